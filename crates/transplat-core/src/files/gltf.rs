//! Splats in glTF 2.0 (`.gltf`, `.glb`) by `KHR_gaussian_splatting`, ratified or as its drafts had it, and with SPZ inside.

mod accessor;
mod names;
mod write;

use std::borrow::Cow;
use std::collections::{HashMap, HashSet};
use std::path::{Component, Path, PathBuf};

use glam::{Affine3A, DAffine3, DMat4, DQuat, DVec3, DVec4};
use serde::Deserialize;
use serde_json::Value;

use super::packed::{Fields, dc_of_color, logit};
use super::rows::{Builder, Finished, SplatKind, StoredRow, check_count, origin_near, rearranged};
use super::write::folder_of;
use super::{decode, read, spz};
use crate::color::{Encoding, STORED_OFFSET};
use crate::error::{Error, Result};
use crate::sh::{SQRT_4PI, coefficient_count};
use crate::surfels::{SurfelCloud, UpAxis};
use accessor::{Accessor, BufferView, Column};

use names::{BINARY_CHUNK, EXTENSION, JSON_CHUNK};
pub(super) use names::{MAGIC, MAX_DEGREE};
pub(super) use write::write;

/// SPZ inside, by the names that its drafts had.
const SPZ_EXTENSIONS: [&str; 3] = [
    "KHR_gaussian_splatting_compression_spz_2",
    "KHR_gaussian_splatting_compression_spz",
    "KHR_spz_gaussian_splats_compression",
];

pub(super) const MAX_FILE_BYTES: u64 = 1 << 36;

/// One is the rule.
const MAX_BUFFERS: usize = 64;

/// Nodes of a scene, each as often as it is placed.
const MAX_PLACED: usize = 1 << 16;

#[derive(Default, Deserialize)]
#[serde(rename_all = "camelCase", default)]
struct Document {
    buffers: Vec<Buffer>,
    buffer_views: Vec<BufferView>,
    accessors: Vec<Accessor>,
    meshes: Vec<Mesh>,
    nodes: Vec<GltfNode>,
    scenes: Vec<GltfScene>,
    scene: usize,
    extensions_required: Vec<String>,
}

/// True where a file may require an extension: it is read, or changes nothing of a splat.
fn is_understood(extension: &str) -> bool {
    const OF_OTHERS: [&str; 4] = ["KHR_materials_", "KHR_texture_", "KHR_lights_", "KHR_xmp"];
    extension == EXTENSION
        || SPZ_EXTENSIONS.contains(&extension)
        || extension == "KHR_mesh_quantization"
        || OF_OTHERS.iter().any(|other| extension.starts_with(other))
}

#[derive(Deserialize)]
struct Buffer {
    uri: Option<String>,
}

#[derive(Deserialize)]
struct Mesh {
    primitives: Vec<Primitive>,
}

#[derive(Deserialize)]
struct Primitive {
    #[serde(default)]
    attributes: HashMap<String, usize>,
    #[serde(default)]
    extensions: Value,
}

#[derive(Default, Deserialize)]
#[serde(default)]
struct GltfNode {
    mesh: Option<usize>,
    children: Vec<usize>,
    matrix: Option<[f64; 16]>,
    translation: Option<[f64; 3]>,
    rotation: Option<[f64; 4]>,
    scale: Option<[f64; 3]>,
}

#[derive(Deserialize)]
struct GltfScene {
    #[serde(default)]
    nodes: Vec<usize>,
}

impl GltfNode {
    fn parent_from_node(&self) -> DAffine3 {
        if let Some(matrix) = &self.matrix {
            return DAffine3::from_mat4(DMat4::from_cols_array(matrix));
        }
        let turn = self
            .rotation
            .and_then(|r| DVec4::from_array(r).try_normalize());
        DAffine3::from_scale_rotation_translation(
            self.scale.map_or(DVec3::ONE, DVec3::from_array),
            turn.map_or(DQuat::IDENTITY, DQuat::from_vec4),
            self.translation.map_or(DVec3::ZERO, DVec3::from_array),
        )
    }
}

impl Primitive {
    fn is_splat(&self) -> bool {
        let has = |name: &str| self.extensions.get(name).is_some();
        has(EXTENSION) || SPZ_EXTENSIONS.iter().any(|name| has(name))
    }

    /// The buffer view that holds it as SPZ.
    fn spz(&self) -> Option<usize> {
        let within = |holder: &Value| {
            let mut names = SPZ_EXTENSIONS.iter();
            names.find_map(|name| holder.get(name)?.get("bufferView")?.as_u64())
        };
        let nested = self
            .extensions
            .get(EXTENSION)
            .and_then(|e| e.get("extensions"));
        let view = nested
            .and_then(within)
            .or_else(|| within(&self.extensions))?;
        usize::try_from(view).ok()
    }

    fn is_linear(&self) -> bool {
        let space = self
            .extensions
            .get(EXTENSION)
            .and_then(|e| e.get("colorSpace"));
        space.and_then(Value::as_str) == Some("lin_rec709_display")
    }
}

/// Reads the splats of a file, each where its node is.
pub(super) fn read(path: &Path) -> Result<Finished> {
    let bytes = read::read_all(path, MAX_FILE_BYTES)?;
    let (text, binary) = if bytes.starts_with(MAGIC) {
        chunks(&bytes).ok_or_else(|| Error::invalid(path, "the binary glTF is truncated"))?
    } else {
        (&bytes[..], &[][..])
    };
    let document: Document =
        decode::json(text).map_err(|e| Error::invalid(path, format!("not a glTF splat: {e}")))?;
    let mut required = document.extensions_required.iter();
    if let Some(other) = required.find(|name| !is_understood(name)) {
        return Err(not_supported(path, other));
    }
    let buffers = load_buffers(path, &document, binary)?;
    read_document(path, &document, &buffers)
}

fn not_supported(path: &Path, extension: &str) -> Error {
    let what = format!(
        "needs the extension {extension}, which is not supported; save it without (gltf-transform copy, or uncompressed), or as PLY or SPZ"
    );
    Error::invalid(path, what)
}

/// The JSON and the binary chunk of a binary glTF.
fn chunks(bytes: &[u8]) -> Option<(&[u8], &[u8])> {
    let total = Fields(bytes.get(8..12)?).u32() as usize;
    let mut rest = bytes.get(12..total)?;
    let (mut text, mut binary) = (None, &[][..]);
    while rest.len() >= 8 {
        let [length, kind] = Fields(rest).each(Fields::u32);
        let end = 8usize.checked_add(length as usize)?;
        let content = rest.get(8..end)?;
        match kind {
            JSON_CHUNK => text = text.or(Some(content)),
            BINARY_CHUNK => binary = content,
            _ => {}
        }
        rest = rest.get(end..)?;
    }
    Some((text?, binary))
}

fn load_buffers<'a>(
    path: &Path,
    document: &Document,
    binary: &'a [u8],
) -> Result<Vec<Cow<'a, [u8]>>> {
    let invalid = |message: String| Error::invalid(path, message);
    if document.buffers.len() > MAX_BUFFERS {
        return Err(invalid(format!("has more than {MAX_BUFFERS} buffers")));
    }
    let buffers = document.buffers.iter().enumerate().map(|(i, buffer)| {
        let Some(uri) = &buffer.uri else {
            // The binary chunk is the first one; others without a name hold what an extension makes of it.
            return Ok(if i == 0 {
                binary.into()
            } else {
                Cow::default()
            });
        };
        if let Some(data) = uri.strip_prefix("data:") {
            let (_, text) = data.split_once(";base64,").unwrap_or_default();
            let decoded = decode::base64(text);
            let decoded = decoded.map_err(|e| invalid(format!("a buffer is no base64: {e}")));
            return Ok(decoded?.into());
        }
        let outside = || {
            invalid(format!(
                "names a buffer {uri:?} that is not in its folder or below"
            ))
        };
        let file = below(folder_of(path), uri).ok_or_else(outside)?;
        Ok(read::read_all(&file, MAX_FILE_BYTES)?.into())
    });
    buffers.collect()
}

/// The file that a relative URI names in a folder or below it; as it is written, or with its percent codes decoded (RFC 3986).
fn below(folder: &Path, uri: &str) -> Option<PathBuf> {
    let decoded = percent_decoded(uri);
    let named = [uri, &decoded].into_iter().map(|name| {
        let is_within =
            |part: Component<'_>| matches!(part, Component::Normal(_) | Component::CurDir);
        let name = Path::new(name);
        (name.components().all(is_within) && name.file_name().is_some()).then(|| folder.join(name))
    });
    let named: Vec<PathBuf> = named.collect::<Option<_>>()?;
    let there = named.iter().find(|file| file.is_file());
    there.or(named.last()).cloned()
}

/// A part of a URI with its percent codes decoded (RFC 3986).
pub fn percent_decoded(uri: &str) -> String {
    let mut bytes = Vec::with_capacity(uri.len());
    let mut rest = uri.as_bytes();
    while let [first, after @ ..] = rest {
        let code = after.get(..2).filter(|_| *first == b'%');
        let code = code.and_then(|c| u8::from_str_radix(str::from_utf8(c).ok()?, 16).ok());
        bytes.push(code.unwrap_or(*first));
        rest = if code.is_some() { &after[2..] } else { after };
    }
    String::from_utf8(bytes).unwrap_or_else(|_| uri.to_owned())
}

/// A path as a part of a URI: all but letters, digits and `-._~/` as percent codes (RFC 3986).
pub fn percent_encoded(path: &Path) -> String {
    let plain = |b: u8| b.is_ascii_alphanumeric() || b"-._~/".contains(&b);
    let mut out = String::new();
    for byte in path.as_os_str().as_encoded_bytes() {
        match plain(*byte) {
            true => out.push(char::from(*byte)),
            false => out += &format!("%{byte:02X}"),
        }
    }
    out
}

fn read_document(path: &Path, document: &Document, buffers: &[Cow<'_, [u8]>]) -> Result<Finished> {
    let invalid = |message: String| Error::invalid(path, message);
    let mut placed = Vec::new();
    for (node, world_from_node) in placed_nodes(document).map_err(invalid)? {
        let Some(mesh) = node.mesh else {
            continue;
        };
        let mesh = document.meshes.get(mesh);
        let mesh = mesh.ok_or_else(|| invalid("names a mesh that is not there".into()))?;
        let splats = mesh.primitives.iter().filter(|p| p.is_splat());
        placed.extend(splats.map(|p| (p, world_from_node)));
    }
    if placed.is_empty() {
        return Err(invalid(format!(
            "holds no splat: no primitive of its scene has {EXTENSION}"
        )));
    }
    let compressed = document
        .buffer_views
        .iter()
        .find_map(BufferView::compression);
    if let Some(extension) = compressed {
        return Err(not_supported(path, extension));
    }
    let bytes = buffers.iter().map(|b| b.len() as u64).sum();
    let mut total = 0;
    let mut parts = Vec::with_capacity(placed.len());
    for (primitive, world_from_node) in placed {
        let part = match primitive.spz() {
            Some(view) => {
                let view = document.buffer_views.get(view);
                let view = view.and_then(|v| v.bytes(buffers));
                let mut bytes =
                    view.ok_or_else(|| invalid("names SPZ that is not there".into()))?;
                let length = bytes.len() as u64;
                spz::read(path, &mut bytes, length)?
            }
            None => read_attributes(document, buffers, primitive).map_err(invalid)?,
        };
        // The same may be placed many times.
        total += part.0.len() as u64;
        check_count(total, bytes).map_err(invalid)?;
        parts.push((part, world_from_node));
    }
    together(parts).ok_or_else(|| invalid("has a node that flattens its splat".into()))
}

/// The nodes of the scene, or all where there is none, each with where it is.
fn placed_nodes(document: &Document) -> std::result::Result<Vec<(&GltfNode, DAffine3)>, String> {
    let inner: HashSet<usize> = (document.nodes.iter())
        .flat_map(|n| n.children.iter().copied())
        .collect();
    let roots = match document.scenes.get(document.scene) {
        Some(scene) => scene.nodes.clone(),
        None => (0..document.nodes.len())
            .filter(|n| !inner.contains(n))
            .collect(),
    };
    let mut waiting: Vec<(usize, DAffine3)> = roots
        .into_iter()
        .map(|root| (root, DAffine3::IDENTITY))
        .collect();
    let mut placed = Vec::new();
    while let Some((node, world_from_parent)) = waiting.pop() {
        let node = document
            .nodes
            .get(node)
            .ok_or("names a node that is not there")?;
        let world_from_node = world_from_parent * node.parent_from_node();
        placed.push((node, world_from_node));
        let children = node.children.iter().map(|child| (*child, world_from_node));
        waiting.extend(children);
        // Rings come here, too.
        if placed.len() + waiting.len() > MAX_PLACED {
            return Err(format!(
                "places more than {MAX_PLACED} nodes, or nests them without end"
            ));
        }
    }
    Ok(placed)
}

/// True where a map only scales evenly, rotates and moves.
fn scales_evenly(map: DAffine3) -> bool {
    let axes = [map.matrix3.x_axis, map.matrix3.y_axis, map.matrix3.z_axis];
    let [x, y, z] = axes.map(|a| a.length());
    let close = |a: f64, b: f64| (a - b).abs() <= 1e-3 * x;
    let square = (0..3).all(|i| axes[i].dot(axes[(i + 1) % 3]).abs() <= 1e-3 * x * x);
    let is_even = x > 0.0 && x.is_finite() && close(x, y) && close(x, z) && square;
    is_even && map.matrix3.determinant() > 0.0
}

/// Parts in one, as one file of theirs would have them; nothing where a node flattens its part.
fn together(mut parts: Vec<(Finished, DAffine3)>) -> Option<Finished> {
    if let [(_, place)] = &parts[..]
        && *place == DAffine3::IDENTITY
        && let Some((alone, _)) = parts.pop()
    {
        return Some(alone);
    }
    // Where the first is, what all are relative to.
    let ((first, ..), place) = &parts[0];
    let bounds = first.bounds();
    let middle = place.transform_point3(first.origin + bounds.center.as_dvec3());
    let largest = place
        .matrix3
        .to_cols_array()
        .into_iter()
        .map(f64::abs)
        .fold(0.0, f64::max);
    let size = largest * f64::from(first.median_size().unwrap_or(0.0));
    let origin = origin_near(middle, size);
    let mut mapped = Vec::with_capacity(parts.len());
    for ((cloud, ..), place) in &parts {
        let moved = place.transform_point3(cloud.origin) - origin;
        let local = DAffine3::from_mat3_translation(place.matrix3, moved);
        let map = Affine3A::from_mat3_translation(local.matrix3.as_mat3(), moved.as_vec3());
        if !(map.is_finite() && map.matrix3.determinant() != 0.0) {
            return None;
        }
        mapped.push(match scales_evenly(local) {
            true => cloud.transformed(map),
            false => cloud.mapped(map)?,
        });
    }
    let clouds: Vec<(&SurfelCloud, Affine3A)> = mapped
        .iter()
        .map(|cloud| (cloud, Affine3A::IDENTITY))
        .collect();
    let mut cloud = SurfelCloud {
        origin,
        ..SurfelCloud::composed(&clouds)
    };
    let mut surfel_of_row = Vec::with_capacity(cloud.len());
    let mut report = parts[0].0.1.clone();
    report.skipped_work.clear();
    for ((part, told, rows), _) in &parts {
        let (first_row, first) = (surfel_of_row.len(), surfel_of_row.len() as u32);
        debug_assert_eq!(part.len(), rows.len());
        let others = told
            .warnings
            .iter()
            .filter(|w| !report.warnings.contains(w));
        let others: Vec<String> = others.cloned().collect();
        report.warnings.extend(others);
        report
            .skipped_work
            .extend(told.skipped_work.iter().map(|row| first_row + row));
        surfel_of_row.extend(rows.iter().map(|surfel| first + surfel));
    }
    report.vertices = cloud.len();
    let places = rearranged(&mut cloud);
    surfel_of_row
        .iter_mut()
        .for_each(|s| *s = places[*s as usize]);
    Some((cloud, report, surfel_of_row))
}

fn read_attributes(
    document: &Document,
    buffers: &[Cow<'_, [u8]>],
    primitive: &Primitive,
) -> std::result::Result<Finished, String> {
    let find = |names: &[String]| -> std::result::Result<Option<Column<'_>>, String> {
        let mut found = names
            .iter()
            .filter_map(|name| Some((name, *primitive.attributes.get(name)?)));
        let Some((name, index)) = found.next() else {
            return Ok(None);
        };
        let accessor = document.accessors.get(index);
        let accessor = accessor.ok_or_else(|| format!("{name} has no accessor"))?;
        let column = accessor.column(&document.buffer_views, buffers);
        column.map(Some).map_err(|e| format!("{name}: {e}"))
    };
    let named = |name: &str| [format!("{EXTENSION}:{name}"), format!("_{name}")];
    let need = |names: &[String], width: usize| {
        let column = find(names)?.ok_or_else(|| format!("the splat has no {}", names[0]))?;
        if column.width < width {
            return Err(format!("{} has too few numbers", names[0]));
        }
        Ok::<_, String>(column)
    };
    let positions = need(&["POSITION".into()], 3)?;
    let rotations = need(&named("ROTATION"), 4)?;
    let scales = need(&named("SCALE"), 3)?;
    let opacities = find(&named("OPACITY"))?;
    let colors = find(&["COLOR_0".into()])?;
    let mut sh = Vec::new();
    let mut degree = 0;
    for l in 0..=MAX_DEGREE {
        let of_degree = (0..2 * l + 1).map(|m| find(&named(&format!("SH_DEGREE_{l}_COEF_{m}"))));
        let of_degree: Vec<_> = of_degree.collect::<std::result::Result<_, _>>()?;
        let Some(of_degree) = of_degree.into_iter().collect::<Option<Vec<_>>>() else {
            break;
        };
        degree = l;
        sh.extend(of_degree);
    }
    if sh.iter().any(|c| c.width < 3) {
        return Err("SH coefficients are not of three colours".into());
    }
    let n = positions.count;
    let mut columns = [&rotations, &scales]
        .into_iter()
        .chain(&opacities)
        .chain(&colors)
        .chain(&sh);
    if n == 0 || columns.any(|c| c.count != n) {
        return Err("the splat's attributes are of different lengths, or empty".into());
    }
    if opacities.is_none() && colors.as_ref().is_none_or(|c| c.width != 4) {
        return Err(format!("the splat has no {EXTENSION}:OPACITY"));
    }
    if sh.is_empty() && colors.is_none() {
        return Err(format!("the splat has no {EXTENSION}:SH_DEGREE_0_COEF_0"));
    }
    // Before it was ratified they were logarithms, some of which are below 0 in any scene.
    let are_logs = (0..n).any(|i| scales.get::<3>(i).iter().any(|s| *s < 0.0));
    let mut rows = Builder::new(SplatKind::Gaussians3d, degree, n)?;
    rows.push_rows(n, |i, _, out| {
        for (f, column) in out.iter_mut().zip(&sh) {
            *f = column.get(i);
        }
        let color = colors.as_ref().map(|c| c.get::<4>(i));
        if let (true, Some([r, g, b, _])) = (sh.is_empty(), color) {
            out[0] = [r, g, b].map(dc_of_color);
        }
        let opacity = opacities.as_ref().map(|o| o.get::<1>(i)[0]);
        let [x, y, z, w] = rotations.get(i);
        let scales: [f32; 3] = scales.get(i);
        StoredRow {
            position: positions.get::<3>(i).map(f64::from),
            rotation: [w, x, y, z],
            log_scales: if are_logs {
                scales
            } else {
                scales.map(f32::ln)
            },
            logit: logit(opacity.or(color.map(|c| c[3])).unwrap_or(1.0)),
        }
    });
    let mut finished = rows.finish("glTF".into(), Some(UpAxis::PlusY))?;
    if primitive.is_linear() {
        let cloud = &mut finished.0;
        cloud.encoding = Encoding::Linear;
        // What is added to stored colour is a part of linear colour.
        let k = coefficient_count(cloud.sh_degree);
        for dc in cloud.sh.iter_mut().step_by(k).flatten() {
            *dc += STORED_OFFSET * SQRT_4PI as f32;
        }
    }
    Ok(finished)
}

#[cfg(test)]
mod tests;
