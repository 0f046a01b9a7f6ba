//! Which surfels probably are of the same stuff: their gloss is found together.

use std::num::NonZeroUsize;

use glam::Vec3;
use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

use crate::visibility::trace::RaySurfel;

/// Surfels around one that its gloss is pooled over.
pub(crate) const NEIGHBORS: usize = 64;

/// The surfels nearest in place and normal: probably of the same stuff. `[n][min(NEIGHBORS, n - 1)]`
pub fn neighbors(surfels: &[RaySurfel], normals: &[Vec3]) -> Vec<u32> {
    let n = normals.len();
    let mean_size: f32 = surfels.iter().map(|s| s.major).sum::<f32>() / n.max(1) as f32;
    let unit = 1.0 / (3.0 * mean_size).max(1e-12);
    let points: Vec<[f32; 6]> = surfels
        .iter()
        .zip(normals)
        .map(|(s, n)| {
            let (p, n) = (s.position * unit, *n * 2.0);
            [p.x, p.y, p.z, n.x, n.y, n.z]
        })
        .collect();
    let count = NEIGHBORS.min(n.saturating_sub(1));
    let (Some(wanted), Ok(tree)) = (
        NonZeroUsize::new(count + 1).filter(|_| count > 0),
        ImmutableKdTree::<f32, 6>::new_from_slice(&points),
    ) else {
        return Vec::new();
    };
    points
        .par_iter()
        .enumerate()
        .flat_map_iter(|(i, p)| {
            let found = tree
                .query(p)
                .nearest_n::<SquaredEuclidean<f32>>(wanted)
                .execute();
            let others: Vec<u32> = found
                .into_iter()
                .map(|f| f.item)
                .filter(|j| *j as usize != i)
                .take(count)
                .collect();
            others
        })
        .collect()
}
