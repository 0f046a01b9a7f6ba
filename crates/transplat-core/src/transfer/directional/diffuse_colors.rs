//! Diffuse colour at the quadrature nodes: kept for specular surfels; that of the others is decoded from what is stored on demand.

use crate::color_rows::{ColorRows, RowMut};

/// In the place of a row: the colour is what is stored.
const AS_STORED: u32 = u32::MAX;

/// Diffuse colour of some surfels at the nodes, the specular lobe subtracted.
#[derive(Clone, Debug)]
pub(super) struct DiffuseColors {
    /// Row of `kept` of each surfel. `[n]`
    row_of: Vec<u32>,
    /// `[rows][Q]`
    pub kept: ColorRows,
}

impl DiffuseColors {
    /// With rows for some of the surfels, `[n]`, black until they are set.
    pub fn for_those(is_kept: impl Iterator<Item = bool>, nodes: usize) -> Self {
        let (row_of, rows) = numbered(is_kept);
        Self {
            kept: ColorRows::new(rows, nodes, row_of.len()),
            row_of,
        }
    }

    /// The row of surfel `i`, `[Q]`, if its colour is not what is stored; by way of `read`, as [`ColorRows::row`] has it.
    pub fn row<'a>(&'a self, i: usize, read: &'a mut Vec<[f32; 3]>) -> Option<&'a [[f32; 3]]> {
        let row = self.row_of[i];
        (row != AS_STORED).then(|| self.kept.row(row as usize, read))
    }

    /// Rows of all surfels, to be set. `[n]`
    pub fn rows_mut(&mut self) -> Vec<Option<RowMut<'_>>> {
        let mut rows = self.kept.rows_mut().into_iter();
        let each = self.row_of.iter();
        each.map(|row| (*row != AS_STORED).then(|| rows.next()).flatten())
            .collect()
    }

    /// Colours of some surfels.
    pub fn selected(&self, surfels: &[usize]) -> Self {
        let kept: Vec<usize> = (surfels.iter().map(|i| self.row_of[*i]))
            .filter(|row| *row != AS_STORED)
            .map(|row| row as usize)
            .collect();
        let are_kept = surfels.iter().map(|i| self.row_of[*i] != AS_STORED);
        Self {
            kept: self.kept.selected(&kept),
            row_of: numbered(are_kept).0,
        }
    }

    /// Bytes in memory.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.row_of[..]) + self.kept.bytes()
    }
}

/// Row of each surfel, if it has one, and the number of rows.
fn numbered(is_kept: impl Iterator<Item = bool>) -> (Vec<u32>, usize) {
    let mut rows = 0;
    let row_of = is_kept.map(|is_kept| {
        let row = if is_kept { rows } else { AS_STORED };
        rows += u32::from(is_kept);
        row
    });
    (row_of.collect(), rows as usize)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn those_that_are_kept_stay_with_their_surfels() {
        let mut colors = DiffuseColors::for_those([false, true, true, false].into_iter(), 2);
        for (i, row) in colors.rows_mut().into_iter().enumerate() {
            let mut values = [[i as f32; 3]; 2];
            row.into_iter().for_each(|row| row.store(&mut values));
        }
        let rows = |colors: &DiffuseColors, n: usize| -> Vec<Option<f32>> {
            let mut read = Vec::new();
            (0..n)
                .map(|i| colors.row(i, &mut read).map(|r| r[1][2]))
                .collect()
        };
        assert_eq!(rows(&colors, 4), [None, Some(1.0), Some(2.0), None]);
        let some = colors.selected(&[2, 3, 2, 1]);
        assert_eq!(rows(&some, 4), [Some(2.0), None, Some(2.0), Some(1.0)]);
        assert_eq!(some.bytes(), 4 * 4 + 3 * 2 * 12);
    }
}
