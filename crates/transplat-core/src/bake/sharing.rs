//! Surfels that see nearly the same share what one of them sees: what many surfels cost grows with what there is to tell apart, not with them.
//!
//! Those that lie together and face one way are asked in some directions; those that see the same there, but for a little, follow the first of
//! them, which leads. So there are few leaders where a surface is open and plain, and many in its folds.

use rayon::prelude::*;

use super::trace::{Tracer, places_and_normals};
use crate::error::{Error, Result};
use crate::nearest::grouped;
use crate::progress::Progress;

/// Surfels that are each traced: only what is more than twice as many is grouped, to about that many groups.
const EACH_OWN: usize = 1 << 16;

/// So many at most are of a group.
const TOGETHER: usize = 32;

/// In how many of the directions that are asked a surfel may see another thing than its leader.
const MOST_OFF: u32 = 2;

/// Cosine between the normals of a surfel and its leader, at least.
const LEAST_ALIKE: f32 = 0.95;

/// What sharing was measured to change of the relit colour (relative L2), at most, on six objects of 90,000 to 240,000 surfels.
pub const SHARED_SIGHT_ERROR: f32 = 0.02;

/// Which surfels share what one of them sees.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Sharing {
    /// The row that each surfel looks up what it sees in. `[n]`
    pub row_of: Vec<u32>,
    /// The surfel that each row was traced from. `[rows]`
    pub leaders: Vec<u32>,
}

impl Sharing {
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

    /// Of what was stored, if it belongs together: each leader has its own row.
    pub fn of_rows(row_of: Vec<u32>, leaders: Vec<u32>) -> Option<Self> {
        let leads =
            |(row, surfel): (usize, &u32)| row_of.get(*surfel as usize) == Some(&(row as u32));
        let is_whole = leaders.iter().enumerate().all(leads)
            && row_of.iter().all(|row| (*row as usize) < leaders.len());
        is_whole.then_some(Self { row_of, leaders })
    }

    /// Asks the surfels in these directions, fewer than 32, and finds who follows whom; neighbouring rows are of neighbours.
    ///
    /// # Errors
    /// [`Error::Cancelled`] when `progress` asked for it.
    pub fn find(
        tracer: &Tracer,
        directions: &[glam::Vec3],
        progress: Progress<'_>,
    ) -> Result<Self> {
        let n = tracer.surfels.len();
        let together = (n / EACH_OWN).min(TOGETHER);
        if together < 2 {
            return Ok(Self::each_own(&tracer.order));
        }
        let fronts = &tracer.fronts.of;
        let normals: Vec<_> = fronts.iter().map(|f| f.surface_normal()).collect();
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
                !(behind && fronts[i as usize].hides_its_back())
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

    /// Whether there is no surfel.
    pub fn is_empty(&self) -> bool {
        self.row_of.is_empty()
    }

    /// What is known of rows, for surfels. `[n]`
    pub fn spread<T: Copy>(&self, of_rows: &[T]) -> Vec<T> {
        let each = self.row_of.iter();
        each.map(|row| of_rows[*row as usize]).collect()
    }

    /// How many surfels look up rows that are such.
    pub fn count(&self, is_such: impl Fn(usize) -> bool) -> usize {
        let each = self.row_of.iter();
        each.filter(|row| is_such(**row as usize)).count()
    }

    /// Share of the surfels that follow another.
    pub fn follower_share(&self) -> f32 {
        1.0 - self.leaders.len() as f32 / self.len().max(1) as f32
    }
}

/// Rows, one for each surfel of so many.
impl From<usize> for Sharing {
    fn from(n: usize) -> Self {
        let each: Vec<u32> = (0..n as u32).collect();
        Self::each_own(&each)
    }
}
