//! Contact sheets: one file with a picture a light.

use anyhow::{Result, bail};
use transplat_core::color::Display;
use transplat_core::environment::EnvironmentMap;
use transplat_core::files::folder_of;
use transplat_core::progress::tell;
use transplat_core::rasterize::Raster;

use super::caption::Captions;
use super::run::ExportRun;
use super::task::ExportResult;
use transplat_engine::environments::Environment;
use transplat_engine::language::tr_format;
use transplat_engine::output::make_folder;
use transplat_engine::render::MAX_SAMPLES;

/// Height of a caption, one over that of the picture above it.
const CAPTION: usize = 14;

/// The least height of one that can be read, in pixels.
const LEAST_CAPTION: usize = 14;

/// Grey of the sheet, and of what is written on it; display values.
const PAPER: f32 = 0.1;
const INK: f32 = 0.85;

/// Pictures in rows, as wide as high about, each with its light's map in the corner and the light's name below.
pub(super) fn contact_sheet(run: &mut ExportRun<'_>) -> Result<ExportResult> {
    run.need_lights()?;
    let count = run.light_library.len();
    let columns = (count as f64).sqrt().ceil() as usize;
    let rows = count.div_ceil(columns);
    let [width, height] = run.settings.size;
    let caption = (height / CAPTION).max(LEAST_CAPTION);
    let cell = height + caption;
    if width * columns * cell * rows > MAX_SAMPLES {
        bail!(tr_format!(
            "{count} images of {width} x {height} make too large a sheet. Lower the size.",
            count = count,
            width = width,
            height = height
        ));
    }
    let is_linear = run.settings.format.is_linear();
    let paper = match (run.settings.transparent, is_linear) {
        (true, _) => [0.0; 4],
        (false, true) => [0.0, 0.0, 0.0, 1.0],
        (false, false) => [PAPER, PAPER, PAPER, 1.0],
    };
    let mut sheet = Raster {
        width: width * columns,
        height: cell * rows,
        pixels: vec![paper; width * columns * cell * rows],
        depth: Vec::new(),
    };
    let mut captions = Captions::new(0.6 * caption as f32);
    let scene = run.shots.project.scene.clone();
    for (i, light) in run.light_library.clone().iter().enumerate() {
        let progress = run.step(i, count);
        tell(&progress, 0.0)?;
        run.shots.project.scene.clone_from(&scene);
        run.shots.light_by(light);
        let mut picture = run.picture(scene.view, &progress)?;
        add_map(&mut picture, light, is_linear);
        let origin = [i % columns * width, i / columns * cell];
        for (y, row) in picture.pixels.chunks_exact(width).enumerate() {
            let start = (origin[1] + y) * sheet.width + origin[0];
            sheet.pixels[start..][..width].copy_from_slice(row);
        }
        let margin = caption / 2;
        let room = width.saturating_sub(2 * margin);
        let label = captions.line(&light.name(), room as f32);
        let top = origin[1] + height + caption.saturating_sub(label.height) / 2;
        // Premultiplied: ink over paper.
        for y in 0..label.height.min(caption) {
            for x in 0..label.width.min(room) {
                let covered = label.coverage[y * label.width + x];
                let at = (top + y) * sheet.width + origin[0] + margin + x;
                let ink = [INK, INK, INK, 1.0];
                let below = sheet.pixels[at];
                sheet.pixels[at] =
                    std::array::from_fn(|c| covered * ink[c] + (1.0 - covered) * below[c]);
            }
        }
    }
    let path = run.named("lights", scene.view);
    make_folder(folder_of(&path))?;
    run.settings.format.write(&path, &sheet)?;
    Ok(ExportResult::Files(vec![path]))
}

fn add_map(picture: &mut Raster, light: &Environment, is_linear: bool) {
    let edge = picture.width.min(picture.height) / 20;
    let room = picture.height - edge;
    let height = (picture.width / 8).min(room);
    let width = 2 * height;
    if width < 2 || width + edge > picture.width {
        return;
    }
    let map = EnvironmentMap::reduced(&light.small, width);
    let display = Display::default();
    for y in 0..height {
        for x in 0..width {
            let (mx, my) = (x * map.width() / width, y * map.height() / height);
            let radiance = map.pixels()[my * map.width() + mx].map(|v| v * light.thumbnail_gain);
            let [r, g, b] = if is_linear {
                radiance
            } else {
                display.encode(radiance).map(|v| v.min(1.0))
            };
            let at = (picture.height - edge - height + y) * picture.width + edge + x;
            picture.pixels[at] = [r, g, b, 1.0];
        }
    }
}
