//! Which surfels probably are of the same stuff: their gloss is found together.

use glam::Vec3;
use rayon::prelude::*;

use crate::bake::trace::{PlaceAndNormal, RaySurfel, places_and_normals};
use crate::nearest::{Nearest, grouped, nearest_to};

/// Surfels around one that its gloss is pooled over.
pub(crate) const NEIGHBORS: usize = 64;

/// Of more surfels than so many, those that lie together share their neighbours.
const EACH_OWN: usize = 1 << 12;

/// So many at most do.
const TOGETHER: usize = 8;

/// Surfels, about, among which the nearest are looked for: those of the nearest groups. Of a million Gaussians 96.5 % of the nearest are found, of
/// 250,000 98.4 %; what is found instead is 0.8 and 0.3 % farther.
const ASKED: usize = 256;

/// Of more surfels than this as many more do, up to four times.
const VERY_MANY: usize = 1 << 19;

/// The surfels nearest to each in place and normal: probably of the same stuff.
#[derive(Clone, Debug, Default)]
pub(super) struct Neighbors {
    /// Of one group of surfels that share them after the other: those nearest to the group, itself among them.
    all: Vec<u32>,
    /// Where in `all` each group's end.
    ends: Vec<u32>,
    /// Which one a surfel is of, `[n]`.
    group_of: Vec<u32>,
}

impl Neighbors {
    pub fn new(surfels: &[RaySurfel], normals: &[Vec3]) -> Self {
        let n = normals.len();
        let points = places_and_normals(surfels, normals);
        if n <= EACH_OWN {
            let nearest = Nearest::new(&points, NEIGHBORS);
            let around = |i: usize| nearest.of(i).chain([i]).map(|j| j as u32);
            return Self::of_lists((0..n).map(around), (0..n as u32).collect());
        }
        let mut order: Vec<u32> = (0..n as u32).collect();
        let members = grouped(&points, &mut order, together(n));
        let middle = |group: &&[u32]| -> PlaceAndNormal {
            let sum = |axis: usize| group.iter().map(|i| points[*i as usize][axis]).sum::<f32>();
            std::array::from_fn(|axis| sum(axis) / group.len() as f32)
        };
        let middles: Vec<PlaceAndNormal> = members.iter().map(middle).collect();
        let nearest = nearest_to_groups(&points, &members, &middles, ASKED / together(n));
        let mut group_of = vec![0; n];
        for (group, members) in members.iter().enumerate() {
            for member in *members {
                group_of[*member as usize] = group as u32;
            }
        }
        let lists = members.iter().zip(nearest).map(|(members, mut around)| {
            let is_aside = |member: &&u32| !around.contains(member);
            let aside: Vec<u32> = members.iter().filter(is_aside).copied().collect();
            around.extend(aside);
            around.into_iter()
        });
        Self::of_lists(lists, group_of)
    }

    /// So many surfels, each alone.
    pub fn alone(n: usize) -> Self {
        let each = 0..n as u32;
        Self::of_lists(each.clone().map(std::iter::once), each.collect())
    }

    fn of_lists(
        lists: impl Iterator<Item = impl Iterator<Item = u32>>,
        group_of: Vec<u32>,
    ) -> Self {
        let (mut all, mut ends) = (Vec::new(), Vec::new());
        for list in lists {
            all.extend(list);
            ends.push(all.len() as u32);
        }
        Self {
            all,
            ends,
            group_of,
        }
    }

    fn of_group(&self, group: usize) -> &[u32] {
        let start = group.checked_sub(1).map_or(0, |last| self.ends[last]);
        &self.all[start as usize..self.ends[group] as usize]
    }

    /// Those of each group, itself among them, in parallel.
    pub fn of_groups(&self) -> impl IndexedParallelIterator<Item = &[u32]> {
        (0..self.ends.len())
            .into_par_iter()
            .map(|group| self.of_group(group))
    }

    /// Which group surfel `i` is of.
    pub fn group_of(&self, i: usize) -> usize {
        self.group_of[i] as usize
    }

    /// Those around surfel `i`, itself left out.
    pub fn of(&self, i: usize) -> impl Iterator<Item = usize> + '_ {
        let around = self.of_group(self.group_of(i));
        around.iter().map(|j| *j as usize).filter(move |j| *j != i)
    }
}

/// The points that are nearest to the middle of each group, among those of so many groups around it.
fn nearest_to_groups(
    points: &[PlaceAndNormal],
    members: &[&[u32]],
    middles: &[PlaceAndNormal],
    around: usize,
) -> Vec<Vec<u32>> {
    let groups = nearest_to(middles, middles, around);
    let nearest = |(groups, middle): (&Vec<u32>, &PlaceAndNormal)| {
        let all = groups.iter().flat_map(|group| members[*group as usize]);
        let away = |i: u32| {
            let each = points[i as usize].iter().zip(middle);
            each.map(|(a, b)| (a - b) * (a - b)).sum::<f32>()
        };
        let mut all: Vec<(f32, u32)> = all.map(|i| (away(*i), *i)).collect();
        if all.len() > NEIGHBORS + 1 {
            all.select_nth_unstable_by(NEIGHBORS, |a, b| a.0.total_cmp(&b.0));
            all.truncate(NEIGHBORS + 1);
        }
        all.into_iter().map(|(_, i)| i).collect()
    };
    groups.par_iter().zip(middles).map(nearest).collect()
}

/// How many of so many surfels share their neighbours at most.
fn together(surfels: usize) -> usize {
    (TOGETHER * surfels / VERY_MANY).clamp(TOGETHER, 4 * TOGETHER)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::directional::DirectionalBake;
    use crate::progress::no_progress;
    use crate::synthetic;

    /// A ball of more than have neighbours of their own, as rays meet it.
    fn ball() -> Vec<RaySurfel> {
        let cloud = synthetic::sphere(2 * EACH_OWN);
        let tracer = DirectionalBake::tracer(&cloud, &no_progress).expect("nobody cancels");
        tracer.surfels.clone()
    }

    #[test]
    fn those_that_are_shared_are_hardly_farther() {
        let surfels = ball();
        let normals: Vec<Vec3> = surfels.iter().map(|s| s.position).collect();
        let shared = Neighbors::new(&surfels, &normals);
        assert!(shared.ends.len() * (TOGETHER / 2) <= surfels.len());
        let points: Vec<[f32; 3]> = normals.iter().map(Vec3::to_array).collect();
        let exact = Nearest::new(&points, NEIGHBORS);
        for i in 0..surfels.len() {
            let far = |j: usize| normals[i].distance(normals[j]);
            let [mut shared_far, exact_far]: [Vec<f32>; 2] = [
                shared.of(i).map(far).collect(),
                exact.of(i).map(far).collect(),
            ];
            assert!(shared.of_group(shared.group_of(i)).contains(&(i as u32)));
            shared_far.sort_by(f32::total_cmp);
            let sum = |all: &[f32]| all[..NEIGHBORS].iter().sum::<f32>();
            let ratio = sum(&shared_far) / sum(&exact_far);
            // 64 fill a circle of four times the radius that eight do: whoever is at the edge of those is a quarter off the middle.
            assert!(ratio < 1.3, "{i}: {ratio}");
        }
    }

    /// At a thousand places, and all at one: they cannot be told apart, and have each other.
    #[test]
    fn surfels_at_one_place_have_neighbors() {
        for places in [1, 1000] {
            let mut surfels = ball();
            for (i, surfel) in surfels.iter_mut().enumerate() {
                surfel.position = Vec3::X * (i % places) as f32;
            }
            let shared = Neighbors::new(&surfels, &vec![Vec3::Z; surfels.len()]);
            for i in 0..surfels.len() {
                let around = shared.of_group(shared.group_of(i));
                assert!(around.contains(&(i as u32)) && shared.of(i).count() + 1 == around.len());
                assert!(around.len() > 1, "{places}: {i}");
            }
        }
    }
}
