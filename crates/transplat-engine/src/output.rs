//! Image files: formats, numbered frames, videos, and free names.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use serde::{Deserialize, Serialize};
use transplat_core::files::{ExrFloats, PngBits, write_exr, write_png};
use transplat_core::present;
use transplat_core::rasterize::Raster;

use crate::language::tr_later;
use crate::video::{VideoEncoder, VideoFormat};

/// Format of an image's file.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum ImageFormat {
    /// 8 bits a channel, as on the screen.
    #[default]
    Png8,
    /// 16 bits.
    Png16,
    /// Linear, 16-bit floats.
    ExrHalf,
    /// Linear, 32-bit floats.
    ExrFloat,
    /// Plate, objects, shadow, depth, normals and ids, each a layer.
    ExrLayers,
}

impl ImageFormat {
    /// All of them, with their names.
    pub const ALL: [(&'static str, Self); 5] = [
        (tr_later("PNG, 8 bit"), Self::Png8),
        (tr_later("PNG, 16 bit"), Self::Png16),
        (tr_later("EXR, half"), Self::ExrHalf),
        (tr_later("EXR, float"), Self::ExrFloat),
        (tr_later("EXR, layers"), Self::ExrLayers),
    ];

    /// True where it holds linear light.
    pub fn is_linear(self) -> bool {
        matches!(self, Self::ExrHalf | Self::ExrFloat | Self::ExrLayers)
    }

    /// Ending of the files, without the dot.
    pub fn extension(self) -> &'static str {
        if self.is_linear() { "exr" } else { "png" }
    }

    /// Writes an image without layers.
    pub fn write(self, path: &Path, image: &Raster) -> Result<()> {
        let (width, height) = (image.width, image.height);
        let png = |bits| write_png(path, width, height, &present::straight(image), bits);
        match self {
            Self::Png8 => png(PngBits::Eight)?,
            Self::Png16 => png(PngBits::Sixteen)?,
            Self::ExrHalf | Self::ExrLayers => write_exr(path, image, ExrFloats::Half)?,
            Self::ExrFloat => write_exr(path, image, ExrFloats::Full)?,
        }
        Ok(())
    }
}

/// Writes images into files of their own, or all into the video that their path is.
pub struct Sink {
    format: ImageFormat,
    frame_rate: u32,
    video: Option<VideoEncoder>,
    /// Files that were written.
    pub files: Vec<PathBuf>,
    /// Images that were written.
    pub count: usize,
}

impl Sink {
    /// Takes the format of files of their own, and the frame rate of a video.
    pub fn new(format: ImageFormat, frame_rate: u32) -> Self {
        Self {
            format,
            frame_rate,
            video: None,
            files: Vec::new(),
            count: 0,
        }
    }

    /// Writes one; in a video, all are as large as the first.
    pub fn add(&mut self, path: &Path, image: &Raster) -> Result<()> {
        let is_video = VideoFormat::of(path).is_some();
        if is_video && self.video.is_none() {
            let size = [image.width, image.height];
            self.video = Some(VideoEncoder::new(path, size, self.frame_rate)?);
            self.files.push(path.to_owned());
        }
        self.count += 1;
        match &mut self.video {
            Some(video) => video.add(image),
            None => {
                self.files.push(path.to_owned());
                self.format.write(path, image)
            }
        }
    }

    /// Completes the video, if there is one. Yields the files.
    pub fn finish(self) -> Result<Vec<PathBuf>> {
        if let Some(video) = self.video {
            video.finish()?;
        }
        Ok(self.files)
    }
}

/// Refuses a file where a folder is to be made.
pub fn refuse_file(path: &Path) -> Result<()> {
    if path.is_file() {
        bail!(
            "{}: is a file; the output is a folder of files here",
            path.display()
        );
    }
    Ok(())
}

/// Makes a folder that outputs go into, unless it is there.
pub fn make_folder(path: &Path) -> Result<()> {
    refuse_file(path)?;
    std::fs::create_dir_all(path).with_context(|| path.display().to_string())
}

/// `folder/stem.extension`, or with the first number that is free.
pub fn free_name(folder: &Path, stem: &str, extension: &str) -> PathBuf {
    let named = |stem: &str| match extension {
        "" => folder.join(stem),
        extension => folder.join(format!("{stem}.{extension}")),
    };
    let plain = named(stem);
    if !plain.exists() {
        return plain;
    }
    (2..)
        .map(|i| named(&format!("{stem}-{i}")))
        .find(|p| !p.exists())
        .unwrap_or(plain)
}
