//! Writer of a splat's own PLY with other colour: every property, comment and trailing element that the file had, in its order.

use std::io::{BufRead, Read, Seek, SeekFrom, Write};

use super::colors::ColorOf;
use super::header::{Format, Header};
use crate::error::{Error, Result};
use crate::files::packed::color_of_dc;
use crate::files::rows::{NOT_WRITTEN, SplatReport};

/// For each property of a row the index of the colour that replaces it.
pub(in crate::files) struct ColorColumns<'a> {
    header: &'a Header,
    report: &'a SplatReport,
    /// The surfel that each row is, if it is written.
    surfel_of_row: &'a [u32],
    /// Number of rows.
    written: usize,
    /// `[n][K][3]`
    stored: &'a [[f32; 3]],
    coefficients: usize,
    /// The colour that each property is, if it is any.
    replaced: Vec<Option<ColorOf>>,
}

impl<'a> ColorColumns<'a> {
    pub fn new(
        header: &'a Header,
        report: &'a SplatReport,
        surfel_of_row: &'a [u32],
        stored: &'a [[f32; 3]],
    ) -> Result<Self> {
        let properties = &header.properties;
        let rest = properties
            .iter()
            .filter(|p| p.name.starts_with("f_rest_"))
            .count();
        let coefficients = rest / 3 + 1;
        let written = surfel_of_row.iter().filter(|s| **s != NOT_WRITTEN).count();
        if stored.len() != written * coefficients {
            return Err(Error::Mismatch(format!(
                "{} colour coefficients do not fit {written} surfels of {coefficients}",
                stored.len()
            )));
        }
        let has_sh = header.find("f_dc_0").is_some();
        let color_of = |name: &str| ColorOf::of_name(name, coefficients, has_sh);
        let replaced = properties.iter().map(|p| color_of(&p.name)).collect();
        Ok(Self {
            header,
            report,
            surfel_of_row,
            written,
            stored,
            coefficients,
            replaced,
        })
    }

    /// Writes the file that `reader` is at the start of.
    pub fn write(
        &self,
        reader: &mut (impl BufRead + Seek),
        out: &mut impl Write,
    ) -> std::io::Result<()> {
        let ascii = self.header.format == Format::Ascii;
        let prefix = self.header.bytes + if ascii { 0 } else { self.header.skip };
        let mut head = vec![0; self.header.bytes as usize];
        reader.read_exact(&mut head)?;
        if self.written < self.report.vertices {
            out.write_all(&counting(&head, self.written))?;
        } else {
            out.write_all(&head)?;
        }
        std::io::copy(&mut reader.take(prefix - self.header.bytes), out)?;
        if ascii {
            self.write_ascii(reader, out)?;
        } else {
            reader.seek(SeekFrom::Start(prefix))?;
            self.write_binary(reader, out)?;
        }
        std::io::copy(reader, out)?;
        Ok(())
    }

    /// The surfel that each row of the file is, if it is written.
    fn surfels(&self) -> impl Iterator<Item = Option<usize>> {
        let rows = self.surfel_of_row.iter();
        rows.map(|surfel| (*surfel != NOT_WRITTEN).then_some(*surfel as usize))
    }

    /// The value that replaces property `column` of a row, which is that surfel, if any does; `old` is what was there.
    fn value(
        &self,
        (row, surfel): (usize, usize),
        column: usize,
        old: impl FnOnce() -> f32,
    ) -> Option<f32> {
        let property = &self.header.properties[column];
        let stored = |coefficient: usize| &self.stored[surfel * self.coefficients + coefficient];
        match self.replaced[column] {
            Some(ColorOf::Sh(coefficient, channel)) => return Some(stored(coefficient)[channel]),
            Some(ColorOf::Shown(channel)) => {
                let shown = color_of_dc(stored(0)[channel]).clamp(0.0, 1.0);
                return Some(property.scalar.most() * shown);
            }
            None => {}
        }
        if property.scalar.is_float() && self.report.skipped_work.binary_search(&row).is_ok() {
            if property.name == "opacity" {
                return Some(-30.0);
            }
            let old = old();
            // What was left out for being out of range becomes small too.
            return (!old.is_finite() || old.abs() > 1e6).then_some(0.0);
        }
        None
    }

    fn write_binary(&self, reader: &mut impl Read, out: &mut impl Write) -> std::io::Result<()> {
        let header = &self.header;
        let big_endian = header.big_endian();
        let mut row_bytes = vec![0u8; header.stride];
        for (row, surfel) in self.surfels().enumerate() {
            reader.read_exact(&mut row_bytes)?;
            let Some(surfel) = surfel else {
                continue;
            };
            for (column, p) in header.properties.iter().enumerate() {
                let at = &mut row_bytes[p.offset..];
                let old = || p.scalar.read(at, big_endian);
                if let Some(value) = self.value((row, surfel), column, old) {
                    p.scalar.write(value, at, big_endian);
                }
            }
            out.write_all(&row_bytes)?;
        }
        Ok(())
    }

    fn write_ascii(&self, reader: &mut impl BufRead, out: &mut impl Write) -> std::io::Result<()> {
        let mut line = String::new();
        let (mut skipped, mut row) = (0, 0);
        let mut surfels = self.surfels();
        while row < self.report.vertices {
            line.clear();
            if reader.read_line(&mut line)? == 0 {
                return Err(std::io::ErrorKind::UnexpectedEof.into());
            }
            if line.trim().is_empty() || skipped < self.header.skip {
                skipped += u64::from(!line.trim().is_empty());
                out.write_all(line.as_bytes())?;
                continue;
            }
            row += 1;
            let Some(surfel) = surfels.next().flatten() else {
                continue;
            };
            for (column, word) in line.split_ascii_whitespace().enumerate() {
                let separator = if column == 0 { "" } else { " " };
                let old = || word.parse().unwrap_or(f32::NAN);
                match self.value((row - 1, surfel), column, old) {
                    Some(value) if self.header.properties[column].scalar.is_float() => {
                        write!(out, "{separator}{value}")?
                    }
                    Some(value) => write!(out, "{separator}{}", value.round())?,
                    None => write!(out, "{separator}{word}")?,
                }
            }
            out.write_all(b"\n")?;
        }
        Ok(())
    }
}

/// A header, its surfels counted anew; all else in it is as it was, in whatever encoding.
fn counting(head: &[u8], surfels: usize) -> Vec<u8> {
    let each = head.split_inclusive(|b| *b == b'\n').map(|line| {
        let is_count = line.trim_ascii_start().starts_with(b"element")
            && line
                .split(u8::is_ascii_whitespace)
                .filter(|w| !w.is_empty())
                .nth(1)
                == Some(b"vertex");
        let end = &line[line.trim_ascii_end().len()..];
        if is_count {
            [format!("element vertex {surfels}").as_bytes(), end].concat()
        } else {
            line.into()
        }
    });
    each.collect::<Vec<_>>().concat()
}

#[cfg(test)]
mod tests;
