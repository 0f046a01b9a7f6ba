//! Splats in PLY: 2DGS and 3DGS of any SH degree to 8, properties found by name in any order; and compressed, by [`compressed`].

mod comments;
pub(super) mod compressed;
mod header;
mod made;
mod write;

use std::io::{BufRead, Seek, SeekFrom};
use std::path::Path;

use super::rows::{AssetKind, Builder, Finished, StoredRow};
use crate::error::{Error, Result};
use crate::sh::{MAX_DEGREE, coefficient_count};

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
    let layout = Layout::find(&header).map_err(invalid)?;
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
    let mut rows =
        Builder::new(layout.kind(), layout.degree, header.vertices as usize).map_err(invalid)?;
    if header.comments.iter().any(|c| says_antialiased(c)) || layout.filter.is_some() {
        rows.set_antialiased();
    }
    if ascii {
        read_ascii(path, reader, &header, &layout, &mut rows)?;
    } else {
        let read = read_binary(reader, &header, &layout, &mut rows);
        read.map_err(Error::io(path))?;
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
    Ok(((cloud, report, surfel_of_row), Some(header)))
}

fn read_binary(
    reader: &mut (impl BufRead + Seek),
    header: &Header,
    layout: &Layout,
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
            layout.row(values, sh)
        });
        left -= rows;
    }
    Ok(())
}

fn read_ascii(
    path: &Path,
    reader: &mut impl BufRead,
    header: &Header,
    layout: &Layout,
    cloud: &mut Builder,
) -> Result<()> {
    let invalid = |message: String| Error::invalid(path, message);
    let columns = header.properties.len();
    let mut line = String::new();
    let mut skipped = 0;
    let (mut rows, mut values) = (0u64, Vec::new());
    while rows < header.vertices {
        line.clear();
        if reader.read_line(&mut line).map_err(Error::io(path))? == 0 {
            return Err(invalid(format!(
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
                .map_err(|_| invalid(format!("vertex {rows}: {word:?} is not a number")))?;
            values.push(value);
        }
        if values.len() - before != columns {
            return Err(invalid(format!(
                "vertex {rows} has {} values where the header names {columns}",
                values.len() - before
            )));
        }
        rows += 1;
        if values.len() >= BLOCK_ROWS * columns || rows == header.vertices {
            cloud.push_rows(values.len() / columns, |row, _, sh| {
                layout.row(&values[row * columns..][..columns], sh)
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
    /// What Mip-Splatting widens each Gaussian by.
    filter: Option<usize>,
    /// `[K][3]`: in the file, all of red's higher coefficients come first, then green's, then blue's.
    sh: Vec<[usize; 3]>,
    degree: usize,
}

impl Layout {
    fn find(header: &Header) -> Result<Self, String> {
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
        let mut sh = vec![[need("f_dc_0")?, need("f_dc_1")?, need("f_dc_2")?]];
        let rest = |c: usize, i: usize| need(&format!("f_rest_{}", c * (k - 1) + i));
        for i in 0..k - 1 {
            sh.push([rest(0, i)?, rest(1, i)?, rest(2, i)?]);
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
            filter: header.find("filter_3D"),
            sh,
            degree,
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

    fn kind(&self) -> AssetKind {
        match self.scales[..] {
            [_, _] => AssetKind::Surfels2d,
            _ => AssetKind::Gaussians3d,
        }
    }

    /// The row of these values, in the order of its properties.
    fn row(&self, values: &[f32], sh: &mut [[f32; 3]]) -> StoredRow {
        let get = |index: usize| values[index];
        for (out, indices) in sh.iter_mut().zip(&self.sh) {
            *out = indices.map(get);
        }
        let mut log_scales = [0.0; 3];
        for (log, index) in log_scales.iter_mut().zip(&self.scales) {
            *log = get(*index);
        }
        let mut row = StoredRow {
            position: self.position.map(get),
            rotation: self.rotation.map(get),
            log_scales,
            logit: get(self.opacity),
        };
        if let (Some(filter), AssetKind::Gaussians3d) = (self.filter, self.kind()) {
            row.widen(get(filter));
        }
        row
    }
}

#[cfg(test)]
mod tests;
