//! Emission: surfels that are brighter than any light on them explains, from wherever they are seen.

use std::f32::consts::PI;

use rayon::prelude::*;

use super::asset::{DirectionalCache, FrontAndBack};
use super::specular_lobe::SpecularLobe;
use crate::color::{srgb_decode, srgb_encode};
use crate::numeric::{smoothstep, weighted_quantile};
use crate::settings::GLOW_ABOVE;

/// Irradiance counts as at least this share of the source's mean: where hardly any light is known to come, a bright surfel says little.
const LEAST_LIGHT: f32 = 0.25;

/// From this many times on what paint explains a surfel glows wholly.
const CERTAIN: f32 = 1.6;

/// Display-encoded brightness of the brightest channel at which emission begins and is certain. With a lower limit of emission than the usual one
/// less is asked, in proportion.
const BRIGHT: [f32; 2] = [0.75, 0.9];

/// Variation over the views, relative to the mean, at which emission is certain and ends.
const EVEN: [f32; 2] = [0.2, 0.45];

/// Linear colour of white paint in good light, as pictures are exposed: a capture may hold nothing that is white.
const WHITE: f32 = 0.6;

/// Share of what is seen that is lit less well than good light is.
const WELL_LIT: f64 = 0.9;

/// A colour so pure is twice as little that of a paint, which reflects a few hundredths of all light at its surface.
const PURE: [f32; 2] = [0.94, 0.99];

/// Purity from which colours are a lamp's, or as bright beside one, where the capture light is unknown and even light stands in: bright skin and wood
/// in the sun look no less bright.
const LAMPS: [f32; 2] = [0.8, 0.95];

/// Share of its neighbours, by what is seen of them, that glow with it: single ones are noise.
const TOGETHER: [f32; 2] = [0.1, 0.4];

/// Irradiance of what is lit well.
fn well_lit(asset: &DirectionalCache, divisor: &[FrontAndBack]) -> f32 {
    let seen = asset.bake.visible_weight.iter().map(|p| f64::from(*p));
    let light = divisor
        .iter()
        .map(|[front, _]| front.iter().sum::<f32>() / 3.0);
    let light = light
        .map(f64::from)
        .zip(seen)
        .filter(|(e, _)| e.is_finite());
    weighted_quantile(light.collect(), WELL_LIT).map_or(1.0, |e| e.max(1e-6) as f32)
}

/// Share of each surfel's colour that is emission, 0 to 1, `[n]`, or empty where none is: where any channel of its albedo is `above` times the
/// whitest one of the splat, it is bright in the images and even over the views, and its neighbours are so, too. `trust` is the confidence in the
/// light, 0 to 1.
pub(super) fn find_emission(
    asset: &DirectionalCache,
    divisor: &[FrontAndBack],
    specular_lobe: &[SpecularLobe],
    (white, above, trust): (f32, f32, f32),
) -> Vec<f32> {
    let q = asset.nodes.count();
    let white = white.max(PI * WHITE / well_lit(asset, divisor));
    let bright = BRIGHT.map(|v| srgb_encode(srgb_decode(v) * (above / GLOW_ABOVE).min(1.0)));
    let each = asset
        .means
        .par_iter()
        .zip(divisor)
        .zip(specular_lobe)
        .enumerate();
    let alone = each.map(|(i, (([mean, _], [light, _]), specular_lobe))| {
        // What mirrors a lamp is as bright as one.
        if !specular_lobe.is_diffuse() {
            return [0.0; 2];
        }
        let albedo = |c: usize| PI * mean[c] / light[c].max(LEAST_LIGHT);
        let brightest = mean.iter().copied().fold(0f32, f32::max);
        let purity = 1.0 - mean.iter().copied().fold(brightest, f32::min) / brightest.max(1e-6);
        let vivid = 1.0 + smoothstep(PURE[0], PURE[1], purity);
        let most = vivid * (0..3).map(albedo).fold(0f32, f32::max) / white;
        let emits = smoothstep(above, CERTAIN * above, most)
            * smoothstep(bright[0], bright[1], srgb_encode(brightest));
        if emits <= 0.0 {
            return [0.0; 2];
        }
        let sum = |v: &[f32; 3]| v.iter().sum::<f32>();
        let middle = sum(mean);
        let spread = (asset.colors_of(i).iter())
            .map(|v| (sum(v) - middle).powi(2))
            .sum::<f32>()
            / q as f32;
        let variation = spread.sqrt() / middle.max(1e-6);
        let emission_share = emits * (1.0 - smoothstep(EVEN[0], EVEN[1], variation));
        let is_lamp = smoothstep(LAMPS[0], LAMPS[1], purity);
        [
            emission_share,
            emission_share * if trust < 1.0 { is_lamp } else { 1.0 },
        ]
    });
    // Whether it may glow, and whether it speaks of that itself.
    let alone: Vec<[f32; 2]> = alone.collect();
    if alone.iter().all(|[_, g]| *g <= 0.0) {
        return Vec::new();
    }
    let visible_weight = &asset.bake.visible_weight;
    let together = alone.par_iter().enumerate().map(|(i, [own, _])| {
        if *own <= 0.0 {
            return 0.0;
        }
        let weighed = asset.neighbors.of(i).map(|j| {
            let weight = visible_weight[j];
            (alone[j][1] * weight, weight)
        });
        let (emission_share, seen) = weighed.fold((0.0, 0.0), |a, b| (a.0 + b.0, a.1 + b.1));
        own * smoothstep(TOGETHER[0], TOGETHER[1], emission_share / seen.max(1e-12))
    });
    together.collect()
}
