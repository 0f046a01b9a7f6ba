//! Undo history.

use transplat_core::files::look_text;
use transplat_core::scene::{FixedTo, Light, Object, Scene};

use super::rigs::called;
use transplat_engine::language::{tr, tr_format, tr_later};

/// Once settings have stayed so long they are a step to come back to, in seconds.
pub const STEP_S: f64 = 1.0;

/// While they do not stay, there is one every so often.
const LONGEST_CHANGE_S: f64 = 30.0;

/// Steps that are kept.
const MOST_STEPS: usize = 200;

/// Changes of one step that are named.
const MOST_NAMED: usize = 2;

/// A state of the scene, and what led to it.
struct HistoryStep {
    what: String,
    scene: Scene,
}

/// Settings that do not stay yet.
struct HistoryChange {
    began: f64,
    last: f64,
    scene: Scene,
}

/// The scene's states, the oldest first.
#[derive(Default)]
pub struct History {
    steps: Vec<HistoryStep>,
    at: usize,
    change: Option<HistoryChange>,
}

impl History {
    /// Learns how the scene is at a time, in seconds.
    pub fn feed(&mut self, now: f64, scene: &Scene) {
        // From elsewhere, what was set here could not be told from what went along.
        let leaves = |change: &&mut HistoryChange| change.scene.camera != scene.camera;
        if let Some(change) = self.change.as_mut().filter(leaves) {
            let left = change.scene.clone();
            self.take(&left);
        }
        match (self.steps.get_mut(self.at), &mut self.change) {
            (None, _) => self.take(scene),
            (Some(step), _) if is_as(&step.scene, scene) => {
                if step.scene != *scene {
                    step.scene = scene.clone();
                }
                self.change = None;
            }
            (_, Some(change)) => {
                if change.scene != *scene {
                    change.last = now;
                    change.scene = scene.clone();
                }
                if now - change.last >= STEP_S || now - change.began >= LONGEST_CHANGE_S {
                    self.take(scene);
                }
            }
            (_, none) => {
                let scene = scene.clone();
                let (began, last) = (now, now);
                *none = Some(HistoryChange { began, last, scene });
            }
        }
    }

    /// Learns that the light went to a time of its animation: that is no step, if nothing else is another.
    pub fn went_to(&mut self, time: f64, scene: &Scene) {
        let step = self.steps.get_mut(self.at);
        let Some(step) = step.filter(|step| step.scene != *scene) else {
            return;
        };
        let mut then = step.scene.clone();
        then.go_to(time);
        if is_as(&then, scene) {
            step.scene = scene.clone();
            self.change = None;
        }
    }

    /// True while a change is under way that is no step yet.
    pub fn is_in_flux(&self) -> bool {
        self.change.is_some()
    }

    /// True where a scene can be undone.
    pub fn has_undo(&self, scene: &Scene) -> bool {
        self.at > 0 || self.is_new(scene)
    }

    /// True where an undone step can be done again.
    pub fn has_redo(&self, scene: &Scene) -> bool {
        self.at + 1 < self.steps.len() && !self.is_new(scene)
    }

    /// The step before a scene.
    pub fn undo(&mut self, scene: &Scene) -> Option<&Scene> {
        if self.is_new(scene) {
            self.take(scene);
        }
        self.go_to(self.at.checked_sub(1)?)
    }

    /// The step after a scene.
    pub fn redo(&mut self, scene: &Scene) -> Option<&Scene> {
        if self.is_new(scene) {
            return None;
        }
        self.go_to(self.at + 1)
    }

    /// One of the steps.
    pub fn go_to(&mut self, step: usize) -> Option<&Scene> {
        if step <= self.at
            && let Some(change) = self.change.take()
        {
            // What is on its way is a step, too, to come back to.
            self.take(&change.scene);
        }
        let scene = &self.steps.get(step)?.scene;
        self.at = step;
        self.change = None;
        Some(scene)
    }

    /// Steps, the oldest first, and the one that the scene shows.
    pub fn steps(
        &self,
    ) -> (
        impl DoubleEndedIterator<Item = &str> + ExactSizeIterator,
        usize,
    ) {
        (self.steps.iter().map(|step| step.what.as_str()), self.at)
    }

    fn is_new(&self, scene: &Scene) -> bool {
        let now = self.steps.get(self.at);
        now.is_some_and(|step| !is_as(&step.scene, scene))
    }

    fn take(&mut self, scene: &Scene) {
        let last = self.steps.get(self.at);
        let what = last.map_or(tr("Opened").into(), |last| changes(&last.scene, scene));
        self.steps.truncate(self.at + 1);
        let scene = scene.clone();
        self.steps.push(HistoryStep { what, scene });
        if self.steps.len() > MOST_STEPS {
            self.steps.remove(0);
        }
        self.at = self.steps.len() - 1;
        self.change = None;
    }
}

/// True for scenes that differ in the camera at most: lights that are fixed to it went along.
pub fn is_as(step: &Scene, scene: &Scene) -> bool {
    if step.camera == scene.camera {
        return step == scene;
    }
    let mut went_along = step.clone();
    went_along.camera = scene.camera;
    for (light, now) in went_along.lights.iter_mut().zip(&scene.lights) {
        if light.fixed_to == FixedTo::Camera && now.source.kind() == light.source.kind() {
            light.source = now.source.clone();
        }
    }
    went_along == *scene
}

/// Words for the settings of a look: the longest matching beginning counts.
const WORDS: [(&str, &str); 59] = [
    ("animation", tr_later("light animation")),
    ("asset", tr_later("splat")),
    ("background", tr_later("background")),
    ("background_blur", tr_later("blur")),
    ("bookmarks", tr_later("saved views")),
    ("camera", tr_later("view")),
    ("cut", tr_later("cuts")),
    ("difference_scale", tr_later("scale of the difference")),
    ("directions", tr_later("directions")),
    ("display/exposure", tr_later("exposure")),
    ("display/tone_map", tr_later("tone mapping")),
    ("false_color", tr_later("false colours")),
    ("hide", tr_later("filters")),
    ("lights", tr_later("placed lights")),
    ("response", tr_later("camera response")),
    ("lut", tr_later("LUT")),
    ("match_strength", tr_later("match exposure")),
    ("note", tr_later("note")),
    ("objects", tr_later("objects")),
    ("outside_from", tr_later("outside")),
    ("plate", tr_later("photograph")),
    ("shadow_catcher", tr_later("shadow catcher")),
    ("source", tr_later("capture light")),
    ("source/file", tr_later("capture light")),
    ("source/clipped", tr_later("clipped capture light")),
    ("source/layout", tr_later("layout of the capture light")),
    ("source/layer", tr_later("layer of the capture light")),
    ("source/mirror", tr_later("capture light mirrored")),
    ("source/rotation", tr_later("capture light rotated")),
    ("source/strength", tr_later("strength of the capture light")),
    ("source/tilt", tr_later("capture light tilted")),
    ("source/tint", tr_later("tint of the capture light")),
    ("source/trust", tr_later("trust in the capture light")),
    ("source/up", tr_later("up axis of the capture light")),
    ("target", tr_later("light")),
    ("target/file", tr_later("new light")),
    ("target/layout", tr_later("layout of the light")),
    ("target/layer", tr_later("layer of the light")),
    ("target/mirror", tr_later("light mirrored")),
    ("target/rotation", tr_later("light rotated")),
    ("target/sky", tr_later("sun and sky")),
    ("target/strength", tr_later("strength of the light")),
    ("target/tilt", tr_later("light tilted")),
    ("target/tint", tr_later("tint of the light")),
    ("target/up", tr_later("up axis of the light")),
    ("target/without_suns", tr_later("sun converted to light")),
    ("transfer", tr_later("transfer")),
    ("transfer/preset", tr_later("preset")),
    ("transfer/terms", tr_later("terms")),
    ("locked", tr_later("lock")),
    ("name", tr_later("name")),
    ("shown", tr_later("visibility")),
    ("transform/rotation", tr_later("rotated")),
    ("transform/scale", tr_later("scaled")),
    ("transform/translation", tr_later("moved")),
    ("up", tr_later("up axis")),
    ("variants", tr_later("saved looks")),
    ("view", tr_later("comparison")),
    ("wipe", tr_later("split line")),
];

/// Differences of two scenes, in words.
fn changes(before: &Scene, after: &Scene) -> String {
    let value = |scene: &Scene| -> serde_json::Value {
        let text = look_text(scene).unwrap_or_default();
        serde_json::from_str(&text).unwrap_or_default()
    };
    // What a look says of its objects depends on how many they are.
    let others = |scene: &Scene| {
        let objects = vec![Object::default()];
        value(&Scene {
            objects,
            ..scene.clone()
        })
    };
    let (last, now) = (others(before), others(after));
    let mut said = changed_objects(&before.objects, &after.objects);
    let mut found = Vec::new();
    differences(String::new(), &last, &now, &mut found);
    for (path, value) in found {
        if path == "lights" {
            said.extend(changed_lights(&before.lights, &after.lights));
            continue;
        }
        let text = in_words(&path, value);
        if !said.contains(&text) {
            said.push(text);
        }
    }
    if said.len() > MOST_NAMED {
        said.truncate(MOST_NAMED);
        said.push("…".into());
    }
    said.join(", ")
}

/// A setting in words, with its value where that is simple.
fn in_words(path: &str, value: Option<String>) -> String {
    let known = WORDS.iter().filter(|(of, _)| {
        let rest = path.strip_prefix(of);
        rest.is_some_and(|rest| rest.is_empty() || rest.starts_with('/'))
    });
    let words = known.max_by_key(|(of, _)| of.len());
    let is_whole = words.is_some_and(|(of, _)| *of == path);
    let words = words.map_or_else(|| path.replace(['/', '_'], " "), |(_, w)| tr(w).to_owned());
    match value {
        Some(value) if is_whole => format!("{words} {value}"),
        _ => words,
    }
}

/// The one more that the first list has, if the others are all in the second, in their order.
fn one_more<'a, T: PartialEq>(these: &'a [T], others: &[T]) -> Option<&'a T> {
    let same = these.iter().zip(others).take_while(|(a, b)| a == b).count();
    let rest = these.get(same + 1..)?;
    (rest == &others[same..]).then(|| &these[same])
}

/// Differences of the objects, in words; of several, each is named.
fn changed_objects(before: &[Object], after: &[Object]) -> Vec<String> {
    let called = |object: &Object| object.called().unwrap_or_else(|| tr("object").into());
    if let Some(added) = one_more(after, before) {
        return vec![tr_format!("{name}: added", name = called(added))];
    }
    if let Some(removed) = one_more(before, after) {
        return vec![tr_format!("{name}: removed", name = called(removed))];
    }
    if before.len() != after.len() {
        return vec![tr("objects").into()];
    }
    let is_one_of_several = after.len() > 1;
    let mut said = Vec::new();
    for (before, after) in before.iter().zip(after) {
        let value = |object| serde_json::to_value(object).unwrap_or_default();
        let mut found = Vec::new();
        differences(String::new(), &value(before), &value(after), &mut found);
        for (path, value) in found {
            let text = in_words(&path, value);
            said.push(match is_one_of_several {
                true => format!("{}: {text}", called(after)),
                false => text,
            });
        }
    }
    said.dedup();
    said
}

/// Differences of the placed lights, in words.
fn changed_lights(before: &[Light], after: &[Light]) -> Vec<String> {
    if let Some(added) = one_more(after, before) {
        return vec![tr_format!("{name}: added", name = called(added))];
    }
    if let Some(removed) = one_more(before, after) {
        return vec![tr_format!("{name}: removed", name = called(removed))];
    }
    if before.len() != after.len() {
        return vec![tr("placed lights").into()];
    }
    let pairs = before.iter().zip(after).filter(|(a, b)| a != b);
    pairs
        .map(|(a, b)| format!("{}: {}", called(b), changed_in_light(a, b)))
        .collect()
}

fn changed_in_light(before: &Light, after: &Light) -> String {
    let place = |of: &Light| (of.source.position(), of.source.direction());
    let number = |value: f32| simple(&value.into()).unwrap_or_default();
    if before.on != after.on {
        tr(if after.on { "on" } else { "off" }).into()
    } else if before.solo != after.solo {
        let [yes, no] = [tr("solo"), tr("solo off")];
        if after.solo { yes } else { no }.into()
    } else if before.strength != after.strength {
        tr_format!("strength {stops}", stops = number(after.strength))
    } else if (before.tint, before.kelvin) != (after.tint, after.kelvin) {
        tr("colour").into()
    } else if before.name != after.name {
        tr("name").into()
    } else if before.fixed_to != after.fixed_to {
        tr("attachment").into()
    } else if place(before) != place(after) {
        tr("moved").into()
    } else if before.source.emission() != after.source.emission() {
        tr("power").into()
    } else {
        tr("size").into()
    }
}

/// The settings of a look that differ, by their paths, and what those that are simple are now.
fn differences(
    path: String,
    before: &serde_json::Value,
    after: &serde_json::Value,
    found: &mut Vec<(String, Option<String>)>,
) {
    use serde_json::Value;
    match (before, after) {
        _ if before == after => {}
        (Value::Object(a), Value::Object(b)) => {
            let mut names: Vec<&String> = a.keys().chain(b.keys()).collect();
            names.sort();
            names.dedup();
            for name in names.into_iter().filter(|name| *name != "version") {
                let [a, b] = [a, b].map(|of| of.get(name).unwrap_or(&Value::Null));
                let path = if path.is_empty() {
                    name.clone()
                } else {
                    format!("{path}/{name}")
                };
                differences(path, a, b, found);
            }
        }
        _ => found.push((path, simple(after))),
    }
}

fn simple(value: &serde_json::Value) -> Option<String> {
    use serde_json::Value;
    match value {
        Value::Bool(true) => Some(tr("on").into()),
        Value::Bool(false) => Some(tr("off").into()),
        Value::Number(number) => {
            let text = format!("{:.2}", number.as_f64()?);
            Some(text.trim_end_matches('0').trim_end_matches('.').to_owned())
        }
        Value::String(text) => {
            let name = std::path::Path::new(text).file_stem()?;
            Some(name.to_string_lossy().into_owned())
        }
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;
    use transplat_core::camera::CameraPose;
    use transplat_core::scene::{Bookmark, EnvironmentLight, KEY, LightKind, Placed, Variant};
    use transplat_core::surfels::Bounds;

    use super::*;

    fn exposed(stops: f32) -> Scene {
        let mut scene = Scene::default();
        scene.display.exposure = stops;
        scene
    }

    #[test]
    fn what_stays_is_a_step_and_what_is_on_its_way_is_none() {
        let mut history = History::default();
        history.feed(0.0, &exposed(0.0));
        for frame in 1..20 {
            history.feed(0.1 * f64::from(frame), &exposed(frame as f32));
        }
        assert!(history.is_in_flux());
        history.feed(3.0, &exposed(19.0));
        assert!(!history.is_in_flux());
        history.feed(4.0, &exposed(1.5));
        let now = exposed(1.5);
        assert!(history.has_undo(&now) && !history.has_redo(&now));
        // What is undone before it was a step can be done again.
        assert_eq!(history.undo(&now), Some(&exposed(19.0)));
        assert_eq!(history.undo(&exposed(19.0)), Some(&exposed(0.0)));
        assert_eq!(history.undo(&exposed(0.0)), None);
        assert_eq!(history.redo(&exposed(0.0)), Some(&exposed(19.0)));
        assert_eq!(history.redo(&exposed(19.0)), Some(&now));
        let (steps, at) = history.steps();
        let steps: Vec<_> = steps.collect();
        assert_eq!(steps, ["Opened", "exposure 19", "exposure 1.5"]);
        assert_eq!(at, 2);
        // Something else after an undo takes the place of what was undone.
        assert_eq!(history.go_to(0), Some(&exposed(0.0)));
        history.feed(5.0, &exposed(2.0));
        history.feed(7.0, &exposed(2.0));
        assert_eq!(history.steps().0.len(), 2);
        for i in 0..2 * MOST_STEPS {
            history.feed(10.0 * i as f64, &exposed(0.1 * i as f32));
            history.feed(10.0 * i as f64 + 5.0, &exposed(0.1 * i as f32));
        }
        assert_eq!(history.steps().0.len(), MOST_STEPS);
    }

    fn light(position: DVec3) -> Light {
        let placed = Placed {
            position,
            aim: DVec3::ZERO,
            radius: 1.0,
        };
        Light {
            fixed_to: FixedTo::Camera,
            ..Light::placed(LightKind::Spot, placed, KEY)
        }
    }

    /// Where the light went to another time of its animation, that is no step; what else is set is.
    #[test]
    fn the_light_over_time_makes_no_steps() {
        let mut scene = Scene::default();
        for (time, rotation) in [(0.0, 0.0), (4.0, 90.0)] {
            scene.environment.rotation = rotation;
            let key = scene.light_key(time);
            scene.animation.keys.push(key);
        }
        scene.go_to(0.0);
        let mut history = History::default();
        history.feed(0.0, &scene);
        for frame in 1..=40 {
            let now = f64::from(frame);
            scene.go_to(0.1 * now);
            history.went_to(0.1 * now, &scene);
            history.feed(now, &scene);
        }
        assert_eq!(scene.environment.rotation, 90.0);
        assert!(!history.has_undo(&scene) && !history.is_in_flux());
        scene.display.exposure = 1.0;
        history.went_to(4.0, &scene);
        history.feed(50.0, &scene);
        history.feed(60.0, &scene);
        // It goes back to where the light is, not to where it began.
        let undone = history.undo(&scene).expect("a step");
        assert_eq!(
            (undone.display.exposure, undone.environment.rotation),
            (0.0, 90.0)
        );
    }

    /// A light that goes along with the camera makes no steps of that; what it is set to does.
    #[test]
    fn what_goes_along_with_the_camera_is_no_step() {
        let bounds = Bounds {
            center: glam::Vec3::ZERO,
            radius: 1.0,
        };
        let seen = |azimuth: f64, position: DVec3| Scene {
            camera: Some(CameraPose::around(&bounds, azimuth, 0.0, 1.0, 40.0)),
            lights: vec![light(position)],
            ..Scene::default()
        };
        let (x, y) = (DVec3::X, DVec3::Y);
        let mut history = History::default();
        history.feed(0.0, &seen(0.0, x));
        history.feed(5.0, &seen(90.0, y));
        assert!(!history.has_undo(&seen(90.0, y)) && !history.is_in_flux());
        history.feed(10.0, &seen(90.0, x));
        history.feed(20.0, &seen(90.0, x));
        assert!(history.has_undo(&seen(90.0, x)));
        assert_eq!(history.undo(&seen(90.0, x)), Some(&seen(90.0, y)));
    }

    #[test]
    fn a_step_is_called_by_what_it_changed() {
        let before = Scene::default();
        let mut after = before.clone();
        after.environment = EnvironmentLight {
            rotation: 30.0,
            ..EnvironmentLight::of("a/sunset.hdr")
        };
        let what = changes(&before, &after);
        assert_eq!(what, "new light sunset, light rotated 30");
        after.transfer.terms.shadow = false;
        assert!(changes(&before, &after).ends_with(", …"));
        let mut moved = before.clone();
        moved.objects[0].transform.scale = 2.0;
        assert_eq!(changes(&before, &moved), "scaled 2");
        let mut both = moved.clone();
        both.objects.push(Object {
            name: Some("vase".into()),
            ..Object::default()
        });
        assert_eq!(changes(&moved, &both), "vase: added");
        let mut turned = both.clone();
        turned.objects[1].transform.rotation = glam::Quat::from_rotation_x(1.0);
        assert_eq!(changes(&both, &turned), "vase: rotated");
        // A light is called by its name, and by what it was set to.
        let one = |set: &dyn Fn(&mut Light)| {
            let mut lights = [DVec3::X, DVec3::Y].map(light);
            lights[1].name = "key".into();
            lights[0].name.clear();
            set(&mut lights[1]);
            lights.to_vec()
        };
        let lit = |lights| Scene {
            lights,
            ..before.clone()
        };
        let both = one(&|_| {});
        for (lights, said) in [
            (one(&|l| l.strength = 1.5), "key: strength 1.5"),
            (one(&|l| l.on = false), "key: off"),
            (one(&|l| l.source.put(-DVec3::X, DVec3::ZERO)), "key: moved"),
            (both[..1].to_vec(), "key: removed"),
            (both[1..].to_vec(), "spot light: removed"),
            (Vec::new(), "placed lights"),
        ] {
            assert_eq!(changes(&lit(both.clone()), &lit(lights)), said);
        }
        let added = changes(&lit(both[..1].to_vec()), &lit(both.clone()));
        assert_eq!(added, "key: added");
        // No setting lacks its words.
        let bounds = Bounds {
            center: glam::Vec3::ZERO,
            radius: 1.0,
        };
        let mut full = before.clone();
        (full.lut, full.plate) = (Some("a.cube".into()), Some("a.png".into()));
        full.note = "a note".into();
        full.lights = vec![light(DVec3::X)];
        full.animation.keys.push(full.light_key(0.0));
        full.bookmarks = vec![Bookmark {
            name: "a view".into(),
            camera: CameraPose::around(&bounds, 0.0, 0.0, 1.0, 40.0),
        }];
        full.variants = vec![Variant {
            name: "a look".into(),
            look: before.look_alone(),
        }];
        let text = look_text(&full).expect("plain data");
        let look: serde_json::Value = serde_json::from_str(&text).expect("a look");
        for name in look.as_object().expect("settings").keys() {
            let is_said = WORDS
                .iter()
                .any(|(of, _)| of.split('/').next() == Some(name));
            let is_none = name == "version";
            assert!(is_said || is_none, "{name}");
        }
    }
}
