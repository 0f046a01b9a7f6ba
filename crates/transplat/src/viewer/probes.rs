//! Light probes: a grey and a mirror ball under each light, and each environment beside what the transfer takes of it.

use eframe::egui::{self, Color32, ColorImage, TextureHandle};
use glam::{DVec3, Mat3, Vec3};
use rayon::prelude::*;
use transplat_core::bake::strata::directions;
use transplat_core::color::Display;
use transplat_core::environment::{
    Emitter, EnvironmentMap, Illumination, IncidentRadiance, Mosaic,
};
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::sh::{band_of, cosine_kernel, evaluate_sh};

use transplat_engine::environments::Environment;
use transplat_engine::object::OrientedLight;

/// Pixels across a ball.
const BALL: usize = 64;

/// Reflectance of the grey ball.
const GREY: f32 = 0.5;

/// Pixels across a map, and across what a ball mirrors.
pub const MAP_WIDTH: usize = 128;

/// All that the pictures of one light depend on.
#[derive(Clone, PartialEq)]
pub struct ProbeKey {
    /// Another one whenever the light changes.
    pub oriented: OrientedLight,
    /// Where the balls are, in the Z-up world.
    pub place: DVec3,
    pub transfer: TransferSettings,
    pub display: Display,
    /// From the view's coordinates to the Z-up world's.
    pub world_from_view: Mat3,
}

/// Environment of the probe balls, in the Z-up world.
pub struct BallEnvironment {
    /// As it arrives there.
    light: Illumination,
    /// Emitters that are near.
    near: Vec<Emitter>,
    /// All that shines.
    map: EnvironmentMap,
}

impl BallEnvironment {
    /// A light, and the map of all that is of it, at a place.
    pub fn new(light: Illumination, map: EnvironmentMap, place: DVec3) -> Self {
        Self {
            light: light.at_one_place(place.as_vec3()).into_owned(),
            near: light.emitters,
            map,
        }
    }
}

/// The pictures of one light.
pub struct ProbeBall {
    key: ProbeKey,
    around: BallEnvironment,
    pub grey: TextureHandle,
    pub mirror: TextureHandle,
    pub map: TextureHandle,
    pub seen: TextureHandle,
}

impl ProbeBall {
    /// Keeps the pictures up to date.
    pub fn update(
        probe: &mut Option<Self>,
        context: &egui::Context,
        name: &str,
        key: ProbeKey,
        around: impl FnOnce() -> BallEnvironment,
    ) {
        if probe.as_ref().is_some_and(|p| p.key == key) {
            return;
        }
        // The maps do not turn with the camera.
        let kept = probe.take().filter(|p| {
            let turned = ProbeKey {
                world_from_view: key.world_from_view,
                ..p.key.clone()
            };
            turned == key
        });
        let (around, maps) = match kept {
            Some(kept) => (kept.around, Some((kept.map, kept.seen))),
            None => (around(), None),
        };
        let encode = |radiance: [f32; 3]| color(key.display.encode(radiance));
        let radiance = &around.light.radiance;
        let irradiance = convolved(radiance);
        let grey = ball(|normal, _| {
            let n = (key.world_from_view * normal).to_array();
            let e = evaluate_sh(&irradiance, radiance.degree, n);
            encode(e.map(|e| GREY / std::f32::consts::PI * e.max(0.0)))
        });
        let mirror = ball(|normal, towards| {
            let away = -towards;
            let reflected = away - 2.0 * away.dot(normal) * normal;
            encode(around.map.sample(key.world_from_view * reflected))
        });
        let load = |part: &str, image: ColorImage| {
            context.load_texture(
                format!("{name} {part}"),
                image,
                egui::TextureOptions::LINEAR,
            )
        };
        // One beside the other: what is lost is seen at once.
        let draw_maps = || {
            let taken = taken_in(&around.light, &key.transfer);
            let size = [MAP_WIDTH, MAP_WIDTH / 2];
            let taken = EnvironmentMap::of_directions(size[0], size[1], |d| taken(d.as_vec3()));
            // What is near is traced as it is by one method, and is in the series of the other.
            let near: &[Emitter] = match key.transfer.method {
                Method::Directional => &around.near,
                Method::Harmonic => &[],
            };
            let taken = taken.with_lights(near, key.place.as_vec3());
            let [map, seen] = [&around.map, &taken].map(|map| image(map, encode));
            (load("map", map), load("seen", seen))
        };
        let (map, seen) = maps.unwrap_or_else(draw_maps);
        let (grey, mirror) = (load("grey", grey), load("mirror", mirror));
        *probe = Some(Self {
            key,
            around,
            grey,
            mirror,
            map,
            seen,
        });
    }
}

/// Radiance from a direction as far as the transfer knows it.
fn taken_in<'a>(
    light: &'a Illumination,
    transfer: &TransferSettings,
) -> Box<dyn Fn(Vec3) -> [f32; 3] + Sync + 'a> {
    let terms = transfer.terms;
    match &light.light_samples {
        Some(light_samples) if transfer.method == Method::Directional && terms.sums => {
            let mosaic = if terms.suns {
                Mosaic::new(light_samples, &directions())
            } else {
                Mosaic::new(&light_samples.with_suns_as_sky(), &directions())
            };
            Box::new(move |d| mosaic.radiance(d))
        }
        _ => {
            let series = light.radiance.truncated(transfer.sh_degree);
            Box::new(move |d| {
                let radiance = evaluate_sh(&series.coefficients, series.degree, d.to_array());
                radiance.map(|v| v.max(0.0))
            })
        }
    }
}

/// A map as a picture.
pub fn image(map: &EnvironmentMap, encode: impl Fn([f32; 3]) -> Color32 + Sync) -> ColorImage {
    picture([map.width(), map.height()], |x, y| {
        encode(map.pixels()[y * map.width() + x])
    })
}

/// Irradiance coefficients: each band times the cosine's.
fn convolved(light: &IncidentRadiance) -> Vec<[f32; 3]> {
    light
        .coefficients
        .iter()
        .enumerate()
        .map(|(i, c)| c.map(|v| v * cosine_kernel(band_of(i)) as f32))
        .collect()
}

/// A ball seen from far away: `shade` gets the normal and the direction to the eye, in the view's coordinates.
fn ball(shade: impl Fn(Vec3, Vec3) -> Color32 + Sync) -> ColorImage {
    picture([BALL, BALL], |x, y| {
        let at = |v: usize| (v as f32 + 0.5) / BALL as f32 * 2.0 - 1.0;
        let (x, y) = (at(x), at(y));
        let r2 = x * x + y * y;
        let edge = 1.0 / BALL as f32;
        let cover = ((1.0 - r2.sqrt()) / edge).clamp(0.0, 1.0);
        if cover <= 0.0 {
            return Color32::TRANSPARENT;
        }
        let normal = Vec3::new(x, y, -(1.0 - r2).max(0.0).sqrt()).normalize();
        shade(normal, Vec3::NEG_Z).gamma_multiply(cover)
    })
}

fn picture(size: [usize; 2], pixel: impl Fn(usize, usize) -> Color32 + Sync) -> ColorImage {
    let pixels = (0..size[0] * size[1])
        .into_par_iter()
        .map(|i| pixel(i % size[0], i / size[0]))
        .collect();
    ColorImage::new(size, pixels)
}

/// A display-encoded colour.
pub fn color(encoded: [f32; 3]) -> Color32 {
    let [r, g, b] = encoded.map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
    Color32::from_rgb(r, g, b)
}

/// A light's thumbnail, at an exposure of its own.
pub fn thumbnail(context: &egui::Context, light: &Environment, width: usize) -> TextureHandle {
    let map: EnvironmentMap = light.small.reduced(width);
    let display = Display::default();
    let image = image(&map, |radiance| {
        color(display.encode(radiance.map(|v| v * light.thumbnail_gain)))
    });
    let name = light.path.display().to_string();
    context.load_texture(name, image, egui::TextureOptions::LINEAR)
}
