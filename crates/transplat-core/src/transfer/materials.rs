//! Materials of a splat for other renderers: albedo, metalness, roughness, emission.

use glam::{Quat, Vec3};

use crate::color::{Encoding, srgb_encode};
use crate::numeric::weighted_quantile;
use crate::sh::SQRT_4PI;

/// The whitest albedo that a captured object has, as its pictures and its light tell it, unless the two are not exposed alike.
pub const PLAUSIBLE_WHITEST: std::ops::RangeInclusive<f32> = 0.1..=0.95;

/// The albedo that the whitest twentieth of an object is taken to have where nothing tells it.
pub const WHITEST_ALBEDO: f64 = 0.65;

/// Share of what is seen whose albedo is below the whitest one, so that a little that is odd does not count.
pub(crate) const WHITEST: f32 = 0.95;

/// Material of a surfel for metallic-roughness shading (Burley 2012): it scatters its base colour where it is no metal, and mirrors that where it is
/// one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Material {
    /// Unit normal of the surface, out of its front.
    pub normal: Vec3,
    /// Linear, 0 to 1; none of what shines by itself.
    pub base_color: [f32; 3],
    /// 0 to 1.
    pub metallic: f32,
    /// 0 to 1, the square root of alpha in GGX; 1 where no gloss shows.
    pub roughness: f32,
    /// Reflectance along the normal, linear, 0 to 1; 0 without a specular lobe.
    pub reflectance: [f32; 3],
    /// Share of its colour that is emission, 0 to 1.
    pub emission_share: f32,
    /// Radiance that is its own, linear, in the unit of the capture's pictures.
    pub emission: [f32; 3],
}

/// The material of each surfel.
#[derive(Clone, Debug)]
pub struct Materials {
    /// `[n]`
    pub each: Vec<Material>,
    /// The whitest albedo as pictures and light tell it: nobody knows how one is exposed against the other.
    pub whitest: f32,
    /// Factor of all albedos and reflectances: the radiance of the even light under which the open surface radiates its albedo.
    pub gain: f32,
}

impl Materials {
    /// Takes materials as pictures and light tell them, albedos of any size, and how much of what is seen each makes up, `[n]`. The whitest albedo
    /// becomes what is wanted, or something plausible where it is not.
    pub(super) fn of(
        mut each: Vec<Material>,
        seen: impl Iterator<Item = f32>,
        wanted: Option<f32>,
    ) -> Self {
        let albedos = each.iter().zip(seen);
        let albedos = albedos
            .filter(|(m, _)| m.emission_share == 0.0)
            .map(|(m, seen)| {
                let albedo = m.base_color.iter().sum::<f32>() / 3.0;
                (f64::from(albedo), f64::from(seen))
            });
        let albedos = albedos.filter(|(albedo, _)| albedo.is_finite()).collect();
        let whitest = weighted_quantile(albedos, f64::from(WHITEST)).unwrap_or(0.0) as f32;
        // All of it black, or its own light: there is nothing to scale.
        let is_explicit = whitest > 1e-6;
        let plausible = || {
            if PLAUSIBLE_WHITEST.contains(&whitest) {
                whitest
            } else {
                WHITEST_ALBEDO as f32
            }
        };
        let gain = if is_explicit {
            wanted.unwrap_or_else(plausible) / whitest
        } else {
            1.0
        };
        for material in &mut each {
            for color in [&mut material.base_color, &mut material.reflectance] {
                *color = color.map(|v| (gain * v).clamp(0.0, 1.0));
            }
            // A lamp has no albedo.
            let lit = 1.0 - material.emission_share;
            material.base_color = material.base_color.map(|v| lit * v);
        }
        Self {
            each,
            whitest,
            gain,
        }
    }

    /// Joins materials of several splats: each as plausible as it is alone, the figures for all being the first one's.
    pub(super) fn together(each: impl Iterator<Item = Self>) -> Self {
        each.reduce(|mut all, one| {
            all.each.extend(one.each);
            all
        })
        .expect("at least one object")
    }

    /// Materials of a rotated splat.
    pub(crate) fn turned(mut self, turn: Quat) -> Self {
        for material in &mut self.each {
            material.normal = turn * material.normal;
        }
        self
    }

    /// Colour of each surfel without light but its own: base colour and emission. Linear. `[n]`
    fn shown(&self) -> impl Iterator<Item = [f32; 3]> {
        let shown =
            |m: &Material| std::array::from_fn(|c| (m.base_color[c] + m.emission[c]).min(1.0));
        self.each.iter().map(shown)
    }

    /// Colours as a splat of degree 0 stores them. `[n]`
    pub fn stored(&self, encoding: Encoding) -> Vec<[f32; 3]> {
        let stored = |v| encoding.encode(v) * SQRT_4PI as f32;
        self.shown().map(|color| color.map(stored)).collect()
    }

    /// Colours for display. `[n]`
    pub fn colors(&self) -> Vec<[f32; 3]> {
        self.shown().map(|color| color.map(srgb_encode)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::srgb_decode;
    use crate::environment::{EnvironmentMap, Illumination};
    use crate::settings::{Method, TransferSettings};
    use crate::synthetic;
    use crate::transfer::{Part, PreparedTransfer};

    /// A ball of one albedo as they look in a light, which is told as so many times as bright.
    fn captured(
        (albedo, exposure): (f32, f32),
        light: &Illumination,
        method: Method,
    ) -> PreparedTransfer {
        let mut settings = TransferSettings::of(method);
        settings.epsilon = Some(1e-4);
        let mut cloud = synthetic::sphere(2000);
        let progress = &crate::progress::no_progress;
        let bake = crate::bake::Bake::new(&cloud, method, 128, progress).expect("a bake");
        // Grey paint in even light is its albedo; the relight makes it a capture in the other light.
        let encoding = cloud.encoding;
        let stored = encoding.encode(albedo) * SQRT_4PI as f32;
        cloud.sh = cloud.positions.iter().map(|_| [stored; 3]).collect();
        cloud.sh_degree = 0;
        settings.terms.shadow = false;
        let even = Illumination::even(settings.sh_degree);
        let first = PreparedTransfer::new(&cloud, &bake, &even, &settings).expect("prepared");
        let lit = first.relight(light, Part::Whole).expect("relit");
        cloud.sh = lit.stored(&cloud).into();
        PreparedTransfer::new(&cloud, &bake, &light.scaled(exposure), &settings).expect("prepared")
    }

    fn sky() -> Illumination {
        let map = EnvironmentMap::of_directions(128, 64, |d| {
            [0.3 + 0.25 * d.z as f32, 0.35, 0.4 - 0.2 * d.x as f32]
        });
        Illumination::of(&map, 3)
    }

    #[test]
    fn one_paint_has_one_albedo_in_any_light() {
        for method in Method::ALL {
            let materials = captured((0.5, 1.0), &sky(), method).materials(None);
            assert_eq!(materials.gain, 1.0, "it is plausible");
            for m in &materials.each {
                for v in m.base_color {
                    // The map is summed in cells, and as a series.
                    assert!((v / 0.5 - 1.0).abs() < 0.01, "{method:?} {m:?}");
                }
                assert_eq!((m.metallic, m.emission_share), (0.0, 0.0));
            }
        }
    }

    #[test]
    fn a_light_of_another_exposure_or_a_known_white_scale_the_albedos() {
        let capture = captured((0.5, 1.0), &sky(), Method::Directional);
        let known = capture.materials(Some(0.9));
        assert!((known.whitest * known.gain - 0.9).abs() < 1e-4);
        // The light is told a hundred times as bright as it was.
        let materials = captured((0.5, 100.0), &sky(), Method::Directional).materials(None);
        assert!(materials.whitest < 0.01);
        let albedo = materials.each[0].base_color[1];
        assert!((albedo - WHITEST_ALBEDO as f32).abs() < 0.1, "{albedo}");
    }

    #[test]
    fn albedos_are_stored_as_a_splat_has_them() {
        let materials = captured((0.25, 1.0), &sky(), Method::Directional).materials(Some(0.25));
        let stored = materials.stored(Encoding::Stored);
        let shown = stored[7][1] / SQRT_4PI as f32 + Encoding::Stored.offset();
        assert!((srgb_decode(shown) - materials.each[7].base_color[1]).abs() < 1e-4);
        assert!((materials.colors()[7][1] - shown).abs() < 1e-4);
    }
}
