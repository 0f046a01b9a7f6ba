//! OpenEXR pictures and environments: any channel type and every compression that the `exr` crate reads; other layers are ignored.

mod primaries;

use std::path::Path;

use exr::meta::MetaData;
use exr::prelude::{AnyChannels, FlatSamples, ReadChannels, ReadLayers, read};

use self::primaries::rec_709_from;
use super::read::check_map_size;
use crate::environment::EnvironmentMap;
use crate::error::{Error, Result};
use crate::rasterize::Raster;

pub fn load(path: &Path) -> Result<EnvironmentMap> {
    let picture = load_picture(path)?;
    let pixels = picture.pixels.iter().map(|[r, g, b, _]| [*r, *g, *b]);
    Ok(EnvironmentMap::new(
        picture.width,
        picture.height,
        pixels.collect(),
    ))
}

/// Width and height, as the header of the first layer tells them.
pub fn size(path: &Path) -> Result<[usize; 2]> {
    super::read::open(path)?;
    let meta = MetaData::read_from_file(path, false).map_err(invalid(path))?;
    let size = meta.headers.first().map(|h| h.layer_size);
    let size = size.ok_or_else(|| Error::invalid(path, "OpenEXR: no layer"))?;
    Ok([size.width(), size.height()])
}

fn invalid(path: &Path) -> impl Fn(exr::error::Error) -> Error + '_ {
    move |error| Error::invalid(path, format!("OpenEXR: {error}"))
}

/// Reads a picture as it is: linear, premultiplied, opaque where it has no alpha; no depth.
///
/// # Errors
/// The file cannot be read, is broken or too large, or has no colour.
pub fn load_picture(path: &Path) -> Result<Raster> {
    let invalid = invalid(path);
    let bytes = super::read::open(path)?
        .metadata()
        .map_err(Error::io(path))?
        .len();
    let meta = MetaData::read_from_file(path, false).map_err(&invalid)?;
    // Every layer is checked, because the reader makes room for the first that it can read.
    for header in &meta.headers {
        // The reader divides by it.
        let samples = header.channels.list.iter().map(|c| c.sampling);
        if samples.into_iter().any(|s| s.x() == 0 || s.y() == 0) {
            return Err(Error::invalid(path, "a channel of no pixels"));
        }
        let size = header.layer_size;
        check_map_size(path, size.width(), size.height())?;
        // Deflate packs 1032 to 1 at best, and PXR24 drops a quarter of f32 before it.
        let claimed = header.total_pixel_bytes() as u64;
        if claimed > bytes.saturating_mul(1400) {
            return Err(Error::invalid(
                path,
                format!("claims {claimed} bytes of pixels in a file of {bytes}"),
            ));
        }
    }
    let decode = || {
        read()
            .no_deep_data()
            .largest_resolution_level()
            .all_channels()
            .all_layers()
            .all_attributes()
            .from_file(path)
    };
    // The crate asserts some of what only the file can break, such as the level that a tile says it is of.
    let image = std::panic::catch_unwind(decode)
        .map_err(|_| Error::invalid(path, "OpenEXR: a block is broken"))?
        .map_err(invalid)?;
    let found = image
        .layer_data
        .iter()
        .find_map(|layer| Some((layer, pick_channels(&layer.channel_data)?)));
    let (layer, (channels, alpha)) = found.ok_or_else(|| {
        let names: Vec<String> = image
            .layer_data
            .iter()
            .flat_map(|layer| &layer.channel_data.list)
            .map(|c| c.name.to_string())
            .collect();
        Error::invalid(
            path,
            format!("no R, G and B channels (it has {})", names.join(", ")),
        )
    })?;
    let (width, height) = (layer.size.width(), layer.size.height());
    let window = image.attributes.display_window;
    if window.size != layer.size || window.position != layer.attributes.layer_position {
        return Err(Error::invalid(
            path,
            format!(
                "holds {width} x {height} pixels of a picture of {} x {}; save the whole sphere, uncropped",
                window.size.width(),
                window.size.height()
            ),
        ));
    }
    let mut pixels = vec![[0.0, 0.0, 0.0, 1.0]; width * height];
    for (c, samples) in channels.into_iter().chain(alpha).enumerate() {
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
    if let Some(matrix) = image
        .attributes
        .chromaticities
        .as_ref()
        .and_then(rec_709_from)
    {
        for pixel in &mut pixels {
            let [r, g, b, a] = *pixel;
            // What is no number is told of where the map is made.
            if ![r, g, b].iter().all(|v| v.is_finite()) {
                continue;
            }
            // No light of ours has a colour outside of Rec. 709.
            let rgb = matrix.map(|[x, y, z]| (x * r + y * g + z * b).max(0.0));
            *pixel = [rgb[0], rgb[1], rgb[2], a];
        }
    }
    Ok(Raster {
        width,
        height,
        pixels,
        depth: Vec::new(),
    })
}

/// The channels named R, G and B, in the unnamed group first, then in any; else Y thrice; and the alpha beside them.
fn pick_channels(
    channels: &AnyChannels<FlatSamples>,
) -> Option<([&FlatSamples; 3], Option<&FlatSamples>)> {
    let named = |prefix: &str, letter: &str| {
        channels
            .list
            .iter()
            .find(|c| c.name.eq_case_insensitive(&format!("{prefix}{letter}")))
            .map(|c| &c.sample_data)
    };
    let group = |prefix: &str| {
        let colors = [
            named(prefix, "R")?,
            named(prefix, "G")?,
            named(prefix, "B")?,
        ];
        Some((colors, named(prefix, "A")))
    };
    let prefixes = channels.list.iter().filter_map(|c| {
        let name = c.name.to_string();
        name.rfind('.').map(|dot| name[..=dot].to_owned())
    });
    group("")
        .or_else(|| prefixes.into_iter().find_map(|prefix| group(&prefix)))
        .or_else(|| named("", "Y").map(|y| ([y; 3], named("", "A"))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files::fuzz::raster;
    use crate::files::{ExrFloats, write_exr};
    use exr::prelude::*;

    fn write(
        channels: Vec<(&str, FlatSamples)>,
        compression: Compression,
    ) -> tempfile::NamedTempFile {
        let file = tempfile::NamedTempFile::new().expect("a temporary file");
        let list = channels
            .into_iter()
            .map(|(name, samples)| AnyChannel::new(name, samples))
            .collect();
        let encoding = Encoding {
            compression,
            ..Encoding::default()
        };
        let layer = Layer::new(
            (4, 2),
            LayerAttributes::named("test"),
            encoding,
            AnyChannels::sort(list),
        );
        Image::from_layer(layer)
            .write()
            .to_file(file.path())
            .expect("room for it");
        file
    }

    fn ramp(start: f32) -> Vec<f32> {
        (0..8).map(|i| start + i as f32).collect()
    }

    #[test]
    fn every_sample_type_compression_and_naming() {
        let half = |start| FlatSamples::F16(ramp(start).into_iter().map(f16::from_f32).collect());
        let full = |start| FlatSamples::F32(ramp(start));
        let integer = |start: f32| FlatSamples::U32((0..8).map(|i| start as u32 + i).collect());
        for compression in [
            Compression::Uncompressed,
            Compression::RLE,
            Compression::ZIP1,
            Compression::ZIP16,
            Compression::PIZ,
        ] {
            for prefix in ["", "ViewLayer.Combined."] {
                let name = |letter: &str| format!("{prefix}{letter}");
                let (r, g, b, a) = (name("R"), name("G"), name("B"), name("A"));
                for samples in [
                    [half(0.0), full(10.0), integer(20.0)],
                    [full(0.0), half(10.0), full(20.0)],
                ] {
                    let [red, green, blue] = samples;
                    let file = write(
                        vec![
                            (&r, red),
                            (&g, green),
                            (&b, blue),
                            (&a, full(0.0)),
                            ("Depth.Z", full(99.0)),
                        ],
                        compression,
                    );
                    let map = load(file.path()).expect("a good file");
                    assert_eq!((map.width(), map.height()), (4, 2));
                    assert_eq!(
                        map.pixels()[5],
                        [5.0, 15.0, 25.0],
                        "{compression:?} {prefix}"
                    );
                }
            }
        }
    }

    #[test]
    fn no_word_of_a_file_that_says_one_is_a_panic() {
        let good = tempfile::NamedTempFile::new().expect("a temporary file");
        write_exr(good.path(), &raster(), ExrFloats::Half).expect("room for it");
        let bytes = std::fs::read(good.path()).expect("just written");
        let mut refused = 0;
        for i in 0..bytes.len() - 3 {
            let mut broken = bytes.clone();
            broken[i..i + 4].copy_from_slice(&1u32.to_le_bytes());
            let file = tempfile::NamedTempFile::new().expect("a temporary file");
            std::fs::write(file.path(), broken).expect("room for it");
            refused += usize::from(load(file.path()).is_err());
        }
        assert!(refused > 50, "{refused}");
    }

    #[test]
    fn colours_of_other_primaries_become_ours() {
        let channel =
            |name: &str, values: [f32; 2]| AnyChannel::new(name, FlatSamples::F32(values.to_vec()));
        let list = [
            channel("R", [1.0, 1.0]),
            channel("G", [1.0, 0.0]),
            channel("B", [1.0, 0.0]),
        ];
        let list = AnyChannels::sort(list.into_iter().collect());
        let layer = Layer::new(
            (2, 1),
            LayerAttributes::default(),
            Encoding::default(),
            list,
        );
        let mut image = Image::from_layer(layer);
        // Those of ITU-R BT.2020.
        image.attributes.chromaticities = Some(attribute::Chromaticities {
            red: Vec2(0.708, 0.292),
            green: Vec2(0.170, 0.797),
            blue: Vec2(0.131, 0.046),
            white: Vec2(0.3127, 0.3290),
        });
        let file = tempfile::NamedTempFile::new().expect("a temporary file");
        image.write().to_file(file.path()).expect("room for it");
        let map = load(file.path()).expect("a good file");
        let near = |a: [f32; 3], b: [f32; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-3);
        assert!(near(map.pixels()[0], [1.0; 3]), "{:?}", map.pixels()[0]);
        // ITU-R BT.2407: green and blue would be less than none.
        assert!(
            near(map.pixels()[1], [1.6605, 0.0, 0.0]),
            "{:?}",
            map.pixels()[1]
        );
    }

    #[test]
    fn grey_is_grey_and_no_colour_is_an_error() {
        let grey = write(vec![("Y", FlatSamples::F32(ramp(3.0)))], Compression::ZIP16);
        assert_eq!(
            load(grey.path()).expect("a good file").pixels()[0],
            [3.0; 3]
        );
        let depth = write(vec![("Z", FlatSamples::F32(ramp(3.0)))], Compression::ZIP16);
        let message = load(depth.path()).expect_err("no colour").to_string();
        assert!(
            message.contains("no R, G and B") && message.contains('Z'),
            "{message}"
        );
    }

    #[test]
    fn broken_files_are_errors() {
        let file = write(vec![("Y", FlatSamples::F32(ramp(0.0)))], Compression::PIZ);
        let good = std::fs::read(file.path()).expect("it is there");
        for i in 0..good.len() {
            let mut broken = good.clone();
            broken[i] ^= 0x55;
            std::fs::write(file.path(), &broken).expect("room for it");
            // An error or a map, but neither a panic nor a claim that is believed.
            if let Ok(map) = load(file.path()) {
                assert!(map.pixels().len() <= 1 << 20);
            }
            std::fs::write(file.path(), &good[..i]).expect("room for it");
            assert!(load(file.path()).is_err(), "cut to {i} bytes");
        }
    }
}
