//! Splat in memory: Gaussians, flat or not, with view-dependent colour.

use std::sync::Arc;

use glam::{Affine3A, DMat3, DVec3, Mat3, Vec2, Vec3};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::color::{Encoding, decode_sh};
use crate::error::{Result, ensure};
use crate::numeric::{quantile, weighted_quantile};
use crate::settings::optimizations::{Optimization, Optimizations};
use crate::sh::{SharedSh, band, coefficient_count, rotate_functions, with_degree};

/// Contributions below this are not drawn.
pub const MIN_ALPHA: f32 = 1.0 / 255.0;

/// Extent of a Gaussian along its normal, which decides how it is drawn.
///
/// In one number, as it crosses to the GPU: 0 is a 2D surfel, anything else the standard deviation of a 3D Gaussian in scene units,
/// below 0 where its trainer compensated the opacity for the low-pass.
#[derive(Clone, Copy, Debug, Default, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
#[repr(transparent)]
pub struct Thickness(f32);

impl Thickness {
    /// Thickness of a 2D surfel.
    pub const FLAT: Self = Self(0.0);

    /// Thickness of a 3D Gaussian, however thin.
    pub fn of_gaussian(sigma: f32, is_antialiased: bool) -> Self {
        let sigma = sigma.max(f32::MIN_POSITIVE);
        Self(if is_antialiased { -sigma } else { sigma })
    }

    /// True for a 2D surfel.
    pub fn is_flat(self) -> bool {
        self.0 == 0.0
    }

    /// True for a 3D Gaussian that is drawn fainter where the low-pass widens it (Yu et al., "Mip-Splatting", 2024).
    pub fn is_antialiased(self) -> bool {
        self.0 < 0.0
    }

    /// Standard deviation along the normal, in scene units; 0 for a surfel.
    pub fn sigma(self) -> f32 {
        self.0.abs()
    }

    /// The number that it is to the GPU.
    pub fn signed(self) -> f32 {
        self.0
    }

    fn scaled(self, factor: f32) -> Self {
        if self.is_flat() {
            return self;
        }
        Self::of_gaussian(factor * self.sigma(), self.is_antialiased())
    }
}

/// A trained splat, structure of arrays: every vector has one entry a Gaussian, except `sh`. What is not flat is taken by all but the
/// rasterizer for the surfel across its shortest axis.
#[derive(Clone, Debug)]
pub struct SurfelCloud {
    /// Centres, in scene units.
    pub positions: Vec<Vec3>,
    /// Unit vectors along the two axes of each surfel; their cross product is the normal, of unknown sign.
    pub tangents: Vec<[Vec3; 2]>,
    /// Standard deviations along the tangents, in scene units.
    pub scales: Vec<Vec2>,
    /// Extents along the normal. `[n]`
    pub thicknesses: Vec<Thickness>,
    /// Peak opacity, 0 to 1.
    pub opacities: Vec<f32>,
    /// Colour `[n][K][3]` as [`SurfelCloud::encoding`] says.
    pub sh: SharedSh,
    /// Degree of `sh`.
    pub sh_degree: usize,
    /// Encoding of `sh`.
    pub encoding: Encoding,
    /// Direction that is up in the asset's own coordinates.
    pub up: UpAxis,
    /// Places that see the outside of it, where somebody told: what they see of a surfel is its front.
    pub outside_from: Vec<Vec3>,
    /// Origin of the positions in the coordinates of the file: zero but for a splat far from their origin (georeferenced, UTM), so that positions fit
    /// 32-bit floats.
    pub origin: DVec3,
}

impl SurfelCloud {
    /// Number of surfels.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// True without any surfel.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// Normal as stored: third axis of the surfel's frame, pointing to either side.
    pub fn stored_normal(&self, i: usize) -> Vec3 {
        let [u, v] = self.tangents[i];
        u.cross(v)
    }

    /// Colour coefficients of one surfel, `[K][3]`.
    pub fn sh_of(&self, i: usize) -> &[[f32; 3]] {
        let k = coefficient_count(self.sh_degree);
        &self.sh[i * k..][..k]
    }

    /// Adds another cloud of the same degree and encoding, scaled and then moved.
    pub fn add(&mut self, other: &Self, scale: f32, offset: Vec3) {
        let places = other.positions.iter().map(|p| scale * *p + offset);
        self.positions.extend(places);
        self.tangents.extend(&other.tangents);
        self.scales.extend(other.scales.iter().map(|s| scale * *s));
        let thicknesses = other.thicknesses.iter().map(|t| t.scaled(scale));
        self.thicknesses.extend(thicknesses);
        self.opacities.extend(&other.opacities);
        self.sh.extend(&other.sh);
    }

    /// The cloud elsewhere: scaled by one factor, turned with its colour, and moved. Which axis is up is said as before: an object stands in
    /// the scene of another.
    pub fn transformed(&self, there_from_here: Affine3A) -> Self {
        let (scale, turn, _) = there_from_here.to_scale_rotation_translation();
        let (scale, turn_of_colors) = (scale.x, DMat3::from_quat(turn.as_dquat()));
        let place = |p: &Vec3| there_from_here.transform_point3(*p);
        Self {
            positions: self.positions.iter().map(place).collect(),
            tangents: (self.tangents.iter())
                .map(|t| t.map(|t| turn * t))
                .collect(),
            scales: self.scales.iter().map(|s| scale * *s).collect(),
            thicknesses: self.thicknesses.iter().map(|t| t.scaled(scale)).collect(),
            opacities: self.opacities.clone(),
            sh: rotate_functions(turn_of_colors, self.sh_degree, &self.sh).into(),
            sh_degree: self.sh_degree,
            encoding: self.encoding,
            up: self.up,
            outside_from: self.outside_from.iter().map(place).collect(),
            origin: self.origin,
        }
    }

    /// The cloud under any linear map and a move: a Gaussian stays one. Its colour is turned, and mirrored, by the orthogonal part of the map.
    ///
    /// Nothing where the map flattens space.
    pub fn mapped(&self, there_from_here: Affine3A) -> Option<Self> {
        let linear = Mat3::from(there_from_here.matrix3).as_dmat3();
        let turn = orthogonal_part(linear)?;
        let is_mirrored = turn.determinant() < 0.0;
        let mut sh: Vec<[f32; 3]> = self.sh.to_vec();
        if is_mirrored {
            // A point reflection, of which odd bands change their sign, and a rotation.
            let k = coefficient_count(self.sh_degree);
            for l in (1..=self.sh_degree).step_by(2) {
                for f in sh.chunks_exact_mut(k).flat_map(|row| &mut row[band(l)]) {
                    *f = f.map(|v| -v);
                }
            }
        }
        let rotation = if is_mirrored { -turn } else { turn };
        let place = |p: &Vec3| there_from_here.transform_point3(*p);
        let each = (0..self.len()).into_par_iter().map(|i| {
            let ([u, v], scale) = (self.tangents[i], self.scales[i]);
            let thickness = self.thicknesses[i];
            let axes = [(u, scale.x), (v, scale.y), (u.cross(v), thickness.sigma())];
            let shape = DMat3::from_cols_array_2d(
                &axes.map(|(axis, sigma)| (linear * (axis * sigma).as_dvec3()).to_array()),
            );
            // Its principal axes; that of a surfel that is flat is last, since nothing is shorter.
            let [(u, a), (v, b), (_, c)] = principal_axes(shape);
            let thickness = match thickness.is_flat() {
                true => thickness,
                false => Thickness::of_gaussian(c, thickness.is_antialiased()),
            };
            ([u, v], Vec2::new(a, b), thickness)
        });
        let each: Vec<([Vec3; 2], Vec2, Thickness)> = each.collect();
        Some(Self {
            positions: self.positions.iter().map(place).collect(),
            tangents: each.iter().map(|(tangents, ..)| *tangents).collect(),
            scales: each.iter().map(|(_, scale, _)| *scale).collect(),
            thicknesses: each.iter().map(|(.., thickness)| *thickness).collect(),
            opacities: self.opacities.clone(),
            sh: rotate_functions(rotation, self.sh_degree, &sh).into(),
            outside_from: self.outside_from.iter().map(place).collect(),
            ..*self
        })
    }

    /// Objects where they stand as one cloud, in the coordinates that they are placed in and with the up axis of the first. Colour is stored
    /// as they all store it, or else linear.
    ///
    /// # Panics
    /// There is no object.
    pub fn composed(objects: &[(&Self, Affine3A)]) -> Self {
        let mut placed: Vec<Self> = (objects.iter())
            .map(|(cloud, place)| {
                if *place == Affine3A::IDENTITY {
                    (*cloud).clone()
                } else {
                    cloud.transformed(*place)
                }
            })
            .collect();
        if placed.iter().any(|c| c.encoding != placed[0].encoding) {
            for cloud in &mut placed {
                cloud.sh = decode_sh(&cloud.sh, cloud.sh_degree, cloud.encoding).into();
                cloud.encoding = Encoding::Linear;
            }
        }
        let degree = placed.iter().map(|c| c.sh_degree).max().unwrap_or_default();
        let with_degree = |cloud: &mut Self| {
            cloud.sh = with_degree(std::mem::take(&mut cloud.sh), cloud.sh_degree, degree);
            cloud.sh_degree = degree;
        };
        placed.iter_mut().for_each(with_degree);
        let together = |mut all: Self, cloud: Self| {
            all.add(&cloud, 1.0, Vec3::ZERO);
            all.outside_from.extend(cloud.outside_from);
            all
        };
        let all = placed.into_iter().reduce(together);
        all.expect("at least one object")
    }

    /// Joins any number of objects; one where it was captured stays itself.
    pub fn whole(objects: &[(Arc<Self>, Affine3A)]) -> Option<Arc<Self>> {
        match objects {
            [] => None,
            [(one, place)] if *place == Affine3A::IDENTITY => Some(one.clone()),
            several => {
                let each: Vec<_> = several.iter().map(|(c, place)| (&**c, *place)).collect();
                Some(Arc::new(Self::composed(&each)))
            }
        }
    }

    /// At most `count` surfels of it, taken evenly from their order and so much larger that they cover as much.
    pub fn thinned(&self, count: usize) -> Self {
        let n = self.len();
        let taken: Vec<usize> = (0..count.min(n)).map(|i| i * n / count.min(n)).collect();
        let larger = (n as f32 / taken.len().max(1) as f32).sqrt();
        let mut thinned = self.selected(&taken);
        for (scale, thickness) in thinned.scales.iter_mut().zip(&mut thinned.thicknesses) {
            *scale *= larger;
            *thickness = thickness.scaled(larger);
        }
        thinned
    }

    /// Selects some of its surfels, as they are.
    pub fn selected(&self, taken: &[usize]) -> Self {
        Self {
            positions: taken.iter().map(|i| self.positions[*i]).collect(),
            tangents: taken.iter().map(|i| self.tangents[*i]).collect(),
            scales: taken.iter().map(|i| self.scales[*i]).collect(),
            thicknesses: taken.iter().map(|i| self.thicknesses[*i]).collect(),
            opacities: taken.iter().map(|i| self.opacities[*i]).collect(),
            sh: taken.iter().flat_map(|i| self.sh_of(*i)).copied().collect(),
            sh_degree: self.sh_degree,
            encoding: self.encoding,
            up: self.up,
            outside_from: self.outside_from.clone(),
            origin: self.origin,
        }
    }

    /// Takes the surfels in another order, each once.
    pub(crate) fn rearrange(&mut self, order: &[u32]) {
        fn taken<T: Copy + Send + Sync>(all: &[T], order: &[u32]) -> Vec<T> {
            order.par_iter().map(|i| all[*i as usize]).collect()
        }
        self.positions = taken(&self.positions, order);
        self.tangents = taken(&self.tangents, order);
        self.scales = taken(&self.scales, order);
        self.thicknesses = taken(&self.thicknesses, order);
        self.opacities = taken(&self.opacities, order);
        let k = coefficient_count(self.sh_degree);
        let mut sh: Vec<[f32; 3]> = bytemuck::zeroed_vec(self.sh.len());
        let rows = sh.par_chunks_exact_mut(k).zip(order);
        rows.for_each(|(row, i)| row.copy_from_slice(&self.sh[*i as usize * k..][..k]));
        self.sh = sh.into();
    }

    /// True where colour depends on the view.
    pub fn has_view_dependence(&self) -> bool {
        self.filled_degree() > 0
    }

    /// The highest SH band in which any surfel holds anything.
    pub fn filled_degree(&self) -> usize {
        let k = coefficient_count(self.sh_degree);
        let holds = |l: &usize| {
            let mut bands = self.sh.chunks_exact(k).map(|f| &f[band(*l)]);
            bands.any(|b| b.iter().flatten().any(|v| *v != 0.0))
        };
        (1..=self.sh_degree).rev().find(holds).unwrap_or(0)
    }

    /// Median of the larger standard deviations of all that is drawn at all; none of none.
    pub fn median_size(&self) -> Option<f32> {
        let drawn = self
            .scales
            .iter()
            .zip(&self.opacities)
            .filter(|(_, o)| **o > 0.0);
        quantile(drawn.map(|(s, _)| s.max_element()).collect(), 0.5)
    }

    /// Where the object is, robust against floaters far away; surfels that are never drawn do not count.
    ///
    /// Most are counted as one each. Where that leaves it more than half larger than what is seen of it, by opacity and area, the latter
    /// counts: a few faint surfels may lie anywhere.
    pub fn bounds(&self) -> Bounds {
        let drawn = || (0..self.len()).filter(|i| self.opacities[*i] > 0.0);
        let seen: Vec<Vec3> = drawn().map(|i| self.positions[i]).collect();
        let counted = Bounds::of(&seen);
        // Half of it lies much nearer where something floats far away, and seldom otherwise.
        let distances = seen.iter().map(|p| p.distance(counted.center)).collect();
        let middle = quantile(distances, 0.5).unwrap_or(0.0);
        if counted.radius <= FAR_OUT * middle {
            return counted;
        }
        let largest = MOST_SEEN * self.median_size().unwrap_or(0.0);
        let weight = |i: usize| {
            let area = self.scales[i].min(Vec2::splat(largest)).element_product();
            f64::from(self.opacities[i] * area)
        };
        let step = self.len().div_ceil(MOST_WEIGHED).max(1);
        let some: Vec<usize> = drawn().step_by(step).collect();
        let places: Vec<Vec3> = some.iter().map(|i| self.positions[*i]).collect();
        let weights: Vec<f64> = some.into_iter().map(weight).collect();
        match Bounds::of_visible(&places, &weights) {
            Some(visible) if counted.radius > 1.5 * visible.radius => visible,
            _ => counted,
        }
    }
}

/// A radius of more than so many times the median distance from the middle may be one of floaters.
const FAR_OUT: f32 = 2.5;

/// Surfels that are weighed, at most.
const MOST_WEIGHED: usize = 1 << 16;

/// A surfel counts as so many times as large as the median at most.
const MOST_SEEN: f32 = 8.0;

/// The orthogonal matrix that is nearest to a linear map, by Newton's iteration (Higham 1986); none of a map that flattens space.
fn orthogonal_part(map: DMat3) -> Option<DMat3> {
    let size = map.x_axis.length() * map.y_axis.length() * map.z_axis.length();
    if !(map.is_finite() && map.determinant().abs() > 1e-9 * size && size > 0.0) {
        return None;
    }
    let mut turn = map;
    for _ in 0..100 {
        let next = 0.5 * (turn + turn.inverse().transpose());
        let is_done = (next - turn)
            .to_cols_array()
            .iter()
            .all(|v| v.abs() < 1e-14);
        turn = next;
        if is_done {
            break;
        }
    }
    turn.is_finite().then_some(turn)
}

/// The principal axes of a Gaussian that is a unit one under a linear map, with its standard deviations, the largest first; right-handed.
fn principal_axes(shape: DMat3) -> [(Vec3, f32); 3] {
    let columns = shape.to_cols_array();
    let decomposed = nalgebra::Matrix3::from_column_slice(&columns).svd_unordered(true, false);
    let axes = decomposed.u.unwrap_or_else(nalgebra::Matrix3::identity);
    let mut order = [0, 1, 2];
    let sigma = decomposed.singular_values;
    order.sort_by(|a, b| sigma[*b].total_cmp(&sigma[*a]));
    let axis = |i: usize| DVec3::new(axes[(0, i)], axes[(1, i)], axes[(2, i)]);
    let (u, v) = (axis(order[0]), axis(order[1]));
    let each = [u, v, u.cross(v)];
    std::array::from_fn(|i| (each[i].as_vec3(), sigma[order[i]] as f32))
}

/// True for an opacity too faint to be drawn.
pub fn is_faint(opacity: f32) -> bool {
    opacity <= MIN_ALPHA
}

/// Filters of surfels that are not drawn, such as floaters and surroundings. Nothing is edited, and what is hidden still casts its shadow.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SurfelFilter {
    /// True to hide everything outside of the box.
    pub crop: bool,
    /// Least corner of the box, in the object's radius around its centre.
    pub crop_min: Vec3,
    /// Greatest corner of the box.
    pub crop_max: Vec3,
    /// Surfels fainter than this are hidden.
    pub min_opacity: f32,
    /// Surfels with a standard deviation above this are hidden, in the object's radius; 1 hides none.
    pub max_size: f32,
}

impl Default for SurfelFilter {
    fn default() -> Self {
        Self {
            crop: false,
            crop_min: Vec3::splat(-1.0),
            crop_max: Vec3::splat(1.0),
            min_opacity: 0.0,
            max_size: 1.0,
        }
    }
}

impl SurfelFilter {
    /// True where it hides nothing, whatever the splat.
    pub fn is_off(&self) -> bool {
        !self.crop && self.min_opacity <= 0.0 && self.max_size >= 1.0
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// A value is no number or out of range.
    pub fn validate(&self) -> Result<()> {
        let good = self.crop_min.is_finite()
            && self.crop_max.is_finite()
            && (0.0..=1.0).contains(&self.min_opacity)
            && (0.0..=1.0).contains(&self.max_size);
        ensure(good, || {
            "what is hidden is out of range (min_opacity and max_size 0 to 1, crop corners numbers)"
                .into()
        })
    }

    /// Surfels that nobody sees, `[n]` or empty: hidden ones, and those too faint for any pixel.
    pub fn unseen(
        &self,
        cloud: &SurfelCloud,
        bounds: &Bounds,
        optimizations: &Optimizations,
    ) -> Vec<bool> {
        let mut unseen = if self.is_off() {
            Vec::new()
        } else {
            self.hidden(cloud, bounds)
        };
        if optimizations.has(Optimization::Unseen) && cloud.opacities.iter().any(|o| is_faint(*o)) {
            unseen.resize(cloud.len(), false);
            for (unseen, opacity) in unseen.iter_mut().zip(&cloud.opacities) {
                *unseen |= is_faint(*opacity);
            }
        }
        unseen
    }

    /// Surfels that are hidden, `[n]`.
    pub fn hidden(&self, cloud: &SurfelCloud, bounds: &Bounds) -> Vec<bool> {
        (0..cloud.len())
            .map(|i| {
                let p = (cloud.positions[i] - bounds.center) / bounds.radius;
                let outside = self.crop && (p.cmplt(self.crop_min) | p.cmpgt(self.crop_max)).any();
                let faint = cloud.opacities[i] < self.min_opacity;
                let large = self.max_size < 1.0
                    && cloud.scales[i].max_element() > self.max_size * bounds.radius;
                outside || faint || large
            })
            .collect()
    }
}

/// A sphere around the object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Centre.
    pub center: Vec3,
    /// Radius in scene units; positive.
    pub radius: f32,
}

impl Bounds {
    /// Around several.
    pub fn around(all: impl Iterator<Item = Self> + Clone) -> Option<Self> {
        let ends = |b: Self| (b.center - b.radius, b.center + b.radius);
        let corners = all.clone().map(ends);
        let (low, high) = corners.reduce(|(a, b), (c, d)| (a.min(c), b.max(d)))?;
        let center = low.midpoint(high);
        let reach = |b: Self| b.center.distance(center) + b.radius;
        let radius = all.map(reach).fold(0.0, f32::max);
        Some(Self { center, radius })
    }

    /// Bounds in other coordinates: scaled by one factor, rotated, moved.
    pub fn transformed(&self, there_from_here: Affine3A) -> Self {
        let (scale, ..) = there_from_here.to_scale_rotation_translation();
        Self {
            center: there_from_here.transform_point3(self.center),
            radius: scale.x * self.radius,
        }
    }

    /// Around the points that carry all but a hundredth of the weight, and others within one and a half times as far; none where there is no
    /// weight.
    fn of_visible(points: &[Vec3], weights: &[f64]) -> Option<Self> {
        let quantile = |values: &mut dyn Iterator<Item = f32>, share: f64| {
            let pairs = values.zip(weights).map(|(v, w)| (f64::from(v), *w));
            weighted_quantile(pairs.collect(), share).map(|v| v as f32)
        };
        if !weights.iter().any(|w| *w > 0.0) {
            return None;
        }
        let along = |axis: usize| {
            let low = quantile(&mut points.iter().map(|p| p[axis]), 0.005)?;
            let high = quantile(&mut points.iter().map(|p| p[axis]), 0.995)?;
            Some(low / 2.0 + high / 2.0)
        };
        let center = Vec3::new(along(0)?, along(1)?, along(2)?);
        let distances = || points.iter().map(|p| p.distance(center));
        let most = quantile(&mut distances(), 0.99)?;
        let radius = distances().filter(|d| *d <= 1.5 * most).fold(0.0, f32::max);
        (radius > 0.0).then_some(Self { center, radius })
    }

    /// Middle of the box that leaves out 0.5 % of the points at either end of each axis, and the radius that holds
    /// 99.5 % of the points around it; all of them, unless the rest is far away.
    pub(crate) fn of(points: &[Vec3]) -> Self {
        if points.is_empty() {
            return Self {
                center: Vec3::ZERO,
                radius: 1.0,
            };
        }
        let last = points.len() - 1;
        let tail = points.len() / 200;
        let mut values: Vec<f32> = Vec::with_capacity(points.len());
        let center = Vec3::from_array(std::array::from_fn(|axis| {
            values.clear();
            values.extend(points.iter().map(|p| p[axis]));
            let low = *values.select_nth_unstable_by(tail, f32::total_cmp).1;
            let high = *values.select_nth_unstable_by(last - tail, f32::total_cmp).1;
            low / 2.0 + high / 2.0
        }));
        values.clear();
        values.extend(points.iter().map(|p| p.distance(center)));
        let most = *values.select_nth_unstable_by(last - tail, f32::total_cmp).1;
        let all = values.iter().copied().fold(0f32, f32::max);
        let radius = if all <= 1.5 * most { all } else { most };
        Self {
            center,
            radius: if radius > 0.0 { radius } else { 1.0 },
        }
    }
}

/// An axis that points up, with its sign.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum UpAxis {
    /// +X
    #[serde(rename = "+x")]
    PlusX,
    /// -X
    #[serde(rename = "-x")]
    MinusX,
    /// +Y
    #[serde(rename = "+y")]
    PlusY,
    /// -Y
    #[serde(rename = "-y")]
    MinusY,
    /// +Z, the world's own up axis.
    #[default]
    #[serde(rename = "+z")]
    PlusZ,
    /// -Z
    #[serde(rename = "-z")]
    MinusZ,
}

impl UpAxis {
    /// All six, with their names.
    pub const ALL: [(&'static str, Self); 6] = [
        ("+x", Self::PlusX),
        ("-x", Self::MinusX),
        ("+y", Self::PlusY),
        ("-y", Self::MinusY),
        ("+z", Self::PlusZ),
        ("-z", Self::MinusZ),
    ];

    /// `+x`, `-y` and so on.
    pub fn name(self) -> &'static str {
        Self::ALL
            .iter()
            .find(|(_, axis)| *axis == self)
            .map_or("+z", |(name, _)| name)
    }

    /// The unit vector in the asset's coordinates.
    pub fn direction(self) -> Vec3 {
        match self {
            Self::PlusX => Vec3::X,
            Self::MinusX => Vec3::NEG_X,
            Self::PlusY => Vec3::Y,
            Self::MinusY => Vec3::NEG_Y,
            Self::PlusZ => Vec3::Z,
            Self::MinusZ => Vec3::NEG_Z,
        }
    }

    /// The rotation that brings the Z-up world of the lights into the asset's coordinates.
    ///
    /// Turning the light with it is turning the asset against it, and leaves every number of the asset alone.
    pub fn asset_from_world(self) -> DMat3 {
        let up = self.direction().as_dvec3();
        if up.z < -0.5 {
            return DMat3::from_rotation_x(std::f64::consts::PI);
        }
        DMat3::from_quat(glam::DQuat::from_rotation_arc(DVec3::Z, up))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn floaters_do_not_grow_the_bounds() {
        let mut points = crate::sh::lattice(1000);
        let clean = Bounds::of(&points);
        assert!((clean.radius - 1.0).abs() < 0.02 && clean.center.length() < 0.02);
        points[17] = Vec3::splat(1e6);
        let rough = Bounds::of(&points);
        assert!((rough.radius - 1.0).abs() < 0.05, "{rough:?}");
    }

    #[test]
    fn faint_floaters_do_not_grow_the_bounds_however_many() {
        let mut cloud = crate::synthetic::sphere(1000);
        let clean = cloud.bounds();
        for (i, p) in crate::sh::lattice(40).into_iter().enumerate() {
            cloud.positions[i * 25] = (30.0 + 20.0 * i as f32) * p;
            cloud.opacities[i * 25] = 0.05;
        }
        let found = cloud.bounds();
        assert!(
            (found.radius / clean.radius - 1.0).abs() < 0.05,
            "{found:?}"
        );
        assert!(found.center.length() < 0.05, "{found:?}");
    }

    /// Densities of a mapped Gaussian are those of the Gaussian at the places that the map takes there.
    #[test]
    fn a_gaussian_under_a_linear_map_is_one() {
        let mut cloud = crate::synthetic::sphere(20);
        cloud.thicknesses.fill(Thickness::of_gaussian(0.02, false));
        let shear = Mat3::from_cols(Vec3::new(-1.3, 0.2, 0.0), Vec3::new(0.4, 0.9, 0.0), Vec3::Z);
        let map = Affine3A::from_mat3_translation(shear, Vec3::new(1.0, 2.0, 3.0));
        let mapped = cloud.mapped(map).expect("no flat map");
        let squared = |c: &SurfelCloud, i: usize, at: Vec3| {
            let ([u, v], d) = (c.tangents[i], at - c.positions[i]);
            let along = Vec3::new(d.dot(u), d.dot(v), d.dot(u.cross(v)));
            let sigma = c.scales[i].extend(c.thicknesses[i].sigma());
            (along / sigma).length_squared()
        };
        for i in 0..cloud.len() {
            for off in [Vec3::X, Vec3::Y, Vec3::new(0.3, -0.2, 0.9)] {
                let at = cloud.positions[i] + 0.01 * off;
                let (here, there) = (
                    squared(&cloud, i, at),
                    squared(&mapped, i, map.transform_point3(at)),
                );
                assert!((here - there).abs() < 1e-2 * (1.0 + here), "{here} {there}");
            }
        }
        assert!(
            cloud
                .mapped(Affine3A::from_scale(Vec3::new(1.0, 0.0, 1.0)))
                .is_none()
        );
    }

    #[test]
    fn up_goes_up() {
        for (name, axis) in UpAxis::ALL {
            let turn = axis.asset_from_world();
            let up = (turn * DVec3::Z).as_vec3();
            assert!(up.distance(axis.direction()) < 1e-6, "{name}");
            assert!((turn.determinant() - 1.0).abs() < 1e-12);
            assert_eq!(axis.name(), name);
        }
    }
}
