//! Convex and other open objects: they block no light of their own and need no bake.
//!
//! Some directions are asked, in turn, and it ends at the first ray that tells otherwise. That is soon where something blocks.

use glam::Vec3;
use rayon::prelude::*;

use super::strata::{PER_STRATUM, STRATA, SurfelHits, directions};
use super::trace::Tracer;
use crate::sh::refining_order;

/// Patches that are asked, three directions each.
const PROBES: usize = 16;

/// Cosine to the normal below which a direction grazes: a surface that bends away may block it with its own discs.
const GRAZING: f32 = 0.2;

/// An object of which every surfel's side is wholly open or wholly closed.
#[derive(Clone, Debug)]
pub struct OpenObject {
    /// Open sides: that of the stored normal, and the other one. `[n]`
    pub open: Vec<[bool; 2]>,
    /// The share of the irradiance in even light that this may miss, the mean over the surfels: what blocked the grazing directions that were
    /// asked, and what may hide between those that were not (with 95 % confidence, the rule of three).
    pub mean_error: f32,
    normals: Vec<Vec3>,
}

/// Openness of a surfel's sides.
#[derive(Clone, Copy, Default)]
struct SideOpenness {
    open: [bool; 2],
    blocked: [bool; 2],
    /// Cosine-weighted, of the grazing rays that were blocked and of all rays.
    grazing_blocked: [f32; 2],
    all: [f32; 2],
}

impl SideOpenness {
    fn add(&mut self, cosine: f32, is_open: bool) {
        let (side, weight) = (usize::from(cosine < 0.0), cosine.abs());
        self.all[side] += weight;
        if weight >= GRAZING {
            self.open[side] |= is_open;
            self.blocked[side] |= !is_open;
        } else if !is_open {
            self.grazing_blocked[side] += weight;
        }
    }

    fn is_mixed(&self) -> bool {
        (0..2).any(|s| self.open[s] && self.blocked[s])
    }

    fn missed(&self) -> f32 {
        let of = |s: usize| self.grazing_blocked[s] / self.all[s].max(1e-9);
        let open = (0..2).filter(|s| self.open[*s]);
        open.map(of).fold(0.0, f32::max)
    }
}

impl OpenObject {
    /// Asks whether it is one.
    pub fn probe(tracer: &Tracer) -> Option<Self> {
        let n = tracer.surfels.len();
        let directions = directions();
        let mut sides = vec![SideOpenness::default(); n];
        for stratum in refining_order(STRATA).into_iter().take(PROBES) {
            for place in 0..PER_STRATUM {
                let direction = directions[place * STRATA + stratum];
                let open = tracer.open_towards(direction, |_| true);
                for ((side, surfel), open) in sides.iter_mut().zip(&tracer.surfels).zip(open) {
                    side.add(surfel.normal.dot(direction), open);
                }
            }
            if sides.par_iter().any(SideOpenness::is_mixed) {
                return None;
            }
        }
        if !sides.iter().all(|s| s.open[0] || s.open[1]) {
            return None;
        }
        let rays = (n * PROBES * PER_STRATUM) as f32;
        let missed: f32 = sides.iter().map(SideOpenness::missed).sum();
        // One surfel has nothing that could block it.
        let mean_error = if n < 2 {
            0.0
        } else {
            missed / n as f32 + 3.0 / rays
        };
        Some(Self {
            open: sides.iter().map(|s| s.open).collect(),
            mean_error,
            normals: tracer.surfels.iter().map(|s| s.normal).collect(),
        })
    }

    /// True where surfel `i` sees all the way out towards a direction.
    pub fn is_open(&self, i: usize, direction: Vec3) -> bool {
        self.open[i][usize::from(self.normals[i].dot(direction) < 0.0)]
    }

    /// Hits of all rays of some surfels.
    pub(super) fn found(&self, of: &[u32]) -> Vec<SurfelHits> {
        let directions = directions();
        of.par_iter()
            .map(|i| {
                let mut found = SurfelHits::of(*i);
                for (j, d) in directions.iter().enumerate() {
                    found.set_open(j, self.is_open(*i as usize, *d));
                }
                found
            })
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::outward_side::OutwardSides;
    use crate::progress::no_progress;
    use crate::surfels::SurfelCloud;
    use crate::synthetic;

    #[test]
    fn a_ball_and_a_sheet_are_open_and_a_ball_over_a_plate_is_not() {
        let probe = |cloud: SurfelCloud| {
            let outward_sides = OutwardSides::find(&cloud, &no_progress).expect("not cancelled");
            OpenObject::probe(&Tracer::new(&cloud, outward_sides))
        };
        let ball = synthetic::sphere(2000);
        let open = probe(ball.clone()).expect("convex");
        assert!(open.mean_error < 0.01, "{}", open.mean_error);
        for (i, sides) in open.open.iter().enumerate() {
            let outward = ball.stored_normal(i).dot(ball.positions[i]) > 0.0;
            assert_eq!(*sides, [outward, !outward]);
        }
        let sheet = probe(synthetic::sheet(20)).expect("nothing blocks it");
        assert!(sheet.open.iter().all(|s| *s == [true, true]));
        assert!(probe(synthetic::sphere_over_plate(2000)).is_none());
        assert_eq!(probe(synthetic::sphere(0)).map(|o| o.mean_error), Some(0.0));
    }
}
