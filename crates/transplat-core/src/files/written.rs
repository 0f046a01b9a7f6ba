//! A splat in the order and form that writers need: Gaussian by Gaussian.

use std::io::Write;

use glam::{Mat3, Quat, Vec3};
use rayon::prelude::*;

use crate::color::Encoding;
use crate::sh::coefficient_count;
use crate::surfels::{SurfelCloud, UpAxis};
use crate::transfer::materials::Material;

/// Logarithm of the thickness of a surfel among 3D Gaussians: nothing that is drawn is as thin.
const FLAT_LOG: f32 = -30.0;

/// Gaussians that are encoded together.
const BLOCK: usize = 1 << 12;

/// A splat that is to be written.
pub(super) struct WritableSplat<'a> {
    pub cloud: &'a SurfelCloud,
    /// Colour `[n][K][3]` as [`crate::color::Encoding::Stored`] has it.
    pub stored: &'a [[f32; 3]],
    /// Surfels that are written, in this order.
    pub order: Vec<u32>,
    /// Up axis, as far as it is known.
    pub up: Option<UpAxis>,
    /// True where colour is linear all the same.
    pub is_linear: bool,
    /// Materials, `[n]`, where they are written, too.
    pub materials: Option<&'a [Material]>,
    /// Degree of the colour.
    pub degree: usize,
    /// True for 3D Gaussians of which most were trained with their opacity compensated for the low-pass.
    pub is_antialiased: bool,
}

/// A Gaussian that is to be written.
pub(super) struct Gaussian<'a> {
    /// In the coordinates of the file.
    pub position: [f64; 3],
    /// Position relative to the splat's origin.
    pub place: Vec3,
    /// Unit quaternion w, x, y, z.
    pub rotation: [f32; 4],
    /// Unit vector across it, to either side.
    pub normal: [f32; 3],
    /// The last one is along the normal.
    pub log_scales: [f32; 3],
    /// 0 to 1.
    pub opacity: f32,
    /// `[K]`
    pub sh: &'a [[f32; 3]],
    /// Material, where that is known; its normal is then the surface's.
    pub material: Option<&'a Material>,
}

/// Property of a material besides its normal.
pub(super) struct MaterialProperty {
    pub name: &'static str,
    pub width: usize,
    /// Its first `width` values.
    pub of: fn(&Material) -> [f32; 3],
}

/// All of them, as the formats that hold any call them.
pub(super) const MATERIAL: [MaterialProperty; 5] = {
    const fn property(
        name: &'static str,
        width: usize,
        of: fn(&Material) -> [f32; 3],
    ) -> MaterialProperty {
        MaterialProperty { name, width, of }
    }
    [
        property("base_color", 3, |m| m.base_color),
        property("metallic", 1, |m| [m.metallic, 0.0, 0.0]),
        property("roughness", 1, |m| [m.roughness, 0.0, 0.0]),
        property("reflectance", 3, |m| m.reflectance),
        property("emission", 3, |m| m.emission),
    ]
};

impl<'a> WritableSplat<'a> {
    pub fn new(cloud: &'a SurfelCloud, stored: &'a [[f32; 3]], order: Vec<u32>) -> Self {
        let is_antialiased = |i: &&u32| cloud.thicknesses[**i as usize].is_antialiased();
        let antialiased = order.iter().filter(is_antialiased).count();
        Self {
            cloud,
            stored,
            up: Some(cloud.up),
            is_linear: cloud.encoding == Encoding::Linear,
            degree: cloud.sh_degree,
            materials: None,
            is_antialiased: 2 * antialiased > order.len(),
            order,
        }
    }

    pub fn len(&self) -> usize {
        self.order.len()
    }

    /// True where any of it is a 3D Gaussian.
    pub fn has_gaussians(&self) -> bool {
        let mut thicknesses = self
            .order
            .iter()
            .map(|i| self.cloud.thicknesses[*i as usize]);
        thicknesses.any(|t| !t.is_flat())
    }

    /// The one that is written at that place.
    pub fn gaussian(&self, place: usize) -> Gaussian<'a> {
        let (cloud, i) = (self.cloud, self.order[place] as usize);
        let ([u, v], normal) = (cloud.tangents[i], cloud.stored_normal(i));
        let material = self.materials.map(|m| &m[i]);
        let turn = Quat::from_mat3(&Mat3::from_cols(u, v, normal)).normalize();
        let k = coefficient_count(self.degree);
        let scales = cloud.scales[i].extend(cloud.thicknesses[i].sigma());
        Gaussian {
            position: (cloud.origin + cloud.positions[i].as_dvec3()).to_array(),
            place: cloud.positions[i],
            rotation: [turn.w, turn.x, turn.y, turn.z],
            normal: material.map_or(normal, |m| m.normal).to_array(),
            log_scales: scales.to_array().map(|s| s.ln().max(FLAT_LOG)),
            opacity: cloud.opacities[i],
            sh: &self.stored[i * k..][..k],
            material,
        }
    }

    /// Greatest coordinate of any position.
    pub fn farthest(&self) -> f64 {
        let (cloud, order) = (self.cloud, self.order.iter());
        let positions = order.map(|i| cloud.origin + cloud.positions[*i as usize].as_dvec3());
        positions.fold(0f64, |most, p| most.max(p.abs().max_element()))
    }

    /// Writes what is to be said of each, one after the other.
    pub fn write_each(
        &self,
        out: &mut impl Write,
        put: impl Fn(&Gaussian<'_>, &mut Vec<u8>) + Sync,
    ) -> std::io::Result<()> {
        let starts: Vec<usize> = (0..self.len()).step_by(BLOCK).collect();
        let blocks = starts.into_par_iter().map(|start| {
            let mut bytes = Vec::new();
            for place in start..(start + BLOCK).min(self.len()) {
                put(&self.gaussian(place), &mut bytes);
            }
            bytes
        });
        let blocks: Vec<Vec<u8>> = blocks.collect();
        blocks.iter().try_for_each(|bytes| out.write_all(bytes))
    }
}
