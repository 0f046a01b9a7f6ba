//! What the method sees of the lights: a grey and a mirror ball under each, and each environment beside what the transfer takes of it.

use eframe::egui::{self, Color32, ColorImage, TextureHandle};
use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;
use transplat_core::bake::patches::directions;
use transplat_core::color::Display;
use transplat_core::environment::{EnvironmentMap, Illumination, IncidentRadiance, Mosaic};
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::sh::{band_of, cosine_kernel, evaluate_sh};

use super::environments::Environment;
use super::object::OrientedLight;

/// Pixels across a ball.
const BALL: usize = 64;

/// Reflectance of the grey ball.
const GREY: f32 = 0.5;

/// Pixels across a map.
const MAP_WIDTH: usize = 128;

/// All that the pictures of one light depend on.
#[derive(Clone, PartialEq)]
pub struct Key {
    pub light: u64,
    pub oriented: OrientedLight,
    /// Where the balls are, for what is near: in the coordinates of the light.
    pub place: Vec3,
    pub transfer: TransferSettings,
    pub map_from_asset: DMat3,
    pub gain: [f32; 3],
    pub display: Display,
    /// Rows of the camera's rotation.
    pub view: glam::Mat3,
}

/// The pictures of one light.
pub struct Probe {
    key: Key,
    pub grey: TextureHandle,
    pub mirror: TextureHandle,
    pub map: TextureHandle,
    pub seen: TextureHandle,
}

impl Probe {
    /// Keeps the pictures up to date.
    pub fn update(
        probe: &mut Option<Self>,
        context: &egui::Context,
        name: &str,
        key: Key,
        light: &Environment,
    ) {
        if probe.as_ref().is_some_and(|p| p.key == key) {
            return;
        }
        // The maps do not turn with the camera.
        let maps = probe.as_ref().filter(|p| {
            let turned = Key {
                view: key.view,
                ..p.key.clone()
            };
            turned == key
        });
        let maps = maps.map(|p| (p.map.clone(), p.seen.clone()));
        let encode = |radiance: [f32; 3]| color(key.display.encode(radiance));
        let turn = key.map_from_asset.as_mat3();
        let seen = |d: Vec3| -> [f32; 3] {
            let radiance = light.small.sample(turn * d);
            std::array::from_fn(|c| radiance[c] * key.gain[c])
        };
        let radiance = &key.oriented.light.at_one_place(key.place).radiance;
        let irradiance = convolved(radiance);
        let asset_from_view = key.view.transpose();
        let grey = ball(|normal, _| {
            let n = (asset_from_view * normal).to_array();
            let e = evaluate_sh(&irradiance, radiance.degree, n);
            encode(e.map(|e| GREY / std::f32::consts::PI * e.max(0.0)))
        });
        let mirror = ball(|normal, towards| {
            let away = -towards;
            let reflected = away - 2.0 * away.dot(normal) * normal;
            encode(seen(asset_from_view * reflected))
        });
        let load = |part: &str, image: ColorImage| {
            context.load_texture(
                format!("{name} {part}"),
                image,
                egui::TextureOptions::LINEAR,
            )
        };
        // The maps as they lie in their file, one beside the other: what is lost is seen at once.
        let draw_maps = || {
            let radiance = |d: DVec3| {
                let radiance = light.small.sample(d.as_vec3());
                std::array::from_fn(|c| radiance[c] * key.gain[c])
            };
            let asset_from_map = turn.transpose();
            let taken = taken_in(&key.oriented.light, &key.transfer);
            let of = |radiance: &(dyn Fn(DVec3) -> [f32; 3] + Sync)| {
                let map = EnvironmentMap::of_directions(MAP_WIDTH, MAP_WIDTH / 2, radiance);
                image(&map, encode)
            };
            let map = of(&radiance);
            let seen = of(&|d| taken(asset_from_map * d.as_vec3()));
            (load("map", map), load("seen", seen))
        };
        let (map, seen) = maps.unwrap_or_else(draw_maps);
        let (grey, mirror) = (load("grey", grey), load("mirror", mirror));
        *probe = Some(Self {
            key,
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
    match &light.beams {
        Some(beams) if transfer.method == Method::Directional && terms.sums => {
            let mosaic = if terms.suns {
                Mosaic::new(beams, &directions())
            } else {
                Mosaic::new(&beams.with_suns_as_sky(), &directions())
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
