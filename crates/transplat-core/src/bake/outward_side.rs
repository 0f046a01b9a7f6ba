//! Normal orientation: the outward side of a surfel, and its smoothed normal. Trained normals have no sign, and are noisy.
//!
//! Three things tell the front. *What is seen*: the side from which more of the surfel is seen through what lies around it. *What was
//! photographed*: a trained colour varies with the view where there were cameras, and is smooth where there were none; how much that tells
//! differs between trainers, and is counted on those surfels whose front the first leaves no doubt of. *What neighbours say*: surfels in one
//! plane have one front. All are log odds, and add up. Where that is not enough, the user tells: what is seen from some place is outside.

use std::sync::atomic::{AtomicUsize, Ordering};

use bytemuck::{Pod, Zeroable};
use glam::{Vec2, Vec3};
use rayon::prelude::*;

use super::hierarchy::PACKET;
use super::transmittance::{LightGrid, TranslucentLayers};
use crate::error::{Error, Result};
use crate::nearest::Nearest;
use crate::progress::Progress;
use crate::sh::{coefficient_count, evaluate_sh, lattice};
use crate::surfels::SurfelCloud;

/// Directions from which it is asked how much of a surfel is seen.
const DIRECTIONS: usize = 24;

/// Surfels from which on sides are rasterized on grids, from fewer directions: what is seen of one alone matters little.
const MANY: usize = 1 << 17;
const DIRECTIONS_OF_MANY: usize = 12;

/// Directions at which its colour is looked at.
const VIEWS: usize = 24;

/// Visible share of a side that is not seen at all, so that its odds stay finite.
const LEAST_SEEN: f32 = 0.02;

/// Less than this share of what is seen from the other side, and the front is beyond doubt.
const CERTAIN: f32 = 0.1;

/// Less than this share, and the surfel is seen from one side alone.
const ONE_SIDED: f32 = 0.3;

/// Log odds of what is seen that may be chance.
const CHANCE: f32 = 0.1;

/// Classes of how much less the colour varies on one side than on the other.
const CLASSES: usize = 8;

/// Log odds that the variation tells at most: less than what is seen of one side alone, since where no camera was it may tell anything.
const MOST_VARIATION: f32 = 1.5;

/// Surfels that are taken to say nothing, in each class, before any is counted.
const PRIOR: f32 = 10.0;

/// Surfels around one that its front is compared with, and its normal averaged over.
const NEIGHBORS: usize = 32;

/// Log odds that neighbours which are all certain and all agree add, and turns in which they tell each other.
const AGREEMENT: f32 = 3.0;
const TURNS: usize = 5;

/// Neighbours are averaged over this share of their larger standard deviations: within a surfel's own extent the asset tells nothing finer.
const SMOOTHING: f32 = 0.5;

/// The surfel's own normal counts as much as that many neighbours: one that is close by is no evidence of noise, many are.
const OWN_WEIGHT: f32 = 4.0;

/// Turns of the averaging.
const SMOOTHING_TURNS: usize = 3;

/// Visible share of a back that is hidden, and certainty that the front must have, of 255.
const HIDDEN: u8 = 2;
const CERTAINLY: u8 = 250;

/// Below this certainty a front is a guess: it is wrong for one surfel in four.
const GUESS: f32 = 0.5;

/// Log odds that the user adds who says that what is seen from somewhere is the outside: more than all other evidence together, but for
/// what is seen at a grazing angle.
const TOLD: f32 = 20.0;

/// From there on a surfel is well seen: a member of a stack is covered by the others, from either side.
const WELL_SEEN: f32 = 0.25;

/// Less than this share of what is seen of a surfel from beyond, and it lies on another face.
const SEEN_AS_WELL: f32 = 0.7;

/// Outward side of a surfel; eight bytes, as in a bake's file.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct OutwardSide {
    /// Visible shares from the stored normal's side and from the other one, 255 for all, cosine-weighted over a hemisphere.
    seen: [u8; 2],
    /// 1 where the outward side is the one that the stored normal does not point to.
    turned: u8,
    /// Certainty of the outward side: 0 for even odds, 255 for certain.
    certainty: u8,
    /// The surface's normal on the octahedron.
    surface_normal: [i16; 2],
}

impl OutwardSide {
    fn new(seen: [f32; 2], log_odds: f32, surface_normal: Vec3) -> Self {
        Self {
            seen: seen.map(|s| (255.0 * s).round() as u8),
            turned: u8::from(log_odds < 0.0),
            certainty: (255.0 * (0.5 * log_odds).tanh().abs()).round() as u8,
            surface_normal: to_octahedron(surface_normal),
        }
    }

    /// True where the stored normal points to the back.
    pub fn is_turned(&self) -> bool {
        self.turned != 0
    }

    /// Visible share from its front, 0 to 1.
    pub fn seen(&self) -> f32 {
        f32::from(self.seen[usize::from(self.is_turned())]) / 255.0
    }

    /// True where it is seen from its front alone.
    pub fn is_one_sided(&self) -> bool {
        let [a, b] = self.seen.map(f32::from);
        a.min(b) < ONE_SIDED * a.max(b)
    }

    /// True where certainly nothing is seen of its back.
    pub fn hides_its_back(&self) -> bool {
        self.seen[usize::from(!self.is_turned())] <= HIDDEN && self.certainty >= CERTAINLY
    }

    /// By how much more probable it is than the other side, 0 to 1.
    pub fn certainty(&self) -> f32 {
        f32::from(self.certainty) / 255.0
    }

    /// True where it is little better than a guess.
    pub fn is_guess(&self) -> bool {
        self.certainty() < GUESS
    }

    /// Unit normal of the surface that the surfel is part of.
    pub fn surface_normal(&self) -> Vec3 {
        from_octahedron(self.surface_normal)
    }
}

/// The fronts of an asset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OutwardSides {
    /// Outward side of each surfel. `[n]`
    pub of: Vec<OutwardSide>,
}

impl OutwardSides {
    /// Where nobody asked: the stored normals, and both sides may be seen.
    pub fn unknown(cloud: &SurfelCloud) -> Self {
        let of = |i| OutwardSide::new([1.0; 2], 0.0, stored_normal(cloud, i));
        Self {
            of: (0..cloud.len()).map(of).collect(),
        }
    }

    /// Outward sides of some of the surfels.
    pub fn selected(&self, taken: &[usize]) -> Self {
        Self {
            of: taken.iter().map(|i| self.of[*i]).collect(),
        }
    }

    /// Finds them.
    ///
    /// # Errors
    /// [`Error::Cancelled`] when `progress` asked for it.
    pub fn find(cloud: &SurfelCloud, progress: Progress<'_>) -> Result<Self> {
        let translucent_layers = TranslucentLayers::new(cloud);
        let normals: Vec<Vec3> = (0..cloud.len()).map(|i| stored_normal(cloud, i)).collect();
        let seen = seen_from_sides(&translucent_layers, &normals, progress)?;
        let variation = variation_on_sides(cloud, &normals);
        let mut own = log_odds(&seen, &variation);
        for eye in &cloud.outside_from {
            if progress(1.0).is_break() {
                return Err(Error::Cancelled);
            }
            let evidence = outside_evidence(cloud, &translucent_layers, &normals, *eye);
            own.iter_mut().zip(evidence).for_each(|(own, e)| *own += e);
        }
        let points: Vec<[f32; 3]> = translucent_layers
            .positions
            .iter()
            .map(Vec3::to_array)
            .collect();
        let neighbors = Nearest::new(&points, NEIGHBORS);
        let odds = inferred_visibility(cloud, &translucent_layers, &neighbors, &normals, own);
        let outward_sides: Vec<Vec3> = (normals.iter().zip(&odds))
            .map(|(n, odds)| if *odds < 0.0 { -*n } else { *n })
            .collect();
        let surface = surface_normals(
            cloud,
            &translucent_layers,
            &neighbors,
            &outward_sides,
            (&seen, &odds),
        );
        Ok(Self {
            of: (0..cloud.len())
                .map(|i| OutwardSide::new(seen[i], odds[i], surface[i]))
                .collect(),
        })
    }

    /// Unit normal of surfel `i` itself, towards its front.
    pub fn normal(&self, cloud: &SurfelCloud, i: usize) -> Vec3 {
        let n = stored_normal(cloud, i);
        if self.of[i].is_turned() { -n } else { n }
    }

    /// Visible weight of each surfel: its area times opacity times visible share. `[n]`, sums to 1
    pub fn visible_weight(&self, cloud: &SurfelCloud) -> Vec<f32> {
        let largest = (cloud.scales.iter()).fold(0f32, |l, s| l.max(s.max_element()));
        let unit = largest.max(f32::MIN_POSITIVE);
        let each =
            |(i, front): (usize, &OutwardSide)| f64::from(seen_area(cloud, i, front.seen(), unit));
        let all: Vec<f64> = self.of.iter().enumerate().map(each).collect();
        let sum: f64 = all.iter().sum();
        if sum.is_nan() || sum <= 0.0 {
            return vec![1.0 / cloud.len().max(1) as f32; cloud.len()];
        }
        all.into_iter().map(|w| (w / sum) as f32).collect()
    }
}

fn stored_normal(cloud: &SurfelCloud, i: usize) -> Vec3 {
    cloud.stored_normal(i).normalize_or(Vec3::Z)
}

/// Area of surfel `i` in units of `unit` squared, by its opacity and by how much of it is seen.
fn seen_area(cloud: &SurfelCloud, i: usize, seen: f32, unit: f32) -> f32 {
    seen * cloud.opacities[i] * (cloud.scales[i] / unit).element_product()
}

/// Visible share of each surfel from the stored normal's side and from the other one, 0 to 1: cosine-weighted means. `[n]`
fn seen_from_sides(
    translucent_layers: &TranslucentLayers,
    normals: &[Vec3],
    progress: Progress<'_>,
) -> Result<Vec<[f32; 2]>> {
    if normals.len() >= MANY
        && let Some(grid) = LightGrid::resolving(translucent_layers)
    {
        return seen_on_grids(translucent_layers, &grid, normals, progress);
    }
    let directions = lattice(DIRECTIONS);
    let done = AtomicUsize::new(0);
    let packets: Vec<Vec<[f32; 2]>> = translucent_layers
        .order
        .par_chunks(PACKET)
        .map_init(Vec::new, |stack, of| {
            let so_far = done.fetch_add(of.len(), Ordering::Relaxed);
            if progress(so_far as f64 / normals.len() as f64).is_break() {
                return Err(Error::Cancelled);
            }
            let mut sums = vec![[[0f32; 2]; 2]; of.len()];
            for d in &directions {
                let through = translucent_layers.transmittance(of, *d, stack);
                for ((sum, i), through) in sums.iter_mut().zip(of).zip(through) {
                    add_seen(sum, normals[*i as usize].dot(*d), through);
                }
            }
            Ok(sums.into_iter().map(|s| s.map(share)).collect())
        })
        .collect::<Result<_>>()?;
    let mut seen = vec![[0f32; 2]; normals.len()];
    for (i, s) in translucent_layers
        .order
        .iter()
        .zip(packets.into_iter().flatten())
    {
        seen[*i as usize] = s;
    }
    Ok(seen)
}

/// Visible shares by blending all surfels once for each direction. `[n]`
fn seen_on_grids(
    translucent_layers: &TranslucentLayers,
    grid: &LightGrid,
    normals: &[Vec3],
    progress: Progress<'_>,
) -> Result<Vec<[f32; 2]>> {
    let directions = lattice(DIRECTIONS_OF_MANY);
    let done = AtomicUsize::new(0);
    let each = directions.len().div_ceil(rayon::current_num_threads());
    let through: Vec<Vec<Vec<u8>>> = (directions.par_chunks(each))
        .map(|directions| {
            let mut grid = grid.clone();
            let from = |d: &Vec3| {
                let so_far = done.fetch_add(1, Ordering::Relaxed);
                if progress(so_far as f64 / DIRECTIONS_OF_MANY as f64).is_break() {
                    return Err(Error::Cancelled);
                }
                Ok(grid.transmittance(translucent_layers, *d))
            };
            directions.iter().map(from).collect()
        })
        .collect::<Result<_>>()?;
    let through: Vec<Vec<u8>> = through.into_iter().flatten().collect();
    let of_surfel = |(i, normal): (usize, &Vec3)| {
        let mut sums = [[0f32; 2]; 2];
        for (d, through) in directions.iter().zip(&through) {
            add_seen(&mut sums, normal.dot(*d), f32::from(through[i]) / 255.0);
        }
        sums.map(share)
    };
    Ok(normals.par_iter().enumerate().map(of_surfel).collect())
}

/// Adds what is seen from a direction to what is seen of the side that it is on, and to what might be.
fn add_seen(sums: &mut [[f32; 2]; 2], cosine: f32, through: f32) {
    let [seen, all] = &mut sums[usize::from(cosine < 0.0)];
    *seen += cosine.abs() * through;
    *all += cosine.abs();
}

fn share([seen, all]: [f32; 2]) -> f32 {
    (seen / all.max(1e-6)).clamp(0.0, 1.0)
}

/// Variation of the stored colour with the view on the stored normal's side and on the other one: squared distance to the mean colour,
/// cosine-weighted. `[n]`
fn variation_on_sides(cloud: &SurfelCloud, normals: &[Vec3]) -> Vec<[f32; 2]> {
    let views = lattice(VIEWS);
    let k = coefficient_count(cloud.sh_degree);
    let of_surfel = |(sh, n): (&[[f32; 3]], &Vec3)| {
        let mut function = sh.to_vec();
        function[0] = [0.0; 3];
        let mut sides = [0f32; 2];
        for to_camera in &views {
            let cosine = n.dot(*to_camera);
            let off = evaluate_sh(&function, cloud.sh_degree, (-*to_camera).to_array());
            sides[usize::from(cosine < 0.0)] +=
                cosine.abs() * off.iter().map(|v| v * v).sum::<f32>();
        }
        sides
    };
    if cloud.sh_degree == 0 {
        return vec![[0.0; 2]; cloud.len()];
    }
    let each = cloud.sh.par_chunks_exact(k).zip(normals);
    each.map(of_surfel).collect()
}

/// Log odds that the stored normal's side is the front, from what is seen and what was photographed. `[n]`
fn log_odds(seen: &[[f32; 2]], variation: &[[f32; 2]]) -> Vec<f32> {
    let class = |[a, b]: [f32; 2]| {
        let ratio = a.min(b) / a.max(b).max(1e-20);
        ((ratio * CLASSES as f32) as usize).min(CLASSES - 1)
    };
    let (mut agree, mut all) = ([0.5 * PRIOR; CLASSES], [PRIOR; CLASSES]);
    for ([a, b], v) in seen.iter().zip(variation) {
        let certain = a.max(*b) > LEAST_SEEN && a.min(*b) < CERTAIN * a.max(*b);
        if certain && v[0] != v[1] {
            all[class(*v)] += 1.0;
            agree[class(*v)] += f32::from(u8::from((v[0] > v[1]) == (a > b)));
        }
    }
    let each = seen.iter().zip(variation).map(|([a, b], v)| {
        let of_seen = ((a + LEAST_SEEN) / (b + LEAST_SEEN)).ln();
        // As much as may be chance: a sheet stays as it was stored.
        let of_seen = of_seen - of_seen.clamp(-CHANCE, CHANCE);
        let p = agree[class(*v)] / all[class(*v)];
        let of_variation = (p / (1.0 - p)).ln().clamp(-MOST_VARIATION, MOST_VARIATION);
        of_seen
            + match v[0].partial_cmp(&v[1]) {
                Some(std::cmp::Ordering::Greater) => of_variation,
                Some(std::cmp::Ordering::Less) => -of_variation,
                _ => 0.0,
            }
    });
    each.collect()
}

/// Log odds that the stored normal's side is the front, of what is seen from a place outside. `[n]`
fn outside_evidence(
    cloud: &SurfelCloud,
    translucent_layers: &TranslucentLayers,
    normals: &[Vec3],
    eye: Vec3,
) -> Vec<f32> {
    let packets: Vec<Vec<f32>> = translucent_layers
        .order
        .par_chunks(PACKET)
        .map_init(Vec::new, |stack, of| {
            // Neighbours are seen along one line; what is behind the eye covers them as well.
            let places = of.iter().map(|i| cloud.positions[*i as usize]);
            let middle = places.sum::<Vec3>() / of.len() as f32;
            let toward = (eye - middle).normalize_or(Vec3::Z);
            let [near, far] =
                [toward, -toward].map(|d| translucent_layers.transmittance(of, d, stack));
            let each = of.iter().zip(near.into_iter().zip(far));
            each.map(|(i, (near, far))| {
                // What is seen less from here than from beyond lies on another face.
                let is_seen = near > SEEN_AS_WELL * far;
                let share = if is_seen {
                    (near / WELL_SEEN).min(1.0)
                } else {
                    0.0
                };
                let i = *i as usize;
                let direction = (eye - cloud.positions[i]).normalize_or(toward);
                TOLD * share * normals[i].dot(direction)
            })
            .collect()
        })
        .collect();
    let mut evidence = vec![0f32; normals.len()];
    for (i, odds) in translucent_layers
        .order
        .iter()
        .zip(packets.into_iter().flatten())
    {
        evidence[*i as usize] = odds;
    }
    evidence
}

/// The log odds when neighbours in one plane agree on their fronts: mean field of an Ising model. `[n]`
fn inferred_visibility(
    cloud: &SurfelCloud,
    translucent_layers: &TranslucentLayers,
    neighbors: &Nearest,
    normals: &[Vec3],
    own: Vec<f32>,
) -> Vec<f32> {
    // Of one plane: facing one way, and near it by the finer of the two surfels' extents.
    let couple = |i: usize, j: usize| {
        let cosine = normals[i].dot(normals[j]);
        let apart = translucent_layers.positions[j] - translucent_layers.positions[i];
        let off = 0.5 * (apart.dot(normals[i]).abs() + apart.dot(normals[j]).abs());
        let extent = cloud.scales[i]
            .min_element()
            .min(cloud.scales[j].min_element());
        let off = off * translucent_layers.radius / extent.max(1e-9 * translucent_layers.radius);
        (cosine * cosine * (-off * off).exp() * cloud.opacities[j]).copysign(cosine)
    };
    let couplings: Vec<f32> = (0..own.len())
        .into_par_iter()
        .flat_map_iter(|i| {
            let mut row: Vec<f32> = neighbors.of(i).map(|j| couple(i, j)).collect();
            let sum: f32 = row.iter().map(|c| c.abs()).sum();
            // Little that is beside it says little.
            row.iter_mut().for_each(|c| *c /= sum.max(0.3));
            row
        })
        .collect();
    let mut odds = own.clone();
    for _ in 0..TURNS {
        let mean: Vec<f32> = odds.iter().map(|l| (0.5 * l).tanh()).collect();
        odds = (0..own.len())
            .into_par_iter()
            .map(|i| {
                let row = couplings[i * neighbors.each..].iter();
                let said: f32 = row.zip(neighbors.of(i)).map(|(c, j)| c * mean[j]).sum();
                own[i] + AGREEMENT * said
            })
            .collect();
    }
    odds
}

/// The normals of the surface that the surfels make up: many that overlap are averaged, one that stands alone keeps its own. `[n]`
fn surface_normals(
    cloud: &SurfelCloud,
    translucent_layers: &TranslucentLayers,
    neighbors: &Nearest,
    outward_sides: &[Vec3],
    (seen, odds): (&[[f32; 2]], &[f32]),
) -> Vec<Vec3> {
    let weights: Vec<f32> = (0..outward_sides.len())
        .map(|i| {
            seen_area(
                cloud,
                i,
                seen[i][usize::from(odds[i] < 0.0)],
                translucent_layers.radius,
            )
        })
        .collect();
    let extent = |i: usize| SMOOTHING * cloud.scales[i].max_element() / translucent_layers.radius;
    let mut normals = outward_sides.to_vec();
    for _ in 0..SMOOTHING_TURNS {
        normals = (0..outward_sides.len())
            .into_par_iter()
            .map(|i| {
                let mut sum = normals[i] * (OWN_WEIGHT * weights[i]);
                for j in neighbors.of(i) {
                    let cosine = normals[i].dot(normals[j]);
                    if cosine <= 0.0 {
                        continue;
                    }
                    let apart = translucent_layers.positions[j]
                        .distance_squared(translucent_layers.positions[i]);
                    let near = (-0.5 * apart / (extent(i) * extent(j)).max(1e-18)).exp();
                    sum += normals[j] * (weights[j] * near * cosine * cosine);
                }
                sum.normalize_or(normals[i])
            })
            .collect();
    }
    normals
}

/// A unit vector on the octahedron, unfolded to a square (Meyer et al., "On Floating-Point Normal Vectors", 2010).
fn to_octahedron(n: Vec3) -> [i16; 2] {
    let p = Vec2::new(n.x, n.y) / (n.x.abs() + n.y.abs() + n.z.abs());
    let p = if n.z < 0.0 { folded(p) } else { p };
    (p * 32767.0).round().to_array().map(|v| v as i16)
}

fn from_octahedron(packed: [i16; 2]) -> Vec3 {
    let p = Vec2::from_array(packed.map(f32::from)) / 32767.0;
    let z = 1.0 - p.x.abs() - p.y.abs();
    let p = if z < 0.0 { folded(p) } else { p };
    p.extend(z).normalize_or(Vec3::Z)
}

fn folded(p: Vec2) -> Vec2 {
    (1.0 - Vec2::new(p.y, p.x).abs()) * Vec2::new(1f32.copysign(p.x), 1f32.copysign(p.y))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::progress::no_progress;
    use crate::sh::{MAX_COEFFICIENTS, band, evaluate_basis};
    use crate::synthetic;

    fn find(cloud: &SurfelCloud) -> Vec<Vec3> {
        let outward_sides = OutwardSides::find(cloud, &no_progress).expect("not cancelled");
        (0..cloud.len())
            .map(|i| outward_sides.normal(cloud, i))
            .collect()
    }

    fn turn_every_third(cloud: &mut SurfelCloud) {
        for [u, v] in cloud.tangents.iter_mut().step_by(3) {
            std::mem::swap(u, v);
        }
    }

    /// A number between -1 and 1 that looks like chance.
    fn chance(i: usize) -> f32 {
        let bits = (i as u32 + 1)
            .wrapping_mul(0x9e37_79b9)
            .rotate_left(15)
            .wrapping_mul(0x85eb_ca6b);
        (bits >> 8) as f32 / (1 << 23) as f32 - 1.0
    }

    #[test]
    fn a_ball_faces_outward_however_its_normals_are_stored() {
        let mut ball = synthetic::sphere(1500);
        turn_every_third(&mut ball);
        let outward_sides = OutwardSides::find(&ball, &no_progress).expect("not cancelled");
        for (i, p) in ball.positions.iter().enumerate() {
            assert!(outward_sides.normal(&ball, i).dot(*p) > 0.0, "surfel {i}");
            let front = &outward_sides.of[i];
            assert!(front.is_one_sided() && !front.is_guess(), "{front:?}");
            assert_eq!(front.is_turned(), i % 3 == 0);
            // One layer of surfels that hardly overlap has nothing to average.
            assert!(front.surface_normal().dot(*p) > 0.9999);
        }
        let sum: f32 = outward_sides.visible_weight(&ball).iter().sum();
        assert!((sum - 1.0).abs() < 1e-4);
    }

    #[test]
    fn the_faces_of_a_plate_thinner_than_its_surfels_are_wide_face_apart() {
        let sheet = synthetic::sheet(24);
        let mut plate = sheet.clone();
        let thickness = 0.4 * sheet.scales[0].x;
        plate.add(&sheet, 1.0, -thickness * Vec3::Z);
        turn_every_third(&mut plate);
        let wrong = (find(&plate).iter().enumerate())
            .filter(|(i, n)| (n.z > 0.0) != (*i < sheet.len()))
            .count();
        // All but some of the rim.
        assert!(wrong * 50 < plate.len(), "{wrong} of {}", plate.len());
    }

    #[test]
    fn a_sheet_faces_where_its_colour_varies_as_that_of_what_surely_is_a_front() {
        let mut scene = synthetic::sphere_over_slab(1200);
        let solid = scene.len();
        let sheet = synthetic::sheet(16);
        scene.add(&sheet, 0.5, 2.0 * Vec3::Z);
        scene.sh_degree = 3;
        let outward: Vec<Vec3> = find(&synthetic::sphere_over_slab(1200));
        // What cameras above a surface teach its colour: the kernel of bands 1 to 3 around their directions.
        let photographed = |n: Vec3, i: usize| -> Vec<[f32; 3]> {
            let mut f = vec![[0f32; 3]; coefficient_count(3)];
            f[0] = [1.0; 3];
            let camera =
                (n + 0.5 * Vec3::new(chance(i), chance(i + 7), chance(i + 13))).normalize_or(n);
            let mut y = [0f32; MAX_COEFFICIENTS];
            evaluate_basis((-camera).to_array(), 3, &mut y);
            for k in band(1).start..band(3).end {
                f[k] = [0.05 * y[k]; 3];
            }
            f
        };
        scene.sh = (0..scene.len())
            .flat_map(|i| photographed(outward.get(i).copied().unwrap_or(-Vec3::Z), i))
            .collect();
        let found = find(&scene);
        let up = (solid..scene.len()).filter(|i| found[*i].z > 0.0).count();
        assert!(up * 20 < sheet.len(), "{up} of {}", sheet.len());
    }

    #[test]
    fn what_is_seen_outweighs_how_the_colour_varies() {
        // Fitted by least squares, colour is calm where cameras were and wild behind: so it is for most, and the other way round for one in a
        // hundred that no camera saw.
        let seen = vec![[1.0, 0.05]; 1000];
        let variation = |i: usize| {
            if i.is_multiple_of(100) {
                [1.0, 0.0]
            } else {
                [0.0, 1.0]
            }
        };
        let variation: Vec<[f32; 2]> = (0..1000).map(variation).collect();
        let odds = log_odds(&seen, &variation);
        assert!(odds.iter().all(|odds| *odds > 0.0), "{:?}", &odds[..2]);
        // And it does tell where nothing is seen.
        let even = log_odds(
            &[seen, vec![[0.5, 0.5]; 2]].concat(),
            &[variation, vec![[0.0, 1.0], [1.0, 0.0]]].concat(),
        );
        assert!(even[1000] > 1.0 && even[1001] < -1.0, "{:?}", &even[1000..]);
    }

    #[test]
    fn normals_of_a_stack_are_nearer_to_the_surface_than_those_of_its_members() {
        let ball = synthetic::sphere(8000);
        // Four times as wide as they are apart.
        let mut stack = ball.clone();
        for (i, n) in ball.positions.iter().enumerate() {
            let jitter = Vec3::new(chance(3 * i), chance(3 * i + 1), chance(3 * i + 2));
            let (u, v) = (*n + 0.25 * jitter).normalize().any_orthonormal_pair();
            stack.tangents[i] = [u, v];
            stack.scales[i] *= 4.0;
            stack.opacities[i] = 0.3;
        }
        let outward_sides = OutwardSides::find(&stack, &no_progress).expect("not cancelled");
        let off = |n: Vec3, i: usize| n.angle_between(ball.positions[i]);
        let mean = |f: &dyn Fn(usize) -> f32| (0..stack.len()).map(f).sum::<f32>() / 8000.0;
        let own = mean(&|i| off(outward_sides.normal(&stack, i), i));
        let surface = mean(&|i| off(outward_sides.of[i].surface_normal(), i));
        assert!(surface < 0.5 * own, "{surface} for {own}");
    }

    #[test]
    fn a_sheet_stays_as_it_was_stored_and_is_a_guess() {
        let sheet = synthetic::sheet(12);
        let outward_sides = OutwardSides::find(&sheet, &no_progress).expect("not cancelled");
        assert!(
            outward_sides
                .of
                .iter()
                .all(|f| !f.is_turned() && f.is_guess())
        );
        assert!(outward_sides.of.iter().all(|f| !f.is_one_sided()));
    }

    #[test]
    fn what_the_user_sees_from_outside_is_the_front() {
        let mut sheet = synthetic::sheet(12);
        sheet.outside_from = vec![Vec3::new(0.3, 0.2, -4.0)];
        let outward_sides = OutwardSides::find(&sheet, &no_progress).expect("not cancelled");
        assert!(
            outward_sides
                .of
                .iter()
                .all(|f| f.is_turned() && !f.is_guess())
        );
        // It says nothing of what is not seen from there.
        let mut ball = synthetic::sphere(1500);
        turn_every_third(&mut ball);
        ball.outside_from = vec![Vec3::new(0.0, 0.0, 5.0)];
        for (i, n) in find(&ball).into_iter().enumerate() {
            assert!(n.dot(ball.positions[i]) > 0.0, "surfel {i}");
        }
    }

    #[test]
    fn packed_normals_are_exact_enough() {
        for (i, n) in lattice(2000).into_iter().enumerate() {
            let back = from_octahedron(to_octahedron(n));
            assert!(back.distance(n) < 1e-4, "{i}: {n} {back}");
        }
    }

    #[test]
    fn grids_tell_the_same_side_as_rays() {
        let mut cloud = synthetic::sphere_over_plate(6000);
        turn_every_third(&mut cloud);
        let (translucent_layers, normals) = (
            TranslucentLayers::new(&cloud),
            (0..cloud.len())
                .map(|i| stored_normal(&cloud, i))
                .collect::<Vec<_>>(),
        );
        let grid =
            LightGrid::resolving(&translucent_layers).expect("they are larger than its pixels");
        let by_rays =
            seen_from_sides(&translucent_layers, &normals, &no_progress).expect("not cancelled");
        let on_grids = seen_on_grids(&translucent_layers, &grid, &normals, &no_progress)
            .expect("not cancelled");
        let (mut told, mut other) = (0, 0);
        for ([a, b], [c, d]) in by_rays.iter().zip(&on_grids) {
            if a.min(*b) < ONE_SIDED * a.max(*b) {
                told += 1;
                other += usize::from((a > b) != (c > d));
            }
        }
        assert!(told > 4000, "{told}");
        assert!(other * 100 < told, "{other} of {told}");
    }
}
