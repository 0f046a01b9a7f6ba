//! How far the picture is what the settings ask for.

use transplat_core::present::View;

use crate::engine::jobs::{Kind, Work};
use crate::engine::object::ObjectState;
use crate::engine::project::Project;
use crate::language::tr;

impl Project {
    /// What a view lacks that shows what is relit, in words.
    pub fn not_final(&self, view: View) -> Option<&'static str> {
        if !view.needs_relit() {
            return None;
        }
        let shown = || self.shown().map(|(at, ..)| &self.states[at]);
        if shown().any(|state| state.relit.get().is_none()) {
            return Some(tr("not relit yet: as captured"));
        }
        if shown().any(ObjectState::is_coarse) {
            return Some(tr("coarse: the light changes"));
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
                true => tr("coarse: visibility is baked in part"),
                false => tr("coarse: visibility is being baked"),
            });
        }
        let is_traced = !self.is_composed() || self.is_traced();
        (!is_traced).then_some(tr("coarse: light between the objects is being traced"))
    }

    /// Whether nothing is being computed that the picture waits for.
    pub fn is_relit_as_set(&self) -> bool {
        if self.states.iter().any(ObjectState::is_coarse) {
            return false;
        }
        let mut running = self.jobs.running().iter();
        let is_beside = |kind: Kind| matches!(kind, Kind::Of(_, Work::Channel | Work::Doubts));
        running.all(|job| is_beside(job.kind))
    }
}
