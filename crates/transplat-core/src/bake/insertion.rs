//! Visibility of objects put into a scene as the paper does it (section 4.2): each by itself, and its shadow on the scene around.

use std::sync::Arc;

use glam::{Quat, Vec3};

use super::harmonic::{self, HarmonicBake};
use crate::error::{Error, Result};
use crate::numeric::smoothstep;
use crate::progress::Progress;
use crate::sh::coefficient_count;
use crate::surfels::{Bounds, SurfelCloud};

/// An object's shadow begins to fade at so many of its radii from its centre, and is gone at the second number.
pub const SHADOW_REACH: [f32; 2] = [3.0, 4.0];

/// An object where it stands in a scene.
#[derive(Clone, Debug)]
pub struct Standing {
    /// Its surfels, in the scene's coordinates.
    pub cloud: Arc<SurfelCloud>,
    /// Visibility of the object by itself.
    pub bake: Arc<HarmonicBake>,
    /// Rotation of the object.
    pub turn: Quat,
}

/// Shadow of an object on the scene around it.
#[derive(Clone, Debug)]
pub struct ShadowBake {
    /// The object.
    pub ball: Bounds,
    /// The scene's surfels that it reaches, and how much of the shadow they get, 0 to 1.
    pub near: Vec<(usize, f32)>,
    /// Surfels around, by themselves.
    pub around: SurfelCloud,
    /// Visibility of those without the object.
    pub without: HarmonicBake,
    /// Visibility with the object: more rows than they are, of which the first are theirs.
    pub with: HarmonicBake,
}

/// A scene, and the objects in it.
#[derive(Clone, Debug)]
pub struct InsertionBake {
    /// The scene first. Surfels are numbered object after object.
    pub objects: Vec<Standing>,
    /// Shadows that reach any of the scene's surfels, each with the index of its object.
    pub shadows: Vec<(usize, Arc<ShadowBake>)>,
    /// Visibility of each surfel within its own object.
    pub together: Arc<HarmonicBake>,
}

impl InsertionBake {
    /// Takes objects where they stand, the scene first; `shadows` is whether they throw any on it. Those that `known` has of the very same
    /// surfels are taken from there.
    ///
    /// # Errors
    /// An object is too large or baked with other directions than the rest, or [`Error::Cancelled`] when `progress` asked for it.
    pub fn new(
        objects: Vec<Standing>,
        shadows: bool,
        known: Option<&Self>,
        progress: Progress<'_>,
    ) -> Result<Self> {
        let directions = objects[0].bake.directions;
        if let Some(other) = objects.iter().find(|o| o.bake.directions != directions) {
            let other = other.bake.directions;
            return Err(Error::Mismatch(format!(
                "objects of a scene are baked with the same directions; {directions} and {other} are not"
            )));
        }
        let count = if shadows { objects.len() } else { 0 };
        let mut made = Vec::new();
        for at in 1..count {
            let shadow = known.and_then(|known| known.shadow_of(&objects[0], &objects[at]));
            let shadow = match shadow {
                Some(known) => Some(known.clone()),
                None => {
                    let share = |done: f64| progress(((at - 1) as f64 + done) / (count - 1) as f64);
                    ShadowBake::new(&objects[0], &objects[at], &share)?.map(Arc::new)
                }
            };
            made.extend(shadow.map(|shadow| (at, shadow)));
        }
        let bakes: Vec<&HarmonicBake> = objects.iter().map(|o| &*o.bake).collect();
        Ok(Self {
            together: Arc::new(HarmonicBake::together(&bakes)),
            objects,
            shadows: made,
        })
    }

    /// The shadow that an object throws on a scene, if both are among these.
    fn shadow_of(&self, scene: &Standing, object: &Standing) -> Option<&Arc<ShadowBake>> {
        let same = |a: &Standing, b: &Standing| Arc::ptr_eq(&a.cloud, &b.cloud);
        let mut shadows = self.shadows.iter();
        let found = shadows.find(|(at, _)| same(&self.objects[*at], object))?;
        let is_on_it = same(&self.objects[0], scene)
            && self.objects[0].bake.directions == scene.bake.directions;
        is_on_it.then_some(&found.1)
    }
}

impl ShadowBake {
    /// Nothing where the object reaches no surfel.
    fn new(scene: &Standing, object: &Standing, progress: Progress<'_>) -> Result<Option<Self>> {
        let ball = object.cloud.bounds();
        let positions = scene.cloud.positions.iter().enumerate();
        let near: Vec<(usize, f32)> = positions
            .map(|(i, place)| (i, reach(*place, &ball)))
            .filter(|(_, share)| *share > 0.0)
            .collect();
        if near.is_empty() {
            return Ok(None);
        }
        let indices: Vec<usize> = near.iter().map(|(i, _)| *i).collect();
        let around = scene.cloud.selected(&indices);
        let mut both = around.clone();
        let blocker = SurfelCloud {
            sh: vec![[0.0; 3]; object.cloud.len() * coefficient_count(around.sh_degree)].into(),
            sh_degree: around.sh_degree,
            ..(*object.cloud).clone()
        };
        both.add(&blocker, 1.0, Vec3::ZERO);
        let directions = scene.bake.directions;
        let without = harmonic::bake(&around, directions, &|done| progress(0.5 * done))?;
        let with = harmonic::bake(&both, directions, &|done| progress(0.5 + 0.5 * done))?;
        Ok(Some(Self {
            ball,
            near,
            around,
            without,
            with,
        }))
    }
}

/// Share of an object's shadow that a place gets, 0 to 1.
fn reach(place: Vec3, ball: &Bounds) -> f32 {
    let radii = place.distance(ball.center) / ball.radius;
    1.0 - smoothstep(SHADOW_REACH[0], SHADOW_REACH[1], radii)
}
