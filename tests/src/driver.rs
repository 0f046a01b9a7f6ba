//! The viewer without a window, with its files in a folder of its own.

use std::fs;
use std::time::{Duration, Instant};

use eframe::egui;
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use transplat::viewer::{Startup, Viewer, wgpu_setup};

use crate::{Folder, asset};

/// Of the window.
pub const SIZE: egui::Vec2 = egui::vec2(1000.0, 640.0);

/// How long a job may take on a slow machine.
pub const PATIENCE: Duration = Duration::from_secs(120);

/// A viewer that is driven.
pub struct Driver {
    /// The window.
    pub harness: Harness<'static, Viewer>,
    /// Keeps the files of the scene.
    pub folder: Folder,
}

impl Driver {
    /// The viewer on a copy of the bundled scene, so that bakes are kept apart.
    pub fn bundled() -> Self {
        let folder = Folder::empty();
        for name in ["teapot.ply", "city.hdr", "sunset.hdr", "interior.hdr"] {
            fs::copy(asset(name), folder.path(name)).expect("room for it");
        }
        let opening = Startup {
            files: ["teapot.ply", "interior.hdr", "sunset.hdr"]
                .map(|n| folder.path(n))
                .into(),
            ..Startup::default()
        };
        let mut driver = Self::open(opening, folder);
        let city = driver.folder.path("city.hdr");
        driver.after(|v| v.session.set_light(0, city));
        driver
    }

    /// The viewer with what it is opened with.
    pub fn open(startup: Startup, folder: Folder) -> Self {
        let startup = Startup {
            bakes_beside: true,
            ..startup
        };
        let harness = Harness::builder()
            .with_size(SIZE)
            .with_max_steps(64)
            .wgpu_setup(wgpu_setup(false))
            .build_eframe(move |cc| Viewer::new(cc, startup).expect("a viewer"));
        let mut driver = Self { harness, folder };
        // However slow the machine, passes are counted.
        driver.viewer().session.project.coarse_from_ms = f64::INFINITY;
        driver.settle();
        driver
    }

    /// The viewer itself.
    pub fn viewer(&mut self) -> &mut Viewer {
        self.harness.state_mut()
    }

    /// Does something to the viewer, and runs until nothing is being computed any more.
    pub fn after(&mut self, act: impl FnOnce(&mut Viewer)) {
        act(self.viewer());
        self.settle();
    }

    /// Runs until nothing is being computed any more.
    pub fn settle(&mut self) {
        let start = Instant::now();
        let mut quiet = 0;
        while quiet < 3 {
            self.harness.step();
            let busy = !self.harness.state().session.is_settled();
            quiet = if busy { 0 } else { quiet + 1 };
            if busy {
                std::thread::sleep(Duration::from_millis(5));
            }
            assert!(
                start.elapsed() < PATIENCE,
                "the viewer does not come to rest"
            );
        }
    }

    /// What the viewport shows, `[height * width]`.
    pub fn picture(&mut self) -> Vec<[f32; 3]> {
        self.settle();
        let live = self.harness.state().session.canvas.live();
        live.read_screen().expect("the driver works").0
    }

    /// Clicks what has a label.
    pub fn click(&mut self, label: &str) {
        self.harness.get_by_label(label).scroll_to_me();
        self.settle();
        self.harness.get_by_label(label).click();
        self.settle();
    }
}
