//! Stage *probe*: the light at a place in a scene, as the scene's own splat shows it.
//!
//! A picture in all directions from there, its encoding undone (the paper's supplement, section 6, does so by a cube map), and what is beyond the
//! scene where it is open. A capture that was trained on display-encoded pictures ends at white: what was brighter is clipped, and only something
//! else can tell by how much.

use glam::{DMat3, DVec3, Mat3, Vec2, Vec3};

use crate::camera::{Camera, Lens};
use crate::color::{luminance, srgb_decode};
use crate::environment::EnvironmentMap;
use crate::numeric::weighted_quantile;
use crate::rasterize::Raster;
use crate::surfels::UpAxis;

/// Rows of a probe's map, unless another number is asked for.
pub const DEFAULT_ROWS: usize = 128;

/// An encoded value from which a capture is taken to be clipped: half of its noise below white.
pub(crate) const CLIPPED: f32 = 0.98;

/// Samples of a map's pixel along each edge.
pub(crate) const SAMPLES: usize = 3;

/// The six directions of a cube map, each with what is up in its picture.
const FACES: [[Vec3; 2]; 6] = [
    [Vec3::X, Vec3::Z],
    [Vec3::NEG_X, Vec3::Z],
    [Vec3::Y, Vec3::Z],
    [Vec3::NEG_Y, Vec3::Z],
    [Vec3::Z, Vec3::Y],
    [Vec3::NEG_Z, Vec3::Y],
];

/// A light by directions of a scene.
pub type RadianceToward<'a> = &'a dyn Fn(Vec3) -> [f32; 3];

/// Light that a scene does not show.
#[derive(Clone, Copy, Default)]
pub struct Beyond<'a> {
    /// Radiance where the scene is open, by direction in its coordinates; none where that is not known.
    pub environment: Option<RadianceToward<'a>>,
    /// Factor of clipped light, 1 or more.
    pub clipped_gain: f32,
    /// A light like the one that was clipped: brought to the strength of what is not clipped, it stands in where it is the brighter one.
    pub clipped_like: Option<RadianceToward<'a>>,
}

/// A scene as it is seen from a place, in all directions.
pub struct Cube {
    faces: Vec<(Camera, Raster)>,
}

/// The light at a place.
#[derive(Clone, Debug)]
pub struct Probe {
    /// As an environment, with +Z up.
    pub map: EnvironmentMap,
    /// Share of the sphere where the scene is open, 0 to 1.
    pub open_share: f64,
    /// Share of the sphere where the scene's own light is clipped, 0 to 1.
    pub clipped_share: f64,
    /// Share of the scene's own light that comes from there, before anything is done about it.
    pub clipped_light: f64,
}

impl Cube {
    /// Sees a scene from a place: `draw` yields a picture of display-encoded colour for a camera.
    ///
    /// # Errors
    /// As `draw`.
    pub fn seen_from<E>(
        place: Vec3,
        near: f32,
        rows: usize,
        mut draw: impl FnMut(&Camera) -> Result<Raster, E>,
    ) -> Result<Self, E> {
        // A pixel in the middle of a face is as large as one of the map on its equator.
        let edge = (rows * 2 / 3).clamp(16, 2048);
        let faces = FACES.map(|[forward, up]| {
            let camera = Camera {
                view_from_world: Mat3::from_cols(forward.cross(up), -up, forward).transpose(),
                eye: place,
                focal: edge as f32 / 2.0,
                width: edge,
                height: edge,
                near,
                backdrop_focal: edge as f32 / 2.0,
                shift: Vec2::ZERO,
                lens: Lens::default(),
            };
            Ok((camera, draw(&camera)?))
        });
        let faces = faces.into_iter().collect::<Result<_, E>>()?;
        Ok(Self { faces })
    }

    /// Encoded colour and coverage towards a direction.
    pub(crate) fn toward(&self, d: Vec3) -> ([f32; 3], f32) {
        let ahead = |(camera, _): &&(Camera, Raster)| camera.view_from_world.row(2).dot(d);
        let face = (self.faces.iter()).max_by(|a, b| ahead(a).total_cmp(&ahead(b)));
        let Some((camera, raster)) = face else {
            return ([0.0; 3], 0.0);
        };
        let v = camera.view_from_world * d;
        let at = |v: f32, size: usize| {
            let pixel = camera.focal * v + size as f32 / 2.0;
            (pixel.max(0.0) as usize).min(size - 1)
        };
        let (x, y) = (at(v.x / v.z, raster.width), at(v.y / v.z, raster.height));
        let [r, g, b, a] = raster.pixels[y * raster.width + x];
        let straight = [r, g, b].map(|v| if a > 0.0 { v / a } else { 0.0 });
        (straight, a.clamp(0.0, 1.0))
    }

    /// The light that arrives from all around, with what is beyond the scene; `up` is the scene's up axis.
    pub fn light(&self, rows: usize, up: UpAxis, beyond: Beyond<'_>) -> Probe {
        let asset_from_world = up.asset_from_world();
        let (width, height) = (2 * rows, rows);
        let gain = beyond.clipped_gain.max(1.0);
        let like = self.matched(rows, asset_from_world, beyond);
        let blank = EnvironmentMap::new(width, height, vec![[0.0; 3]; width * height]);
        let (mut open, mut clipped, mut light, mut clipped_light) = (0.0, 0.0, 0.0, 0.0);
        let mut pixels = Vec::with_capacity(width * height);
        for i in 0..width * height {
            let (column, row) = (i % width, i / width);
            let share = blank.pixel_solid_angle(row) / (4.0 * std::f64::consts::PI);
            let mut sum = [0f32; 3];
            for sample in 0..SAMPLES * SAMPLES {
                let share = share / (SAMPLES * SAMPLES) as f64;
                let [across, down] = [sample % SAMPLES, sample / SAMPLES]
                    .map(|s| (s as f64 + 0.5) / SAMPLES as f64 - 0.5);
                let d = direction_in(&blank, column as f64 + across, row as f64 + down);
                let d = (asset_from_world * d).as_vec3();
                let (encoded, alpha) = self.toward(d);
                let mut radiance = encoded.map(srgb_decode);
                open += share * f64::from(1.0 - alpha);
                let own = share * f64::from(alpha * luminance(radiance));
                light += own;
                if is_clipped(encoded) {
                    clipped += share * f64::from(alpha);
                    clipped_light += own;
                    radiance = radiance.map(|v| gain * v);
                    if let Some((strength, like)) = like {
                        let like = like(d).map(|v| strength * v);
                        if luminance(like) > luminance(radiance) {
                            radiance = like;
                        }
                    }
                }
                let around = beyond.environment.map_or([0.0; 3], |e| e(d));
                for c in 0..3 {
                    sum[c] += alpha * radiance[c] + (1.0 - alpha) * around[c];
                }
            }
            pixels.push(sum.map(|v| v / (SAMPLES * SAMPLES) as f32));
        }
        Probe {
            map: EnvironmentMap::new(width, height, pixels),
            open_share: open,
            clipped_share: clipped,
            clipped_light: if light > 0.0 {
                clipped_light / light
            } else {
                0.0
            },
        }
    }

    /// A light like the one that was clipped, with what brings it to the strength of what is not clipped.
    fn matched<'a>(
        &self,
        rows: usize,
        asset_from_world: DMat3,
        beyond: Beyond<'a>,
    ) -> Option<(f32, RadianceToward<'a>)> {
        let like = beyond.clipped_like?;
        let mut ratios = Vec::new();
        let blank = EnvironmentMap::new(2 * rows, rows, vec![[0.0; 3]; 2 * rows * rows]);
        for row in 0..rows {
            let omega = blank.pixel_solid_angle(row);
            for column in 0..2 * rows {
                let d = direction_in(&blank, column as f64, row as f64);
                let d = (asset_from_world * d).as_vec3();
                let (encoded, alpha) = self.toward(d);
                if !is_clipped(encoded) && alpha > 0.5 {
                    let own = luminance(encoded.map(srgb_decode));
                    let ratio = f64::from(own / luminance(like(d)));
                    if ratio.is_finite() {
                        ratios.push((ratio, omega));
                    }
                }
            }
        }
        // Around what is clipped the two differ, and the median does not ask by how much.
        let strength = weighted_quantile(ratios, 0.5).unwrap_or(1.0);
        Some((strength as f32, like))
    }
}

fn is_clipped(encoded: [f32; 3]) -> bool {
    encoded.iter().any(|v| *v >= CLIPPED)
}

/// Direction of a point of a map, in pixels.
pub(crate) fn direction_in(map: &EnvironmentMap, column: f64, row: f64) -> DVec3 {
    use std::f64::consts::PI;
    let polar = PI * (row + 0.5) / map.height() as f64;
    let azimuth = PI - 2.0 * PI * (column + 0.5) / map.width() as f64;
    let (sin, cos) = azimuth.sin_cos();
    DVec3::new(polar.sin() * cos, polar.sin() * sin, polar.cos())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::srgb_encode;
    use crate::environment::project_environment;
    use crate::rasterize::{ColorSpace, rasterize, shade};
    use crate::surfels::SurfelCloud;
    use crate::synthetic;

    /// What is seen from a place in a cloud.
    fn seen(cloud: &SurfelCloud, place: Vec3) -> Cube {
        let draw = |camera: &Camera| {
            let space = ColorSpace::Display(Default::default());
            let colors = shade(
                &cloud.positions,
                &cloud.sh,
                cloud.sh_degree,
                cloud.encoding,
                camera.eye,
                space,
            );
            Ok::<_, ()>(rasterize(cloud, camera, &colors, &[]))
        };
        Cube::seen_from(place, 1e-3, 64, draw).expect("drawn")
    }

    /// A room with walls of a radiance, which a function tells by direction.
    fn room(radiance: impl Fn(Vec3) -> f32) -> SurfelCloud {
        let mut room = synthetic::sphere(20_000);
        for i in 0..room.len() {
            let grey = radiance(room.positions[i]);
            room.sh[i] = [grey * crate::sh::SQRT_4PI as f32; 3];
            room.scales[i] *= 2.0;
            room.opacities[i] = 0.999;
        }
        room
    }

    #[test]
    fn a_room_lights_its_middle_from_where_its_walls_are_bright() {
        let walls = |d: Vec3| 0.2 + 0.15 * d.x - 0.1 * d.y + 0.05 * d.z;
        let probe = seen(&room(walls), Vec3::ZERO).light(64, UpAxis::PlusZ, Beyond::default());
        assert!(probe.open_share < 0.01, "{}", probe.open_share);
        assert_eq!(probe.clipped_share, 0.0);
        let light = project_environment(&probe.map, 2);
        let expected = EnvironmentMap::of_directions(128, 64, |d| [walls(d.as_vec3()); 3]);
        let expected = project_environment(&expected, 2);
        for (a, b) in light.coefficients.iter().zip(&expected.coefficients) {
            assert!((a[0] - b[0]).abs() < 0.01, "{a:?} {b:?}");
        }
    }

    #[test]
    fn what_is_beyond_a_scene_shines_in_where_it_is_open_and_up_is_up() {
        // A floor below, in a scene whose up is -y: the sky is above it.
        let mut floor = synthetic::sheet(60);
        floor.sh.fill([0.0; 3]);
        let turn = UpAxis::MinusY.asset_from_world();
        let mut floor = synthetic::turned(&floor, turn);
        floor.up = UpAxis::MinusY;
        let place = 0.2 * UpAxis::MinusY.direction();
        let sky = |_: Vec3| [1.0; 3];
        let beyond = Beyond {
            environment: Some(&sky),
            ..Beyond::default()
        };
        let probe = seen(&floor, place).light(64, floor.up, beyond);
        let (top, bottom) = (probe.map.sample(Vec3::Z), probe.map.sample(-Vec3::Z));
        assert!(top[0] > 0.99 && bottom[0] < 0.05, "{top:?} {bottom:?}");
        assert!(
            (0.5..0.65).contains(&probe.open_share),
            "{}",
            probe.open_share
        );
    }

    #[test]
    fn clipped_light_is_told_of_and_comes_back_from_a_gain_or_a_light_like_it() {
        // A lamp of radiance 20 in a room of 0.1, trained to white.
        let is_lamp = |d: Vec3| d.x > 0.6;
        let truth = |d: Vec3| [if is_lamp(d) { 20f32 } else { 0.1 }; 3];
        let room = room(|d| truth(d)[0].min(1.0));
        let cube = seen(&room, Vec3::ZERO);
        let mean = |beyond| cube.light(64, UpAxis::PlusZ, beyond);
        let plain = mean(Beyond::default());
        assert!(
            (plain.clipped_share - 0.2).abs() < 0.03,
            "{}",
            plain.clipped_share
        );
        let expected = 0.2 / (0.2 + 0.8 * 0.1);
        assert!(
            (plain.clipped_light - expected).abs() < 0.05,
            "{}",
            plain.clipped_light
        );
        let whole = EnvironmentMap::of_directions(128, 64, |d| truth(d.as_vec3()));
        let strength = |map: &EnvironmentMap| project_environment(map, 0).mean_irradiance();
        let lost = strength(&plain.map) / strength(&whole);
        assert!(lost < 0.2, "{lost}");
        // A light like it, of another strength.
        let like = |d: Vec3| truth(d).map(|v| 3.0 * v);
        let gained = mean(Beyond {
            clipped_gain: 20.0,
            ..Beyond::default()
        });
        let matched = mean(Beyond {
            clipped_like: Some(&like),
            ..Beyond::default()
        });
        for probe in [gained, matched] {
            let ratio = strength(&probe.map) / strength(&whole);
            // At its rim the lamp is blended with the wall, and not white.
            assert!((ratio - 1.0).abs() < 0.2, "{ratio}");
        }
        assert!(srgb_encode(1.0) >= CLIPPED);
    }
}
