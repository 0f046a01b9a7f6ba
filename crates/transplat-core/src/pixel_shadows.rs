//! Shadows at the pixel: rays from the surface under it to suns and placed lights.
//!
//! In a ratio: of a pixel's linear colour L, to which a light would bring Y if nothing blocked it, and brings X as its surfels see it, becomes
//! L - X + v Y, where v is the visible share of the light from the pixel.

use glam::Vec3;
use rayon::prelude::*;

use crate::bake::trace::Stack;
use crate::camera::Camera;
use crate::numeric::over;
use crate::rasterize::{ColorSpace, PlacedSplat, Raster, Rasterizer, TILE, Tile};
use crate::surfels::SurfelCloud;
use crate::transfer::cast_shadows::{CastShadows, PlacedShadows, SurfacePoint};

/// Least share of a pixel's light that a shadow ray is traced for.
const LEAST_SHARE: f32 = 1e-3;

/// Least alpha of a pixel with a surface.
const LEAST_ALPHA: f32 = 0.02;

/// Attributes of a surfel for a light: linear colour, outward normal, smaller and larger standard deviation, and the linear colour that the light
/// would bring unblocked, and brings.
type Attributes = [f32; 14];

/// Shadows to be cast on an image.
#[derive(Clone, Copy, Debug)]
pub struct PixelShadows<'a> {
    /// Lights, and what they bring the surfels.
    pub shadows: &'a [PlacedShadows],
    /// View of the image.
    pub camera: &'a Camera,
    /// Space of the image's colours.
    pub space: ColorSpace,
}

impl PixelShadows<'_> {
    /// Casts the shadows on an image of `cloud` alone, but for what is `hidden` (`[n]` or empty); `linear` is the surfels' colour in linear light, `[n]`.
    pub fn cast(
        &self,
        cloud: &SurfelCloud,
        hidden: &[bool],
        linear: &[[f32; 3]],
        raster: &mut Raster,
    ) {
        let mut rasterizer = Rasterizer::default();
        rasterizer.project(
            &[PlacedSplat::alone(cloud, self.camera, hidden)],
            self.camera,
        );
        self.cast_on(&rasterizer, |surfel| linear[surfel], raster);
    }

    /// Casts the shadows on an image of what a rasterizer projected, objects after objects; `linear` is a surfel's colour in linear light.
    pub fn cast_on(
        &self,
        rasterizer: &Rasterizer,
        linear: impl Fn(usize) -> [f32; 3] + Sync,
        raster: &mut Raster,
    ) {
        let width = raster.width;
        let [columns, _] = rasterizer.tile_counts();
        let rows = raster.pixels.par_chunks_mut(width * TILE).enumerate();
        rows.for_each(|(row, pixels)| {
            let columns = (0..columns).into_par_iter();
            let factors: Vec<Option<Vec<[f32; 3]>>> = columns
                .map_init(TileScratch::default, |scratch, column| {
                    let change = self.tile_change(rasterizer, [column, row], &linear, scratch)?;
                    Some(self.factors(&change))
                })
                .collect();
            for (y, pixels) in pixels.chunks_exact_mut(width).enumerate() {
                for (x, pixel) in pixels.iter_mut().enumerate() {
                    if let Some(factors) = &factors[x / TILE] {
                        for (v, factor) in pixel.iter_mut().zip(factors[y * TILE + x % TILE]) {
                            *v *= factor;
                        }
                    }
                }
            }
        });
    }

    /// Change of a tile's light; none where no edge of a shadow is near.
    fn tile_change(
        &self,
        rasterizer: &Rasterizer,
        at: [usize; 2],
        linear: &(impl Fn(usize) -> [f32; 3] + Sync),
        scratch: &mut TileScratch,
    ) -> Option<TileChange> {
        let mut change: Option<TileChange> = None;
        for placed in self.shadows {
            let shadows = &placed.shadows;
            let own = |surfel: usize| {
                let is_own = placed.surfels.contains(&surfel);
                is_own.then(|| surfel - placed.surfels.start)
            };
            for light in 0..shadows.lights() {
                let mut surfels = rasterizer.surfels_of_tile(at).filter_map(own);
                if !surfels.any(|surfel| shadows.has_edge(light, surfel)) {
                    continue;
                }
                let attributes = |i: usize| -> Attributes {
                    let color = linear(i);
                    let [r, g, b] = color;
                    let Some(i) = own(i) else {
                        let mut other = [0.0; 14];
                        other[..3].copy_from_slice(&color);
                        return other;
                    };
                    let (lit, (normal, [minor, major])) =
                        (shadows.lit(light, i), shadows.surface(i));
                    let [x, y, z] = normal.to_array();
                    let [lr, lg, lb] = [0, 1, 2].map(|c| color[c] * lit.share[c]);
                    let [sr, sg, sb] = [lr, lg, lb].map(|v| v * lit.seen);
                    [r, g, b, x, y, z, minor, major, lr, lg, lb, sr, sg, sb]
                };
                let tile = rasterizer.attributes_tile(at, &mut scratch.order, attributes)?;
                let change = change.get_or_insert_with(TileChange::none);
                self.add_light(placed, light, at, &tile, &mut scratch.stack, change);
            }
            if let Some(change) = &mut change {
                change.take_gained(shadows);
            }
        }
        change
    }

    /// Adds the change by what a light's rays see from the pixels of a tile.
    fn add_light(
        &self,
        placed: &PlacedShadows,
        light: usize,
        at: [usize; 2],
        tile: &Tile<14>,
        stack: &mut Stack,
        change: &mut TileChange,
    ) {
        let camera = self.camera;
        let object_from_scene = placed.scene_from_object.inverse();
        let object_scale = object_from_scene.transform_vector3(Vec3::X).length();
        let forward = camera.view_from_world.transpose() * Vec3::Z;
        for i in 0..TILE * TILE {
            let (x, y) = (i % TILE, i / TILE);
            let (attributes, alpha, depth) = tile.pixel(x, y);
            let [r, g, b, nx, ny, nz, minor, major, lit @ .., _, _, _] = attributes;
            let [.., sr, sg, sb] = attributes;
            change.linear[i] = [r, g, b].map(|v| over(v, alpha));
            if alpha < LEAST_ALPHA || lit.iter().sum::<f32>() <= LEAST_SHARE * (r + g + b) {
                continue;
            }
            let ray = camera.ray(at[0] * TILE + x, at[1] * TILE + y);
            let position = camera.eye + ray * (depth / ray.dot(forward));
            let toward_camera = object_from_scene.transform_vector3(-ray) / object_scale;
            let own = SurfacePoint {
                position: object_from_scene.transform_point3(position),
                normal: Vec3::new(nx, ny, nz).normalize_or(toward_camera),
                sizes: [minor / alpha, major / alpha],
            };
            let seen = placed.shadows.seen(light, &own, stack);
            let was = [sr, sg, sb];
            for c in 0..3 {
                change.gained[i][c] += over(seen * lit[c] - was[c], attributes[c]);
            }
        }
    }

    /// Factors of a tile's pixels in the image's colours.
    fn factors(&self, change: &TileChange) -> Vec<[f32; 3]> {
        let each = change.linear.iter().zip(&change.factor[..]);
        each.map(|(linear, factor)| {
            let ColorSpace::Display(display) = self.space else {
                return *factor;
            };
            let before = display.encode(*linear);
            let after = display.encode(std::array::from_fn(|c| linear[c] * factor[c]));
            std::array::from_fn(|c| match before[c] > 0.0 {
                true => after[c] / before[c],
                false => 1.0,
            })
        })
        .collect()
    }
}

/// Memory that a thread needs for a tile, used again for the next.
#[derive(Default)]
struct TileScratch {
    order: Vec<u64>,
    stack: Stack,
}

/// A tile's linear colour, and how it changes.
struct TileChange {
    linear: Box<[[f32; 3]; TILE * TILE]>,
    /// Change of one object's light, relative to the colour.
    gained: Box<[[f32; 3]; TILE * TILE]>,
    factor: Box<[[f32; 3]; TILE * TILE]>,
}

impl TileChange {
    fn none() -> Self {
        Self {
            linear: Box::new([[0.0; 3]; TILE * TILE]),
            gained: Box::new([[0.0; 3]; TILE * TILE]),
            factor: Box::new([[1.0; 3]; TILE * TILE]),
        }
    }

    /// Takes the changes of one object's light into the factors.
    fn take_gained(&mut self, shadows: &CastShadows) {
        for (gained, factor) in self.gained.iter_mut().zip(&mut self.factor[..]) {
            let own = shadows.factor(*gained);
            *factor = std::array::from_fn(|c| factor[c] * own[c]);
            *gained = [0.0; 3];
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::Bake;
    use crate::environment::{Emitter, Illumination, LightSample, Shape};
    use crate::progress::no_progress;
    use crate::rasterize::rasterize;
    use crate::settings::{Method, TransferSettings};
    use crate::sh::MAX_DEGREE;
    use crate::synthetic;
    use crate::transfer::{Part, PreparedTransfer, Relit};

    const TOWARD: Vec3 = Vec3::new(0.5, 0.0, 0.866_025_4);

    /// Relights a ball over a slab, captured in even light.
    fn relit(cloud: &SurfelCloud, target: &Illumination) -> Relit {
        let bake = Bake::new(cloud, Method::Directional, 384, &no_progress).expect("small");
        let settings = TransferSettings::of(Method::Directional);
        let even = Illumination::even(MAX_DEGREE);
        let prepared = PreparedTransfer::new(cloud, &bake, &even, &settings).expect("good input");
        prepared.relight(target, Part::Whole).expect("for both")
    }

    /// Share of the pixels of the slab near the edge of the ball's shadow that are on its wrong side, of an image with shadows at the surfels, and at
    /// the pixels.
    fn wrong_sides(target: &Illumination) -> [f64; 2] {
        let cloud = synthetic::sphere_over_slab(1200);
        let relit = relit(&cloud, target);
        assert!(!relit.shadows.is_empty(), "the ball casts one");
        let eye = Vec3::new(-3.0, 0.0, 4.0);
        let camera = Camera::look_at(eye, Vec3::ZERO, Vec3::Z, 0.6, [160, 160], 0.01);
        // They are matte.
        let colors: Vec<[f32; 3]> = (0..cloud.len())
            .map(|i| {
                relit.sh[i * relit.sh.len() / cloud.len()]
                    .map(|v| v / (4.0 * std::f32::consts::PI).sqrt())
            })
            .collect();
        let by_surfel = rasterize(&cloud, &camera, &colors, &[]);
        let mut by_pixel = by_surfel.clone();
        let pixel_shadows = PixelShadows {
            shadows: &relit.shadows,
            camera: &camera,
            space: ColorSpace::Linear,
        };
        pixel_shadows.cast(&cloud, &[], &colors, &mut by_pixel);
        let (ball, radius) = (Vec3::Z * 0.7, 0.5);
        // Distance of a ray from the ball's middle.
        let off = |from: Vec3, d: Vec3| {
            let along = (ball - from).dot(d).max(0.0);
            (from + along * d).distance(ball)
        };
        let at_edge = (0..160 * 160).filter_map(|i| {
            let ray = camera.ray(i % 160, i / 160);
            let place = eye - ray * (eye.z / ray.z);
            let on_slab = place.abs().max_element() < 0.9 && off(eye, ray) > 1.2 * radius;
            let off = off(place, TOWARD) - radius;
            (on_slab && off.abs() < 0.06).then_some((i, off > 0.0))
        });
        let at_edge: Vec<(usize, bool)> = at_edge.collect();
        assert!(at_edge.len() > 100, "{}", at_edge.len());
        [by_surfel, by_pixel].map(|raster| {
            let value = |i: usize| raster.pixels[i][1] / raster.pixels[i][3];
            let ends = at_edge
                .iter()
                .fold([f32::MAX, 0.0], |[low, high]: [f32; 2], (i, _)| {
                    [low.min(value(*i)), high.max(value(*i))]
                });
            let half = 0.5 * (ends[0] + ends[1]);
            let wrong = at_edge.iter().filter(|(i, lit)| (value(*i) > half) != *lit);
            wrong.count() as f64 / at_edge.len() as f64
        })
    }

    /// Surfels of the slab are as large as a ninth of the ball's radius.
    #[test]
    fn the_edge_of_a_shadow_is_where_its_caster_ends() {
        let mut sun = Illumination::even(MAX_DEGREE);
        let light_samples = sun.light_samples.as_mut().expect("for either method");
        light_samples.suns.push(LightSample {
            direction: TOWARD,
            energy: [6.0; 3],
        });
        let placed = Illumination {
            emitters: vec![Emitter {
                shape: Shape::Distant {
                    toward: TOWARD,
                    radius: 0.0,
                },
                emission: [6.0; 3],
            }],
            ..Illumination::even(MAX_DEGREE)
        };
        for target in [sun, placed] {
            let [by_surfel, by_pixel] = wrong_sides(&target);
            // The ball is made of soft discs: their rims move its outline by some hundredths of its radius, of which the margin is an eighth.
            assert!(by_pixel < 0.1, "{by_pixel}");
            assert!(by_pixel < 0.6 * by_surfel, "{by_pixel} for {by_surfel}");
        }
    }

    #[test]
    fn where_light_hardly_changes_shadows_hardly_do() {
        let cloud = synthetic::sphere_over_slab(300);
        let mut sun = Illumination::even(MAX_DEGREE);
        let light_samples = sun.light_samples.as_mut().expect("for either method");
        light_samples.suns.push(LightSample {
            direction: TOWARD,
            energy: [1e-3; 3],
        });
        let shadows = relit(&cloud, &sun).shadows;
        let [r, g, b] = shadows[0].shadows.factor([-0.5; 3]);
        assert!(r == g && g == b && r < 1.0 && r > 0.995, "{r}");
    }
}
