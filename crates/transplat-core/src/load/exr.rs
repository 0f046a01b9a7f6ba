//! OpenEXR environments: any channel type and every compression that the `exr` crate reads; alpha and other layers are ignored.

use std::path::Path;

use exr::meta::MetaData;
use exr::prelude::{AnyChannels, FlatSamples, ReadChannels, ReadLayers, read};

use super::check_map_size;
use crate::environment::EnvironmentMap;
use crate::error::{Error, Result};

pub fn load(path: &Path) -> Result<EnvironmentMap> {
    let told = |error: exr::error::Error| Error::invalid(path, format!("OpenEXR: {error}"));
    let bytes = super::open(path)?
        .metadata()
        .map_err(Error::io(path))?
        .len();
    let meta = MetaData::read_from_file(path, false).map_err(told)?;
    // Every layer is checked, because the reader makes room for the first that it can read.
    for header in &meta.headers {
        let size = header.layer_size;
        check_map_size(path, size.width(), size.height())?;
        // No lossless compression of the format exceeds deflate's 1032 to 1.
        let claimed = header.total_pixel_bytes() as u64;
        if claimed > bytes.saturating_mul(1100) {
            return Err(Error::invalid(
                path,
                format!("claims {claimed} bytes of pixels in a file of {bytes}"),
            ));
        }
    }
    let image = read()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .from_file(path)
        .map_err(told)?;
    let layer = image.layer_data;
    let (width, height) = (layer.size.width(), layer.size.height());
    let channels = pick_channels(&layer.channel_data).ok_or_else(|| {
        let names: Vec<String> = layer
            .channel_data
            .list
            .iter()
            .map(|c| c.name.to_string())
            .collect();
        Error::invalid(
            path,
            format!("no R, G and B channels (it has {})", names.join(", ")),
        )
    })?;
    let mut pixels = vec![[0f32; 3]; width * height];
    for (c, samples) in channels.into_iter().enumerate() {
        if samples.len() != pixels.len() {
            return Err(Error::invalid(
                path,
                "colour channels of reduced resolution are not supported; save it as plain RGB",
            ));
        }
        for (pixel, value) in pixels.iter_mut().zip(samples.values_as_f32()) {
            pixel[c] = value;
        }
    }
    Ok(EnvironmentMap::new(width, height, pixels))
}

/// The channels named R, G and B, in the unnamed group first, then in any; else Y thrice.
fn pick_channels(channels: &AnyChannels<FlatSamples>) -> Option<[&FlatSamples; 3]> {
    let named = |prefix: &str, letter: &str| {
        channels
            .list
            .iter()
            .find(|c| c.name.eq_case_insensitive(&format!("{prefix}{letter}")))
            .map(|c| &c.sample_data)
    };
    let group = |prefix: &str| {
        Some([
            named(prefix, "R")?,
            named(prefix, "G")?,
            named(prefix, "B")?,
        ])
    };
    let prefixes = channels.list.iter().filter_map(|c| {
        let name = c.name.to_string();
        name.rfind('.').map(|dot| name[..=dot].to_owned())
    });
    group("")
        .or_else(|| prefixes.into_iter().find_map(|prefix| group(&prefix)))
        .or_else(|| named("", "Y").map(|y| [y; 3]))
}
