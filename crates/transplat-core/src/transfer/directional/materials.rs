//! Materials of surfels, from what explains their colour under the source.

use std::f32::consts::PI;

use rayon::prelude::*;

use super::nodes::weighted_mean;
use super::{DirectionalTransfer, LEAST_IRRADIANCE};
use crate::numeric::weighted_quantile;
use crate::transfer::materials::{Material, Materials};

/// Surfels that an albedo is the median of, and the cosine between their normals and that of the first at least.
const AROUND: usize = 24;
const SAME_WAY: f32 = 0.8;

impl DirectionalTransfer {
    /// The material of each surfel: its matte exitance over what shone on it, and its lobe.
    pub(super) fn materials_of(&self, whitest: Option<f32>) -> Materials {
        let each = (0..self.asset.bake.len()).into_par_iter();
        let each = each.map(|i| self.material(i)).collect();
        let seen = self.asset.bake.visible_weight.iter().copied();
        Materials::of(each, seen, whitest)
    }

    /// Albedo around a surfel, as light and pictures tell it, whatever the trust: the median of the nearest ones that face its way.
    pub fn albedo_around(&self, surfel: usize) -> [f32; 3] {
        let (surfels, normals) = (&self.asset.bake.tracer.surfels, &self.asset.bake.normals);
        let (place, normal) = (surfels[surfel].position, normals[surfel]);
        let apart = |i: usize| surfels[i].position.distance_squared(place);
        let mut near: Vec<usize> = (0..surfels.len())
            .filter(|i| normals[*i].dot(normal) > SAME_WAY && apart(*i).is_finite())
            .collect();
        if near.len() > AROUND {
            near.select_nth_unstable_by(AROUND, |a, b| apart(*a).total_cmp(&apart(*b)));
            near.truncate(AROUND);
        }
        std::array::from_fn(|c| {
            // All of the colour: what of it is gloss depends on the strength that is asked for.
            let albedo = |i: &usize| {
                let divisor = self.divisor[*i][0][c].max(LEAST_IRRADIANCE);
                let albedo = self.asset.means[*i][0][c] * PI * self.light_gain / divisor;
                (f64::from(albedo), 1.0)
            };
            weighted_quantile(near.iter().map(albedo).collect(), 0.5).unwrap_or(0.0) as f32
        })
    }

    /// As light and pictures tell it, albedos of any size.
    fn material(&self, i: usize) -> Material {
        let asset = &*self.asset;
        let front = weighted_mean(&asset.nodes.weights, &self.diffuse_of(i, &mut Vec::new()));
        let back = if self.settings.terms.two_sided {
            asset.bake.two_sided[i]
        } else {
            0.0
        };
        // Under light of radiance 1 from everywhere it would radiate its albedo.
        let albedo: [f32; 3] = std::array::from_fn(|c| {
            let radiance = (front[c] + back * asset.means[i][1][c]) / (1.0 + back);
            let [d0, d1] = self.divisor[i];
            let divisor = ((d0[c] + back * d1[c]) / (1.0 + back)).max(LEAST_IRRADIANCE);
            radiance * (PI * self.light_gain / divisor).powf(self.trust)
        });
        let (specular_lobe, emission_share) = (&self.specular_lobe[i], self.emission_share_of(i));
        let reflectance = specular_lobe.reflectance.map(|k| k * self.light_gain);
        let is_metal = !specular_lobe.is_diffuse() && !specular_lobe.has_fresnel;
        let mirrored = if is_metal { reflectance } else { [0.0; 3] };
        let base = sum(albedo, mirrored);
        let total = |v: [f32; 3]| v.iter().sum::<f32>();
        Material {
            normal: asset.bake.normals[i],
            base_color: base,
            metallic: if is_metal {
                total(mirrored) / total(base).max(1e-12)
            } else {
                0.0
            },
            // GGX's alpha is about the root of one over the lobe's exponent.
            roughness: if specular_lobe.is_diffuse() {
                1.0
            } else {
                ((1u32 << specular_lobe.width) as f32).powf(-0.25)
            },
            reflectance,
            emission_share,
            emission: front.map(|v| emission_share * v),
        }
    }
}

fn sum(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|c| a[c] + b[c])
}
