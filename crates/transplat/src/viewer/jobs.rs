//! Work off the interface's thread, with progress and cancel.

use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Instant;

use anyhow::{Result, anyhow};
use eframe::egui;
use transplat_core::settings::Method;

/// What a job is doing, for those who must not start it twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A stage of an object, by the number of its state.
    Of(u64, Work),
    Light,
    Cameras,
    /// The ground under the objects.
    Ground,
    /// What objects see of each other, and all of them relit.
    Surroundings,
    /// The same for preset paper, and their transfers.
    Insertion,
    PrepareTogether,
    RelightTogether,
    Backdrop(usize),
    Export,
    Extremes,
    Dialog,
}

/// What is done to an object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    Load,
    Bake(Method),
    Estimate,
    Prepare,
    Relight,
    Doubts,
    Measure,
}

/// A job that runs.
pub struct Job {
    pub id: u64,
    pub kind: Kind,
    /// For the user: what is being done, to what.
    pub label: String,
    pub started: Instant,
    signals: Arc<Signals>,
}

#[derive(Default)]
struct Signals {
    per_mille: AtomicU32,
    cancelled: AtomicBool,
}

impl Job {
    /// How far it is, 0 to 1.
    pub fn progress(&self) -> f32 {
        self.signals.per_mille.load(Ordering::Relaxed) as f32 / 1e3
    }

    /// Whether it looks out for being stopped.
    pub fn can_be_cancelled(&self) -> bool {
        matches!(
            self.kind,
            Kind::Of(_, Work::Load | Work::Bake(_) | Work::Measure)
                | Kind::Ground
                | Kind::Surroundings
                | Kind::Insertion
                | Kind::Export
                | Kind::Extremes
        )
    }

    pub fn is_cancelled(&self) -> bool {
        self.signals.cancelled.load(Ordering::Relaxed)
    }

    /// Asks it to stop; what it would have yielded is dropped.
    pub fn cancel(&self) {
        self.signals.cancelled.store(true, Ordering::Relaxed);
    }
}

/// A job's own side.
pub struct Handle<E> {
    id: u64,
    sender: Sender<Message<E>>,
    signals: Arc<Signals>,
    context: egui::Context,
}

impl<E> Handle<E> {
    /// Tells how far it is, and learns whether to go on.
    pub fn progress(&self, done: f64) -> ControlFlow<()> {
        let per_mille = (done * 1e3) as u32;
        if self.signals.per_mille.swap(per_mille, Ordering::Relaxed) != per_mille {
            self.context.request_repaint();
        }
        if self.is_cancelled() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    }

    pub fn is_cancelled(&self) -> bool {
        self.signals.cancelled.load(Ordering::Relaxed)
    }

    /// Yields something before the end.
    pub fn send(&self, event: E) {
        self.post(Some(event), false);
    }

    fn post(&self, event: Option<E>, ended: bool) {
        // Nobody listens any more once the window is closed.
        let _ = self.sender.send(Message {
            id: self.id,
            event,
            ended,
        });
        self.context.request_repaint();
    }
}

struct Message<E> {
    id: u64,
    event: Option<E>,
    ended: bool,
}

/// Runs work in a pool of its own: neither the interface, which has small things to compute too, nor what is opened meanwhile waits for it.
fn beside_the_rest<T: Send>(work: impl FnOnce() -> T + Send) -> T {
    match rayon::ThreadPoolBuilder::new().build() {
        Ok(pool) => pool.install(work),
        Err(_) => work(),
    }
}

/// All jobs, and what they yield.
pub struct Jobs<E> {
    sender: Sender<Message<E>>,
    receiver: Receiver<Message<E>>,
    running: Vec<Job>,
    next: u64,
    context: egui::Context,
}

impl<E: Send + 'static> Jobs<E> {
    pub fn new(context: &egui::Context) -> Self {
        let (sender, receiver) = channel();
        Self {
            sender,
            receiver,
            running: Vec::new(),
            next: 1,
            context: context.clone(),
        }
    }

    /// Starts one; `finish` makes an event of its result.
    pub fn start<T: Send>(
        &mut self,
        kind: Kind,
        label: impl Into<String>,
        work: impl FnOnce(&Handle<E>) -> Result<T> + Send + 'static,
        finish: impl FnOnce(Result<T>) -> E + Send + 'static,
    ) {
        let id = self.next;
        self.next += 1;
        let signals = Arc::<Signals>::default();
        let handle = Handle {
            id,
            sender: self.sender.clone(),
            signals: signals.clone(),
            context: self.context.clone(),
        };
        self.running.push(Job {
            id,
            kind,
            label: label.into(),
            started: Instant::now(),
            signals,
        });
        std::thread::spawn(move || {
            let work = || beside_the_rest(|| work(&handle));
            let result = catch_unwind(AssertUnwindSafe(work));
            let internal = |_| Err(anyhow!("an internal error; the scene is as it was"));
            let result = result.unwrap_or_else(internal);
            handle.post(Some(finish(result)), true);
        });
    }

    /// Everything that was yielded since the last call; of cancelled jobs nothing.
    pub fn events(&mut self) -> Vec<E> {
        let mut events = Vec::new();
        while let Ok(message) = self.receiver.try_recv() {
            let at = self.running.iter().position(|j| j.id == message.id);
            let cancelled = at.is_none_or(|i| self.running[i].is_cancelled());
            if message.ended
                && let Some(i) = at
            {
                self.running.remove(i);
            }
            events.extend(message.event.filter(|_| !cancelled));
        }
        events
    }

    /// The interface that is woken when something is ready.
    pub fn context(&self) -> &egui::Context {
        &self.context
    }

    pub fn running(&self) -> &[Job] {
        &self.running
    }

    pub fn is_running(&self, kind: Kind) -> bool {
        self.running.iter().any(|j| j.kind == kind)
    }

    /// Whether a job of a kind runs whose result is still wanted.
    pub fn is_awaited(&self, kind: Kind) -> bool {
        let mut of_kind = self.running.iter().filter(|j| j.kind == kind);
        of_kind.any(|j| !j.is_cancelled())
    }

    /// Cancels all that is done to an object.
    pub fn cancel_object(&self, id: u64) {
        let is_its = |job: &&Job| matches!(job.kind, Kind::Of(of, _) if of == id);
        self.running.iter().filter(is_its).for_each(Job::cancel);
    }

    /// Cancels all jobs of a kind.
    pub fn cancel(&self, kind: Kind) {
        for job in self.running.iter().filter(|j| j.kind == kind) {
            job.cancel();
        }
    }
}

#[cfg(test)]
mod tests {
    use std::time::Duration;

    use rayon::prelude::*;

    use super::*;

    #[test]
    fn the_interface_computes_while_a_job_keeps_all_cores_busy() {
        let mut jobs = Jobs::<Result<()>>::new(&egui::Context::default());
        let (begun, has_begun) = channel();
        let long = Duration::from_millis(1500);
        let work = move |_: &Handle<_>| {
            let _ = begun.send(());
            (0..4 * rayon::current_num_threads())
                .into_par_iter()
                .for_each(|_| std::thread::sleep(long / 4));
            Ok(())
        };
        jobs.start(Kind::Export, "long work", work, |result| result);
        has_begun.recv().expect("it begins");
        let start = Instant::now();
        let sum: usize = (0..1000usize).into_par_iter().sum();
        assert_eq!(sum, 499_500);
        assert!(start.elapsed() < long / 3, "{:?}", start.elapsed());
        assert!(jobs.is_running(Kind::Export));
    }
}
