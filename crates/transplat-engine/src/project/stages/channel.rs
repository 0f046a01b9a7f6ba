//! Channels that no target light changes: visibility and materials, made on demand.

use transplat_core::present::{View, material_colors};
use transplat_core::settings::Method;

use crate::jobs::{Kind, Work};
use crate::language::tr;
use crate::object::ChannelKey;
use crate::project::Project;

impl Project {
    /// Colours the channel that is shown.
    pub(crate) fn update_channel(&mut self, at: usize) {
        match self.scene.view {
            View::Visibility => self.update_visibility(at),
            view if view.is_of_materials() => self.start_materials(at, view),
            _ => {}
        }
    }

    fn update_visibility(&mut self, at: usize) {
        let method = self.scene.transfer.method;
        let state = &mut self.states[at];
        let Some(made) = state.bakes.get(&method) else {
            return;
        };
        let Some(bake) = made.get() else {
            return;
        };
        // Among others it sees less.
        let traced = self.surroundings.made_from().map(|(of, _)| of);
        let among = traced.and_then(|of| of.iter().position(|(id, ..)| *id == state.id));
        let among = among.filter(|_| method == Method::Directional);
        let among = among.filter(|_| self.together.contains(&state.id));
        let scene = among.zip(self.surroundings.get());
        let version = scene.map(|_| self.surroundings.version());
        let key = ChannelKey::Visibility(method, made.version(), version);
        if state.channel.ask(&key) {
            let open = match scene {
                Some((object, scene)) => scene.openness_of(object),
                None => bake.bake.openness(),
            };
            let colors = open.into_iter().map(|o| [o; 3]).collect();
            self.draw(|live| live.set_channel(at, View::Visibility, colors));
        }
    }

    fn start_materials(&mut self, at: usize, view: View) {
        let state = &mut self.states[at];
        let Some(prepared) = state.prepared.get() else {
            return;
        };
        let key = ChannelKey::Materials(view, state.prepared.version());
        let kind = Kind::Of(state.id, Work::Channel);
        if state.channel.is_asked(&key) || self.jobs.is_running(kind) {
            return;
        }
        state.channel.ask(&key);
        let (id, prepared) = (state.id, prepared.prepared.clone());
        let work = move |_: &_| Ok(material_colors(view, &prepared));
        self.start(
            kind,
            tr("separating materials"),
            work,
            move |project, colors| {
                let Some(at) = project.at(id) else {
                    return;
                };
                if project.states[at].channel.accept(key, ()) {
                    project.draw(|live| live.set_channel(at, view, colors));
                }
            },
        );
    }
}
