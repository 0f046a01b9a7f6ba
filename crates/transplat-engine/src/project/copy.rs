//! Headless copies of a project, to export from while it goes on.

use transplat_core::scene::{Object, Transform};

use crate::environments::Resolved;
use crate::jobs::{Jobs, unwatched};
use crate::object::ObjectState;
use crate::project::{Project, Requested};

impl Project {
    /// A headless copy with all that is made so far, partial bakes and stand-ins for lights among it. It requests nothing yet.
    pub fn copy(&self) -> Self {
        let mut copy = Self {
            pose: self.pose,
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
        copy.surroundings.drop_pending();
        copy.insertion.drop_pending();
        copy.inserted.drop_pending();
        copy.ground.drop_pending();
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

    /// A copy that shows the pinned look on the objects as they stand now, where others are compared with that.
    pub fn copy_of_pinned(&self) -> Option<Self> {
        let pinned = self.compared()?;
        let mut copy = self.copy();
        copy.pinned = None;
        copy.scene = pinned.scene.clone();
        for (pinned, now) in copy.scene.objects.iter_mut().zip(&self.scene.objects) {
            pinned.shown = now.shown;
            pinned.transform = now.transform;
        }
        for state in &mut copy.states {
            state
                .bakes
                .retain(|_, bake| bake.get().is_some_and(|b| b.share == 1.0));
        }
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
