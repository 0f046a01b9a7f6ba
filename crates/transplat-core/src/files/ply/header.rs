//! The header of a PLY file: elements, their properties by name, and comments.

use std::io::{BufRead, Seek, SeekFrom};

/// A header longer than this is no header.
const MAX_HEADER_BYTES: usize = 1 << 20;

/// Encoding of the rows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// Type of a scalar property.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ScalarType {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl ScalarType {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    pub(crate) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }

    /// Integer that stands for 1 where it is a share, as in colours; of a float, 1.
    pub(crate) fn most(self) -> f32 {
        match self {
            Self::I8 => f32::from(i8::MAX),
            Self::U8 => f32::from(u8::MAX),
            Self::I16 => f32::from(i16::MAX),
            Self::U16 => f32::from(u16::MAX),
            Self::I32 => i32::MAX as f32,
            Self::U32 => u32::MAX as f32,
            Self::F32 | Self::F64 => 1.0,
        }
    }

    pub(crate) fn is_float(self) -> bool {
        matches!(self, Self::F32 | Self::F64)
    }

    /// Reads a number in double precision. See [`ScalarType::read`].
    pub(crate) fn read_f64(self, bytes: &[u8], big_endian: bool) -> f64 {
        match self {
            Self::F64 => f64::from_le_bytes(array(bytes, big_endian)),
            Self::I32 => f64::from(i32::from_le_bytes(array(bytes, big_endian))),
            Self::U32 => f64::from(u32::from_le_bytes(array(bytes, big_endian))),
            other => other.read(bytes, big_endian).into(),
        }
    }

    /// Reads one value from the start of `bytes`, which is long enough.
    #[inline(always)]
    pub(crate) fn read(self, bytes: &[u8], big_endian: bool) -> f32 {
        match self {
            Self::I8 => f32::from(bytes[0] as i8),
            Self::U8 => f32::from(bytes[0]),
            Self::I16 => f32::from(i16::from_le_bytes(array(bytes, big_endian))),
            Self::U16 => f32::from(u16::from_le_bytes(array(bytes, big_endian))),
            Self::I32 => i32::from_le_bytes(array(bytes, big_endian)) as f32,
            Self::U32 => u32::from_le_bytes(array(bytes, big_endian)) as f32,
            Self::F32 => f32::from_le_bytes(array(bytes, big_endian)),
            Self::F64 => f64::from_le_bytes(array(bytes, big_endian)) as f32,
        }
    }

    /// Writes one value, the inverse of [`ScalarType::read`]; integers are rounded, and held to their range.
    pub(crate) fn write(self, value: f32, bytes: &mut [u8], big_endian: bool) {
        let bytes = &mut bytes[..self.size()];
        let rounded = value.round();
        match self {
            Self::I8 => bytes.copy_from_slice(&(rounded as i8).to_le_bytes()),
            Self::U8 => bytes.copy_from_slice(&(rounded as u8).to_le_bytes()),
            Self::I16 => bytes.copy_from_slice(&(rounded as i16).to_le_bytes()),
            Self::U16 => bytes.copy_from_slice(&(rounded as u16).to_le_bytes()),
            Self::I32 => bytes.copy_from_slice(&(rounded as i32).to_le_bytes()),
            Self::U32 => bytes.copy_from_slice(&(rounded as u32).to_le_bytes()),
            Self::F32 => bytes.copy_from_slice(&value.to_le_bytes()),
            Self::F64 => bytes.copy_from_slice(&f64::from(value).to_le_bytes()),
        }
        if big_endian {
            bytes.reverse();
        }
    }
}

/// The first bytes as a number has them in memory.
#[inline(always)]
fn array<const N: usize>(bytes: &[u8], big_endian: bool) -> [u8; N] {
    let mut a = [0; N];
    a.copy_from_slice(&bytes[..N]);
    if big_endian {
        a.reverse();
    }
    a
}

/// A scalar property.
#[derive(Clone, Debug)]
pub(crate) struct Property {
    pub name: String,
    pub scalar: ScalarType,
    /// Bytes from the start of a binary row.
    pub offset: usize,
}

/// An element: what its rows are.
#[derive(Clone, Debug)]
pub(crate) struct Element {
    pub name: String,
    /// Claimed number of rows.
    pub count: u64,
    pub properties: Vec<Property>,
    /// Binary bytes of a row, without lists.
    pub stride: usize,
    /// Parts of a row in its order, where it has lists: the type of a list's length, and the type of its values.
    lists: Vec<(Option<ScalarType>, ScalarType)>,
    has_list: bool,
}

impl Element {
    /// The property of that name.
    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.name == name)
    }

    /// Steps over all of its rows in binary; `None` where they end too early.
    fn skip(&self, reader: &mut (impl BufRead + Seek), big_endian: bool, end: u64) -> Option<()> {
        let here = reader.stream_position().ok()?;
        if !self.has_list {
            let bytes = self.count.checked_mul(self.stride as u64)?;
            let after = here.checked_add(bytes).filter(|after| *after <= end)?;
            return reader.seek(SeekFrom::Start(after)).ok().map(drop);
        }
        // Each row takes something, so a claimed count comes to the end soon.
        for _ in 0..self.count {
            for (length, item) in &self.lists {
                let mut bytes = item.size() as u64;
                if let Some(length) = length {
                    let mut number = [0; 8];
                    let number = &mut number[..length.size()];
                    reader.read_exact(number).ok()?;
                    let items = length.read(number, big_endian);
                    bytes = bytes.checked_mul(items.max(0.0) as u64)?;
                }
                if bytes > end {
                    return None;
                }
                reader.seek_relative(bytes as i64).ok()?;
            }
            if reader.stream_position().ok()? > end {
                return None;
            }
        }
        Some(())
    }
}

/// Header of a file, with the vertex element picked out.
#[derive(Clone, Debug)]
pub(crate) struct Header {
    pub format: Format,
    pub comments: Vec<String>,
    /// Length of the header itself.
    pub bytes: u64,
    /// Binary bytes, or ascii lines, of the elements that come before the vertices.
    pub skip: u64,
    /// Claimed number of vertices; not to be trusted for an allocation.
    pub vertices: u64,
    pub properties: Vec<Property>,
    /// Binary bytes of one vertex.
    pub stride: usize,
    /// The elements before the vertices, and those after.
    pub before: Vec<Element>,
    pub after: Vec<Element>,
}

impl Header {
    /// The vertex property of that name.
    pub(crate) fn find(&self, name: &str) -> Option<usize> {
        self.properties.iter().position(|p| p.name == name)
    }

    pub(crate) fn big_endian(&self) -> bool {
        self.format == Format::BigEndian
    }

    /// True where a file of so many bytes holds all that comes after the vertices, which is where the reader is.
    pub(crate) fn is_whole(&self, reader: &mut (impl BufRead + Seek), file_bytes: u64) -> bool {
        if self.format == Format::Ascii {
            let rows = self.after.iter().map(|e| e.count);
            let Some(mut rows) = rows.reduce(u64::saturating_add) else {
                return true;
            };
            let mut line = Vec::new();
            while rows > 0 {
                line.clear();
                match reader.read_until(b'\n', &mut line) {
                    Ok(1..) => rows -= u64::from(!line.trim_ascii().is_empty()),
                    _ => return false,
                }
            }
            return true;
        }
        let big_endian = self.big_endian();
        let mut after = self.after.iter();
        after.all(|element| element.skip(reader, big_endian, file_bytes).is_some())
    }

    /// Parses a header; the reader is left at the first byte behind it.
    pub(crate) fn parse(reader: &mut impl BufRead) -> Result<Self, String> {
        let mut parser = Parser::default();
        let mut bytes = 0;
        if read_line(reader, &mut bytes)?
            .trim_start_matches('\u{feff}')
            .trim()
            != "ply"
        {
            return Err("does not begin with \"ply\"".into());
        }
        loop {
            match read_line(reader, &mut bytes)?.trim() {
                "end_header" => return parser.finish(bytes as u64),
                line => parser.line(line)?,
            }
        }
    }
}

fn read_line(reader: &mut impl BufRead, total: &mut usize) -> Result<String, String> {
    let mut line = Vec::new();
    let mut limited = std::io::Read::take(&mut *reader, (MAX_HEADER_BYTES - *total) as u64);
    limited
        .read_until(b'\n', &mut line)
        .map_err(|e| e.to_string())?;
    *total += line.len();
    if line.last() != Some(&b'\n') {
        return Err("the header has no end_header line".into());
    }
    // Comments are in whatever encoding their writer had; each byte of another one is some character.
    Ok(String::from_utf8(line)
        .unwrap_or_else(|e| e.into_bytes().into_iter().map(char::from).collect()))
}

#[derive(Default)]
struct Parser {
    format: Option<Format>,
    comments: Vec<String>,
    elements: Vec<Element>,
}

impl Parser {
    fn line(&mut self, line: &str) -> Result<(), String> {
        let words: Vec<&str> = line.split_whitespace().collect();
        match words[..] {
            ["format", format, "1.0"] => {
                self.format = Some(match format {
                    "ascii" => Format::Ascii,
                    "binary_little_endian" => Format::LittleEndian,
                    "binary_big_endian" => Format::BigEndian,
                    _ => return Err(format!("format {format} is not known")),
                });
            }
            ["format", ..] => return Err(format!("{line:?} is no format of PLY 1.0")),
            ["comment" | "obj_info", ..] => {
                let text = line.split_once(char::is_whitespace).map_or("", |(_, t)| t);
                self.comments.push(text.trim().to_owned());
            }
            ["element", name, count] => {
                let count = count
                    .parse()
                    .map_err(|_| format!("{line:?} does not count its rows"))?;
                self.elements.push(Element {
                    name: name.to_owned(),
                    count,
                    properties: Vec::new(),
                    stride: 0,
                    lists: Vec::new(),
                    has_list: false,
                });
            }
            ["property", ..] => {
                let element = self
                    .elements
                    .last_mut()
                    .ok_or("a property comes before any element")?;
                match words[1..] {
                    ["list", length, item, name] => {
                        let types = [length, item].map(ScalarType::parse);
                        let [Some(length), Some(item)] = types else {
                            return Err(format!("list {name} has an unknown type"));
                        };
                        element.lists.push((Some(length), item));
                        element.has_list = true;
                    }
                    [scalar, name] => {
                        let scalar = ScalarType::parse(scalar)
                            .ok_or_else(|| format!("property {name} has unknown type {scalar}"))?;
                        if element.properties.iter().any(|p| p.name == name) {
                            return Err(format!("property {name} is there twice"));
                        }
                        element.properties.push(Property {
                            name: name.to_owned(),
                            scalar,
                            offset: element.stride,
                        });
                        element.stride += scalar.size();
                        element.lists.push((None, scalar));
                    }
                    _ => return Err(format!("{line:?} is not a property")),
                }
            }
            [] => {}
            _ => return Err(format!("{line:?} does not belong into a header")),
        }
        Ok(())
    }

    fn finish(self, bytes: u64) -> Result<Header, String> {
        let format = self.format.ok_or("the header has no format line")?;
        let mut skip = 0u64;
        let mut elements = self.elements.into_iter();
        let mut before = Vec::new();
        while let Some(element) = elements.next() {
            if element.name == "vertex" {
                if element.has_list {
                    return Err("a vertex has list properties, which no splat has".into());
                }
                return Ok(Header {
                    format,
                    comments: self.comments,
                    bytes,
                    skip,
                    vertices: element.count,
                    properties: element.properties,
                    stride: element.stride,
                    before,
                    after: elements.collect(),
                });
            }
            if element.has_list && element.count > 0 && format != Format::Ascii {
                return Err(format!(
                    "element {} has lists and comes before the vertices; put the vertices first",
                    element.name
                ));
            }
            let row = if format == Format::Ascii {
                1
            } else {
                element.stride as u64
            };
            skip = element
                .count
                .checked_mul(row)
                .and_then(|n| n.checked_add(skip))
                .ok_or("an element claims more rows than any file holds")?;
            before.push(element);
        }
        Err("there is no vertex element; a splat has one row of that element a Gaussian".into())
    }
}
