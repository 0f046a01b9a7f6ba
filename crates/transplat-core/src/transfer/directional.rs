//! The directional method: quadrature over directions instead of products of SH series, with materials fitted to the splat's own colour under the
//! source light. `docs/method.md` derives it.
//!
//! Once for an asset: [`DirectionalCache`]. Once for asset and source light: [`DirectionalTransfer`]. A new light is then sums over light.

mod asset;
mod coarse;
mod diffuse;
mod diffuse_colors;
mod emission;
mod incident;
mod light_visibility;
mod lobe;
mod materials;
mod moments;
mod neighbors;
mod nodes;
mod rays;
mod relight;
mod shadow_rays;
mod specular_lobe;

use std::borrow::Cow;
use std::sync::Arc;

use rayon::prelude::*;

use super::materials::WHITEST;
use super::relit::Part;
use crate::bake::directional::DirectionalBake;
use crate::color_rows::{ColorRows, RowMut, rows_of};
use crate::environment::{Illumination, IncidentRadiance, LightSamples};
use crate::error::Result;
use crate::numeric::weighted_quantile;
use crate::progress::{Progress, no_progress, tell};
use crate::settings::optimizations::Optimization;
use crate::settings::{Terms, TransferSettings};
use crate::sh::coefficient_count;

pub(crate) use asset::mean_radiance;
pub use asset::{DirectionalCache, DirectionalLight, FrontAndBack, Radiance};
pub use diffuse::{BACK_RANGE, HORIZON, RESIDUAL_FLOOR};
use diffuse::{BackLanes, DiffuseSurfels, residual_scale, share_of_back, within_range};
use diffuse_colors::DiffuseColors;
use emission::find_emission;
pub(super) use incident::{Incident, Others};
pub use lobe::WIDTHS;
use lobe::mirrored;
pub(crate) use neighbors::NEIGHBORS;
pub use nodes::QuadratureNodes;
use nodes::SurfelFrame;
pub(crate) use nodes::{FIT_FLOOR, FIT_RIDGE, NORMAL_OVER_GRAZING};
use rays::Rays;
pub use specular_lobe::SpecularLobe;
pub(crate) use specular_lobe::{
    METAL, METAL_TURNS, MOST_GLOSS, MOST_REFLECTANCE, RIDGE, TRUSTED_CORRELATION,
};
use specular_lobe::{fit_lobes, pooled};

/// Turns of the fixed point by which light bounces.
pub const TURNS: usize = 3;

/// Least divisor, relative to the mean irradiance of the source: a channel may hold no light at all.
pub const LEAST_IRRADIANCE: f32 = 1e-6;

/// A channel of the source with less than that share of its mean irradiance tells nothing: it is filled up to it, in both lights.
const LEAST_CHANNEL: f32 = 0.05;

/// Trust from which on a source is asked what it mirrored.
pub const LOBE_TRUST: f32 = 0.6;

/// An asset under its source light, ready for any other.
#[derive(Clone, Debug)]
pub struct DirectionalTransfer {
    /// Splat that is relit.
    pub asset: Arc<DirectionalCache>,
    /// How.
    pub settings: TransferSettings,
    /// Factor of target lights: 1 over the source's mean irradiance.
    pub light_gain: f32,
    /// True where the source was black, and even light was taken in its place.
    pub source_was_black: bool,
    /// Power to which a change of matte light is taken: [`Illumination::trust`] of the source. What it mirrored is not asked below [`LOBE_TRUST`].
    pub trust: f32,
    /// [`Illumination::user_gain`] of the source.
    user_gain: [f32; 3],
    /// Mean irradiance of the source, as [`DirectionalLight::mean`] and so multiplied.
    mean: [f32; 3],
    /// Epsilon's part of the divisor.
    least: [f32; 3],
    /// Share of each light's mean that a channel gets because the source hardly has it.
    fill: [f32; 3],
    /// Specular lobe of each surfel. `[n]`
    pub specular_lobe: Vec<SpecularLobe>,
    /// Share of emission in each surfel's diffuse colour, which no light changes; empty where none is. `[n]`
    emission_share: Vec<f32>,
    /// Number of surfels with any specular lobe.
    pub specular_surfels: usize,
    /// Number of surfels whose lobe is so faint that they are taken for diffuse.
    faintly_specular: usize,
    /// Irradiance, bounced light and epsilon under the source. `[n]`
    pub divisor: Vec<FrontAndBack>,
    /// Colour at the nodes that gloss does not explain: [`DirectionalTransfer::diffuse_of`].
    diffuse: DiffuseColors,
    /// The least of it in each channel. `[n]`
    darkest: Vec<[f32; 3]>,
    /// Stored colour that the model of the source misses. `[n][K]`
    residual: ColorRows,
    /// Mean encoded colour that the model of the source has. `[n]`
    pub encoded_mean: Vec<[f32; 3]>,
}

/// The asset's whitest albedo as it appears: exitance over irradiance, the mean of the channels, around each surfel.
fn whitest(asset: &DirectionalCache, divisor: &[FrontAndBack]) -> f32 {
    let visible_weight = &asset.bake.visible_weight;
    let each = asset.means.iter().zip(divisor);
    let light: Vec<[f32; 2]> = each
        .map(|([m, _], [d, _])| [std::f32::consts::PI * m.iter().sum::<f32>(), d.iter().sum()])
        .collect();
    let albedos = pooled(&light, &asset.neighbors, visible_weight)
        .into_iter()
        .map(|[exitance, irradiance]| f64::from(exitance / irradiance))
        .zip(visible_weight.iter().map(|p| f64::from(*p)))
        .filter(|(albedo, _)| albedo.is_finite())
        .collect();
    weighted_quantile(albedos, f64::from(WHITEST)).map_or(1.0, |a| a.max(1e-12) as f32)
}

impl DirectionalCache {
    /// Splits a surfel's colour: what gloss does not explain of that at the nodes goes into `diffuse`, `[Q]`, where that is kept, and what the model
    /// misses of the stored one into `residual`, `[K]`. Returns the model's mean encoded colour, and the darkest of the matte one.
    fn explain(
        &self,
        i: usize,
        (specular_lobe, light, radiance): (&SpecularLobe, &Incident<'_>, &[Radiance]),
        scratch: &mut TransferScratch,
        diffuse: Option<RowMut<'_>>,
        residual: RowMut<'_>,
    ) -> [[f32; 3]; 2] {
        let nodes = &self.nodes;
        let mut colors = self.colors_of(i);
        self.reflect(i, specular_lobe, light, radiance, scratch);
        if !scratch.specular.is_empty() {
            let seen = nodes.values(&nodes.refit, &scratch.specular);
            for (m, s) in colors.iter_mut().zip(&seen) {
                *m = std::array::from_fn(|c| (m[c] - s[c]).max(0.0));
            }
        }
        // What is kept is what is used.
        if let Some(diffuse) = diffuse {
            diffuse.store(&mut colors);
        }
        self.store(&colors, [1.0; 3], scratch);
        let mut shown = nodes.function(&nodes.fit, &scratch.stored);
        SurfelFrame::new(self.bake.normals[i]).apply_sh(nodes.degree, &mut shown);
        for (s, stored) in shown
            .iter_mut()
            .zip(&self.sh[i * coefficient_count(nodes.degree)..])
        {
            *s = std::array::from_fn(|c| stored[c] - s[c]);
        }
        residual.store(&mut shown);
        [self.encoded_mean(&scratch.stored), self.darkest(i, &colors)]
    }

    /// Evaluates the specular lobe of surfel `i` towards each node, into `scratch.specular`: `[Q]`, or empty where that is nothing.
    fn reflect(
        &self,
        i: usize,
        specular_lobe: &SpecularLobe,
        light: &Incident<'_>,
        radiance: &[Radiance],
        scratch: &mut TransferScratch,
    ) {
        scratch.specular.clear();
        if specular_lobe.is_diffuse() && light.optimizations.has(Optimization::DiffuseSurfels) {
            return;
        }
        let q = self.nodes.count();
        self.rays_of(i, light, radiance, &mut scratch.rays);
        scratch.values.resize(3 * q, 0.0);
        let frame = SurfelFrame::new(self.bake.normals[i]);
        let (rays, values) = (&scratch.rays, &mut scratch.values);
        mirrored(&self.nodes, frame, specular_lobe.width, rays, values);
        scratch.specular.extend((0..q).map(|s| {
            let rise = if specular_lobe.has_fresnel {
                self.nodes.rise[s]
            } else {
                1.0
            };
            std::array::from_fn(|c| rise * specular_lobe.reflectance[c] * values[c * q + s])
        }));
    }

    /// The least of surfel `i`'s colour at the nodes in each channel: of its matte one, `[Q]`, and where it has two sides of both as stored.
    fn darkest(&self, i: usize, diffuse: &[[f32; 3]]) -> [f32; 3] {
        if self.bake.two_sided[i] == 0.0 {
            return darkest(diffuse);
        }
        let nodes = &self.nodes;
        let k = coefficient_count(nodes.degree);
        let mut f = self.sh[i * k..][..k].to_vec();
        SurfelFrame::new(self.bake.normals[i]).apply_sh(nodes.degree, &mut f);
        let sides = [&nodes.evaluate, &nodes.evaluate_back].map(|e| darkest(&nodes.values(e, &f)));
        let stored = darkest(&sides).map(|v| self.encoding.decode(v));
        // What is clamped is not what is stored.
        let least = darkest(&[darkest(diffuse), stored]);
        least.map(|v| if v > 0.0 { v } else { f32::NAN })
    }

    /// Stored colour of `diffuse * tau`, `[Q]`, and what is in `scratch.specular`, into `scratch.stored`.
    fn store(&self, diffuse: &[[f32; 3]], tau: [f32; 3], scratch: &mut TransferScratch) {
        let out = &mut scratch.stored;
        out.clear();
        out.extend(
            diffuse
                .iter()
                .map(|m| [m[0] * tau[0], m[1] * tau[1], m[2] * tau[2]]),
        );
        for (o, g) in out.iter_mut().zip(&scratch.specular) {
            for c in 0..3 {
                o[c] += g[c];
            }
        }
        self.encoding.encode_all(bytemuck::cast_slice_mut(out));
    }

    /// Mean over the nodes of stored colour, as the renderer shows it.
    fn encoded_mean(&self, stored: &[[f32; 3]]) -> [f32; 3] {
        let mut sum = [0f64; 3];
        for v in stored {
            for c in 0..3 {
                sum[c] += f64::from(v[c]);
            }
        }
        let count = stored.len().max(1) as f64;
        sum.map(|s| (s / count) as f32 + self.encoding.offset())
    }
}

impl DirectionalTransfer {
    /// Prepares asset and source light.
    ///
    /// # Errors
    /// The light was read without its beams.
    pub fn new(
        asset: &Arc<DirectionalCache>,
        source: &Illumination,
        settings: &TransferSettings,
    ) -> Result<Self> {
        Self::prepared(asset, source, settings, &no_progress)
    }

    /// Prepares a transfer, with progress.
    ///
    /// # Errors
    /// As [`DirectionalTransfer::new`], and [`crate::error::Error::Cancelled`] when `progress` asked for it.
    pub(super) fn prepared(
        asset: &Arc<DirectionalCache>,
        source: &Illumination,
        settings: &TransferSettings,
        progress: Progress<'_>,
    ) -> Result<Self> {
        let (trust, user_gain) = (source.trust, source.user_gain);
        let source = source.for_directional()?;
        let source_was_black = source.1.mean_irradiance() <= 0.0;
        let even = (&IncidentRadiance::even(0), &LightSamples::even());
        let source = if source_was_black { even } else { source };
        let source = (source.0, source.1, &[][..]);
        let light_gain = (1.0 / source.1.mean_irradiance()).clamp(1e-30, 1e30);
        let fill = fill_of(source.1);
        let light = asset.light(source, (light_gain, user_gain), settings, fill);
        let light = asset.incident(light, settings, None);
        tell(progress, 0.25)?;
        let radiance = asset.captured_radiance();
        let divisor: Vec<FrontAndBack> = (0..asset.bake.len())
            .into_par_iter()
            .map(|i| {
                let bounced = asset.bounced(i, &light, &radiance);
                added(light.irradiance[i], bounced)
            })
            .collect();
        tell(progress, 0.35)?;
        let white = whitest(asset, &divisor);
        let (specular_lobe, faintly_specular) = if settings.terms.lobe && trust >= LOBE_TRUST {
            let mut specular_lobe = fit_lobes(asset, (&light, &radiance), white);
            let faint = if settings.optimizations.has(Optimization::DiffuseSurfels) {
                SpecularLobe::take_unseen(&mut specular_lobe, white)
            } else {
                0
            };
            (specular_lobe, faint)
        } else {
            (vec![SpecularLobe::default(); asset.bake.len()], 0)
        };
        tell(progress, 0.7)?;
        let emission_share = match settings.terms.emission {
            true => find_emission(
                asset,
                &divisor,
                &specular_lobe,
                (white, settings.glow_above, trust),
            ),
            false => Vec::new(),
        };
        let (q, k) = (asset.nodes.count(), coefficient_count(asset.nodes.degree));
        let n = asset.bake.len();
        let mut residual = ColorRows::new(n, k, n);
        let mut diffuse =
            DiffuseColors::for_those(specular_lobe.iter().map(|g| !g.is_diffuse()), q);
        let (encoded_mean, darkest) = (diffuse.rows_mut().into_par_iter())
            .zip(residual.rows_mut().into_par_iter())
            .enumerate()
            .map_init(
                TransferScratch::default,
                |scratch, (i, (diffuse, residual))| {
                    let shining = (&specular_lobe[i], &light, &radiance[..]);
                    let [mean, darkest] = asset.explain(i, shining, scratch, diffuse, residual);
                    (mean, darkest)
                },
            )
            .unzip();
        Ok(Self {
            asset: asset.clone(),
            settings: settings.clone(),
            light_gain,
            source_was_black,
            trust,
            user_gain,
            mean: light.mean,
            least: light.least,
            fill,
            specular_surfels: specular_lobe.iter().filter(|g| !g.is_diffuse()).count(),
            faintly_specular,
            specular_lobe,
            emission_share,
            divisor,
            darkest,
            diffuse,
            residual,
            encoded_mean,
        })
    }

    /// Transfer of some of its surfels without the others, given what they see then: their capture light is known from where they were captured,
    /// among the others.
    pub fn part(&self, bake: Arc<DirectionalBake>, surfels: &[usize]) -> Self {
        let specular_lobe = rows_of(&self.specular_lobe, 1, surfels);
        Self {
            asset: Arc::new(self.asset.part(bake, surfels)),
            settings: self.settings.clone(),
            specular_surfels: specular_lobe.iter().filter(|g| !g.is_diffuse()).count(),
            specular_lobe,
            emission_share: match self.emission_share[..] {
                [] => Vec::new(),
                _ => rows_of(&self.emission_share, 1, surfels),
            },
            divisor: rows_of(&self.divisor, 1, surfels),
            diffuse: self.diffuse.selected(surfels),
            darkest: rows_of(&self.darkest, 1, surfels),
            residual: self.residual.selected(surfels),
            encoded_mean: rows_of(&self.encoded_mean, 1, surfels),
            ..*self
        }
    }

    /// Colour of surfel `i` at the nodes that gloss does not explain, `[Q]`; by way of `read`, which holds nothing else.
    pub fn diffuse_of<'a>(&'a self, i: usize, read: &'a mut Vec<[f32; 3]>) -> Cow<'a, [[f32; 3]]> {
        match self.diffuse.row(i, read) {
            Some(row) => Cow::Borrowed(row),
            None => Cow::Owned(self.asset.colors_of(i)),
        }
    }

    /// Stored colour of surfel `i` that the model of the source misses, `[K]`; by way of `read`.
    pub fn residual_of<'a>(&'a self, i: usize, read: &'a mut Vec<[f32; 3]>) -> &'a [[f32; 3]] {
        self.residual.row(i, read)
    }

    /// A target light, taken in.
    ///
    /// # Errors
    /// The light was not read for the method.
    pub fn light(&self, target: &Illumination) -> Result<DirectionalLight> {
        let (gain, settings) = (self.light_gain, &self.settings);
        let (radiance, light_samples) = target.for_directional()?;
        let light = (radiance, light_samples, &target.emitters[..]);
        let told = target.user_gain;
        Ok(self.asset.light(light, (gain, told), settings, self.fill))
    }

    /// By how much a light's mean, [`DirectionalLight::mean`], is stronger than the source's: from there the bounces start.
    pub fn mean_ratio(&self, mean: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|c| mean[c] / self.mean[c].max(LEAST_IRRADIANCE))
    }

    /// By how much each surfel's front changes in matte light. `[n]`
    pub fn ratio(&self, light: DirectionalLight) -> Vec<[f32; 3]> {
        let light = self.asset.incident(light, &self.settings, None);
        self.bounce(&light).into_iter().map(|t| t[0]).collect()
    }

    fn epsilon_shares(&self, i: usize) -> [f32; 3] {
        let divisor = self.divisor[i][0];
        std::array::from_fn(|c| (self.least[c] / divisor[c].max(LEAST_IRRADIANCE)).clamp(0.0, 1.0))
    }

    /// Turns of the fixed point that this asset needs: where no light bounces, the first one is right.
    pub fn turns(&self) -> usize {
        let Terms { shadow, bounce, .. } = self.settings.terms;
        let bounces = shadow && bounce && !self.asset.bake.directional_visibility.hits.is_empty();
        if bounces || !self.settings.optimizations.has(Optimization::Bounces) {
            TURNS
        } else {
            1
        }
    }

    /// Change of the diffuse light on each side: a fixed point, since what one surfel gains lights others. `[n]`
    fn bounce(&self, light: &Incident<'_>) -> Vec<FrontAndBack> {
        let asset = &*self.asset;
        let mut tau = vec![[self.mean_ratio(light.mean); 2]; asset.bake.len()];
        let mut radiance = Vec::new();
        for _ in 0..self.turns() {
            asset.radiance(&tau).collect_into_vec(&mut radiance);
            self.turn(light, &radiance, &mut tau);
        }
        self.trusted(light.user_gain, &mut tau);
        tau
    }

    /// A turn of the fixed point: how much the matte light changes where the surfels radiate that, into `tau`, `[n]`.
    pub(super) fn turn(
        &self,
        light: &Incident<'_>,
        radiance: &[Radiance],
        tau: &mut [FrontAndBack],
    ) {
        let bounced = |i| self.asset.bounced(i, light, radiance);
        self.turn_with(light, bounced, tau);
    }

    /// A turn of the fixed point, given what light bounces to each surfel.
    pub(super) fn turn_with(
        &self,
        light: &Incident<'_>,
        bounced: impl Fn(usize) -> FrontAndBack + Sync,
        tau: &mut [FrontAndBack],
    ) {
        tau.par_iter_mut().enumerate().for_each(|(i, tau)| {
            *tau = self.change(i, added(light.irradiance[i], bounced(i)));
        });
    }

    /// Change of the diffuse light of surfel `i` in that irradiance.
    fn change(&self, i: usize, irradiance: FrontAndBack) -> FrontAndBack {
        let [front, back]: FrontAndBack = std::array::from_fn(|s| {
            std::array::from_fn(|c| irradiance[s][c] / self.divisor[i][s][c].max(LEAST_IRRADIANCE))
        });
        let two_sided = self.settings.terms.two_sided;
        let sides = [front, if two_sided { back } else { front }];
        let emission_share = self.emission_share_of(i);
        sides.map(|side| side.map(|t| t + emission_share * (1.0 - t)))
    }

    /// Share of emission in a surfel's diffuse colour, 0 to 1.
    pub fn emission_share_of(&self, i: usize) -> f32 {
        self.emission_share.get(i).copied().unwrap_or(0.0)
    }

    /// Believes a change only as far as its source, but for what is told of the light; what glows is as it was.
    pub(super) fn trusted(&self, user_gain: [f32; 3], tau: &mut [FrontAndBack]) {
        if self.trust >= 1.0 {
            return;
        }
        let whole = self.undamped(user_gain);
        for (i, sides) in tau.iter_mut().enumerate() {
            let emission_share = self.emission_share_of(i);
            let whole = whole.map(|w| w + (1.0 - w) * emission_share);
            for side in sides {
                *side = std::array::from_fn(|c| whole[c] * side[c].powf(self.trust));
            }
        }
    }

    /// Factor of a change beside its power, so that a light's user-set gain counts in full against the source's.
    pub fn undamped(&self, user_gain: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|c| {
            let told = user_gain[c] / self.user_gain[c].max(f32::MIN_POSITIVE);
            told.min(1e20).powf(1.0 - self.trust)
        })
    }

    /// Diffuse surfels, as they are kept.
    fn diffuse(&self, part: Part) -> DiffuseSurfels<'_> {
        let Terms {
            residual,
            two_sided,
            ..
        } = self.settings.terms;
        DiffuseSurfels {
            asset: &self.asset,
            darkest: &self.darkest,
            residual: &self.residual,
            encoded_mean: &self.encoded_mean,
            with_residual: part == Part::Whole && residual,
            with_backs: two_sided,
        }
    }

    fn relight_surfel(
        &self,
        i: usize,
        (light, part): (&Incident<'_>, Part),
        tau: FrontAndBack,
        radiance: &[Radiance],
        scratch: &mut TransferScratch,
        out: &mut [[f32; 3]],
    ) {
        let asset = &*self.asset;
        scratch.specular.clear();
        if part != Part::Diffuse {
            asset.reflect(i, &self.specular_lobe[i], light, radiance, scratch);
        }
        let diffuse = if part == Part::Specular {
            FrontAndBack::default()
        } else {
            tau
        };
        let two_sided = self.diffuse(part).two_sided(i);
        let has_two_sides = two_sided > 0.0;
        let is_diffuse = self.specular_lobe[i].is_diffuse()
            && scratch.specular.is_empty()
            && part != Part::Specular;
        if is_diffuse
            && self
                .diffuse(part)
                .multiply(i, (tau, two_sided), &mut scratch.read, out)
        {
            if has_two_sides {
                scratch.backs.push(i);
            }
            return;
        }
        let mut read = std::mem::take(&mut scratch.read);
        asset.store(&self.diffuse_of(i, &mut read), diffuse[0], scratch);
        scratch.read = read;
        let (now, then) = (asset.encoded_mean(&scratch.stored), self.encoded_mean[i]);
        let scale: [f32; 3] = std::array::from_fn(|c| residual_scale(now[c], then[c]));
        let frame = SurfelFrame::new(asset.bake.normals[i]);
        asset.nodes.fit_into(&scratch.stored, out);
        if has_two_sides {
            self.add_back(i, diffuse, two_sided, scratch, out);
        }
        frame.apply_sh(asset.nodes.degree, out);
        // What the model misses is of neither part.
        if !self.settings.terms.residual || part != Part::Whole {
            return;
        }
        for (o, r) in out.iter_mut().zip(self.residual.row(i, &mut scratch.read)) {
            for c in 0..3 {
                o[c] += r[c] * scale[c];
            }
        }
    }

    /// Adds the change of a two-sided surfel's colour because its back has a light of its own.
    fn add_back(
        &self,
        i: usize,
        tau: FrontAndBack,
        two_sided: f32,
        scratch: &mut TransferScratch,
        out: &mut [[f32; 3]],
    ) {
        let asset = &*self.asset;
        let (nodes, encoding) = (&asset.nodes, asset.encoding);
        let k = out.len();
        let mut f = asset.sh[i * k..][..k].to_vec();
        SurfelFrame::new(asset.bake.normals[i]).apply_sh(nodes.degree, &mut f);
        let back = within_range(tau);
        let sides = [(&nodes.evaluate, 1.0), (&nodes.evaluate_back, -1.0)];
        for ((evaluate, side), project) in sides.into_iter().zip(&nodes.project) {
            let mut before = nodes.values(evaluate, &f);
            encoding.decode_all(bytemuck::cast_slice_mut(&mut before));
            let after = &mut scratch.stored;
            after.clear();
            after.extend(before.iter().zip(&nodes.to_camera).map(|(v, d)| {
                let share = share_of_back(two_sided, side * d.z);
                std::array::from_fn(|c| v[c] * (tau[0][c] + share * (back[c] - tau[0][c])))
            }));
            for v in &mut before {
                *v = std::array::from_fn(|c| v[c] * tau[0][c]);
            }
            encoding.encode_all(bytemuck::cast_slice_mut(&mut before));
            encoding.encode_all(bytemuck::cast_slice_mut(after));
            for (a, b) in after.iter_mut().zip(before) {
                for c in 0..3 {
                    a[c] -= b[c];
                }
            }
            for (o, p) in out.iter_mut().zip(nodes.function(project, after)) {
                for c in 0..3 {
                    o[c] += p[c];
                }
            }
        }
    }
}

/// Fill of each channel of a light up to the least that explains anything, as a share of its mean.
fn fill_of(light: &LightSamples) -> [f32; 3] {
    let mean = light.mean_irradiance();
    light
        .mean_irradiances()
        .map(|e| (LEAST_CHANNEL - e / mean).max(0.0))
}

#[derive(Default)]
struct TransferScratch {
    rays: Rays,
    /// `[3][Q]`
    values: Vec<f32>,
    specular: Vec<[f32; 3]>,
    stored: Vec<[f32; 3]>,
    /// A row as it is read.
    read: Vec<[f32; 3]>,
    /// Matte surfels that still lack what their backs do.
    backs: Vec<usize>,
    lanes: BackLanes,
}

/// The least of some colours in each channel.
fn darkest(colors: &[[f32; 3]]) -> [f32; 3] {
    let least = |a: [f32; 3], b: &[f32; 3]| std::array::from_fn(|c| a[c].min(b[c]));
    colors.iter().fold([f32::INFINITY; 3], least)
}

fn added(a: FrontAndBack, b: FrontAndBack) -> FrontAndBack {
    std::array::from_fn(|s| std::array::from_fn(|c| a[s][c] + b[s][c]))
}

#[cfg(test)]
mod tests;
