//! Which surfels probably are of the same stuff: their gloss is found together.

use glam::Vec3;

use crate::bake::trace::RaySurfel;
use crate::nearest::Nearest;

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
    Nearest::new(&points, NEIGHBORS).all
}
