//! Splats in the compressed PLY of PlayCanvas: Gaussians in chunks of 256, in few bits within the range of their chunk.

use std::io::{BufRead, Seek, SeekFrom, Write};
use std::path::Path;

use super::comments::{says_antialiased, up_of, write_comments};
use super::header::{Element, Format, Header, ScalarType};

use crate::error::{Error, Result};
use crate::files::packed::{
    Fields, color_of_dc, component, component_share, dc_of_color, logit, share, share_code,
    with_largest, without_largest,
};
use crate::files::read::read_exactly;
use crate::files::rows::{Builder, Finished, SplatKind, StoredRow};
use crate::files::written::{Gaussian, WritableSplat};
use crate::sh::coefficient_count;

/// The highest degree that the format knows.
pub(in crate::files) const MAX_DEGREE: usize = 3;

/// Gaussians that share ranges.
pub(in crate::files) const CHUNK: usize = 256;

/// Bits of x, y and z, of positions and of scales.
const BITS: [u32; 3] = [11, 10, 11];

/// An SH coefficient's byte spans this, around 0.
const SH_SPAN: f32 = 8.0;

/// Logarithms of scales beyond this are held to it.
const MAX_LOG: f32 = 20.0;

/// Names of the bounds of a chunk's values, least and greatest.
const RANGES: [[&str; 3]; 3] = [
    ["x", "y", "z"],
    ["scale_x", "scale_y", "scale_z"],
    ["r", "g", "b"],
];

/// Bounds of a chunk's values: positions, logarithms of scales, colours. `[3][x y z]` least and greatest
type Chunk = [[[f32; 2]; 3]; 3];

/// Reads a splat whose header is that, from a file of so many bytes.
pub(super) fn read(
    path: &Path,
    reader: &mut (impl BufRead + Seek),
    file_bytes: u64,
    header: &Header,
) -> Result<Finished> {
    let invalid = |message: &str| Error::invalid(path, format!("a compressed PLY that {message}"));
    if header.format != Format::LittleEndian {
        return Err(invalid("is not binary_little_endian"));
    }
    let packed = ["position", "rotation", "scale", "color"].map(|name| format!("packed_{name}"));
    let columns = packed.map(|name| header.find(&name));
    let columns = columns.map(|c| c.map(|c| &header.properties[c]));
    let [Some(position), Some(rotation), Some(scale), Some(color)] = columns else {
        return Err(invalid(
            "lacks packed_rotation, packed_scale or packed_color",
        ));
    };
    let columns = [position, rotation, scale, color];
    if columns.iter().any(|c| c.scalar != ScalarType::U32) {
        return Err(invalid("has packed values of another type than uint"));
    }
    let columns = columns.map(|c| c.offset);
    let [chunk_element] = &header.before[..] else {
        return Err(invalid(
            "has not its chunks, and nothing else, before the vertices",
        ));
    };
    let n = header.vertices;
    if chunk_element.name != "chunk" || chunk_element.count < n.div_ceil(CHUNK as u64) {
        return Err(invalid("has too few chunks"));
    }
    let higher = header.after.iter().find(|e| e.name == "sh");
    let degree = match higher {
        None => 0,
        Some(element) => {
            degree_of(element, n).ok_or_else(|| invalid("has SH of no known degree"))?
        }
    };
    if n == 0 {
        return Err(invalid("holds no vertices"));
    }
    let bytes = (n.checked_mul(header.stride as u64)).filter(|b| *b <= file_bytes);
    let Some(bytes) = bytes else {
        return Err(invalid("claims more vertices than it has room for"));
    };
    let mut rows =
        Builder::new(SplatKind::Gaussians3d, degree, n as usize).map_err(|m| invalid(&m))?;
    let read = |reader: &mut _, count: u64| {
        read_exactly(reader, count).map_err(|e| invalid(&format!("is truncated: {e}")))
    };
    reader
        .seek(SeekFrom::Start(header.bytes))
        .map_err(Error::io(path))?;
    let chunks = read(reader, header.skip)?;
    let chunks: Option<Vec<Chunk>> = (chunks.chunks_exact(chunk_element.stride.max(1)))
        .map(|row| parse_chunk(chunk_element, row))
        .collect();
    let chunks = chunks.ok_or_else(|| invalid("has chunks without a range of theirs"))?;
    let vertices = read(reader, bytes)?;
    let sh_row = higher.map_or(0, |e| e.stride);
    let coefficients = match higher {
        Some(element) => {
            // What lies between is stepped over.
            let between = header.after.iter().take_while(|e| e.name != element.name);
            for element in between {
                let bytes = element.count.saturating_mul(element.stride as u64);
                read(reader, bytes)?;
            }
            read(reader, n * sh_row as u64)?
        }
        None => Vec::new(),
    };
    if header.comments.iter().any(|c| says_antialiased(c)) {
        rows.set_antialiased();
    }
    let k = coefficient_count(degree);
    rows.push_rows(n as usize, |i, _, sh| {
        let row = &vertices[i * header.stride..][..header.stride];
        let [position, rotation, scale, color] = columns.map(|at| Fields(&row[at..]).u32());
        let [positions, scales, colors] = &chunks[i / CHUNK];
        let [red, green, blue, opacity] = color.to_be_bytes().map(|b| share(b.into(), 8));
        sh[0] = std::array::from_fn(|c| dc_of_color(between([red, green, blue][c], colors[c])));
        // Channel by channel, as in a PLY of floats.
        for (j, f) in sh[1..].iter_mut().enumerate() {
            *f = std::array::from_fn(|c| coefficient(coefficients[i * sh_row + c * (k - 1) + j]));
        }
        let component = |shift: u32| component(share(rotation >> shift & 0x3ff, 10));
        StoredRow {
            position: unpack(position, positions).map(f64::from),
            rotation: with_largest(
                (rotation >> 30) as usize,
                [component(20), component(10), component(0)],
            ),
            log_scales: unpack(scale, scales),
            logit: logit(opacity),
        }
    });
    let finished = rows.finish("compressed PLY".into(), up_of(header));
    let (cloud, mut report, surfel_of_row) = finished.map_err(|m| Error::invalid(path, m))?;
    report.comments = header.comments.clone();
    Ok((cloud, report, surfel_of_row))
}

/// The degree of the SH that an element has a byte a coefficient of, a row a vertex.
fn degree_of(element: &Element, vertices: u64) -> Option<usize> {
    let properties = &element.properties;
    let in_order = (properties.iter().enumerate())
        .all(|(i, p)| p.name == format!("f_rest_{i}") && p.scalar == ScalarType::U8);
    let degree = (1..=MAX_DEGREE).find(|l| 3 * (coefficient_count(*l) - 1) == properties.len());
    degree.filter(|_| in_order && element.count >= vertices)
}

/// The ranges of a chunk; older files have none for colours, which are whole then.
fn parse_chunk(element: &Element, row: &[u8]) -> Option<Chunk> {
    let value = |name: String| {
        let property = &element.properties[element.find(&name)?];
        (property.scalar == ScalarType::F32).then(|| Fields(&row[property.offset..]).f32())
    };
    let mut chunk = [[[0.0, 1.0]; 3]; 3];
    for (ranges, names) in chunk.iter_mut().zip(RANGES) {
        let is_color = names[0] == "r";
        for (range, name) in ranges.iter_mut().zip(names) {
            match (value(format!("min_{name}")), value(format!("max_{name}"))) {
                (Some(least), Some(most)) => *range = [least, most],
                (None, None) if is_color => {}
                _ => return None,
            }
        }
    }
    Some(chunk)
}

fn between(share: f32, [least, most]: [f32; 2]) -> f32 {
    least * (1.0 - share) + most * share
}

/// Three numbers of 11, 10 and 11 bits.
fn unpack(code: u32, ranges: &[[f32; 2]; 3]) -> [f32; 3] {
    let codes = [code >> 21, code >> 11 & 0x3ff, code & 0x7ff];
    std::array::from_fn(|a| between(share(codes[a], BITS[a]), ranges[a]))
}

fn pack(values: [f32; 3], ranges: &[[f32; 2]; 3]) -> u32 {
    let [x, y, z] = std::array::from_fn(|a| share_code(share_of(values[a], ranges[a]), BITS[a]));
    x << 21 | y << 11 | z
}

/// Where a value lies in a range.
fn share_of(value: f32, [least, most]: [f32; 2]) -> f32 {
    if most > least {
        (value - least) / (most - least)
    } else {
        0.0
    }
}

/// An SH coefficient from its byte.
fn coefficient(byte: u8) -> f32 {
    let share = match byte {
        0 => 0.0,
        255 => 1.0,
        b => (f32::from(b) + 0.5) / 256.0,
    };
    (share - 0.5) * SH_SPAN
}

fn coefficient_byte(value: f32) -> u8 {
    ((value / SH_SPAN + 0.5) * 256.0).clamp(0.0, 255.0) as u8
}

/// Values of a Gaussian that are packed within the bounds of its chunk.
fn packed_values(g: &Gaussian<'_>) -> [[f32; 3]; 3] {
    let logs = g.log_scales.map(|l| l.clamp(-MAX_LOG, MAX_LOG));
    [g.position.map(|v| v as f32), logs, g.sh[0].map(color_of_dc)]
}

/// Writes a splat.
pub(in crate::files) fn write(
    splat: &WritableSplat<'_>,
    out: &mut impl Write,
) -> std::io::Result<()> {
    let (n, degree) = (splat.len(), splat.degree.min(MAX_DEGREE));
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    write_comments(splat, out)?;
    writeln!(out, "element chunk {}", n.div_ceil(CHUNK))?;
    for names in RANGES {
        for end in ["min", "max"] {
            for name in names {
                writeln!(out, "property float {end}_{name}")?;
            }
        }
    }
    writeln!(out, "element vertex {n}")?;
    for name in ["position", "rotation", "scale", "color"] {
        writeln!(out, "property uint packed_{name}")?;
    }
    let higher = coefficient_count(degree) - 1;
    if degree > 0 {
        writeln!(out, "element sh {n}")?;
        for i in 0..3 * higher {
            writeln!(out, "property uchar f_rest_{i}")?;
        }
    }
    writeln!(out, "end_header")?;
    let chunks: Vec<Chunk> = (0..n)
        .step_by(CHUNK)
        .map(|first| chunk_of((first..(first + CHUNK).min(n)).map(|i| splat.gaussian(i))))
        .collect();
    for ranges in chunks.iter().flatten() {
        for end in 0..2 {
            for range in ranges {
                out.write_all(&range[end].to_le_bytes())?;
            }
        }
    }
    for (i, chunk) in (0..n).map(|i| (i, &chunks[i / CHUNK])) {
        let g = splat.gaussian(i);
        let [position, logs, color] = packed_values(&g);
        let (largest, others) = without_largest(g.rotation);
        let rotation = others.iter().fold(largest as u32, |code, v| {
            code << 10 | share_code(component_share(*v), 10)
        });
        let shares = std::array::from_fn(|c| share_of(color[c], chunk[2][c]));
        let [red, green, blue] = shares.map(|s: f32| share_code(s, 8));
        let color = red << 24 | green << 16 | blue << 8 | share_code(g.opacity, 8);
        for code in [
            pack(position, &chunk[0]),
            rotation,
            pack(logs, &chunk[1]),
            color,
        ] {
            out.write_all(&code.to_le_bytes())?;
        }
    }
    splat.write_each(out, |g, bytes| {
        for c in 0..3 {
            bytes.extend(g.sh[1..=higher].iter().map(|f| coefficient_byte(f[c])));
        }
    })
}

/// Bounds of the values of some Gaussians.
fn chunk_of<'a>(gaussians: impl Iterator<Item = Gaussian<'a>>) -> Chunk {
    let mut chunk = [[[f32::INFINITY, f32::NEG_INFINITY]; 3]; 3];
    for gaussian in gaussians {
        for (ranges, values) in chunk.iter_mut().zip(packed_values(&gaussian)) {
            for (range, value) in ranges.iter_mut().zip(values) {
                *range = [range[0].min(value), range[1].max(value)];
            }
        }
    }
    chunk
}

#[cfg(test)]
mod tests;
