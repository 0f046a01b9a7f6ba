//! Device of the stages beside a window's, and timing of GPU work.

use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::sync::{Arc, Mutex};
use std::time::{Duration, Instant};

use transplat_gpu::Context;

use super::jobs::Wake;
use crate::device::Device;

/// Where stages compute.
#[derive(Clone)]
pub enum StageDevice {
    /// On the device that the user chose.
    Chosen(Device),
    /// Beside a window, which cannot be resized while another thread submits to its queue: on a device of their own, opened when the first
    /// of them needs it.
    Beside {
        /// Device that draws the window.
        window: Arc<Context>,
        /// Device of the stages, once one of them needed it.
        own: Arc<Mutex<Option<Arc<Context>>>>,
    },
}

impl StageDevice {
    /// A second device of a window's adapter.
    pub fn beside(window: &Arc<Context>) -> Self {
        Self::Beside {
            window: window.clone(),
            own: Arc::default(),
        }
    }

    /// The adapter, software or not; none where it gives no second device. One that was lost is opened anew.
    pub fn gpu(&self) -> Option<Arc<Context>> {
        match self {
            Self::Chosen(Device::Cpu) => None,
            Self::Chosen(Device::Gpu(context)) => Some(context.clone()),
            Self::Beside { window, own } => {
                let mut own = own.lock().unwrap_or_else(|p| p.into_inner());
                if own.as_ref().is_none_or(|c| c.is_lost()) {
                    *own = window.sibling().ok().map(Arc::new);
                }
                own.clone()
            }
        }
    }

    /// For short work, the adapter where there is any; for long work see [`StageDevice::fastest`].
    pub fn any(&self) -> Device {
        self.gpu().map_or(Device::Cpu, Device::Gpu)
    }

    /// Where long work is the faster: the adapter if it is a real one, else the CPU; what the user chose is taken as it is.
    pub fn fastest(&self) -> Device {
        match self {
            Self::Beside { window, .. } if window.is_software() => Device::Cpu,
            _ => self.any(),
        }
    }
}

/// Measures how long submitted work takes on the adapter: a thread waits for it, and meanwhile no other is measured.
#[derive(Default)]
pub struct GpuTimer {
    micros: Arc<AtomicU64>,
    count: Arc<AtomicU64>,
    waiting: Arc<AtomicBool>,
}

impl GpuTimer {
    /// The last that is finished, from its first command to its end on the adapter.
    pub fn ms(&self) -> f64 {
        self.micros.load(Ordering::Relaxed) as f64 / 1e3
    }

    /// Number of measurements so far.
    pub fn count(&self) -> u64 {
        self.count.load(Ordering::Relaxed)
    }

    /// Measures what began at `start` and has just been submitted.
    pub fn measure(&self, context: &Arc<Context>, start: Instant, wake: &Wake) {
        if self.waiting.swap(true, Ordering::Relaxed) {
            return;
        }
        let (micros, waiting) = (self.micros.clone(), self.waiting.clone());
        let count = self.count.clone();
        let (context, wake) = (context.clone(), wake.clone());
        let submission = context.last_submission();
        std::thread::spawn(move || {
            context.finish(&submission);
            micros.store(start.elapsed().as_micros() as u64, Ordering::Relaxed);
            count.fetch_add(1, Ordering::Relaxed);
            waiting.store(false, Ordering::Relaxed);
            wake(Duration::ZERO);
        });
    }
}
