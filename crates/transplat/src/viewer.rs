//! The window: live relighting.

mod actions;
mod annotations;
mod app;
mod autosave;
mod bookmarks;
mod document;
mod export;
mod files;
mod frame;
mod gestures;
mod gizmo;
mod history;
mod inspector;
mod light_handles;
mod light_library;
mod light_map;
mod measurements;
mod menus;
mod mode_chips;
mod navigation;
mod open_file;
mod overlays;
mod panels;
mod preferences;
mod probe_export;
mod probes;
mod projection;
mod questions;
mod rigs;
mod session;
mod shortcuts;
mod style;
mod tabs;
mod thumbnail;
mod timeline;
mod viewport;
mod widgets;
mod window;

use std::sync::Arc;

use anyhow::{Result, anyhow};
use eframe::egui;
use eframe::egui_wgpu::{WgpuSetup, WgpuSetupCreateNew};

pub use app::{Startup, Viewer};
pub use export::task::Task;
pub use transplat_engine::output::ImageFormat;

/// Device setup of a window: the best adapter with all its limits, software drivers last or alone.
pub fn wgpu_setup(software_only: bool) -> WgpuSetup {
    let mut setup = WgpuSetupCreateNew::without_display_handle();
    setup.native_adapter_selector = Some(Arc::new(move |adapters, surface| {
        let fitting: Vec<_> = adapters
            .iter()
            .filter(|a| !software_only || a.get_info().device_type == eframe::wgpu::DeviceType::Cpu)
            .filter(|a| surface.is_none_or(|s| a.is_surface_supported(s)))
            .cloned()
            .collect();
        transplat_gpu::choose_adapter(&fitting).map_err(|e| e.to_string())
    }));
    setup.device_descriptor = Arc::new(transplat_gpu::device_descriptor);
    WgpuSetup::CreateNew(setup)
}

/// Opens the window, and returns when it is closed.
///
/// # Errors
/// There is no display, or no adapter that can draw.
pub fn open(startup: Startup, software_only: bool) -> Result<()> {
    transplat_engine::memory_trim::keep_few_arenas();
    let mut options = eframe::NativeOptions {
        viewport: egui::ViewportBuilder::default()
            .with_title("transplat")
            .with_app_id("transplat")
            .with_icon(icon()?)
            .with_inner_size([1280.0, 800.0])
            .with_min_inner_size([800.0, 520.0])
            .with_drag_and_drop(true),
        ..Default::default()
    };
    options.wgpu_options.wgpu_setup = wgpu_setup(software_only);
    let fatal = startup.fatal.clone();
    let created = eframe::run_native(
        "transplat",
        options,
        Box::new(|cc| Ok(Box::new(Viewer::new(cc, startup)?))),
    );
    created.map_err(|error| anyhow!("{}", plain(&error.to_string())))?;
    let fatal = fatal.lock().unwrap_or_else(|p| p.into_inner()).take();
    fatal.map_or(Ok(()), |text| Err(anyhow!("{text}")))
}

/// The program's own, for the task bar.
fn icon() -> Result<egui::IconData> {
    Ok(eframe::icon_data::from_png_bytes(include_bytes!(
        "../../../assets/icon.png"
    ))?)
}

/// Cause of a window's failure in plain words.
fn plain(error: &str) -> String {
    let has_display = ["DISPLAY", "WAYLAND_DISPLAY"]
        .iter()
        .any(|name| std::env::var_os(name).is_some_and(|v| !v.is_empty()));
    if cfg!(target_os = "linux") && !has_display {
        return "there is no display to open a window on; the commands relight, render, bake and info work without one (see transplat --help)".into();
    }
    let no_adapter = ["Failed to create surface", "no graphics driver", "adapter"];
    if no_adapter.iter().any(|text| error.contains(text)) {
        format!(
            "no graphics adapter can draw the window ({error}). Install a Vulkan driver (on Debian: apt-get install libvulkan1 mesa-vulkan-drivers); the commands work without one (--device cpu)"
        )
    } else {
        // Where in its own sources the toolkit gave up helps nobody.
        let what = error.split(": os error at").next().unwrap_or(error);
        format!("the window could not be opened; does the display answer? ({what})")
    }
}
