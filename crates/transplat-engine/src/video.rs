//! Video encoding, by the program `ffmpeg` where that is installed.

use std::fs::File;
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};

use anyhow::{Context as _, Result, anyhow, bail};
use serde::{Deserialize, Serialize};
use tempfile::TempPath;
use transplat_core::files::{check_output, write_atomically};
use transplat_core::present;
use transplat_core::rasterize::Raster;

/// Frames a second, where nothing else is said.
pub const FRAME_RATE: u32 = 24;

/// Format of a video.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum VideoFormat {
    /// H.264, which everything plays.
    Mp4,
    /// VP9, with alpha.
    WebM,
    /// An animated picture, with alpha.
    WebP,
}

impl VideoFormat {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Mp4, Self::WebM, Self::WebP];

    /// Ending of the files, without the dot.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Mp4 => "mp4",
            Self::WebM => "webm",
            Self::WebP => "webp",
        }
    }

    /// By a file's name.
    pub fn of(path: &Path) -> Option<Self> {
        let extension = path.extension()?.to_string_lossy().to_lowercase();
        Self::ALL.into_iter().find(|f| f.extension() == extension)
    }

    /// Arguments of the encoder, near lossless to the eye.
    fn encoder(self) -> &'static [&'static str] {
        match self {
            // Its colour has half the resolution, so that edges are even; players need it so.
            Self::Mp4 => &[
                "-vf",
                "pad=ceil(iw/2)*2:ceil(ih/2)*2,scale=out_color_matrix=bt709:out_range=tv,format=yuv420p",
                "-c:v",
                "libx264",
                "-crf",
                "16",
                "-preset",
                "medium",
                "-movflags",
                "+faststart",
                "-colorspace",
                "bt709",
                "-color_primaries",
                "bt709",
                "-color_trc",
                "iec61966-2-1",
            ],
            Self::WebM => &[
                "-vf",
                "scale=out_color_matrix=bt709:out_range=tv,format=yuva420p",
                "-c:v",
                "libvpx-vp9",
                "-crf",
                "22",
                "-b:v",
                "0",
                "-colorspace",
                "bt709",
            ],
            Self::WebP => &[
                "-c:v",
                "libwebp_anim",
                "-pix_fmt",
                "yuva420p",
                "-q:v",
                "88",
                "-loop",
                "0",
            ],
        }
    }
}

/// A film in the making; nothing is left of one that is not finished.
pub struct VideoEncoder {
    path: PathBuf,
    /// File that the encoder writes, under a temporary name until it is complete.
    unfinished: TempPath,
    format: VideoFormat,
    encoder: Child,
    size: [usize; 2],
}

/// True where the program ffmpeg is found.
pub fn has_ffmpeg() -> bool {
    let name = format!("ffmpeg{}", std::env::consts::EXE_SUFFIX);
    let folders = std::env::var_os("PATH").unwrap_or_default();
    std::env::split_paths(&folders).any(|folder| folder.join(&name).is_file())
}

impl VideoEncoder {
    /// Begins one of frames of a size.
    pub fn new(path: &Path, size: [usize; 2], frame_rate: u32) -> Result<Self> {
        let format = VideoFormat::of(path).with_context(|| {
            let path = path.display();
            format!("{path}: a video is .mp4, .webm or .webp")
        })?;
        let suffix = format!(".{}", format.extension());
        check_output(path)?;
        let unfinished = tempfile::Builder::new().suffix(&suffix).tempfile();
        let unfinished = unfinished.context("a temporary file")?.into_temp_path();
        let [width, height] = size;
        let encoder = Command::new("ffmpeg")
            .args(["-loglevel", "error", "-nostdin", "-y"])
            .args(["-f", "rawvideo", "-pix_fmt", "rgba"])
            .args(["-s", &format!("{width}x{height}")])
            .args(["-r", &frame_rate.to_string(), "-i", "pipe:0"])
            .args(format.encoder())
            .arg(&unfinished)
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .map_err(|why| {
                anyhow!(
                    "{}: a video needs ffmpeg, which could not be started ({why}). Install it (Debian: apt-get install ffmpeg), or save numbered images",
                    path.display()
                )
            })?;
        Ok(Self {
            path: path.to_owned(),
            unfinished,
            format,
            encoder,
            size,
        })
    }

    /// Adds a frame, of display values.
    pub fn add(&mut self, frame: &Raster) -> Result<()> {
        let size = [frame.width, frame.height];
        if size != self.size {
            bail!(
                "{}: the frames of a video need one size, and one is {} x {} after others of {} x {}; give --size",
                self.path.display(),
                size[0],
                size[1],
                self.size[0],
                self.size[1]
            );
        }
        let byte = |v: f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        let bytes: Vec<u8> = match self.format {
            // It has no alpha: what is behind is black.
            VideoFormat::Mp4 => {
                let pixels = frame.pixels.iter();
                pixels
                    .flat_map(|[r, g, b, _]| [*r, *g, *b, 1.0].map(byte))
                    .collect()
            }
            VideoFormat::WebM | VideoFormat::WebP => {
                let pixels = present::straight(frame);
                pixels.into_iter().flatten().map(byte).collect()
            }
        };
        let input = self.encoder.stdin.as_mut().context("it takes frames")?;
        let taken = input.write_all(&bytes);
        taken.map_err(|_| self.complaint())
    }

    /// Ends it, and gives it its name.
    pub fn finish(mut self) -> Result<()> {
        drop(self.encoder.stdin.take());
        let status = self.encoder.wait().context("ffmpeg")?;
        if !status.success() {
            return Err(self.complaint());
        }
        let mut video = File::open(&self.unfinished).context("a temporary file")?;
        let write = write_atomically(&self.path, |out| std::io::copy(&mut video, out).map(drop));
        Ok(write?)
    }

    /// Error message of the encoder.
    fn complaint(&mut self) -> anyhow::Error {
        drop(self.encoder.stdin.take());
        let mut words = String::new();
        if let Some(errors) = &mut self.encoder.stderr {
            // What it said up to here is better than nothing.
            let _ = errors.read_to_string(&mut words);
        }
        anyhow!("{}: ffmpeg failed: {}", self.path.display(), words.trim())
    }
}

impl Drop for VideoEncoder {
    fn drop(&mut self) {
        // One that was cut off would wait for frames for ever; one that has ended does not mind.
        let _ = self.encoder.kill();
        let _ = self.encoder.wait();
    }
}
