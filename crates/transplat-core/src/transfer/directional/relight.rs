//! Relight by the directional method, with its skipped work and memory.

use rayon::prelude::*;

use super::neighbors::SHARED_LOBES_ERROR;
use super::specular_lobe::LEAST_GLOSS;
use super::{
    DirectionalLight, DirectionalTransfer, FrontAndBack, Incident, LEAST_IRRADIANCE, LOBE_TRUST,
    Radiance, TURNS, TransferScratch,
};
use crate::color_rows::ColorRows;
use crate::environment::Illumination;
use crate::error::Result;
use crate::settings::Terms;
use crate::settings::optimizations::{Optimization, SkippedWork, Stage};
use crate::sh::coefficient_count;
use crate::surfels::SurfelCloud;
use crate::transfer::materials::Materials;
use crate::transfer::relit::{Part, Relight, Relit, RelitRows, empty_bytes, switched_off};

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
        RelitRows {
            sh,
            degree: asset.nodes.degree,
            encoding: asset.encoding,
            tau: outward_sides,
        }
    }

    /// Rows for colour in full precision.
    pub(in crate::transfer) fn whole_rows(&self) -> ColorRows {
        let k = coefficient_count(self.asset.nodes.degree);
        ColorRows::whole(vec![[0.0; 3]; self.asset.bake.len() * k], k)
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
