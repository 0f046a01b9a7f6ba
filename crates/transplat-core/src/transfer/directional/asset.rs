//! Cache of a preparation that no light changes, and a light as the transfer takes it in.

use std::sync::Arc;

use glam::{Vec3, Vec3A};
use rayon::prelude::*;

use super::light_visibility::ShadowCache;
use super::neighbors::{Neighbors, asked_one_in};
use super::nodes::{QuadratureNodes, SurfelFrame, weighted_mean};
use crate::bake::directional::DirectionalBake;
use crate::bake::strata::directions;
use crate::bake::trace::places_and_normals;
use crate::color::Encoding;
use crate::color_rows::rows_of;
use crate::environment::{Emitter, LightSample};
use crate::settings::optimizations::{Optimization, Optimizations};
use crate::sh::{SharedSh, coefficient_count, with_degree};
use crate::surfels::SurfelCloud;

/// Vectors as structure of arrays: an axis or a channel after the other. `[3][DIRECTIONS]`
pub(super) type Planes = [Vec<f32>; 3];

pub(super) fn planes(values: impl Iterator<Item = [f32; 3]> + Clone) -> Planes {
    std::array::from_fn(|c| values.clone().map(|v| v[c]).collect())
}

/// A colour of a surfel's front, and one of its back.
pub type FrontAndBack = [[f32; 3]; 2];

/// Radiance of a surfel's front and back: padded, since rays that bounce hit surfels far from each other in memory.
pub type Radiance = [Vec3A; 2];

/// Part of a preparation that no light changes.
#[derive(Debug)]
pub struct DirectionalCache {
    /// Directions that a surfel is seen from, and their matrices.
    pub nodes: QuadratureNodes,
    /// Encoding of the stored colour.
    pub encoding: Encoding,
    /// Visibility of the surfels.
    pub bake: Arc<DirectionalBake>,
    /// Directions of the light, those of the bake.
    pub(super) directions: Vec<Vec3>,
    /// Normals, an axis after the other.
    pub(super) planes: Planes,
    /// Stored colour. `[n][K]`
    pub sh: SharedSh,
    /// Mean linear colour of the front and the back: the exitance under the source light, over pi. `[n]`
    pub means: Vec<FrontAndBack>,
    pub(super) neighbors: Neighbors,
    pub(super) shadow_cache: ShadowCache,
}

/// A light as the transfer takes it in.
#[derive(Clone, Debug, PartialEq)]
pub struct DirectionalLight {
    /// Environment around each of the bake's directions, as samples from where most of it shines. `[DIRECTIONS]`
    pub sky: Vec<LightSample>,
    /// Compact sources, at most [`crate::environment::MAX_SUNS`].
    pub suns: Vec<LightSample>,
    /// Lights at a finite distance or with an extent, in the coordinates of the asset's rays.
    pub emitters: Vec<Emitter>,
    /// Irradiance averaged over all normals, with what fills a channel that the source lacks.
    pub mean: [f32; 3],
    /// User-set gain of the light: [`crate::environment::Illumination::user_gain`].
    pub user_gain: [f32; 3],
    /// Irradiance that is added everywhere: epsilon's share, and that filling.
    pub least: [f32; 3],
}

impl DirectionalCache {
    /// Takes an asset and its bake.
    pub fn new(
        cloud: &SurfelCloud,
        bake: Arc<DirectionalBake>,
        optimizations: &Optimizations,
    ) -> Self {
        // A two-sided surfel may show another colour on either side, and gloss fills bands that the capture left empty.
        let has_two_sides = bake.two_sided.iter().any(|t| *t > 0.0);
        let degree = if optimizations.has(Optimization::EmptyBands)
            && !has_two_sides
            && !cloud.has_view_dependence()
        {
            0
        } else {
            cloud.sh_degree
        };
        let nodes = QuadratureNodes::new(degree);
        let encoding = cloud.encoding;
        let directions = directions();
        let sh = with_degree(cloud.sh.clone(), cloud.sh_degree, degree);
        let k = coefficient_count(degree);
        let means = (sh.par_chunks_exact(k).zip(&bake.normals))
            .map(|(sh, n)| means_of(&nodes, encoding, sh, *n))
            .collect();
        Self {
            neighbors: neighbors_of(&bake, optimizations),
            shadow_cache: ShadowCache::default(),
            nodes,
            encoding,
            bake,
            planes: planes(directions.iter().map(|d| d.to_array())),
            directions,
            sh,
            means,
        }
    }

    /// Part of its surfels without the others, given what they see then.
    pub(super) fn part(&self, bake: Arc<DirectionalBake>, surfels: &[usize]) -> Self {
        let k = coefficient_count(self.nodes.degree);
        Self {
            nodes: self.nodes.clone(),
            encoding: self.encoding,
            directions: self.directions.clone(),
            planes: self.planes.clone(),
            sh: rows_of(&self.sh, k, surfels).into(),
            means: rows_of(&self.means, 1, surfels),
            neighbors: neighbors_of(&bake, &Optimizations::NONE),
            bake,
            shadow_cache: ShadowCache::default(),
        }
    }

    /// Linear colour of surfel `i` at the front's nodes, as captured. `[Q]`
    pub(super) fn colors_of(&self, i: usize) -> Vec<[f32; 3]> {
        let (nodes, k) = (&self.nodes, coefficient_count(self.nodes.degree));
        let mut f = self.sh[i * k..][..k].to_vec();
        SurfelFrame::new(self.bake.normals[i]).apply_sh(nodes.degree, &mut f);
        colors_at(&nodes.evaluate, (nodes, self.encoding), &f)
    }

    /// Radiance of each surfel when its colour under the source changes by tau. `[n]`
    pub(in crate::transfer) fn radiance<'a>(
        &'a self,
        tau: &'a [FrontAndBack],
    ) -> impl IndexedParallelIterator<Item = Radiance> + 'a {
        let each = self.means.par_iter().zip(tau);
        each.map(|(m, t)| [0, 1].map(|s| Vec3A::from(m[s]) * Vec3A::from(t[s])))
    }

    /// Radiance of each surfel as captured. `[n]`
    pub(super) fn captured_radiance(&self) -> Vec<Radiance> {
        self.means.iter().map(|m| m.map(Vec3A::from)).collect()
    }
}

fn neighbors_of(bake: &DirectionalBake, optimizations: &Optimizations) -> Neighbors {
    let points = places_and_normals(&bake.tracer.surfels, &bake.normals);
    let one_in = match optimizations.has(Optimization::SharedLobes) {
        true => asked_one_in(points.len()),
        false => 1,
    };
    Neighbors::new(&points, one_in, &bake.visible_weight)
}

/// Mean linear colour of the front and the back of each surfel, as captured. `[n]`
pub(crate) fn mean_radiance(cloud: &SurfelCloud, normals: &[Vec3]) -> Vec<FrontAndBack> {
    let nodes = QuadratureNodes::new(cloud.sh_degree);
    let k = coefficient_count(cloud.sh_degree);
    let each = cloud.sh.par_chunks_exact(k).zip(normals);
    each.map(|(sh, n)| means_of(&nodes, cloud.encoding, sh, *n))
        .collect()
}

/// Mean linear colour of a surfel's sides, of its stored colour `[K]`.
fn means_of(
    nodes: &QuadratureNodes,
    encoding: Encoding,
    sh: &[[f32; 3]],
    normal: Vec3,
) -> FrontAndBack {
    let mut f = sh.to_vec();
    SurfelFrame::new(normal).apply_sh(nodes.degree, &mut f);
    [&nodes.evaluate, &nodes.evaluate_back]
        .map(|e| weighted_mean(&nodes.weights, &colors_at(e, (nodes, encoding), &f)))
}

/// Linear colour at the nodes of a side, of the stored one in the surfel's frame `[K]`. `[Q]`
fn colors_at(
    side: &[f32],
    (nodes, encoding): (&QuadratureNodes, Encoding),
    f: &[[f32; 3]],
) -> Vec<[f32; 3]> {
    let mut values = nodes.values(side, f);
    encoding.decode_all(bytemuck::cast_slice_mut(&mut values));
    values
}
