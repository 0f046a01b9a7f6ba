//! Relight by the directional method, with its skipped work and memory.

use std::sync::Arc;

use rayon::prelude::*;

use super::neighbors::SHARED_LOBES_ERROR;
use super::shadow_rays::Tracing;
use super::specular_lobe::{LEAST_GLOSS, pooled};
use super::{
    DirectionalLight, DirectionalTransfer, FrontAndBack, Incident, LEAST_IRRADIANCE, LOBE_TRUST,
    Radiance, TURNS, TransferScratch,
};
use crate::bake::surroundings::InterObjectVisibility;
use crate::bake::trace::{STACK_SCALES, Stack};
use crate::color_rows::ColorRows;
use crate::environment::{Illumination, Shape};
use crate::error::Result;
use crate::numeric::smoothstep;
use crate::settings::Terms;
use crate::settings::optimizations::{Optimization, SkippedWork, Stage};
use crate::sh::coefficient_count;
use crate::surfels::SurfelCloud;
use crate::transfer::cast_shadows::{
    CastShadow, CastShadows, LitSurfel, PlacedShadows, transmittance,
};
use crate::transfer::materials::Materials;
use crate::transfer::relit::{Part, Relight, Relit, RelitRows, empty_bytes, switched_off};

/// Visible share of a light around a surfel within which an edge of a shadow is near: from none at 0 and 1 to certain at this far from both.
const NEAR_EDGE: f32 = 0.12;

/// Cosines to a light between which rays at the pixel take over: at grazing angles the surfels' own roughness casts shadows.
const GRAZING: [f32; 2] = [0.2, 0.5];

/// Reach of a surface's own surfels where edges of shadows are looked for, over that of other rays.
const STACK_BELOW: f32 = 2.0;

/// Mean relative change of the surfels' light from which on shadows are cast in full: under the light of the capture they are in its colours.
const CHANGED: f32 = 0.03;

/// Change below which there is none but rounding.
const UNCHANGED: f32 = 1e-5;

impl DirectionalTransfer {
    /// Relights; `part` says what of the colour is wanted. Surfels that are not seen (`[n]` or empty) stay as captured: they still give light
    /// to the others.
    pub fn relight(&self, light: DirectionalLight, part: Part, unseen: &[bool]) -> Relit {
        self.relight_in(self.whole_rows(), light, part, unseen)
            .into_whole()
    }

    /// Relights into rows that are there.
    pub(super) fn relight_in(
        &self,
        sh: ColorRows,
        light: DirectionalLight,
        part: Part,
        unseen: &[bool],
    ) -> RelitRows {
        let asset = &*self.asset;
        let mut light = asset.incident(light, &self.settings, None);
        let tau = self.bounce(&light);
        // Nothing asks it any more.
        light.irradiance = Vec::new();
        let radiance: Vec<Radiance> = asset.radiance(&tau).collect();
        self.shown(sh, (&light, part), tau, &radiance, unseen)
    }

    /// Colour of the surfels in a light, each diffuse side changed by tau and all of them radiating `radiance`, put into rows that are there.
    pub(in crate::transfer) fn shown(
        &self,
        mut sh: ColorRows,
        (light, part): (&Incident<'_>, Part),
        tau: Vec<FrontAndBack>,
        radiance: &[Radiance],
        unseen: &[bool],
    ) -> RelitRows {
        let asset = &*self.asset;
        let k = coefficient_count(asset.nodes.degree);
        sh.fill(TransferScratch::default, |scratch, first, out| {
            scratch.backs.clear();
            for (at, out) in out.chunks_exact_mut(k).enumerate() {
                let i = first + at;
                if unseen.get(i).is_some_and(|u| *u) {
                    out.copy_from_slice(&asset.sh[i * k..][..k]);
                } else {
                    self.relight_surfel(i, (light, part), tau[i], radiance, scratch, out);
                }
            }
            let diffuse = self.diffuse(part);
            diffuse.add_backs(first, &tau, &scratch.backs, &mut scratch.lanes, out);
        });
        let mut outward_sides: Vec<[f32; 3]> = tau.into_iter().map(|t| t[0]).collect();
        // They are where both sides were.
        outward_sides.shrink_to_fit();
        // They are of diffuse light.
        let shadows = match part {
            Part::Specular => None,
            Part::Whole | Part::Diffuse => self.cast_shadows(light, &outward_sides),
        };
        let alone = |shadows| PlacedShadows::alone(Arc::new(shadows), outward_sides.len());
        RelitRows {
            sh,
            degree: asset.nodes.degree,
            encoding: asset.encoding,
            shadows: shadows.into_iter().map(alone).collect(),
            tau: outward_sides,
        }
    }

    /// Rows for colour in full precision.
    pub(in crate::transfer) fn whole_rows(&self) -> ColorRows {
        let k = coefficient_count(self.asset.nodes.degree);
        ColorRows::whole(vec![[0.0; 3]; self.asset.bake.len() * k], k)
    }
}

impl DirectionalTransfer {
    /// Shadows that the suns and placed lights of a light cast on surfels whose diffuse light it changes by `tau`, `[n]`; none where no edge of a
    /// shadow is on the asset, or the light is that of the capture.
    fn cast_shadows(&self, light: &Incident<'_>, tau: &[[f32; 3]]) -> Option<CastShadows> {
        let asset = &*self.asset;
        let (bake, tracer) = (&asset.bake, &asset.bake.tracer);
        let (terms, change) = (self.settings.terms, self.mean_change(tau));
        if !(terms.shadow && terms.pixel_shadows) {
            return None;
        }
        if light.suns.is_empty() && light.near.is_empty() || change.is_nan() || change <= UNCHANGED
        {
            return None;
        }
        let whole = self.undamped(light.user_gain);
        // All the light of a surfel, as its change tells.
        let irradiance: Vec<[f32; 3]> = (0..tau.len())
            .map(|i| {
                std::array::from_fn(|c| {
                    let change = (tau[i][c] / whole[c]).powf(1.0 / self.trust.max(0.1));
                    (change * self.divisor[i][0][c]).max(LEAST_IRRADIANCE)
                })
            })
            .collect();
        let suns = light.suns.iter().map(|(sun, open)| {
            let shape = Shape::Distant {
                toward: sun.direction,
                radius: 0.0,
            };
            let seen: Vec<f32> = open.iter().map(|open| f32::from(*open)).collect();
            (shape, sun.energy, seen)
        });
        let near = light.near.iter().map(|near| {
            let shape = near.emitter.shape;
            let seen = (0..tau.len()).map(|i| near.seen_share(asset, i));
            (shape, near.emitter.emission, seen.collect())
        });
        let sizes: Vec<[f32; 1]> = tracer.surfels.iter().map(|s| [s.major]).collect();
        let sizes = pooled(&sizes, &asset.neighbors, &bake.visible_weight);
        let of_light = |(shape, emission, seen): (Shape, [f32; 3], Vec<f32>)| {
            let around = self.seen_around(&shape, &sizes, light.around.as_deref());
            let lit = |i: usize| {
                let (surfel, normal) = (&tracer.surfels[i], bake.normals[i]);
                let toward = shape.sample((0, 1), [0.5; 2], surfel.position, surfel.minor);
                let edge = smoothstep(0.0, NEAR_EDGE, around[i][0])
                    * smoothstep(1.0, 1.0 - NEAR_EDGE, around[i][0]);
                let near_edge = edge
                    * smoothstep(GRAZING[0], GRAZING[1], normal.dot(toward.direction))
                    * (1.0 - bake.two_sided[i])
                    * (1.0 - self.emission_share_of(i));
                if near_edge <= 0.0 {
                    return LitSurfel::default();
                }
                let [unit, _] = shape.irradiance(surfel.position, normal, surfel.minor);
                LitSurfel {
                    share: std::array::from_fn(|c| {
                        near_edge * unit * emission[c] / irradiance[i][c]
                    }),
                    seen: seen[i],
                }
            };
            CastShadow {
                shape,
                surfels: (0..tau.len()).into_par_iter().map(lit).collect(),
            }
        };
        let has_edges = |of: &CastShadow| of.surfels.iter().any(|s| s.share != [0.0; 3]);
        let lights: Vec<CastShadow> = suns.chain(near).map(of_light).filter(has_edges).collect();
        (!lights.is_empty()).then(|| CastShadows {
            tracer: tracer.clone(),
            around: light.around.clone(),
            lights,
            trust: self.trust,
            weight: 1.0 - (-(change / CHANGED).powi(2)).exp(),
        })
    }

    /// Mean change of what lights the surfels, relative to the sum of before and after, by how much they make up of what is seen.
    fn mean_change(&self, tau: &[[f32; 3]]) -> f32 {
        let (mut changed, mut all) = (0f64, 0f64);
        for ((tau, divisor), weight) in tau
            .iter()
            .zip(&self.divisor)
            .zip(&self.asset.bake.visible_weight)
        {
            for (tau, before) in tau.iter().zip(divisor[0]) {
                let before = f64::from(weight * before);
                changed += before * f64::from((tau - 1.0).abs());
                all += before * f64::from(tau + 1.0);
            }
        }
        (changed / all.max(f64::MIN_POSITIVE)) as f32
    }

    /// Visible share of a light around each surfel, through soft surfels: 0 in a shadow, 1 beside it. `[n]`
    fn seen_around(
        &self,
        shape: &Shape,
        sizes: &[[f32; 1]],
        around: Option<&InterObjectVisibility>,
    ) -> Vec<[f32; 1]> {
        let bake = &self.asset.bake;
        let trace = |stack: &mut Stack, i: usize| {
            let surfel = &bake.tracer.surfels[i];
            let toward = shape.sample((0, 1), [0.5; 2], surfel.position, surfel.minor);
            if toward.strength <= 0.0 || bake.normals[i].dot(toward.direction) <= 0.0 {
                return [0.0];
            }
            let mut start = surfel.start(toward.direction);
            start.stack = start.stack.max(STACK_BELOW * STACK_SCALES * sizes[i][0]);
            let (direction, end) = (toward.direction, toward.distance);
            let tracer = &bake.tracer;
            [transmittance(
                tracer, around, surfel, start, direction, end, stack,
            )]
        };
        let surfels = (0..sizes.len()).into_par_iter();
        let seen: Vec<[f32; 1]> = surfels.map_init(Stack::new, trace).collect();
        pooled(&seen, &self.asset.neighbors, &bake.visible_weight)
    }
}

impl Relight for DirectionalTransfer {
    fn relight_after(
        &self,
        last: Option<Relit>,
        target: &Illumination,
        part: Part,
        unseen: &[bool],
    ) -> Result<Relit> {
        // Two at once would be twice the memory.
        drop(last);
        Ok(self.relight(self.light(target)?, part, unseen))
    }

    fn relight_rows(
        &self,
        target: &Illumination,
        part: Part,
        unseen: &[bool],
    ) -> Result<RelitRows> {
        let (n, k) = (
            self.asset.bake.len(),
            coefficient_count(self.asset.nodes.degree),
        );
        let rows = ColorRows::new(n, k, n);
        Ok(self.relight_in(rows, self.light(target)?, part, unseen))
    }

    fn tau(&self, target: &Illumination) -> Result<Vec<[f32; 3]>> {
        Ok(self.ratio(self.light(target)?))
    }

    fn coarse_tau(&self, target: &Illumination) -> Result<Option<Vec<[f32; 3]>>> {
        self.coarse_ratio(target).map(Some)
    }

    fn materials(&self, whitest: Option<f32>) -> Materials {
        self.materials_of(whitest)
    }

    fn computed_part(&self, shown: Part) -> Part {
        shown
    }

    fn skipped_work(&self, cloud: &SurfelCloud) -> Vec<SkippedWork> {
        let mut out = switched_off(&self.settings);
        let (n, asset) = (self.asset.bake.len(), &self.asset);
        let degree = asset.nodes.degree;
        if degree < cloud.sh_degree {
            let what = format!("SH bands above {degree}");
            let why = "the asset's colour has nothing there";
            out.push(SkippedWork {
                skip: Some(Optimization::EmptyBands),
                // Stored colour, its residual, and the result.
                bytes: 3 * empty_bytes(n, cloud.sh_degree, degree),
                ..SkippedWork::exact(Stage::Transfer, what, why)
            });
        }
        let asked = asset.neighbors.asked().len();
        if asked < n {
            let told = 100.0 * (n - asked) as f32 / n as f32;
            let why = format!("{told:.0} % of the Gaussians follow their neighbours");
            out.push(SkippedWork {
                skip: Some(Optimization::SharedLobes),
                max_error: Some(SHARED_LOBES_ERROR),
                ..SkippedWork::exact(Stage::Prepare, "what each Gaussian is made of", why)
            });
        }
        if self.settings.terms.lobe
            && self
                .settings
                .optimizations
                .has(Optimization::DiffuseSurfels)
            && self.specular_surfels < n
        {
            let (what, why) = if self.specular_surfels > 0 {
                let diffuse = 100.0 * (n - self.specular_surfels) as f32 / n as f32;
                let what = format!("the lobe of {diffuse:.0} % of the Gaussians");
                (what, "their colour shows no visible highlights")
            } else if self.trust < LOBE_TRUST {
                let why = "reflections cannot be separated from paint without the capture light";
                ("specular lobe".into(), why)
            } else if cloud.has_view_dependence() {
                (
                    "specular lobe".into(),
                    "the splat's colour shows no visible highlights",
                )
            } else {
                let why = "the asset's colour does not depend on the view";
                ("specular lobe".into(), why)
            };
            let any = self.faintly_specular > 0;
            out.push(SkippedWork {
                skip: Some(Optimization::DiffuseSurfels),
                max_error: Some(if any { LEAST_GLOSS } else { 0.0 }),
                ..SkippedWork::exact(Stage::Transfer, what, why)
            });
        }
        if self.turns() < TURNS && self.settings.terms.bounce && self.settings.terms.shadow {
            let why = "no light bounces between Gaussians";
            out.push(SkippedWork {
                skip: Some(Optimization::Bounces),
                ..SkippedWork::exact(Stage::Transfer, "turns of the bounce", why)
            });
        }
        out
    }

    fn skipped_work_for(&self, light: &Illumination, _: bool) -> Option<SkippedWork> {
        let Terms { sums, suns, .. } = self.settings.terms;
        let has_none = light
            .light_samples
            .as_ref()
            .is_none_or(|b| b.suns.is_empty());
        let has_none = has_none && light.emitters.is_empty();
        (has_none && sums && suns && self.settings.optimizations.has(Optimization::Suns)).then(
            || SkippedWork {
                skip: Some(Optimization::Suns),
                ..SkippedWork::exact(Stage::Transfer, "rays to suns", "the light has no sun")
            },
        )
    }

    fn shadows(&self, target: &Illumination, tau: &[[f32; 3]]) -> Result<Option<Arc<CastShadows>>> {
        let tracing = Tracing::Done { all: false };
        let light = (self.asset).met(self.light(target)?, &self.settings, None, tracing);
        Ok(self.cast_shadows(&light, tau).map(Arc::new))
    }

    fn light_gain(&self) -> f32 {
        self.light_gain
    }

    fn source_was_black(&self) -> bool {
        self.source_was_black
    }

    fn bytes(&self) -> usize {
        let bake = &self.asset.bake;
        bake.directional_visibility.bytes()
            + size_of_val(&bake.normals[..])
            + size_of_val(&self.asset.means[..])
            + size_of_val(&self.specular_lobe[..])
            + size_of_val(&self.emission_share[..])
            + size_of_val(&self.divisor[..])
            + self.diffuse.bytes()
            + self.residual.bytes()
            + size_of_val(&self.encoded_mean[..])
            + size_of_val(&self.darkest[..])
    }

    fn amplification(&self, i: usize) -> f32 {
        let least = self.divisor[i][0].into_iter().fold(f32::INFINITY, f32::min);
        1.0 / least.max(LEAST_IRRADIANCE)
    }

    fn epsilon_share(&self, i: usize) -> f32 {
        let shares = self.epsilon_shares(i);
        (shares[0] + shares[1] + shares[2]) / 3.0
    }

    fn is_dark(&self, i: usize) -> bool {
        self.epsilon_shares(i).iter().any(|s| *s > 0.5)
    }

    fn dark_share(&self) -> f32 {
        let dark = (0..self.asset.bake.len())
            .filter(|i| self.is_dark(*i))
            .count();
        dark as f32 / self.asset.bake.len().max(1) as f32
    }
}
