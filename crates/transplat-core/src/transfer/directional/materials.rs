//! Materials of surfels, from what explains their colour under the source.

use std::f32::consts::PI;

use rayon::prelude::*;

use super::nodes::weighted_mean;
use super::{DirectionalTransfer, LEAST_IRRADIANCE};
use crate::transfer::materials::{Material, Materials};

impl DirectionalTransfer {
    /// The material of each surfel: its matte exitance over what shone on it, and its lobe.
    pub(super) fn materials_of(&self, whitest: Option<f32>) -> Materials {
        let each = (0..self.asset.bake.len()).into_par_iter();
        let each = each.map(|i| self.material(i)).collect();
        let seen = self.asset.bake.visible_weight.iter().copied();
        Materials::of(each, seen, whitest)
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
