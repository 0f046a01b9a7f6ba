//! Headless copies of a project, to export from while it goes on.

use transplat_core::scene::{Object, Transform};

use crate::environments::Resolved;
use crate::jobs::{Jobs, unwatched};
use crate::object::ObjectState;
use crate::project::{Project, Requested};

impl Project {
    /// A headless copy with all that is made so far. It requests nothing yet, and makes for itself what is still under way here.
    pub fn copy(&self) -> Self {
        let mut copy = Self {
            pose: self.pose,
            viewport: self.viewport,
            states: self.states.iter().map(ObjectState::copy).collect(),
            captures: self.captures.clone(),
            environments: self.environments.clone(),
            environment: self.environment.clone(),
            surroundings: self.surroundings.clone(),
            insertion: self.insertion.clone(),
            inserted: self.inserted.clone(),
            ground: self.ground.clone(),
            pinned: self.pinned.clone(),
            requested: Requested {
                all_terms: true,
                ..Requested::default()
            },
            ..Self::new(
                self.device.clone(),
                Jobs::at_once(unwatched()),
                self.scene_to_save(),
            )
        };
        copy.surroundings.ask_for_made();
        copy.insertion.ask_for_made();
        copy.inserted.ask_for_made();
        copy.ground.ask_for_made();
        copy
    }

    /// A copy that shows one object alone, as it was captured.
    pub fn copy_of_object(&self, at: usize) -> Self {
        let mut copy = self.copy();
        copy.scene.objects = vec![Object {
            shown: true,
            transform: Transform::default(),
            ..copy.scene.objects.swap_remove(at)
        }];
        copy.states = vec![copy.states.swap_remove(at)];
        copy.pinned = None;
        copy
    }

    /// A copy that shows the pinned look, where others are compared with that.
    pub fn copy_of_compared(&self) -> Option<Self> {
        let pinned = self.compared()?;
        let mut copy = self.copy();
        copy.pinned = None;
        copy.scene = pinned.scene.clone();
        copy.environment = Resolved {
            light: pinned.environment.clone(),
            settings: pinned.scene.environment.clone(),
        };
        let captured = pinned.sources.iter().zip(&pinned.scene.objects);
        for (state, (light, object)) in copy.states.iter_mut().zip(captured) {
            state.source = Resolved {
                light: light.clone(),
                settings: object.source.clone(),
            };
        }
        Some(copy)
    }
}
