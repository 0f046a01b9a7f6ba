//! Rows of colours, in sixteen bits a number where there are very many.

use std::borrow::Cow;
use std::ops::Range;

use rayon::prelude::*;

/// Stored value of the largest number of a short row.
const LARGEST: f32 = i16::MAX as f32;

/// From so many surfels on rows are short: what is kept to relight a million, of degree 3, takes 160 MB less, and what is shown relit of it 92 MB.
pub(crate) const SHORT_FROM: usize = 1 << 17;

/// Rows of colours.
#[derive(Clone, Debug)]
pub struct ColorRows {
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
        /// Unit of each row. `[rows]`
        units: Vec<f32>,
    },
}

/// A row to be set.
pub(crate) enum RowMut<'a> {
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

    /// Rows of that width that are there, as they are.
    pub fn whole(values: Vec<[f32; 3]>, width: usize) -> Self {
        let rows = Rows::Whole(values);
        Self { width, rows }
    }

    /// Stores colours, very many of them in sixteen bits with one unit a surfel.
    pub fn of(values: Vec<[f32; 3]>, width: usize) -> Self {
        let rows = values.len() / width;
        if rows < SHORT_FROM {
            return Self::whole(values, width);
        }
        let mut short = Self::new(rows, width, rows);
        let copy = |_: &mut (), first: usize, out: &mut [[f32; 3]]| {
            out.copy_from_slice(&values[first * width..][..out.len()]);
        };
        short.fill(|| (), copy);
        short
    }

    /// Number of rows.
    pub fn len(&self) -> usize {
        let values = match &self.rows {
            Rows::Whole(values) => values.len(),
            Rows::Short { values, .. } => values.len(),
        };
        values / self.width
    }

    /// True without any row.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// All of them, one after the other. `[rows][width]`
    pub fn values(&self) -> Cow<'_, [[f32; 3]]> {
        match &self.rows {
            Rows::Whole(values) => values.into(),
            Rows::Short { values, units } => {
                let mut all = vec![[0.0; 3]; values.len()];
                let rows = all.par_chunks_exact_mut(self.width);
                let stored = values.par_chunks_exact(self.width).zip(units);
                rows.zip(stored).for_each(|(row, (stored, unit))| {
                    for (v, stored) in row.iter_mut().zip(stored) {
                        *v = of_unit(*unit)(stored);
                    }
                });
                all.into()
            }
        }
    }

    /// Colours in full precision, without a copy of those that are kept so.
    pub fn into_values(self) -> Vec<[f32; 3]> {
        match self.rows {
            Rows::Whole(values) => values,
            Rows::Short { .. } => self.values().into_owned(),
        }
    }

    /// A row, `[width]`, by way of `read` where it is a short one.
    #[inline(always)]
    pub fn row<'a>(&'a self, at: usize, read: &'a mut Vec<[f32; 3]>) -> &'a [[f32; 3]] {
        let range = at * self.width..(at + 1) * self.width;
        match &self.rows {
            Rows::Whole(values) => &values[range],
            Rows::Short { values, units } => {
                read.clear();
                read.extend(values[range].iter().map(of_unit(units[at])));
                read
            }
        }
    }

    /// The sum of some colours of a row, each as often as its weight says.
    #[inline(always)]
    pub fn weighted(
        &self,
        at: usize,
        some: Range<usize>,
        weight: impl Fn(usize) -> f32,
    ) -> [f32; 3] {
        let own = at * self.width..(at + 1) * self.width;
        let first = some.start;
        match &self.rows {
            Rows::Whole(values) => {
                let weights = some.clone().map(weight);
                weighted_sum(values[own][some].iter().copied().zip(weights))
            }
            Rows::Short { values, units } => {
                let mut sum = [0.0; 3];
                for (chunk, stored) in values[own][some].chunks(AT_ONCE).enumerate() {
                    // In a loop of its own this is many numbers an instruction.
                    let mut colors = [[0f32; 3]; AT_ONCE];
                    let each = colors.as_flattened_mut().iter_mut();
                    each.zip(stored.as_flattened())
                        .for_each(|(v, stored)| *v = f32::from(*stored));
                    let weights = (first + chunk * AT_ONCE..).map(&weight);
                    let some = colors[..stored.len()].iter().copied().zip(weights);
                    let more = weighted_sum(some);
                    sum = std::array::from_fn(|c| sum[c] + more[c]);
                }
                sum.map(|v| v * units[at])
            }
        }
    }

    /// Sets all rows, some after each other and those pieces side by side: `fill` gets what a thread keeps, a piece's first row, and rows to be
    /// set, whatever they hold.
    pub fn fill<S>(
        &mut self,
        init: impl Fn() -> S + Send + Sync,
        fill: impl Fn(&mut S, usize, &mut [[f32; 3]]) + Send + Sync,
    ) {
        let width = self.width;
        match &mut self.rows {
            Rows::Whole(values) => {
                let pieces = values.par_chunks_mut(PIECE * width).enumerate();
                pieces.for_each_init(init, |kept, (at, out)| fill(kept, at * PIECE, out));
            }
            Rows::Short { values, units } => {
                let pieces = values.par_chunks_mut(PIECE * width);
                let pieces = pieces.zip(units.par_chunks_mut(PIECE)).enumerate();
                let init = || (init(), Vec::new());
                pieces.for_each_init(init, |(kept, out), (at, (values, units))| {
                    out.clear();
                    out.resize(values.len(), [0.0; 3]);
                    fill(kept, at * PIECE, out);
                    let rows = values.chunks_exact_mut(width).zip(units);
                    for ((values, unit), row) in rows.zip(out.chunks_exact_mut(width)) {
                        RowMut::Short(values, unit).store(row);
                    }
                });
            }
        }
    }

    /// All rows, to be set. `[rows]`
    pub(crate) fn rows_mut(&mut self) -> Vec<RowMut<'_>> {
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

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        match &self.rows {
            Rows::Whole(values) => size_of_val(&values[..]),
            Rows::Short { values, units } => size_of_val(&values[..]) + size_of_val(&units[..]),
        }
    }
}

/// Colours of a row that are read at once: all of degree 3.
const AT_ONCE: usize = 16;

/// Rows that are set one after the other.
const PIECE: usize = 512;

/// Decoder of a row with a unit.
fn of_unit(unit: f32) -> impl Fn(&[i16; 3]) -> [f32; 3] {
    move |stored| stored.map(|s| f32::from(s) * unit)
}

/// The sum of colours, each as often as its weight says.
#[inline(always)]
pub(crate) fn weighted_sum(each: impl Iterator<Item = ([f32; 3], f32)>) -> [f32; 3] {
    each.fold([0.0; 3], |[r, g, b], (v, w)| {
        [r + v[0] * w, g + v[1] * w, b + v[2] * w]
    })
}

/// Some rows of a table whose rows are that wide.
pub(crate) fn rows_of<T: Copy>(table: &[T], width: usize, taken: &[usize]) -> Vec<T> {
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
            let values = kept.concat();
            assert_eq!(*table.values(), values);
            let weighted = table.weighted(3, 0..2, |q| [2.0, -1.0][q]);
            for (c, v) in weighted.into_iter().enumerate() {
                let expected = 2.0 * kept[3][0][c] - kept[3][1][c];
                assert!((v - expected).abs() <= 1e-6 * expected.abs());
            }
            let mut filled = ColorRows::new(rows.len(), 2, if are_short { SHORT_FROM } else { 0 });
            filled.fill(
                || (),
                |(), first, out| {
                    out.copy_from_slice(&rows.concat()[2 * first..][..out.len()]);
                },
            );
            assert_eq!(filled.into_values(), values);
            let some = table.selected(&[2, 0]);
            assert_eq!(some.row(1, &mut read), kept[0]);
            assert_eq!(some.bytes(), 2 * each);
        }
    }

    #[test]
    fn rows_are_short_from_so_many_on_and_all_of_them_are_filled() {
        for n in [SHORT_FROM - 1, SHORT_FROM] {
            let values: Vec<[f32; 3]> = (0..n).map(|i| [i as f32, 1.0, -0.5 * i as f32]).collect();
            let rows = ColorRows::of(values.clone(), 1);
            let is_short = rows.bytes() < 12 * n;
            assert_eq!((rows.len(), is_short), (n, n == SHORT_FROM));
            for (a, b) in values.iter().zip(&*rows.values()) {
                let largest = a[0].max(1.0);
                let most = if is_short { 1.6e-5 * largest } else { 0.0 };
                assert!((0..3).all(|c| (a[c] - b[c]).abs() <= most), "{a:?} {b:?}");
            }
        }
    }

    /// Of a degree whose row is longer than what is read at once, from the middle on.
    #[test]
    fn a_part_of_a_long_row_is_summed() {
        let row: Vec<[f32; 3]> = (0..25).map(|q| [q as f32, 1.0, 3.0 - q as f32]).collect();
        let weight = |q: usize| 1.0 / (1 + q) as f32;
        for surfels in [1, SHORT_FROM] {
            let mut rows = ColorRows::new(1, 25, surfels);
            rows.fill(|| (), |(), _, out| out.copy_from_slice(&row));
            let held = rows.values();
            let sum = rows.weighted(0, 3..25, weight);
            for (c, sum) in sum.into_iter().enumerate() {
                let each = (3..25).map(|q| f64::from(held[q][c]) * f64::from(weight(q)));
                // A rounding of each of 22 products, which come to 22 at most.
                let expected: f64 = each.sum();
                assert!((f64::from(sum) - expected).abs() < 3e-5, "{sum} {expected}");
            }
        }
    }
}
