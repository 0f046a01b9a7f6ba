//! Visibility clusters: surfels with nearly equal visibility share the rays of one, so that cost grows with detail and not with their number.
//!
//! Those that lie together and face one way are asked in some directions; those that see the same there, but for a little, follow the first of
//! them, which leads. So there are few leaders where a surface is open and plain, and many in its folds.

use rayon::prelude::*;

use super::trace::{Tracer, places_and_normals};
use crate::error::{Error, Result};
use crate::nearest::grouped;
use crate::progress::Progress;

/// Surfels that are each traced: only what is more than twice as many is grouped, to about that many groups.
const EACH_OWN: usize = 1 << 15;

/// So many at most are of a group.
const TOGETHER: usize = 32;

/// In how many of the directions that are asked a surfel may see another thing than its leader.
const MOST_OFF: u32 = 3;

/// Cosine between the normals of a surfel and its leader, at least.
const LEAST_ALIKE: f32 = 0.9;

/// Error of the relit colour of single surfels (relative L2) by visibility clusters: at most that on four objects of 90,000 to 240,000 surfels, two
/// thirds of it on most. It is noise: images, where many overlap, are off by a fifth to a half of it.
pub const SHARED_VISIBILITY_ERROR: f32 = 0.08;

/// Visibility clusters: surfels that share the rays of one of them.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct VisibilityClusters {
    /// The row that each surfel looks up what it sees in. `[n]`
    pub row_of: Vec<u32>,
    /// The surfel that each row was traced from. `[rows]`
    pub leaders: Vec<u32>,
}

impl VisibilityClusters {
    /// None: each has its own, in that order.
    pub fn each_own(order: &[u32]) -> Self {
        let mut row_of = vec![0; order.len()];
        for (row, surfel) in order.iter().enumerate() {
            row_of[*surfel as usize] = row as u32;
        }
        Self {
            row_of,
            leaders: order.to_vec(),
        }
    }

    /// Clusters from stored rows, if they are consistent: each leader has its own row.
    pub fn of_rows(row_of: Vec<u32>, leaders: Vec<u32>) -> Option<Self> {
        let leads =
            |(row, surfel): (usize, &u32)| row_of.get(*surfel as usize) == Some(&(row as u32));
        let is_whole = leaders.iter().enumerate().all(leads)
            && row_of.iter().all(|row| (*row as usize) < leaders.len());
        is_whole.then_some(Self { row_of, leaders })
    }

    /// Largest cluster for so many surfels: 1 is none.
    pub fn together(surfels: usize) -> usize {
        (surfels / EACH_OWN).clamp(1, TOGETHER)
    }

    /// Asks the surfels in these directions, fewer than 32, and finds who follows whom, so many `together` at most; neighbouring rows are of
    /// neighbours.
    ///
    /// # Errors
    /// [`Error::Cancelled`] when `progress` asked for it.
    pub fn find(
        tracer: &Tracer,
        directions: &[glam::Vec3],
        together: usize,
        progress: Progress<'_>,
    ) -> Result<Self> {
        let n = tracer.surfels.len();
        let outward_sides = &tracer.outward_sides.of;
        let normals: Vec<_> = outward_sides.iter().map(|f| f.surface_normal()).collect();
        let points = places_and_normals(&tracer.surfels, &normals);
        let mut order: Vec<u32> = (0..n as u32).collect();
        let groups = grouped(&points, &mut order, together);
        let mut seen = vec![0u32; n];
        for (k, direction) in directions.iter().enumerate() {
            if progress(k as f64 / directions.len() as f64).is_break() {
                return Err(Error::Cancelled);
            }
            let asked = |i: u32| {
                let behind = tracer.surfels[i as usize].normal.dot(*direction) < 0.0;
                !(behind && outward_sides[i as usize].hides_its_back())
            };
            let open = tracer.open_towards(*direction, asked);
            let each = seen.par_iter_mut().zip(open);
            each.for_each(|(seen, open)| *seen |= u32::from(open) << k);
        }
        let follows = |i: usize, leader: usize| {
            let [own, of_leader] = [i, leader].map(|i| tracer.surfels[i].normal);
            (seen[i] ^ seen[leader]).count_ones() <= MOST_OFF
                && normals[i].dot(normals[leader]) >= LEAST_ALIKE
                && own.dot(of_leader) > 0.0
        };
        let mut leader_of: Vec<u32> = (0..n as u32).collect();
        let found: Vec<Vec<(u32, u32)>> = (groups.par_iter())
            .map(|group| {
                let mut leaders: Vec<u32> = Vec::new();
                let each = group.iter().map(|i| {
                    let is_led = |leader: &&u32| follows(*i as usize, **leader as usize);
                    let leader = leaders.iter().find(is_led).copied();
                    (
                        *i,
                        leader.unwrap_or_else(|| {
                            leaders.push(*i);
                            *i
                        }),
                    )
                });
                each.collect()
            })
            .collect();
        for (i, leader) in found.into_iter().flatten() {
            leader_of[i as usize] = leader;
        }
        let leads = |i: &&u32| leader_of[**i as usize] == **i;
        let leaders: Vec<u32> = tracer.order.iter().filter(leads).copied().collect();
        let mut row_of = vec![0; n];
        for (row, leader) in leaders.iter().enumerate() {
            row_of[*leader as usize] = row as u32;
        }
        let row_of = leader_of
            .iter()
            .map(|leader| row_of[*leader as usize])
            .collect();
        Ok(Self { row_of, leaders })
    }

    /// The row that surfel `i` looks up.
    #[inline(always)]
    pub fn row(&self, i: usize) -> usize {
        self.row_of[i] as usize
    }

    /// Number of surfels.
    pub fn len(&self) -> usize {
        self.row_of.len()
    }

    /// True without any surfel.
    pub fn is_empty(&self) -> bool {
        self.row_of.is_empty()
    }

    /// Spreads values of rows to surfels. `[n]`
    pub fn spread<T: Copy>(&self, of_rows: &[T]) -> Vec<T> {
        let each = self.row_of.iter();
        each.map(|row| of_rows[*row as usize]).collect()
    }

    /// Number of surfels whose rows have a property.
    pub fn count(&self, is_such: impl Fn(usize) -> bool) -> usize {
        let each = self.row_of.iter();
        each.filter(|row| is_such(**row as usize)).count()
    }

    /// Share of the surfels that follow another.
    pub fn follower_share(&self) -> f32 {
        1.0 - self.leaders.len() as f32 / self.len().max(1) as f32
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::directional::DirectionalBake;
    use crate::bake::strata::{DIRECTIONS, STRATA, directions};
    use crate::progress::no_progress;
    use crate::sh::refining_order;
    use crate::synthetic;

    #[test]
    fn who_follows_sees_nearly_what_its_leader_does() {
        let cloud = synthetic::sphere_over_plate(3000);
        let exact = DirectionalBake::all_rays(&cloud);
        let all = directions();
        let asked: Vec<_> = refining_order(STRATA)[..16]
            .iter()
            .map(|p| all[*p])
            .collect();
        let visibility_clusters = VisibilityClusters::find(&exact.tracer, &asked, 8, &no_progress)
            .expect("not cancelled");
        let (n, rows) = (cloud.len(), visibility_clusters.leaders.len());
        // A plate and a ball are plain nearly everywhere.
        assert!(rows * 3 < n, "{rows} of {n}");
        let rebuilt = VisibilityClusters::of_rows(
            visibility_clusters.row_of.clone(),
            visibility_clusters.leaders.clone(),
        );
        assert_eq!(rebuilt.as_ref(), Some(&visibility_clusters));
        let (mut off, mut seen) = (0f32, 0f32);
        for i in 0..n {
            let leader = visibility_clusters.leaders[visibility_clusters.row(i)] as usize;
            assert!(exact.normals[i].dot(exact.normals[leader]) >= LEAST_ALIKE);
            for (j, d) in all.iter().enumerate() {
                let cosine = exact.normals[i].dot(*d).max(0.0);
                let open = exact.directional_visibility.is_open(i, j);
                seen += cosine * f32::from(u8::from(open));
                off += cosine
                    * f32::from(u8::from(
                        open != exact.directional_visibility.is_open(leader, j),
                    ));
            }
        }
        // Rays from beside each other pass the rim of the ball on either side, and a sixth of what is asked may be off.
        assert!(
            off < 0.05 * seen,
            "{off} of {seen} in {DIRECTIONS} directions"
        );
    }

    #[test]
    fn few_surfels_share_nothing_and_what_does_not_belong_together_is_no_sharing() {
        assert_eq!(VisibilityClusters::together(2 * EACH_OWN - 1), 1);
        assert_eq!(VisibilityClusters::together(usize::MAX), TOGETHER);
        let own = VisibilityClusters::each_own(&[2, 0, 1]);
        assert_eq!((own.row(2), own.row(1), own.follower_share()), (0, 2, 0.0));
        for (row_of, leaders) in [
            (vec![0, 1], vec![0]),
            (vec![0, 0], vec![5]),
            (vec![1, 0], vec![0, 1]),
        ] {
            assert_eq!(VisibilityClusters::of_rows(row_of, leaders), None);
        }
    }
}
