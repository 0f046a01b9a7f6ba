//! Splats in PLY: 2DGS and 3DGS of any SH degree to 8, properties found by name in any order; and compressed, by [`compressed`].

mod colors;
mod comments;
pub(super) mod compressed;
mod header;
mod made;
mod write;

use std::io::{BufRead, Seek, SeekFrom};
use std::path::Path;

use super::packed::{dc_of_color, logit};
use super::rows::{Builder, Finished, SplatKind, StoredRow};
use crate::error::{Error, Result};
use crate::sh::{MAX_DEGREE, coefficient_count};

use colors::SHOWN;
use comments::{says_antialiased, up_of};
pub(super) use header::Header;
use header::{Format, ScalarType};
pub(super) use made::write as write_made;
pub(super) use write::ColorColumns;

/// Rows are read and converted in blocks of this size.
const BLOCK_ROWS: usize = 1 << 14;

/// Reads a splat from a file of so many bytes; the header, where it is not compressed, is what [`ColorColumns`] writes it again by.
pub(super) fn read(
    path: &Path,
    reader: &mut (impl BufRead + Seek),
    file_bytes: u64,
) -> Result<(Finished, Option<Header>)> {
    let invalid = |message: String| Error::invalid(path, message);
    let header = Header::parse(reader).map_err(|m| invalid(format!("not a PLY splat: {m}")))?;
    if header.find("packed_position").is_some() {
        let finished = compressed::read(path, reader, file_bytes, &header)?;
        return Ok((finished, None));
    }
    let layout = PlyLayout::find(&header).map_err(invalid)?;
    let available = file_bytes.saturating_sub(header.bytes);
    let ascii = header.format == Format::Ascii;
    // The least that the claimed rows take: so nothing is allocated that the file could not fill.
    let row_bytes = if ascii {
        2 * header.properties.len()
    } else {
        header.stride
    } as u64;
    let before = if ascii { 0 } else { header.skip };
    let needed = (header.vertices.checked_mul(row_bytes)).and_then(|n| n.checked_add(before));
    // The last line of a text may lack its end.
    if needed.is_none_or(|n| n > available + u64::from(ascii)) {
        let whole = available / row_bytes.max(1);
        return Err(invalid(format!(
            "claims {} vertices of {row_bytes} bytes or more, and has room for {whole}: it is truncated, or its count is wrong",
            header.vertices
        )));
    }
    if header.vertices == 0 {
        return Err(invalid("holds no vertices".into()));
    }
    let mut rows = fill(path, reader, &header, &layout)?;
    let mut warnings = Vec::new();
    let mut layout = layout;
    // Stored in another way than it seemed: all is read once more.
    if layout.reinterpret(&rows, &mut warnings) {
        drop(rows);
        reader
            .seek(SeekFrom::Start(header.bytes))
            .map_err(Error::io(path))?;
        rows = fill(path, reader, &header, &layout)?;
    }
    if !header.is_whole(reader, file_bytes) {
        return Err(invalid(
            "holds all its vertices, and is cut in what comes after them".into(),
        ));
    }
    let (cloud, mut report, surfel_of_row) =
        (rows.finish("PLY".into(), up_of(&header))).map_err(invalid)?;
    report.properties = header.properties.iter().map(|p| p.name.clone()).collect();
    report.comments = header.comments.clone();
    report.warnings.extend(warnings);
    report.warnings.extend(motion_warning(&header));
    Ok(((cloud, report, surfel_of_row), Some(header)))
}

/// All rows of a file whose header was read.
fn fill(
    path: &Path,
    reader: &mut (impl BufRead + Seek),
    header: &Header,
    layout: &PlyLayout,
) -> Result<Builder> {
    let invalid = |message: String| Error::invalid(path, message);
    let mut rows =
        Builder::new(layout.kind(), layout.degree, header.vertices as usize).map_err(invalid)?;
    if header.comments.iter().any(|c| says_antialiased(c)) || layout.filter.is_some() {
        rows.set_antialiased();
    }
    if layout.position_is_wide {
        rows.set_position_step(0.0);
    }
    if header.format == Format::Ascii {
        read_ascii(path, reader, header, layout, &mut rows)?;
    } else {
        let read = read_binary(reader, header, layout, &mut rows);
        read.map_err(Error::io(path))?;
    }
    Ok(rows)
}

/// Properties of splats that move: names, or what names begin with.
const MOTION: [&str; 9] = [
    "motion_",
    "trbf_",
    "omega_",
    "f_t_",
    "velocity",
    "scale_t",
    "scaling_t",
    "rot_r_",
    "trans_",
];

fn motion_warning(header: &Header) -> Option<String> {
    let moves = |name: &str| name == "t" || MOTION.iter().any(|m| name.starts_with(m));
    let moving = header.properties.iter().filter(|p| moves(&p.name));
    let names: Vec<&str> = moving.map(|p| &*p.name).collect();
    let first = names.first()?;
    Some(format!(
        "has properties of a splat that moves ({first} and {} more); it is shown as it stands in x, y, z, without its motion",
        names.len() - 1
    ))
}

fn read_binary(
    reader: &mut (impl BufRead + Seek),
    header: &Header,
    layout: &PlyLayout,
    cloud: &mut Builder,
) -> std::io::Result<()> {
    reader.seek(SeekFrom::Start(header.bytes + header.skip))?;
    let mut left = header.vertices as usize;
    let mut block = vec![0u8; BLOCK_ROWS.min(left) * header.stride];
    while left > 0 {
        let rows = left.min(BLOCK_ROWS);
        let block = &mut block[..rows * header.stride];
        reader.read_exact(block)?;
        let properties = &header.properties;
        let big_endian = header.big_endian();
        // As trainers write it; everything else is read property by property.
        let plain = !big_endian && properties.iter().all(|p| p.scalar == ScalarType::F32);
        cloud.push_rows(rows, |row, values, sh| {
            values.resize(properties.len(), 0.0);
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
            let mut stored = layout.row(values, sh);
            if layout.position_is_wide {
                stored.position = layout.position.map(|i| {
                    let p = &properties[i];
                    p.scalar.read_f64(&bytes[p.offset..], big_endian)
                });
            }
            stored
        });
        left -= rows;
    }
    Ok(())
}

fn read_ascii(
    path: &Path,
    reader: &mut impl BufRead,
    header: &Header,
    layout: &PlyLayout,
    cloud: &mut Builder,
) -> Result<()> {
    let invalid = |message: String| Error::invalid(path, message);
    let columns = header.properties.len();
    let mut line = Vec::new();
    let mut skipped = 0;
    let (mut rows, mut values, mut positions) = (0u64, Vec::new(), Vec::new());
    while rows < header.vertices {
        line.clear();
        let read = reader.read_until(b'\n', &mut line);
        if read.map_err(Error::io(path))? == 0 {
            return Err(invalid(format!(
                "ends after {rows} of {} vertices",
                header.vertices
            )));
        }
        let line = String::from_utf8_lossy(&line);
        if line.trim().is_empty() {
            continue;
        }
        if skipped < header.skip {
            skipped += 1;
            continue;
        }
        let before = values.len();
        let mut position = [0f64; 3];
        for (column, word) in line.split_ascii_whitespace().enumerate() {
            let wrong = || invalid(format!("vertex {rows}: {word:?} is not a number"));
            values.push(word.parse::<f32>().map_err(|_| wrong())?);
            if let Some(axis) = layout.position.iter().position(|i| *i == column) {
                // As exact as the header says that it is.
                position[axis] = match header.properties[column].scalar {
                    ScalarType::F32 => values[values.len() - 1].into(),
                    _ => word.parse().map_err(|_| wrong())?,
                };
            }
        }
        positions.push(position);
        if values.len() - before != columns {
            return Err(invalid(format!(
                "vertex {rows} has {} values where the header names {columns}",
                values.len() - before
            )));
        }
        rows += 1;
        if values.len() >= BLOCK_ROWS * columns || rows == header.vertices {
            cloud.push_rows(values.len() / columns, |row, _, sh| StoredRow {
                position: positions[row],
                ..layout.row(&values[row * columns..][..columns], sh)
            });
            values.clear();
            positions.clear();
        }
    }
    Ok(())
}

/// Indices of the properties that make a surfel.
struct PlyLayout {
    position: [usize; 3],
    /// True where positions are stored in more than 32-bit floats.
    position_is_wide: bool,
    rotation: [usize; 4],
    scales: Vec<usize>,
    opacity: usize,
    /// Mip-Splatting's filter, which widens each Gaussian.
    filter: Option<usize>,
    /// `[K][3]`
    sh: Vec<[usize; 3]>,
    /// Stored value of 1, where colour is no SH and stored as it is shown.
    shown: Option<f32>,
    degree: usize,
    /// True where scales are lengths, not logarithms.
    are_lengths: bool,
    /// True where opacities are shares, not logits.
    are_shares: bool,
}

impl PlyLayout {
    fn find(header: &Header) -> Result<Self, String> {
        if let Some(other) = no_splat(header) {
            return Err(other);
        }
        let need = |name: &str| {
            header.find(name).ok_or_else(|| {
                format!("the vertices have no property {name}; a splat has x y z, f_dc_0..2, opacity, scale_0..1 (and 2), rot_0..3")
            })
        };
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
        let all = |names: &[&str; 3]| {
            let [r, g, b] = names.map(|name| header.find(name));
            Some([r?, g?, b?])
        };
        let shown = SHOWN
            .iter()
            .find_map(all)
            .filter(|_| header.find("f_dc_0").is_none());
        let mut sh = match shown {
            Some(shown) if rest == 0 => vec![shown],
            _ => vec![[need("f_dc_0")?, need("f_dc_1")?, need("f_dc_2")?]],
        };
        let rest = |c: usize, i: usize| need(&format!("f_rest_{}", c * (k - 1) + i));
        for i in 0..k - 1 {
            sh.push([rest(0, i)?, rest(1, i)?, rest(2, i)?]);
        }
        let mut scales = vec![need("scale_0")?, need("scale_1")?];
        scales.extend(header.find("scale_2"));
        let position = [need("x")?, need("y")?, need("z")?];
        let scalar = |i: usize| header.properties[i].scalar;
        let layout = Self {
            position,
            position_is_wide: position.iter().any(|i| scalar(*i) != ScalarType::F32),
            rotation: [
                need("rot_0")?,
                need("rot_1")?,
                need("rot_2")?,
                need("rot_3")?,
            ],
            scales,
            opacity: need("opacity")?,
            filter: header.find("filter_3D"),
            shown: shown.map(|[red, ..]| scalar(red).most()),
            sh,
            degree,
            are_lengths: false,
            are_shares: false,
        };
        // Integers cannot hold logits, logarithms and SH: such a file is packed in a way of its own.
        let colors = layout.sh.iter().flatten().filter(|_| shown.is_none());
        let used = colors.chain(&layout.scales);
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

    fn kind(&self) -> SplatKind {
        match self.scales[..] {
            [_, _] => SplatKind::Surfels2d,
            _ => SplatKind::Gaussians3d,
        }
    }

    /// Takes in how rows are stored by what was read of them; whether that is otherwise than they were read.
    fn reinterpret(&mut self, rows: &Builder, warnings: &mut Vec<String>) -> bool {
        let found = rows.found();
        if self.scales.len() == 3 && found.third_scale_is_zero {
            self.scales.truncate(2);
            warnings.push(
                "every scale_2 is 0: it is read as a splat of 2D Gaussians, which have no third scale"
                    .into(),
            );
            return true;
        }
        if found.are_lengths && !self.are_lengths {
            (self.are_lengths, self.are_shares) = (true, found.are_shares);
            let which = match found.are_shares {
                true => "scales and opacities",
                false => "scales",
            };
            warnings.push(format!(
                "its {which} look already exponentiated, and are read so: as the logarithms that a PLY stores, its Gaussians would be as large as the object"
            ));
            return true;
        }
        false
    }

    /// The row of these values, in the order of its properties.
    fn row(&self, values: &[f32], sh: &mut [[f32; 3]]) -> StoredRow {
        let get = |index: usize| values[index];
        for (out, indices) in sh.iter_mut().zip(&self.sh) {
            *out = indices.map(get);
        }
        if let Some(most) = self.shown {
            sh[0] = sh[0].map(|v| dc_of_color(v / most));
        }
        let mut log_scales = [0.0; 3];
        for (log, index) in log_scales.iter_mut().zip(&self.scales) {
            *log = get(*index);
        }
        let mut row = StoredRow {
            position: self.position.map(|i| get(i).into()),
            rotation: self.rotation.map(get),
            log_scales,
            logit: get(self.opacity),
        };
        if self.are_lengths {
            row.log_scales = row.log_scales.map(f32::ln);
        }
        if self.are_shares {
            row.logit = logit(row.logit);
        }
        if let (Some(filter), SplatKind::Gaussians3d) = (self.filter, self.kind()) {
            row.widen(get(filter));
        }
        row
    }
}

/// Description of a PLY that is no splat, and what to do about it.
fn no_splat(header: &Header) -> Option<String> {
    let has = |name: &str| header.find(name).is_some();
    if has("scale_0") || has("rot_0") || !has("x") {
        return None;
    }
    let others = header.before.iter().chain(&header.after);
    let has_faces = others.clone().any(|e| e.name == "face" && e.count > 0);
    let what = if has_faces { "a mesh" } else { "a point cloud" };
    Some(format!(
        "{what}, not a splat: its vertices have no scales and rotations (scale_0, rot_0). Export the trained Gaussians instead (point_cloud.ply of the reference trainer, \"splat PLY\" in other programs), or train a splat from it"
    ))
}

#[cfg(test)]
mod tests;
