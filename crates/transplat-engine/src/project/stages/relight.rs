//! Stage *relight*: an object that is alone under the target light.

use std::sync::Arc;
use std::time::{Duration, Instant};

use transplat_core::present;
use transplat_core::settings::optimizations::Optimization;
use transplat_core::transfer::{Part, PreparedTransfer, RelitRows};
use transplat_gpu::live::{Drawing, LiveSh};

use crate::jobs::{Kind, Work};
use crate::language::tr;
use crate::object::{Relighting, RelitKey};
use crate::project::Project;
use crate::project::canvas::Canvas;

/// So long a light is the same before the exact one begins.
const REST: Duration = Duration::from_millis(250);

impl Project {
    /// Relights an object that is alone: on the GPU at once, else in a job.
    pub(crate) fn relight(&mut self, at: usize, canvas: &Canvas) {
        let [_, target] = self.oriented_of(at);
        let state = &mut self.states[at];
        let Some(made) = state.prepared.get() else {
            return;
        };
        let (prepared, on_gpu) = (made.prepared.clone(), made.on_gpu);
        let mut key = RelitKey {
            prepared: state.prepared.version(),
            target,
            part: match self.scene.view.part() {
                shown if on_gpu => prepared.computed_part(shown),
                shown => shown,
            },
            unseen: state.unseen.version,
            surroundings: 0,
            coarse: false,
        };
        if state.relit.made_from() == Some(&key) {
            return;
        }
        // Now that it runs, it leaves out what is not seen now.
        if self.scene.transfer.optimizations.has(Optimization::Unseen) {
            state.leave_out_hidden();
            key.unseen = state.unseen.version;
        }
        // Rays to what is near the CPU traces, beside the interface.
        let is_near = !key.target.light.emitters.is_empty();
        let is_traced = is_near && matches!(prepared, PreparedTransfer::Directional(_));
        if !on_gpu || is_traced {
            self.start_relight(at, canvas, prepared, (key, on_gpu));
            return;
        }
        let start = Instant::now();
        let unseen = state.unseen.surfels.clone();
        let relit = canvas
            .live()
            .relight(at, &key.target.light, key.part, &unseen);
        if let Err(error) = relit {
            self.error(error.to_string());
        }
        let timer = &canvas.timers.transfer;
        timer.measure(&canvas.context, start, self.jobs.wake());
        let relighting = self.relighting(at, &key, None);
        self.states[at].relit.set(key, relighting);
    }

    /// Shows another light coarsely where it takes long, the newest whenever the last one is done; whether it is to be awaited.
    fn start_coarse_relight(
        &mut self,
        at: usize,
        canvas: &Canvas,
        prepared: &PreparedTransfer,
        key: &RelitKey,
    ) -> bool {
        let is_drawn_here = Drawing::fastest(&canvas.context) == Drawing::Cpu;
        let state = &mut self.states[at];
        let shown = state.relit.made_from();
        let light_rests = shown.is_some_and(|shown| !shown.coarse && shown.target == key.target);
        let takes_long = state.relit_in_ms >= self.coarse_from_ms;
        if !is_drawn_here || light_rests || !takes_long || key.part != Part::Whole {
            return false;
        }
        let key = RelitKey {
            coarse: true,
            ..key.clone()
        };
        if state.relit.made_from() == Some(&key) {
            // The exact one takes both cores: not before the light rests.
            let since = state.coarse_since.map_or(REST, |at| at.elapsed());
            let rest = REST.saturating_sub(since);
            if !rest.is_zero() {
                (self.jobs.wake())(rest);
            }
            return !rest.is_zero();
        }
        let kind = Kind::Of(state.id, Work::RelightCoarsely);
        if self.jobs.is_running(kind) || !state.relit.ask(&key) {
            return true;
        }
        let (id, prepared, light) = (state.id, prepared.clone(), key.target.clone());
        let work = move |_: &_| {
            let start = Instant::now();
            let tau = prepared.coarse_tau(&light.light)?;
            Ok((tau, start.elapsed().as_secs_f64() * 1e3))
        };
        let label = tr("relighting");
        self.start_or_else(kind, label, work, move |project, done| match done {
            Ok((tau, ms)) => project.show_coarse(id, key, tau, ms),
            Err(error) => {
                project.error(error.to_string());
                project.without_coarse(id);
            }
        });
        true
    }

    fn show_coarse(&mut self, id: u64, key: RelitKey, tau: Option<Vec<[f32; 3]>>, ms: f64) {
        let is_of = |at: &usize| self.states[*at].prepared.version() == key.prepared;
        let Some(at) = self.at(id).filter(is_of) else {
            return;
        };
        let Some(tau) = tau else {
            self.without_coarse(id);
            return;
        };
        let relighting = self.relighting(at, &key, Some(ms));
        let state = &mut self.states[at];
        state.coarse_since = Some(Instant::now());
        if state.relit.accept(key, relighting) {
            // Of a light that is gone: the next exact one gets its room.
            state.readout.clear();
            let colors = present::tau_colors(&tau);
            self.draw(|live| live.set_relit(at, LiveSh::Coarse(Arc::new(tau)), colors));
        }
    }

    /// The exact one of this light is next.
    fn without_coarse(&mut self, id: u64) {
        if let Some(at) = self.at(id) {
            self.states[at].relit_in_ms = 0.0;
        }
    }

    /// Relights on the CPU, one light after the other: the newest there is whenever the last one is done.
    fn start_relight(
        &mut self,
        at: usize,
        canvas: &Canvas,
        prepared: PreparedTransfer,
        (key, on_gpu): (RelitKey, bool),
    ) {
        if !on_gpu && self.start_coarse_relight(at, canvas, &prepared, &key) {
            return;
        }
        let state = &mut self.states[at];
        let kind = Kind::Of(state.id, Work::Relight);
        if self.jobs.is_running(kind) || !state.relit.ask(&key) {
            return;
        }
        let (context, unseen) = (canvas.context.clone(), state.unseen.surfels.clone());
        let (id, wanted) = (state.id, key.clone());
        let work = move |_: &_| {
            let start = Instant::now();
            let drawing = Drawing::fastest(&context);
            let (light, part) = (&wanted.target.light, wanted.part);
            let relit = match drawing {
                Drawing::Cpu => prepared.relight_rows(light, part, &unseen)?,
                Drawing::Gpu => drawing.kept(prepared.relight_seen(light, part, &unseen)?),
            };
            let ms = start.elapsed().as_secs_f64() * 1e3;
            let relit = Arc::new(relit);
            let upload = || LiveSh::new(&context, &relit, drawing);
            let there = (!on_gpu).then(upload);
            Ok((there, relit, ms))
        };
        self.start(kind, tr("relighting"), work, move |project, relit| {
            project.show_relit(id, key, relit);
        });
    }

    fn show_relit(
        &mut self,
        id: u64,
        key: RelitKey,
        (there, relit, ms): (Option<LiveSh>, Arc<RelitRows>, f64),
    ) {
        // One of the last preparation is not shown any more.
        let is_of = |at: &usize| self.states[*at].prepared.version() == key.prepared;
        let Some(at) = self.at(id).filter(is_of) else {
            return;
        };
        let relighting = self.relighting(at, &key, Some(ms));
        let state = &mut self.states[at];
        state.relit_in_ms = ms;
        let (part, shown) = (key.part, key.shown());
        if !state.relit.accept(key, relighting) {
            return;
        }
        if part == Part::Whole && !state.unseen.has_hidden {
            state.readout.set(shown, relit.clone());
        }
        self.draw(|live| match there {
            Some(there) => live.set_relit(at, there, present::tau_colors(&relit.tau)),
            None => live.take_relit(at, &relit, part),
        });
    }

    /// Figures of a relight.
    pub(crate) fn relighting(&self, at: usize, key: &RelitKey, cpu_ms: Option<f64>) -> Relighting {
        let prepared = self.states[at].prepared.get();
        let gain = prepared.map_or(1.0, |p| p.prepared.light_gain());
        let stops = (key.target.light.mean_irradiance() * gain).log2();
        let mut sides = self.sides_of(at).into_iter();
        let is_known = sides.all(|(settings, there)| {
            let file = settings.file.as_ref();
            file.is_none_or(|f| *f == there.light.path)
        });
        Relighting {
            cpu_ms,
            stops_over_source: Some(stops).filter(|s| s.is_finite() && is_known),
        }
    }
}
