//! A look: all settings of a relight in one readable file (JSON).

use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3, Vec3};
use serde::{Deserialize, Serialize};

use crate::bake::harmonic::{DEFAULT_DIRECTIONS, DIRECTIONS};
use crate::camera::CameraPose;
use crate::color::{Display, Encoding};
use crate::environment::Illumination;
use crate::error::{Error, Result};
use crate::present::{Background, View};
use crate::settings::TransferSettings;
use crate::surfels::{Hide, SurfelCloud, UpAxis};

/// The version of looks that this program writes; it reads all up to it.
pub const LOOK_VERSION: u32 = 2;

/// The name that stands for uniform white light where a file is expected.
pub const EVEN: &str = "even";

/// The name that stands for the light that the asset itself tells of.
pub const ESTIMATE: &str = "estimate";

/// One of the two lights: which, how it is turned, how strong it is.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct LightSettings {
    /// The environment's file, or `even`, or of the source `estimate`; none where the look leaves it open.
    pub file: Option<PathBuf>,
    /// Turn about the up axis, in degrees, counter-clockwise seen from above.
    pub rotation: f64,
    /// Tilt about the world's X axis, before the turn, in degrees.
    pub tilt: f64,
    /// Mirrored left to right.
    pub mirror: bool,
    /// Which axis of the map points up; a map is drawn with +Z up.
    pub up: UpAxis,
    /// Strength in stops.
    pub strength: f32,
    /// Colour that the light is multiplied by, linear.
    pub tint: [f32; 3],
}

impl Default for LightSettings {
    fn default() -> Self {
        Self {
            file: None,
            rotation: 0.0,
            tilt: 0.0,
            mirror: false,
            up: UpAxis::default(),
            strength: 0.0,
            tint: [1.0; 3],
        }
    }
}

impl LightSettings {
    /// A light as it is.
    pub fn of(file: impl Into<PathBuf>) -> Self {
        Self {
            file: Some(file.into()),
            ..Self::default()
        }
    }

    /// Whether it is the light that the asset tells of.
    pub fn is_estimate(&self) -> bool {
        self.file.as_deref().is_some_and(is_estimate)
    }

    /// Takes another light. The estimate comes as the asset sees it: how a map was turned, and how strong it was, is nothing to it, nor
    /// the other way round.
    pub fn set_file(&mut self, file: PathBuf) {
        if is_estimate(&file) != self.is_estimate() {
            *self = Self::default();
        }
        self.file = Some(file);
    }

    /// The turn of the (mirrored) map in the Z-up world.
    pub fn world_from_map(&self) -> DMat3 {
        DMat3::from_rotation_z(self.rotation.to_radians())
            * DMat3::from_rotation_x(self.tilt.to_radians())
            * self.up.asset_from_world().transpose()
    }

    /// From directions of an asset whose up axis is `asset_up` to directions of the map as it lies in its file, the mirror included.
    pub fn map_from_asset(&self, asset_up: UpAxis) -> DMat3 {
        let turn = (asset_up.asset_from_world() * self.world_from_map()).transpose();
        if self.mirror {
            DMat3::from_diagonal(DVec3::new(1.0, -1.0, 1.0)) * turn
        } else {
            turn
        }
    }

    /// What the light's radiance is multiplied by, per channel.
    pub fn gain(&self) -> [f32; 3] {
        self.tint.map(|t| t * self.strength.exp2())
    }

    /// A map's light as the asset sees it: mirrored, turned, tinted, with its strength.
    pub fn orient(&self, light: &Illumination, asset_up: UpAxis) -> Illumination {
        let turn = asset_up.asset_from_world() * self.world_from_map();
        let light = if self.mirror {
            light.mirrored()
        } else {
            light.clone()
        };
        light.rotated(turn).tinted(self.gain())
    }

    fn validate(&self, name: &str) -> Result<()> {
        if !STOPS.contains(&self.strength) {
            return Err(Error::Mismatch(format!(
                "strength of the {name} {} is out of range -60 to 60 stops",
                self.strength
            )));
        }
        if !self.rotation.is_finite() || !self.tilt.is_finite() {
            return Err(Error::Mismatch(format!(
                "the turn of the {name} light is not a number"
            )));
        }
        if self.tint.iter().any(|t| !(0.0..=1e3).contains(t)) {
            return Err(Error::Mismatch(format!(
                "the tint of the {name} light is out of range 0 to 1000"
            )));
        }
        Ok(())
    }
}

/// Whether a light's name stands for uniform white light.
pub fn is_even(path: &Path) -> bool {
    path.as_os_str() == EVEN
}

/// Whether a light's name stands for the light that the asset tells of.
pub fn is_estimate(path: &Path) -> bool {
    path.as_os_str() == ESTIMATE
}

/// Whether a light's name is that of a file.
pub fn is_file(path: &Path) -> bool {
    !is_even(path) && !is_estimate(path)
}

/// Every setting that changes the picture; what a file leaves out keeps its default.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Look {
    /// Of this format.
    pub version: u32,
    /// The splat that the look was made for, relative to the look's file.
    pub asset: Option<PathBuf>,
    /// The asset's up axis, where the file's own is not to be believed.
    pub up: Option<UpAxis>,
    /// The asset's colour is linear already.
    pub linear: bool,
    /// Places, in the asset's coordinates, that see its outside: where which side of a surface is its front could not be told.
    pub outside_from: Vec<Vec3>,
    /// Directions of the bake.
    pub directions: usize,
    /// The light that the asset was captured under.
    pub source: LightSettings,
    /// The light that it is relit by.
    pub target: LightSettings,
    /// The target's mean irradiance is brought to the source's, before its strength.
    pub match_strength: bool,
    /// The mathematics.
    pub transfer: TransferSettings,
    /// Exposure and tone curve.
    pub display: Display,
    /// Stops of exposure as colours instead of the picture.
    pub false_color: bool,
    /// What is shown.
    pub view: View,
    /// Where a split picture is split, from the left, 0 to 1.
    pub wipe: f32,
    /// What a difference is multiplied by.
    pub difference_scale: f32,
    /// What is behind it.
    pub background: Background,
    /// Blur of an environment behind it: standard deviation in degrees.
    pub background_blur: f32,
    /// The object's shadow on the ground under it.
    pub shadow_catcher: bool,
    /// What is not drawn.
    pub hide: Hide,
    /// Where the camera is.
    pub camera: Option<CameraPose>,
}

impl Default for Look {
    fn default() -> Self {
        Self {
            version: LOOK_VERSION,
            asset: None,
            up: None,
            linear: false,
            outside_from: Vec::new(),
            directions: DEFAULT_DIRECTIONS,
            source: LightSettings::default(),
            target: LightSettings::default(),
            match_strength: false,
            transfer: TransferSettings::default(),
            display: Display::default(),
            false_color: false,
            view: View::default(),
            wipe: 0.5,
            difference_scale: 1.0,
            background: Background::default(),
            background_blur: 0.0,
            shadow_catcher: false,
            hide: Hide::default(),
            camera: None,
        }
    }
}

/// Range of exposure and strength in stops: 18 orders of magnitude either way.
pub const STOPS: std::ops::RangeInclusive<f32> = -60.0..=60.0;

/// The most places that may be said to see the outside, and how far away they may be: each costs a pass over the asset.
pub const MOST_PLACES: usize = 32;
const FARTHEST: f32 = 1e12;

/// Range of a background's blur in degrees.
pub const BLUR: std::ops::RangeInclusive<f32> = 0.0..=60.0;

/// Range of what differences are multiplied by.
pub const DIFFERENCE_SCALE: std::ops::RangeInclusive<f32> = 0.1..=100.0;

impl Look {
    /// Checks version and ranges.
    ///
    /// # Errors
    /// Says which setting is out of range.
    pub fn validate(&self) -> Result<()> {
        if !(1..=LOOK_VERSION).contains(&self.version) {
            return Err(Error::Mismatch(format!(
                "a look of version {}; this program reads versions up to {LOOK_VERSION}",
                self.version
            )));
        }
        self.transfer.validate()?;
        if !DIRECTIONS.contains(&self.directions) {
            return Err(Error::Mismatch(format!(
                "{} visibility directions are out of range {} to {}",
                self.directions,
                DIRECTIONS.start(),
                DIRECTIONS.end()
            )));
        }
        if !STOPS.contains(&self.display.exposure) {
            return Err(Error::Mismatch(format!(
                "exposure {} is out of range -60 to 60 stops",
                self.display.exposure
            )));
        }
        for (name, value, range) in [
            ("wipe", self.wipe, 0.0..=1.0),
            ("difference_scale", self.difference_scale, DIFFERENCE_SCALE),
            ("background_blur", self.background_blur, BLUR),
        ] {
            if !range.contains(&value) {
                return Err(Error::Mismatch(format!(
                    "{name} {value} is out of range {} to {}",
                    range.start(),
                    range.end()
                )));
            }
        }
        let is_place = |p: &Vec3| p.abs().max_element() < FARTHEST;
        if self.outside_from.len() > MOST_PLACES || !self.outside_from.iter().all(is_place) {
            return Err(Error::Mismatch(format!(
                "outside_from: up to {MOST_PLACES} places of three numbers below {FARTHEST:e} are expected"
            )));
        }
        self.hide.validate()?;
        self.source.validate("source")?;
        self.target.validate("target")?;
        self.camera.map_or(Ok(()), |c| c.validate())
    }

    /// What of it the asset itself is: how its colour is read, and where its outside is.
    pub fn apply_to(&self, cloud: &mut SurfelCloud) {
        if self.linear {
            cloud.encoding = Encoding::StoredLinear;
        }
        cloud.outside_from.clone_from(&self.outside_from);
    }

    /// The two lights as the asset sees them, from their maps' light: the target brought to the source's mean where that is wanted.
    pub fn lights(
        &self,
        source: &Illumination,
        target: &Illumination,
        asset_up: UpAxis,
    ) -> [Illumination; 2] {
        let gain = self.match_gain(source, target);
        let source = self.source.orient(source, asset_up);
        let target = self.target.orient(target, asset_up);
        if gain == 1.0 {
            [source, target]
        } else {
            [source, target.scaled(gain)]
        }
    }

    /// What brings the target's mean irradiance to the source's, where that is wanted; 1 otherwise. Both lights are as their maps hold
    /// them. The target's own strength and tint come on top; the source's count, since it is what the target is matched to.
    pub fn match_gain(&self, source: &Illumination, target: &Illumination) -> f32 {
        let source = source.radiance.tinted(self.source.gain()).mean_irradiance();
        let target = target.mean_irradiance();
        if self.match_strength && source > 0.0 && target > 0.0 {
            (source / target).clamp(1e-20, 1e20)
        } else {
            1.0
        }
    }

    /// The look with its paths made relative to a folder where they lie below it or beside it; `even` stays.
    pub fn relative_to(mut self, folder: &Path) -> Self {
        self.each_path(|path| relative(path, folder));
        self
    }

    /// The look with its paths resolved against the folder of its file.
    pub fn resolved_in(mut self, folder: &Path) -> Self {
        // Without `..` where it can be: a path is compared with others.
        self.each_path(|path| {
            let whole = folder.join(path);
            whole.canonicalize().unwrap_or(whole)
        });
        self
    }

    fn each_path(&mut self, change: impl Fn(&Path) -> PathBuf) {
        let files = [
            &mut self.asset,
            &mut self.source.file,
            &mut self.target.file,
        ];
        for path in files.into_iter().flatten() {
            if is_file(path) {
                *path = change(path);
            }
        }
    }
}

/// `path` as seen from `folder`, with `..` where needed; as it is where the two have no root in common.
fn relative(path: &Path, folder: &Path) -> PathBuf {
    let whole = |p: &Path| p.canonicalize().or_else(|_| std::path::absolute(p));
    let (Ok(path_whole), Ok(folder)) = (whole(path), whole(folder)) else {
        return path.to_owned();
    };
    let common = path_whole
        .components()
        .zip(folder.components())
        .take_while(|(a, b)| a == b)
        .count();
    // Only the root in common: the path says more as it is.
    if common < 2 {
        return path_whole;
    }
    let up = folder.components().count() - common;
    std::iter::repeat_n(Path::new("..").as_os_str(), up)
        .chain(path_whole.components().skip(common).map(|c| c.as_os_str()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::{Beams, EnvironmentMap, project_environment};

    #[test]
    fn a_light_keeps_its_turn_among_files_and_none_of_an_estimate() {
        let mut light = LightSettings {
            rotation: 90.0,
            strength: 1.0,
            ..LightSettings::of("a.hdr")
        };
        light.set_file("b.hdr".into());
        assert_eq!((light.rotation, light.strength), (90.0, 1.0));
        light.set_file(ESTIMATE.into());
        assert_eq!(light, LightSettings::of(ESTIMATE));
        light.strength = 2.0;
        light.set_file(ESTIMATE.into());
        assert_eq!(light.strength, 2.0);
        light.set_file("a.hdr".into());
        assert_eq!(light, LightSettings::of("a.hdr"));
    }

    #[test]
    fn a_partial_look_keeps_the_defaults_and_a_misspelt_one_is_refused() {
        let look: Look = serde_json::from_str(
            r#"{"transfer": {"epsilon": 0.1, "terms": {"shadow": false}}, "up": "-y"}"#,
        )
        .expect("a good look");
        assert_eq!(look.transfer.sh_degree, 3);
        assert!(!look.transfer.terms.shadow && look.transfer.terms.specular);
        assert_eq!(look.up, Some(UpAxis::MinusY));
        for misspelt in [
            r#"{"epsilom": 1}"#,
            r#"{"transfer": {"terms": {"shadows": false}}}"#,
            r#"{"display": {"exposur": 1}}"#,
            r#"{"target": {"rotatio": 1}}"#,
        ] {
            assert!(
                serde_json::from_str::<Look>(misspelt).is_err(),
                "{misspelt}"
            );
        }
        for wrong in [
            r#"{"display": {"exposure": 500}}"#,
            r#"{"version": 3}"#,
            r#"{"version": 0}"#,
            r#"{"wipe": 1.5}"#,
            r#"{"target": {"tint": [1, -1, 1]}}"#,
        ] {
            let look: Look = serde_json::from_str(wrong).expect("a look");
            assert!(look.validate().is_err(), "{wrong}");
        }
        assert!(look.validate().is_ok());
        let text = serde_json::to_string(&look).expect("plain data");
        assert_eq!(
            serde_json::from_str::<Look>(&text).expect("its own text"),
            look
        );
    }

    #[test]
    fn paths_are_relative_to_the_look_and_come_back() {
        let folder = tempfile::tempdir().expect("a folder");
        let inside = folder.path().join("looks");
        std::fs::create_dir_all(&inside).expect("room");
        std::fs::create_dir_all(folder.path().join("lights")).expect("room");
        let light = folder.path().join("lights/sky.hdr");
        std::fs::write(&light, "x").expect("room");
        let mut look = Look::default();
        look.source.file = Some(EVEN.into());
        look.target.file = Some(light.clone());
        let saved = look.clone().relative_to(&inside);
        assert_eq!(
            saved.target.file.as_deref(),
            Some(Path::new("../lights/sky.hdr"))
        );
        assert_eq!(saved.source.file, Some(EVEN.into()));
        let back = saved.resolved_in(&inside);
        let file = back.target.file.expect("a light");
        assert_eq!(
            file.canonicalize().expect("it is there"),
            light.canonicalize().expect("it is there")
        );
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
        let light = Illumination {
            radiance: project_environment(&map, 6),
            beams: Some(Beams::of(&map)),
            trust: 1.0,
        };
        let settings = LightSettings {
            rotation: 35.0,
            tilt: 20.0,
            mirror: true,
            up: UpAxis::PlusY,
            strength: 1.0,
            tint: [1.0, 0.5, 2.0],
            ..LightSettings::default()
        };
        let up = UpAxis::MinusX;
        let oriented = settings.orient(&light, up);
        let map_from_asset = settings.map_from_asset(up);
        for d in crate::sh::fibonacci_sphere(40) {
            let there = map_from_asset * DVec3::from_array(d);
            let expected = crate::sh::evaluate_sh(
                &light.radiance.coefficients,
                6,
                there.to_array().map(|v| v as f32),
            );
            let found =
                crate::sh::evaluate_sh(&oriented.radiance.coefficients, 6, d.map(|v| v as f32));
            for c in 0..3 {
                let expected = expected[c] * settings.gain()[c];
                assert!((found[c] - expected).abs() < 1e-4, "{found:?} {expected}");
            }
        }
    }

    #[test]
    fn matched_lights_have_one_mean_and_keep_their_strength_on_top() {
        let source = Illumination::even(3).scaled(5.0);
        let target = Illumination::even(3).scaled(0.2);
        let mut look = Look {
            match_strength: true,
            ..Look::default()
        };
        look.target.strength = 1.0;
        let [s, t] = look.lights(&source, &target, UpAxis::PlusZ);
        assert!((t.mean_irradiance() / s.mean_irradiance() - 2.0).abs() < 1e-4);
        look.match_strength = false;
        let [_, t] = look.lights(&source, &target, UpAxis::PlusZ);
        assert!((t.mean_irradiance() / target.mean_irradiance() - 2.0).abs() < 1e-5);
    }
}
