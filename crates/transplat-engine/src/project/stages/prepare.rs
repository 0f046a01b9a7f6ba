//! Stage *prepare*: the transfer from the source light.

use std::sync::Arc;
use std::time::Instant;

use transplat_core::settings::Method;
use transplat_core::transfer::PreparedTransfer;
use transplat_gpu::live::Drawing;
use transplat_gpu::transfer::GpuTransfer;
use transplat_gpu::{Context, GpuError};

use crate::capture::CutPart;
use crate::jobs::{Handle, Kind, Work};
use crate::language::tr_format;
use crate::object::{PrepareKey, Prepared};
use crate::project::{Change, Project};

/// From so many surfels on gloss is left to the whole bake.
const PREPARED_TWICE: usize = 200_000;

impl Project {
    /// All that an object's preparation depends on, as it is now.
    fn prepare_key(&self, at: usize) -> Option<PrepareKey> {
        let [source, _] = self.oriented_of(at);
        let mut settings = self.scene.transfer.clone();
        let state = &self.states[at];
        let bake = state.bakes.get(&settings.method)?;
        // Of many surfels, what they mirror takes longest to find, and would be found anew with the whole bake.
        let surfels = state.asset.as_ref().map_or(0, |a| a.cloud.len());
        let is_soon_anew = self.is_bake_awaited(at, settings.method);
        if surfels >= PREPARED_TWICE && is_soon_anew && state.bake_share(settings.method) < 1.0 {
            settings.terms.lobe = false;
        }
        Some(PrepareKey {
            bake: bake.version(),
            source,
            settings,
        })
    }

    /// True where an object is prepared as all is set now.
    pub fn is_prepared(&self, at: usize) -> bool {
        let made_from = self.states[at].prepared.made_from();
        made_from.is_some() && made_from == self.prepare_key(at).as_ref()
    }

    /// Starts to prepare an object's transfer where its inputs changed.
    pub(crate) fn start_prepare(&mut self, at: usize) {
        let is_alone = self.canvas.is_some()
            || !self.is_composed()
            || self.scene.transfer.method == Method::Directional;
        let is_requested = self.requested.transfers && self.is_used(at) && is_alone;
        let is_baked = self.is_baked_as_set(at, self.scene.transfer.method);
        if !is_requested || !is_baked || self.waits_for_capture_light(at) {
            return;
        }
        let [_, target] = self.oriented_of(at);
        let Some(key) = self.prepare_key(at) else {
            return;
        };
        let state = &mut self.states[at];
        let kind = Kind::Of(state.id, Work::Prepare);
        let bake = state.bakes.get(&key.settings.method).and_then(|b| b.get());
        let (Some(asset), Some(bake)) = (&state.asset, bake) else {
            return;
        };
        if self.jobs.is_running(kind) || !state.prepared.ask(&key) {
            return;
        }
        let (id, bake, cloud) = (state.id, bake.bake.clone(), asset.cloud.clone());
        let (part, asset_name) = (asset.part.clone(), asset.name());
        let (canvas, transfer) = (self.canvas.clone(), state.transfer.clone());
        let (wanted, is_isolated) = (key.clone(), self.is_isolated(at));
        let work = move |handle: &Handle<Change>| {
            let start = Instant::now();
            let (source, settings) = (&wanted.source.light, &wanted.settings);
            let among_rest = |_: &&CutPart| settings.method == Method::Directional && !is_isolated;
            let prepared = match part.as_ref().filter(among_rest) {
                Some(part) => part.prepare(&bake, source, settings)?,
                None => {
                    let mut transfer = transfer.lock().unwrap_or_else(|p| p.into_inner());
                    let report = |done| handle.progress(done);
                    transfer.prepare(&cloud, &bake, wanted.bake, source, settings, &report)?
                }
            };
            let live = canvas.map(|c| on_gpu(&c.context, &prepared)).transpose()?;
            let live = live.flatten();
            if let Some(live) = &live {
                live.warm_up(&target.light);
            }
            let made = Prepared {
                skipped_work: prepared.skipped_work(&cloud),
                prepared,
                on_gpu: live.is_some(),
                ms: start.elapsed().as_secs_f64() * 1e3,
            };
            Ok((made, live))
        };
        let take = move |project: &mut Self, (made, live): (Prepared, Option<GpuTransfer>)| {
            let Some(at) = project.at(id) else {
                return;
            };
            if project.states[at].prepared.accept(key, made) {
                project.stages.prepare += 1;
                // What is relit together is not drawn from there.
                if let Some(live) = live.filter(|_| !project.together.contains(&id)) {
                    project.draw(|drawn| drawn.set_transfer(at, live));
                }
            }
        };
        self.start(kind, tr_format!("preparing {}", asset_name), work, take);
    }
}

/// A transfer on the GPU, if that is where it is drawn; what the adapter has no room for is relit on the CPU as well.
fn on_gpu(
    context: &Arc<Context>,
    prepared: &PreparedTransfer,
) -> Result<Option<GpuTransfer>, GpuError> {
    let is_of_one = match prepared {
        PreparedTransfer::Directional(_) | PreparedTransfer::Harmonic(_) => true,
        PreparedTransfer::Scene(_) | PreparedTransfer::HarmonicScene(_) => false,
    };
    let serves = is_of_one && Drawing::fastest(context) == Drawing::Gpu;
    match serves
        .then(|| GpuTransfer::new(context, prepared))
        .transpose()
    {
        Err(_) if !context.is_lost() => Ok(None),
        made => made,
    }
}
