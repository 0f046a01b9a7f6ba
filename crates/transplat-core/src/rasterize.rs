//! Stage *rasterize* on the CPU: 2D surfels and 3D Gaussians as their trainers draw them, in one order, over tiles in parallel.
//!
//! Surfels: Huang et al., "2D Gaussian Splatting for Geometrically Accurate Radiance Fields", SIGGRAPH 2024. A surfel is hit where the
//! pixel's two planes meet its own; a screen-space low-pass keeps those visible that are seen edge-on. 3D Gaussians: Kerbl et al., "3D Gaussian
//! Splatting for Real-Time Radiance Field Rendering", SIGGRAPH 2023, after Zwicker et al., "EWA Volume Splatting", 2001: the projection is
//! linear around the centre, and widened by a low-pass. Front to back by the centres' depth.

mod blend;
mod project;
mod shade;
mod tiles;

use std::sync::atomic::{AtomicU32, Ordering};

use glam::Vec3;
use rayon::prelude::*;

use blend::TileSplat;
pub(crate) use blend::{TILE, Tile};
pub use project::{LEAST_COMPENSATION, LOW_PASS_VARIANCE, MARGIN, MAX_ALPHA};
use project::{ProjectedSurfel, project_surfel};
pub use shade::{ColorSpace, Functions, Shading, shade};
pub use tiles::PlacedSplat;
use tiles::Tiles;

use crate::camera::Camera;
use crate::numeric::over;
use crate::surfels::SurfelCloud;

/// A picture of surfels: premultiplied colour in whatever space the surfels' colours were, alpha, and depth.
#[derive(Clone, Debug, Default)]
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
    /// Makes room for a picture of a size; what is in it is left.
    fn resize(&mut self, width: usize, height: usize) {
        (self.width, self.height) = (width, height);
        self.pixels.resize(width * height, [0.0; 4]);
        self.depth.resize(width * height, 0.0);
    }

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

/// Finds the surface under a pixel: none where the object is mostly transparent. `hidden` `[n]` or empty.
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
            let projected = project_surfel(cloud, camera, i, 1.0)?;
            let (alpha, depth) = projected.at(x, y, camera.near)?;
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
    let mut rasterizer = Rasterizer::default();
    rasterizer.project(&[PlacedSplat::alone(cloud, camera, hidden)], camera);
    let mut raster = Raster::default();
    let of = |surfels: &[usize], out: &mut [[f32; 3]]| {
        for (surfel, out) in surfels.iter().zip(out) {
            *out = colors[*surfel];
        }
    };
    rasterizer.draw(of, &mut raster);
    raster
}

/// Surfels that are blended before it is looked which pixels are finished.
const AT_ONCE: usize = 32;

/// The nearest of a tile are put in order first, so many; then twice as many, and so on until all its pixels are finished.
const FIRST_ORDERED: usize = 128;

/// Draws picture after picture in the same memory.
///
/// Tiles list what touches them, in no order; each then puts as many of the nearest in order as it takes until nothing shines through, and only
/// those are coloured.
#[derive(Debug, Default)]
pub struct Rasterizer {
    tiles: Tiles,
    /// Size of the image, in pixels.
    size: [usize; 2],
    near: f32,
    /// Colours of the projected surfels.
    colors: Vec<LazyColor>,
}

impl Rasterizer {
    /// Puts the objects of a scene on the screen. Their surfels are counted one object after the other.
    pub fn project(&mut self, objects: &[PlacedSplat<'_>], camera: &Camera) {
        self.size = [camera.width, camera.height];
        self.near = camera.near;
        self.tiles.list(objects, self.size);
    }

    /// Number of surfels on the screen.
    pub fn seen(&self) -> usize {
        self.tiles.seen
    }

    /// Draws what was projected. `color` writes the colours of surfels; it is asked where one is seen, of some at once and hardly of any twice.
    pub fn draw(&mut self, color: impl Fn(&[usize], &mut [[f32; 3]]) + Sync, raster: &mut Raster) {
        let [width, height] = self.size;
        raster.resize(width, height);
        let surfels = self.tiles.projected.len();
        self.colors.resize_with(surfels, LazyColor::default);
        self.colors.par_iter_mut().for_each(LazyColor::forget);
        let this = &*self;
        raster
            .pixels
            .par_chunks_mut(width * TILE)
            .zip(raster.depth.par_chunks_mut(width * TILE))
            .enumerate()
            .for_each(|(row, (pixels, depth))| {
                let drawn: Vec<Option<Tile<3>>> = (0..this.tiles.columns)
                    .into_par_iter()
                    .map_init(Scratch::default, |scratch, column| {
                        this.draw_tile([column, row], &color, scratch)
                    })
                    .collect();
                for (y, (pixels, depth)) in pixels
                    .chunks_exact_mut(width)
                    .zip(depth.chunks_exact_mut(width))
                    .enumerate()
                {
                    for (x, (pixel, depth)) in pixels.iter_mut().zip(depth).enumerate() {
                        if let Some(tile) = &drawn[x / TILE] {
                            let ([r, g, b], alpha, middle) = tile.pixel(x % TILE, y);
                            (*pixel, *depth) = ([r, g, b, alpha], middle);
                        } else {
                            (*pixel, *depth) = ([0.0; 4], 0.0);
                        }
                    }
                }
            });
    }

    /// A tile, if anything touches it.
    fn draw_tile<'a>(
        &'a self,
        at: [usize; 2],
        color: &(impl Fn(&[usize], &mut [[f32; 3]]) + Sync),
        scratch: &mut Scratch<'a>,
    ) -> Option<Tile<3>> {
        let mut order = std::mem::take(&mut scratch.order);
        let tile = self.blend_in_order(at, &mut order, |tile, some| {
            self.blend(tile, some, color, scratch);
        });
        scratch.order = order;
        tile
    }

    /// A tile, if anything touches it, into which what comes next is blended, some at once, until it is finished. `order` is scratch.
    fn blend_in_order<const N: usize>(
        &self,
        at: [usize; 2],
        order: &mut Vec<u64>,
        mut blend: impl FnMut(&mut Tile<N>, &[u64]),
    ) -> Option<Tile<N>> {
        let entries = self.tiles.of(at[1] * self.tiles.columns + at[0]);
        if entries.len() == 0 {
            return None;
        }
        order.clear();
        order.extend(entries);
        let mut tile = Tile::new(at.map(|i| i * TILE), self.size, self.tiles.grain);
        let (mut left, mut ordered) = (&mut order[..], FIRST_ORDERED);
        while !left.is_empty() && !tile.is_finished() {
            if left.len() > 2 * ordered {
                left.select_nth_unstable(ordered);
            } else {
                ordered = left.len();
            }
            let (nearest, farther) = left.split_at_mut(ordered);
            nearest.sort_unstable();
            for some in nearest.chunks(AT_ONCE) {
                blend(&mut tile, some);
                if tile.is_finished() {
                    break;
                }
            }
            (left, ordered) = (farther, 2 * ordered);
        }
        Some(tile)
    }

    /// Numbers of tiles across and down.
    pub(crate) fn tile_counts(&self) -> [usize; 2] {
        [self.tiles.columns, self.tiles.rows]
    }

    /// Surfels that touch a tile.
    pub(crate) fn surfels_of_tile(&self, at: [usize; 2]) -> impl Iterator<Item = usize> + '_ {
        let entries = self.tiles.of(at[1] * self.tiles.columns + at[0]);
        entries.map(|entry| self.tiles.projected[entry as u32 as usize].index())
    }

    /// A tile of what is blended like a colour, in the order of its surfels; `attributes` says what that is. `order` is scratch.
    pub(crate) fn attributes_tile<const N: usize>(
        &self,
        at: [usize; 2],
        order: &mut Vec<u64>,
        attributes: impl Fn(usize) -> [f32; N],
    ) -> Option<Tile<N>> {
        let surfel_of = |entry: &u64| &self.tiles.projected[*entry as u32 as usize];
        self.blend_in_order(at, order, |tile, some| {
            let touching = some.iter().map(surfel_of).filter(|s| tile.takes(s.touches));
            let splats: Vec<TileSplat<'_, N>> =
                touching.map(|s| (s, attributes(s.index()))).collect();
            tile.blend(&splats, self.near);
        })
    }

    /// Blends what comes next in a tile.
    fn blend<'a>(
        &'a self,
        tile: &mut Tile<3>,
        entries: &[u64],
        color: &(impl Fn(&[usize], &mut [[f32; 3]]) + Sync),
        scratch: &mut Scratch<'a>,
    ) {
        let Scratch {
            nearest,
            splats,
            asked,
            places,
            answers,
            ..
        } = scratch;
        splats.clear();
        asked.clear();
        places.clear();
        // All are fetched before one is looked at: the memory's latency is paid once.
        nearest.clear();
        nearest.extend(entries.iter().map(|entry| {
            let place = *entry as u32 as usize;
            let surfel = &self.tiles.projected[place];
            (surfel, surfel.touches, self.colors[place].get())
        }));
        for (i, (surfel, touches, color)) in nearest.iter().enumerate() {
            if tile.takes(*touches) {
                if color.is_none() {
                    places.push([i, splats.len()]);
                    asked.push(surfel.index());
                }
                splats.push((surfel, color.unwrap_or_default()));
            }
        }
        if !asked.is_empty() {
            answers.resize(asked.len(), [0.0; 3]);
            color(asked, answers);
            for ([entry, splat], color) in places.iter().zip(answers) {
                splats[*splat].1 = *color;
                self.colors[entries[*entry] as u32 as usize].set(*color);
            }
        }
        tile.blend(splats, self.near);
    }
}

/// A surfel with what is looked at first: what it touches, and its colour where that is known.
type Fetched<'a> = (&'a ProjectedSurfel, [u16; 4], Option<[f32; 3]>);

/// Memory that a thread needs for a tile, used again for the next.
#[derive(Default)]
struct Scratch<'a> {
    order: Vec<u64>,
    nearest: Vec<Fetched<'a>>,
    splats: Vec<TileSplat<'a, 3>>,
    /// Surfels whose colour is not known yet.
    asked: Vec<usize>,
    /// Ranges among the entries and the splats.
    places: Vec<[usize; 2]>,
    answers: Vec<[f32; 3]>,
}

/// A colour that is made where it is first asked for; all who ask make the same.
#[derive(Debug)]
struct LazyColor([AtomicU32; 3]);

/// Marker in place of red where a colour was not requested yet.
const UNKNOWN: u32 = u32::MAX;

impl Default for LazyColor {
    fn default() -> Self {
        Self([const { AtomicU32::new(UNKNOWN) }; 3])
    }
}

impl LazyColor {
    fn forget(&mut self) {
        *self.0[0].get_mut() = UNKNOWN;
    }

    fn get(&self) -> Option<[f32; 3]> {
        let [r, g, b] = &self.0;
        let red = r.load(Ordering::Acquire);
        let rest = || [g, b].map(|channel| channel.load(Ordering::Relaxed));
        (red != UNKNOWN).then(|| {
            let [green, blue] = rest();
            [red, green, blue].map(f32::from_bits)
        })
    }

    fn set(&self, color: [f32; 3]) {
        let [r, g, b] = &self.0;
        let [red, green, blue] = color.map(f32::to_bits);
        g.store(green, Ordering::Relaxed);
        b.store(blue, Ordering::Relaxed);
        // Last, so that who sees it sees the others.
        r.store(red, Ordering::Release);
    }
}

#[cfg(test)]
mod tests {
    use glam::Vec2;

    use super::*;
    use crate::surfels::{MIN_ALPHA, Thickness};
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

    /// A small picture of a dense surface is nearly the same of one in four, twice as large; left as they are, they leave gaps.
    #[test]
    fn few_pixels_need_few_surfels() {
        let cloud = synthetic::sphere(8_000);
        let camera = view(64);
        let color = |surfels: &[usize], out: &mut [[f32; 3]]| {
            for (surfel, out) in surfels.iter().zip(out) {
                *out = cloud.positions[*surfel].map(|v| 0.5 + 0.4 * v).to_array();
            }
        };
        let drawn = |placed: PlacedSplat<'_>| {
            let mut rasterizer = Rasterizer::default();
            rasterizer.project(&[placed], &camera);
            let mut raster = Raster::default();
            rasterizer.draw(color, &mut raster);
            (raster, rasterizer.seen())
        };
        let alone = PlacedSplat::alone(&cloud, &camera, &[]);
        let (all, seen) = drawn(alone);
        let (some, of_those) = drawn(PlacedSplat { one_of: 4, ..alone });
        assert!(
            of_those.abs_diff(seen / 4) < seen / 50,
            "{of_those} of {seen}"
        );
        let off = |of: &Raster| {
            let each = all.pixels.iter().flatten().zip(of.pixels.iter().flatten());
            let squares: f32 = each.map(|(a, b)| (a - b) * (a - b)).sum();
            (squares / all.pixels.len() as f32 / 4.0).sqrt()
        };
        let hidden: Vec<bool> = (0..cloud.len()).map(|i| i % 4 != 0).collect();
        let (gaps, _) = drawn(PlacedSplat {
            hidden: &hidden,
            ..alone
        });
        // What is off is the rim, which grows by half a surfel.
        assert!(off(&some) < 0.06, "{}", off(&some));
        assert!(off(&gaps) > 2.0 * off(&some), "{}", off(&gaps));
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

    /// What each pixel meets, nearest centre first, one after the other.
    fn plainly(cloud: &SurfelCloud, camera: &Camera, colors: &[[f32; 3]]) -> Vec<[f64; 4]> {
        let order = depth_order(&cloud.positions, camera, &[]);
        let projected: Vec<ProjectedSurfel> = order
            .iter()
            .filter_map(|i| project_surfel(cloud, camera, *i as usize, 1.0))
            .collect();
        let pixels = 0..camera.width * camera.height;
        let pixel = |at: usize| {
            let (x, y) = (at % camera.width, at / camera.width);
            let (mut sum, mut through) = ([0f64; 4], 1f64);
            for s in &projected {
                let Some((alpha, _)) = s.at(x, y, camera.near) else {
                    continue;
                };
                let left = through * (1.0 - f64::from(alpha));
                if left < 1e-4 {
                    break;
                }
                for (sum, c) in sum
                    .iter_mut()
                    .zip(colors[s.index()].into_iter().chain([1.0]))
                {
                    *sum += through * f64::from(alpha) * f64::from(c);
                }
                through = left;
            }
            sum
        };
        pixels.map(pixel).collect()
    }

    /// So many in a tile that they are put in order a part at a time, some pixels are finished long before others, and colours are asked for by
    /// several tiles.
    #[test]
    fn tiles_are_what_their_pixels_meet_one_after_the_other() {
        let mut cloud = synthetic::glossy_sphere_over_plate(3000, 1);
        let n = cloud.len();
        for i in 0..n {
            cloud.opacities[i] = [0.05, 0.4, 0.95][i % 3];
            cloud.scales[i] *= [0.5, 1.0, 3.0][i / 3 % 3];
            if i % 2 == 0 {
                cloud.thicknesses[i] = Thickness::of_gaussian(0.02, i % 4 == 0);
            }
        }
        let colors: Vec<[f32; 3]> = (0..n).map(|i| [i as f32 / n as f32, 0.5, 1.0]).collect();
        let camera = Camera::look_at(
            Vec3::new(3.0, 1.0, 1.5),
            Vec3::ZERO,
            Vec3::Z,
            0.9,
            // No whole tiles.
            [75, 41],
            0.02,
        );
        let expected = plainly(&cloud, &camera, &colors);
        let raster = rasterize(&cloud, &camera, &colors, &[]);
        assert!(expected.iter().any(|p| p[3] > 0.999) && expected.iter().any(|p| p[3] == 0.0));
        for (i, (got, expected)) in raster.pixels.iter().zip(&expected).enumerate() {
            for (got, expected) in got.iter().zip(expected) {
                // Where f32 finishes a pixel one surfel earlier or later, a ten-thousandth is left.
                assert!(
                    (f64::from(*got) - expected).abs() < 2e-4,
                    "{i}: {got} {expected}"
                );
            }
        }
    }

    /// Columns beyond what 16 bits count.
    #[test]
    fn a_very_wide_picture_is_drawn_to_its_end() {
        let at = |y: f32| Vec3::new(0.0, y, 0.0);
        let cloud = synthetic::from_points(&[at(1.5), at(-1.5), at(0.0)], &[Vec3::X; 3], 1e-3);
        let eye = Vec3::new(4.0, 0.0, 0.0);
        let camera = Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 1.0, [150_000, 40], 0.02);
        let raster = rasterize(&cloud, &camera, &[[1.0; 3]; 3], &[]);
        for position in &cloud.positions {
            let ([x, y], _) = camera.project(*position);
            assert!((0.0..150_000.0).contains(&x), "{x}");
            let pixel = raster.pixels[y.round() as usize * 150_000 + x.round() as usize];
            assert!(pixel[3] > 0.9, "{x}: {pixel:?}");
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
