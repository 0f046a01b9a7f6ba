//! Splats in `.splat`: 32 bytes a Gaussian without any header, and no colour that depends on the view.

use std::io::{Read, Write};
use std::path::Path;

use super::packed::{Fields, color_of_dc, dc_of_color, logit};
use super::rows::{Builder, Finished, SplatKind, StoredRow};
use super::written::WritableSplat;
use crate::error::{Error, Result};

/// Bytes of a Gaussian: position, scales, colour with opacity, rotation.
pub(super) const ROW: usize = 32;

/// Rows are read and converted in blocks of this size.
const BLOCK_ROWS: usize = 1 << 16;

/// True for a file that can be one by its beginning, and by its size where that is known: there is nothing else to know it by.
pub(super) fn begins_as_one(start: &[u8], file_bytes: Option<u64>) -> bool {
    let is_row = |row: &[u8]| {
        let mut fields = Fields(row);
        let position: [f32; 3] = fields.each(Fields::f32);
        let scales: [f32; 3] = fields.each(Fields::f32);
        let rotation = &row[28..];
        position
            .iter()
            .all(|v| v.abs() < 1e9 && (*v == 0.0 || v.abs() > 1e-12))
            && scales
                .iter()
                .all(|s| (0.0..1e5).contains(s) && (*s == 0.0 || *s > 1e-20))
            && rotation.iter().any(|r| *r != 128)
    };
    file_bytes.is_none_or(|n| n > 0 && n.is_multiple_of(ROW as u64))
        && start.len() >= ROW
        && start.chunks_exact(ROW).all(is_row)
}

/// Reads a splat from a file of so many bytes, a multiple of [`ROW`].
pub(super) fn read(path: &Path, reader: &mut impl Read, file_bytes: u64) -> Result<Finished> {
    let mut left = (file_bytes / ROW as u64) as usize;
    let mut rows =
        Builder::new(SplatKind::Gaussians3d, 0, left).map_err(|m| Error::invalid(path, m))?;
    let mut block = vec![0; BLOCK_ROWS.min(left) * ROW];
    while left > 0 {
        let count = left.min(BLOCK_ROWS);
        let block = &mut block[..count * ROW];
        reader.read_exact(block).map_err(Error::io(path))?;
        rows.push_rows(count, |row, _, sh| {
            let mut fields = Fields(&block[row * ROW..][..ROW]);
            let position: [f32; 3] = fields.each(Fields::f32);
            let scales: [f32; 3] = fields.each(Fields::f32);
            sh[0] = fields.each(|f| dc_of_color(f32::from(f.u8()) / 255.0));
            StoredRow {
                position: position.map(f64::from),
                log_scales: scales.map(f32::ln),
                logit: logit(f32::from(fields.u8()) / 255.0),
                rotation: fields.each(|f| (f32::from(f.u8()) - 128.0) / 128.0),
            }
        });
        left -= count;
    }
    rows.finish(".splat".into(), None)
        .map_err(|message| Error::invalid(path, message))
}

/// Writes a splat.
pub(super) fn write(splat: &WritableSplat<'_>, out: &mut impl Write) -> std::io::Result<()> {
    let byte = |v: f32| v.round().clamp(0.0, 255.0) as u8;
    splat.write_each(out, |g, bytes| {
        let scales = g.log_scales.map(f32::exp);
        let numbers = g.position.map(|v| v as f32).into_iter().chain(scales);
        bytes.extend(numbers.flat_map(f32::to_le_bytes));
        bytes.extend(g.sh[0].map(|dc| byte(255.0 * color_of_dc(dc))));
        bytes.push(byte(255.0 * g.opacity));
        bytes.extend(g.rotation.map(|v| byte(128.0 * v + 128.0)));
    })
}
