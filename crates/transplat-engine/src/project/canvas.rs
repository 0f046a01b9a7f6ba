//! Canvas of a window: the graphics device that draws a project.

use std::sync::{Arc, Mutex, MutexGuard};

use transplat_gpu::Context;
use transplat_gpu::live::{Live, Passes};

use crate::adapter::GpuTimer;

/// A graphics device, and the objects as they are drawn by it frame by frame.
#[derive(Clone)]
pub struct Canvas {
    /// Graphics device of the window.
    pub context: Arc<Context>,
    live: Arc<Mutex<Live>>,
    /// GPU times of the last frame and transfer.
    pub timers: Arc<Timers>,
}

/// GPU times of a frame and of a transfer.
#[derive(Default)]
pub struct Timers {
    /// Drawing of a frame.
    pub frame: GpuTimer,
    /// Change of light.
    pub transfer: GpuTimer,
}

impl Canvas {
    /// A canvas on a graphics device.
    pub fn new(context: Arc<Context>, live: Live) -> Self {
        Self {
            context,
            live: Arc::new(Mutex::new(live)),
            timers: Arc::default(),
        }
    }

    /// Locks the objects as they are drawn.
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
