//! Directional visibility: what each surfel sees in each direction, open sky or another surfel.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::strata::{DIRECTIONS, Hit, WORDS, directions};
use super::visibility_clusters::VisibilityClusters;

/// Directional visibility of each surfel.
#[derive(Clone, Debug)]
pub struct DirectionalVisibility {
    /// Clusters of surfels with the same visibility.
    pub visibility_clusters: Arc<VisibilityClusters>,
    /// Open directions, a bit each. `[rows][WORDS]`
    pub open: Vec<[u64; WORDS]>,
    /// Where the blocked directions of each row begin in `hits`. `[rows + 1]`
    pub starts: Vec<u32>,
    /// Blocked directions among those that know what is met, by patch: those in front and, where there are two sides, those behind.
    pub hits: Vec<Hit>,
}

impl DirectionalVisibility {
    /// Blocked directions of surfel `i` that know what they meet.
    pub fn hits_of(&self, i: usize) -> &[Hit] {
        self.hits_of_row(self.visibility_clusters.row(i))
    }

    /// Hits of a row.
    pub fn hits_of_row(&self, row: usize) -> &[Hit] {
        &self.hits[self.starts[row] as usize..self.starts[row + 1] as usize]
    }

    /// Open directions of surfel `i`, a bit each.
    #[inline(always)]
    pub fn open_of(&self, i: usize) -> &[u64; WORDS] {
        &self.open[self.visibility_clusters.row(i)]
    }

    /// True where surfel `i` sees all the way out towards direction `j`.
    #[inline(always)]
    pub fn is_open(&self, i: usize, j: usize) -> bool {
        is_open(self.open_of(i), j)
    }

    /// Openness of each direction around surfel `i`, 0 or 1.
    pub fn seen_by(&self, i: usize) -> Vec<(Vec3, f32)> {
        let each = directions().into_iter().enumerate();
        each.map(|(j, d)| (d, f32::from(u8::from(self.is_open(i, j)))))
            .collect()
    }

    /// Cosine-weighted share of the front side's hemisphere that is open, `[n]`, 0 to 1.
    pub fn openness(&self, normals: &[Vec3]) -> Vec<f32> {
        let directions = directions();
        (normals.par_iter().enumerate())
            .map(|(i, n)| openness(self.open_of(i), &directions, *n)[0].clamp(0.0, 1.0))
            .collect()
    }

    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        size_of_val(&self.visibility_clusters.row_of[..])
            + size_of_val(&self.visibility_clusters.leaders[..])
            + size_of_val(&self.open[..])
            + size_of_val(&self.starts[..])
            + size_of_val(&self.hits[..])
    }
}

/// True where a hit in a direction counts: in front and, where there are two sides, behind.
pub(super) fn sees(normal: Vec3, two_sided: f32, direction: Vec3) -> bool {
    two_sided > 0.0 || normal.dot(direction) > 0.0
}

/// True where a ray hits the back of a surfel: that of a two-sided one, from behind.
pub(super) fn is_met_on_back(normal: Vec3, two_sided: f32, direction: Vec3) -> bool {
    two_sided > 0.0 && normal.dot(direction) > 0.0
}

pub(super) fn is_open(open: &[u64; WORDS], j: usize) -> bool {
    open[j / 64] >> (j % 64) & 1 == 1
}

/// Cosine-weighted share of the two sides' hemispheres that is open, 0 to 1.
pub(super) fn openness(open: &[u64; WORDS], lattice: &[Vec3], n: Vec3) -> [f32; 2] {
    let mut sides = [0f32; 2];
    for (j, w) in lattice.iter().enumerate() {
        if is_open(open, j) {
            let cosine = n.dot(*w);
            sides[usize::from(cosine < 0.0)] += cosine.abs();
        }
    }
    sides.map(|s| s * 4.0 / DIRECTIONS as f32)
}
