//! Background jobs, with progress and cancel.

use std::collections::VecDeque;
use std::ops::ControlFlow;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Condvar, Mutex, OnceLock, PoisonError};
use std::time::{Duration, Instant};

use super::memory_trim;
use crate::language::tr;
use anyhow::{Result, anyhow};
use thread_priority::{ThreadPriority, set_current_thread_priority};
use transplat_core::settings::Method;

/// Kind of a job, so that none is started twice.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// A stage of an object, by the number of its state.
    Of(u64, Work),
    /// Reads an environment.
    Light,
    /// Reads a camera file.
    Cameras,
    /// The ground under the objects.
    Ground,
    /// Traces visibility between the objects.
    Surroundings,
    /// Traces visibility between the objects for preset paper.
    Insertion,
    /// Prepares the joint transfer of preset paper.
    PrepareScene,
    /// Relights all objects as one scene.
    RelightScene,
    /// Reads the map behind a side.
    Backdrop(usize),
    /// Reads the LUT of a side.
    Lut(usize),
    /// Saves images or splats.
    Export,
    /// Tries the extreme cases.
    Extremes,
    /// Waits for a file dialog.
    Dialog,
}

/// Kind of work on one object.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Work {
    /// Reads the splat.
    Load,
    /// Bakes visibility for a method.
    Bake(Method),
    /// Estimates the light of the capture.
    Estimate,
    /// Compares a user-set capture light with the object.
    Align,
    /// Completes its clipped capture light.
    Complete,
    /// Prepares the transfer from the source light.
    Prepare,
    /// Relights exactly.
    Relight,
    /// Relights coarsely while the light changes.
    RelightCoarsely,
    /// Colours a channel.
    Channel,
    /// Rates the confidence of the surfels.
    Confidence,
    /// Measures settings.
    Measure,
}

/// A job that runs.
pub struct Job {
    /// Number of the job.
    pub id: u64,
    /// Kind of the work.
    pub kind: Kind,
    /// For the user: what is being done, to what.
    pub label: String,
    /// Time at which it was started.
    pub started: Instant,
    signals: Arc<Signals>,
}

#[derive(Default)]
struct Signals {
    per_mille: AtomicU32,
    cancelled: AtomicBool,
    waits: AtomicBool,
    begun: OnceLock<Instant>,
}

impl Signals {
    /// Notes how far it is, and says whether to go on.
    fn report(&self, done: f64, wake: &Wake) -> ControlFlow<()> {
        let per_mille = (done * 1e3) as u32;
        if self.per_mille.swap(per_mille, Ordering::Relaxed) != per_mille {
            // Without a graphics card a picture of the window costs what the job would get.
            wake(PROGRESS_INTERVAL);
        }
        self.go_on()
    }

    fn go_on(&self) -> ControlFlow<()> {
        match self.cancelled.load(Ordering::Relaxed) {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }

    /// Time since its turn came, if it did.
    fn worked(&self) -> Option<Duration> {
        self.begun.get().map(Instant::elapsed)
    }
}

impl Kind {
    /// True for kinds whose jobs run one after the other.
    fn is_queued(self) -> bool {
        self == Self::Export
    }

    /// True for long work: it yields to what is shown meanwhile, and can be cancelled.
    fn is_long(self) -> bool {
        let of_object = matches!(
            self,
            Self::Of(
                _,
                Work::Load | Work::Bake(_) | Work::Estimate | Work::Prepare | Work::Measure
            )
        );
        of_object || matches!(self, Self::Ground | Self::Export | Self::Extremes)
    }
}

/// Jobs that wait for each other, by their numbers, the one that runs first.
#[derive(Default)]
struct Queue {
    jobs: Mutex<VecDeque<u64>>,
    moved: Condvar,
}

/// Interval at which the progress of jobs is shown.
pub const PROGRESS_INTERVAL: Duration = Duration::from_millis(250);

/// Interval at which a waiting job checks whether it was cancelled.
const LOOK_AGAIN: Duration = Duration::from_millis(100);

impl Queue {
    fn join(&self, id: u64) {
        let mut jobs = self.jobs.lock().unwrap_or_else(PoisonError::into_inner);
        jobs.push_back(id);
    }

    /// Waits until a job is the first, or cancelled.
    fn wait(&self, id: u64, signals: &Signals) {
        let mut jobs = self.jobs.lock().unwrap_or_else(PoisonError::into_inner);
        while jobs.front() != Some(&id) && !signals.cancelled.load(Ordering::Relaxed) {
            signals.waits.store(true, Ordering::Relaxed);
            let woken = self.moved.wait_timeout(jobs, LOOK_AGAIN);
            jobs = woken.unwrap_or_else(PoisonError::into_inner).0;
        }
        signals.waits.store(false, Ordering::Relaxed);
    }

    fn leave(&self, id: u64) {
        let mut jobs = self.jobs.lock().unwrap_or_else(PoisonError::into_inner);
        jobs.retain(|job| *job != id);
        self.moved.notify_all();
    }
}

impl Job {
    /// Share that is done, 0 to 1.
    pub fn progress(&self) -> f32 {
        self.signals.per_mille.load(Ordering::Relaxed) as f32 / 1e3
    }

    /// Time left if the rest goes as fast as what is done; none before that is known.
    pub fn time_left(&self) -> Option<Duration> {
        let worked = self.signals.worked()?;
        let done = self.progress();
        let is_known = done >= 0.05 && worked >= Duration::from_secs(3);
        is_known.then(|| worked.mul_f32((1.0 / done - 1.0).max(0.0)))
    }

    /// True where it checks whether it was cancelled.
    pub fn can_be_cancelled(&self) -> bool {
        self.kind.is_long() || matches!(self.kind, Kind::Surroundings | Kind::Insertion)
    }

    /// True once it was asked to stop.
    pub fn is_cancelled(&self) -> bool {
        self.signals.cancelled.load(Ordering::Relaxed)
    }

    /// True while its turn is still to come.
    pub fn waits(&self) -> bool {
        self.signals.waits.load(Ordering::Relaxed)
    }

    /// Asks it to stop; what it would have yielded is dropped.
    pub fn cancel(&self) {
        self.signals.cancelled.store(true, Ordering::Relaxed);
    }
}

/// A job's own side.
pub struct Handle<E> {
    id: u64,
    sender: Sender<JobMessage<E>>,
    signals: Arc<Signals>,
    wake: Wake,
    watch: Option<(Kind, Watch)>,
}

impl<E> Handle<E> {
    /// Tells how far it is, and learns whether to go on.
    pub fn progress(&self, done: f64) -> ControlFlow<()> {
        match &self.watch {
            Some((kind, watch)) => watch(*kind, done),
            None => self.signals.report(done, &self.wake),
        }
    }

    /// Has jobs within this one stop where it is cancelled.
    pub fn watch(&self) -> Watch {
        let signals = self.signals.clone();
        Arc::new(move |_, _| signals.go_on())
    }

    /// True once it was asked to stop.
    pub fn is_cancelled(&self) -> bool {
        self.signals.cancelled.load(Ordering::Relaxed)
    }

    /// Yields something before the end.
    pub fn send(&self, event: E) {
        self.post(Some(event), false);
    }

    fn post(&self, event: Option<E>, ended: bool) {
        // Nobody listens any more once the window is closed.
        let _ = self.sender.send(JobMessage {
            id: self.id,
            event,
            ended,
        });
        (self.wake)(Duration::ZERO);
    }
}

struct JobMessage<E> {
    id: u64,
    event: Option<E>,
    ended: bool,
}

/// Asks whoever shows the engine's state to look at it again after a while.
pub type Wake = Arc<dyn Fn(Duration) + Send + Sync>;

/// Follows the work of who waits for it: what is done and how far it is, 0 to 1. It may be broken off.
pub type Watch = Arc<dyn Fn(Kind, f64) -> ControlFlow<()> + Send + Sync>;

/// Follows nothing.
pub fn unwatched() -> Watch {
    Arc::new(|_, _| ControlFlow::Continue(()))
}

/// Priority of threads with long work, out of 99; in Linux a niceness of 10, a tenth of a core while a frame is drawn.
const PRIORITY_OF_LONG: u8 = 25;

/// Runs work in a pool of its own: neither the interface, which has small things to compute too, nor what is opened meanwhile waits for it.
fn beside_the_rest<T: Send>(is_long: bool, work: impl FnOnce() -> T + Send) -> T {
    let begin = move |_| {
        if is_long && let Ok(priority) = PRIORITY_OF_LONG.try_into() {
            // Where the system does not let it, it is as quick as the rest.
            let _ = set_current_thread_priority(ThreadPriority::Crossplatform(priority));
        }
    };
    match rayon::ThreadPoolBuilder::new().start_handler(begin).build() {
        Ok(pool) => pool.install(work),
        Err(_) => work(),
    }
}

/// Duration from which a job may leave much memory behind, next to which giving it back is cheap.
const LEAVES_MUCH: Duration = Duration::from_millis(250);

/// All jobs, and what they yield.
pub struct Jobs<E> {
    sender: Sender<JobMessage<E>>,
    receiver: Receiver<JobMessage<E>>,
    running: Vec<Job>,
    next: u64,
    wake: Wake,
    queue: Arc<Queue>,
    /// Who waits for each of them where it is started; none where they run beside the rest.
    watch: Option<Watch>,
    /// Milliseconds of jobs that were done at once.
    took: Vec<(Kind, f64)>,
}

impl<E: Send + 'static> Jobs<E> {
    /// Jobs that are done where they are started.
    pub fn at_once(watch: Watch) -> Self {
        Self {
            watch: Some(watch),
            ..Self::new(Arc::new(|_| ()))
        }
    }

    /// Jobs that run beside each other and all else.
    pub fn new(wake: Wake) -> Self {
        let (sender, receiver) = channel();
        Self {
            sender,
            receiver,
            running: Vec::new(),
            next: 1,
            wake,
            queue: Arc::default(),
            watch: None,
            took: Vec::new(),
        }
    }

    /// Number of jobs that were started.
    pub fn count(&self) -> u64 {
        self.next - 1
    }

    /// Jobs since the last call with their milliseconds, where they are done at once.
    pub fn take_times(&mut self) -> Vec<(Kind, f64)> {
        std::mem::take(&mut self.took)
    }

    /// Starts one, or lets it wait for its turn; `finish` makes an event of its result.
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
        let queue = kind.is_queued().then(|| self.queue.clone());
        queue.iter().for_each(|queue| queue.join(id));
        let handle = Handle {
            id,
            sender: self.sender.clone(),
            signals: signals.clone(),
            wake: self.wake.clone(),
            watch: self.watch.clone().map(|watch| (kind, watch)),
        };
        self.running.push(Job {
            id,
            kind,
            label: label.into(),
            started: Instant::now(),
            signals,
        });
        if self.watch.is_some() {
            let start = Instant::now();
            handle.post(Some(finish(work(&handle))), true);
            self.took.push((kind, start.elapsed().as_secs_f64() * 1e3));
            return;
        }
        std::thread::spawn(move || {
            queue
                .iter()
                .for_each(|queue| queue.wait(id, &handle.signals));
            handle.signals.begun.get_or_init(Instant::now);
            let work = || match handle.is_cancelled() {
                true => Err(anyhow!("cancelled")),
                false => beside_the_rest(kind.is_long(), || work(&handle)),
            };
            let result = catch_unwind(AssertUnwindSafe(work));
            let internal = |_| Err(anyhow!(tr("Internal error. The scene is unchanged.")));
            let result = result.unwrap_or_else(internal);
            handle.post(Some(finish(result)), true);
            // Not before: the next one could be told as done first.
            queue.iter().for_each(|queue| queue.leave(id));
            if handle.signals.worked() > Some(LEAVES_MUCH) {
                memory_trim::give_back();
            }
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

    /// Asks for another look; jobs call it when something is ready.
    pub fn wake(&self) -> &Wake {
        &self.wake
    }

    /// Jobs that run or wait for their turn.
    pub fn running(&self) -> &[Job] {
        &self.running
    }

    /// True while a job of a kind runs, cancelled or not.
    pub fn is_running(&self, kind: Kind) -> bool {
        self.running.iter().any(|j| j.kind == kind)
    }

    /// True while a job of a kind runs whose result is still wanted.
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
    use rayon::prelude::*;

    use super::*;

    #[test]
    fn exports_are_made_one_after_the_other_and_one_that_waits_can_be_cancelled() {
        let mut jobs = Jobs::<u32>::new(Arc::new(|_| ()));
        let (go, gate) = channel::<()>();
        let mut gate = Some(gate);
        for number in 0..4 {
            let gate = gate.take();
            let work = move |_: &Handle<_>| {
                if let Some(gate) = gate {
                    let _ = gate.recv();
                }
                Ok(number)
            };
            jobs.start(Kind::Export, "a picture", work, |n: Result<u32>| {
                n.unwrap_or(99)
            });
        }
        let deadline = Instant::now() + Duration::from_secs(10);
        let until = |done: &mut dyn FnMut() -> bool| {
            while !done() {
                assert!(Instant::now() < deadline, "too long");
                std::thread::sleep(Duration::from_millis(5));
            }
        };
        until(&mut || jobs.running()[1..].iter().all(Job::waits));
        assert!(!jobs.running()[0].waits());
        jobs.running()[2].cancel();
        let mut made = Vec::new();
        until(&mut || {
            made.extend(jobs.events());
            jobs.running().len() == 3
        });
        assert!(made.is_empty());
        go.send(()).expect("it waits for that");
        until(&mut || {
            made.extend(jobs.events());
            jobs.running().is_empty()
        });
        assert_eq!(made, [0, 1, 3]);
    }

    #[test]
    #[cfg(target_os = "linux")]
    fn what_takes_long_makes_way_for_what_is_shown_meanwhile() {
        let niceness = |_: &Handle<_>| {
            let stat = std::fs::read_to_string("/proc/thread-self/stat")?;
            let fields = stat.rsplit(')').next().into_iter();
            // The nineteenth; the name, which ends with the bracket, is the second.
            let nice = fields.flat_map(str::split_whitespace).nth(16);
            Ok(nice.and_then(|n| n.parse::<i32>().ok()))
        };
        let mut jobs = Jobs::<Option<i32>>::new(Arc::new(|_| ()));
        let mut of = |kind| {
            jobs.start(kind, "work", niceness, |result| result.ok().flatten());
            let end = Instant::now() + Duration::from_secs(20);
            loop {
                match jobs.events().pop() {
                    Some(nice) => return nice.expect("Linux tells it"),
                    None => assert!(Instant::now() < end, "it does not end"),
                }
            }
        };
        let bake = Kind::Of(0, Work::Bake(Method::Directional));
        assert!(of(bake) > of(Kind::Of(0, Work::Relight)));
    }

    #[test]
    fn the_interface_computes_while_a_job_keeps_all_cores_busy() {
        let mut jobs = Jobs::<Result<()>>::new(Arc::new(|_| ()));
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
