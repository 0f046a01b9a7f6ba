//! Numbers in the buffers of a glTF.

use std::borrow::Cow;

use serde::Deserialize;

use crate::files::packed::Fields;

/// A part of a buffer.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct BufferView {
    buffer: usize,
    #[serde(default)]
    byte_offset: usize,
    byte_length: usize,
    byte_stride: Option<usize>,
    #[serde(default)]
    extensions: serde_json::Map<String, serde_json::Value>,
}

impl BufferView {
    /// The extension that its bytes are compressed by.
    pub fn compression(&self) -> Option<&str> {
        let mut names = self.extensions.keys().map(String::as_str);
        names.find(|name| name.contains("compression"))
    }

    /// Its bytes, if they are there.
    pub fn bytes<'a>(&self, buffers: &'a [Cow<'_, [u8]>]) -> Option<&'a [u8]> {
        let end = self.byte_offset.checked_add(self.byte_length)?;
        buffers.get(self.buffer)?.get(self.byte_offset..end)
    }
}

/// Number format of a part of a buffer.
#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
pub(super) struct Accessor {
    buffer_view: Option<usize>,
    #[serde(default)]
    byte_offset: usize,
    component_type: u32,
    #[serde(default)]
    normalized: bool,
    count: usize,
    #[serde(rename = "type")]
    shape: String,
    sparse: Option<serde_json::Value>,
}

/// Type of a component.
#[derive(Clone, Copy, Debug, PartialEq)]
enum Component {
    I8,
    U8,
    I16,
    U16,
    U32,
    F32,
}

impl Component {
    fn of(number: u32) -> Option<Self> {
        Some(match number {
            5120 => Self::I8,
            5121 => Self::U8,
            5122 => Self::I16,
            5123 => Self::U16,
            5125 => Self::U32,
            5126 => Self::F32,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::U32 | Self::F32 => 4,
        }
    }

    fn read(self, fields: &mut Fields<'_>, normalized: bool) -> f32 {
        let (value, most) = match self {
            Self::I8 => (f32::from(fields.u8() as i8), f32::from(i8::MAX)),
            Self::U8 => (f32::from(fields.u8()), f32::from(u8::MAX)),
            Self::I16 => (f32::from(fields.u16() as i16), f32::from(i16::MAX)),
            Self::U16 => (f32::from(fields.u16()), f32::from(u16::MAX)),
            Self::U32 => (fields.u32() as f32, u32::MAX as f32),
            Self::F32 => return fields.f32(),
        };
        if normalized {
            (value / most).max(-1.0)
        } else {
            value
        }
    }
}

/// The values of an attribute, which are all there.
pub(super) struct Column<'a> {
    bytes: &'a [u8],
    stride: usize,
    component: Component,
    normalized: bool,
    /// Number of values.
    pub count: usize,
    /// Numbers of a value.
    pub width: usize,
}

impl Accessor {
    pub fn column<'a>(
        &self,
        views: &[BufferView],
        buffers: &'a [Cow<'_, [u8]>],
    ) -> Result<Column<'a>, String> {
        if self.sparse.is_some() {
            return Err("sparse accessors are not read".into());
        }
        let component = Component::of(self.component_type);
        let component = component.ok_or("its component type is not known")?;
        let width = match self.shape.as_str() {
            "SCALAR" => 1,
            "VEC2" => 2,
            "VEC3" => 3,
            "VEC4" => 4,
            other => return Err(format!("its type {other} is none of a splat")),
        };
        let view = self.buffer_view.and_then(|i| views.get(i));
        let view = view.ok_or("it has no buffer view")?;
        let bytes = view.bytes(buffers).and_then(|b| b.get(self.byte_offset..));
        let bytes = bytes.ok_or("its buffer view is not within its buffer")?;
        let size = width * component.size();
        let stride = view.byte_stride.unwrap_or(size);
        let fits = stride >= size
            && (self.count.checked_sub(1)).is_none_or(|n| {
                n.checked_mul(stride)
                    .and_then(|n| n.checked_add(size))
                    .is_some_and(|n| n <= bytes.len())
            });
        if !fits {
            return Err(format!(
                "claims {} values, and has no room for them",
                self.count
            ));
        }
        Ok(Column {
            bytes,
            stride,
            component,
            normalized: self.normalized,
            count: self.count,
            width,
        })
    }
}

impl Column<'_> {
    /// The first numbers of a value; those that it has not are 1, as the opacity of a colour.
    pub fn get<const N: usize>(&self, i: usize) -> [f32; N] {
        let mut fields = Fields(&self.bytes[i * self.stride..]);
        let mut value = [1.0; N];
        for number in value.iter_mut().take(self.width) {
            *number = self.component.read(&mut fields, self.normalized);
        }
        value
    }
}
