//! Morton order (Morton 1966): points whose bits are interleaved, so that what lies near in space lies near in memory.

use glam::Vec3;
use rayon::prelude::*;

/// Bits an axis: what a far sky takes of them still leaves enough for the object.
const BITS: u32 = 21;

/// Indices of points so that neighbours follow each other; those that are no numbers come last.
pub fn neighborhood_order(points: &[Vec3]) -> Vec<u32> {
    let finite = || points.par_iter().filter(|p| p.is_finite());
    let low = finite().copied().reduce(|| Vec3::INFINITY, Vec3::min);
    let high = finite().copied().reduce(|| Vec3::NEG_INFINITY, Vec3::max);
    let extent = (high - low).max_element().max(f32::MIN_POSITIVE);
    let scale = f64::from((1u32 << BITS) - 1) / f64::from(extent);
    let code = |p: &Vec3| {
        if !p.is_finite() {
            return u64::MAX;
        }
        let [x, y, z] = [0, 1, 2].map(|c| spread((f64::from(p[c] - low[c]) * scale) as u64));
        x | (y << 1) | (z << 2)
    };
    let mut keyed: Vec<(u64, u32)> = points.par_iter().map(code).zip(indices(points)).collect();
    keyed.par_sort_unstable();
    keyed.into_par_iter().map(|(_, i)| i).collect()
}

fn indices(points: &[Vec3]) -> impl IndexedParallelIterator<Item = u32> {
    (0..points.len() as u32).into_par_iter()
}

/// Two empty bits between each two of the lowest 21.
fn spread(v: u64) -> u64 {
    let mut x = v & 0x1f_ffff;
    x = (x | (x << 32)) & 0x001f_0000_0000_ffff;
    x = (x | (x << 16)) & 0x001f_0000_ff00_00ff;
    x = (x | (x << 8)) & 0x100f_00f0_0f00_f00f;
    x = (x | (x << 4)) & 0x10c3_0c30_c30c_30c3;
    (x | (x << 2)) & 0x1249_2492_4924_9249
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sh::lattice;

    #[test]
    fn bits_are_spread_and_none_is_lost() {
        for bit in 0..BITS {
            assert_eq!(spread(1 << bit), 1 << (3 * bit));
        }
    }

    #[test]
    fn neighbours_follow_each_other_though_a_point_is_far_away_and_one_nowhere() {
        let mut points = lattice(1000);
        points.push(Vec3::splat(1000.0));
        points.push(Vec3::NAN);
        let order = neighborhood_order(&points);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.into_iter().eq(0..1002));
        assert_eq!(order[1000..], [1000, 1001]);
        let step = |order: &[u32]| -> f32 {
            let pairs = order.windows(2);
            pairs
                .map(|p| points[p[0] as usize].distance(points[p[1] as usize]))
                .sum()
        };
        let spiral: Vec<u32> = (0..1000).collect();
        assert!(step(&order[..1000]) < 0.3 * step(&spiral));
        assert!(neighborhood_order(&[]).is_empty());
        assert_eq!(neighborhood_order(&[Vec3::NAN]), [0]);
    }
}
