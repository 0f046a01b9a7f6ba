//! Animation of the light by keys.

use serde::{Deserialize, Serialize};

use super::light::{EnvironmentLight, STOPS, wrap};
use super::rig::Light;
use crate::environment::{PlaceAndTime, Sky, Sun};
use crate::error::{Error, Result, ensure};

/// Light that changes over time.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Animation {
    /// The earliest first.
    pub keys: Vec<LightKey>,
}

/// The light at a time: what of it is animated.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct LightKey {
    /// In seconds from the beginning.
    pub time: f64,
    /// Easing from here to the next key.
    #[serde(default)]
    pub ease: Ease,
    /// The environment's turn, in degrees; from key to key it goes the shorter way.
    pub rotation: f64,
    /// Its tilt, in degrees.
    pub tilt: f64,
    /// Its strength, in stops.
    pub strength: f32,
    /// Where the sun stands, where the environment is sun and sky: of a place it is the hour that changes.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sun: Option<Sun>,
    /// Strengths of the lights of one's own in stops, in their order; none of one that is off.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub lights: Vec<Option<f32>>,
}

/// Easing from one state to another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Ease {
    /// Evenly.
    Linear,
    /// Slowly at either end.
    #[default]
    Smooth,
}

/// Keys of an animation, and seconds that it takes, at most.
pub const MOST_KEYS: usize = 500;
/// Longest animation, in seconds.
pub const LONGEST: f64 = 3600.0;

/// Frames that are drawn of an animation, at most.
pub const MOST_FRAMES: usize = 20_000;

/// Keys that are nearer in time are one, in seconds.
const SAME_TIME: f64 = 5e-3;

impl Ease {
    /// Share of the state, 0 to 1, once that share of the time is over.
    pub fn share(self, over: f64) -> f64 {
        match self {
            Self::Linear => over,
            Self::Smooth => over * over * (3.0 - 2.0 * over),
        }
    }
}

impl LightKey {
    /// The light as it is set.
    pub fn of(environment: &EnvironmentLight, lights: &[Light], time: f64) -> Self {
        Self {
            time,
            ease: Ease::default(),
            rotation: environment.rotation,
            tilt: environment.tilt,
            strength: environment.strength,
            sun: environment.sky().map(|sky| sky.sun),
            lights: lights.iter().map(|l| l.on.then_some(l.strength)).collect(),
        }
    }

    /// Sets the light as it says.
    pub fn apply(&self, environment: &mut EnvironmentLight, lights: &mut [Light]) {
        environment.rotation = self.rotation;
        environment.tilt = self.tilt;
        environment.strength = self.strength;
        if let (Some(sun), Some(sky)) = (self.sun, environment.sky()) {
            environment.sky = Some(Sky { sun, ..sky });
        }
        for (light, strength) in lights.iter_mut().zip(&self.lights) {
            light.on = strength.is_some();
            light.strength = strength.unwrap_or(light.strength);
        }
    }

    /// Key between this one and a later one, at a time.
    fn between(&self, next: &Self, time: f64) -> Self {
        let over = (time - self.time) / (next.time - self.time).max(f64::MIN_POSITIVE);
        let share = self.ease.share(over.clamp(0.0, 1.0));
        let mix = |a: f64, b: f64| a + (b - a) * share;
        let angle = |a: f64, b: f64| wrap(a + wrap(b - a) * share);
        let stops = |a: f32, b: f32| mix(a.into(), b.into()) as f32;
        let lights = 0..self.lights.len().max(next.lights.len());
        let each = lights.map(|i| (self.lights.get(i), next.lights.get(i)));
        Self {
            time,
            ease: self.ease,
            rotation: angle(self.rotation, next.rotation),
            tilt: angle(self.tilt, next.tilt),
            strength: stops(self.strength, next.strength),
            sun: self.sun.map(|sun| sun_between(sun, next.sun, mix, angle)),
            lights: each
                .map(|of| match of {
                    (Some(Some(a)), Some(Some(b))) => Some(stops(*a, *b)),
                    // What goes on or off does so by what it gives, which no stops tell.
                    (Some(a), Some(b)) => {
                        let gain = |s: &Option<f32>| s.map_or(0.0, |s| f64::from(s).exp2());
                        let gain = mix(gain(a), gain(b));
                        (gain > 0.0).then(|| (gain.log2() as f32).max(*STOPS.start()))
                    }
                    // One that only one of them knows is as that has it.
                    (a, b) => a.or(b).copied().flatten(),
                })
                .collect(),
        }
    }

    fn validate(&self) -> Result<()> {
        ensure((0.0..=LONGEST).contains(&self.time), || {
            format!("its time {} is out of range 0 to {LONGEST} s", self.time)
        })?;
        let mut strengths = self.lights.iter().flatten().chain([&self.strength]);
        ensure(strengths.all(|s| STOPS.contains(s)), || {
            "a strength is out of range -60 to 60 stops".into()
        })?;
        ensure(self.rotation.is_finite() && self.tilt.is_finite(), || {
            "its turn is not a number".into()
        })?;
        self.sun.map_or(Ok(()), |sun| sun.validate())
    }
}

/// Where the sun is between two places: at another hour of the same day, or on the way from one to the other.
fn sun_between(
    sun: Sun,
    next: Option<Sun>,
    mix: impl Fn(f64, f64) -> f64,
    angle: impl Fn(f64, f64) -> f64,
) -> Sun {
    match (sun, next) {
        (Sun::Of(now), Some(Sun::Of(later)))
            if now
                == (PlaceAndTime {
                    hour: now.hour,
                    ..later
                }) =>
        {
            Sun::Of(PlaceAndTime {
                hour: mix(now.hour, later.hour),
                ..now
            })
        }
        (_, Some(next)) => {
            let [[a, low], [b, high]] = [sun, next].map(|sun| sun.angles());
            Sun::At {
                azimuth: angle(a, b),
                elevation: mix(low, high),
            }
        }
        (sun, None) => sun,
    }
}

impl Animation {
    /// True where nothing changes.
    pub fn is_empty(&self) -> bool {
        self.keys.is_empty()
    }

    /// Duration in seconds.
    pub fn seconds(&self) -> f64 {
        self.keys.last().map_or(0.0, |key| key.time)
    }

    /// The light at a time: before the first key and after the last it is theirs.
    pub fn at(&self, time: f64) -> Option<LightKey> {
        let after = self.keys.partition_point(|key| key.time <= time);
        let held = |key: &LightKey| LightKey {
            time,
            ..key.clone()
        };
        let light = match (after.checked_sub(1), self.keys.get(after)) {
            (Some(before), Some(next)) => self.keys[before].between(next, time),
            (Some(last), None) => held(&self.keys[last]),
            (None, next) => held(next?),
        };
        let sun = self.sun_at(time);
        Some(LightKey { sun, ..light })
    }

    /// Where the sun stands at a time, by those keys that tell: one that was set under another light does not.
    fn sun_at(&self, time: f64) -> Option<Sun> {
        let told = || self.keys.iter().filter(|key| key.sun.is_some());
        let before = told().rfind(|key| key.time <= time);
        let next = told().find(|key| key.time > time);
        match (before, next) {
            (Some(before), Some(next)) => before.between(next, time).sun,
            (only, none) => only.or(none)?.sun,
        }
    }

    /// Sets a key in the place of one at its time, if there is one.
    pub fn set(&mut self, key: LightKey) {
        match self.key_at(key.time) {
            Some(at) => {
                let time = self.keys[at].time;
                self.keys[at] = LightKey { time, ..key };
            }
            None => {
                let at = self.keys.partition_point(|other| other.time < key.time);
                self.keys.insert(at, key);
            }
        }
    }

    /// The number of the key at a time.
    pub fn key_at(&self, time: f64) -> Option<usize> {
        let is_then = |key: &LightKey| (key.time - time).abs() < SAME_TIME;
        self.keys.iter().position(is_then)
    }

    /// Knows another light of one's own, the last one, as it is now.
    pub(super) fn add_light(&mut self, light: &Light) {
        for key in &mut self.keys {
            key.lights.push(light.on.then_some(light.strength));
        }
    }

    /// Forgets one of the lights of one's own.
    pub(super) fn remove_light(&mut self, at: usize) {
        for key in &mut self.keys {
            if at < key.lights.len() {
                key.lights.remove(at);
            }
        }
    }

    /// Number of frames at so many a second, the last key's among them.
    pub fn frames(&self, frame_rate: u32) -> usize {
        (self.seconds() * f64::from(frame_rate)).round() as usize + 1
    }

    pub(super) fn validate(&self) -> Result<()> {
        ensure(self.keys.len() <= MOST_KEYS, || {
            format!("more than {MOST_KEYS} keys of light")
        })?;
        let ascend = self.keys.windows(2).all(|k| k[0].time < k[1].time);
        ensure(ascend, || {
            "the keys of the light are to be in the order of their times".into()
        })?;
        for (i, key) in self.keys.iter().enumerate() {
            key.validate()
                .map_err(|why| Error::Mismatch(format!("key {} of the light: {why}", i + 1)))?;
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::Date;
    use crate::scene::SKY;

    fn key(time: f64, rotation: f64, lights: &[Option<f32>]) -> LightKey {
        LightKey {
            time,
            ease: Ease::Linear,
            rotation,
            tilt: 0.0,
            strength: 0.0,
            sun: None,
            lights: lights.to_vec(),
        }
    }

    #[test]
    fn the_light_is_that_of_its_keys_and_between_them() {
        let mut animation = Animation::default();
        assert_eq!(animation.at(1.0), None);
        animation.set(key(2.0, -170.0, &[None, Some(2.0)]));
        animation.set(key(0.0, 170.0, &[Some(0.0), Some(0.0)]));
        assert_eq!((animation.seconds(), animation.frames(24)), (2.0, 49));
        let at = |time| animation.at(time).expect("it has keys");
        // The shorter way round, and held at the ends.
        assert_eq!(at(-1.0).rotation, 170.0);
        assert!((at(0.5).rotation - 175.0).abs() < 1e-9);
        assert!((at(1.5).rotation + 175.0).abs() < 1e-9);
        assert_eq!(at(9.0).lights, [None, Some(2.0)]);
        // Half of it is gone at half of the time: a stop; of the other, half of the stops.
        let half = at(1.0).lights;
        assert!((half[0].expect("it shines still") + 1.0).abs() < 1e-5);
        assert_eq!(half[1], Some(1.0));
        // Smooth: slow at the ends, the same in the middle.
        animation.keys[0].ease = Ease::Smooth;
        let at = |time: f64| wrap(animation.at(time).expect("it has keys").rotation - 170.0);
        assert!((at(1.0) - 10.0).abs() < 1e-9 && at(0.2) < 1.0 && at(1.8) > 19.0);
    }

    /// Keys that were set under another light know no sun: where it stands those tell that do.
    #[test]
    fn the_sun_stands_where_the_keys_that_know_it_say() {
        let mut animation = Animation::default();
        let up = |elevation| {
            Some(Sun::At {
                azimuth: 0.0,
                elevation,
            })
        };
        for (time, sun) in [
            (0.0, None),
            (1.0, up(10.0)),
            (2.0, None),
            (3.0, up(30.0)),
            (4.0, None),
        ] {
            let key = key(time, 0.0, &[]);
            animation.set(LightKey { sun, ..key });
        }
        for (time, elevation) in [(0.5, 10.0), (1.5, 15.0), (2.0, 20.0), (4.0, 30.0)] {
            let sun = animation.at(time).and_then(|light| light.sun);
            let found = sun.expect("a key tells").angles()[1];
            assert!((found - elevation).abs() < 1e-9, "{time}: {found}");
        }
    }

    /// Lights that come and go keep their keys; a light that a key does not know is as the other has it.
    #[test]
    fn keys_are_of_the_lights_there_are() {
        let mut scene = crate::scene::Scene::default();
        let light = |strength| Light {
            strength,
            ..Light::of(crate::scene::LightSource::Point {
                position: glam::DVec3::Z,
                intensity: [1.0; 3],
            })
        };
        scene.add_light(light(1.0));
        scene.animation.set(scene.light_key(0.0));
        scene.lights[0].strength = 3.0;
        scene.animation.set(scene.light_key(2.0));
        scene.add_light(light(-1.0));
        let at = |scene: &crate::scene::Scene, time| {
            scene.animation.at(time).expect("it has keys").lights
        };
        scene
            .animation
            .keys
            .iter_mut()
            .for_each(|k| k.ease = Ease::Linear);
        assert_eq!(at(&scene, 1.0), [Some(2.0), Some(-1.0)]);
        scene.remove_light(0);
        assert_eq!((scene.lights.len(), at(&scene, 1.0)), (1, vec![Some(-1.0)]));
        scene.animation.keys[0].lights.clear();
        assert_eq!(at(&scene, 1.0), [Some(-1.0)]);
        // What is hardly another time is the same key.
        scene.animation.set(scene.light_key(2.001));
        assert_eq!(scene.animation.keys.len(), 2);
        scene.set_lights(vec![light(0.0); 3]);
        assert!(scene.animation.keys.iter().all(|k| k.lights.is_empty()));
    }

    #[test]
    fn a_day_goes_by_the_clock() {
        let at = |hour| {
            Sun::Of(PlaceAndTime {
                latitude: 50.0,
                longitude: 10.0,
                date: Date {
                    year: 2026,
                    month: 6,
                    day: 21,
                },
                hour,
                utc_offset: 2.0,
            })
        };
        let mut environment = EnvironmentLight::of(SKY);
        environment.sky = Some(Sky {
            sun: at(6.0),
            ..Sky::default()
        });
        let morning = LightKey::of(&environment, &[], 0.0);
        let noon = LightKey {
            time: 4.0,
            sun: Some(at(12.0)),
            ..morning.clone()
        };
        let animation = Animation {
            keys: vec![morning, noon],
        };
        let then = animation.at(2.0).expect("it has keys");
        assert_eq!(then.sun, Some(at(9.0)));
        then.apply(&mut environment, &mut []);
        assert_eq!(environment.sky().map(|sky| sky.sun), Some(at(9.0)));
        // What is no key of a look is refused.
        let mut wrong = animation.clone();
        wrong.keys[1].time = 0.0;
        assert!(wrong.validate().is_err());
        assert!(animation.validate().is_ok());
    }
}
