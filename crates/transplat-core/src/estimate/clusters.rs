//! Clusters of surfels that lie together and face one way: single surfels are too noisy.

use std::collections::HashMap;
use std::f64::consts::PI;

use bytemuck::Zeroable;
use glam::Vec3;
use rayon::prelude::*;

use super::sky::nearest_direction;
use crate::bake::directional::DirectionalBake;
use crate::bake::strata::{DIRECTIONS, STRATA, directions};
use crate::nearest::Nearest;
use crate::numeric::weighted_quantile;
use crate::surfels::{MIN_ALPHA, SurfelCloud};
use crate::transfer::directional::FrontAndBack;

/// Surfels of a cluster at least, where it is not the only one.
const FEWEST: usize = 4;

/// Clusters that are needed to show any light.
pub(super) const FEWEST_CLUSTERS: usize = 8;

/// Neighbours that a cluster is compared with.
pub(super) const NEIGHBORS: usize = 24;

/// Surfels a cell on average, where there are not too many clusters.
const PER_CLUSTER: usize = 10;

/// Clusters at most: more cost time and tell nothing new.
const MOST: usize = 4000;

/// Surfels that see less of the light than this share hardly tell of it.
const LEAST_OPENNESS: f32 = 0.02;

/// Difference in chroma at which two clusters are probably not of the same stuff.
const CHROMA: f64 = 0.06;

/// A channel below this share of [`Clusters::bright`] is too dark to be compared.
const DARK: f64 = 0.01;

/// Share of the object that is darker than what counts as bright. Not the mean: a floater may be brighter than all the rest together. Nor
/// of all of it: most may be a black backdrop, which is what lies below that share of the brightest twentieth.
const BRIGHT: f64 = 0.8;
const BRIGHTEST: f64 = 0.95;
const BLACK: f64 = 1e-3;

/// Edges of the cells at which the search begins and ends, and how many it tries.
const FIRST_EDGE: f32 = 0.1;
const FINEST: f32 = 1e-4;
const COARSEST: f32 = 4.0;
const TRIES: usize = 8;

/// Surfels of a cluster that are asked whether they see a sun: all of them, where there are not very many. (Of twelve it was chance which, and
/// the sun of one capture came out anywhere between 0.5 and 1.3 by the order of its surfels.)
const SAMPLES: usize = 48;

/// No cluster.
pub(super) const NONE: u32 = u32::MAX;

/// Means over each cluster. `[c]`
pub(super) struct Clusters {
    /// Radiance, the mean over the view.
    pub radiance: Vec<[f64; 3]>,
    /// Irradiance that radiance 1 from around each of the bake's directions makes. `[c][DIRECTIONS]`
    pub seen: Vec<f32>,
    /// Irradiance from the surfels that block the light.
    pub bounced: Vec<[f64; 3]>,
    pub normals: Vec<Vec3>,
    /// Share of all area, weighted by opacity.
    pub mass: Vec<f64>,
    /// Cluster of each surfel, or [`NONE`]. `[n]`
    pub of: Vec<u32>,
    /// Share of each surfel in those of its cluster that are tested for seeing a sun. `[n]`
    pub share: Vec<f32>,
    positions: Vec<[f32; 3]>,
    /// Share of all that is seen and lit from both sides, as leaves are.
    pub two_sided: f64,
}

/// Two clusters that may be of the same stuff.
#[derive(Clone, Copy)]
pub(super) struct Pair {
    pub of: [u32; 2],
    /// Weight by channel.
    pub weight: [f64; 3],
}

impl Clusters {
    /// Number of clusters.
    pub fn len(&self) -> usize {
        self.mass.len()
    }

    /// Irradiance of each cluster by a sun of energy 1 at the bake's direction nearest to some. `[c]`
    pub fn seen_towards(&self, direction: Vec3) -> Vec<f64> {
        let j = nearest_direction(&directions(), direction);
        let per_energy = DIRECTIONS as f64 / (4.0 * PI);
        let rows = self.seen.chunks_exact(DIRECTIONS);
        rows.map(|row| per_energy * f64::from(row[j])).collect()
    }

    /// `radiance`: mean colour of both sides, `[n]`.
    pub fn new(cloud: &SurfelCloud, bake: &DirectionalBake, radiance: &[FrontAndBack]) -> Self {
        let directions = directions();
        let (surfels, openness) = (&bake.tracer.surfels, bake.openness());
        let seen: Vec<Option<Seen>> = (0..cloud.len())
            .into_par_iter()
            .map(|i| {
                let area = cloud.scales[i].element_product();
                let weight = f64::from(cloud.opacities[i] * area);
                let is_sound = surfels[i].position.is_finite()
                    && bake.normals[i].is_finite()
                    && radiance[i][0].iter().all(|v| v.is_finite())
                    && weight.is_finite()
                    && cloud.opacities[i] > MIN_ALPHA
                    && weight > 0.0;
                let seen = is_sound.then(|| Seen {
                    position: surfels[i].position,
                    normal: bake.normals[i],
                    weight,
                });
                seen.filter(|_| openness[i] > LEAST_OPENNESS)
            })
            .collect();
        let (of, count) = assign(&seen);
        let mut clusters = Self {
            radiance: vec![[0.0; 3]; count],
            seen: vec![0.0; count * DIRECTIONS],
            bounced: vec![[0.0; 3]; count],
            normals: vec![Vec3::zeroed(); count],
            mass: vec![0.0; count],
            share: vec![0.0; of.len()],
            of,
            positions: Vec::new(),
            two_sided: 0.0,
        };
        for (k, s) in clusters.of.iter().zip(&seen) {
            if let (true, Some(s)) = (*k != NONE, s) {
                clusters.mass[*k as usize] += s.weight;
            }
        }
        let members = clusters.members(&seen);
        clusters.positions = clusters.average(&members, bake, radiance, &directions);
        let total: f64 = clusters.mass.iter().sum();
        for m in &mut clusters.mass {
            *m /= total;
        }
        let two_sided = members.iter().zip(&clusters.mass).map(|(members, mass)| {
            let of_all = |(i, share): &(u32, f32)| share * bake.two_sided[*i as usize];
            mass * f64::from(members.iter().map(of_all).sum::<f32>())
        });
        clusters.two_sided = two_sided.sum();
        clusters
    }

    /// Surfels of each cluster with their shares; some of them are noted in `share`.
    fn members(&mut self, seen: &[Option<Seen>]) -> Vec<Vec<(u32, f32)>> {
        let mut members = vec![Vec::new(); self.len()];
        for (i, s) in seen.iter().enumerate() {
            let k = self.of[i];
            if let (true, Some(s)) = (k != NONE, s) {
                let share = (s.weight / self.mass[k as usize]) as f32;
                members[k as usize].push((i as u32, share));
            }
        }
        for members in &members {
            let sample = || members.iter().step_by(members.len().div_ceil(SAMPLES));
            let all: f32 = sample().map(|(_, share)| share).sum();
            for (i, share) in sample() {
                self.share[*i as usize] = share / all;
            }
        }
        members
    }

    /// Fills the means in, and returns each cluster's position.
    fn average(
        &mut self,
        members: &[Vec<(u32, f32)>],
        bake: &DirectionalBake,
        radiance: &[FrontAndBack],
        directions: &[Vec3],
    ) -> Vec<[f32; 3]> {
        let omega = 4.0 * std::f32::consts::PI;
        let means = members
            .par_iter()
            .zip(self.seen.par_chunks_exact_mut(DIRECTIONS))
            .map(|(members, seen)| {
                let (mut mean, mut normal, mut position) = ([[0f64; 3]; 2], Vec3::ZERO, Vec3::ZERO);
                for (i, share) in members {
                    let (i, w) = (*i as usize, f64::from(*share));
                    let n = bake.normals[i];
                    normal += *share * n;
                    position += *share * bake.tracer.surfels[i].position;
                    for (j, d) in directions.iter().enumerate() {
                        if bake.directional_visibility.is_open(i, j) {
                            seen[j] += share * n.dot(*d).max(0.0) * (omega / DIRECTIONS as f32);
                        }
                    }
                    for c in 0..3 {
                        mean[0][c] += w * f64::from(radiance[i][0][c]);
                    }
                    for hit in bake.directional_visibility.hits_of(i) {
                        let cosine = n.dot(directions[hit.stratum()]).max(0.0);
                        let b = radiance[hit.surfel()][usize::from(hit.is_back())];
                        let scale = w * f64::from(cosine * omega / STRATA as f32);
                        for c in 0..3 {
                            let b = f64::from(b[c]);
                            mean[1][c] += scale * if b.is_finite() { b } else { 0.0 };
                        }
                    }
                }
                (mean, normal, position.to_array())
            });
        let mut positions = Vec::with_capacity(members.len());
        for (k, (mean, normal, position)) in means.collect::<Vec<_>>().into_iter().enumerate() {
            [self.radiance[k], self.bounced[k]] = mean;
            self.normals[k] = normal;
            positions.push(position);
        }
        positions
    }

    /// Pairs of each cluster and its nearest ones, weighted by how alike they are in chroma.
    pub fn pairs(&self, neighbors: usize) -> Vec<Pair> {
        let nearest = Nearest::new(&self.positions, neighbors);
        let least = DARK * self.bright();
        let chroma = |k: usize| {
            let b = self.radiance[k];
            b.map(|v| v / b.iter().sum::<f64>().max(1e-30))
        };
        let visible = |k: usize, c: usize| {
            let b = self.radiance[k][c].max(0.0);
            b * b / (b * b + least * least).max(1e-300)
        };
        let pair = |a: usize, b: usize| {
            let (p, q) = (chroma(a), chroma(b));
            let apart: f64 = (0..3).map(|c| (p[c] - q[c]).powi(2)).sum();
            let alike = (-apart / (CHROMA * CHROMA)).exp();
            let weight = alike * (self.mass[a] * self.mass[b]).sqrt();
            Pair {
                of: [a as u32, b as u32],
                weight: std::array::from_fn(|c| weight * visible(a, c).min(visible(b, c))),
            }
        };
        let pairs_of = |a: usize| nearest.of(a).map(|b| pair(a, b)).collect::<Vec<_>>();
        let mut pairs: Vec<Pair> = (0..self.len())
            .into_par_iter()
            .flat_map_iter(pairs_of)
            .collect();
        // As many observations as there are clusters: each is compared with many, and is one all the same.
        let total: f64 = pairs.iter().flat_map(|p| p.weight).sum::<f64>() / 3.0;
        if total > 0.0 {
            let scale = self.len() as f64 / total;
            for pair in &mut pairs {
                pair.weight = pair.weight.map(|w| w * scale);
            }
        } else {
            pairs.clear();
        }
        pairs
    }

    /// The radiance of what is bright of the object, the mean of the channels.
    pub fn bright(&self) -> f64 {
        let each = self.radiance.iter().zip(&self.mass);
        let mut each: Vec<_> = each
            .map(|(b, m)| (b.iter().sum::<f64>() / 3.0, *m))
            .collect();
        let brightest = weighted_quantile(each.clone(), BRIGHTEST).unwrap_or(0.0);
        each.retain(|(b, _)| *b > BLACK * brightest);
        weighted_quantile(each, BRIGHT).unwrap_or(0.0)
    }
}

/// A surfel that tells of the light.
#[derive(Clone, Copy)]
struct Seen {
    position: Vec3,
    normal: Vec3,
    weight: f64,
}

/// Clusters by cells of a grid and octants of the normal, as fine as gives neither too small nor too many ones: of each surfel its
/// cluster, and how many there are.
fn assign(seen: &[Option<Seen>]) -> (Vec<u32>, usize) {
    let count = seen.iter().flatten().count();
    let most = (count / PER_CLUSTER).clamp(1, MOST);
    // One cell and an octant each at first.
    let mut best = grid(seen, COARSEST);
    let mut edge = FIRST_EDGE;
    for _ in 0..TRIES {
        let found = grid(seen, edge);
        // Those that are too small to be kept count as well: of too fine a grid there are many.
        let ratio = found.cells.max(1) as f32 / most as f32;
        if found.cells <= most && found.cells > best.cells {
            best = found;
        }
        if (0.9..=1.0).contains(&ratio) {
            break;
        }
        // Surfaces have so many cells as their edges' squares are smaller.
        edge = (edge * (ratio * 1.05).sqrt()).clamp(FINEST, COARSEST);
    }
    (best.of, best.kept)
}

/// Clusters in cells of one edge.
struct Grid {
    /// Cluster of each surfel, or [`NONE`]. `[n]`
    of: Vec<u32>,
    /// Clusters that are large enough, of so many cells that hold any surfel.
    kept: usize,
    cells: usize,
}

/// Clusters in cells of an edge; those of too few surfels are left out.
fn grid(seen: &[Option<Seen>], edge: f32) -> Grid {
    let key = |s: &Seen| {
        // The object lies in the unit ball.
        let cell = ((s.position + 1.0) / edge).floor().as_ivec3();
        (cell, s.normal.cmpgt(Vec3::ZERO).bitmask())
    };
    let mut sizes: HashMap<_, usize> = HashMap::new();
    for s in seen.iter().flatten() {
        *sizes.entry(key(s)).or_default() += 1;
    }
    let mut numbers: HashMap<_, u32> = HashMap::new();
    let of = seen
        .iter()
        .map(|s| {
            let Some(key) = s.as_ref().map(key).filter(|k| sizes[k] >= FEWEST) else {
                return NONE;
            };
            let next = numbers.len() as u32;
            *numbers.entry(key).or_insert(next)
        })
        .collect();
    Grid {
        of,
        kept: numbers.len(),
        cells: sizes.len(),
    }
}
