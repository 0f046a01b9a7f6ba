//! Splats in SPZ (Niantic's format, versions 1 to 4): attribute after attribute in few bits, compressed.
//!
//! Versions 1 to 3 are one gzip stream; version 4 has its header in the clear and a zstd frame an attribute.

use std::io::{Read, Write};
use std::path::Path;

use flate2::Compression;
use flate2::write::GzEncoder;

use super::decode;
use super::packed::{Fields, logit, with_largest, without_largest};
use super::read::{SPZ as MAGIC, read_exactly};
use super::rows::{Builder, Finished, SplatKind, StoredRow, check_count};
use super::written::WritableSplat;
use crate::error::{Error, Result};
use crate::sh::coefficient_count;
use crate::surfels::UpAxis;

/// First bytes of a gzip stream.
pub(super) const GZIP: &[u8; 2] = &[0x1f, 0x8b];

/// The highest degree that the format knows.
pub(super) const MAX_DEGREE: usize = 4;

const IS_ANTIALIASED: u8 = 1;
const HAS_EXTENSIONS: u8 = 2;

/// Type of the extension that says which way the axes point.
const COORDINATES: u32 = 0xadbe_0003;

/// No file needs more room for its extensions.
const MAX_EXTENSION_BYTES: u64 = 1 << 20;

/// A colour's byte is `0.5 + COLOR_SCALE * f_dc`.
const COLOR_SCALE: f32 = 0.15;

/// The logarithm of a scale is `byte / 16 - 10`.
const LOG_STEPS: f32 = 16.0;
const LEAST_LOG: f32 = -10.0;

/// Magnitude of a rotation's component in 9 bits.
const MOST_MAGNITUDE: f32 = 511.0;

struct SpzHeader {
    version: u32,
    points: u32,
    degree: usize,
    fractional_bits: u8,
    flags: u8,
    /// Version 4: how many frames there are, and where their lengths begin.
    streams: u8,
    lengths_at: u64,
}

impl SpzHeader {
    fn parse(bytes: &[u8; 16]) -> std::result::Result<Self, String> {
        let mut fields = Fields(bytes);
        let magic = fields.u32().to_le_bytes();
        if magic != MAGIC {
            return Err("not an SPZ splat: its content does not begin with \"NGSP\"".into());
        }
        let (version, points) = (fields.u32(), fields.u32());
        let [degree, fractional_bits, flags, streams] = fields.each(Fields::u8);
        if !(1..=4).contains(&version) {
            return Err(format!(
                "is SPZ of version {version}; versions 1 to 4 are read"
            ));
        }
        if usize::from(degree) > MAX_DEGREE {
            return Err(format!("claims SH of degree {degree}; SPZ has at most 4"));
        }
        if fractional_bits > 23 {
            return Err(format!(
                "claims positions with {fractional_bits} bits behind the point, of 24"
            ));
        }
        Ok(Self {
            version,
            points,
            degree: degree.into(),
            fractional_bits,
            flags,
            streams,
            lengths_at: 0,
        })
    }

    /// Bytes a point of positions, opacities, colours, scales, rotations and SH.
    fn sizes(&self) -> [usize; 6] {
        let position = if self.version == 1 { 6 } else { 9 };
        let rotation = if self.version < 3 { 3 } else { 4 };
        let sh = 3 * (coefficient_count(self.degree) - 1);
        [position, 1, 3, 3, rotation, sh]
    }

    fn has(&self, flag: u8) -> bool {
        self.flags & flag != 0
    }
}

/// Reads a splat from a file of so many bytes.
pub(super) fn read(
    path: &Path,
    reader: &mut impl std::io::BufRead,
    file_bytes: u64,
) -> Result<Finished> {
    let invalid = |message: String| Error::invalid(path, message);
    let start = reader.fill_buf().map_err(Error::io(path))?;
    let (header, body, extensions) = if start.starts_with(MAGIC) {
        read_frames(reader, file_bytes).map_err(invalid)?
    } else {
        read_gzip(reader, file_bytes).map_err(invalid)?
    };
    let n = header.points as usize;
    let mut starts = [0; 7];
    for (i, size) in header.sizes().into_iter().enumerate() {
        starts[i + 1] = starts[i] + n * size;
    }
    let attribute = |i: usize, point: usize| {
        let size = header.sizes()[i];
        Fields(&body[starts[i] + point * size..][..size])
    };
    let mut rows = Builder::new(SplatKind::Gaussians3d, header.degree, n).map_err(invalid)?;
    if header.has(IS_ANTIALIASED) {
        rows.set_antialiased();
    }
    let position_step = (-f64::from(header.fractional_bits)).exp2();
    rows.set_position_step(position_step);
    rows.push_rows(n, |i, _, sh| {
        let mut color = attribute(2, i);
        sh[0] = color.each(|c| (f32::from(c.u8()) / 255.0 - 0.5) / COLOR_SCALE);
        let mut higher = attribute(5, i);
        for f in &mut sh[1..] {
            *f = higher.each(|h| (f32::from(h.u8()) - 128.0) / 128.0);
        }
        let mut position = attribute(0, i);
        StoredRow {
            position: if header.version == 1 {
                position.each(Fields::f16).map(f64::from)
            } else {
                position.each(|p| position_step * f64::from(fixed(p.each(Fields::u8))))
            },
            rotation: rotation(attribute(4, i), header.version),
            log_scales: attribute(3, i).each(|s| f32::from(s.u8()) / LOG_STEPS + LEAST_LOG),
            logit: logit(f32::from(attribute(1, i).u8()) / 255.0),
        }
    });
    let up = up_of(&extensions);
    rows.finish(format!("SPZ, version {}", header.version), up)
        .map_err(invalid)
}

/// A signed number in 24 bits.
fn fixed([low, middle, high]: [u8; 3]) -> i32 {
    i32::from_le_bytes([0, low, middle, high]) >> 8
}

/// Quaternion w, x, y, z.
fn rotation(mut fields: Fields<'_>, version: u32) -> [f32; 4] {
    if version < 3 {
        let [x, y, z] = fields.each(|f| f32::from(f.u8()) / 127.5 - 1.0);
        let w = (1.0 - x * x - y * y - z * z).max(0.0).sqrt();
        return [w, x, y, z];
    }
    let bits = fields.u32();
    let component = |shift: u32| {
        let code = bits >> shift;
        let sign = if code & 0x200 == 0 { 1.0 } else { -1.0 };
        sign * (code & 0x1ff) as f32 / MOST_MAGNITUDE * std::f32::consts::FRAC_1_SQRT_2
    };
    let others = [component(20), component(10), component(0)];
    let [x, y, z, w] = with_largest((bits >> 30) as usize, others);
    [w, x, y, z]
}

type Contents = (SpzHeader, Vec<u8>, Vec<u8>);

/// Versions 1 to 3: everything in one gzip stream.
fn read_gzip(
    reader: &mut impl std::io::BufRead,
    file_bytes: u64,
) -> std::result::Result<Contents, String> {
    let broken = |e: std::io::Error| format!("not an SPZ splat, or broken: {e}");
    let mut gzip = decode::gunzip(reader);
    let mut head = [0; 16];
    gzip.read_exact(&mut head).map_err(broken)?;
    let header = SpzHeader::parse(&head)?;
    check_count(u64::from(header.points), file_bytes)?;
    let expected = header.points as u64 * header.sizes().iter().sum::<usize>() as u64;
    let body = read_exactly(&mut gzip, expected).map_err(broken)?;
    let mut extensions = Vec::new();
    if header.has(HAS_EXTENSIONS) {
        let rest = gzip.take(MAX_EXTENSION_BYTES).read_to_end(&mut extensions);
        rest.map_err(broken)?;
    } else {
        // To the end, where the checksum is.
        std::io::copy(&mut gzip.take(MAX_EXTENSION_BYTES), &mut std::io::sink()).map_err(broken)?;
    }
    Ok((header, body, extensions))
}

/// Version 4: a zstd frame an attribute.
fn read_frames(
    reader: &mut impl std::io::BufRead,
    file_bytes: u64,
) -> std::result::Result<Contents, String> {
    let broken = |e: std::io::Error| format!("the SPZ splat is broken: {e}");
    let mut head = [0; 32];
    reader.read_exact(&mut head).map_err(broken)?;
    let (first, rest) = head.split_first_chunk().expect("32 bytes");
    let mut header = SpzHeader::parse(first)?;
    if header.version != 4 {
        return Err(format!(
            "is SPZ of version {} without its gzip stream",
            header.version
        ));
    }
    header.lengths_at = Fields(rest).u32().into();
    check_count(u64::from(header.points), file_bytes)?;
    let before = (header.lengths_at.checked_sub(32)).filter(|n| *n <= MAX_EXTENSION_BYTES);
    let before = before.ok_or("its table of contents is out of place")?;
    let extensions = read_exactly(reader, before).map_err(broken)?;
    let n = u64::from(header.points);
    let sizes = header.sizes().into_iter().filter(|s| *s > 0);
    let expected: Vec<u64> = sizes.map(|s| n * s as u64).collect();
    if usize::from(header.streams) != expected.len() {
        return Err(format!(
            "has {} streams where {} are expected",
            header.streams,
            expected.len()
        ));
    }
    let table = read_exactly(reader, 16 * expected.len() as u64).map_err(broken)?;
    let mut body = Vec::new();
    for (entry, expected) in table.chunks_exact(16).zip(expected) {
        let [packed, plain] = Fields(entry).each(|f| {
            let [low, high] = f.each(Fields::u32);
            u64::from(high) << 32 | u64::from(low)
        });
        if plain != expected {
            return Err(format!(
                "a stream claims {plain} bytes where {expected} are expected"
            ));
        }
        let before = body.len() as u64;
        let frame = decode::unzstd(reader.take(packed));
        let frame = frame.map_err(|e| format!("the SPZ splat is broken: {e}"))?;
        let mut frame = frame.take(expected);
        frame.read_to_end(&mut body).map_err(broken)?;
        if body.len() as u64 - before != expected {
            return Err(format!(
                "ends after {} of {expected} bytes of a stream",
                body.len() as u64 - before
            ));
        }
        // What is left of the frame is its end.
        let mut rest = frame.into_inner().into_inner().into_inner();
        std::io::copy(&mut rest, &mut std::io::sink()).map_err(broken)?;
    }
    Ok((header, body, extensions))
}

/// Up axis, where an extension has it.
fn up_of(mut extensions: &[u8]) -> Option<UpAxis> {
    while extensions.len() >= 8 {
        let mut fields = Fields(extensions);
        let [kind, length] = fields.each(Fields::u32);
        let payload = fields.0.get(..length as usize)?;
        if kind == COORDINATES && length == 4 {
            // 1 to 8 are left or right, down or up, back or front; in 9 to 16 y and z have changed places.
            return match Fields(payload).u32() {
                system @ 1..=8 if (system - 1) & 2 == 0 => Some(UpAxis::MinusY),
                1..=8 => Some(UpAxis::PlusY),
                system @ 9..=16 if (system - 9) & 2 == 0 => Some(UpAxis::MinusZ),
                9..=16 => Some(UpAxis::PlusZ),
                _ => None,
            };
        }
        extensions = &fields.0[length as usize..];
    }
    None
}

/// Writes a splat as version 3, which all readers know.
pub(super) fn write(splat: &WritableSplat<'_>, out: &mut impl Write) -> std::io::Result<()> {
    let mut gzip = GzEncoder::new(out, Compression::default());
    let degree = splat.degree.min(MAX_DEGREE);
    let fractional_bits = fractional_bits(splat);
    let flags = if splat.is_antialiased {
        IS_ANTIALIASED
    } else {
        0
    };
    gzip.write_all(MAGIC)?;
    gzip.write_all(&3u32.to_le_bytes())?;
    gzip.write_all(&(splat.len() as u32).to_le_bytes())?;
    gzip.write_all(&[degree as u8, fractional_bits, flags, 0])?;
    let byte = |v: f32| v.round().clamp(0.0, 255.0) as u8;
    let steps = f64::from(fractional_bits).exp2();
    let position = |v: f64| (v * steps).round().clamp(-8_388_608.0, 8_388_607.0) as i32;
    splat.write_each(&mut gzip, |g, bytes| {
        for v in g.position {
            bytes.extend_from_slice(&position(v).to_le_bytes()[..3]);
        }
    })?;
    splat.write_each(&mut gzip, |g, bytes| bytes.push(byte(255.0 * g.opacity)))?;
    splat.write_each(&mut gzip, |g, bytes| {
        bytes.extend(g.sh[0].map(|dc| byte(255.0 * (COLOR_SCALE * dc + 0.5))));
    })?;
    splat.write_each(&mut gzip, |g, bytes| {
        bytes.extend(g.log_scales.map(|log| byte((log - LEAST_LOG) * LOG_STEPS)));
    })?;
    splat.write_each(&mut gzip, |g, bytes| {
        let [w, x, y, z] = g.rotation;
        let (largest, others) = without_largest([x, y, z, w]);
        let code = others.iter().fold(largest as u32, |code, v| {
            let magnitude = (v.abs() * std::f32::consts::SQRT_2 * MOST_MAGNITUDE).round() as u32;
            code << 10 | u32::from(*v < 0.0) << 9 | magnitude.min(511)
        });
        bytes.extend(code.to_le_bytes());
    })?;
    splat.write_each(&mut gzip, |g, bytes| {
        let higher = &g.sh[1..coefficient_count(degree)];
        bytes.extend(higher.iter().flatten().map(|v| byte(128.0 * v + 128.0)));
    })?;
    gzip.finish()?;
    Ok(())
}

/// Quantum of a splat's positions.
pub(super) fn position_step(splat: &WritableSplat<'_>) -> f64 {
    (-f64::from(fractional_bits(splat))).exp2()
}

/// As many as leave room for the farthest position.
fn fractional_bits(splat: &WritableSplat<'_>) -> u8 {
    let farthest = splat.farthest().max(1e-30);
    (22.0 - farthest.log2().floor()).clamp(0.0, 23.0) as u8
}

#[cfg(test)]
pub(super) mod tests;
