use exr::image::{Image as File, Layer as Part};

use super::super::load_environment;
use super::*;
use crate::files::fuzz::raster;
use crate::files::{ExrFloats, write_exr};
use exr::prelude::{
    AnyChannel, AnyChannels, Blocks, Compression, Encoding, FlatSamples, LayerAttributes,
    LineOrder, Vec2, WritableImage, attribute, f16,
};

fn load(path: &Path) -> Result<crate::environment::EnvironmentMap> {
    load_environment(path)
}

fn write(channels: Vec<(&str, FlatSamples)>, compression: Compression) -> tempfile::NamedTempFile {
    let file = tempfile::NamedTempFile::new().expect("a temporary file");
    let list = channels
        .into_iter()
        .map(|(name, samples)| AnyChannel::new(name, samples))
        .collect();
    let encoding = Encoding {
        compression,
        ..Encoding::default()
    };
    let layer = Part::new(
        (4, 2),
        LayerAttributes::named("test"),
        encoding,
        AnyChannels::sort(list),
    );
    File::from_layer(layer)
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
    let layer = Part::new(
        (2, 1),
        LayerAttributes::default(),
        Encoding::default(),
        list,
    );
    let mut image = File::from_layer(layer);
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

fn channel(name: &str, value: f32) -> AnyChannel<FlatSamples> {
    AnyChannel::new(name, FlatSamples::F32(vec![value; 8]))
}

fn channels(each: &[(&str, f32)]) -> AnyChannels<FlatSamples> {
    AnyChannels::sort(each.iter().map(|(name, v)| channel(name, *v)).collect())
}

/// A file with those parts: the name of each, and its channels, each of one value.
fn parts(each: &[(&str, &[(&str, f32)])]) -> tempfile::NamedTempFile {
    let part = |(name, of): &(&str, &[(&str, f32)])| {
        let encoding = Encoding {
            compression: Compression::ZIP1,
            blocks: Blocks::ScanLines,
            line_order: LineOrder::Increasing,
        };
        Part::new(
            (4, 2),
            LayerAttributes::named(*name),
            encoding,
            channels(of),
        )
    };
    let window = attribute::IntegerBounds::from_dimensions((4, 2));
    let file = tempfile::NamedTempFile::new().expect("a temporary file");
    File::from_layers(
        exr::prelude::ImageAttributes::new(window),
        each.iter().map(part).collect::<Vec<_>>(),
    )
    .write()
    .to_file(file.path())
    .expect("room for it");
    file
}

#[test]
fn the_layer_that_is_the_image_is_read_and_the_others_are_named() {
    let rgb = |prefix: &str, v: f32| -> Vec<(String, f32)> {
        ["R", "G", "B"]
            .map(|c| (format!("{prefix}{c}"), v))
            .to_vec()
    };
    let of = |groups: &[(&str, f32)]| {
        let all: Vec<(String, f32)> = groups.iter().flat_map(|(p, v)| rgb(p, *v)).collect();
        let all: Vec<(&str, f32)> = all.iter().map(|(n, v)| (n.as_str(), *v)).collect();
        parts(&[("main", &all)])
    };
    // As Blender, renderers and compositors name them; the value 7 is the image.
    for groups in [
        &[
            ("View.AO.", 1.0),
            ("View.Combined.", 7.0),
            ("View.DiffCol.", 2.0),
        ][..],
        &[("albedo.", 1.0), ("Beauty.", 7.0)],
        &[("A.", 1.0), ("", 7.0)],
        &[("crypto00.", 1.0), ("specular.", 7.0)],
        &[("rgba.", 7.0)],
    ] {
        let file = of(groups);
        let image = super::load(file.path(), None).expect("a good file");
        assert_eq!(image.pixels[3], [7.0; 3], "{groups:?}");
        assert_eq!(image.provenance.layers.len() > 1, groups.len() > 1);
        assert_eq!(
            image.provenance.warnings.len(),
            usize::from(groups.len() > 1)
        );
    }
    let several = of(&[("View.AO.", 1.0), ("View.Combined.", 7.0)]);
    for name in ["View.AO", "ao"] {
        let image = super::load(several.path(), Some(name)).expect("it is there");
        assert_eq!(
            (image.pixels[0], image.provenance.warnings.len()),
            ([1.0; 3], 0)
        );
    }
    let why = super::load(several.path(), Some("Z"))
        .expect_err("none")
        .to_string();
    assert!(
        why.contains("no layer \"Z\"") && why.contains("View.AO"),
        "{why}"
    );
}

#[test]
fn the_part_that_is_the_image_is_read() {
    let rgb = |v: f32| [("R", v), ("G", v), ("B", v)];
    let file = parts(&[
        ("albedo", &rgb(1.0)),
        ("beauty", &rgb(7.0)),
        ("depth", &[("Z", 3.0)]),
    ]);
    let image = super::load(file.path(), None).expect("a good file");
    assert_eq!(image.pixels[0], [7.0; 3]);
    assert_eq!(image.provenance.layers, ["albedo", "beauty"]);
    let other = super::load(file.path(), Some("albedo")).expect("it is there");
    assert_eq!(other.pixels[0], [1.0; 3]);
}

#[test]
fn colours_are_found_however_they_are_called() {
    for names in [
        ["rgba.red", "rgba.green", "rgba.blue"],
        ["red", "green", "blue"],
        ["r", "g", "b"],
    ] {
        let each: Vec<(&str, f32)> = names.into_iter().zip([1.0, 2.0, 3.0]).collect();
        let map = load(parts(&[("main", &each)]).path()).expect("a good file");
        assert_eq!(map.pixels()[0], [1.0, 2.0, 3.0], "{names:?}");
    }
    // Luminance and chroma of one resolution: of a grey they are its luminance and nothing.
    let grey = parts(&[("main", &[("Y", 0.5), ("RY", 0.0), ("BY", 0.0)])]);
    let [r, g, b] = load(grey.path()).expect("a good file").pixels()[0];
    assert!(
        [r, g, b].iter().all(|v| (v - 0.5).abs() < 1e-5),
        "{r} {g} {b}"
    );
}

#[test]
fn what_lies_outside_of_the_stored_pixels_is_black_and_what_is_too_much_is_cut() {
    let image = |position: (i32, i32)| {
        let attributes = LayerAttributes {
            layer_position: Vec2(position.0, position.1),
            ..LayerAttributes::default()
        };
        let each = channels(&[("R", 1.0), ("G", 1.0), ("B", 1.0)]);
        let layer = Part::new((4, 2), attributes, Encoding::default(), each);
        let mut image = File::from_layer(layer);
        image.attributes.display_window = attribute::IntegerBounds::from_dimensions((6, 3));
        let file = tempfile::NamedTempFile::new().expect("a temporary file");
        image.write().to_file(file.path()).expect("room for it");
        super::load(file.path(), None)
    };
    let lit = |image: &Image| -> Vec<usize> {
        let pixels = image.pixels.iter().enumerate();
        pixels.filter(|(_, p)| p[0] > 0.0).map(|(i, _)| i).collect()
    };
    let within = image((1, 1)).expect("a good file");
    assert_eq!((within.width, within.height), (6, 3));
    assert_eq!(lit(&within), [7, 8, 9, 10, 13, 14, 15, 16]);
    assert!(within.provenance.warnings[0].contains("is black"));
    let beyond = image((-2, -1)).expect("a good file");
    assert_eq!(lit(&beyond), [0, 1]);
    let why = image((40, 0)).expect_err("nothing is seen").to_string();
    assert!(why.contains("display window"), "{why}");
}

#[test]
fn what_is_infinitely_bright_is_very_bright() {
    let sun = parts(&[("main", &[("R", f32::INFINITY), ("G", 2.0), ("B", f32::NAN)])]);
    let map = load(sun.path()).expect("a good file");
    assert_eq!(
        map.pixels()[0],
        [crate::environment::INFINITE_RADIANCE, 2.0, 0.0]
    );
    let sun = parts(&[("main", &[("R", f32::INFINITY), ("G", 2.0), ("B", 0.0)])]);
    let map = load(sun.path()).expect("a good file");
    assert_eq!((map.infinite(), map.repaired()), (8, 0));
}

/// A cube of the `envmap` attribute holds the same directions as a panorama of it.
#[test]
fn a_cube_by_its_attribute_is_read_as_one() {
    let edge = 16;
    // OpenEXR's axes: +Y is up, and the middle of its panoramas looks along +Z, which is +X here.
    let faces: [fn(f32, f32) -> [f32; 3]; 6] = [
        |a, b| [1.0, b, a],
        |a, b| [-1.0, b, -a],
        |a, b| [a, 1.0, b],
        |a, b| [a, -1.0, -b],
        |a, b| [-a, b, 1.0],
        |a, b| [a, b, -1.0],
    ];
    let at = |i: usize| {
        let on = |v: usize| 2.0 * v as f32 / (edge - 1) as f32 - 1.0;
        let (x, y) = (on(i % edge), -on(i / edge % edge));
        let [ex, ey, ez] = faces[i / (edge * edge)](x, y);
        glam::Vec3::new(ez, ex, ey).normalize()
    };
    let count = 6 * edge * edge;
    let plane = |c: usize| FlatSamples::F32((0..count).map(|i| 1.5 + at(i)[c]).collect());
    let list = ["R", "G", "B"].into_iter().enumerate();
    let list = list
        .map(|(c, name)| AnyChannel::new(name, plane(c)))
        .collect();
    let attributes = LayerAttributes {
        environment_map: Some(attribute::EnvironmentMap::Cube),
        ..LayerAttributes::default()
    };
    let layer = Part::new(
        (edge, 6 * edge),
        attributes,
        Encoding::default(),
        AnyChannels::sort(list),
    );
    let file = tempfile::NamedTempFile::new().expect("a temporary file");
    File::from_layer(layer)
        .write()
        .to_file(file.path())
        .expect("room for it");
    let map = load(file.path()).expect("a good file");
    assert_eq!(map.layout(), Layout::CubeColumn);
    for row in 0..map.height() {
        for column in 0..map.width() {
            let there = map.direction(column, row).map(|v| 1.5 + v as f32);
            let found = map.pixels()[row * map.width() + column];
            // A pixel is 6 degrees wide, and colour is constant half a pixel from an edge on.
            let off = (0..3)
                .map(|c| (found[c] - there[c]).abs())
                .fold(0.0, f32::max);
            assert!(off < 0.08, "{column} {row}: {found:?} {there:?}");
        }
    }
}

/// Headers of deep parts are read, their pixels are not.
#[test]
fn deep_pixels_are_an_error_that_says_so() {
    let mut file = vec![0x76, 0x2f, 0x31, 0x01, 2, 8, 0, 0];
    let mut put = |name: &str, kind: &str, value: &[u8]| {
        file.extend(name.bytes().chain([0]).chain(kind.bytes()).chain([0]));
        file.extend((value.len() as i32).to_le_bytes());
        file.extend(value);
    };
    let ints =
        |values: &[i32]| -> Vec<u8> { values.iter().flat_map(|v| v.to_le_bytes()).collect() };
    let mut list = Vec::new();
    for name in ["A", "Z"] {
        list.extend(name.bytes().chain([0]));
        list.extend(ints(&[2, 0, 1, 1]));
    }
    list.push(0);
    put("channels", "chlist", &list);
    put("compression", "compression", &[0]);
    put("dataWindow", "box2i", &ints(&[0, 0, 3, 1]));
    put("displayWindow", "box2i", &ints(&[0, 0, 3, 1]));
    put("lineOrder", "lineOrder", &[0]);
    put("pixelAspectRatio", "float", &1f32.to_le_bytes());
    put("screenWindowCenter", "v2f", &[0; 8]);
    put("screenWindowWidth", "float", &1f32.to_le_bytes());
    put("type", "string", b"deepscanline");
    put("name", "string", b"deep");
    put("version", "int", &ints(&[1]));
    put("chunkCount", "int", &ints(&[2]));
    put("maxSamplesPerPixel", "int", &ints(&[4]));
    file.push(0);
    file.extend([0; 64]);
    let path = tempfile::NamedTempFile::new().expect("a temporary file");
    std::fs::write(path.path(), file).expect("room for it");
    let why = load(path.path()).expect_err("deep").to_string();
    assert!(why.contains("deep pixels"), "{why}");
}
