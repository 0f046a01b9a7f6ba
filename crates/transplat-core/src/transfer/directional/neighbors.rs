//! Which surfels probably are of the same stuff: their gloss is found together.

use glam::Vec3;
use rayon::prelude::*;

use crate::bake::trace::RaySurfel;
use crate::nearest::{Nearest, nearest_to};

/// Surfels around one that its gloss is pooled over.
pub(crate) const NEIGHBORS: usize = 64;

/// Of more surfels than so many, those that lie together share their neighbours.
const EACH_OWN: usize = 1 << 12;

/// So many at most do.
const TOGETHER: usize = 8;

/// Place and normal, in units in which both tell alike.
type Point = [f32; 6];

/// Surfels that share their neighbours.
#[derive(Clone, Debug)]
struct Group {
    /// Those nearest to it in place and normal, itself among them.
    around: Vec<u32>,
}

/// The surfels nearest to each in place and normal: probably of the same stuff.
#[derive(Clone, Debug, Default)]
pub(super) struct Neighbors {
    groups: Vec<Group>,
    /// Which one a surfel is of, `[n]`.
    group_of: Vec<u32>,
}

impl Neighbors {
    pub fn new(surfels: &[RaySurfel], normals: &[Vec3]) -> Self {
        let n = normals.len();
        let mean_size: f32 = surfels.iter().map(|s| s.major).sum::<f32>() / n.max(1) as f32;
        let unit = 1.0 / (3.0 * mean_size).max(1e-12);
        let points: Vec<Point> = surfels
            .iter()
            .zip(normals)
            .map(|(s, n)| {
                let (p, n) = (s.position * unit, *n * 2.0);
                [p.x, p.y, p.z, n.x, n.y, n.z]
            })
            .collect();
        if n <= EACH_OWN {
            let nearest = Nearest::new(&points, NEIGHBORS);
            let group = |i: usize| Group {
                around: nearest.of(i).chain([i]).map(|j| j as u32).collect(),
            };
            return Self {
                groups: (0..n).map(group).collect(),
                group_of: (0..n as u32).collect(),
            };
        }
        let mut order: Vec<u32> = (0..n as u32).collect();
        let members = grouped(&points, &mut order);
        let middle = |group: &&[u32]| -> Point {
            let sum = |axis: usize| group.iter().map(|i| points[*i as usize][axis]).sum::<f32>();
            std::array::from_fn(|axis| sum(axis) / group.len() as f32)
        };
        let middles: Vec<Point> = members.iter().map(middle).collect();
        let nearest = nearest_to(&points, &middles, NEIGHBORS + 1);
        let mut group_of = vec![0; n];
        for (group, members) in members.iter().enumerate() {
            for member in *members {
                group_of[*member as usize] = group as u32;
            }
        }
        let each = members.iter().zip(nearest.chunks(NEIGHBORS + 1));
        let groups = each.map(|(members, nearest)| {
            let aside = members.iter().filter(|member| !nearest.contains(member));
            Group {
                around: nearest.iter().chain(aside).copied().collect(),
            }
        });
        Self {
            groups: groups.collect(),
            group_of,
        }
    }

    /// Those of each group, itself among them, in parallel.
    pub fn of_groups(&self) -> impl IndexedParallelIterator<Item = &[u32]> {
        self.groups.par_iter().map(|group| &group.around[..])
    }

    /// Which group surfel `i` is of.
    pub fn group_of(&self, i: usize) -> usize {
        self.group_of[i] as usize
    }

    /// Those around surfel `i`, itself left out.
    pub fn of(&self, i: usize) -> impl Iterator<Item = usize> + '_ {
        let around = &self.groups[self.group_of(i)].around;
        around.iter().map(|j| *j as usize).filter(move |j| *j != i)
    }
}

/// Points that lie together, at most [`TOGETHER`] each: halved across where they reach farthest, until they are so few.
fn grouped<'a>(points: &[Point], of: &'a mut [u32]) -> Vec<&'a [u32]> {
    if of.len() <= TOGETHER {
        return vec![of];
    }
    let reach = |axis: usize| {
        let each = of.iter().map(|i| points[*i as usize][axis]);
        let (low, high) = each.fold((f32::MAX, f32::MIN), |(a, b), x| (a.min(x), b.max(x)));
        high - low
    };
    let reaches: [f32; 6] = std::array::from_fn(reach);
    let widest = (0..6).max_by(|a, b| reaches[*a].total_cmp(&reaches[*b]));
    let axis = widest.unwrap_or_default();
    let along = |i: &u32| points[*i as usize][axis];
    let half = of.len() / 2;
    of.select_nth_unstable_by(half, |a, b| along(a).total_cmp(&along(b)));
    let (low, high) = of.split_at_mut(half);
    let (mut low, high) = rayon::join(|| grouped(points, low), || grouped(points, high));
    low.extend(high);
    low
}
