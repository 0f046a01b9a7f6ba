//! What settings cost on the open asset, and what they are worth: measured when the user asks for it.

use transplat_core::extremes;
use transplat_core::settings::Method;

use super::jobs::{Handle, Kind, beside_the_rest};
use super::session::{Event, Session};
use crate::device::Device;
use crate::savings;
use crate::sweep::{Effort, Setting, Subject, Sweep};

/// Repeats of a transfer with and without what is left out.
const REPEATS: usize = 7;

impl Session {
    /// Measures the settings that the user can choose, under the lights as they are.
    pub fn measure(&mut self) {
        let Some(asset) = &self.asset else {
            return;
        };
        if self.jobs.is_running(Kind::Measure) {
            return;
        }
        let [source, target] = self.oriented_lights();
        let subject = Subject {
            cloud: asset.cloud.clone(),
            map: None,
            lights: [(*source.light).clone(), (*target.light).clone()],
            views: None,
            bakes: self.whole_bakes().map(|bake| (**bake).clone()).collect(),
        };
        let mut devices = vec![Device::Cpu];
        // A driver that computes on the CPU is not what the user would buy time with.
        devices.extend(
            self.background
                .gpu()
                .filter(|gpu| !gpu.is_software())
                .map(Device::Gpu),
        );
        let label = format!("measuring settings on {}", asset.name());
        let id = self.asset_id;
        let work = move |handle: &Handle<Event>| {
            let half = |start: f64| move |done: f64, _: &str| handle.progress(start + 0.5 * done);
            let measure = || {
                let points = Sweep::run(&subject, &devices, Effort::Offered, &half(0.0))?;
                anyhow::Ok((points, savings::measure(&subject, REPEATS, &half(0.5))?))
            };
            Some(match beside_the_rest(measure) {
                Ok((points, savings)) => Event::Measured {
                    asset: id,
                    points,
                    savings,
                },
                Err(_) if handle.is_cancelled() => return None,
                Err(error) => Event::Failed(format!("nothing could be measured: {error:#}")),
            })
        };
        self.jobs.start(Kind::Measure, label, work, Event::Failed);
    }

    /// Tries the extreme cases, which have scenes of their own, on this machine.
    pub fn try_extremes(&mut self) {
        if self.jobs.is_running(Kind::Extremes) {
            return;
        }
        let work = |handle: &Handle<Event>| {
            let cases = extremes::all();
            let mut outcomes = Vec::new();
            for (i, case) in cases.iter().enumerate() {
                if handle.progress(i as f64 / cases.len() as f64).is_break() {
                    return None;
                }
                let each = || Method::ALL.map(|method| extremes::run(case, method, None));
                outcomes.extend(beside_the_rest(each));
            }
            Some(Event::Extremes(extremes::in_words(&outcomes)))
        };
        let label = "trying the extreme cases";
        self.jobs.start(Kind::Extremes, label, work, Event::Failed);
    }

    /// Takes a setting that was measured; epsilon stays as it is.
    pub fn apply_setting(&mut self, setting: &Setting) {
        let transfer = &mut self.look.transfer;
        transfer.method = setting.settings.method;
        transfer.sh_degree = setting.settings.sh_degree;
        transfer.terms = setting.settings.terms;
    }
}
