//! Splats in PLY: 2DGS and 3DGS of any SH degree to 8, properties found by name in any order.

mod header;

use std::io::{BufRead, BufReader, Seek, SeekFrom};
use std::path::{Path, PathBuf};

use glam::{Mat3, Quat, Vec2, Vec3};
use rayon::prelude::*;

use crate::color::Encoding;
use crate::error::{Error, Result};
use crate::sh::{MAX_COEFFICIENTS, MAX_DEGREE, coefficient_count};
use crate::surfels::{SurfelCloud, UpAxis};

pub(crate) use header::Format;
use header::{Header, ScalarType};

/// What kind of splat a file holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum AssetKind {
    /// 2D Gaussian surfels: two scales.
    Surfels2d,
    /// 3D Gaussians: three scales, of which the shortest was dropped.
    Gaussians3d,
}

/// What loading noticed.
#[derive(Clone, Debug)]
pub struct AssetReport {
    /// 2DGS or 3DGS.
    pub kind: AssetKind,
    /// Vertices in the file.
    pub vertices: usize,
    /// Names of all properties, in the file's order.
    pub properties: Vec<String>,
    /// Comment lines of the header.
    pub comments: Vec<String>,
    /// Rows that hold something that is not a number or out of any range; they are kept in place and never drawn.
    pub left_out: Vec<usize>,
    /// 3DGS: median of shortest over second axis. 0 is flat; relighting needs well under 0.3.
    pub median_flatness: Option<f32>,
}

/// The file behind an asset: what [`crate::files::write_relit_ply`] needs to write it again with other colour.
#[derive(Clone, Debug)]
pub struct AssetFile {
    /// Where it was read.
    pub path: PathBuf,
    /// What was noticed.
    pub report: AssetReport,
    pub(crate) header: Header,
    /// Length and time of change when it was read: it must still be the same when it is written again.
    pub(crate) stamp: (u64, Option<std::time::SystemTime>),
}

/// A file with a larger share of broken rows is refused: it is not a splat with a few bad surfels.
const MAX_LEFT_OUT_SHARE: f64 = 0.1;

/// Rows are read and converted in blocks of this size.
const BLOCK_ROWS: usize = 1 << 14;

/// Loads a 2DGS or 3DGS PLY.
///
/// A 3D Gaussian becomes a surfel by dropping its shortest axis. Rows with values that are no numbers are left out of the
/// picture (opacity 0) and reported.
///
/// # Errors
/// The file cannot be read, is no PLY, lacks a property that a splat has, ends before its rows do, or is mostly no numbers.
pub fn load_asset(path: &Path) -> Result<(SurfelCloud, AssetFile)> {
    let invalid = |message: String| Error::invalid(path, message);
    let file = super::read::open(path)?;
    let metadata = file.metadata().map_err(Error::io(path))?;
    if metadata.len() == 0 {
        return Err(invalid(
            "the file is empty; a splat in PLY is expected".into(),
        ));
    }
    let mut reader = BufReader::with_capacity(1 << 20, file);
    let header =
        Header::parse(&mut reader).map_err(|m| invalid(format!("not a PLY splat: {m}")))?;
    let layout = Layout::find(&header).map_err(invalid)?;
    let available = metadata.len().saturating_sub(header.bytes);
    // The least that the claimed rows take: so nothing is allocated that the file could not fill.
    let row_bytes = if header.format == Format::Ascii {
        2 * header.properties.len()
    } else {
        header.stride
    } as u64;
    let needed = header.vertices.checked_mul(row_bytes).and_then(|n| {
        n.checked_add(if header.format == Format::Ascii {
            0
        } else {
            header.skip
        })
    });
    // The last line of a text may lack its end.
    let slack = u64::from(header.format == Format::Ascii);
    if needed.is_none_or(|n| n > available + slack) {
        let whole = available / row_bytes.max(1);
        return Err(invalid(format!(
            "claims {} vertices of {row_bytes} bytes or more, and has room for {whole}: it is truncated, or its count is wrong",
            header.vertices
        )));
    }
    if header.vertices == 0 {
        return Err(invalid("holds no vertices".into()));
    }
    let mut cloud = Builder::new(&layout, header.vertices as usize);
    if header.format == Format::Ascii {
        read_ascii(&mut reader, &header, &mut cloud)
    } else {
        read_binary(&mut reader, &header, &mut cloud)
    }
    .map_err(|problem| match problem {
        RowError::Io(reason) => Error::Io {
            path: path.to_owned(),
            reason,
        },
        RowError::Text(message) => invalid(message),
    })?;
    let (cloud, report) = cloud.finish(&header).map_err(invalid)?;
    let asset = AssetFile {
        path: path.to_owned(),
        report,
        header,
        stamp: (metadata.len(), metadata.modified().ok()),
    };
    Ok((cloud, asset))
}

enum RowError {
    Io(std::io::Error),
    Text(String),
}

fn read_binary(
    reader: &mut (impl BufRead + Seek),
    header: &Header,
    cloud: &mut Builder<'_>,
) -> Result<(), RowError> {
    reader
        .seek(SeekFrom::Start(header.bytes + header.skip))
        .map_err(RowError::Io)?;
    let mut left = header.vertices as usize;
    let mut block = vec![0u8; BLOCK_ROWS.min(left) * header.stride];
    while left > 0 {
        let rows = left.min(BLOCK_ROWS);
        let block = &mut block[..rows * header.stride];
        reader.read_exact(block).map_err(RowError::Io)?;
        let properties = &header.properties;
        let big_endian = header.big_endian();
        // As trainers write it; everything else is read property by property.
        let plain = !big_endian && properties.iter().all(|p| p.scalar == ScalarType::F32);
        cloud.push_rows(rows, |row, values| {
            let bytes = &block[row * header.stride..][..header.stride];
            if plain {
                for (value, bytes) in values.iter_mut().zip(bytes.as_chunks().0) {
                    *value = f32::from_le_bytes(*bytes);
                }
            } else {
                for (value, p) in values.iter_mut().zip(properties) {
                    *value = p.scalar.read(&bytes[p.offset..], big_endian);
                }
            }
        });
        left -= rows;
    }
    Ok(())
}

fn read_ascii(
    reader: &mut impl BufRead,
    header: &Header,
    cloud: &mut Builder<'_>,
) -> Result<(), RowError> {
    let columns = header.properties.len();
    let mut line = String::new();
    let mut skipped = 0;
    let (mut rows, mut values) = (0u64, Vec::new());
    while rows < header.vertices {
        line.clear();
        if reader.read_line(&mut line).map_err(RowError::Io)? == 0 {
            return Err(RowError::Text(format!(
                "ends after {rows} of {} vertices",
                header.vertices
            )));
        }
        if line.trim().is_empty() {
            continue;
        }
        if skipped < header.skip {
            skipped += 1;
            continue;
        }
        let before = values.len();
        for word in line.split_ascii_whitespace() {
            let value: f32 = word
                .parse()
                .map_err(|_| RowError::Text(format!("vertex {rows}: {word:?} is not a number")))?;
            values.push(value);
        }
        if values.len() - before != columns {
            return Err(RowError::Text(format!(
                "vertex {rows} has {} values where the header names {columns}",
                values.len() - before
            )));
        }
        rows += 1;
        if values.len() >= BLOCK_ROWS * columns || rows == header.vertices {
            cloud.push_rows(values.len() / columns, |row, out| {
                out.copy_from_slice(&values[row * columns..][..columns]);
            });
            values.clear();
        }
    }
    Ok(())
}

/// Indices of the properties that make a surfel.
struct Layout {
    position: [usize; 3],
    rotation: [usize; 4],
    scales: Vec<usize>,
    opacity: usize,
    /// `[K][3]`: in the file, all of red's higher coefficients come first, then green's, then blue's.
    sh: Vec<[usize; 3]>,
    degree: usize,
    /// Properties of a row.
    columns: usize,
}

impl Layout {
    fn find(header: &Header) -> Result<Self, String> {
        let need = |name: &str| {
            header.find(name).ok_or_else(|| {
                format!("the vertices have no property {name}; a splat has x y z, f_dc_0..2, opacity, scale_0..1 (and 2), rot_0..3")
            })
        };
        if header.find("packed_position").is_some() {
            return Err(
                "a compressed PLY, which is not supported yet; save it uncompressed".into(),
            );
        }
        let rest = header
            .properties
            .iter()
            .filter(|p| p.name.starts_with("f_rest_"))
            .count();
        let degree = (0..=MAX_DEGREE)
            .find(|degree| 3 * (coefficient_count(*degree) - 1) == rest)
            .ok_or_else(|| {
                format!("has {rest} f_rest properties, which is no SH degree from 0 to 8 (0, 9, 24, 45, 72, 105, 144, 189 or 240)")
            })?;
        let k = coefficient_count(degree);
        let mut sh = vec![[need("f_dc_0")?, need("f_dc_1")?, need("f_dc_2")?]];
        for i in 0..k - 1 {
            let mut coefficient = [0; 3];
            for (c, slot) in coefficient.iter_mut().enumerate() {
                *slot = need(&format!("f_rest_{}", c * (k - 1) + i))?;
            }
            sh.push(coefficient);
        }
        let mut scales = vec![need("scale_0")?, need("scale_1")?];
        scales.extend(header.find("scale_2"));
        let layout = Self {
            position: [need("x")?, need("y")?, need("z")?],
            rotation: [
                need("rot_0")?,
                need("rot_1")?,
                need("rot_2")?,
                need("rot_3")?,
            ],
            scales,
            opacity: need("opacity")?,
            sh,
            degree,
            columns: header.properties.len(),
        };
        // Integers cannot hold logits, logarithms and SH: such a file is packed in a way of its own.
        let used = layout.sh.iter().flatten().chain(&layout.scales);
        for index in used.chain(&layout.rotation).chain([&layout.opacity]) {
            let p = &header.properties[*index];
            if !p.scalar.is_float() {
                return Err(format!(
                    "property {} is an integer where a splat has a float: a packed format that is not supported",
                    p.name
                ));
            }
        }
        Ok(layout)
    }
}

/// One converted row.
struct Row {
    position: Vec3,
    tangents: [Vec3; 2],
    scale: Vec2,
    opacity: f32,
    /// Shortest over second axis of a 3D Gaussian: 0 is flat.
    flatness: f32,
    valid: bool,
}

/// Positions beyond this overflow when squared; colour beyond [`MAX_SH`] is no colour.
const MAX_POSITION: f32 = 1e15;
const MAX_SH: f32 = 1e6;

impl Row {
    fn read(layout: &Layout, values: &[f32]) -> Self {
        let get = |index: usize| values[index];
        let position = Vec3::from_array(layout.position.map(get));
        let [w, x, y, z] = layout.rotation.map(get);
        let logit = get(layout.opacity);
        let mut logs = [0f32; 3];
        for (log, index) in logs.iter_mut().zip(&layout.scales) {
            *log = get(*index);
        }
        let logs = &logs[..layout.scales.len()];
        let length = (w * w + x * x + y * y + z * z).sqrt();
        let in_range = |v: f32, limit: f32| v.abs() <= limit;
        let valid = position.to_array().iter().all(|v| in_range(*v, MAX_POSITION))
            && length > 1e-12
            && length.is_finite()
            // Flattened to nothing (log 0) or opaque (logit infinity) is fine.
            && !logit.is_nan()
            && logs.iter().all(|v| *v < 80.0)
            && layout.sh.iter().flatten().fold(true, |ok, i| ok & in_range(get(*i), MAX_SH));
        if !valid {
            return Self {
                position: Vec3::ZERO,
                tangents: [Vec3::X, Vec3::Y],
                scale: Vec2::splat(1e-12),
                opacity: 0.0,
                flatness: f32::NAN,
                valid,
            };
        }
        let axes = Mat3::from_quat(Quat::from_xyzw(x, y, z, w).normalize());
        let axes = [axes.x_axis, axes.y_axis, axes.z_axis];
        let scales: [f32; 3] =
            std::array::from_fn(|i| logs.get(i).map_or(0.0, |log| log.max(-60.0).exp()));
        // The third axis is kept as the normal where it is the shortest, so that a flat 3D Gaussian has the frame of a surfel.
        let shortest = if logs.len() < 3 || (scales[2] <= scales[0] && scales[2] <= scales[1]) {
            2
        } else if scales[0] <= scales[1] {
            0
        } else {
            1
        };
        let (u, v) = ((shortest + 1) % 3, (shortest + 2) % 3);
        Self {
            position,
            tangents: [axes[u], axes[v]],
            scale: Vec2::new(scales[u], scales[v]),
            opacity: 1.0 / (1.0 + (-logit).exp()),
            flatness: scales[shortest] / scales[u].min(scales[v]),
            valid,
        }
    }
}

/// Fills the cloud block by block. All of it is allocated at once, zeroed by the system, so that its pages are first touched in parallel.
struct Builder<'a> {
    layout: &'a Layout,
    cloud: SurfelCloud,
    filled: usize,
    flatness: Vec<f32>,
    left_out: Vec<usize>,
}

impl<'a> Builder<'a> {
    fn new(layout: &'a Layout, rows: usize) -> Self {
        let cloud = SurfelCloud {
            positions: bytemuck::zeroed_vec(rows),
            tangents: bytemuck::zeroed_vec(rows),
            scales: bytemuck::zeroed_vec(rows),
            opacities: bytemuck::zeroed_vec(rows),
            sh: bytemuck::zeroed_vec(rows * layout.sh.len()),
            sh_degree: layout.degree,
            encoding: Encoding::Stored,
            up: UpAxis::PlusZ,
            outside_from: Vec::new(),
        };
        Self {
            layout,
            cloud,
            filled: 0,
            flatness: bytemuck::zeroed_vec(rows),
            left_out: Vec::new(),
        }
    }

    /// Converts a block of rows in parallel; `decode` writes a row's values in the order of its properties.
    fn push_rows(&mut self, rows: usize, decode: impl Fn(usize, &mut [f32]) + Sync) {
        const PIECE: usize = 512;
        let (layout, k) = (self.layout, self.layout.sh.len());
        let block = self.filled..self.filled + rows;
        let cloud = &mut self.cloud;
        let left_out: Vec<usize> = cloud.positions[block.clone()]
            .par_chunks_mut(PIECE)
            .zip(cloud.tangents[block.clone()].par_chunks_mut(PIECE))
            .zip(cloud.scales[block.clone()].par_chunks_mut(PIECE))
            .zip(cloud.opacities[block.clone()].par_chunks_mut(PIECE))
            .zip(cloud.sh[block.start * k..block.end * k].par_chunks_mut(PIECE * k))
            .zip(self.flatness[block.clone()].par_chunks_mut(PIECE))
            .enumerate()
            .flat_map_iter(
                |(piece, (((((positions, tangents), scales), opacities), sh), flatness))| {
                    let mut left_out = Vec::new();
                    let mut values = vec![0f32; layout.columns];
                    for i in 0..positions.len() {
                        let row = piece * PIECE + i;
                        decode(row, &mut values);
                        let converted = Row::read(layout, &values);
                        positions[i] = converted.position;
                        tangents[i] = converted.tangents;
                        scales[i] = converted.scale;
                        opacities[i] = converted.opacity;
                        flatness[i] = converted.flatness;
                        if !converted.valid {
                            left_out.push(block.start + row);
                            continue;
                        }
                        for (out, indices) in sh[i * k..][..k].iter_mut().zip(&layout.sh) {
                            *out = indices.map(|index| values[index]);
                        }
                    }
                    left_out
                },
            )
            .collect();
        self.left_out.extend(left_out);
        self.filled += rows;
    }

    fn finish(self, header: &Header) -> Result<(SurfelCloud, AssetReport), String> {
        let (mut cloud, mut flatness) = (self.cloud, self.flatness);
        // A row that is left out has no ratio.
        flatness.retain(|f| f.is_finite());
        if self.layout.scales.len() < 3 {
            flatness.clear();
        }
        debug_assert!(coefficient_count(cloud.sh_degree) <= MAX_COEFFICIENTS);
        if self.left_out.len() as f64 > MAX_LEFT_OUT_SHARE * cloud.len() as f64 {
            return Err(format!(
                "{} of {} vertices hold values that are no numbers or out of any range (the first is vertex {}); not a usable splat",
                self.left_out.len(),
                cloud.len(),
                self.left_out[0]
            ));
        }
        cloud.up = header
            .comments
            .iter()
            .find_map(|comment| up_axis_of(comment))
            .unwrap_or_default();
        let median_flatness = (!flatness.is_empty()).then(|| {
            let middle = flatness.len() / 2;
            *flatness.select_nth_unstable_by(middle, f32::total_cmp).1
        });
        let kind = if self.layout.scales.len() == 3 {
            AssetKind::Gaussians3d
        } else {
            AssetKind::Surfels2d
        };
        let report = AssetReport {
            kind,
            vertices: cloud.len(),
            properties: header.properties.iter().map(|p| p.name.clone()).collect(),
            comments: header.comments.clone(),
            left_out: self.left_out,
            median_flatness,
        };
        Ok((cloud, report))
    }
}

/// `Vertical axis: y` in a comment, as several tools write it.
fn up_axis_of(comment: &str) -> Option<UpAxis> {
    let lower = comment.to_ascii_lowercase();
    let axis = lower.strip_prefix("vertical axis:")?.trim();
    let signed = if axis.starts_with(['+', '-']) {
        axis.to_owned()
    } else {
        format!("+{axis}")
    };
    UpAxis::ALL
        .iter()
        .find(|(name, _)| *name == signed)
        .map(|(_, axis)| *axis)
}

#[cfg(test)]
mod tests;
