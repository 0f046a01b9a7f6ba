//! Splats in SOG (PlayCanvas), versions 1 and 2: lossless images whose pixels are Gaussians, and `meta.json` with their encoding.

mod codebook;
pub(super) mod layout;
mod write;

use std::io::{Read, Seek};
use std::path::{Path, PathBuf};

use image::RgbaImage;
use rayon::prelude::*;
use serde::Deserialize;

use super::decode::{self, Archive};
use super::packed::{component, logit, share, with_largest};
use super::read::{self, Input, ZIP};
use super::rows::{Builder, Finished, SplatKind, StoredRow, check_count};
use crate::error::{Error, Result};
use crate::sh::coefficient_count;

pub(super) use layout::META;
use layout::{CODES, ENTRIES_IN_A_ROW, ROTATION_MODE, meta_in};
pub(super) use write::{MAX_DEGREE, write};

/// `meta.json` holds two tables of 256 numbers and little else.
const MAX_META_BYTES: u64 = 1 << 20;
/// No picture of 16384 x 16384 pixels takes more.
const MAX_IMAGE_BYTES: u64 = 1 << 31;

/// Edge of a picture that WebP can hold.
const MAX_EDGE: usize = 16384;

#[derive(Deserialize)]
struct Meta {
    version: Option<u32>,
    count: Option<u64>,
    #[serde(default)]
    antialias: bool,
    model: Option<String>,
    means: Means,
    scales: Values,
    quats: Files,
    sh0: Values,
    #[serde(rename = "shN")]
    higher: Option<Higher>,
}

#[derive(Deserialize)]
struct Means {
    shape: Option<Vec<u64>>,
    mins: [f64; 3],
    maxs: [f64; 3],
    files: [String; 2],
}

#[derive(Deserialize)]
struct Files {
    files: Vec<String>,
}

/// By codes (version 2), or between least and greatest (version 1).
#[derive(Deserialize)]
struct Values {
    codebook: Option<Codebook>,
    mins: Option<Vec<f32>>,
    maxs: Option<Vec<f32>>,
    files: Vec<String>,
}

#[derive(Deserialize)]
struct Higher {
    bands: Option<usize>,
    codebook: Option<Codebook>,
    mins: Option<f32>,
    maxs: Option<f32>,
    files: [String; 2],
}

/// Numbers by their code; what is no number is `null`.
#[derive(Deserialize)]
#[serde(transparent)]
struct Codebook(Vec<Option<f32>>);

impl Codebook {
    fn table(&self) -> std::result::Result<[f32; CODES], String> {
        let codes = &self.0;
        if codes.len() != CODES {
            return Err(format!(
                "a codebook has {} numbers, not {CODES}",
                codes.len()
            ));
        }
        let at = |i: usize| codes[i].unwrap_or(0.0);
        let mut table = std::array::from_fn(at);
        if codes[0].is_none() {
            // As the engine that reads them takes it.
            table[0] = at(1) + (at(1) - at(CODES - 1)) / (CODES - 1) as f32;
        }
        Ok(table)
    }
}

impl Values {
    /// Values of each byte of each channel.
    fn tables<const N: usize>(&self) -> std::result::Result<[[f32; CODES]; N], String> {
        if let Some(codebook) = &self.codebook {
            return Ok([codebook.table()?; N]);
        }
        let (Some(mins), Some(maxs)) = (&self.mins, &self.maxs) else {
            return Err("has neither a codebook nor mins and maxs".into());
        };
        if mins.len() < N || maxs.len() < N {
            return Err(format!("mins and maxs have fewer than {N} numbers"));
        }
        let between =
            |c: usize| std::array::from_fn(|i| lerp(mins[c], maxs[c], share(i as u32, 8)));
        Ok(std::array::from_fn(between))
    }

    fn file(&self) -> std::result::Result<&str, String> {
        self.files
            .first()
            .map(String::as_str)
            .ok_or_else(|| "names no file".into())
    }
}

fn lerp(a: f32, b: f32, share: f32) -> f32 {
    a + (b - a) * share
}

/// Where the files are.
enum SogSource {
    Folder(PathBuf),
    /// An archive, and the folder in it that holds them, with its slash.
    Bundle(Box<Archive<Input>>, String),
}

impl SogSource {
    fn open(path: &Path) -> Result<Self> {
        let invalid = |why: String| Error::invalid(path, why);
        let mut file = read::open(path)?;
        let mut start = Vec::new();
        let read = file.by_ref().take(4).read_to_end(&mut start);
        read.and_then(|_| file.rewind()).map_err(Error::io(path))?;
        if start == ZIP {
            let archive = Archive::open(file)
                .map_err(|why| invalid(format!("is no whole zip archive: {why}")))?;
            let meta = meta_in(&archive.names())
                .ok_or_else(|| invalid(format!("holds no {META} of a SOG splat")))?;
            let folder = meta[..meta.len() - META.len()].to_owned();
            return Ok(Self::Bundle(Box::new(archive), folder));
        }
        Ok(Self::Folder(super::write::folder_of(path).to_owned()))
    }

    /// One of its files, of at most so many bytes.
    fn read(&mut self, name: &str, limit: u64) -> std::result::Result<Vec<u8>, String> {
        match self {
            Self::Folder(folder) => {
                // A name, not a way to somewhere else.
                if Path::new(name).file_name() != Some(name.as_ref()) {
                    return Err(format!("names a file {name:?} that is not beside it"));
                }
                read::read_all(&folder.join(name), limit).map_err(|e| e.to_string())
            }
            Self::Bundle(archive, folder) => archive
                .read(&format!("{folder}{name}"), limit)
                .map_err(|why| format!("{name}: {why}")),
        }
    }
}

/// Reads a splat from its `meta.json`, or from a bundle.
pub(super) fn read(path: &Path) -> Result<Finished> {
    let mut source = SogSource::open(path)?;
    read_source(path, &mut source).map_err(|message| Error::invalid(path, message))
}

fn read_source(path: &Path, source: &mut SogSource) -> std::result::Result<Finished, String> {
    let text = match source {
        SogSource::Folder(_) => read::read_all(path, MAX_META_BYTES).map_err(|e| e.to_string())?,
        SogSource::Bundle(..) => source.read(META, MAX_META_BYTES)?,
    };
    let meta: Meta = decode::json(&text).map_err(|e| format!("not a SOG splat: {e}"))?;
    let version = meta.version.unwrap_or(1);
    if !(1..=2).contains(&version) {
        return Err(format!(
            "is SOG of version {version}; versions 1 and 2 are read"
        ));
    }
    let claimed = meta
        .count
        .or_else(|| meta.means.shape.as_ref()?.first().copied());
    let count = claimed.ok_or("does not say how many splats there are")?;
    let quats = meta
        .quats
        .files
        .first()
        .ok_or("names no file of rotations")?;
    let mut names = vec![
        meta.means.files[0].as_str(),
        &meta.means.files[1],
        meta.scales.file()?,
        quats,
        meta.sh0.file()?,
    ];
    if let Some(higher) = &meta.higher {
        names.extend(higher.files.iter().map(String::as_str));
    }
    let files = names.iter().map(|name| source.read(name, MAX_IMAGE_BYTES));
    let files: Vec<Vec<u8>> = files.collect::<std::result::Result<_, _>>()?;
    check_count(count, files.iter().map(|f| f.len() as u64).sum())?;
    let images = files.par_iter().zip(&names).enumerate();
    let images: Vec<RgbaImage> = images
        .map(|(i, (bytes, name))| {
            // All but the palette have a pixel a splat.
            let least = if i == 5 { 0 } else { count };
            decode(bytes, least, count).map_err(|e| format!("{name}: {e}"))
        })
        .collect::<std::result::Result<_, _>>()?;
    let [low, high, scales, quats, sh0, ..] = &images[..] else {
        return Err("lacks an image".into());
    };
    let palette = match (&meta.higher, &images[5..]) {
        (Some(higher), [centroids, labels]) => Some(Palette::new(higher, centroids, labels)?),
        _ => None,
    };
    let log_scales: [_; 3] = meta.scales.tables()?;
    let colors: [_; 3] = meta.sh0.tables()?;
    // Of version 1 the logit, by the fourth channel's own range.
    let logits: [f32; CODES] = match (&meta.sh0.codebook, meta.sh0.tables::<4>()) {
        (None, tables) => tables?[3],
        _ => std::array::from_fn(|i| logit(share(i as u32, 8))),
    };
    let kind = match meta.model.as_deref() {
        Some("2dgs") => SplatKind::Surfels2d,
        _ => SplatKind::Gaussians3d,
    };
    let degree = palette.as_ref().map_or(0, |p| p.degree);
    let mut rows = Builder::new(kind, degree, count as usize)?;
    if meta.antialias || meta.model.as_deref() == Some("antialiased") {
        rows.set_antialiased();
    }
    // Where it is between its ends.
    let position_step = (0..3).map(|a| {
        let [least, most] = [meta.means.mins[a], meta.means.maxs[a]];
        (most - least).abs() / f64::from(u16::MAX) * (0.5 * (least + most)).abs().exp()
    });
    rows.set_position_step(position_step.fold(0.0, f64::max));
    let pixel = |image: &RgbaImage, i: usize| -> [u8; 4] {
        let bytes = image.as_raw();
        [
            bytes[4 * i],
            bytes[4 * i + 1],
            bytes[4 * i + 2],
            bytes[4 * i + 3],
        ]
    };
    rows.push_rows(count as usize, |i, _, sh| {
        let (low, high) = (pixel(low, i), pixel(high, i));
        let position = |a: usize| {
            let code = u16::from_le_bytes([low[a], high[a]]);
            let [least, most] = [meta.means.mins[a], meta.means.maxs[a]];
            let log = least + (most - least) * f64::from(code) / f64::from(u16::MAX);
            log.signum() * log.abs().exp_m1()
        };
        let [r, g, b, opacity] = pixel(sh0, i);
        sh[0] = std::array::from_fn(|c| colors[c][usize::from([r, g, b][c])]);
        if let Some(palette) = &palette {
            palette.put(i, &mut sh[1..]);
        }
        let scale = pixel(scales, i);
        StoredRow {
            position: std::array::from_fn(position),
            rotation: rotation(pixel(quats, i)),
            log_scales: std::array::from_fn(|a| log_scales[a][usize::from(scale[a])]),
            logit: logits[usize::from(opacity)],
        }
    });
    let mut finished = rows.finish(format!("SOG, version {version}"), None)?;
    let bands = meta.higher.as_ref().and_then(|h| h.bands);
    if let Some(bands) = bands.filter(|bands| *bands != degree) {
        finished.1.warnings.push(format!(
            "says that its SH is of degree {bands}; its palette is of degree {degree}, which is taken"
        ));
    }
    Ok(finished)
}

/// Quaternion w, x, y, z.
fn rotation([a, b, c, mode]: [u8; 4]) -> [f32; 4] {
    let Some(largest) = mode.checked_sub(ROTATION_MODE) else {
        return [1.0, 0.0, 0.0, 0.0];
    };
    let others = [a, b, c].map(|v| component(share(v.into(), 8)));
    with_largest(largest.into(), others)
}

/// A picture of at least so many pixels, and not of many more than there are splats.
fn decode(bytes: &[u8], least: u64, count: u64) -> std::result::Result<RgbaImage, String> {
    let image = decode::small_picture(bytes, |[width, height]| {
        let pixels = width as u64 * height as u64;
        if pixels < least {
            return Err(format!("has {width} x {height} pixels for {count} splats"));
        }
        // A palette has up to 15 pixels for each of at most 65536 entries.
        if pixels > 4 * count + (1 << 20) || width.max(height) > MAX_EDGE {
            return Err(format!(
                "claims {width} x {height} pixels, which is too many for {count} splats"
            ));
        }
        Ok(32 * pixels + (1 << 20))
    })?;
    Ok(image.into_rgba8())
}

/// The SH of degree 1 and more that splats share.
struct Palette<'a> {
    degree: usize,
    /// Values of each byte of a coefficient.
    values: [f32; CODES],
    centroids: &'a RgbaImage,
    /// Entry of each splat, low and high byte.
    labels: &'a RgbaImage,
}

impl<'a> Palette<'a> {
    fn new(
        higher: &Higher,
        centroids: &'a RgbaImage,
        labels: &'a RgbaImage,
    ) -> std::result::Result<Self, String> {
        let in_a_row = centroids.width() as usize / ENTRIES_IN_A_ROW;
        let fits = |l: &usize| coefficient_count(*l) - 1 == in_a_row;
        let degree = (1..=3).find(fits);
        let degree = degree.ok_or_else(|| {
            format!(
                "the palette is {} pixels wide, which fits no SH degree (192, 512 or 960)",
                centroids.width()
            )
        })?;
        let values = match (&higher.codebook, higher.mins, higher.maxs) {
            (Some(codebook), ..) => codebook.table()?,
            (None, Some(least), Some(most)) => {
                std::array::from_fn(|i| lerp(least, most, share(i as u32, 8)))
            }
            _ => return Err("shN has neither a codebook nor mins and maxs".into()),
        };
        Ok(Self {
            degree,
            values,
            centroids,
            labels,
        })
    }

    /// Writes the coefficients of a splat; those of an entry that is not there are no numbers.
    fn put(&self, splat: usize, sh: &mut [[f32; 3]]) {
        let label = &self.labels.as_raw()[4 * splat..];
        let entry = usize::from(u16::from_le_bytes([label[0], label[1]]));
        let row = entry / ENTRIES_IN_A_ROW * self.centroids.width() as usize;
        let first = row + entry % ENTRIES_IN_A_ROW * sh.len();
        let there = self.centroids.as_raw().get(4 * first..);
        let mut pixels = there.unwrap_or_default().chunks_exact(4);
        for f in sh {
            *f = match pixels.next() {
                Some(pixel) => std::array::from_fn(|c| self.values[usize::from(pixel[c])]),
                None => [f32::NAN; 3],
            };
        }
    }
}

#[cfg(test)]
mod tests;
