//! Confidence map of the relit colours, and their readout, made on demand.

use std::sync::Arc;

use transplat_core::present::{self, LowConfidence, View};
use transplat_core::transfer::{Part, RelitRows};

use crate::jobs::{Kind, Work};
use crate::language::tr;
use crate::object::{ConfidenceMap, ShownKey};
use crate::project::Project;

/// Weight of a mark over a surfel's colour.
const MARK_WEIGHT: f32 = 0.75;

impl ConfidenceMap {
    fn new(of: Vec<Option<LowConfidence>>) -> Self {
        let n = of.len().max(1) as f32;
        let share =
            |which: LowConfidence| of.iter().filter(|d| **d == Some(which)).count() as f32 / n;
        Self {
            shares: LowConfidence::ALL.map(share),
            of,
        }
    }
}

impl Project {
    /// Rates the confidence of the relit surfels where a client shows it.
    pub(crate) fn start_confidence(&mut self, at: usize) {
        let Some(bake) = self.baked_of(at).map(|b| b.bake.clone()) else {
            return;
        };
        let shows = self.shows_confidence();
        let state = &mut self.states[at];
        let (Some(asset), Some(prepared), Some(relit)) =
            (&state.asset, state.prepared.get(), state.relit.made_from())
        else {
            return;
        };
        let (key, kind) = (relit.shown(), Kind::Of(state.id, Work::Confidence));
        // What is shown may still be of the last preparation, or soon be another light's.
        if relit.coarse || key.0 != state.prepared.version() || self.jobs.is_running(kind) {
            return;
        }
        let wants_confidence = shows && !state.confidence.is_asked(&key);
        let wants_readout = self.requested.readout && state.readout.of(&key).is_none();
        if !wants_confidence && !wants_readout {
            return;
        }
        // Only all objects together tell what one is among others.
        if key.2 > 0 && state.readout.of(&key).is_none() {
            return;
        }
        state.confidence.ask(&key);
        let (cloud, prepared) = (asset.cloud.clone(), prepared.prepared.clone());
        let (id, target) = (state.id, key.1.light.clone());
        let known = state.readout.of(&key).cloned();
        // What was relit on the GPU is not here.
        let work = move |_: &_| {
            let (tau, readout) = if let Some(relit) = known {
                (relit.tau.clone(), None)
            } else if wants_readout {
                let relit = prepared.relight_rows(&target, Part::Whole, &[])?;
                (relit.tau.clone(), Some(Arc::new(relit)))
            } else {
                (prepared.tau(&target)?, None)
            };
            let confidence = present::confidence(&cloud, &bake, &prepared, &tau);
            Ok((ConfidenceMap::new(confidence), readout))
        };
        let label = tr("computing confidence");
        self.start(kind, label, work, move |project, made| {
            project.show_confidence(id, key, made);
        });
    }

    /// True where anything shows low-confidence surfels.
    pub fn shows_confidence(&self) -> bool {
        self.requested.confidence || self.scene.view == View::Confidence
    }

    fn show_confidence(
        &mut self,
        id: u64,
        key: ShownKey,
        (confidence, readout): (ConfidenceMap, Option<Arc<RelitRows>>),
    ) {
        let Some(at) = self.at(id) else {
            return;
        };
        let state = &mut self.states[at];
        let shown = state.relit.made_from();
        let is_shown = shown.is_some_and(|shown| !shown.coarse && shown.shown() == key);
        if let Some(relit) = readout.filter(|_| is_shown) {
            state.readout.set(key.clone(), relit);
        }
        let marks = confidence.of.iter().map(|d| match d {
            None => [0.0; 4],
            Some(low_confidence) => {
                let [r, g, b] = low_confidence.color();
                [r, g, b, MARK_WEIGHT]
            }
        });
        let (colors, marks): (_, Vec<_>) =
            (present::confidence_colors(&confidence.of), marks.collect());
        if state.confidence.accept(key, confidence) {
            self.draw(|live| live.set_confidence(at, colors, marks.into_iter()));
        }
    }
}
