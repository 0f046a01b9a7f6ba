//! Environment light as it is set: file, rotation, tilt, strength, tint.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

use crate::environment::{EnvironmentMap, Illumination, ImageReading, Layout, Sky};
use crate::error::{Result, ensure};
use crate::surfels::UpAxis;

/// Range of exposure and strength in stops: 18 orders of magnitude either way.
pub const STOPS: std::ops::RangeInclusive<f32> = -60.0..=60.0;

/// The name that stands for uniform white light where a file is expected.
pub const EVEN: &str = "even";

/// The name that stands for the light that the asset itself tells of.
pub const ESTIMATE: &str = "estimate";

/// The name that stands for the light of sun and sky.
pub const SKY: &str = "sky";

/// Light from all around: which environment, how it is turned, how strong it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct EnvironmentLight {
    /// The environment's file, or `even`, of the source `estimate`, or of the target `sky`; none where the look leaves it open.
    pub file: Option<PathBuf>,
    /// Sun and sky, where the file is `sky`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub sky: Option<Sky>,
    /// Layout of its image; none for that of its shape.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layout: Option<Layout>,
    /// Layer or part of an OpenEXR file; none for the one that its names suggest.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layer: Option<String>,
    /// Without the suns in its picture, which may be among the lights instead.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub without_suns: bool,
    /// Turn about the up axis, in degrees, counter-clockwise seen from above.
    pub rotation: f64,
    /// Tilt about the world's X axis, before the turn, in degrees.
    pub tilt: f64,
    /// Mirrored left to right.
    pub mirror: bool,
    /// Axis of the map that points up; a map is drawn with +Z up.
    pub up: UpAxis,
    /// Strength in stops.
    pub strength: f32,
    /// Colour that the light is multiplied by, linear.
    pub tint: [f32; 3],
    /// User-set trust in a capture light: see [`Illumination::trust`].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trust: Option<f32>,
    /// True where the image of a capture light is clipped, and completed from the shading; none for what its file says.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub clipped: Option<bool>,
}

impl Default for EnvironmentLight {
    fn default() -> Self {
        Self {
            file: None,
            sky: None,
            layout: None,
            layer: None,
            without_suns: false,
            rotation: 0.0,
            tilt: 0.0,
            mirror: false,
            up: UpAxis::default(),
            strength: 0.0,
            tint: [1.0; 3],
            trust: None,
            clipped: None,
        }
    }
}

/// An angle in degrees from -180 to 180.
pub fn wrap(degrees: f64) -> f64 {
    (degrees + 180.0).rem_euclid(360.0) - 180.0
}

/// Largest tilt that brings something of a light to where it is wanted, in degrees: beyond that its world lies on its side.
pub const MOST_TILT: f64 = 60.0;

impl EnvironmentLight {
    /// A light as it is.
    pub fn of(file: impl Into<PathBuf>) -> Self {
        Self {
            file: Some(file.into()),
            ..Self::default()
        }
    }

    /// True for the light that is estimated from the splat.
    pub fn is_estimate(&self) -> bool {
        self.file.as_deref().is_some_and(is_estimate)
    }

    /// The light of sun and sky, if it is that.
    pub fn sky(&self) -> Option<Sky> {
        let is_it = self.file.as_deref().is_some_and(is_sky);
        is_it.then(|| self.sky.unwrap_or_default())
    }

    /// Layout and layer of its file, where they are set.
    pub fn reading(&self) -> ImageReading {
        ImageReading {
            layout: self.layout,
            layer: self.layer.clone(),
        }
    }

    /// Sets how its file is read.
    pub fn set_reading(&mut self, reading: &ImageReading) {
        self.layout = reading.layout;
        self.layer.clone_from(&reading.layer);
    }

    /// Takes another light. The estimate comes as the asset sees it, even light and the sky are no pictures: how a map was turned, and how strong
    /// it was, is nothing to them, nor the other way round.
    pub fn set_file(&mut self, file: PathBuf) {
        let kind = |file: &Path| [is_estimate(file), is_even(file), is_sky(file)];
        if self
            .file
            .as_deref()
            .map_or(is_estimate(&file), |last| kind(last) != kind(&file))
        {
            *self = Self::default();
        }
        if self.file.as_deref() != Some(&file) {
            self.layout = None;
            self.layer = None;
            self.sky = None;
            self.without_suns = false;
            self.trust = None;
            self.clipped = None;
        }
        self.file = Some(file);
    }

    /// Another light with these settings on top of its own; they name no file.
    pub(super) fn over(self, light: Self) -> Self {
        let (low, high) = STOPS.into_inner();
        let tint = std::array::from_fn(|c| (self.tint[c] * light.tint[c]).min(MOST_TINT));
        Self {
            rotation: light.rotation + self.rotation,
            tilt: light.tilt + self.tilt,
            mirror: light.mirror != self.mirror,
            strength: (light.strength + self.strength).clamp(low, high),
            tint,
            ..light
        }
    }

    /// The turn of the (mirrored) map in the Z-up world.
    pub fn world_from_map(&self) -> DMat3 {
        DMat3::from_rotation_z(self.rotation.to_radians())
            * DMat3::from_rotation_x(self.tilt.to_radians())
            * self.up.asset_from_world().transpose()
    }

    /// Turns and tilts the light so that what lies in a direction of the map, as it is in its file, comes from a direction of the Z-up world;
    /// as high or as low as a tilt of 60 degrees brings it, where that does not reach. Of two ways the one that tilts less.
    pub fn bring(&mut self, in_map: DVec3, to_world: DVec3) {
        let upright = self.up.asset_from_world().transpose() * self.mirroring() * in_map;
        // A tilt turns y and z on a circle: z is its radius times the sine of tilt and `first`.
        let (reach, first) = (upright.y.hypot(upright.z), upright.z.atan2(upright.y));
        let height = if reach > 1e-9 {
            (to_world.z / reach).clamp(-1.0, 1.0).asin()
        } else {
            first
        };
        let ways = [height, std::f64::consts::PI - height].map(|a| wrap((a - first).to_degrees()));
        let least = ways[0].abs().min(ways[1].abs());
        self.tilt = if least <= MOST_TILT {
            ways[usize::from(ways[1].abs() == least)]
        } else {
            // The nearer end: between the ends it only gets farther.
            let off = |tilt: f64| (reach * (first + tilt.to_radians()).sin() - to_world.z).abs();
            MOST_TILT.copysign(off(-MOST_TILT) - off(MOST_TILT))
        };
        let tilted = DMat3::from_rotation_x(self.tilt.to_radians()) * upright;
        let azimuth = |d: DVec3| d.y.atan2(d.x).to_degrees();
        self.rotation = wrap(azimuth(to_world) - azimuth(tilted));
    }

    /// From directions of an asset whose up axis is `asset_up` to directions of the map as it lies in its file, the mirror included.
    pub fn map_from_asset(&self, asset_up: UpAxis) -> DMat3 {
        self.mirroring() * (asset_up.asset_from_world() * self.world_from_map()).transpose()
    }

    /// From directions of the map as it lies in its file to those of the mirrored one, or back.
    fn mirroring(&self) -> DMat3 {
        let y = if self.mirror { -1.0 } else { 1.0 };
        DMat3::from_diagonal(DVec3::new(1.0, y, 1.0))
    }

    /// Factor of the light's radiance, per channel.
    pub fn gain(&self) -> [f32; 3] {
        self.tint.map(|t| t * self.strength.exp2())
    }

    /// Its map as it is seen behind the objects; `light` is the map's, as that lies in its file.
    pub fn backdrop<'a>(
        &self,
        map: &'a EnvironmentMap,
        light: &Illumination,
    ) -> Cow<'a, EnvironmentMap> {
        match &light.light_samples {
            Some(light_samples) if self.without_suns => {
                Cow::Owned(map.clone().without_suns(&light_samples.suns))
            }
            _ => Cow::Borrowed(map),
        }
    }

    /// Map in the Z-up world, with its strength and tint and times a gain.
    pub fn in_world(
        &self,
        map: &EnvironmentMap,
        light: &Illumination,
        columns: usize,
        gain: f32,
    ) -> EnvironmentMap {
        let gain = self.gain().map(|g| g * gain);
        let map = map.reduced(columns);
        let map = self.backdrop(&map, light);
        let map_from_world = self.map_from_asset(UpAxis::PlusZ);
        EnvironmentMap::of_directions(columns, columns / 2, |d| {
            let radiance = map.sample((map_from_world * d).as_vec3());
            std::array::from_fn(|c| radiance[c] * gain[c])
        })
    }

    /// A map's light as the asset sees it: mirrored, turned, tinted, with its strength.
    pub fn orient(&self, light: &Illumination, asset_up: UpAxis) -> Illumination {
        let turn = asset_up.asset_from_world() * self.world_from_map();
        let mut light = match self.without_suns {
            true => Cow::Owned(light.without_suns()),
            false => Cow::Borrowed(light),
        };
        if self.mirror {
            light = Cow::Owned(light.mirrored());
        }
        let seen = light.rotated(turn).told(self.gain());
        Illumination {
            trust: self.trust.unwrap_or(seen.trust),
            ..seen
        }
    }

    pub(super) fn validate(&self, name: &str) -> Result<()> {
        let is_share = |trust: f32| (0.0..=1.0).contains(&trust);
        ensure(self.trust.is_none_or(is_share), || {
            format!("trust of the {name} is out of range 0 to 1")
        })?;
        let strength = self.strength;
        ensure(STOPS.contains(&strength), || {
            format!("strength of the {name} {strength} is out of range -60 to 60 stops")
        })?;
        if let Some(sky) = self.sky() {
            sky.validate()?;
        } else {
            ensure(self.sky.is_none(), || {
                format!("a sky of the {name} needs the file \"{SKY}\"")
            })?;
        }
        ensure(self.rotation.is_finite() && self.tilt.is_finite(), || {
            format!("the turn of the {name} light is not a number")
        })?;
        ensure(
            self.tint.iter().all(|t| (0.0..=MOST_TINT).contains(t)),
            || format!("the tint of the {name} light is out of range 0 to 1000"),
        )
    }
}

/// The most that a channel of a light is multiplied by, beside its strength.
pub(super) const MOST_TINT: f32 = 1e3;

/// True where a light's name stands for uniform white light.
pub fn is_even(path: &Path) -> bool {
    path.as_os_str() == EVEN
}

/// True where a light's name stands for sun and sky.
pub fn is_sky(path: &Path) -> bool {
    path.as_os_str() == SKY
}

/// True where a light's name stands for the estimated light.
pub fn is_estimate(path: &Path) -> bool {
    path.as_os_str() == ESTIMATE
}

/// True where a light's name is that of a file.
pub fn is_file(path: &Path) -> bool {
    !is_even(path) && !is_estimate(path) && !is_sky(path)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sh::{evaluate_sh, lattice};

    #[test]
    fn a_direction_of_the_map_is_brought_where_it_is_wanted() {
        let directions: Vec<DVec3> = lattice(60)
            .iter()
            .map(|d| d.as_dvec3().normalize())
            .collect();
        for (i, in_map) in directions.iter().enumerate() {
            for mirror in [false, true] {
                let to_world = directions[(i * 17 + 5) % directions.len()];
                let mut light = EnvironmentLight {
                    mirror,
                    up: UpAxis::ALL[i % 6].1,
                    tilt: 3.0,
                    ..EnvironmentLight::of("a.hdr")
                };
                light.bring(*in_map, to_world);
                let comes_from = |light: &EnvironmentLight| {
                    light.map_from_asset(UpAxis::PlusZ).transpose() * *in_map
                };
                let came = comes_from(&light);
                // No other tilt brings it nearer to that height, and none turns the world over.
                assert!(light.tilt.abs() <= MOST_TILT);
                let nearest = (-60..=60).map(|tilt| {
                    let light = EnvironmentLight {
                        tilt: f64::from(tilt),
                        ..light.clone()
                    };
                    (comes_from(&light).z - to_world.z).abs()
                });
                let nearest = nearest.fold(f64::INFINITY, f64::min);
                assert!((came.z - to_world.z).abs() < nearest + 1e-9);
                // And it is turned there.
                let flat = |d: DVec3| DVec3::new(d.x, d.y, 0.0).normalize();
                let off = flat(came).distance(flat(to_world));
                assert!(off < 1e-6, "{in_map} {to_world}: {came}");
                assert!(light.tilt.abs() <= 180.0 && light.rotation.abs() <= 180.0);
            }
        }
    }

    #[test]
    fn a_light_keeps_its_turn_among_files_and_none_of_an_estimate() {
        let mut light = EnvironmentLight {
            rotation: 90.0,
            strength: 1.0,
            ..EnvironmentLight::of("a.hdr")
        };
        light.set_file("b.hdr".into());
        assert_eq!((light.rotation, light.strength), (90.0, 1.0));
        light.set_file(ESTIMATE.into());
        assert_eq!(light, EnvironmentLight::of(ESTIMATE));
        light.strength = 2.0;
        light.set_file(ESTIMATE.into());
        assert_eq!(light.strength, 2.0);
        light.set_file("a.hdr".into());
        assert_eq!(light, EnvironmentLight::of("a.hdr"));
    }

    /// The coefficients' way (mirror, rotate) and the background's way (one matrix for directions) show the same light.
    #[test]
    fn light_and_background_turn_alike() {
        let (width, height) = (32, 16);
        let pixels = (0..width * height)
            .map(|i| {
                let (x, y) = (i % width, i / width);
                [if x < 8 && y < 6 { 4.0 } else { 0.3 }, x as f32 / 32.0, 0.5]
            })
            .collect();
        let map = EnvironmentMap::new(width, height, pixels);
        let light = Illumination::of(&map, 6);
        let settings = EnvironmentLight {
            rotation: 35.0,
            tilt: 20.0,
            mirror: true,
            up: UpAxis::PlusY,
            strength: 1.0,
            tint: [1.0, 0.5, 2.0],
            ..EnvironmentLight::default()
        };
        let up = UpAxis::MinusX;
        let oriented = settings.orient(&light, up);
        let map_from_asset = settings.map_from_asset(up);
        for d in lattice(40) {
            let there = (map_from_asset * d.as_dvec3()).as_vec3();
            let expected = evaluate_sh(&light.radiance.coefficients, 6, there.to_array());
            let found = evaluate_sh(&oriented.radiance.coefficients, 6, d.to_array());
            for c in 0..3 {
                let expected = expected[c] * settings.gain()[c];
                assert!((found[c] - expected).abs() < 1e-4, "{found:?} {expected}");
            }
        }
    }
}
