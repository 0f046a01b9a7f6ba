//! OpenEXR images: any channel type and every compression that the `exr` crate reads, of the layer or part that is the image.

mod layers;

use std::path::Path;

use exr::meta::attribute::EnvironmentMap as Envmap;
use exr::meta::header::Header;
use glam::DVec2;

use super::super::decode;
use super::super::read::{check_map_size, open};
use super::primaries::{Chromaticities, apply, rec_709_from};
use crate::error::{Error, Result};
use crate::images::{Image, Layout, Provenance};
use layers::{Colors, Layer, default_layer, layers_of, named_layer};

/// Share of an image that is black because the file has no pixels there, from which on that is said.
const MISSING_SHARE: f64 = 0.01;

/// Width and height of what is seen of the first layer, as its header tells them.
pub fn size(path: &Path) -> Result<[usize; 2]> {
    let headers = decode::exr_headers(open(path)?);
    let headers = headers.map_err(|why| Error::invalid(path, why))?;
    let first = headers.first();
    let first = first.ok_or_else(|| Error::invalid(path, "OpenEXR: no layer"))?;
    let size = first.shared_attributes.display_window.size;
    Ok([size.width(), size.height()])
}

/// Loads the layer of that name, or else the one that its name tells to be the image.
pub fn load(path: &Path, named: Option<&str>) -> Result<Image> {
    let invalid = |why: String| Error::invalid(path, why);
    let file = open(path)?;
    let bytes = file.len();
    let headers = decode::exr_headers(file).map_err(invalid)?;
    for header in &headers {
        check(path, header, bytes)?;
    }
    let layers = layers_of(&headers);
    let (at, is_clear) = match named {
        Some(name) if !layers.is_empty() => (named_layer(&layers, name).map_err(invalid)?, true),
        _ => default_layer(&layers).ok_or_else(|| invalid(no_color(&headers)))?,
    };
    let layer = &layers[at];
    let header = &headers[layer.part];
    let planes = decode::exr_channels(open(path)?, layer.part, &layer.channels());
    let planes = planes.map_err(invalid)?;
    let mut image = within_window(path, header, layer, &planes)?;
    let mut warnings = std::mem::take(&mut image.provenance.warnings);
    let is_partial = !warnings.is_empty();
    if layers.len() > 1 {
        let others = layers.iter().filter(|l| l.name != layer.name);
        let others: Vec<String> = others.map(Layer::called).collect();
        let chosen = layer.called();
        let low_confidence = if is_clear {
            ""
        } else {
            ", the first: no name says which is the image"
        };
        if named.is_none() {
            warnings.push(format!(
                "has {} layers; {chosen} is read{low_confidence}; --layer NAME (--source-layer; Layer in the panel Light) takes another: {}",
                layers.len(),
                others.join(", ")
            ));
        }
        image.provenance.layers = layers.iter().map(|l| l.name.clone()).collect();
        image.provenance.layer = Some(layer.name.clone());
    }
    let attributes = &header.shared_attributes;
    let own = &header.own_attributes;
    if let Some(c) = attributes.chromaticities {
        let at = |v: exr::math::Vec2<f32>| DVec2::new(v.x().into(), v.y().into());
        let c = Chromaticities {
            red: at(c.red),
            green: at(c.green),
            blue: at(c.blue),
            white: at(c.white),
        };
        if let Some(matrix) = rec_709_from(&c, own.adopted_neutral.map(at)) {
            apply(&matrix, &mut image.pixels);
        }
    }
    image.layout = match own.environment_map {
        Some(Envmap::Cube) if image.height == 6 * image.width => Some(Layout::CubeColumn),
        Some(Envmap::LatitudeLongitude) => Some(Layout::Equirectangular),
        // What is black of it is no empty part of a layout.
        _ if is_partial => Some(Layout::Equirectangular),
        _ => None,
    };
    image.provenance.warnings = warnings;
    Ok(image)
}

/// Checks what the header of a part claims, before anything is allocated by it.
fn check(path: &Path, header: &Header, bytes: u64) -> Result<()> {
    let invalid = |why: &str| Error::invalid(path, why);
    if header.deep {
        return Err(invalid(
            "holds deep pixels, which are no flat image; flatten it first (DeepToImage in Nuke, or save it without \"deep\")",
        ));
    }
    // The decoder divides by it.
    let samplings = || header.channels.list.iter().map(|c| c.sampling);
    if samplings().any(|s| s.x() == 0 || s.y() == 0) {
        return Err(invalid("a channel of no pixels"));
    }
    if samplings().any(|s| s.x() > 1 || s.y() > 1) {
        return Err(invalid(
            "its channels have different resolutions (luminance and chroma), which is not read; save it as plain RGB",
        ));
    }
    let (size, window) = (
        header.layer_size,
        header.shared_attributes.display_window.size,
    );
    check_map_size(path, size.width(), size.height())?;
    check_map_size(path, window.width(), window.height())?;
    // Deflate packs 1032 to 1 at best, and PXR24 drops a quarter of f32 before it.
    let claimed = header.total_pixel_bytes() as u64;
    if claimed > bytes.saturating_mul(1400) {
        return Err(Error::invalid(
            path,
            format!("claims {claimed} bytes of pixels in a file of {bytes}"),
        ));
    }
    Ok(())
}

fn no_color(headers: &[Header]) -> String {
    let channels = headers.iter().flat_map(|h| &h.channels.list);
    let names: Vec<String> = channels.map(|c| c.name.to_string()).collect();
    format!("no R, G and B channels (it has {})", names.join(", "))
}

/// The part of a layer that is in the display window; black where it has no pixels there.
fn within_window(
    path: &Path,
    header: &Header,
    layer: &Layer,
    planes: &[Vec<f32>],
) -> Result<Image> {
    let window = header.shared_attributes.display_window;
    let [width, height] = [window.size.width(), window.size.height()];
    let stored = header.layer_size;
    let position = header.own_attributes.layer_position;
    let offset = [
        i64::from(position.x()) - i64::from(window.position.x()),
        i64::from(position.y()) - i64::from(window.position.y()),
    ];
    // Columns and rows of the window that are stored.
    let span = |offset: i64, stored: usize, shown: usize| {
        let from = offset.clamp(0, shown as i64);
        let to = (offset + stored as i64).clamp(from, shown as i64);
        from as usize..to as usize
    };
    let columns = span(offset[0], stored.width(), width);
    let rows = span(offset[1], stored.height(), height);
    if columns.is_empty() || rows.is_empty() {
        let why = "none of its pixels lies in its display window; save it uncropped";
        return Err(Error::invalid(path, why));
    }
    let mut pixels = vec![[0f32; 3]; width * height];
    let has_alpha = layer.alpha.is_some();
    let mut alpha = vec![0f32; if has_alpha { width * height } else { 0 }];
    for y in rows.clone() {
        let row = (y as i64 - offset[1]) as usize * stored.width();
        let first = row + (columns.start as i64 - offset[0]) as usize;
        let out = &mut pixels[y * width..][columns.clone()];
        let plane = |c: usize| &planes[c][first..][..columns.len()];
        match layer.colors {
            Colors::Rgb(_) => {
                let colors = plane(0).iter().zip(plane(1)).zip(plane(2));
                for (out, ((r, g), b)) in out.iter_mut().zip(colors) {
                    *out = [*r, *g, *b];
                }
            }
            Colors::Luminance(_) => {
                for (out, y) in out.iter_mut().zip(plane(0)) {
                    *out = [*y; 3];
                }
            }
            Colors::LuminanceChroma(_) => {
                let colors = plane(0).iter().zip(plane(1)).zip(plane(2));
                for (out, ((y, ry), by)) in out.iter_mut().zip(colors) {
                    *out = rgb_of_chroma(*y, *ry, *by);
                }
            }
        }
        if has_alpha {
            let stored = plane(layer.colors.count());
            alpha[y * width..][columns.clone()].copy_from_slice(stored);
        }
    }
    let mut image = Image {
        alpha,
        ..Image::new(width, height, pixels)
    };
    let missing = 1.0 - (columns.len() * rows.len()) as f64 / (width * height) as f64;
    if missing > MISSING_SHARE {
        image.provenance = Provenance {
            warnings: vec![format!(
                "holds {} x {} pixels of an image of {width} x {height}; the rest, {:.0} %, is black",
                stored.width(),
                stored.height(),
                100.0 * missing
            )],
            ..Provenance::default()
        };
    }
    Ok(image)
}

/// Colour of luminance and chroma RY = (R - Y) / Y, BY = (B - Y) / Y ("Technical Introduction to OpenEXR"), of Rec. 709.
fn rgb_of_chroma(y: f32, ry: f32, by: f32) -> [f32; 3] {
    let (r, b) = ((1.0 + ry) * y, (1.0 + by) * y);
    let [wr, wg, wb] = crate::color::LUMINANCE;
    [r, (y - wr * r - wb * b) / wg, b]
}

#[cfg(test)]
mod tests;
