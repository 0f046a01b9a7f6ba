//! Placed lights in the window: added, placed, and rigs.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DQuat, DVec3, Vec3};
use transplat_core::environment::EnvironmentMap;
use transplat_core::environment::MOST_LIGHTS;
use transplat_core::files::{FileKind, file_kind, load_rig, save_rig, write_environment};
use transplat_core::scene::{
    Around, KEY, Light, LightKind, Rig, RigPreset, RigTarget, is_even, moved_lights,
};

use super::session::{Event, Session};
use transplat_engine::environments::SKY_COLUMNS;
use transplat_engine::environments::load_map;
use transplat_engine::jobs::Kind;
use transplat_engine::language::{tr, tr_format, tr_later};
use transplat_engine::names::beside;
use transplat_engine::project::pinned::free;

/// Name of a kind of light.
pub fn kind_name(kind: LightKind) -> &'static str {
    tr(match kind {
        LightKind::Directional => tr_later("sun"),
        LightKind::Point => tr_later("point light"),
        LightKind::Spot => tr_later("spot light"),
        LightKind::Rect => tr_later("area light"),
        LightKind::Disc => tr_later("disc light"),
    })
}

/// Name of a light: its own, or else that of its kind.
pub fn called(light: &Light) -> &str {
    match light.name.is_empty() {
        true => kind_name(light.source.kind()),
        false => &light.name,
    }
}

/// The rigs to begin with.
pub const RIGS: [(RigPreset, &str); 5] = [
    (RigPreset::ThreePoint, tr_later("three point")),
    (RigPreset::Rim, tr_later("rim light")),
    (RigPreset::Overcast, tr_later("overcast")),
    (RigPreset::GoldenHour, tr_later("golden hour")),
    (RigPreset::ProductTable, tr_later("product table")),
];

/// Names of the rigs' lights.
const NAMES: [&str; 10] = [
    tr_later("key"),
    tr_later("fill"),
    tr_later("back"),
    tr_later("rim right"),
    tr_later("rim left"),
    tr_later("overcast sky"),
    tr_later("sun"),
    tr_later("top"),
    tr_later("right"),
    tr_later("left"),
];

/// Where new lights stand: degrees to the right of the camera and above the horizon, the first one first.
const PLACES: [[f64; 2]; 5] = [
    [-45.0, 40.0],
    [55.0, 20.0],
    [150.0, 40.0],
    [-140.0, 25.0],
    [0.0, 70.0],
];

/// Least strength of a rig's light, the first one being 1.
const LEAST_SHARE: f32 = 0.3;

/// Distance of a rig's lights, in radii of all that is shown.
const AWAY: f64 = 3.0;

impl Session {
    /// Subject that lights are placed around.
    pub fn lit(&self) -> RigTarget {
        let bounds = self.project.scene_bounds();
        let center = bounds.map_or(Vec3::ZERO, |b| b.center);
        RigTarget {
            center: self.project.world_from_scene() * center.as_dvec3(),
            radius: bounds.map_or(1.0, |b| f64::from(b.radius).max(1e-6)),
            seen_from: self.project.pose.azimuth,
        }
    }

    /// The number of the light that the panel is about.
    pub fn chosen_light(&self) -> Option<usize> {
        let last = self.project.scene.lights.len().checked_sub(1)?;
        Some(self.selected_light.min(last))
    }

    /// Adds a light of a kind where none stands yet.
    pub fn add_light(&mut self, kind: LightKind) {
        let lit = self.lit();
        let [right, above] = PLACES[self.project.scene.lights.len() % PLACES.len()];
        let placed = lit.around(right, above, AWAY);
        // Several together are to be as bright as one, or not much brighter.
        let share = (self.project.scene.lights.len() as f32 + 1.0)
            .recip()
            .max(LEAST_SHARE);
        let light = Light::placed(kind, placed, share * KEY);
        self.take_light(light, kind_name(kind));
    }

    /// Adds another light like one.
    pub fn duplicate_light(&mut self, at: usize) {
        let mut light = self.project.scene.lights[at].clone();
        let RigTarget { center, .. } = self.lit();
        let aim = light.source.aim(center);
        // To the other side of where it is seen from: two in one place are hard to take.
        let toward = light.source.position().map_or_else(
            || -light.source.direction().unwrap_or(DVec3::Z),
            |p| p - aim,
        );
        let aside = aim + DQuat::from_rotation_z(0.5) * toward;
        light.source.put(aside, aim);
        let name = light.name.clone();
        self.take_light(light, &name);
    }

    fn take_light(&mut self, mut light: Light, name: &str) {
        if !self.has_room_for(1) {
            return;
        }
        light.name = free(
            name,
            self.project.scene.lights.iter().map(|l| l.name.as_str()),
        );
        self.project.scene.add_light(light);
        self.selected_light = self.project.scene.lights.len() - 1;
    }

    /// Checks that there is room for so many more lights, and reports where there is none.
    fn has_room_for(&mut self, more: usize) -> bool {
        let has_room = self.project.scene.lights.len() + more <= MOST_LIGHTS;
        if !has_room {
            self.error(tr_format!(
                "A scene holds up to {MOST_LIGHTS} placed lights. Remove some first.",
                MOST_LIGHTS = MOST_LIGHTS
            ));
        }
        has_room
    }

    /// Takes a rig in the place of the lights there are, with what it has around them.
    pub fn take_rig(&mut self, rig: Rig, from: Option<&Path>) {
        let mut scene = self.project.scene.clone();
        if let Some(around) = &rig.environment {
            let places = [from, self.project.scene.objects[0].source.file.as_deref()];
            scene.environment =
                around.over(&self.project.scene.environment, |file| beside(file, places));
            // It is as bright as it is made.
            scene.match_strength = false;
        }
        scene.set_lights(rig.lights);
        if let Err(error) = scene.validate() {
            return self.error(match from {
                Some(path) => format!("{}: {error}", path.display()),
                None => error.to_string(),
            });
        }
        self.project.scene = scene;
        if let Some(file) = self.project.scene.environment.file.clone() {
            self.project.environments.request(&file);
        }
        self.selected_light = 0;
    }

    /// Takes one of the rigs to begin with.
    pub fn take_preset(&mut self, preset: RigPreset) {
        let mut rig = preset.rig(self.lit());
        for light in &mut rig.lights {
            if let Some(name) = NAMES.into_iter().find(|name| *name == light.name) {
                light.name = tr(name).to_owned();
            }
        }
        self.take_rig(rig, None);
    }

    /// Opens a rig's file.
    pub fn open_rig(&mut self, path: &Path) {
        // Of what is neither a rig nor anything else it is told why.
        let is_other = |kind| !matches!(kind, FileKind::Rig | FileKind::Look);
        if file_kind(path).is_ok_and(is_other) {
            let why = tr("This is not a light rig.");
            return self.error(format!("{}: {why}", path.display()));
        }
        match load_rig(path) {
            Ok(rig) if rig.lights.is_empty() && rig.environment.is_none() => {
                let why = tr("No lights in this file. The placed lights are unchanged.");
                self.error(format!("{}: {why}", path.display()));
            }
            Ok(mut rig) => {
                self.opened.push(path.to_owned());
                // A file has them in the coordinates of the splat's.
                rig.lights = moved_lights(
                    &rig.lights,
                    -self.project.scene.objects[0].origin,
                    self.project.scene_up(),
                );
                self.take_rig(rig, Some(path));
            }
            Err(error) => self.error(error.to_string()),
        }
    }

    /// Writes the lights as a rig; light that is even is around them there, and an environment's file is left to whoever takes the rig.
    pub fn save_rig(&mut self, path: &Path) {
        let around = &self.project.scene.environment;
        let is_even = around.file.as_deref().is_some_and(is_even);
        let uniform = is_even.then(|| Around::Uniform {
            uniform: around.gain(),
        });
        let sky = around.sky().map(|sky| Around::Sky { sky });
        let lights = moved_lights(
            &self.project.scene.lights,
            self.project.scene.objects[0].origin,
            self.project.scene_up(),
        );
        let rig = Rig::of(lights, uniform.or(sky));
        match save_rig(path, &rig) {
            Ok(()) => self.info(tr_format!("Saved {}.", path.display())),
            Err(error) => self.error(error.to_string()),
        }
    }

    /// Writes all that lights the objects as one environment, seen from their middle, and puts it on the shelf.
    pub fn save_environment(&mut self, path: PathBuf) {
        let (scene, place) = (self.project.scene.clone(), self.lit().center);
        let around = self.project.environment.light.clone();
        let [(_, source), _] = self.project.matched_sides();
        let source = source.light.clone();
        let work = move |_: &_| {
            let map = match scene.environment.sky() {
                Some(sky) => Arc::new(sky.dome_map(SKY_COLUMNS)),
                None => load_map(&around)?,
            };
            let lights = [&source.illumination, &around.illumination];
            // The backdrop of even light is grey, and no light.
            let even = EnvironmentMap::even();
            let map = if around.is_even { &even } else { &map };
            let all = scene.light_in_world(lights);
            let map = scene.panorama(map, lights, &all, place, SKY_COLUMNS);
            write_environment(&path, &map)?;
            Ok(path)
        };
        let label = tr("saving the light as an environment");
        self.start(Kind::Export, label, work, |session, path| {
            let saved = tr_format!("Saved {} and added it to the library.", path.display());
            session.info(saved);
            session.events.push(Event::Light(path));
        });
    }

    /// Takes the suns out of the environment: they are lights of one's own from then on.
    pub fn take_out_suns(&mut self) {
        let suns = self.suns();
        if suns.is_empty() {
            return self.info(tr("No sun found: no small spot holds much of the light."));
        }
        if !self.has_room_for(suns.len()) {
            return;
        }
        self.project.scene.environment.without_suns = true;
        for sun in suns {
            self.take_light(sun, kind_name(LightKind::Directional));
        }
    }

    /// The suns of the environment as lights of one's own.
    fn suns(&self) -> Vec<Light> {
        let [source, environment] = self
            .project
            .matched_sides()
            .map(|(_, resolved)| &resolved.light);
        let maps = [&source.illumination, &environment.illumination];
        self.project.scene.suns(maps)
    }

    /// Puts the suns back into the environment, in the place of the lights that were made of them, unless those are others now.
    pub fn put_suns_back(&mut self) {
        for sun in self.suns() {
            let mut all = self.project.scene.lights.iter();
            if let Some(at) = all.position(|light| light.source == sun.source) {
                self.project.scene.remove_light(at);
            }
        }
        self.project.scene.environment.without_suns = false;
    }

    /// Puts a light in a direction of the world from where it shines, as far away from there as it is and not nearer than `least`.
    pub fn put_light(&mut self, at: usize, aim: DVec3, toward: DVec3, least: f64) {
        let RigTarget { radius, .. } = self.lit();
        let light = &mut self.project.scene.lights[at];
        let far = light
            .source
            .position()
            .map_or(AWAY * radius, |p| p.distance(aim));
        let far = far.max(1e-3 * radius).max(least);
        light.source.put(aim + far * toward, aim);
    }
}

/// The direction from which light comes that a surface mirrors to the eye.
pub fn mirrored(normal: Vec3, to_eye: Vec3) -> Vec3 {
    // What mirrors is the side that is seen.
    2.0 * normal.dot(to_eye) * normal - to_eye
}
