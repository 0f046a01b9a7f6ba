//! Splats in `.ksplat` (GaussianSplats3D): sections of Gaussians, from level 1 on relative to the middles of buckets and in half floats.

use std::io::BufRead;
use std::path::Path;

use super::packed::{Fields, dc_of_color, logit};
use super::read::read_exactly;
use super::rows::{Builder, Finished, SplatKind, StoredRow};
use crate::error::{Error, Result};
use crate::sh::coefficient_count;

const HEADER: usize = 4096;
const SECTION_HEADER: usize = 1024;

/// Range of SH bytes where the header has none.
const SH_RANGE: [f32; 2] = [-1.5, 1.5];

/// Range of the integers that a position is within its bucket, where the header has none.
const POSITION_RANGE: u32 = 32767;

/// No file has more sections.
const MAX_SECTIONS: u32 = 1 << 16;

/// True for a file that begins like a version that is read.
pub(super) fn begins_as_one(start: &[u8]) -> bool {
    let Some(start) = start.get(..24) else {
        return false;
    };
    let mut fields = Fields(start);
    let [major, minor, zero, also_zero] = fields.each(Fields::u8);
    let [max_sections, sections, max_splats, splats] = fields.each(Fields::u32);
    let level = fields.u16();
    [major, zero, also_zero] == [0; 3]
        && minor >= 1
        && (1..=max_sections).contains(&sections)
        && splats <= max_splats
        && level <= 2
}

struct Section {
    splats: usize,
    /// Room for so many.
    room: usize,
    bucket_size: usize,
    full_buckets: usize,
    degree: usize,
    /// Step of a position's integer, and the integer in the middle.
    step: f32,
    middle: f32,
    /// Middle of each bucket.
    buckets: Vec<[f32; 3]>,
    /// Numbers of splats in the buckets that are not full.
    partial: Vec<u32>,
}

impl Section {
    /// Checks a section's header.
    fn parse(bytes: &[u8], level: u16) -> std::result::Result<(Self, [usize; 2]), String> {
        let mut fields = Fields(bytes);
        let [splats, room, bucket_size, bucket_count] = fields.each(Fields::u32);
        let block_size = fields.f32();
        let [bucket_bytes, _] = fields.each(Fields::u16);
        let [range, _, full, partial] = fields.each(Fields::u32);
        let degree = usize::from(fields.u16());
        if degree > 2 || splats > room {
            return Err("a section's header is broken".into());
        }
        let bucketed = level > 0;
        if bucketed
            && (bucket_bytes != 12
                || bucket_size == 0
                || full.checked_add(partial) != Some(bucket_count))
        {
            return Err("a section's buckets do not fit its header".into());
        }
        let range = if range == 0 { POSITION_RANGE } else { range } as f32;
        let section = Self {
            splats: splats as usize,
            room: room as usize,
            bucket_size: bucket_size as usize,
            full_buckets: full as usize,
            degree,
            step: block_size / 2.0 / range,
            middle: range,
            buckets: Vec::new(),
            partial: Vec::new(),
        };
        let counts = if bucketed {
            [partial, bucket_count]
        } else {
            [0; 2]
        };
        Ok((section, counts.map(|c| c as usize)))
    }

    /// Bucket of each splat.
    fn bucket_of_each(&self) -> std::result::Result<Vec<u32>, String> {
        let full =
            (0..self.full_buckets as u32).flat_map(|b| std::iter::repeat_n(b, self.bucket_size));
        let partial = (self.full_buckets as u32..).zip(&self.partial);
        let partial = partial.flat_map(|(b, count)| std::iter::repeat_n(b, *count as usize));
        let each: Vec<u32> = full.chain(partial).take(self.splats).collect();
        if each.len() < self.splats {
            return Err("a section's buckets hold fewer splats than it claims".into());
        }
        Ok(each)
    }
}

/// Reads a splat from a file of so many bytes.
pub(super) fn read(path: &Path, reader: &mut impl BufRead, file_bytes: u64) -> Result<Finished> {
    read_sections(reader, file_bytes).map_err(|message| Error::invalid(path, message))
}

fn read_sections(
    reader: &mut impl BufRead,
    file_bytes: u64,
) -> std::result::Result<Finished, String> {
    let broken = |e: std::io::Error| format!("the .ksplat is broken: {e}");
    let header = read_exactly(reader, HEADER as u64).map_err(broken)?;
    let mut fields = Fields(&header[4..]);
    let [max_sections, section_count, _, _] = fields.each(Fields::u32);
    let level = fields.u16();
    let mut fields = Fields(&header[36..]);
    let mut range: [f32; 2] = fields.each(Fields::f32);
    if range == [0.0; 2] {
        range = SH_RANGE;
    }
    if max_sections > MAX_SECTIONS || level > 2 || section_count > max_sections {
        return Err("not a .ksplat of a version that is read".into());
    }
    let bytes = u64::from(max_sections) * SECTION_HEADER as u64;
    let headers = read_exactly(reader, bytes).map_err(broken)?;
    let headers = headers
        .chunks_exact(SECTION_HEADER)
        .take(section_count as usize);
    let parsed: Vec<(Section, [usize; 2])> = headers
        .map(|bytes| Section::parse(bytes, level))
        .collect::<std::result::Result<_, _>>()?;
    let total: usize = parsed.iter().map(|(s, _)| s.splats).sum();
    // The least that a splat takes.
    if total == 0 || total as u64 > file_bytes / 24 {
        return Err(format!(
            "claims {total} splats in a file of {file_bytes} bytes: it is truncated, or its count is wrong"
        ));
    }
    let degree = parsed.iter().map(|(s, _)| s.degree).max().unwrap_or(0);
    let mut rows = Builder::new(SplatKind::Gaussians3d, degree, total)?;
    for (mut section, [partial, buckets]) in parsed {
        let read = read_exactly(reader, 4 * partial as u64).map_err(broken)?;
        section.partial = read.chunks_exact(4).map(|b| Fields(b).u32()).collect();
        let read = read_exactly(reader, 12 * buckets as u64).map_err(broken)?;
        section.buckets = read
            .chunks_exact(12)
            .map(|b| Fields(b).each(Fields::f32))
            .collect();
        push_section(reader, &section, level, range, &mut rows)?;
    }
    rows.finish(format!(".ksplat, compression level {level}"), None)
}

fn push_section(
    reader: &mut impl BufRead,
    section: &Section,
    level: u16,
    [least, most]: [f32; 2],
    rows: &mut Builder,
) -> std::result::Result<(), String> {
    let higher = 3 * (coefficient_count(section.degree) - 1);
    let row_bytes = match level {
        0 => 44 + 4 * higher,
        1 => 24 + 2 * higher,
        _ => 24 + higher,
    };
    let bytes = row_bytes as u64 * section.room as u64;
    let bytes = read_exactly(reader, bytes).map_err(|e| format!("the .ksplat is broken: {e}"))?;
    let bucket_of = if level > 0 {
        section.bucket_of_each()?
    } else {
        Vec::new()
    };
    rows.push_rows(section.splats, |row, _, sh| {
        let mut fields = Fields(&bytes[row * row_bytes..][..row_bytes]);
        let position = if level == 0 {
            fields.each(Fields::f32)
        } else {
            let codes: [u16; 3] = fields.each(Fields::u16);
            let bucket = section.buckets[bucket_of[row] as usize];
            std::array::from_fn(|a| {
                (f32::from(codes[a]) - section.middle) * section.step + bucket[a]
            })
        };
        let number = |f: &mut Fields<'_>| if level == 0 { f.f32() } else { f.f16() };
        let scales: [f32; 3] = fields.each(number);
        let rotation = fields.each(number);
        sh.fill([0.0; 3]);
        sh[0] = fields.each(|f| dc_of_color(f32::from(f.u8()) / 255.0));
        let logit = logit(f32::from(fields.u8()) / 255.0);
        // Degree by degree all of red, then of green, then of blue.
        for l in 1..=section.degree {
            for c in 0..3 {
                for f in &mut sh[coefficient_count(l - 1)..coefficient_count(l)] {
                    f[c] = match level {
                        2 => least + (most - least) * f32::from(fields.u8()) / 255.0,
                        _ => number(&mut fields),
                    };
                }
            }
        }
        StoredRow {
            position: position.map(f64::from),
            rotation,
            log_scales: scales.map(f32::ln),
            logit,
        }
    });
    Ok(())
}

#[cfg(test)]
pub(super) mod tests;
