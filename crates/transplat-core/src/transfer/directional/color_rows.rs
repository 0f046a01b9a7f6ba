//! Rows of colours: of very many in sixteen bits a number, half of what they would take.

/// What the largest number of a short row is stored as.
const LARGEST: f32 = i16::MAX as f32;

/// From so many surfels on rows are short: a million, of degree 3, take 160 MB less.
pub(crate) const SHORT_FROM: usize = 1 << 17;

/// Rows of colours.
#[derive(Clone, Debug)]
pub(super) struct ColorRows {
    /// Colours a row.
    width: usize,
    rows: Rows,
}

#[derive(Clone, Debug)]
enum Rows {
    /// `[rows][width]`
    Whole(Vec<[f32; 3]>),
    /// Each row's numbers in units of its own: off by half a unit at most, 1.5e-5 of the row's largest.
    Short {
        /// `[rows][width]`
        values: Vec<[i16; 3]>,
        /// What a 1 stands for. `[rows]`
        units: Vec<f32>,
    },
}

/// A row to be set.
pub(super) enum RowMut<'a> {
    Whole(&'a mut [[f32; 3]]),
    Short(&'a mut [[i16; 3]], &'a mut f32),
}

impl RowMut<'_> {
    /// Stores a row, and makes of it what was stored.
    pub fn store(self, row: &mut [[f32; 3]]) {
        match self {
            RowMut::Whole(stored) => stored.copy_from_slice(row),
            RowMut::Short(stored, unit) => {
                let largest = row.iter().flatten().fold(0f32, |a, v| a.max(v.abs()));
                // What is no number is 0, as is what is too faint for a unit, and what has no end nearly the largest there is.
                *unit = largest.min(0.5 * f32::MAX) / LARGEST;
                let over = if *unit >= f32::MIN_POSITIVE {
                    1.0 / *unit
                } else {
                    0.0
                };
                for (stored, row) in stored.iter_mut().zip(row) {
                    *stored = row.map(|v| (v * over).round().clamp(-LARGEST, LARGEST) as i16);
                    *row = stored.map(|s| f32::from(s) * *unit);
                }
            }
        }
    }
}

impl ColorRows {
    /// So many rows of that width, all zero, for an asset of so many surfels.
    pub fn new(rows: usize, width: usize, surfels: usize) -> Self {
        let rows = match surfels >= SHORT_FROM {
            true => Rows::Short {
                values: vec![[0; 3]; rows * width],
                units: vec![0.0; rows],
            },
            false => Rows::Whole(vec![[0.0; 3]; rows * width]),
        };
        Self { width, rows }
    }

    /// A row, `[width]`, by way of `read` where it is a short one.
    #[inline(always)]
    pub fn row<'a>(&'a self, at: usize, read: &'a mut Vec<[f32; 3]>) -> &'a [[f32; 3]] {
        let range = at * self.width..(at + 1) * self.width;
        match &self.rows {
            Rows::Whole(values) => &values[range],
            Rows::Short { values, units } => {
                read.clear();
                let each = values[range].iter();
                read.extend(each.map(|stored| stored.map(|s| f32::from(s) * units[at])));
                read
            }
        }
    }

    /// All rows, to be set. `[rows]`
    pub fn rows_mut(&mut self) -> Vec<RowMut<'_>> {
        match &mut self.rows {
            Rows::Whole(values) => {
                let rows = values.chunks_exact_mut(self.width);
                rows.map(RowMut::Whole).collect()
            }
            Rows::Short { values, units } => {
                let rows = values.chunks_exact_mut(self.width).zip(units);
                rows.map(|(row, unit)| RowMut::Short(row, unit)).collect()
            }
        }
    }

    /// Some of the rows.
    pub fn selected(&self, rows: &[usize]) -> Self {
        let rows = match &self.rows {
            Rows::Whole(values) => Rows::Whole(rows_of(values, self.width, rows)),
            Rows::Short { values, units } => Rows::Short {
                values: rows_of(values, self.width, rows),
                units: rows_of(units, 1, rows),
            },
        };
        Self { rows, ..*self }
    }

    /// What it takes.
    pub fn bytes(&self) -> usize {
        match &self.rows {
            Rows::Whole(values) => size_of_val(&values[..]),
            Rows::Short { values, units } => size_of_val(&values[..]) + size_of_val(&units[..]),
        }
    }

    /// What it would take less if its numbers had half the bits.
    pub fn bytes_saved_by_half(&self) -> usize {
        match &self.rows {
            Rows::Whole(values) => size_of_val(&values[..]) / 2,
            Rows::Short { .. } => 0,
        }
    }

    /// Changes all numbers that are whole.
    pub fn change_whole(&mut self, change: impl Fn(&mut [[f32; 3]])) {
        if let Rows::Whole(values) = &mut self.rows {
            change(values);
        }
    }
}

/// Some rows of a table whose rows are that wide.
pub(super) fn rows_of<T: Copy>(table: &[T], width: usize, taken: &[usize]) -> Vec<T> {
    let row = |i: &usize| table[i * width..][..width].iter().copied();
    taken.iter().flat_map(row).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_comes_back_whole_or_off_by_half_a_unit() {
        let rows = [
            vec![[1.0, -0.5, 0.1], [1e-3, 0.0, -1.0]],
            vec![[1e-30, 3e-31, 0.0], [-1e-30, 0.0, 0.0]],
            vec![[0.0; 3]; 2],
            vec![[-1e38, 3e37, 2e33], [f32::MIN_POSITIVE, 0.0, 0.0]],
        ];
        for (are_short, most_off, each) in [(false, 0.0, 2 * 12), (true, 1.6e-5, 2 * 6 + 4)] {
            let mut table = ColorRows::new(rows.len(), 2, if are_short { SHORT_FROM } else { 0 });
            let mut kept = rows.clone();
            for (row, kept) in table.rows_mut().into_iter().zip(&mut kept) {
                row.store(kept);
            }
            let mut read = Vec::new();
            for (at, (row, kept)) in rows.iter().zip(&kept).enumerate() {
                assert_eq!(table.row(at, &mut read), kept);
                let largest = row.iter().flatten().fold(0f32, |a, v| a.max(v.abs()));
                for (a, b) in row.iter().flatten().zip(kept.iter().flatten()) {
                    assert!((a - b).abs() <= most_off * largest, "{a} {b}");
                }
            }
            if are_short {
                let mut odd = vec![
                    [f32::NAN, f32::NEG_INFINITY, 1.0],
                    [0.0, 1e30, f32::INFINITY],
                ];
                let mut faint = vec![[1e-40, -1e-40, 0.0]; 2];
                let mut rows = table.clone();
                let mut rows = rows.rows_mut().into_iter();
                rows.next().expect("four").store(&mut odd);
                rows.next().expect("four").store(&mut faint);
                assert!(odd.iter().flatten().all(|v| v.is_finite()));
                assert_eq!((odd[0][0], faint[0]), (0.0, [0.0; 3]));
            }
            let some = table.selected(&[2, 0]);
            assert_eq!(some.row(1, &mut read), kept[0]);
            assert_eq!(some.bytes(), 2 * each);
        }
    }
}
