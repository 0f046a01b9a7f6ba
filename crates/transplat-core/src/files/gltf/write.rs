//! Writer of binary glTF with `KHR_gaussian_splatting` as it was ratified.

use std::io::Write;

use serde_json::{Map, Value, json};

use super::names::{BINARY_CHUNK, EXTENSION, JSON_CHUNK, MAGIC, MAX_DEGREE};
use crate::color::STORED_OFFSET;
use crate::files::packed::color_of_dc;
use crate::files::written::{Gaussian, MATERIAL, MaterialProperty, WritableSplat};
use crate::sh::{SQRT_4PI, coefficient_count};

const F32: u32 = 5126;

/// Target of a vertex buffer.
const ARRAY_BUFFER: u32 = 34962;

/// Writes a splat.
pub(in crate::files) fn write(
    splat: &WritableSplat<'_>,
    out: &mut impl Write,
) -> std::io::Result<()> {
    let n = splat.len();
    // Linear colour has in it what is added to stored colour.
    let offset = if splat.is_linear {
        STORED_OFFSET * SQRT_4PI as f32
    } else {
        0.0
    };
    let mut parts: Vec<(String, usize)> = vec![
        ("POSITION".into(), 3),
        (format!("{EXTENSION}:ROTATION"), 4),
        (format!("{EXTENSION}:SCALE"), 3),
        (format!("{EXTENSION}:OPACITY"), 1),
        // For programs that know points and no splats.
        ("COLOR_0".into(), 4),
    ];
    let degree = splat.degree.min(MAX_DEGREE);
    for l in 0..=degree {
        parts.extend((0..2 * l + 1).map(|m| (format!("{EXTENSION}:SH_DEGREE_{l}_COEF_{m}"), 3)));
    }
    if splat.materials.is_some() {
        parts.push(("NORMAL".into(), 3));
        // What is an application's own begins so.
        let own = |p: &MaterialProperty| (format!("_{}", p.name.to_uppercase()), p.width);
        parts.extend(MATERIAL.iter().map(own));
    }
    let mut attributes = Map::new();
    let (mut views, mut accessors) = (Vec::new(), Vec::new());
    let mut length = 0;
    for (i, (name, width)) in parts.iter().enumerate() {
        attributes.insert(name.clone(), json!(i));
        let bytes = 4 * width * n;
        views.push(
            json!({"buffer": 0, "byteOffset": length, "byteLength": bytes, "target": ARRAY_BUFFER}),
        );
        let shape = ["SCALAR", "VEC2", "VEC3", "VEC4"][width - 1];
        let mut accessor =
            json!({"bufferView": i, "componentType": F32, "count": n, "type": shape});
        if i == 0 {
            let [least, most] = ends(splat);
            accessor["min"] = json!(least);
            accessor["max"] = json!(most);
        }
        accessors.push(accessor);
        length += bytes;
    }
    let space = if splat.is_linear {
        "lin_rec709_display"
    } else {
        "srgb_rec709_display"
    };
    let extension = json!({
        "kernel": "ellipse",
        "colorSpace": space,
        "projection": "perspective",
        "sortingMethod": "cameraDistance",
    });
    let mut extensions = Map::new();
    extensions.insert(EXTENSION.into(), extension);
    // Far from the origin, where 32 bits of float would not do, it is the node that is there.
    let node = match splat.cloud.origin {
        glam::DVec3::ZERO => json!({"mesh": 0}),
        origin => json!({"mesh": 0, "translation": origin.to_array()}),
    };
    let document: Value = json!({
        "asset": {"version": "2.0", "generator": concat!("transplat ", env!("CARGO_PKG_VERSION"))},
        "extensionsUsed": [EXTENSION],
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [node],
        "meshes": [{"primitives": [{"mode": 0, "attributes": attributes, "extensions": extensions}]}],
        "accessors": accessors,
        "bufferViews": views,
        "buffers": [{"byteLength": length}],
    });
    let mut text = serde_json::to_vec(&document)?;
    text.resize(text.len().next_multiple_of(4), b' ');
    let total = 12 + 8 + text.len() + 8 + length;
    let total = u32::try_from(total).map_err(|_| {
        std::io::Error::other("the splat is too large for a binary glTF, which holds 4 GB")
    })?;
    out.write_all(MAGIC)?;
    for number in [2, total, text.len() as u32, JSON_CHUNK] {
        out.write_all(&number.to_le_bytes())?;
    }
    out.write_all(&text)?;
    for number in [length as u32, BINARY_CHUNK] {
        out.write_all(&number.to_le_bytes())?;
    }
    let dc = |g: &Gaussian<'_>| g.sh[0].map(|v| v - offset);
    let mut each = |values: &(dyn Fn(&Gaussian<'_>, &mut Vec<f32>) + Sync)| {
        splat.write_each(out, |g, bytes| {
            let mut numbers = Vec::with_capacity(4);
            values(g, &mut numbers);
            bytes.extend(numbers.into_iter().flat_map(f32::to_le_bytes));
        })
    };
    each(&|g, v| v.extend(g.place.to_array()))?;
    each(&|g, v| {
        let [w, x, y, z] = g.rotation;
        v.extend([x, y, z, w]);
    })?;
    each(&|g, v| v.extend(g.log_scales.map(f32::exp)))?;
    each(&|g, v| v.push(g.opacity))?;
    each(&|g, v| {
        v.extend(dc(g).map(|c| color_of_dc(c).clamp(0.0, 1.0)));
        v.push(g.opacity);
    })?;
    each(&|g, v| v.extend(dc(g)))?;
    for k in 1..coefficient_count(degree) {
        each(&|g, v| v.extend(g.sh[k]))?;
    }
    if splat.materials.is_some() {
        each(&|g, v| v.extend(g.normal))?;
        for property in &MATERIAL {
            each(&|g, v| {
                let values = g.material.map(property.of).unwrap_or_default();
                v.extend(&values[..property.width]);
            })?;
        }
    }
    Ok(())
}

/// Least and greatest coordinates.
fn ends(splat: &WritableSplat<'_>) -> [[f32; 3]; 2] {
    let positions = || {
        splat
            .order
            .iter()
            .map(|i| splat.cloud.positions[*i as usize])
    };
    let least = positions().reduce(glam::Vec3::min).unwrap_or_default();
    let most = positions().reduce(glam::Vec3::max).unwrap_or_default();
    [least.to_array(), most.to_array()]
}
