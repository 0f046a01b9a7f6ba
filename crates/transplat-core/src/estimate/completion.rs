//! Completion of a panorama whose highlights are clipped: the shading of the capture shows how bright they were.
//!
//! Clipped pixels were at least as bright as they are shown. What they had beyond that is fitted like any light ([`super::fit`]), and a sun is looked for
//! where the panorama is clipped.

use glam::{DMat3, DVec3, Vec3};
use rayon::prelude::*;

use crate::capture_environment::{clipped_radiance, is_clipped};
use crate::color::{luminance, srgb_decode};
use crate::environment::EnvironmentMap;
use crate::probe::CLIPPED;

/// Radius of the disc that stands for a sun in a map, in degrees.
const DRAWN_SUN: f64 = 2.0;

/// Exposure of a completed panorama.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FoundExposure {
    /// Its unit is known.
    Known,
    /// Factor that the shading shows.
    Found(f32),
    /// The shading does not show it.
    Unknown,
}

impl FoundExposure {
    /// Factor that the shading shows.
    pub fn found(self) -> Option<f32> {
        match self {
            Self::Found(factor) => Some(factor),
            Self::Known | Self::Unknown => None,
        }
    }
}

/// A completed panorama.
#[derive(Clone, Debug)]
pub struct CompletedMap {
    /// The panorama in its own rotation; in the unit of the cloud's colours where its exposure was found, or else in its own.
    pub map: EnvironmentMap,
    /// All of its light over that of the clipped one, at the same exposure.
    pub gain: f32,
    /// Its exposure, which is in it already.
    pub exposure: FoundExposure,
}

/// Radiance from which on a map is clipped.
pub(super) fn white_of(map: &EnvironmentMap) -> f32 {
    srgb_decode(CLIPPED) * map.pixels().iter().flatten().copied().fold(0.0, f32::max)
}

/// Completes the clipped pixels of a map: by the logarithm of what is uncertain of them, and a sun's direction and energy.
pub(super) fn completed(
    map: &EnvironmentMap,
    white: f32,
    log: &(dyn Fn(Vec3) -> [f32; 3] + Sync),
    sun: Option<(Vec3, [f32; 3])>,
    exposure: FoundExposure,
    to_asset: DMat3,
) -> CompletedMap {
    let direction = |i: usize| {
        let d = map.direction(i % map.width(), i / map.width());
        (to_asset * DVec3::from_array(d)).as_vec3()
    };
    let factor = exposure.found().unwrap_or(1.0);
    let radiance = |(i, pixel): (usize, &[f32; 3])| {
        let radiance = match is_clipped(*pixel, white) {
            true => clipped_radiance(*pixel).changed(log(direction(i)), 0.0),
            false => *pixel,
        };
        radiance.map(|v| factor * v)
    };
    let pixels = map.pixels().par_iter().enumerate();
    let mut pixels: Vec<[f32; 3]> = pixels.map(radiance).collect();
    if let Some((toward, energy)) = sun {
        draw_sun(map, &mut pixels, toward, energy, &direction);
    }
    let light = |pixels: &[[f32; 3]]| -> f64 {
        let omega = |i: usize| map.pixel_solid_angle(i / map.width());
        let each = pixels.iter().enumerate();
        each.map(|(i, p)| omega(i) * f64::from(luminance(*p))).sum()
    };
    let shown = f64::from(factor) * light(map.pixels());
    CompletedMap {
        gain: (light(&pixels) / shown.max(f64::MIN_POSITIVE)) as f32,
        map: map.with_pixels(pixels),
        exposure,
    }
}

/// Adds a sun of some energy to a map's pixels, as a small disc; `direction` of each pixel, in the sun's coordinates.
pub(super) fn draw_sun(
    map: &EnvironmentMap,
    pixels: &mut [[f32; 3]],
    toward: Vec3,
    energy: [f32; 3],
    direction: &dyn Fn(usize) -> Vec3,
) {
    let edge = DRAWN_SUN.to_radians().cos() as f32;
    let mut disc: Vec<usize> = (0..pixels.len())
        .filter(|i| direction(*i).dot(toward) > edge)
        .collect();
    if disc.is_empty() {
        // The pixels of a coarse map are larger than the disc.
        let nearer = |a: &usize, b: &usize| {
            let [a, b] = [a, b].map(|i| direction(*i).dot(toward));
            a.total_cmp(&b)
        };
        disc.extend((0..pixels.len()).max_by(nearer));
    }
    let omega = |i: &usize| map.pixel_solid_angle(i / map.width());
    let solid_angle: f64 = disc.iter().map(omega).sum();
    for i in disc {
        for c in 0..3 {
            pixels[i][c] += energy[c] / solid_angle as f32;
        }
    }
}
