//! Measurements of settings on the open splat, made when the user asks for them.

use std::sync::Arc;

use anyhow::{Context as _, bail};
use transplat_core::extremes;
use transplat_core::settings::Method;

use super::session::{Measured, Session, SessionChange};
use transplat_engine::device::Device;
use transplat_engine::jobs::{Handle, Kind, Work};
use transplat_engine::language::{tr, tr_format};
use transplat_eval::savings;
use transplat_eval::sweep::{Effort, Setting, Subject, Sweep, in_words};

/// Repeats of a transfer with and without what is left out.
const REPEATS: usize = 7;

impl Session {
    /// Measurements on the selected object as it is now.
    pub fn measured(&self) -> Option<&Measured> {
        let cloud = Arc::as_ptr(&self.asset()?.cloud);
        let measured = self.measured.get(&self.state().id)?;
        std::ptr::eq(measured.cloud.as_ptr(), cloud).then_some(measured)
    }

    /// Takes the mark of measurements that the user has not seen yet.
    pub fn take_new_measured(&mut self) -> bool {
        let id = self.state().id;
        let measured = self.measured.get_mut(&id);
        measured.is_some_and(|m| std::mem::take(&mut m.is_new))
    }

    /// Stops what is measured on objects that are gone, and forgets it.
    pub fn forget_measured(&mut self) {
        let is_gone = |id: u64| self.project.at(id).is_none();
        for job in self.jobs.running() {
            if matches!(job.kind, Kind::Of(id, Work::Measure) if is_gone(id)) {
                job.cancel();
            }
        }
        self.measured.retain(|id, _| self.project.at(*id).is_some());
    }

    /// Measures the settings that the user can choose, under the lights as they are.
    pub fn measure(&mut self) {
        let state = self.state();
        let (id, kind) = (state.id, Kind::Of(state.id, Work::Measure));
        let Some(asset) = state.asset.as_ref().filter(|_| !self.jobs.is_running(kind)) else {
            return;
        };
        let cloud = Arc::downgrade(&asset.cloud);
        let lights = self.oriented_lights().map(|light| (*light.light).clone());
        let subject = Subject {
            cloud: asset.cloud.clone(),
            map: None,
            lights,
            views: None,
            bakes: state.whole_bakes().map(|bake| (**bake).clone()).collect(),
        };
        let mut devices = vec![Device::Cpu];
        // A driver that computes on the CPU is not what the user would buy time with.
        devices.extend(
            self.project
                .device
                .gpu()
                .filter(|gpu| !gpu.is_software())
                .map(Device::Gpu),
        );
        let label = tr_format!("measuring settings on {}", asset.name());
        let work = move |handle: &Handle<SessionChange>| {
            let half = |start: f64| move |done: f64, _: &str| handle.progress(start + 0.5 * done);
            let measure = || {
                let points = Sweep::run(&subject, &devices, Effort::Offered, &half(0.0))?;
                let savings = savings::measure(&subject, REPEATS, &half(0.5))?;
                anyhow::Ok(Measured {
                    cloud,
                    words: in_words(&points),
                    points,
                    saved: savings.saved,
                    is_new: true,
                })
            };
            measure().context(tr("Nothing could be measured."))
        };
        self.start(kind, label, work, move |session, measured| {
            session.measured.insert(id, measured);
        });
    }

    /// Tries the extreme cases, which have scenes of their own, on this machine.
    pub fn try_extremes(&mut self) {
        if self.jobs.is_running(Kind::Extremes) {
            return;
        }
        let work = |handle: &Handle<SessionChange>| {
            let cases = extremes::all();
            let mut outcomes = Vec::new();
            for (i, case) in cases.iter().enumerate() {
                if handle.progress(i as f64 / cases.len() as f64).is_break() {
                    bail!("cancelled");
                }
                outcomes.extend(Method::ALL.map(|method| extremes::run(case, method, None)));
            }
            Ok(extremes::in_words(&outcomes))
        };
        let label = tr("running the extreme cases");
        self.start(Kind::Extremes, label, work, |session, words| {
            session.extremes = words;
        });
    }

    /// Takes a setting that was measured; epsilon stays as it is.
    pub fn apply_setting(&mut self, setting: &Setting) {
        let transfer = &mut self.project.scene.transfer;
        transfer.method = setting.settings.method;
        transfer.sh_degree = setting.settings.sh_degree;
        transfer.terms = setting.settings.terms;
    }
}
