//! Shadow rays from each surfel to placed lights: visible shares, and irradiance on either side.
//!
//! What is seen of a light depends on where it is, not on how bright it is: that is kept, so that of several lights only the one that moved is
//! traced again.

use std::sync::Arc;

use glam::{Affine3A, Vec3};
use rayon::prelude::*;

use super::asset::DirectionalCache;
use super::light_visibility::LightVisibility;
use super::rays::Rays;
use crate::bake::strata::STRATA;
use crate::bake::surroundings::InterObjectVisibility;
use crate::bake::trace::{PACKET, RayStart, Stack, Tracer};
use crate::environment::{Emitter, FEW, LightSample, MAX_SUNS, MOST_LIGHTS, MOST_PARTS, Shape};

/// Each may be mirrored in as many rays as it has parts.
const _: () = assert!(STRATA + MAX_SUNS + MOST_LIGHTS * MOST_PARTS <= Rays::MOST);

/// A light as an asset meets it.
#[derive(Clone, Debug)]
pub struct NearLight {
    /// In the coordinates of its rays.
    pub emitter: Emitter,
    met: Arc<LightVisibility>,
}

/// Effort for the shadows of placed lights.
#[derive(Clone, Copy, PartialEq, Eq)]
pub enum Tracing {
    /// They are traced, of a light that was not there before; by all rays, or as many as it takes.
    Done { all: bool },
    /// They are taken where they are known.
    Known,
    /// There are none.
    None,
}

/// Sums over a surfel's shadow rays to a light, by side.
#[derive(Clone, Copy, Default)]
struct ShadowSums {
    /// Visible and whole light by side, cosine-weighted.
    sides: [[f32; 2]; 2],
    /// Visible and whole light of each part on the front, not cosine-weighted.
    parts: [[f32; 2]; MOST_PARTS],
}

/// Samples along each edge of a light where an edge of a shadow crosses it: each square of the few in four.
const MANY: usize = 2 * FEW;

/// Surfels that follow each other, all of which are taken for crossed by an edge where one is.
const BESIDE: usize = 4;

/// Squares of a light that the rays of a surfel go to.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Squares {
    /// The few large ones.
    Few,
    /// Three quarters of each square that its first ray did not go to.
    Rest,
}

impl Squares {
    fn count(self, shape: &Shape) -> usize {
        let few = shape.samples(FEW);
        match self {
            Self::Few => few,
            Self::Rest => shape.samples(MANY) - few,
        }
    }

    /// The large square that the `k`th of them is, or lies in.
    fn large(self, k: usize) -> usize {
        match self {
            Self::Few => k,
            Self::Rest => k / 3,
        }
    }

    /// Square and position in it of a surfel's `k`th sample.
    fn sample(self, k: usize, shift: [f32; 2]) -> ((usize, usize), [f32; 2]) {
        if self == Self::Few {
            return ((k, FEW), shift);
        }
        let (large, other) = (self.large(k), 1 + k % 3);
        let half = |axis: usize| usize::from(shift[axis] >= 0.5) ^ (other >> axis & 1);
        let (column, row) = (2 * (large % FEW) + half(0), 2 * (large / FEW) + half(1));
        (
            (row * MANY + column, MANY),
            shift.map(|s| (2.0 * s).fract()),
        )
    }
}

/// Shift of a sample from surfel to surfel within each square of its disc, so that neighbours see other places of it and together all: the first two
/// powers of one over the plastic number (Roberts 2018).
const SHIFTS: [f64; 2] = [0.754_877_666_246_693, 0.569_840_290_998_053];

fn shift_of(place: usize) -> [f32; 2] {
    SHIFTS.map(|s| ((place as f64 + 0.5) * s).fract() as f32)
}

/// A ray to the light ends that much before it, relative to how far it is: a surface that the light lies on does not block it.
const SHORT_OF: f32 = 1e-4;

impl DirectionalCache {
    /// From the asset's coordinates to those of its rays.
    pub(super) fn rays_from_asset(&self) -> Affine3A {
        let tracer = &self.bake.tracer;
        let radius = tracer.radius.max(f32::MIN_POSITIVE);
        Affine3A::from_scale(Vec3::splat(1.0 / radius)) * Affine3A::from_translation(-tracer.center)
    }

    /// Traces those lights that were not there before.
    pub(super) fn meet(
        &self,
        lights: &[Emitter],
        tracing: Tracing,
        among: Option<&InterObjectVisibility>,
    ) -> Vec<NearLight> {
        // Among others, what is kept may be of another place.
        let mut kept = Vec::new();
        if among.is_none() && !lights.is_empty() && tracing != Tracing::None {
            kept = self.shadow_cache.get();
        }
        let near: Vec<NearLight> = lights
            .iter()
            .map(|emitter| {
                let is_it = |m: &&Arc<LightVisibility>| m.shape == emitter.shape;
                let known = kept.iter().find(is_it).cloned();
                let trace = || Arc::new(self.trace_light(&emitter.shape, tracing, among));
                NearLight {
                    emitter: *emitter,
                    met: known.unwrap_or_else(trace),
                }
            })
            .collect();
        if among.is_none() && matches!(tracing, Tracing::Done { .. }) {
            let met = near.iter().map(|light| light.met.clone());
            self.shadow_cache.set(met.collect());
        }
        near
    }

    /// Traces shadow rays from each surfel to a light.
    fn trace_light(
        &self,
        shape: &Shape,
        tracing: Tracing,
        among: Option<&InterObjectVisibility>,
    ) -> LightVisibility {
        let (is_shadowed, every) = match tracing {
            Tracing::Done { all } => (true, all),
            Tracing::Known | Tracing::None => (false, false),
        };
        let (tracer, parts) = (&self.bake.tracer, shape.parts());
        let mut all = vec![ShadowSums::default(); tracer.surfels.len()];
        let tracing = (is_shadowed, among);
        let places: Vec<u32> = (0..tracer.order.len() as u32).collect();
        self.trace_some((shape, Squares::Few), &places, tracing, &mut all);
        if is_shadowed && shape.has_extent() {
            // Where neighbours see all of them, or none, no edge crosses the light.
            let is_mixed = |place: &u32| all[tracer.order[*place as usize] as usize].are_mixed();
            let crossed = |of: &&[u32]| every || of.iter().any(is_mixed);
            let crossed = places.chunks(BESIDE).filter(crossed);
            let crossed: Vec<u32> = crossed.flatten().copied().collect();
            self.trace_some((shape, Squares::Rest), &crossed, tracing, &mut all);
        }
        let mut seen = vec![0f32; all.len() * parts];
        let irradiance = (seen.par_chunks_exact_mut(parts).zip(&all).enumerate())
            .map(|(i, (seen, sums))| {
                for (seen, part) in seen.iter_mut().zip(sums.parts) {
                    *seen = share(part);
                }
                let shares = sums.sides.map(share);
                if shares == [0.0; 2] {
                    return [0.0; 2];
                }
                let surfel = &tracer.surfels[i];
                let open = shape.irradiance(surfel.position, self.bake.normals[i], surfel.minor);
                [0, 1].map(|side| open[side] * shares[side])
            })
            .collect();
        LightVisibility {
            shape: *shape,
            irradiance,
            seen,
        }
    }

    /// Adds what some squares of a light tell of the surfels in some places of the tracer's order.
    fn trace_some(
        &self,
        light: (&Shape, Squares),
        places: &[u32],
        tracing: (bool, Option<&InterObjectVisibility>),
        all: &mut [ShadowSums],
    ) {
        let order = &self.bake.tracer.order;
        let found: Vec<[ShadowSums; PACKET]> = places
            .par_chunks(PACKET)
            .map_init(TraceScratch::default, |scratch, places| {
                self.trace_batch(light, places, tracing, scratch)
            })
            .collect();
        for (places, sums) in places.chunks(PACKET).zip(found) {
            for (place, sums) in places.iter().zip(sums) {
                all[order[*place as usize] as usize].add(&sums);
            }
        }
    }

    /// Traces shadow rays of [`PACKET`] surfels at most.
    fn trace_batch(
        &self,
        (shape, squares): (&Shape, Squares),
        places: &[u32],
        (is_shadowed, among): (bool, Option<&InterObjectVisibility>),
        scratch: &mut TraceScratch,
    ) -> [ShadowSums; PACKET] {
        let bake = &self.bake;
        let in_order = |place: &u32| bake.tracer.order[*place as usize];
        let of: Vec<u32> = places.iter().map(in_order).collect();
        let mut sums = [ShadowSums::default(); PACKET];
        for k in 0..squares.count(shape) {
            let part = shape.part_of(squares.large(k), FEW);
            scratch.rays.clear();
            scratch.whose.clear();
            for (lane, i) in of.iter().enumerate() {
                let (i, surfel) = (*i as usize, &bake.tracer.surfels[*i as usize]);
                let (sample, shift) = squares.sample(k, shift_of(places[lane] as usize));
                let to = shape.sample(sample, shift, surfel.position, surfel.minor);
                let cosine = to.direction.dot(bake.normals[i]);
                let side = usize::from(cosine < 0.0);
                if to.strength <= 0.0 || (side == 1 && bake.two_sided[i] == 0.0) {
                    continue;
                }
                let weight = cosine.abs() * to.strength;
                sums[lane].sides[side][1] += weight;
                if side == 0 {
                    sums[lane].parts[part][1] += to.strength;
                }
                let start = surfel.start(to.direction);
                let distance = to.distance * (1.0 - SHORT_OF);
                scratch.whose.push((lane, side, weight, to.strength));
                scratch.rays.push((start, to.direction, distance));
            }
            let open = if is_shadowed {
                unblocked(&bake.tracer, among, &of, scratch)
            } else {
                [true; PACKET]
            };
            for ((lane, side, weight, strength), open) in scratch.whose.iter().zip(open) {
                if !open {
                    continue;
                }
                sums[*lane].sides[*side][0] += weight;
                if *side == 0 {
                    sums[*lane].parts[part][0] += strength;
                }
            }
        }
        sums
    }
}

impl ShadowSums {
    /// Adds what the next squares tell, each a quarter of one of those before, if there were any.
    fn add(&mut self, next: &Self) {
        let own = self.sides.iter_mut().chain(&mut self.parts);
        for (sum, term) in own.zip(next.sides.iter().chain(&next.parts)) {
            *sum = [0, 1].map(|i| 0.25 * sum[i] + term[i]);
        }
    }

    /// True where some of the samples on a side are visible, and some are not.
    fn are_mixed(&self) -> bool {
        (self.sides.iter()).any(|[seen, all]| *seen > 0.0 && *seen < (1.0 - 1e-4) * all)
    }
}

/// Memory that a thread needs for some surfels, used again for the next.
#[derive(Default)]
struct TraceScratch {
    rays: Vec<(RayStart, Vec3, f32)>,
    /// Surfel, side and weights of each ray.
    whose: Vec<(usize, usize, f32, f32)>,
    stack: Stack,
}

/// True for each ray that nothing blocks.
fn unblocked(
    own: &Tracer,
    among: Option<&InterObjectVisibility>,
    of: &[u32],
    scratch: &mut TraceScratch,
) -> [bool; PACKET] {
    let mut open = own.unblocked(&scratch.rays, &mut scratch.stack);
    if let Some(others) = among {
        let whose: Vec<u32> = scratch.whose.iter().map(|(lane, ..)| of[*lane]).collect();
        others.unblocked(own, &whose, &scratch.rays, &mut open, &mut scratch.stack);
    }
    open
}

/// Visible share of the whole.
fn share([seen, all]: [f32; 2]) -> f32 {
    if all > 0.0 { seen / all } else { 0.0 }
}

impl NearLight {
    /// Adds what it shines on the sides of surfel `i`, no more than `most`.
    pub(super) fn add_to(&self, i: usize, most: f32, sides: &mut [[f32; 3]]) {
        for (side, unit) in sides.iter_mut().zip(self.met.irradiance[i]) {
            for (sum, emission) in side.iter_mut().zip(self.emitter.emission) {
                *sum += (unit * emission).min(most);
            }
        }
    }

    /// Visible share of its irradiance on the front of surfel `i`, 0 to 1.
    pub(super) fn seen_share(&self, asset: &DirectionalCache, i: usize) -> f32 {
        let surfel = &asset.bake.tracer.surfels[i];
        let normal = asset.bake.normals[i];
        let [whole, _] = self
            .met
            .shape
            .irradiance(surfel.position, normal, surfel.minor);
        share([self.met.irradiance[i][0], whole]).min(1.0)
    }

    /// Light of its parts on the front of surfel `i`, as rays.
    pub(super) fn light_samples(
        &self,
        asset: &DirectionalCache,
        i: usize,
        most: f32,
    ) -> impl Iterator<Item = LightSample> {
        let (shape, parts) = (self.emitter.shape, self.met.shape.parts());
        let surfel = &asset.bake.tracer.surfels[i];
        let (at, nearest, normal) = (surfel.position, surfel.minor, asset.bake.normals[i]);
        let emission = self.emitter.emission;
        (0..parts).filter_map(move |part| {
            let seen = self.met.seen[i * parts + part];
            if seen <= 0.0 {
                return None;
            }
            // Of a sun, its middle.
            let across = if parts == 1 { 1 } else { FEW };
            let to = shape.sample((part, across), [0.5; 2], at, nearest);
            (to.direction.dot(normal) > 0.0 && to.strength > 0.0).then(|| LightSample {
                direction: to.direction,
                energy: emission.map(|e| (e * to.strength * seen).min(most)),
            })
        })
    }
}

/// Surfels that tell how strong lights are on an asset, one of so many that follow each other.
const ASKED: usize = 4096;

/// Mean over the surfels of what lights shine on them, all ways that they could face alike.
pub(super) fn mean_irradiance(asset: &DirectionalCache, lights: &[Emitter]) -> [f32; 3] {
    let surfels = &asset.bake.tracer.surfels;
    let asked = || surfels.iter().step_by(surfels.len().div_ceil(ASKED).max(1));
    let mut sum = [0f64; 3];
    for light in lights {
        let facing = asked().map(|s| f64::from(light.shape.facing(s.position, s.minor)));
        // The clamped cosine's mean over the sphere is a quarter.
        let mean = facing.sum::<f64>() / (4 * asked().len().max(1)) as f64;
        for (sum, e) in sum.iter_mut().zip(light.emission) {
            *sum += mean * f64::from(e);
        }
    }
    sum.map(|s| s.min(f64::from(f32::MAX)) as f32)
}

#[cfg(test)]
mod tests {
    use glam::Quat;

    use super::super::asset::FrontAndBack;
    use super::*;
    use crate::bake::directional::DirectionalBake;
    use crate::environment::Illumination;
    use crate::progress::no_progress;
    use crate::settings::TransferSettings;
    use crate::surfels::SurfelCloud;
    use crate::synthetic;
    use crate::transfer::directional::DirectionalTransfer;
    use crate::transfer::relit::Part;

    fn asset_of(cloud: &SurfelCloud) -> Arc<DirectionalCache> {
        let settings = TransferSettings::default();
        let bake = DirectionalBake::bake(cloud, &no_progress).expect("not cancelled");
        Arc::new(DirectionalCache::new(
            cloud,
            Arc::new(bake),
            &settings.optimizations,
        ))
    }

    fn transfer_of(cloud: &SurfelCloud) -> DirectionalTransfer {
        let source = Illumination::even(3);
        DirectionalTransfer::new(&asset_of(cloud), &source, &TransferSettings::default())
            .expect("with beams")
    }

    /// What lights, in the asset's coordinates, shine on the two sides of each surfel, their shadows traced. `[n]`
    fn irradiance_of(asset: &DirectionalCache, lights: &[Emitter], all: bool) -> Vec<FrontAndBack> {
        let to_rays = asset.rays_from_asset();
        let lights: Vec<Emitter> = lights.iter().map(|e| e.moved(to_rays)).collect();
        let near = asset.meet(&lights, Tracing::Done { all }, None);
        let on = |i: usize| {
            let mut sides = FrontAndBack::default();
            for light in &near {
                light.add_to(i, f32::MAX, &mut sides);
            }
            sides
        };
        (0..asset.bake.len()).map(on).collect()
    }

    fn point(position: Vec3, intensity: f32) -> Emitter {
        Emitter {
            shape: Shape::Point { position },
            emission: [intensity; 3],
        }
    }

    fn dark() -> Illumination {
        Illumination::even(3).scaled(0.0)
    }

    /// A ball over a slab: from above it shades a disc of the slab, and how large that is tells how near the light is.
    #[test]
    fn a_near_light_throws_the_shadow_that_it_should() {
        let cloud = synthetic::sphere_over_slab(3000);
        let asset = asset_of(&cloud);
        let height = 2.2f32;
        // The ball's middle is at 0.7, its radius 0.5: the cone that touches it.
        let touches = (0.5 / (height - 0.7)).asin().tan() * height;
        let found = irradiance_of(&asset, &[point(Vec3::Z * height, 2.0)], false);
        let mut seen = [0, 0];
        for (i, sides) in found.iter().enumerate() {
            let p = cloud.positions[i];
            if p.z.abs() > 1e-3 || asset.bake.normals[i].z < 0.9 {
                continue;
            }
            let from_middle = p.truncate().length();
            let spacing = 3.0 * cloud.scales[i].max_element();
            if from_middle < touches - spacing {
                assert_eq!(sides[0][0], 0.0, "{p}");
                seen[0] += 1;
            } else if from_middle > touches + spacing {
                let d = p.distance(Vec3::Z * height);
                let exact = 2.0 * (height / d) / (d * d);
                assert!(
                    (sides[0][0] / exact - 1.0).abs() < 1e-3,
                    "{p}: {}",
                    sides[0][0]
                );
                seen[1] += 1;
            }
        }
        assert!(seen.iter().all(|n| *n > 300), "{seen:?}");
    }

    /// However a surfel's samples are shifted, the few and the rest go to each square of the fine grid once.
    #[test]
    fn the_few_and_the_rest_are_all_squares() {
        let square = Shape::Area {
            center: Vec3::ZERO,
            half: [Vec3::X, Vec3::Y],
            normal: Vec3::Z,
            is_round: false,
        };
        for surfel in 0..50 {
            let mut rays = [0; MANY * MANY];
            for squares in [Squares::Few, Squares::Rest] {
                for k in 0..squares.count(&square) {
                    let ((sample, across), shift) = squares.sample(k, shift_of(surfel));
                    let [column, row] = [sample % across, sample / across];
                    let fine = |i: usize, shift: f32| {
                        ((i as f32 + shift) * (MANY / across) as f32) as usize
                    };
                    let [x, y] = [fine(column, shift[0]), fine(row, shift[1])];
                    assert_eq!(squares.large(k), x / 2 + FEW * (y / 2));
                    rays[x + MANY * y] += 1;
                }
            }
            assert_eq!(rays, [1; MANY * MANY], "{surfel}");
        }
    }

    /// The penumbra of a ball under a soft box: how much of the box each surfel of the slab sees past the ball, by many rays past a sphere.
    #[test]
    fn a_soft_box_has_the_penumbra_that_it_should() {
        let cloud = synthetic::sphere_over_slab(3000);
        let asset = asset_of(&cloud);
        let (middle, radius) = (0.7 * Vec3::Z, 0.5f32);
        let shape = Shape::Area {
            center: 3.0 * Vec3::Z,
            half: [0.6 * Vec3::X, 0.6 * Vec3::Y],
            normal: -Vec3::Z,
            is_round: false,
        };
        let exact = |p: Vec3| {
            let [mut seen, mut all] = [0.0; 2];
            for k in 0..40 * 40 {
                let to = shape.sample((k, 40), [0.5; 2], p, 0.0);
                let weight = to.strength * to.direction.z;
                let away = middle - p;
                let past = (away - to.direction * away.dot(to.direction)).length();
                all += weight;
                seen += if past > radius { weight } else { 0.0 };
            }
            seen / all
        };
        let emission = [1.0; 3];
        for every in [false, true] {
            let found = irradiance_of(&asset, &[Emitter { shape, emission }], every);
            let (mut off, mut partly) = ([0.0, 0.0], 0.0);
            for (i, p) in cloud.positions.iter().enumerate() {
                let n = asset.bake.normals[i];
                let share = exact(*p);
                if p.z.abs() > 1e-3 || n.z < 0.9 || !(0.05..0.95).contains(&share) {
                    continue;
                }
                let here = found[i][0][0] / shape.irradiance(*p, n, 0.0)[0] - share;
                off = [off[0] + here, off[1] + here.abs()];
                partly += 1.0;
            }
            let [bias, mean] = off.map(|v| v / partly);
            assert!(partly > 200.0, "{partly}");
            // Discs of 1.7 standard deviations lie on the sphere and reach beyond it by half a spacing; 16 samples tell sixteenths.
            assert!(bias.abs() < 0.04 && mean < 0.08, "{every}: {bias} {mean}");
        }
    }

    /// Without a disc and far away, a light of one's own is what a sun of the environment is.
    #[test]
    fn a_light_far_away_relights_like_a_sun() {
        let cloud = synthetic::glossy_sphere_over_plate(800, 3);
        let prepared = transfer_of(&cloud);
        let toward = Vec3::new(0.5, -0.3, 0.8).normalize();
        let mut sun = dark();
        sun.add(LightSample {
            direction: toward,
            energy: [3.0, 2.0, 1.0],
        });
        let mut distant = dark();
        distant.emitters.push(Emitter {
            shape: Shape::Distant {
                toward,
                radius: 0.0,
            },
            emission: [3.0, 2.0, 1.0],
        });
        let mut far = dark();
        let d = 1e4f32;
        let intensity = [3.0, 2.0, 1.0].map(|e| e * d * d);
        far.emitters.push(Emitter {
            shape: Shape::Point {
                position: d * toward,
            },
            emission: intensity,
        });
        let relit = |light: &Illumination| {
            let light = prepared.light(light).expect("with beams");
            prepared.relight(light, Part::Whole, &[])
        };
        let exact = relit(&sun);
        for light in [&distant, &far] {
            let found = relit(light);
            let squares = |of: &[[f32; 3]]| {
                of.iter()
                    .flatten()
                    .map(|v| f64::from(*v).powi(2))
                    .sum::<f64>()
            };
            let off: Vec<[f32; 3]> = (found.sh.iter().zip(&exact.sh))
                .map(|(a, b)| std::array::from_fn(|c| a[c] - b[c]))
                .collect();
            let share = (squares(&off) / squares(&exact.sh)).sqrt();
            assert!(share < 1e-3, "{share}");
        }
    }

    /// Only a light that moved is traced again: neither its brightness nor another one asks for that.
    #[test]
    fn only_what_moved_is_traced_again() {
        let asset = asset_of(&synthetic::sphere_over_plate(300));
        let (a, b) = (
            point(Vec3::new(0.2, 0.1, 2.0), 1.0),
            point(Vec3::X * 2.0, 1.0),
        );
        let meet = |lights: &[Emitter]| asset.meet(lights, Tracing::Done { all: false }, None);
        let first = meet(&[a, b]);
        let again = meet(&[
            b.tinted([5.0, 1.0, 1.0]),
            point(Vec3::new(0.2, 0.1, 2.1), 1.0),
        ]);
        assert!(Arc::ptr_eq(&first[1].met, &again[0].met));
        assert!(!Arc::ptr_eq(&first[0].met, &again[1].met));
        // What is not there any more is forgotten.
        let back = meet(&[a]);
        assert!(!Arc::ptr_eq(&first[0].met, &back[0].met));
    }

    /// A light that an asset is moved with relights it alike.
    #[test]
    fn a_light_moves_with_the_coordinates() {
        let cloud = synthetic::sphere_over_slab(500);
        let there = Affine3A::from_scale_rotation_translation(
            Vec3::splat(2.5),
            Quat::from_rotation_x(0.7),
            Vec3::new(3.0, 0.0, -1.0),
        );
        let light = Emitter {
            shape: Shape::Area {
                center: Vec3::new(1.0, 0.5, 1.5),
                half: [0.3 * Vec3::X, 0.3 * Vec3::Y],
                normal: -Vec3::Z,
                is_round: true,
            },
            emission: [4.0; 3],
        };
        let [before, after] = [
            (cloud.clone(), light),
            (cloud.transformed(there), light.moved(there)),
        ]
        .map(|(cloud, light)| irradiance_of(&asset_of(&cloud), &[light], false));
        // Where an edge crosses the light, which places of it are asked follows the order of the surfels.
        let off = before
            .iter()
            .zip(&after)
            .filter(|(a, b)| (a[0][0] - b[0][0]).abs() > 0.02 * (1.0 + a[0][0]));
        let (off, n) = (off.count(), before.len());
        assert!(off < n / 40 && n > 900, "{off} of {n}");
    }

    #[test]
    fn no_light_is_too_near_too_far_or_too_bright() {
        let cloud = synthetic::glossy_sphere_over_plate(300, 3);
        let prepared = transfer_of(&cloud);
        let on_surfel = cloud.positions[10];
        for position in [
            Vec3::Z * 0.7,
            on_surfel,
            on_surfel + Vec3::splat(1e-6),
            Vec3::splat(1e6),
        ] {
            for intensity in [0.0, 1e-30, 1.0, 1e30] {
                for shape in [
                    Shape::Point { position },
                    Shape::Area {
                        center: position,
                        half: [Vec3::X, Vec3::Y],
                        normal: Vec3::Z,
                        is_round: false,
                    },
                    Shape::Spot {
                        position,
                        axis: -Vec3::Z,
                        beam: 0.0,
                        cutoff: 0.0,
                    },
                ] {
                    let mut light = dark();
                    light.emitters.push(Emitter {
                        shape,
                        emission: [intensity; 3],
                    });
                    let light = prepared.light(&light).expect("with beams");
                    let relit = prepared.relight(light, Part::Whole, &[]);
                    let all = relit.sh.iter().chain(&relit.tau).flatten();
                    assert!(
                        all.into_iter().all(|v| v.is_finite()),
                        "{shape:?} {intensity}"
                    );
                }
            }
        }
    }
}
