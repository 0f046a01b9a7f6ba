//! Neighbours that probably share a material: their specular lobes are fitted together.

use rayon::prelude::*;

use crate::bake::trace::PlaceAndNormal;
use crate::nearest::{Nearest, grouped, nearest_to};

/// Surfels around one that its gloss is pooled over.
pub(crate) const NEIGHBORS: usize = 64;

/// Surfels from which on those that lie together share their neighbours.
const EACH_OWN: usize = 1 << 12;

/// So many that are asked do.
const TOGETHER: usize = 8;

/// Surfels, about, among which the nearest are looked for: those of the nearest groups. Of a million Gaussians 96.5 % of the nearest are found, of
/// 250,000 98.4 %; what is found instead is 0.8 and 0.3 % farther.
const LOOKED_AT: usize = 256;

/// Surfels up to which each takes part; of more one in two to [`FEWEST_ASKED`].
const ALL_ASKED: usize = 1 << 17;

/// One in so many surfels is asked, at least.
const FEWEST_ASKED: usize = 4;

/// Error of the relit colour of single surfels (relative L2) by sharing: 2 to 12 % on six objects of 240,000, most of it 4 to 6, of which the truth
/// gets nearer.
pub(super) const SHARED_LOBES_ERROR: f32 = 0.12;

/// The surfels nearest to each in place and normal: probably of the same stuff.
///
/// Of very many not each is asked what it is made of: of those that lie together only the ones that make up most of what is seen. As many
/// neighbours as else are then a little farther.
#[derive(Clone, Debug, Default)]
pub(super) struct Neighbors {
    /// Neighbours of one group after the other: those nearest to the group, its own among them.
    all: Vec<u32>,
    /// Where in `all` each group's end.
    ends: Vec<u32>,
    /// Group of each surfel, `[n]`.
    group_of: Vec<u32>,
    /// Surfels that take part: only they are anyone's neighbours.
    asked: Vec<u32>,
    /// Where in `asked` each is, or [`NOT_ASKED`]. `[n]`
    place_of: Vec<u32>,
}

/// Stride of the surfels that take part, of so many.
pub(super) fn asked_one_in(surfels: usize) -> usize {
    surfels.div_ceil(ALL_ASKED).clamp(1, FEWEST_ASKED)
}

/// In the place of a place.
const NOT_ASKED: u32 = u32::MAX;

impl Neighbors {
    /// One in so many is asked; `visible_weight` is how much each makes up of what is seen, `[n]`.
    pub fn new(points: &[PlaceAndNormal], one_in: usize, visible_weight: &[f32]) -> Self {
        let n = points.len();
        if n <= EACH_OWN && one_in == 1 {
            let nearest = Nearest::new(points, NEIGHBORS);
            let around = |i: usize| nearest.of(i).chain([i]).map(|j| j as u32);
            let each: Vec<u32> = (0..n as u32).collect();
            return Self::of_lists((0..n).map(around), each.clone(), each);
        }
        let mut order: Vec<u32> = (0..n as u32).collect();
        let members = grouped(points, &mut order, TOGETHER * one_in);
        let asked_of = |group: &&[u32]| -> Vec<u32> {
            let mut asked = group.to_vec();
            if one_in > 1 {
                let seen = |i: &u32| visible_weight[*i as usize];
                asked.sort_by(|a, b| seen(b).total_cmp(&seen(a)));
                asked.truncate(group.len().div_ceil(one_in));
            }
            asked
        };
        let asked: Vec<Vec<u32>> = members.par_iter().map(asked_of).collect();
        let middle = |group: &&[u32]| -> PlaceAndNormal {
            let sum = |axis: usize| group.iter().map(|i| points[*i as usize][axis]).sum::<f32>();
            std::array::from_fn(|axis| sum(axis) / group.len() as f32)
        };
        let middles: Vec<PlaceAndNormal> = members.iter().map(middle).collect();
        let nearest = nearest_to_groups(points, &asked, &middles);
        let mut group_of = vec![0; n];
        for (group, members) in members.iter().enumerate() {
            for member in *members {
                group_of[*member as usize] = group as u32;
            }
        }
        let lists = asked.iter().zip(nearest).map(|(members, mut around)| {
            let is_aside = |member: &&u32| !around.contains(member);
            let aside: Vec<u32> = members.iter().filter(is_aside).copied().collect();
            around.extend(aside);
            around.into_iter()
        });
        // As they lie in memory.
        let mut in_order = asked.concat();
        in_order.sort_unstable();
        Self::of_lists(lists, group_of, in_order)
    }

    fn of_lists(
        lists: impl Iterator<Item = impl Iterator<Item = u32>>,
        group_of: Vec<u32>,
        asked: Vec<u32>,
    ) -> Self {
        let (mut all, mut ends) = (Vec::new(), Vec::new());
        for list in lists {
            all.extend(list);
            ends.push(all.len() as u32);
        }
        let mut place_of = vec![NOT_ASKED; group_of.len()];
        for (place, i) in asked.iter().enumerate() {
            place_of[*i as usize] = place as u32;
        }
        Self {
            all,
            ends,
            group_of,
            asked,
            place_of,
        }
    }

    /// The surfels that are asked.
    pub fn asked(&self) -> &[u32] {
        &self.asked
    }

    /// Index of surfel `i` among those that take part.
    pub fn place_of(&self, i: usize) -> Option<usize> {
        let place = self.place_of[i];
        (place != NOT_ASKED).then_some(place as usize)
    }

    fn of_group(&self, group: usize) -> &[u32] {
        let start = group.checked_sub(1).map_or(0, |last| self.ends[last]);
        &self.all[start as usize..self.ends[group] as usize]
    }

    /// Neighbours of each group, its own among them, in parallel.
    pub fn of_groups(&self) -> impl IndexedParallelIterator<Item = &[u32]> {
        (0..self.ends.len())
            .into_par_iter()
            .map(|group| self.of_group(group))
    }

    /// Group of surfel `i`.
    pub fn group_of(&self, i: usize) -> usize {
        self.group_of[i] as usize
    }

    /// Neighbours of surfel `i`, itself left out.
    pub fn of(&self, i: usize) -> impl Iterator<Item = usize> + '_ {
        let around = self.of_group(self.group_of(i));
        around.iter().map(|j| *j as usize).filter(move |j| *j != i)
    }
}

/// The points that are nearest to the middle of each group, among those that are asked of the groups around it.
fn nearest_to_groups(
    points: &[PlaceAndNormal],
    asked: &[Vec<u32>],
    middles: &[PlaceAndNormal],
) -> Vec<Vec<u32>> {
    let groups = nearest_to(middles, middles, LOOKED_AT / TOGETHER);
    let nearest = |(groups, middle): (&Vec<u32>, &PlaceAndNormal)| {
        let all = groups.iter().flat_map(|group| &asked[*group as usize]);
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

#[cfg(test)]
mod tests {
    use glam::Vec3;

    use super::*;
    use crate::bake::directional::DirectionalBake;
    use crate::bake::trace::{RaySurfel, places_and_normals};
    use crate::progress::no_progress;
    use crate::synthetic;

    /// A ball of more than have neighbours of their own, as rays meet it.
    fn ball() -> Vec<RaySurfel> {
        let cloud = synthetic::sphere(2 * EACH_OWN);
        let tracer = DirectionalBake::tracer(&cloud, &no_progress).expect("nobody cancels");
        tracer.surfels.clone()
    }

    fn neighbors_of(surfels: &[RaySurfel], normals: &[Vec3]) -> Neighbors {
        let points = places_and_normals(surfels, normals);
        Neighbors::new(&points, 1, &vec![1.0; normals.len()])
    }

    #[test]
    fn those_that_are_shared_are_hardly_farther() {
        let surfels = ball();
        let normals: Vec<Vec3> = surfels.iter().map(|s| s.position).collect();
        let shared = neighbors_of(&surfels, &normals);
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

    /// One in four is asked, by what is seen of them, and only they are anyone's neighbours.
    #[test]
    fn those_that_are_seen_most_are_asked() {
        let surfels = ball();
        let normals: Vec<Vec3> = surfels.iter().map(|s| s.position).collect();
        let points = places_and_normals(&surfels, &normals);
        let seen: Vec<f32> = (0..surfels.len())
            .map(|i| (i * 7919 % 1000) as f32)
            .collect();
        let few = Neighbors::new(&points, 4, &seen);
        let asked = few.asked();
        assert!((surfels.len() / 4..surfels.len() / 3).contains(&asked.len()));
        for (place, i) in asked.iter().enumerate() {
            assert_eq!(few.place_of(*i as usize), Some(place));
        }
        let mean = |all: &mut dyn Iterator<Item = usize>| {
            let (sum, count) = all.fold((0.0, 0.0), |(s, n), i| (s + seen[i], n + 1.0));
            sum / count
        };
        // The largest quarter of what is spread evenly lies around 7/8 of it.
        let of_asked = mean(&mut asked.iter().map(|i| *i as usize));
        assert!(of_asked > 1.6 * mean(&mut (0..surfels.len())), "{of_asked}");
        for i in 0..surfels.len() {
            let around: Vec<usize> = few.of(i).collect();
            assert!(around.len() >= NEIGHBORS && around.iter().all(|j| few.place_of(*j).is_some()));
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
            let shared = neighbors_of(&surfels, &vec![Vec3::Z; surfels.len()]);
            for i in 0..surfels.len() {
                let around = shared.of_group(shared.group_of(i));
                assert!(around.contains(&(i as u32)) && shared.of(i).count() + 1 == around.len());
                assert!(around.len() > 1, "{places}: {i}");
            }
        }
    }
}
