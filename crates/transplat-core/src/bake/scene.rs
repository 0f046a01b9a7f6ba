//! Bake of several objects: one bake each, and their inter-object visibility.

use std::sync::Arc;

use glam::{Quat, Vec3};

use super::directional::DirectionalBake;
use super::surroundings::{Detail, InterObjectVisibility, PlacedObject};
use crate::error::Result;
use crate::progress::Progress;

/// Visibility of a scene of several objects. Its surfels are numbered object after object.
#[derive(Clone, Debug)]
pub struct SceneBake {
    /// The objects where they stand.
    pub objects: Vec<PlacedObject>,
    /// Inter-object visibility of each object.
    pub surroundings: Vec<Arc<InterObjectVisibility>>,
    /// Unit normals towards the front, in the scene's coordinates. `[n]`
    pub normals: Vec<Vec3>,
}

impl SceneBake {
    /// Traces what the objects see of each other.
    ///
    /// # Errors
    /// They have more surfels than can be told apart, or [`crate::error::Error::Cancelled`] when `progress` asked for it.
    pub fn new(objects: Vec<PlacedObject>, progress: Progress<'_>) -> Result<Self> {
        Self::in_detail(objects, Detail::Full, progress)
    }

    /// Bakes a scene at a level of detail.
    ///
    /// # Errors
    /// As [`SceneBake::new`].
    pub fn in_detail(
        objects: Vec<PlacedObject>,
        detail: Detail,
        progress: Progress<'_>,
    ) -> Result<Self> {
        let total: usize = objects.iter().map(|o| o.bake.len()).sum();
        let mut surroundings = Vec::new();
        let mut done = 0;
        for (which, object) in objects.iter().enumerate() {
            let share = object.bake.len();
            let of_all =
                |part: f64| progress((done as f64 + part * share as f64) / total.max(1) as f64);
            surroundings.push(Arc::new(InterObjectVisibility::trace(
                &objects, which, detail, &of_all,
            )?));
            done += share;
        }
        let normals = objects.iter().flat_map(|o| {
            let turn = o.turn();
            o.bake.normals.iter().map(move |n| turn * *n)
        });
        Ok(Self {
            normals: normals.collect(),
            surroundings,
            objects,
        })
    }

    /// The objects' own bakes.
    pub fn bakes(&self) -> impl Iterator<Item = &DirectionalBake> {
        self.objects.iter().map(|o| &*o.bake)
    }

    /// The object that surfel `i` belongs to, and its number there.
    pub fn locate(&self, i: usize) -> (usize, usize) {
        let after = self.surroundings.partition_point(|s| s.first <= i);
        let object = after.saturating_sub(1);
        (object, i - self.surroundings[object].first)
    }

    /// Property of surfel `i` by its own object's bake.
    pub fn of_surfel<T>(&self, i: usize, of: impl Fn(&DirectionalBake, usize) -> T) -> T {
        let (object, i) = self.locate(i);
        of(&self.objects[object].bake, i)
    }

    /// Range of an object's surfels.
    pub fn surfels_of(&self, object: usize) -> std::ops::Range<usize> {
        let first = self.surroundings[object].first;
        first..first + self.objects[object].bake.len()
    }

    /// Bytes that it takes, beside the objects' own.
    pub fn bytes(&self) -> usize {
        self.surroundings
            .iter()
            .map(|s| s.directional_visibility.bytes())
            .sum()
    }

    /// Openness of each direction around surfel `i`, 0 or 1.
    pub fn seen_by(&self, i: usize) -> Vec<(Vec3, f32)> {
        let (object, i) = self.locate(i);
        let turn = self.objects[object].turn();
        let seen = self.surroundings[object]
            .directional_visibility
            .seen_by(i)
            .into_iter();
        seen.map(|(d, open)| (turn * d, open)).collect()
    }

    /// Cosine-weighted share of the front side's hemisphere that is open, `[n]`, 0 to 1.
    pub fn openness(&self) -> Vec<f32> {
        let objects = 0..self.objects.len();
        objects
            .flat_map(|object| self.openness_of(object))
            .collect()
    }

    /// Openness of one object's surfels.
    pub fn openness_of(&self, object: usize) -> Vec<f32> {
        let directional_visibility = &self.surroundings[object].directional_visibility;
        directional_visibility.openness(&self.objects[object].bake.normals)
    }
}

impl PlacedObject {
    /// Its turn.
    pub fn turn(&self) -> Quat {
        let (_, turn, _) = self.scene_from_object.to_scale_rotation_translation();
        turn
    }
}
