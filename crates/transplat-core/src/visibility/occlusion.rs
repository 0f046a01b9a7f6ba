//! The bake of the preset `best`: for every surfel and direction whether a ray leaves the object, and for some of the directions which
//! surfel it meets instead. Rays start on the side of the surfel that the direction is on, so one bit serves both sides.

use std::f64::consts::PI;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::trace::{MISS, PACKET, Tracer};
use super::{Progress, smoothstep};
use crate::error::{Error, Result};
use crate::sh::fibonacci_sphere;
use crate::surfels::SurfelCloud;

/// Patches of the sphere.
pub const PATCHES: usize = 128;

/// Directions in a patch, around its middle. The first one knows which surfel its ray meets; light that bounces is smoother than light.
pub const PER_PATCH: usize = 3;

/// Directions that are traced.
pub const DIRECTIONS: usize = PER_PATCH * PATCHES;

/// Words of 64 directions.
pub const WORDS: usize = DIRECTIONS / 64;

/// Angle between a patch's middle and its directions in degrees: that which spaces them most evenly.
const SPREAD: f64 = 5.5;

/// The directions, the first ones of all patches before the second ones. `[PER_PATCH][PATCHES]`
pub fn directions() -> Vec<Vec3> {
    let middles = fibonacci_sphere(PATCHES);
    let around = |place: usize, patch: usize, middle: DVec3| {
        let east = DVec3::Z.cross(middle).normalize();
        // Neighbours are turned against each other.
        let turn = PI * (2.0 * place as f64 / PER_PATCH as f64 + patch as f64 / PER_PATCH as f64);
        let aside = turn.cos() * east + turn.sin() * middle.cross(east);
        let spread = SPREAD.to_radians();
        (middle * spread.cos() + aside * spread.sin()).as_vec3()
    };
    (0..DIRECTIONS)
        .map(|j| {
            around(
                j / PATCHES,
                j % PATCHES,
                DVec3::from_array(middles[j % PATCHES]),
            )
        })
        .collect()
}

/// Openness of a surfel's back at which it begins to be two-sided, and at which it wholly is: at the edge of a closed object
/// a few rays pass behind.
pub const TWO_SIDED: [f32; 2] = [0.08, 0.38];

/// Set in a hit that is on the back of the surfel that is met.
pub const BACK: u32 = 1 << 31;

/// What the preset `best` needs of the geometry.
#[derive(Clone, Debug)]
pub struct Occlusion {
    /// Whether the direction is open, a bit each. `[n][WORDS]`
    pub open: Vec<[u64; WORDS]>,
    /// Unit normals, turned to the more open side. `[n]`
    pub normals: Vec<Vec3>,
    /// How much of a two-sided surfel it is, 0 to 1. `[n]`
    pub two_sided: Vec<f32>,
    /// Where the blocked directions of each surfel begin in `hits`. `[n + 1]`
    pub starts: Vec<u32>,
    /// Blocked directions among those that know what is met, front side first and then, where there are two sides, the back.
    pub hits: Vec<Hit>,
    /// How many stored normals pointed to the closed side.
    pub flipped: usize,
    /// Surfels that are closed on both sides.
    pub buried: usize,
}

/// A blocked direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Hit {
    /// The surfel that is met, with [`BACK`] where its back is.
    pub surfel: u32,
    /// The patch whose first direction it is.
    pub patch: u16,
}

/// What is found of one surfel.
struct Found {
    open: [u64; WORDS],
    hits: Vec<Hit>,
}

impl Occlusion {
    /// Traces all rays; the tracer is the asset's.
    ///
    /// # Errors
    /// [`Error::Cancelled`] when `progress` asked for it.
    pub fn bake(cloud: &SurfelCloud, tracer: &Tracer, progress: Progress<'_>) -> Result<Self> {
        let order = &tracer.order;
        let lattice = directions();
        let done = AtomicUsize::new(0);
        let found: Vec<Vec<Found>> = order
            .par_chunks(PACKET)
            .map(|of| {
                let before = done.fetch_add(of.len(), Ordering::Relaxed);
                if progress(before as f64 / order.len() as f64).is_break() {
                    return Err(Error::Cancelled);
                }
                Ok(trace_packet(tracer, &lattice, of))
            })
            .collect::<Result<_>>()?;
        let mut by_surfel: Vec<(u32, Found)> = order
            .iter()
            .copied()
            .zip(found.into_iter().flatten())
            .collect();
        by_surfel.sort_unstable_by_key(|f| f.0);
        Ok(Self::of(
            cloud,
            &lattice,
            by_surfel.into_iter().map(|f| f.1).collect(),
        ))
    }

    fn of(cloud: &SurfelCloud, lattice: &[Vec3], found: Vec<Found>) -> Self {
        let sides: Vec<(Vec3, [f32; 2], bool)> = found
            .par_iter()
            .enumerate()
            .map(|(i, f)| {
                let n = cloud.stored_normal(i).normalize_or(Vec3::Z);
                let [front, back] = openness(&f.open, lattice, n);
                if back > front {
                    (-n, [back, front], true)
                } else {
                    (n, [front, back], false)
                }
            })
            .collect();
        let two_sided: Vec<f32> = sides
            .iter()
            .map(|s| smoothstep(TWO_SIDED[0], TWO_SIDED[1], s.1[1]))
            .collect();
        let (mut starts, mut hits) = (vec![0u32], Vec::new());
        for ((f, (n, ..)), two) in found.iter().zip(&sides).zip(&two_sided) {
            let facing = |h: &&Hit| n.dot(lattice[usize::from(h.patch)]) > 0.0;
            // Where the ray met a two-sided surfel from behind, it saw its back.
            let told = |h: &Hit| {
                let s = h.surfel as usize;
                let behind =
                    two_sided[s] > 0.0 && sides[s].0.dot(lattice[usize::from(h.patch)]) > 0.0;
                Hit {
                    surfel: if behind { h.surfel | BACK } else { h.surfel },
                    ..*h
                }
            };
            hits.extend(f.hits.iter().filter(facing).map(told));
            if *two > 0.0 {
                hits.extend(f.hits.iter().filter(|h| !facing(h)).map(told));
            }
            starts.push(hits.len() as u32);
        }
        Self {
            open: found.iter().map(|f| f.open).collect(),
            normals: sides.iter().map(|s| s.0).collect(),
            flipped: sides.iter().filter(|s| s.2).count(),
            buried: sides.iter().filter(|s| s.1[0] + s.1[1] < 0.02).count(),
            two_sided,
            starts,
            hits,
        }
    }

    /// Number of surfels.
    pub fn len(&self) -> usize {
        self.normals.len()
    }

    /// Whether there is no surfel.
    pub fn is_empty(&self) -> bool {
        self.normals.is_empty()
    }

    /// Blocked directions of surfel `i` that know what they meet.
    pub fn hits_of(&self, i: usize) -> &[Hit] {
        &self.hits[self.starts[i] as usize..self.starts[i + 1] as usize]
    }

    /// Whether surfel `i` sees all the way out towards direction `j`.
    #[inline(always)]
    pub fn is_open(&self, i: usize, j: usize) -> bool {
        self.open[i][j / 64] >> (j % 64) & 1 == 1
    }
}

/// Cosine-weighted share of the two sides' hemispheres that is open, 0 to 1.
fn openness(open: &[u64; WORDS], lattice: &[Vec3], n: Vec3) -> [f32; 2] {
    let mut sides = [0f32; 2];
    for (j, w) in lattice.iter().enumerate() {
        if open[j / 64] >> (j % 64) & 1 == 1 {
            let cosine = n.dot(*w);
            sides[usize::from(cosine < 0.0)] += cosine.abs();
        }
    }
    sides.map(|s| s * 4.0 / DIRECTIONS as f32)
}

fn trace_packet(tracer: &Tracer, lattice: &[Vec3], of: &[u32]) -> Vec<Found> {
    let mut stack = Vec::new();
    let mut found: Vec<Found> = of
        .iter()
        .map(|_| Found {
            open: [0; WORDS],
            hits: Vec::new(),
        })
        .collect();
    for (j, d) in lattice.iter().enumerate() {
        let knows = j < PATCHES;
        let hits = tracer.hits(of, *d, !knows, &mut stack);
        for (f, hit) in found.iter_mut().zip(hits) {
            if hit == MISS {
                f.open[j / 64] |= 1 << (j % 64);
            } else if knows {
                f.hits.push(Hit {
                    surfel: hit,
                    patch: j as u16,
                });
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::oracle;
    use crate::scenes;
    use crate::visibility::no_progress;
    use crate::visibility::{BakeInput, BakeSettings};

    fn bake(cloud: &SurfelCloud, progress: Progress<'_>) -> Result<Occlusion> {
        Occlusion::bake(cloud, &Tracer::new(cloud), progress)
    }

    #[test]
    fn a_sphere_sees_its_upper_half_and_nothing_of_itself() {
        let cloud = scenes::sphere(1500);
        let baked = bake(&cloud, &no_progress).expect("not cancelled");
        let lattice = directions();
        for (i, n) in baked.normals.iter().enumerate() {
            assert!(n.dot(cloud.positions[i]) > 0.0);
            assert_eq!(baked.two_sided[i], 0.0);
            let wrong = (0..DIRECTIONS)
                .filter(|j| {
                    let cosine = n.dot(lattice[*j]);
                    cosine.abs() > 0.2 && baked.is_open(i, *j) != (cosine > 0.0)
                })
                .count();
            assert!(wrong < 4, "surfel {i}: {wrong}");
        }
    }

    #[test]
    fn hits_agree_with_asking_every_disc() {
        let cloud = scenes::sphere_over_plate(300);
        let input = BakeInput::new(&cloud, &BakeSettings { directions: 16 });
        let baked = bake(&cloud, &no_progress).expect("not cancelled");
        let lattice = directions();
        let (mut differ, mut all) = (0, 0);
        for i in 0..cloud.len() {
            // Both those that know what they meet, and those that stop at anything.
            for j in (0..DIRECTIONS).step_by(3) {
                let direction = lattice[j].as_dvec3();
                let exact = oracle::first_hit(&input, i, direction);
                all += 1;
                differ += usize::from(exact.is_none() != baked.is_open(i, j));
                let hit = baked.hits_of(i).iter().find(|h| usize::from(h.patch) == j);
                let knows = j < PATCHES && baked.normals[i].dot(lattice[j]) > 0.0;
                differ += usize::from(knows && hit.is_some() != exact.is_some());
                if let (Some(hit), Some(exact)) = (hit, exact) {
                    // Of discs in one plane, either may be named.
                    let met = (hit.surfel & !BACK) as usize;
                    let distance = oracle::hit_distance(&input, i, direction, met);
                    differ += usize::from(distance.is_none_or(|t| (t - exact).abs() > 1e-5));
                }
            }
        }
        // A ray that grazes a rim may round to either side of it.
        assert!(differ * 1000 < all, "{differ} of {all}");
    }

    #[test]
    fn a_lone_sheet_is_two_sided() {
        let baked = bake(&scenes::sheet(20), &no_progress).expect("not cancelled");
        assert!(baked.two_sided.iter().all(|t| *t == 1.0));
        assert!(baked.hits.is_empty());
    }

    #[test]
    fn cancelling_stops() {
        let stop = |_: f64| std::ops::ControlFlow::Break(());
        let result = bake(&scenes::sphere(100), &stop);
        assert!(matches!(result, Err(Error::Cancelled)));
    }
}
