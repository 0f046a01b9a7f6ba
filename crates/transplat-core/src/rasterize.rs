//! Stage *rasterize* on the CPU: 2D surfels and 3D Gaussians as their trainers draw them, in one order, over tiles in parallel.
//!
//! Surfels: Huang et al., "2D Gaussian Splatting for Geometrically Accurate Radiance Fields", SIGGRAPH 2024. A surfel is hit where the
//! pixel's two planes meet its own; a screen-space low-pass keeps those visible that are seen edge-on. 3D Gaussians: Kerbl et al., "3D Gaussian
//! Splatting for Real-Time Radiance Field Rendering", SIGGRAPH 2023, after Zwicker et al., "EWA Volume Splatting", 2001: the projection is
//! linear around the centre, and widened by a low-pass. Front to back by the centres' depth.

use glam::{Vec2, Vec3};
use rayon::prelude::*;

use crate::camera::Camera;
use crate::color::{Display, Encoding, STORED_OFFSET, radiance};
use crate::numeric::over;
use crate::sh::{coefficient_count, evaluate_sh};
use crate::surfels::{MIN_ALPHA, SurfelCloud, Thickness};

/// Edge of a tile in pixels.
const TILE: usize = 16;

/// A surfel never covers more than this.
pub const MAX_ALPHA: f32 = 0.99;

/// A pixel is finished when less than this would pass through.
pub const MIN_TRANSMITTANCE: f32 = 1e-4;

/// Variance, in pixels squared, that the low-pass adds to a 3D Gaussian on the screen.
pub const LOW_PASS_VARIANCE: f32 = 0.3;

/// Outside of the picture by more than this, a 3D Gaussian is projected as if it were there: its linear projection holds no longer.
pub const MARGIN: f32 = 1.3;

/// Where the opacity is compensated for the low-pass, at least this share of its square is left.
pub const LEAST_COMPENSATION: f32 = 2.5e-5;

/// Where no pixel is: the centre of a low-pass that is not to be seen.
pub const NOWHERE: f32 = 1e15;

/// A picture of surfels: premultiplied colour in whatever space the surfels' colours were, alpha, and depth.
#[derive(Clone, Debug)]
pub struct Raster {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Premultiplied red, green, blue, and alpha. `[height][width]`
    pub pixels: Vec<[f32; 4]>,
    /// Alpha-weighted mean depth of what is hit, in scene units; 0 where nothing is. `[height][width]`
    pub depth: Vec<f32>,
}

impl Raster {
    /// Averages squares of `factor` x `factor` pixels.
    pub fn downsampled(&self, factor: usize) -> Self {
        if factor <= 1 {
            return self.clone();
        }
        let (width, height) = (self.width / factor, self.height / factor);
        let mut out = Self {
            width,
            height,
            pixels: Vec::with_capacity(width * height),
            depth: Vec::with_capacity(width * height),
        };
        let share = 1.0 / (factor * factor) as f32;
        for y in 0..height {
            for x in 0..width {
                let (mut pixel, mut depth) = ([0f32; 4], 0f32);
                for i in 0..factor * factor {
                    let index = (y * factor + i / factor) * self.width + x * factor + i % factor;
                    for (sum, v) in pixel.iter_mut().zip(self.pixels[index]) {
                        *sum += v * share;
                    }
                    depth += self.depth[index] * self.pixels[index][3] * share;
                }
                out.depth.push(over(depth, pixel[3]));
                out.pixels.push(pixel);
            }
        }
        out
    }
}

/// What the colours of a picture are.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum ColorSpace {
    /// Display-encoded, after exposure and tone curve: as splats are trained and blended.
    Display(Display),
    /// Linear radiance, for EXR.
    Linear,
}

/// Colour of each surfel towards `eye`, `[n][3]`: SH once a surfel, towards its centre, clamped below at 0 and not above.
pub fn shade(
    positions: &[Vec3],
    sh: &[[f32; 3]],
    degree: usize,
    encoding: Encoding,
    eye: Vec3,
    space: ColorSpace,
) -> Vec<[f32; 3]> {
    let k = coefficient_count(degree);
    positions
        .par_iter()
        .zip(sh.par_chunks_exact(k))
        .map(|(position, function)| {
            let d = (*position - eye).normalize_or(Vec3::Z).to_array();
            match space {
                // What was trained for display passes untouched.
                ColorSpace::Display(display)
                    if encoding == Encoding::Stored && display.is_identity() =>
                {
                    evaluate_sh(function, degree, d).map(|v| (v + STORED_OFFSET).max(0.0))
                }
                ColorSpace::Display(display) => {
                    display.encode(radiance(function, degree, encoding, d))
                }
                ColorSpace::Linear => radiance(function, degree, encoding, d),
            }
        })
        .collect()
}

/// One surfel on the screen. With `s` the homogeneous point (u, v, 1) of the surfel's plane, a pixel is `(t_u.s, t_v.s) / t_w.s`.
///
/// A 3D Gaussian is on the screen a surfel that lies parallel to it.
#[derive(Clone, Copy, Debug)]
pub struct ProjectedSurfel {
    /// First row of the map from the surfel's plane to homogeneous pixels.
    pub t_u: Vec3,
    /// Second row.
    pub t_v: Vec3,
    /// Third row: depth in the view.
    pub t_w: Vec3,
    /// Centre of the screen-space low-pass.
    pub center: Vec2,
    /// Least and greatest pixel coordinates that it can touch.
    pub low: Vec2,
    /// See `low`.
    pub high: Vec2,
    /// Peak opacity, 0 to 1.
    pub opacity: f32,
    /// Which surfel.
    pub index: u32,
}

/// Centre and half extents of the box around the ellipse `u^2 + v^2 = r2`; `None` where it reaches the camera's plane.
fn ellipse_box(t_u: Vec3, t_v: Vec3, t_w: Vec3, r2: f32) -> Option<(Vec2, Vec2)> {
    let t = Vec3::new(r2, r2, -1.0);
    let d = t.dot(t_w * t_w);
    if d > -1e-12 * t_w.z * t_w.z {
        return None;
    }
    let f = t / d;
    let center = Vec2::new(f.dot(t_u * t_w), f.dot(t_v * t_w));
    let square = Vec2::new(f.dot(t_u * t_u), f.dot(t_v * t_v));
    let half = (center * center - square).max(Vec2::splat(1e-8));
    Some((center, Vec2::new(half.x.sqrt(), half.y.sqrt())))
}

/// Projects one surfel; `None` where it is behind the camera, off the screen or too faint.
pub fn project_surfel(
    cloud: &SurfelCloud,
    camera: &Camera,
    index: usize,
) -> Option<ProjectedSurfel> {
    let opacity = cloud.opacities[index];
    if opacity <= MIN_ALPHA {
        return None;
    }
    let view = camera.view_from_world;
    let p = view * (cloud.positions[index] - camera.eye);
    if p.z <= camera.near {
        return None;
    }
    let a = view * (cloud.tangents[index][0] * cloud.scales[index].x);
    let b = view * (cloud.tangents[index][1] * cloud.scales[index].y);
    let thickness = cloud.thicknesses[index];
    let projected = if thickness.is_flat() {
        project_flat(camera, p, [a, b], opacity)?
    } else {
        let c = view * (cloud.stored_normal(index) * thickness.sigma());
        project_gaussian(camera, p, [a, b, c], opacity, thickness)?
    };
    let size = Vec2::new(camera.width as f32, camera.height as f32);
    let on_screen = projected.high.cmpgt(Vec2::ZERO).all() && projected.low.cmplt(size).all();
    on_screen.then_some(ProjectedSurfel {
        index: index as u32,
        ..projected
    })
}

/// A surfel in the camera's coordinates: centre, and half axes of one standard deviation.
fn project_flat(
    camera: &Camera,
    p: Vec3,
    [a, b]: [Vec3; 2],
    opacity: f32,
) -> Option<ProjectedSurfel> {
    let [cx, cy] = camera.principal_point();
    let t_w = Vec3::new(a.z, b.z, p.z);
    let t_u = camera.focal * Vec3::new(a.x, b.x, p.x) + cx * t_w;
    let t_v = camera.focal * Vec3::new(a.y, b.y, p.y) + cy * t_w;
    // Where alpha falls to 1/255: u^2 + v^2 = 2 ln(255 opacity).
    let r2 = 2.0 * (opacity / MIN_ALPHA).max(1.0001).ln();
    let (center, half) = ellipse_box(t_u, t_v, t_w, r2)?;
    let (low_pass, _) = ellipse_box(t_u, t_v, t_w, 9.0).unwrap_or((center, half));
    let reach = Vec2::splat((r2 / 2.0).sqrt());
    let low = (center - half).min(low_pass - reach);
    let high = (center + half).max(low_pass + reach);
    Some(ProjectedSurfel {
        t_u,
        t_v,
        t_w,
        center: low_pass,
        low,
        high,
        opacity,
        index: 0,
    })
}

/// A 3D Gaussian in the camera's coordinates: centre, and half axes of one standard deviation.
fn project_gaussian(
    camera: &Camera,
    p: Vec3,
    axes: [Vec3; 3],
    opacity: f32,
    thickness: Thickness,
) -> Option<ProjectedSurfel> {
    let limit = MARGIN * 0.5 * Vec2::new(camera.width as f32, camera.height as f32) / camera.focal;
    let slope = p.truncate() / p.z;
    let held = slope.clamp(-limit, limit);
    let to_pixels = camera.focal / p.z;
    // The axes on the screen: columns of the linear projection times the axes.
    let on_screen = axes.map(|axis| to_pixels * (axis.truncate() - held * axis.z));
    let [x, y] = [on_screen.map(|v| v.x), on_screen.map(|v| v.y)].map(Vec3::from_array);
    let (xx, xy, yy) = (x.length_squared(), x.dot(y), y.length_squared());
    // Without cancellation (Cauchy and Binet), however long and thin it is.
    let sharp = x.cross(y).length_squared();
    let determinant = sharp + LOW_PASS_VARIANCE * (xx + yy) + LOW_PASS_VARIANCE * LOW_PASS_VARIANCE;
    let (wide_x, wide_y) = (xx + LOW_PASS_VARIANCE, yy + LOW_PASS_VARIANCE);
    let opacity = if thickness.is_antialiased() {
        opacity * (sharp / determinant).max(LEAST_COMPENSATION).sqrt()
    } else {
        opacity
    };
    if opacity <= MIN_ALPHA || !determinant.is_finite() {
        return None;
    }
    let [cx, cy] = camera.principal_point();
    let center = camera.focal * slope + Vec2::new(cx, cy);
    let r2 = 2.0 * (opacity / MIN_ALPHA).max(1.0001).ln();
    let half = (r2 * Vec2::new(wide_x, wide_y)).map(f32::sqrt);
    // A root of the covariance: it takes a disc to the ellipse.
    let root = wide_x.sqrt();
    Some(ProjectedSurfel {
        t_u: p.z * Vec3::new(root, 0.0, center.x),
        t_v: p.z * Vec3::new(xy / root, (determinant / wide_x).sqrt(), center.y),
        t_w: p.z * Vec3::Z,
        center: Vec2::splat(NOWHERE),
        low: center - half,
        high: center + half,
        opacity,
        index: 0,
    })
}

/// Indices of all surfels in front of the camera, nearest centre first; equal depths keep the file's order.
///
/// `hidden` `[n]` or empty says which surfels are left out.
pub fn depth_order(positions: &[Vec3], camera: &Camera, hidden: &[bool]) -> Vec<u32> {
    let forward = camera.view_from_world.transpose() * Vec3::Z;
    let mut keys: Vec<u64> = positions
        .par_iter()
        .enumerate()
        .filter(|(i, _)| hidden.get(*i).is_none_or(|h| !h))
        .filter_map(|(i, p)| {
            let depth = (*p - camera.eye).dot(forward);
            // Positive floats sort as their bits do.
            (depth > 0.0).then(|| u64::from(depth.to_bits()) << 32 | i as u64)
        })
        .collect();
    keys.par_sort_unstable();
    keys.into_par_iter().map(|key| key as u32).collect()
}

/// The surface under a pixel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pick {
    /// The surfel that adds most to the pixel.
    pub surfel: usize,
    /// Where the ray through the pixel meets that surfel's depth.
    pub position: Vec3,
}

/// What is under a pixel: nothing where the object is mostly transparent. `hidden` `[n]` or empty.
pub fn pick(
    cloud: &SurfelCloud,
    camera: &Camera,
    hidden: &[bool],
    x: usize,
    y: usize,
) -> Option<Pick> {
    let mut hits: Vec<(f32, f32, usize)> = (0..cloud.len())
        .into_par_iter()
        .filter(|i| hidden.get(*i).is_none_or(|h| !h))
        .filter_map(|i| {
            let projected = project_surfel(cloud, camera, i)?;
            let (alpha, depth) = hit(&projected, camera.near, x as f32, y as f32)?;
            Some((depth, alpha, i))
        })
        .collect();
    hits.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
    let mut through = 1f32;
    let mut best: Option<(f32, f32, usize)> = None;
    for (depth, alpha, i) in hits {
        let weight = through * alpha;
        if best.is_none_or(|b| weight > b.0) {
            best = Some((weight, depth, i));
        }
        through *= 1.0 - alpha;
        if through < 0.05 {
            break;
        }
    }
    let (_, depth, surfel) = best.filter(|_| through < 0.5)?;
    let forward = camera.view_from_world.transpose() * Vec3::Z;
    let ray = camera.ray(x, y);
    Some(Pick {
        surfel,
        position: camera.eye + ray * (depth / ray.dot(forward)),
    })
}

/// Draws surfels with given colours `[n][3]`.
///
/// `hidden` `[n]` or empty says which surfels are left out.
///
/// # Panics
/// If there is not one colour a surfel.
pub fn rasterize(
    cloud: &SurfelCloud,
    camera: &Camera,
    colors: &[[f32; 3]],
    hidden: &[bool],
) -> Raster {
    assert_eq!(colors.len(), cloud.len());
    let projected: Vec<ProjectedSurfel> = depth_order(&cloud.positions, camera, hidden)
        .into_par_iter()
        .filter_map(|i| project_surfel(cloud, camera, i as usize))
        .collect();
    let columns = camera.width.div_ceil(TILE);
    let rows = camera.height.div_ceil(TILE);
    let tiles = bin(&projected, columns, rows);
    let mut raster = Raster {
        width: camera.width,
        height: camera.height,
        pixels: vec![[0.0; 4]; camera.width * camera.height],
        depth: vec![0.0; camera.width * camera.height],
    };
    raster
        .pixels
        .par_chunks_mut(camera.width * TILE)
        .zip(raster.depth.par_chunks_mut(camera.width * TILE))
        .enumerate()
        .for_each(|(row, (pixels, depth))| {
            for column in 0..columns {
                let list = tiles.list(row * columns + column);
                let tile = draw_tile(colors, &projected, list, camera, column, row);
                for y in 0..pixels.len() / camera.width {
                    for x in 0..TILE.min(camera.width - column * TILE) {
                        let out = y * camera.width + column * TILE + x;
                        let i = y * TILE + x;
                        let ([r, g, b], alpha) = (tile.color[i], 1.0 - tile.transmittance[i]);
                        pixels[out] = [r, g, b, alpha];
                        depth[out] = over(tile.depth[i], alpha);
                    }
                }
            }
        });
    raster
}

/// For each tile the projected surfels that touch it, in drawing order.
struct TileLists {
    starts: Vec<usize>,
    entries: Vec<u32>,
}

impl TileLists {
    fn list(&self, tile: usize) -> &[u32] {
        &self.entries[self.starts[tile]..self.starts[tile + 1]]
    }
}

fn bin(projected: &[ProjectedSurfel], columns: usize, rows: usize) -> TileLists {
    let span = |low: f32, high: f32, count: usize| {
        let first = (low.max(0.0) as usize / TILE).min(count - 1);
        let last = (high.max(0.0).ceil() as usize / TILE).min(count - 1);
        first..=last
    };
    let touched = |s: &ProjectedSurfel| {
        let across = span(s.low.x, s.high.x, columns);
        span(s.low.y, s.high.y, rows)
            .flat_map(move |row| across.clone().map(move |column| row * columns + column))
    };
    let mut starts = vec![0usize; columns * rows + 1];
    for s in projected {
        for tile in touched(s) {
            starts[tile + 1] += 1;
        }
    }
    for i in 1..starts.len() {
        starts[i] += starts[i - 1];
    }
    let mut next = starts.clone();
    let mut entries = vec![0u32; starts[columns * rows]];
    for (i, s) in projected.iter().enumerate() {
        for tile in touched(s) {
            entries[next[tile]] = i as u32;
            next[tile] += 1;
        }
    }
    TileLists { starts, entries }
}

struct Tile {
    color: [[f32; 3]; TILE * TILE],
    depth: [f32; TILE * TILE],
    transmittance: [f32; TILE * TILE],
    finished: [bool; TILE * TILE],
}

/// Opacity and depth of a surfel at a pixel, or `None` where it adds nothing.
#[inline(always)]
pub fn hit(s: &ProjectedSurfel, near: f32, x: f32, y: f32) -> Option<(f32, f32)> {
    let k = x * s.t_w - s.t_u;
    let l = y * s.t_w - s.t_v;
    let q = k.cross(l);
    let offset = s.center - Vec2::new(x, y);
    let mut rho = 2.0 * offset.length_squared();
    let mut depth = s.t_w.z;
    if q.z != 0.0 {
        let (u, v) = (q.x / q.z, q.y / q.z);
        let on_plane = u * u + v * v;
        if on_plane <= rho {
            rho = on_plane;
            depth = u * s.t_w.x + v * s.t_w.y + s.t_w.z;
        }
    }
    let alpha = (s.opacity * (-0.5 * rho).exp()).min(MAX_ALPHA);
    (depth > near && alpha >= MIN_ALPHA).then_some((alpha, depth))
}

fn draw_tile(
    colors: &[[f32; 3]],
    projected: &[ProjectedSurfel],
    list: &[u32],
    camera: &Camera,
    column: usize,
    row: usize,
) -> Tile {
    let mut tile = Tile {
        color: [[0.0; 3]; TILE * TILE],
        depth: [0.0; TILE * TILE],
        transmittance: [1.0; TILE * TILE],
        finished: [false; TILE * TILE],
    };
    let (x0, y0) = (column * TILE, row * TILE);
    let (x1, y1) = (
        (x0 + TILE).min(camera.width),
        (y0 + TILE).min(camera.height),
    );
    let mut left = (x1 - x0) * (y1 - y0);
    for entry in list {
        let s = &projected[*entry as usize];
        let color = colors[s.index as usize];
        let first = |low: f32, start: usize| (low.ceil().max(0.0) as usize).max(start);
        let until = |high: f32, end: usize| {
            (high.floor().max(-1.0) as i64 + 1).clamp(0, end as i64) as usize
        };
        for y in first(s.low.y, y0)..until(s.high.y, y1) {
            for x in first(s.low.x, x0)..until(s.high.x, x1) {
                let i = (y - y0) * TILE + x - x0;
                if tile.finished[i] {
                    continue;
                }
                let Some((alpha, depth)) = hit(s, camera.near, x as f32, y as f32) else {
                    continue;
                };
                let through = tile.transmittance[i] * (1.0 - alpha);
                if through < MIN_TRANSMITTANCE {
                    tile.finished[i] = true;
                    left -= 1;
                    continue;
                }
                let weight = alpha * tile.transmittance[i];
                for (sum, c) in tile.color[i].iter_mut().zip(color) {
                    *sum += weight * c;
                }
                tile.depth[i] += weight * depth;
                tile.transmittance[i] = through;
            }
        }
        if left == 0 {
            break;
        }
    }
    tile
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic;

    fn view(size: usize) -> Camera {
        Camera::look_at(
            Vec3::new(4.0, 0.0, 0.0),
            Vec3::ZERO,
            Vec3::Z,
            0.7,
            [size, size],
            0.02,
        )
    }

    #[test]
    fn one_surfel_has_its_gaussian_profile() {
        // Facing the camera at distance 4, sigma 0.2: in pixels sigma * focal / 4.
        let cloud = synthetic::from_points(&[Vec3::ZERO], &[Vec3::X], 0.2);
        let camera = view(201);
        let raster = rasterize(&cloud, &camera, &[[1.0, 0.5, 0.0]], &[]);
        let sigma = 0.2 * camera.focal / 4.0;
        for x in 0..201 {
            let r = (x as f32 - 100.0) / sigma;
            let expected = 0.95 * (-0.5 * r * r).exp();
            let [red, green, blue, alpha] = raster.pixels[100 * 201 + x];
            if expected > 1.01 * MIN_ALPHA {
                assert!(
                    (alpha - expected).abs() < 1e-4,
                    "{x}: {alpha} for {expected}"
                );
                assert!(
                    (red - alpha).abs() < 1e-6 && (green - alpha / 2.0).abs() < 1e-6 && blue == 0.0
                );
                assert!((raster.depth[100 * 201 + x] - 4.0).abs() < 1e-3);
            } else if expected < 0.99 * MIN_ALPHA {
                assert_eq!(alpha, 0.0);
            }
        }
    }

    #[test]
    fn an_edge_on_surfel_stays_visible() {
        let cloud = synthetic::from_points(&[Vec3::ZERO], &[Vec3::Y], 0.2);
        let raster = rasterize(&cloud, &view(200), &[[1.0; 3]], &[]);
        let most = raster.pixels.iter().map(|p| p[3]).fold(0f32, f32::max);
        assert!(most > 0.3, "{most}");
    }

    #[test]
    fn the_nearer_surfel_wins_whatever_the_order_in_the_file() {
        let (near, far) = (Vec3::new(1.0, 0.0, 0.0), Vec3::new(-1.0, 0.0, 0.0));
        let (red, green) = ([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]);
        let one = synthetic::from_points(&[near, far], &[Vec3::X; 2], 0.5);
        let other = synthetic::from_points(&[far, near], &[Vec3::X; 2], 0.5);
        let a = rasterize(&one, &view(50), &[red, green], &[]);
        let b = rasterize(&other, &view(50), &[green, red], &[]);
        assert_eq!(a.pixels, b.pixels);
        let middle = a.pixels[25 * 50 + 25];
        assert!(middle[0] > 0.9 && middle[1] < 0.06);
    }

    #[test]
    fn a_sphere_is_opaque_and_round() {
        let cloud = synthetic::sphere(3000);
        let camera = view(100);
        let raster = rasterize(&cloud, &camera, &vec![[1.0; 3]; 3000], &[]);
        for y in 0..100 {
            for x in 0..100 {
                let r = ((x as f32 - 49.5).hypot(y as f32 - 49.5)) / camera.focal;
                // The silhouette of a unit sphere from distance 4 is at tan(asin(1/4)).
                let edge = 0.25f32.asin().tan();
                let alpha = raster.pixels[y * 100 + x][3];
                if r < 0.9 * edge {
                    assert!(alpha > 0.97, "hole at {x} {y}: {alpha}");
                    let depth = raster.depth[y * 100 + x];
                    assert!((2.9..4.0).contains(&depth), "{depth}");
                } else if r > 1.3 * edge {
                    assert_eq!(alpha, 0.0);
                }
            }
        }
    }

    /// The covariance on the screen by matrices, in f64, as Kerbl et al. (2023) write it.
    fn screen_covariance(cloud: &SurfelCloud, camera: &Camera) -> [[f64; 2]; 2] {
        let view = camera.view_from_world.as_dmat3();
        let p = view * (cloud.positions[0] - camera.eye).as_dvec3();
        let [u, v] = cloud.tangents[0].map(|t| t.as_dvec3());
        let sigmas = cloud.scales[0].extend(cloud.thicknesses[0].sigma());
        let axes = glam::DMat3::from_cols(u, v, u.cross(v));
        let root = view * axes * glam::DMat3::from_diagonal(sigmas.as_dvec3());
        let covariance = root * root.transpose();
        let f = f64::from(camera.focal);
        let rows = [
            glam::DVec3::new(f / p.z, 0.0, -f * p.x / (p.z * p.z)),
            glam::DVec3::new(0.0, f / p.z, -f * p.y / (p.z * p.z)),
        ];
        let entry =
            |i: usize, j: usize| rows[i].dot(covariance * rows[j]) + if i == j { 0.3 } else { 0.0 };
        [[entry(0, 0), entry(0, 1)], [entry(1, 0), entry(1, 1)]]
    }

    #[test]
    fn a_3d_gaussian_has_the_profile_of_its_projected_covariance() {
        let center = Vec3::new(0.3, -0.4, 0.25);
        let normal = Vec3::new(0.6, -0.3, 0.7).normalize();
        // Round, a needle, a speck that is smaller than a pixel.
        for (scale, sigma) in [
            ([0.2, 0.1], 0.05),
            ([0.5, 1e-5], 1e-6),
            ([1e-3, 2e-3], 5e-4),
        ] {
            for is_antialiased in [false, true] {
                let mut cloud = synthetic::from_points(&[center], &[normal], 0.1);
                cloud.scales[0] = Vec2::from_array(scale);
                cloud.thicknesses[0] = Thickness::of_gaussian(sigma, is_antialiased);
                let camera = view(200);
                let [[a, b], [_, c]] = screen_covariance(&cloud, &camera);
                let determinant = a * c - b * b;
                let without = (a - 0.3) * (c - 0.3) - b * b;
                let compensation = (without / determinant).max(2.5e-5).sqrt();
                let peak = 0.95 * if is_antialiased { compensation } else { 1.0 };
                let p = camera.view_from_world * (center - camera.eye);
                let [mx, my] = camera.principal_point();
                let middle = camera.focal * p.truncate() / p.z + Vec2::new(mx, my);
                let raster = rasterize(&cloud, &camera, &[[1.0; 3]], &[]);
                let mut drawn = 0;
                for (i, pixel) in raster.pixels.iter().enumerate() {
                    let x = f64::from((i % 200) as f32 - middle.x);
                    let y = f64::from((i / 200) as f32 - middle.y);
                    let rho = (c * x * x - 2.0 * b * x * y + a * y * y) / determinant;
                    let expected = (peak * (-0.5 * rho).exp()) as f32;
                    // Where it ends, either is right.
                    if (expected - MIN_ALPHA).abs() > 1e-3 {
                        let expected = if expected > MIN_ALPHA { expected } else { 0.0 };
                        assert!(
                            (pixel[3] - expected).abs() < 1e-3,
                            "{scale:?} {is_antialiased} at {i}: {} for {expected}",
                            pixel[3]
                        );
                        drawn += usize::from(expected > 0.0);
                    }
                }
                assert!(drawn > 0 || peak < 0.02, "{scale:?}");
            }
        }
    }

    #[test]
    fn surfels_and_3d_gaussians_are_drawn_in_one_order() {
        let (near, far) = (Vec3::new(1.0, 0.0, 0.0), Vec3::new(-1.0, 0.0, 0.0));
        for gaussian in [0, 1] {
            let mut cloud = synthetic::from_points(&[near, far], &[Vec3::X; 2], 0.5);
            cloud.thicknesses[gaussian] = Thickness::of_gaussian(0.1, false);
            let raster = rasterize(&cloud, &view(50), &[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], &[]);
            let middle = raster.pixels[25 * 50 + 25];
            assert!(middle[0] > 0.9 && middle[1] < 0.06, "{middle:?}");
        }
    }

    #[test]
    fn surfels_behind_or_around_the_camera_do_no_harm() {
        let mut cloud = synthetic::sphere(200);
        cloud.scales.fill(Vec2::splat(5.0));
        for thickness in cloud.thicknesses.iter_mut().step_by(2) {
            *thickness = Thickness::of_gaussian(3.0, false);
        }
        let inside = Camera::look_at(Vec3::ZERO, Vec3::X, Vec3::Z, 1.0, [40, 40], 0.02);
        for camera in [view(40), inside] {
            let raster = rasterize(&cloud, &camera, &vec![[1.0; 3]; 200], &[]);
            assert!(raster.pixels.iter().flatten().all(|v| v.is_finite()));
        }
    }
}
