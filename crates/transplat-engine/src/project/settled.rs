//! Completeness of the image against the settings.

use anyhow::{Result, bail};
use transplat_core::present::View;
use transplat_core::transfer::PreparedTransfer;

use crate::jobs::{Kind, Work};
use crate::language::{tr, tr_format};
use crate::object::ObjectState;
use crate::project::Project;
use crate::reading::Reading;

impl Project {
    /// Reason why a relit view is not final, in words.
    pub fn not_final(&self, view: View) -> Option<&'static str> {
        if !view.needs_relit() {
            return None;
        }
        let shown = || self.shown().map(|(at, ..)| &self.states[at]);
        if shown().any(|state| state.relit.get().is_none()) {
            return Some(tr("Not relit yet"));
        }
        if shown().any(ObjectState::is_coarse) {
            return Some(tr("Coarse: the light is changing"));
        }
        let method = self.scene.transfer.method;
        let is_whole = |state: &ObjectState| {
            let Some(bake) = state.bakes.get(&method) else {
                return false;
            };
            // What is shown may be of the bake before.
            let of = state.prepared.made_from().map(|key| key.bake);
            bake.current().is_some_and(|b| b.share == 1.0) && of == Some(bake.version())
        };
        if !shown().all(is_whole) {
            let is_stopped = self.shown().any(|(at, ..)| self.is_stopped(at));
            return Some(match is_stopped {
                true => tr("Coarse: partly baked"),
                false => tr("Coarse: baking visibility"),
            });
        }
        let is_estimating = |at: usize| {
            let is_needed = self.scene.objects[at].source.is_estimate();
            is_needed && self.is_estimate_awaited(at)
        };
        if self.shown().any(|(at, ..)| is_estimating(at)) {
            return Some(tr("Coarse: estimating the capture light"));
        }
        let is_traced = !self.is_composed() || self.is_traced();
        (!is_traced).then_some(tr("Coarse: tracing light between objects"))
    }

    /// Checks that what is shown is loaded as its settings say.
    ///
    /// # Errors
    /// A splat is still being read.
    pub fn check_loaded(&self) -> Result<()> {
        let listed = self.scene.objects.iter().zip(&self.states).enumerate();
        let mut awaited = listed.filter(|(at, (object, state))| {
            let is_listed = object.shown && object.asset.is_some();
            // One that is to be read in another way is still what it was.
            let asset = state.asset.as_ref();
            let is_there = asset.is_some_and(|a| a.reading == Reading::of(object));
            is_listed && !is_there && !self.is_missing(*at)
        });
        let Some(name) = awaited.next().map(|(at, _)| self.called(at)) else {
            return Ok(());
        };
        bail!(tr_format!(
            "{name} is still loading. Try again when that is done.",
            name = name
        ))
    }

    /// Transfer of several objects as they stand now, and not as they stood before the last move. See [`Project::scene_transfer`].
    pub fn scene_transfer_of_now(&self) -> Option<(Vec<usize>, PreparedTransfer)> {
        self.scene_transfer().filter(|(members, _)| {
            self.is_traced() && members.iter().all(|at| self.is_prepared(*at))
        })
    }

    /// True where nothing is being computed that the image waits for.
    pub fn is_relit_as_set(&self) -> bool {
        if self.states.iter().any(ObjectState::is_coarse) {
            return false;
        }
        let mut running = self.jobs.running().iter();
        let is_beside = |kind: Kind| matches!(kind, Kind::Of(_, Work::Channel | Work::Confidence));
        running.all(|job| is_beside(job.kind))
    }
}
