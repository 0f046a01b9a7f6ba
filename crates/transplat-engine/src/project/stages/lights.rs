//! Stage *lights*: capture and target light in each object's coordinates.

use std::sync::Arc;

use glam::Vec3;
use transplat_core::scene::{EnvironmentLight, Transform};

use crate::environments::{Environment, Resolved};
use crate::object::{LightsKey, OrientedLight};
use crate::project::Project;

impl Project {
    /// Lights the sides by what the settings name, where it is there.
    pub(crate) fn resolve_lights(&mut self) {
        if let Some(sky) = self.scene.environment.sky() {
            self.environments.make_sky(sky);
        }
        for at in 0..self.scene.objects.len() {
            let [source, _] = self.sides_of(at);
            let completed = self.completed_source(at).map(|made| &made.light);
            if let Some(resolved) = self.resolve(at, source, completed) {
                self.states[at].source = resolved;
            }
        }
        let [_, environment] = self.sides_of(0);
        if let Some(resolved) = self.resolve(0, environment, None) {
            self.environment = resolved;
        }
    }

    /// Light of a side, where it is another than before; as completed, where it was.
    fn resolve(
        &self,
        at: usize,
        (settings, last): (&EnvironmentLight, &Resolved),
        completed: Option<&Arc<Environment>>,
    ) -> Option<Resolved> {
        let file = settings.file.as_ref()?;
        let light = self.light_of(at, file)?;
        if light.is_file() && light.reading != self.scene.reading_of(file) {
            // It is being read otherwise.
            return None;
        }
        let light = completed.cloned().unwrap_or(light);
        let is_new = light.id != last.light.id || *settings != last.settings;
        is_new.then(|| Resolved {
            light,
            settings: settings.clone(),
        })
    }

    /// Turns an object's lights as they are set.
    pub(crate) fn orient_lights(&mut self, at: usize) {
        let (object, up) = (&self.scene.objects[at], self.up_of(at));
        let [(matched, captured_under), _] = self.matched_sides();
        let sides = self.sides_of(at);
        let key: LightsKey = (
            sides.map(|(_, there)| there.light.id),
            sides.map(|(settings, _)| settings.clone()),
            self.scene.match_strength,
            self.scene.lights.clone(),
            [up, self.scene_up()],
            (captured_under.light.id, matched.clone()),
            object.transform,
        );
        if self.states[at].lights.is_asked(&key) {
            return;
        }
        let [source, environment] = sides.map(|(_, there)| &there.light.illumination);
        let source = object.source.orient(source, up);
        // All objects are in one light, which they see as they are turned.
        let maps = [&captured_under.light.illumination, environment];
        let [_, mut target] = self.scene.lights_on(maps, self.scene_up());
        if object.transform != Transform::default() {
            target = target.seen_by(object.transform.scene_from_object());
        }
        let made = [source, target].map(Arc::new);
        let before = self.states[at].lights.get();
        let lights = std::array::from_fn(|side| match before {
            Some(before) if before[side].light == made[side] => before[side].clone(),
            _ => OrientedLight {
                light: made[side].clone(),
            },
        });
        self.states[at].lights.set(key, lights);
    }

    /// Source and target as an asset sees them.
    pub fn oriented_of(&self, at: usize) -> [OrientedLight; 2] {
        // Before the first frame they lie as in their files.
        let unturned = |there: &Resolved| OrientedLight {
            light: Arc::new(there.light.illumination.clone()),
        };
        let lights = self.states[at].lights.get();
        lights
            .cloned()
            .unwrap_or_else(|| self.sides_of(at).map(|(_, there)| unturned(there)))
    }

    /// Direction in the scene that the brightest part of an object's capture light shone on it from; none of even light.
    pub fn brightest_of_capture(&self, at: usize) -> Option<Vec3> {
        let Resolved { light, settings } = &self.states[at].source;
        let in_map = light.brightest?.as_dvec3();
        let on_asset = settings.map_from_asset(self.up_of(at)).transpose() * in_map;
        Some(self.scene.objects[at].transform.rotation * on_asset.as_vec3())
    }
}
