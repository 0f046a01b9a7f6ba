//! Scene: objects with their capture lights, the target light, placed lights, camera and presentation. Plain data; its file form is a look.

mod animation;
mod cut;
mod light;
mod object;
mod rig;

use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};

use crate::bake::harmonic::{DEFAULT_DIRECTIONS, DIRECTIONS};
use crate::camera::CameraPose;
use crate::color::Display;
use crate::environment::{EnvironmentMap, Illumination, ImageReading};
use crate::error::{Error, Result, ensure};
use crate::present::{Background, View};
use crate::settings::TransferSettings;
use crate::surfels::UpAxis;

pub use animation::{Animation, Ease, LONGEST, LightKey, MOST_FRAMES, MOST_KEYS};
pub use cut::{Cut, FARTHEST, Keep, MOST_CUTS, Support, kept};
pub use light::{
    ESTIMATE, EVEN, EnvironmentLight, SKY, STOPS, is_estimate, is_even, is_file, is_sky, wrap,
};
pub use object::{MOST_OBJECTS, MOST_PLACES, Object, SCALES, Transform, splat_name};
pub use rig::{
    Around, FixedTo, KELVIN, KEY, Light, LightKind, LightSource, Placed, Rig, RigPreset, RigTarget,
    SUN_DEG,
};

/// Every setting that changes the picture.
#[derive(Clone, Debug, PartialEq)]
pub struct Scene {
    /// At least one; what is set before a splat is open is the first one's.
    pub objects: Vec<Object>,
    /// Target light.
    pub environment: EnvironmentLight,
    /// Placed lights.
    pub lights: Vec<Light>,
    /// Keys of the light over time.
    pub animation: Animation,
    /// The environment's mean irradiance is brought to the source's, before its strength.
    pub match_strength: bool,
    /// Directions of the bake.
    pub directions: usize,
    /// The mathematics.
    pub transfer: TransferSettings,
    /// Exposure and tone curve.
    pub display: Display,
    /// A table of colours that the picture is graded by, after the tone curve.
    pub lut: Option<PathBuf>,
    /// Stops of exposure as colours instead of the picture.
    pub false_color: bool,
    /// View that is shown.
    pub view: View,
    /// Where a split picture is split, from the left, 0 to 1.
    pub wipe: f32,
    /// Factor of a difference.
    pub difference_scale: f32,
    /// Background behind the objects.
    pub background: Background,
    /// A photograph to be seen behind it.
    pub plate: Option<PathBuf>,
    /// Blur of an environment behind it: standard deviation in degrees.
    pub background_blur: f32,
    /// The objects' shadow on the ground under them.
    pub shadow_catcher: bool,
    /// Where the camera is.
    pub camera: Option<CameraPose>,
    /// Note of its maker.
    pub note: String,
    /// Views to come back to.
    pub bookmarks: Vec<Bookmark>,
    /// Other looks of the same objects.
    pub variants: Vec<Variant>,
}

/// Most views, and most looks, that a scene keeps.
pub const MOST_KEPT: usize = 500;

/// Lights that stand elsewhere by a step in the coordinates of a scene of which that axis is up.
pub fn moved_lights(lights: &[Light], by: DVec3, up: UpAxis) -> Vec<Light> {
    let by_in_world = up.asset_from_world().transpose() * by;
    let mut lights = lights.to_vec();
    for light in &mut lights {
        light.source.move_by(by_in_world);
    }
    lights
}

/// A view to come back to.
#[derive(Clone, Debug, PartialEq)]
pub struct Bookmark {
    /// For the user.
    pub name: String,
    /// Where it is seen from.
    pub camera: CameraPose,
}

/// Another look of the same objects.
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    /// For the user.
    pub name: String,
    /// Settings that [`Scene::look_alone`] leaves.
    pub look: Scene,
}

impl Default for Scene {
    fn default() -> Self {
        Self {
            objects: vec![Object::default()],
            environment: EnvironmentLight::default(),
            lights: Vec::new(),
            animation: Animation::default(),
            match_strength: false,
            directions: DEFAULT_DIRECTIONS,
            transfer: TransferSettings::default(),
            display: Display::default(),
            lut: None,
            false_color: false,
            view: View::default(),
            wipe: 0.5,
            difference_scale: 1.0,
            background: Background::default(),
            plate: None,
            background_blur: 0.0,
            shadow_catcher: false,
            camera: None,
            note: String::new(),
            bookmarks: Vec::new(),
            variants: Vec::new(),
        }
    }
}

/// Range of a background's blur in degrees.
pub const BLUR: std::ops::RangeInclusive<f32> = 0.0..=60.0;

/// Range of what differences are multiplied by.
pub const DIFFERENCE_SCALE: std::ops::RangeInclusive<f32> = 0.1..=100.0;

impl Scene {
    /// Checks ranges.
    ///
    /// # Errors
    /// Says which setting is out of range.
    pub fn validate(&self) -> Result<()> {
        self.transfer.validate()?;
        let (directions, exposure) = (self.directions, self.display.exposure);
        ensure(DIRECTIONS.contains(&directions), || {
            let (low, high) = DIRECTIONS.into_inner();
            format!("{directions} visibility directions are out of range {low} to {high}")
        })?;
        ensure(STOPS.contains(&exposure), || {
            format!("exposure {exposure} is out of range -60 to 60 stops")
        })?;
        for (name, value, range) in [
            ("wipe", self.wipe, 0.0..=1.0),
            ("difference_scale", self.difference_scale, DIFFERENCE_SCALE),
            ("background_blur", self.background_blur, BLUR),
        ] {
            ensure(range.contains(&value), || {
                let (low, high) = range.into_inner();
                format!("{name} {value} is out of range {low} to {high}")
            })?;
        }
        for (at, object) in self.objects.iter().enumerate() {
            object.validate().map_err(|why| {
                let called = object.called().unwrap_or_default();
                let of_several = self.objects.len() > 1;
                let which = of_several.then(|| format!("object {} ({called}): ", at + 1));
                Error::Mismatch(format!("{}{why}", which.unwrap_or_default()))
            })?;
        }
        self.environment.validate("target")?;
        rig::validate_all(&self.lights)?;
        self.animation.validate()?;
        self.camera.map_or(Ok(()), |c| c.validate())?;
        self.validate_kept()
    }

    /// Objects that are put into a scene are lit by its light, unless there is to be another.
    pub fn light_as_captured(&mut self) {
        if self.objects.len() > 1 && self.environment.file.is_none() {
            let captured = self.objects[0].source.clone();
            self.environment = std::mem::take(&mut self.environment).over(captured);
        }
    }

    /// True where the first object is a place that the others were put into. Where a photograph is, or its ground catches shadows for one, all of
    /// them were.
    pub fn first_is_a_place(&self) -> bool {
        let first_is_shown = self.objects[0].shown;
        first_is_shown && self.background != Background::Backplate && !self.shadow_catcher
    }

    /// Number of the object whose capture light *Match exposure* matches: the first that is shown.
    pub fn matched_object(&self) -> usize {
        self.objects.iter().position(|o| o.shown).unwrap_or(0)
    }

    /// Capture lights of the objects and, last, the target light.
    pub fn environment_lights(&self) -> impl Iterator<Item = &EnvironmentLight> {
        let sources = self.objects.iter().map(|o| &o.source);
        sources.chain([&self.environment])
    }

    /// Capture lights and target light, to be changed.
    pub fn environment_lights_mut(&mut self) -> impl Iterator<Item = &mut EnvironmentLight> {
        let sources = self.objects.iter_mut().map(|o| &mut o.source);
        sources.chain([&mut self.environment])
    }

    /// Layout and layer of a light's file, where any light that uses it sets them: one file is read one way.
    pub fn reading_of(&self, file: &Path) -> ImageReading {
        let of_it = || {
            self.environment_lights()
                .filter(|l| l.file.as_deref() == Some(file))
        };
        ImageReading {
            layout: of_it().find_map(|l| l.layout),
            layer: of_it().find_map(|l| l.layer.clone()),
        }
    }

    /// Takes over the origin of an object's splat as it was read, whose file or settings say `file_up` is up: what the scene says in the splat's
    /// coordinates is relative to that from then on. The scene's own are those of the first object; yields by how much what stands in it is
    /// moved.
    pub fn take_origin(&mut self, at: usize, origin: DVec3, file_up: UpAxis) -> DVec3 {
        let moved = origin - self.objects[at].origin;
        if moved == DVec3::ZERO {
            return DVec3::ZERO;
        }
        let by = match at {
            0 => -self.objects[0].transform.moved(moved),
            _ => DVec3::ZERO,
        };
        for (i, object) in self.objects.iter_mut().enumerate() {
            if i != at {
                object.transform.translation =
                    (object.transform.translation.as_dvec3() + by).as_vec3();
            }
        }
        self.objects[at].take_origin(origin, by);
        let place = |place: &mut Vec3| *place = (place.as_dvec3() + by).as_vec3();
        let cameras = self.bookmarks.iter_mut().map(|b| &mut b.camera);
        for camera in cameras.chain(&mut self.camera) {
            place(&mut camera.pivot);
        }
        let up = self.objects[0].up.unwrap_or(file_up);
        self.lights = moved_lights(&self.lights, by, up);
        for variant in &mut self.variants {
            variant.look.lights = moved_lights(&variant.look.lights, by, up);
        }
        by
    }

    /// Source and target light of [`Scene::matched_object`] in the coordinates of an asset, from the light of the two maps: the environment brought to the source's mean where
    /// that is wanted, with the placed lights beside it.
    pub fn lights_on(
        &self,
        [source, environment]: [&Illumination; 2],
        asset_up: UpAxis,
    ) -> [Illumination; 2] {
        let gain = self.environment_gain([source, environment]);
        let object = &self.objects[self.matched_object()];
        let source = object.source.orient(source, asset_up);
        let mut target = self.environment.orient(environment, asset_up);
        if gain != 1.0 {
            target = target.scaled(gain);
        }
        for light in self.shining() {
            light.add_to(&mut target, asset_up);
        }
        [source, target]
    }

    /// Adds a light of one's own, which the keys of the light then know as it is.
    pub fn add_light(&mut self, light: Light) {
        self.animation.add_light(&light);
        self.lights.push(light);
    }

    /// Takes a light of one's own away, and out of the keys of the light.
    pub fn remove_light(&mut self, at: usize) {
        self.lights.remove(at);
        self.animation.remove_light(at);
    }

    /// Other lights of one's own in the place of those there are, which no key knows.
    pub fn set_lights(&mut self, lights: Vec<Light>) {
        self.lights = lights;
        for key in &mut self.animation.keys {
            key.lights.clear();
        }
    }

    /// The light as it is set, as a key at a time.
    pub fn light_key(&self, time: f64) -> LightKey {
        LightKey::of(&self.environment, &self.lights, time)
    }

    /// Sets the light as it is at a time of the animation, if there is one.
    pub fn go_to(&mut self, time: f64) {
        if let Some(key) = self.animation.at(time) {
            key.apply(&mut self.environment, &mut self.lights);
        }
    }

    /// The suns of the environment's picture as lights of one's own, as strong as they are in it, in the Z-up world; the brightest first.
    pub fn suns(&self, maps: [&Illumination; 2]) -> Vec<Light> {
        let whole = EnvironmentLight {
            without_suns: false,
            ..self.environment.clone()
        };
        let gain = self.match_gain(maps);
        let light = whole.orient(maps[1], UpAxis::PlusZ).scaled(gain);
        let suns = light
            .light_samples
            .into_iter()
            .flat_map(|light_samples| light_samples.suns);
        suns.map(|sun| {
            Light::of(LightSource::Directional {
                to_light: sun.direction.as_dvec3().normalize(),
                irradiance: sun.energy,
                angle_deg: SUN_DEG,
            })
        })
        .collect()
    }

    /// All that lights the objects, Z up. `maps` are the lights of the matched object's source and of the environment, as they are in their
    /// files.
    pub fn light_in_world(&self, maps: [&Illumination; 2]) -> Illumination {
        let [_, light] = self.lights_on(maps, UpAxis::PlusZ);
        light
    }

    /// All that lights the objects as one environment, Z up, as it is seen from a place of that world: what is near has that place's distance.
    /// `around` is the environment's map, and `light` what [`Scene::light_in_world`] makes of `maps`.
    pub fn panorama(
        &self,
        around: &EnvironmentMap,
        maps: [&Illumination; 2],
        light: &Illumination,
        place: DVec3,
        columns: usize,
    ) -> EnvironmentMap {
        let gain = self.environment_gain(maps);
        let map = self.environment.in_world(around, maps[1], columns, gain);
        // Those without a disc are beams among the light's own.
        let light_samples = self.shining().filter(|l| l.is_directional_sample());
        let crisp = light_samples.map(Light::emitter);
        let lights: Vec<_> = crisp.chain(light.emitters.iter().copied()).collect();
        map.with_lights(&lights, place.as_vec3())
    }

    /// Factor of the environment beside its own strength and tint, from the light of the two maps: 0 while a light is solo.
    pub fn environment_gain(&self, maps: [&Illumination; 2]) -> f32 {
        if self.is_solo() {
            return 0.0;
        }
        self.match_gain(maps)
    }

    /// True while placed lights are to be seen alone.
    fn is_solo(&self) -> bool {
        self.lights.iter().any(|l| l.on && l.solo)
    }

    /// The lights of one's own that shine.
    fn shining(&self) -> impl Iterator<Item = &Light> {
        let is_solo = self.is_solo();
        let lights = self.lights.iter();
        lights.filter(move |l| l.on && (l.solo || !is_solo))
    }

    /// Factor that brings the environment's mean irradiance to that of the matched object's source, where that is wanted; 1 otherwise. Both lights are as
    /// their maps hold them. The environment's own strength and tint come on top; the source's count, since it is what is matched.
    pub fn match_gain(&self, maps: [&Illumination; 2]) -> f32 {
        let object = &self.objects[self.matched_object()];
        let source = maps[0]
            .radiance
            .tinted(object.source.gain())
            .mean_irradiance();
        let target = maps[1].mean_irradiance();
        if self.match_strength && source > 0.0 && target > 0.0 {
            (source / target).clamp(1e-20, 1e20)
        } else {
            1.0
        }
    }

    /// The look by itself: light, mathematics and picture, without the objects, where they are seen from and how they are compared.
    pub fn look_alone(&self) -> Self {
        Self {
            objects: vec![Object::default()],
            ..Self::default().with_look(self)
        }
    }

    /// These objects, seen as they are, with the look of another scene.
    pub fn with_look(self, look: &Self) -> Self {
        Self {
            objects: self.objects,
            false_color: self.false_color,
            view: self.view,
            wipe: self.wipe,
            difference_scale: self.difference_scale,
            camera: self.camera,
            bookmarks: self.bookmarks,
            variants: self.variants,
            ..look.clone()
        }
    }

    fn validate_kept(&self) -> Result<()> {
        let most = self.bookmarks.len().max(self.variants.len());
        ensure(most <= MOST_KEPT, || {
            format!("more than {MOST_KEPT} bookmarks or variants")
        })?;
        for Bookmark { name, camera } in &self.bookmarks {
            let named = |why| Error::Mismatch(format!("bookmark {name:?}: {why}"));
            camera.validate().map_err(named)?;
        }
        for Variant { name, look } in &self.variants {
            let named = |why| Error::Mismatch(format!("variant {name:?}: {why}"));
            look.validate().map_err(named)?;
            ensure(*look == look.look_alone(), || {
                format!(
                    "variant {name:?}: it holds a look, and no objects, camera, view, bookmarks or variants"
                )
            })?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::{MAX_SUNS, project_environment};
    use glam::Vec3;

    #[test]
    fn matched_lights_have_one_mean_and_keep_their_strength_on_top() {
        let source = Illumination::even(3).scaled(5.0);
        let target = Illumination::even(3).scaled(0.2);
        let mut scene = Scene {
            match_strength: true,
            ..Scene::default()
        };
        scene.environment.strength = 1.0;
        let lights = |scene: &Scene| scene.lights_on([&source, &target], UpAxis::PlusZ);
        let [s, t] = lights(&scene);
        assert!((t.mean_irradiance() / s.mean_irradiance() - 2.0).abs() < 1e-4);
        scene.match_strength = false;
        let [_, t] = lights(&scene);
        assert!((t.mean_irradiance() / target.mean_irradiance() - 2.0).abs() < 1e-5);
    }

    #[test]
    fn what_is_put_into_a_scene_is_lit_by_its_light_as_that_is_turned_further() {
        let source = EnvironmentLight {
            rotation: 30.0,
            mirror: true,
            tint: [1.0, 0.5, 1.0],
            strength: 1.0,
            ..EnvironmentLight::of("forest.hdr")
        };
        let mut scene = Scene::default();
        scene.objects[0].source = source.clone();
        scene.objects.push(Object::default());
        scene.environment = EnvironmentLight {
            rotation: 60.0,
            tilt: 5.0,
            tint: [0.5, 1.0, 1.0],
            strength: 60.0,
            ..EnvironmentLight::default()
        };
        scene.light_as_captured();
        let expected = EnvironmentLight {
            rotation: 90.0,
            tilt: 5.0,
            tint: [0.5, 0.5, 1.0],
            strength: 60.0,
            ..source
        };
        assert_eq!(scene.environment, expected);
        assert!(scene.validate().is_ok());
        // One that is named is as it is set.
        scene.light_as_captured();
        assert_eq!(scene.environment, expected);
    }

    /// What is drawn of all that shines lights as what is taken of it does: matched, turned, tinted, with lights of one's own and without.
    #[test]
    fn all_that_shines_is_drawn_as_bright_as_it_lights() {
        let map = EnvironmentMap::of_directions(256, 128, |d| {
            let sun = if d.x > 0.97 { 60.0 } else { 0.0 };
            [1.0 + d.z as f32 + sun, 1.5 + sun, 2.0 - d.y as f32 + sun]
        });
        let (light, source) = (Illumination::of(&map, 3), Illumination::even(3));
        let mut scene = Scene {
            match_strength: true,
            ..Scene::default()
        };
        scene.environment = EnvironmentLight {
            rotation: 40.0,
            tilt: 15.0,
            strength: 0.5,
            tint: [1.0, 0.8, 0.5],
            ..EnvironmentLight::of("a.hdr")
        };
        let lights = [
            LightSource::Directional {
                to_light: DVec3::Z,
                irradiance: [3.0, 2.0, 1.0],
                angle_deg: SUN_DEG,
            },
            LightSource::Disc {
                center: DVec3::new(3.0, 0.0, 1.0),
                radius: 1.0,
                normal: DVec3::NEG_X,
                radiance: [4.0; 3],
                reach: None,
            },
        ];
        for lights in [vec![], lights.map(Light::of).to_vec()] {
            scene.set_lights(lights);
            let maps = [&source, &light];
            let all = scene.light_in_world(maps);
            let drawn = scene.panorama(&map, maps, &all, DVec3::ZERO, 512);
            let there = all.at_one_place(Vec3::ZERO);
            let drawn = project_environment(&drawn, 3);
            let pairs = drawn.coefficients.iter();
            let wanted = &there.radiance.coefficients;
            let most = wanted[0].iter().fold(0.0f32, |a, b| a.max(b.abs()));
            for (i, (found, wanted)) in pairs.zip(wanted).enumerate() {
                for (found, wanted) in found.iter().zip(wanted) {
                    // A pixel of 0.7 degrees is coarse for a sun of half of one.
                    assert!(
                        (found - wanted).abs() < 0.02 * most,
                        "{i}: {found} {wanted}"
                    );
                }
            }
        }
    }

    #[test]
    fn exposure_is_matched_to_the_first_object_that_is_shown() {
        let even = Illumination::even(2);
        let mut scene = Scene {
            match_strength: true,
            ..Scene::default()
        };
        let mut dim = Object::default();
        dim.source.strength = -2.0;
        scene.objects.push(dim);
        let mean = |scene: &Scene| scene.light_in_world([&even, &even]).mean_irradiance();
        let bright = mean(&scene);
        scene.objects[0].shown = false;
        // Two stops.
        assert!((bright / mean(&scene) - 4.0).abs() < 1e-3);
    }

    /// Irradiance adds up, whichever form of the light is asked; there is room for any number.
    #[test]
    fn lights_of_ones_own_come_on_top_of_the_environment() {
        let even = Illumination::even(3);
        let mut scene = Scene::default();
        for i in 0..2 * MAX_SUNS {
            scene.lights.push(Light::of(LightSource::Directional {
                to_light: DVec3::Z,
                irradiance: [1.0 + i as f32; 3],
                angle_deg: 0.0,
            }));
        }
        let [source, target] = scene.lights_on([&even, &even], UpAxis::MinusY);
        let up = UpAxis::MinusY;
        assert_eq!(source, scene.objects[0].source.orient(&even, up));
        // A surface turned all ways sees a quarter of what one does that faces the light.
        let more: f32 = (1..=2 * MAX_SUNS).map(|i| i as f32 / 4.0).sum();
        let found = target.mean_irradiance() - even.mean_irradiance();
        assert!((found / more - 1.0).abs() < 1e-3, "{found} {more}");
        let of = |light: &Illumination| {
            light
                .light_samples
                .as_ref()
                .map_or(0.0, |b| b.mean_irradiance())
        };
        let found = of(&target) - of(&even);
        assert!((found / more - 1.0).abs() < 1e-3, "{found} {more}");
        // What the user makes of the environment counts for its share of all.
        let told = Scene {
            environment: EnvironmentLight {
                strength: -10.0,
                ..EnvironmentLight::default()
            },
            ..scene.clone()
        };
        let [_, dimmed] = told.lights_on([&even, &even], UpAxis::MinusY);
        let expected = dimmed.mean_irradiance() / target.mean_irradiance();
        for gain in dimmed.user_gain {
            assert!((gain / expected - 1.0).abs() < 1e-3, "{gain} {expected}");
        }
        let suns = target.light_samples.expect("read with them").suns;
        assert_eq!(suns.len(), MAX_SUNS);
        assert_eq!(
            suns[0].energy,
            [2.0 * MAX_SUNS as f32; 3],
            "the brightest first"
        );
        assert!(suns[0].direction.distance(-Vec3::Y) < 1e-6);
    }
}
