//! Export tasks and their settings.

use std::path::PathBuf;

use anyhow::{Result, bail};
use serde::{Deserialize, Serialize};
use transplat_core::files::SplatFormat;

use transplat_engine::delight::DelitAs;
use transplat_engine::language::{tr, tr_format};
use transplat_engine::output::ImageFormat;
use transplat_engine::render::MAX_SAMPLES;
use transplat_engine::video::{FRAME_RATE, VideoFormat};

/// Sides that are saved.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ExportSides {
    /// Sides that are shown.
    #[default]
    Shown,
    /// Before and after, a picture each.
    Each,
}

/// Subject that rotates on a turntable.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Turn {
    #[default]
    Camera,
    Light,
}

/// Settings of exports, kept from start to start.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct ExportSettings {
    pub size: [usize; 2],
    pub format: ImageFormat,
    pub supersample: usize,
    pub transparent: bool,
    pub sides: ExportSides,
    pub pattern: String,
    pub folder: String,
    pub frames: usize,
    pub turn: Turn,
    /// A turntable as a film, or as numbered pictures.
    #[serde(alias = "film")]
    pub video: Option<VideoFormat>,
    /// Frames of the video a second.
    pub frame_rate: u32,
    /// Format of a relit splat; none for that of the capture.
    pub splat: Option<SplatFormat>,
    /// Colour of a splat without its light.
    pub delit_as: DelitAs,
    /// The albedo of its whitest surface, if that is known.
    pub whitest: Option<f32>,
    /// True where the materials of the surfels come with it.
    pub materials: bool,
}

impl Default for ExportSettings {
    fn default() -> Self {
        let folders = directories::UserDirs::new();
        let folder = folders.map(|d| {
            let usual = d.home_dir().join("Pictures");
            let home = || {
                if usual.is_dir() {
                    usual.clone()
                } else {
                    d.home_dir().to_owned()
                }
            };
            d.picture_dir().map_or_else(home, std::path::Path::to_owned)
        });
        Self {
            size: [1920, 1080],
            format: ImageFormat::default(),
            supersample: 2,
            transparent: false,
            sides: ExportSides::default(),
            pattern: "{splat}_{light}_{view}".into(),
            folder: folder.map_or(".".into(), |f| f.display().to_string()),
            frames: 36,
            turn: Turn::default(),
            video: None,
            frame_rate: FRAME_RATE,
            splat: None,
            delit_as: DelitAs::default(),
            whitest: None,
            materials: false,
        }
    }
}

/// Pixels along the longer edge of a preview.
const PREVIEW_EDGE: usize = 640;

/// Export that is requested.
#[derive(Clone, Debug, PartialEq)]
pub enum Task {
    /// One picture (or one a side); into a named file, or by folder and pattern.
    Screenshot(Option<PathBuf>),
    /// One picture to the clipboard.
    Clipboard,
    /// One picture in the window, as small as it can be looked at.
    Preview,
    /// One file a light of the shelf.
    EachLight,
    /// One file with a picture a light of the shelf.
    ContactSheet,
    /// Numbered frames, or a film.
    Turntable,
    /// Frames of the light over time, or a video.
    Animation,
    /// The relit splat.
    Splat(PathBuf),
    /// The selected object's splat without its light.
    Delit(PathBuf),
}

impl Task {
    /// The settings that it is done with: a file's extension decides on its format, and a clipboard holds display values.
    pub fn settings(&self, settings: &ExportSettings) -> Result<ExportSettings> {
        let mut settings = settings.clone();
        match self {
            Self::Clipboard => settings.format = ImageFormat::Png8,
            Self::Preview => {
                settings.format = ImageFormat::Png8;
                let longer = settings.size[0].max(settings.size[1]).max(PREVIEW_EDGE);
                let scaled = |edge: usize| (edge * PREVIEW_EDGE / longer).max(1);
                settings.size = settings.size.map(scaled);
            }
            // A film holds display values too.
            Self::Turntable | Self::Animation if settings.video.is_some() => {
                settings.format = ImageFormat::Png8;
            }
            Self::Screenshot(Some(path)) => {
                let extension = path.extension().unwrap_or_default().to_string_lossy();
                let format = match &*extension.to_lowercase() {
                    "png" => ImageFormat::Png8,
                    "exr" => ImageFormat::ExrHalf,
                    _ => bail!(tr_format!(
                        "{}: an image is .png or .exr. Change the ending.",
                        path.display()
                    )),
                };
                if settings.format.is_linear() != format.is_linear() {
                    settings.format = format;
                }
            }
            Self::ContactSheet if settings.format == ImageFormat::ExrLayers => {
                bail!(tr("A contact sheet has no layers. Choose another format."))
            }
            _ => {}
        }
        let [width, height] = settings.size;
        let factor = settings.supersample;
        if self.is_of_images() && width * height * factor * factor > MAX_SAMPLES {
            bail!(tr_format!(
                "An image of {width} x {height} with {factor} x {factor} samples is too large. Lower the size or the samples (at most {MAX_SAMPLES} in all).",
                width = width,
                height = height,
                factor = factor,
                MAX_SAMPLES = MAX_SAMPLES
            ));
        }
        Ok(settings)
    }

    /// True for exports of images, not of splats.
    pub fn is_of_images(&self) -> bool {
        !matches!(self, Self::Splat(_) | Self::Delit(_))
    }
}

/// Result of an export.
pub enum ExportResult {
    Files(Vec<PathBuf>),
    /// A splat without its light, and what is to be known of it.
    Delit(PathBuf, Vec<String>),
    /// Width, height, straight RGBA bytes: for the clipboard, or to be looked at.
    Picture([usize; 2], Vec<u8>),
    Preview([usize; 2], Vec<u8>),
}
