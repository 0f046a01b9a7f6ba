//! Bake of the harmonic method (paper 3.2): openness of each surfel towards N directions by exponential shadow maps (ESM), and the sign of its
//! normal.
//!
//! For every direction an orthographic map of the object's heights towards it is drawn; each surfel compares its own height with
//! eight taps of the map, softened exponentially (exponential shadow maps, Annen et al. 2008). Geometry only: no light is needed.

use glam::{Vec2, Vec3};
use multiversion::multiversion;
use rayon::prelude::*;

use super::open_object::OpenObject;
use super::outward_side::OutwardSides;
use super::scaled::{BakeSurfel, ScaledObject};
use super::trace::Tracer;
use crate::error::{Error, Result};
use crate::progress::Progress;
use crate::sh::{
    MAX_COEFFICIENTS, MAX_DEGREE, coefficient_count, cosine_kernel, evaluate_basis,
    fibonacci_sphere, lattice,
};
use crate::surfels::SurfelCloud;

/// Directions of a bake unless asked otherwise: more gain nothing that path-traced pictures show, and half as many do not hold degree 8.
pub const DEFAULT_DIRECTIONS: usize = 128;

/// The range of directions that a bake may have. The upper end bounds its memory: one byte a surfel and direction.
pub const DIRECTIONS: std::ops::RangeInclusive<usize> = 16..=4096;

/// Directions whose maps are held at once; visibility is stored four to a word on the GPU.
pub const DIRECTION_BATCH: usize = 8;

/// Taps of a look-up, in texels: a Poisson disk with one tap in the middle.
pub const TAPS: [[f32; 2]; 8] = [
    [0.0, 0.0],
    [1.22, 0.34],
    [0.52, 1.31],
    [-0.68, 1.08],
    [-1.37, 0.12],
    [-0.81, -1.13],
    [0.31, -1.34],
    [1.15, -0.86],
];

/// Sharpness of the exponential shadow, per object radius.
pub const SHARPNESS: f32 = 200.0;

/// Filter of the comparison with an exponential shadow map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Softness {
    /// The first so many of [`TAPS`].
    pub taps: usize,
    /// Sharpness of the exponential shadow, per object radius.
    pub sharpness: f32,
}

impl Default for Softness {
    fn default() -> Self {
        Self {
            taps: TAPS.len(),
            sharpness: SHARPNESS,
        }
    }
}

/// A disc whose area on the map is below this share of its own is seen edge-on, and casts no shadow.
pub const EDGE_ON: f32 = 1e-4;

/// The cosine below which a receiver's slope towards the map is not believed any more.
pub const MIN_SLOPE_COSINE: f32 = 0.2;

/// Difference of the two sides' openness over their sum below which a surfel is two-sided.
pub const TWO_SIDED_CONTRAST: f32 = 0.25;

/// One direction with its map's axes, all unit and orthogonal.
#[derive(Clone, Copy, Debug)]
pub struct MapFrame {
    /// Right axis of the map.
    pub right: Vec3,
    /// Up axis of the map.
    pub up: Vec3,
    /// Towards the light: heights are measured along it.
    pub direction: Vec3,
}

/// Input of the bake that CPU, GPU and oracle share: frames, scaled surfels, and the size of the maps.
#[derive(Clone, Debug)]
pub struct BakeInput {
    /// One a direction.
    pub frames: Vec<MapFrame>,
    /// One a surfel.
    pub surfels: Vec<BakeSurfel>,
    /// Texels along an edge of a map, which covers -1 to 1 in the scaled coordinates.
    pub resolution: usize,
    /// Where the scaled coordinates have their origin, in the asset's.
    pub center: Vec3,
    /// Length of the scaled unit, in scene units.
    pub radius: f32,
}

impl BakeInput {
    /// Scales the object to the unit ball and chooses the maps' resolution: a texel over four median standard deviations, 64 to 256.
    pub fn new(cloud: &SurfelCloud, directions: usize) -> Self {
        let object = ScaledObject::new(cloud);
        let texels = (0.5 / object.median_size.max(1e-30)).clamp(64.0, 256.0);
        let resolution = (texels as usize).next_power_of_two();
        let frames = lattice(directions)
            .into_iter()
            .map(|direction| {
                let (right, up) = direction.any_orthonormal_pair();
                MapFrame {
                    right,
                    up,
                    direction,
                }
            })
            .collect();
        Self {
            frames,
            surfels: object.surfels,
            resolution,
            center: object.center,
            radius: object.radius,
        }
    }
}

/// Fills openness `[n][N]` of directions that are not baked yet with that of the nearest one that is, so that an unfinished bake can be used.
///
/// `done` are the finished directions' indices, at least one.
pub fn fill_unfinished(open: &mut [u8], directions: usize, done: &[usize]) {
    let lattice = fibonacci_sphere(directions);
    let dot = |a: usize, b: usize| -> f64 { (0..3).map(|c| lattice[a][c] * lattice[b][c]).sum() };
    let from: Vec<usize> = (0..directions)
        .map(|i| {
            done.iter()
                .copied()
                .max_by(|a, b| dot(i, *a).total_cmp(&dot(i, *b)))
                .unwrap_or(i)
        })
        .collect();
    open.par_chunks_exact_mut(directions).for_each(|row| {
        for (i, from) in from.iter().enumerate() {
            row[i] = row[*from];
        }
    });
}

/// Height of a texel that nothing covers.
pub const EMPTY: f32 = -1e30;

/// Draws the heights of all occluders along one direction: `map` `[resolution][resolution]`.
///
/// The GPU asks each texel whether `s^2 + t^2 <= 1`; here the same ellipse is cut into rows, of which the ends are known.
#[multiversion(targets("x86_64+avx2", "aarch64+neon"))]
fn draw_height_map(input: &BakeInput, frame: &MapFrame, map: &mut [f32]) {
    map.fill(EMPTY);
    let texel = 2.0 / input.resolution as f32;
    let last = input.resolution as i32 - 1;
    // First and last texel whose centre is between two coordinates.
    let first = |low: f32| ((low + 1.0) / texel - 0.5).ceil().max(0.0) as i32;
    let until = |high: f32| (((high + 1.0) / texel - 0.5).floor() as i32).min(last);
    let center = |i: i32| (i as f32 + 0.5) * texel - 1.0;
    for surfel in &input.surfels {
        let [a, b] = surfel.axes;
        let (ax, ay) = (a.dot(frame.right), a.dot(frame.up));
        let (bx, by) = (b.dot(frame.right), b.dot(frame.up));
        let det = ax * by - ay * bx;
        // Seen edge-on (or without area) it covers nothing.
        if det.abs() <= EDGE_ON * a.length() * b.length() {
            continue;
        }
        let (px, py) = (
            surfel.position.dot(frame.right),
            surfel.position.dot(frame.up),
        );
        let height = surfel.position.dot(frame.direction);
        let (rise_a, rise_b) = (a.dot(frame.direction), b.dot(frame.direction));
        // Height over the map: height + dx * rise_x + dy * rise_y.
        let rise_x = (by * rise_a - ay * rise_b) / det;
        let rise_y = (ax * rise_b - bx * rise_a) / det;
        let extent_2 = ay * ay + by * by;
        let shear = (ax * ay + bx * by) / extent_2;
        let width = det.abs() / extent_2;
        let extent = extent_2.sqrt();
        for y in first(py - extent)..=until(py + extent) {
            let dy = center(y) - py;
            let half = width * (extent_2 - dy * dy).max(0.0).sqrt();
            let middle = px + dy * shear;
            let (x0, x1) = (first(middle - half), until(middle + half));
            if x0 > x1 {
                continue;
            }
            let start = height + dy * rise_y + (center(x0) - px) * rise_x;
            let row = y as usize * input.resolution;
            let cells = &mut map[row + x0 as usize..=row + x1 as usize];
            for (i, cell) in cells.iter_mut().enumerate() {
                let h = start + i as f32 * (texel * rise_x);
                *cell = if h > *cell { h } else { *cell };
            }
        }
    }
}

/// Openness of a surfel towards a map's direction, 0 to 1.
#[multiversion(targets("x86_64+avx2", "aarch64+neon"))]
fn look_up(
    input: &BakeInput,
    frame: &MapFrame,
    map: &[f32],
    surfel: &BakeSurfel,
    softness: Softness,
) -> f32 {
    let Softness { taps, sharpness } = softness;
    let texel = 2.0 / input.resolution as f32;
    let (px, py) = (
        surfel.position.dot(frame.right),
        surfel.position.dot(frame.up),
    );
    let height = surfel.position.dot(frame.direction);
    let facing = surfel.normal.dot(frame.direction);
    let cosine = facing.abs().max(MIN_SLOPE_COSINE).copysign(facing);
    // The receiver's own plane: a neighbour in it is no occluder.
    let slope = Vec2::new(
        -surfel.normal.dot(frame.right) / cosine,
        -surfel.normal.dot(frame.up) / cosine,
    );
    let (u, v) = ((px + 1.0) / texel, (py + 1.0) / texel);
    let mut sum = 0.0;
    for [ox, oy] in &TAPS[..taps] {
        let (x, y) = ((u + ox).floor(), (v + oy).floor());
        let size = input.resolution as f32;
        if !(x >= 0.0 && y >= 0.0 && x < size && y < size) {
            sum += 1.0;
            continue;
        }
        let plane = height
            + slope.x * ((x + 0.5) * texel - 1.0 - px)
            + slope.y * ((y + 0.5) * texel - 1.0 - py);
        let above = map[y as usize * input.resolution + x as usize] - plane - surfel.bias;
        // Beyond 20 e-foldings nothing is left of a byte.
        if above <= 0.0 {
            sum += 1.0;
        } else if sharpness * above < 20.0 {
            sum += (-sharpness * above).exp();
        }
    }
    sum / taps as f32
}

/// Bakes on the CPU, a batch of directions at a time: maps in parallel, then surfels in parallel.
///
/// Returns openness `[n][N]` in bytes.
///
/// # Errors
/// [`Error::Cancelled`] when `progress` asked for it.
pub fn bake_harmonic(input: &BakeInput, progress: Progress<'_>) -> Result<Vec<u8>> {
    bake_receivers(input, &input.surfels, Softness::default(), progress)
}

/// Bakes any receivers among the input's surfels, such as a ground under them, with any filter. Returns openness `[receivers][N]` in bytes.
///
/// # Errors
/// [`Error::Cancelled`] when `progress` asked for it.
///
/// # Panics
/// If there are not so many taps.
pub fn bake_receivers(
    input: &BakeInput,
    receivers: &[BakeSurfel],
    softness: Softness,
    progress: Progress<'_>,
) -> Result<Vec<u8>> {
    let directions = input.frames.len();
    let texels = input.resolution * input.resolution;
    let mut open = vec![0u8; receivers.len() * directions];
    let mut maps = vec![0f32; DIRECTION_BATCH.min(directions) * texels];
    for (batch, frames) in input.frames.chunks(DIRECTION_BATCH).enumerate() {
        let first = batch * DIRECTION_BATCH;
        if progress(first as f64 / directions as f64).is_break() {
            return Err(Error::Cancelled);
        }
        maps.par_chunks_exact_mut(texels)
            .zip(frames)
            .for_each(|(map, frame)| draw_height_map(input, frame, map));
        open.par_chunks_exact_mut(directions)
            .zip(receivers)
            .for_each(|(row, surfel)| {
                for (i, frame) in frames.iter().enumerate() {
                    let map = &maps[i * texels..][..texels];
                    // A byte, as CPU and GPU both round it.
                    let open = look_up(input, frame, map, surfel, softness);
                    row[first + i] = (open * 255.0 + 0.5) as u8;
                }
            });
    }
    Ok(open)
}

/// The result of a bake: everything that the transfer needs of the geometry.
#[derive(Clone, Debug)]
pub struct HarmonicBake {
    /// Directions N of the lattice [`fibonacci_sphere`].
    pub directions: usize,
    /// `[n][N]`, 255 is open.
    pub open: Vec<u8>,
    /// Unit normals, turned to the open side. `[n]`
    pub normals: Vec<Vec3>,
    /// Surfels whose two sides are about equally open: the light decides which of them counts. `[n]`
    pub two_sided: Vec<bool>,
    /// Number of stored normals that pointed to the closed side.
    pub flipped: usize,
    /// Surfels that are closed on both sides.
    pub buried: usize,
    /// Where no map was drawn, since nothing blocks anything: [`OpenObject::mean_error`].
    pub open_object_error: Option<f32>,
    /// The highest band of [`HarmonicBake::coefficients`] that holds anything.
    pub max_degree: usize,
}

impl HarmonicBake {
    /// Turns each normal to its open side and counts.
    ///
    /// The sign is that of `dot(n, sum_i v_i w_i)`: the difference of the two sides' cosine-weighted openness.
    pub fn from_open(cloud: &SurfelCloud, directions: usize, open: Vec<u8>) -> Self {
        let lattice = lattice(directions);
        // A fully open side: integral of the cosine over a hemisphere, in units of 255 a direction.
        let full = 255.0 * directions as f32 / 4.0;
        let sides: Vec<(Vec3, bool, bool, bool)> = open
            .par_chunks_exact(directions)
            .enumerate()
            .map(|(i, row)| {
                let normal = cloud.stored_normal(i).normalize_or(Vec3::Z);
                let (mut front, mut back) = (0f32, 0f32);
                for (w, v) in lattice.iter().zip(row) {
                    let amount = w.dot(normal) * f32::from(*v);
                    front += amount.max(0.0);
                    back += (-amount).max(0.0);
                }
                let flip = back > front;
                let buried = front + back < 0.02 * full;
                let two_sided =
                    !buried && (front - back).abs() < TWO_SIDED_CONTRAST * (front + back);
                (if flip { -normal } else { normal }, flip, two_sided, buried)
            })
            .collect();
        Self {
            directions,
            open,
            normals: sides.iter().map(|s| s.0).collect(),
            two_sided: sides.iter().map(|s| s.2).collect(),
            flipped: sides.iter().filter(|s| s.1).count(),
            buried: sides.iter().filter(|s| s.3).count(),
            open_object_error: None,
            max_degree: MAX_DEGREE,
        }
    }

    /// Without any map, where nothing blocks the light of any surfel (see [`OpenObject`]).
    pub fn of_open_object(cloud: &SurfelCloud, directions: usize) -> Option<Self> {
        let object = OpenObject::probe(&Tracer::new(cloud, OutwardSides::unknown(cloud)))?;
        let lattice = lattice(directions);
        let mut open = vec![0u8; cloud.len() * directions];
        open.par_chunks_exact_mut(directions)
            .enumerate()
            .for_each(|(i, row)| {
                for (v, d) in row.iter_mut().zip(&lattice) {
                    *v = if object.is_open(i, *d) { 255 } else { 0 };
                }
            });
        Some(Self {
            open_object_error: Some(object.mean_error),
            ..Self::from_open(cloud, directions, open)
        })
    }

    /// A bake of nothing but air: every surfel sees everything, normals stay as they are stored.
    pub fn all_open(cloud: &SurfelCloud, directions: usize) -> Self {
        Self {
            directions,
            open: vec![255; cloud.len() * directions],
            normals: (0..cloud.len())
                .map(|i| cloud.stored_normal(i).normalize_or(Vec3::Z))
                .collect(),
            two_sided: vec![false; cloud.len()],
            flipped: 0,
            buried: 0,
            open_object_error: None,
            max_degree: MAX_DEGREE,
        }
    }

    /// Bakes of the same directions as one, surfels after surfels.
    pub fn together(bakes: &[&Self]) -> Self {
        let each = || bakes.iter();
        Self {
            directions: bakes[0].directions,
            open: each().flat_map(|b| &b.open).copied().collect(),
            normals: each().flat_map(|b| &b.normals).copied().collect(),
            two_sided: each().flat_map(|b| &b.two_sided).copied().collect(),
            flipped: each().map(|b| b.flipped).sum(),
            buried: each().map(|b| b.buried).sum(),
            open_object_error: None,
            max_degree: MAX_DEGREE,
        }
    }

    /// `V_k = (4 pi / N) sum_i v_i Y_k(w_i)`, `[n][K]`: a uniform lattice has equal weights.
    pub fn coefficients(&self, degree: usize) -> Vec<f32> {
        let mut all = self.project(degree, |_, v| v);
        let kept = coefficient_count(self.max_degree.min(degree));
        for v in all.chunks_exact_mut(coefficient_count(degree)) {
            v[kept..].fill(0.0);
        }
        all
    }

    /// Visibility as blurred as an SH series of a degree; the light keeps its own.
    pub fn of_degree(&self, degree: usize) -> Self {
        Self {
            max_degree: degree,
            ..self.clone()
        }
    }

    /// The cosine transfer vector (Sloan et al. 2002), `T_k = (4 pi / N) sum_i v_i max(0, n.w_i) Y_k(w_i)`, `[n][K]`:
    /// irradiance is `L . T`, truncated once.
    pub fn cosine_transfer(&self, degree: usize) -> Vec<f32> {
        self.project(degree, |cosine, v| v * cosine.max(0.0))
    }

    fn project(&self, degree: usize, weight: impl Fn(f32, f32) -> f32 + Sync) -> Vec<f32> {
        let k = coefficient_count(degree);
        let lattice = fibonacci_sphere(self.directions);
        let scale = 4.0 * std::f64::consts::PI / self.directions as f64 / 255.0;
        let mut basis = vec![0f32; self.directions * k];
        let mut directions = Vec::with_capacity(self.directions);
        for (d, row) in lattice.iter().zip(basis.chunks_exact_mut(k)) {
            let mut y = [0f64; MAX_COEFFICIENTS];
            evaluate_basis(*d, degree, &mut y);
            for (out, y) in row.iter_mut().zip(y) {
                *out = (scale * y) as f32;
            }
            directions.push(Vec3::from_array(d.map(|v| v as f32)));
        }
        let mut out = vec![0f32; self.normals.len() * k];
        out.par_chunks_exact_mut(k)
            .zip(self.open.par_chunks_exact(self.directions))
            .zip(&self.normals)
            .for_each(|((out, open), normal)| {
                for ((v, d), y) in open.iter().zip(&directions).zip(basis.chunks_exact(k)) {
                    let w = weight(d.dot(*normal), f32::from(*v));
                    if w != 0.0 {
                        for (out, y) in out.iter_mut().zip(y) {
                            *out += w * y;
                        }
                    }
                }
            });
        out
    }

    /// Cosine-weighted share of the front side's hemisphere that is open, `[n]`, 0 to 1: ambient occlusion.
    pub fn openness(&self) -> Vec<f32> {
        // T_0 = E / L_0 for an even light of radiance 1 / Y_0; fully open it is pi Y_0.
        let full = (cosine_kernel(0) / crate::sh::SQRT_4PI) as f32;
        self.cosine_transfer(0)
            .iter()
            .map(|t| (t / full).clamp(0.0, 1.0))
            .collect()
    }
}

/// Bakes on the CPU from start to end.
///
/// # Errors
/// [`Error::Cancelled`] when `progress` asked for it.
pub fn bake(
    cloud: &SurfelCloud,
    directions: usize,
    progress: Progress<'_>,
) -> Result<HarmonicBake> {
    let input = BakeInput::new(cloud, directions);
    let open = bake_harmonic(&input, progress)?;
    Ok(HarmonicBake::from_open(cloud, directions, open))
}

#[cfg(test)]
mod tests {
    use std::ops::ControlFlow;

    use super::*;
    use crate::oracle;
    use crate::progress::no_progress;
    use crate::sh::refining_order;
    use crate::synthetic;

    #[test]
    fn production_follows_the_oracle() {
        let cloud = synthetic::sphere_over_plate(400);
        let input = BakeInput::new(&cloud, 16);
        let open = bake_harmonic(&input, &no_progress).expect("not cancelled");
        let (mut sum, mut far) = (0.0, 0);
        for i in 0..cloud.len() {
            for j in 0..16 {
                let exact = oracle::openness(&input, i, j);
                let difference = (exact - f64::from(open[i * 16 + j]) / 255.0).abs();
                sum += difference;
                far += usize::from(difference > 0.01);
            }
        }
        let count = cloud.len() * 16;
        // Bytes round by 1/510. A texel's centre on the rim of a disc may round to either side: rare, and then up to a tap's worth.
        assert!(sum / (count as f64) < 0.002, "mean {}", sum / count as f64);
        assert!(far * 200 < count, "{far} of {count} differ");
    }

    #[test]
    fn a_convex_object_sees_its_upper_half() {
        let cloud = synthetic::sphere(1500);
        let visibility = bake(&cloud, DEFAULT_DIRECTIONS, &no_progress).expect("not cancelled");
        let lattice = fibonacci_sphere(DEFAULT_DIRECTIONS);
        let mut wrong = 0;
        for (i, n) in visibility.normals.iter().enumerate() {
            for (j, d) in lattice.iter().enumerate() {
                let cosine = n.dot(Vec3::from_array(d.map(|v| v as f32)));
                let open = visibility.open[i * DEFAULT_DIRECTIONS + j] > 127;
                // Within the tilt of one surfel to the next the horizon may go either way.
                wrong += usize::from(cosine.abs() > 0.15 && open != (cosine > 0.0));
            }
        }
        assert!(wrong * 500 < cloud.len() * DEFAULT_DIRECTIONS, "{wrong}");
        let openness = visibility.openness();
        assert!(
            openness.iter().all(|o| *o > 0.9),
            "{:?}",
            openness.iter().copied().fold(1f32, f32::min)
        );
    }

    #[test]
    fn turned_normals_are_turned_back() {
        let mut cloud = synthetic::sphere(1000);
        for i in (0..1000).step_by(3) {
            cloud.tangents[i].swap(0, 1);
            let s = cloud.scales[i];
            cloud.scales[i] = Vec2::new(s.y, s.x);
        }
        let visibility = bake(&cloud, DEFAULT_DIRECTIONS, &no_progress).expect("not cancelled");
        let outward = (0..1000)
            .filter(|i| visibility.normals[*i].dot(cloud.positions[*i]) > 0.0)
            .count();
        assert_eq!(outward, 1000);
        let flipped = visibility.flipped;
        assert!((330..=340).contains(&flipped), "{flipped}");
        assert_eq!(visibility.two_sided.iter().filter(|t| **t).count(), 0);
    }

    #[test]
    fn a_lone_sheet_is_two_sided() {
        let cloud = synthetic::sheet(20);
        let visibility = bake(&cloud, DEFAULT_DIRECTIONS, &no_progress).expect("not cancelled");
        assert!(visibility.two_sided.iter().all(|t| *t));
    }

    #[test]
    fn all_open_projects_to_one() {
        let cloud = synthetic::sphere(10);
        let visibility = HarmonicBake::all_open(&cloud, 16);
        let v = visibility.coefficients(0);
        let one = crate::sh::SQRT_4PI as f32;
        assert!(v.iter().all(|v| (v - one).abs() < 1e-5));
    }

    #[test]
    fn coefficients_and_cosine_transfer_follow_the_oracle() {
        let cloud = synthetic::sphere_over_plate(60);
        let visibility = bake(&cloud, 100, &no_progress).expect("not cancelled");
        for degree in [0, 3, 8] {
            let k = coefficient_count(degree);
            let v = visibility.coefficients(degree);
            let t = visibility.cosine_transfer(degree);
            for i in 0..cloud.len() {
                let exact = oracle::visibility_coefficients(&visibility, i, degree);
                for j in 0..k {
                    // A hundred terms of at most 2 * 4 pi / 100, each rounded by 2^-24 of the sum so far.
                    assert!((f64::from(v[i * k + j]) - exact[j].0).abs() < 1e-4);
                    assert!((f64::from(t[i * k + j]) - exact[j].1).abs() < 1e-4);
                }
            }
        }
    }

    #[test]
    fn a_blurred_visibility_keeps_its_lower_bands() {
        let visibility = bake(&synthetic::sphere(40), 64, &no_progress);
        let visibility = visibility.expect("not cancelled");
        let whole = visibility.coefficients(3);
        let blurred = visibility.of_degree(1).coefficients(3);
        for (w, b) in whole.chunks_exact(16).zip(blurred.chunks_exact(16)) {
            assert_eq!(w[..4], b[..4]);
            assert!(b[4..].iter().all(|v| *v == 0.0) && w[4..].iter().any(|v| *v != 0.0));
        }
    }

    #[test]
    fn light_times_cosine_transfer_is_the_irradiance() {
        // Open sky and a light of degree 2: E(n) by its closed form (paper eq. 3).
        let cloud = synthetic::sphere(40);
        let visibility = HarmonicBake::all_open(&cloud, 4096);
        let transfer = visibility.cosine_transfer(2);
        let light = [1.0f32, 0.3, -0.2, 0.5, 0.1, -0.4, 0.25, 0.05, 0.15];
        for (i, n) in visibility.normals.iter().enumerate() {
            let mut y = [0f32; 9];
            evaluate_basis(n.to_array(), 2, &mut y);
            let exact: f32 = (0..9)
                .map(|j| cosine_kernel(crate::sh::band_of(j)) as f32 * light[j] * y[j])
                .sum();
            let got: f32 = (0..9).map(|j| light[j] * transfer[9 * i + j]).sum();
            // A lattice of N directions integrates a kinked function to about 1/N of its size.
            assert!((got - exact).abs() < 2e-3, "{got} for {exact}");
        }
    }

    #[test]
    fn cancelling_stops() {
        let cloud = synthetic::sphere(100);
        let stop = |_: f64| ControlFlow::Break(());
        let result = bake(&cloud, DEFAULT_DIRECTIONS, &stop);
        assert!(matches!(result, Err(Error::Cancelled)));
    }

    #[test]
    fn an_unfinished_bake_is_close_to_the_finished_one() {
        let cloud = synthetic::sphere_over_plate(1500);
        let whole = bake(&cloud, DEFAULT_DIRECTIONS, &no_progress).expect("a bake");
        let order = refining_order(DEFAULT_DIRECTIONS);
        let mut sorted = order.clone();
        sorted.sort_unstable();
        assert!(sorted.iter().copied().eq(0..DEFAULT_DIRECTIONS));
        assert_eq!(refining_order(20).len(), 20);
        for (share, tolerance) in [(16, 0.12), (64, 0.06)] {
            let mut open = whole.open.clone();
            fill_unfinished(&mut open, DEFAULT_DIRECTIONS, &order[..share]);
            let part = HarmonicBake::from_open(&cloud, DEFAULT_DIRECTIONS, open);
            let error = |a: &[f32], b: &[f32]| {
                let sum: f32 = a.iter().zip(b).map(|(a, b)| (a - b).abs()).sum();
                sum / a.len() as f32
            };
            let error = error(&part.openness(), &whole.openness());
            assert!(error < tolerance, "{share} directions: {error}");
        }
    }
}
