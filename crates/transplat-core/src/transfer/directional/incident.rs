//! Incident light of a surfel: open sky and suns, and the surfels that block them.

use std::f32::consts::PI;
use std::ops::Range;
use std::sync::Arc;

use glam::{Vec3, Vec3A};
use multiversion::multiversion;
use rayon::prelude::*;

use super::asset::{DirectionalCache, DirectionalLight, FrontAndBack, Planes, Radiance, planes};
use super::rays::Rays;
use super::shadow_rays::{NearLight, Tracing, mean_irradiance};
use crate::bake::directional_visibility::DirectionalVisibility;
use crate::bake::strata::{DIRECTIONS, Hit, PER_STRATUM, STRATA, WORDS};
use crate::bake::surroundings::InterObjectVisibility;
use crate::environment::{Emitter, IncidentRadiance, LightSample, LightSamples, MOST_LIGHTS};
use crate::settings::optimizations::{Optimization, Optimizations};
use crate::settings::{Terms, TransferSettings};
use crate::sh::evaluate_sh;

/// No light is stronger than that many times the source, so that no sum overflows.
const MAX_RELATIVE_LIGHT: f32 = 1e12;

/// Values of patches, by channel.
type StratumPlanes = [[f32; STRATA]; 3];

/// Values that are worked on at once.
const LANES: usize = 16;

/// A light as the surfels of an asset meet it.
pub(in crate::transfer) struct Incident<'a> {
    /// Directional visibility of the surfels.
    directional_visibility: &'a DirectionalVisibility,
    /// The first of them among those whose radiance is given.
    first: usize,
    /// Environment around each direction, as samples from where most of it shines.
    sky: IncidentSky,
    /// With the surfels that see them.
    pub(super) suns: Vec<(LightSample, Vec<bool>)>,
    /// With what the surfels see of them.
    pub(super) near: Vec<NearLight>,
    /// Objects around the asset.
    pub(super) around: Option<Arc<InterObjectVisibility>>,
    /// Irradiance, with epsilon's share. `[n]`, or empty
    pub irradiance: Vec<FrontAndBack>,
    /// Irradiance of the light, [`DirectionalLight::mean`].
    pub mean: [f32; 3],
    /// [`DirectionalLight::user_gain`].
    pub user_gain: [f32; 3],
    /// Epsilon's share.
    pub least: [f32; 3],
    terms: Terms,
    pub optimizations: Optimizations,
    /// In what unit others shine on them; none where all of them share one.
    pub others: Option<Others>,
}

/// Units of the radiance of other objects' surfels, in terms of an object's captured colour.
pub(in crate::transfer) struct Others {
    /// The object's surfels.
    pub own: Range<usize>,
    /// Surfels of other objects of its capture.
    pub parts: Vec<Range<usize>>,
    /// Factor of the radiance of the rest.
    pub gain: f32,
}

impl Others {
    #[inline(always)]
    fn are_own(&self, surfel: usize) -> bool {
        self.own.contains(&surfel) || self.parts.iter().any(|part| part.contains(&surfel))
    }
}

struct IncidentSky {
    energy: Planes,
    direction: Planes,
    /// Direction times the sum of energy's channels.
    toward: Planes,
}

impl IncidentSky {
    fn new(light_samples: &[LightSample]) -> Self {
        Self {
            energy: planes(light_samples.iter().map(|b| b.energy)),
            direction: planes(light_samples.iter().map(|b| b.direction.to_array())),
            toward: planes(
                light_samples
                    .iter()
                    .map(|b| (b.direction * b.energy.iter().sum::<f32>()).to_array()),
            ),
        }
    }
}

impl DirectionalCache {
    /// Takes a light in, its strength multiplied, of which the user told some. `fill` is what a channel gets of the light's mean that the source
    /// lacks.
    pub(super) fn light(
        &self,
        (radiance, light_samples, emitters): (&IncidentRadiance, &LightSamples, &[Emitter]),
        (gain, user_gain): (f32, [f32; 3]),
        settings: &TransferSettings,
        fill: [f32; 3],
    ) -> DirectionalLight {
        let terms = settings.terms;
        let light_samples = light_samples.tinted([gain; 3]).clamped(MAX_RELATIVE_LIGHT);
        let (sky, mut suns) = if terms.sums && terms.suns {
            (
                light_samples.gathered(&self.directions),
                light_samples.suns.clone(),
            )
        } else if terms.sums {
            let all = light_samples.with_suns_as_sky();
            (all.gathered(&self.directions), Vec::new())
        } else {
            let light = radiance.truncated(settings.sh_degree).scaled(gain);
            (self.series(&light), Vec::new())
        };
        if suns.is_empty() && !settings.optimizations.has(Optimization::Suns) {
            // One that holds nothing, to know what it costs.
            suns.push(LightSample {
                direction: Vec3::Z,
                energy: [0.0; 3],
            });
        }
        let to_rays = self.rays_from_asset();
        let emitters: Vec<Emitter> = (emitters.iter().take(MOST_LIGHTS))
            .map(|e| e.moved(to_rays).tinted([gain; 3]))
            .collect();
        let (around, near) = (
            light_samples.mean_irradiances(),
            mean_irradiance(self, &emitters),
        );
        let means: [f32; 3] =
            std::array::from_fn(|c| (around[c] + near[c]).min(MAX_RELATIVE_LIGHT));
        let mean = means.iter().sum::<f32>() / 3.0;
        // What the user made of the rest counts for its share of all.
        let user_gain = match emitters.is_empty() {
            true => user_gain,
            false => std::array::from_fn(|c| {
                let unset = around[c] / user_gain[c].max(f32::MIN_POSITIVE) + near[c];
                let told = means[c] / unset;
                if told.is_finite() && told > 0.0 {
                    told
                } else {
                    1.0
                }
            }),
        };
        DirectionalLight {
            sky,
            suns,
            emitters,
            user_gain,
            mean: std::array::from_fn(|c| means[c] + fill[c] * mean),
            least: std::array::from_fn(|c| settings.epsilon() * means[c] + fill[c] * mean),
        }
    }

    /// A light as the surfels meet it, alone or among others.
    pub(in crate::transfer) fn incident<'a>(
        &'a self,
        light: DirectionalLight,
        settings: &TransferSettings,
        among: Option<&'a Arc<InterObjectVisibility>>,
    ) -> Incident<'a> {
        let all = settings.optimizations == Optimizations::NONE;
        let tracing = Tracing::Done { all };
        let mut light = self.met(light, settings, among, tracing);
        light.irradiance = (0..self.bake.len())
            .into_par_iter()
            .map(|i| self.irradiance(i, &light))
            .collect();
        light
    }

    /// Traces the light, without adding up irradiance.
    pub(super) fn met<'a>(
        &'a self,
        light: DirectionalLight,
        settings: &TransferSettings,
        around: Option<&'a Arc<InterObjectVisibility>>,
        tracing: Tracing,
    ) -> Incident<'a> {
        let terms = settings.terms;
        let among = around.map(|around| &**around);
        Incident {
            directional_visibility: among.map_or(&self.bake.directional_visibility, |a| {
                &a.directional_visibility
            }),
            first: among.map_or(0, |a| a.first),
            sky: IncidentSky::new(&light.sky),
            suns: light
                .suns
                .iter()
                .map(|s| (*s, self.seen_from(s, terms, among)))
                .collect(),
            near: self.meet(
                &light.emitters,
                if terms.shadow { tracing } else { Tracing::None },
                among,
            ),
            around: around.cloned(),
            irradiance: Vec::new(),
            mean: light.mean,
            user_gain: light.user_gain,
            least: light.least,
            terms,
            optimizations: settings.optimizations,
            others: None,
        }
    }

    /// An SH series by its values, where it is not negative.
    fn series(&self, light: &IncidentRadiance) -> Vec<LightSample> {
        let omega = 4.0 * PI / DIRECTIONS as f32;
        self.directions
            .iter()
            .map(|d| {
                let radiance = evaluate_sh(&light.coefficients, light.degree, d.to_array());
                LightSample {
                    direction: *d,
                    energy: radiance.map(|v| omega * v.max(0.0)),
                }
            })
            .collect()
    }

    /// Surfels that a sun shines on, on either side where both count. `[n]`
    fn seen_from(
        &self,
        sun: &LightSample,
        terms: Terms,
        among: Option<&InterObjectVisibility>,
    ) -> Vec<bool> {
        let bake = &self.bake;
        if !terms.shadow {
            return vec![true; self.bake.len()];
        }
        let faces = |i: u32| {
            let i = i as usize;
            bake.two_sided[i] > 0.0 || bake.normals[i].dot(sun.direction) > 0.0
        };
        match among {
            Some(others) => others.open_towards(&bake.tracer, sun.direction, faces),
            None => bake.tracer.open_towards(sun.direction, faces),
        }
    }

    /// Irradiance of surfel `i`, front and back, with epsilon's share.
    pub(super) fn irradiance(&self, i: usize, light: &Incident<'_>) -> FrontAndBack {
        let n = self.bake.normals[i];
        let (open, sky) = (light.open(i), &light.sky);
        // Not all have a back that counts, and a sum costs as much as the other.
        let mut sides = if self.bake.two_sided[i] > 0.0 {
            open_irradiance::<2>(n, open, sky)
        } else {
            open_irradiance::<1>(n, open, sky)
        };
        for (sun, open) in &light.suns {
            if open[i] {
                let cosine = n.dot(sun.direction);
                for (s, e) in sides[usize::from(cosine < 0.0)].iter_mut().zip(sun.energy) {
                    *s += cosine.abs() * e;
                }
            }
        }
        for near in &light.near {
            near.add_to(i, MAX_RELATIVE_LIGHT, &mut sides);
        }
        sides.map(|e| std::array::from_fn(|c| e[c] + light.least[c]))
    }

    /// Light that bounces to surfel `i` from what the others radiate.
    pub(in crate::transfer) fn bounced(
        &self,
        i: usize,
        light: &Incident<'_>,
        radiance: &[Radiance],
    ) -> FrontAndBack {
        if self.bake.two_sided[i] > 0.0 {
            self.sum_of_hits::<2>(i, light, radiance)
        } else {
            self.sum_of_hits::<1>(i, light, radiance)
        }
    }

    #[inline(always)]
    fn sum_of_hits<const SIDES: usize>(
        &self,
        i: usize,
        light: &Incident<'_>,
        radiance: &[Radiance],
    ) -> FrontAndBack {
        let scale = 4.0 * PI / STRATA as f32;
        let n = scale * self.bake.normals[i];
        let [mut front, mut back] = [Vec3A::ZERO; 2];
        for hit in light.hits(i) {
            let cosine = light.factor(*hit) * n.dot(self.directions[hit.stratum()]);
            let b = radiance_of(radiance, *hit);
            // Without a branch: it could not be foretold.
            front += cosine.max(0.0) * b;
            if SIDES > 1 {
                back += (-cosine).max(0.0) * b;
            }
        }
        [front.to_array(), back.to_array()]
    }

    /// All that shines on the front of surfel `i`, a ray a patch: the open sky, and what is met where it is blocked; and the suns.
    pub(super) fn rays_of(
        &self,
        i: usize,
        light: &Incident<'_>,
        radiance: &[Radiance],
        out: &mut Rays,
    ) {
        let n = self.bake.normals[i];
        let scale = 4.0 * PI / DIRECTIONS as f32;
        // Next to a direction that is open, what blocks is taken to be as bright as the surfel itself.
        let near = if light.terms.bounce { scale } else { 0.0 };
        let [r, g, b] = (radiance[light.first + i][0] * near).to_array();
        let mut met = [[r; STRATA], [g; STRATA], [b; STRATA]];
        for hit in light.hits(i) {
            let b = radiance_of(radiance, *hit);
            let scale = scale * light.factor(*hit);
            for c in 0..3 {
                met[c][hit.stratum()] = b[c] * scale;
            }
        }
        let open = light.open(i);
        out.clear();
        strata(n, open, &self.planes, &light.sky, &met, out);
        for (k, (sun, open)) in light.suns.iter().enumerate() {
            if open[i] && n.dot(sun.direction) > 0.0 {
                out.set(STRATA + k, sun);
            }
        }
        let mut next = STRATA + light.suns.len();
        for near in &light.near {
            for light_sample in near.light_samples(self, i, MAX_RELATIVE_LIGHT) {
                out.set(next, &light_sample);
                next += 1;
            }
        }
    }
}

impl Incident<'_> {
    /// Factor of the radiance of a surfel that is hit.
    #[inline(always)]
    fn factor(&self, hit: Hit) -> f32 {
        match &self.others {
            Some(others) if !others.are_own(hit.surfel()) => others.gain,
            _ => 1.0,
        }
    }

    fn open(&self, i: usize) -> &[u64; WORDS] {
        if self.terms.shadow {
            self.directional_visibility.open_of(i)
        } else {
            &[u64::MAX; WORDS]
        }
    }

    fn hits(&self, i: usize) -> &[Hit] {
        if self.terms.shadow && self.terms.bounce {
            self.directional_visibility.hits_of(i)
        } else {
            &[]
        }
    }
}

/// Radiance of the side of a surfel that a ray met.
#[inline(always)]
fn radiance_of(radiance: &[Radiance], hit: Hit) -> Vec3A {
    radiance[hit.surfel()][usize::from(hit.is_back())]
}

fn lanes_of(plane: &[f32], start: usize) -> [f32; LANES] {
    let mut out = [0f32; LANES];
    out.copy_from_slice(&plane[start..start + LANES]);
    out
}

/// Sum over the open directions of cosine times energy, front and, of two sides, back.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn open_irradiance<const SIDES: usize>(
    n: Vec3,
    open: &[u64; WORDS],
    sky: &IncidentSky,
) -> FrontAndBack {
    let mut sums = [[[0f32; LANES]; 3]; 2];
    for start in (0..DIRECTIONS).step_by(LANES) {
        let bits = (open[start / 64] >> (start % 64)) as u32;
        let [x, y, z] = [0, 1, 2].map(|c| lanes_of(&sky.direction[c], start));
        let mut cosines = [[0f32; LANES]; 2];
        for i in 0..LANES {
            let cosine = n.x * x[i] + n.y * y[i] + n.z * z[i];
            let seen = ((bits >> i) & 1) as f32;
            cosines[0][i] = seen * if cosine > 0.0 { cosine } else { 0.0 };
            cosines[1][i] = seen * if cosine < 0.0 { -cosine } else { 0.0 };
        }
        for c in 0..3 {
            let e = lanes_of(&sky.energy[c], start);
            for side in 0..SIDES {
                for i in 0..LANES {
                    sums[side][c][i] += cosines[side][i] * e[i];
                }
            }
        }
    }
    sums.map(|side| side.map(|lanes| lanes.iter().sum()))
}

/// Light of each patch on the front side, from where most of it comes.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn strata(
    n: Vec3,
    open: &[u64; WORDS],
    directions: &Planes,
    sky: &IncidentSky,
    met: &StratumPlanes,
    out: &mut Rays,
) {
    for start in (0..STRATA).step_by(LANES) {
        let met = [0, 1, 2].map(|c| lanes_of(&met[c], start));
        let mut sums = [[[0f32; LANES]; 3]; 2];
        for place in 0..PER_STRATUM {
            let first = place * STRATA + start;
            let bits = (open[first / 64] >> (first % 64)) as u32;
            let at = [0, 1, 2].map(|c| lanes_of(&directions[c], first));
            let (mut seen, mut blocked) = ([0f32; LANES], [0f32; LANES]);
            for i in 0..LANES {
                let cosine = n.x * at[0][i] + n.y * at[1][i] + n.z * at[2][i];
                let front = if cosine > 0.0 { 1.0 } else { 0.0 };
                seen[i] = front * ((bits >> i) & 1) as f32;
                blocked[i] = front - seen[i];
            }
            for c in 0..3 {
                let shines = lanes_of(&sky.energy[c], first);
                let toward = lanes_of(&sky.toward[c], first);
                for i in 0..LANES {
                    let sum = met[0][i] + met[1][i] + met[2][i];
                    sums[0][c][i] += seen[i] * shines[i] + blocked[i] * met[c][i];
                    sums[1][c][i] += seen[i] * toward[i] + blocked[i] * sum * at[c][i];
                }
            }
        }
        let [shines, mut toward] = sums;
        for i in 0..LANES {
            let [x, y, z] = [toward[0][i], toward[1][i], toward[2][i]];
            // No light, no direction; squares of what is fainter would leave f32's range.
            let over = 1.0 / (x * x + y * y + z * z).max(1e-36).sqrt();
            for axis in &mut toward {
                axis[i] *= over;
            }
        }
        for c in 0..3 {
            out.direction[c][start..start + LANES].copy_from_slice(&toward[c]);
            out.energy[c][start..start + LANES].copy_from_slice(&shines[c]);
        }
        for i in 0..LANES {
            let holds = shines[0][i] + shines[1][i] + shines[2][i] > 0.0;
            out.list_if(holds, start + i);
        }
    }
}
