//! The canvas of a window: the graphics device that draws a project, and what it draws.

use std::sync::{Arc, Mutex, MutexGuard};

use transplat_gpu::Context;
use transplat_gpu::live::{Live, Passes};

use crate::engine::adapter::GpuTimer;

/// A graphics device, and the objects as they are drawn by it frame by frame.
#[derive(Clone)]
pub struct Canvas {
    pub context: Arc<Context>,
    live: Arc<Mutex<Live>>,
    pub timers: Arc<Timers>,
}

/// GPU times of a frame and of a transfer.
#[derive(Default)]
pub struct Timers {
    pub frame: GpuTimer,
    pub transfer: GpuTimer,
}

impl Canvas {
    pub fn new(context: Arc<Context>, live: Live) -> Self {
        Self {
            context,
            live: Arc::new(Mutex::new(live)),
            timers: Arc::default(),
        }
    }

    /// What is drawn.
    pub fn live(&self) -> MutexGuard<'_, Live> {
        // A poisoned lock guards pictures, nothing that could be half-written.
        self.live
            .lock()
            .unwrap_or_else(|poisoned| poisoned.into_inner())
    }

    /// Counts of GPU passes so far.
    pub fn passes(&self) -> Passes {
        self.live().passes()
    }
}
