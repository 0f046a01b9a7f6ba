//! Colour at the nodes that gloss does not explain: kept of glossy surfels; that of the others is what is stored, and made of it where it is asked for.

/// In the place of a row: the colour is what is stored.
const AS_STORED: u32 = u32::MAX;

/// What gloss leaves of some surfels' colour at the nodes.
#[derive(Clone, Debug)]
pub(super) struct MatteColors {
    /// Number of nodes Q.
    nodes: usize,
    /// Which row of `kept` each surfel has. `[n]`
    row_of: Vec<u32>,
    /// `[rows][Q]`
    pub kept: Vec<[f32; 3]>,
}

impl MatteColors {
    /// With rows for some of the surfels, `[n]`, black until they are set.
    pub fn for_those(is_kept: impl Iterator<Item = bool>, nodes: usize) -> Self {
        let mut rows = 0;
        let row_of = is_kept.map(|is_kept| {
            let row = if is_kept { rows } else { AS_STORED };
            rows += u32::from(is_kept);
            row
        });
        Self {
            row_of: row_of.collect(),
            nodes,
            kept: vec![[0.0; 3]; rows as usize * nodes],
        }
    }

    /// The row of surfel `i`, `[Q]`, if its colour is not what is stored.
    pub fn row(&self, i: usize) -> Option<&[[f32; 3]]> {
        let row = self.row_of[i];
        (row != AS_STORED).then(|| &self.kept[row as usize * self.nodes..][..self.nodes])
    }

    /// Those of all surfels, to be set. `[n]`
    pub fn rows_mut(&mut self) -> Vec<Option<&mut [[f32; 3]]>> {
        let mut rows = self.kept.chunks_exact_mut(self.nodes);
        let each = self.row_of.iter();
        each.map(|row| (*row != AS_STORED).then(|| rows.next()).flatten())
            .collect()
    }

    /// Those of some surfels.
    pub fn selected(&self, surfels: &[usize]) -> Self {
        let rows = || surfels.iter().map(|i| self.row(*i));
        let mut selected = Self::for_those(rows().map(|row| row.is_some()), self.nodes);
        let kept = rows().flatten();
        for (new, old) in selected.kept.chunks_exact_mut(self.nodes).zip(kept) {
            new.copy_from_slice(old);
        }
        selected
    }

    /// What it takes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.row_of[..]) + size_of_val(&self.kept[..])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn those_that_are_kept_stay_with_their_surfels() {
        let mut colors = MatteColors::for_those([false, true, true, false].into_iter(), 2);
        for (i, row) in colors.rows_mut().into_iter().enumerate() {
            row.into_iter().for_each(|row| row.fill([i as f32; 3]));
        }
        let rows = |colors: &MatteColors, n: usize| -> Vec<Option<f32>> {
            (0..n).map(|i| colors.row(i).map(|r| r[1][2])).collect()
        };
        assert_eq!(rows(&colors, 4), [None, Some(1.0), Some(2.0), None]);
        let some = colors.selected(&[2, 3, 2, 1]);
        assert_eq!(rows(&some, 4), [Some(2.0), None, Some(2.0), Some(1.0)]);
        assert_eq!(some.bytes(), 4 * 4 + 3 * 2 * 12);
    }
}
