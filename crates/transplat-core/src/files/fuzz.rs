//! Fuzzing of every loader: whatever the bytes are, a file is loaded or refused, and what was loaded can be used.
//!
//! `FUZZ_CASES` says how many broken files each loader gets.

use std::path::{Path, PathBuf};

use proptest::prelude::*;
use proptest::test_runner::TestRunner;

use super::*;
use crate::bake::Bake;
use crate::bake::directional::DirectionalBake;
use crate::environment::Illumination;
use crate::estimate::estimate_light;
use crate::extremes::properties::config;
use crate::files::{
    ExrFloats, PngBits, save_bake, save_estimate, save_look, write_exr, write_layers, write_png,
};
use crate::progress::no_progress;
use crate::rasterize::Raster;
use crate::scene::Scene;
use crate::settings::{Method, TransferSettings};
use crate::surfels::{SurfelCloud, Thickness};
use crate::synthetic;
use crate::transfer::{Part, PreparedTransfer};

/// Files a loader in the tests.
const CASES: u32 = 400;

/// Surfels beyond which a loaded splat is not relit: that says nothing new, and takes time.
const MOST_RELIT: usize = 64;

/// One thing that is wrong with a file; places are shares of its length.
#[derive(Clone, Debug)]
enum Harm {
    Bit(f64, u8),
    Byte(f64, u8),
    Cut(f64),
    Insert(f64, Vec<u8>),
    Remove(f64, usize),
    /// Four bytes of one place to another.
    Copy(f64, f64),
    /// What numbers go wrong with, in text.
    Text(f64, &'static str),
    /// The same in binary.
    Word(f64, u32),
}

fn harm() -> impl Strategy<Value = Harm> {
    let place = || 0f64..1.0;
    let text = prop::sample::select(vec![
        "-1",
        "0",
        "1e39",
        "nan",
        "inf",
        "99999999999",
        "1e400",
        "\n",
        " ",
        "{",
        "]",
        "\"",
        "null",
        "-0",
    ]);
    let word = prop::sample::select(vec![
        0u32,
        1,
        0x7fff_ffff,
        0x8000_0000,
        0xffff_ffff,
        0x7f80_0000,
        0xff80_0000,
        0x7fc0_0000,
        0x0000_0100,
        0x7f00_0000,
    ]);
    prop_oneof![
        4 => (place(), 0u8..8).prop_map(|(p, b)| Harm::Bit(p, b)),
        4 => (place(), any::<u8>()).prop_map(|(p, b)| Harm::Byte(p, b)),
        1 => place().prop_map(Harm::Cut),
        2 => (place(), prop::collection::vec(any::<u8>(), 1..9)).prop_map(|(p, b)| Harm::Insert(p, b)),
        2 => (place(), 1usize..9).prop_map(|(p, n)| Harm::Remove(p, n)),
        2 => (place(), place()).prop_map(|(p, q)| Harm::Copy(p, q)),
        4 => (place(), text).prop_map(|(p, t)| Harm::Text(p, t)),
        4 => (place(), word).prop_map(|(p, w)| Harm::Word(p, w)),
    ]
}

impl Harm {
    fn to(&self, bytes: &mut Vec<u8>) {
        let length = bytes.len();
        let at = |place: f64| (place * length as f64) as usize;
        let over = |bytes: &mut Vec<u8>, start: usize, new: &[u8]| {
            for (b, n) in bytes.iter_mut().skip(start).zip(new) {
                *b = *n;
            }
        };
        match self {
            _ if bytes.is_empty() => {}
            Self::Bit(p, bit) => bytes[at(*p)] ^= 1 << bit,
            Self::Byte(p, b) => bytes[at(*p)] = *b,
            Self::Cut(p) => bytes.truncate(at(*p)),
            Self::Insert(p, new) => {
                let i = at(*p);
                bytes.splice(i..i, new.iter().copied());
            }
            Self::Remove(p, n) => drop(bytes.drain(at(*p)..length.min(at(*p) + n))),
            Self::Copy(p, q) => {
                let (from, to) = (at(*p), at(*q));
                let some = bytes[from..length.min(from + 4)].to_vec();
                over(bytes, to, &some);
            }
            Self::Text(p, text) => over(bytes, at(*p), text.as_bytes()),
            Self::Word(p, word) => over(bytes, at(*p), &word.to_le_bytes()),
        }
    }
}

/// Gives a loader the whole file, which it must take, and broken ones.
fn fuzz<T>(whole: &[u8], load: impl Fn(&Path) -> Result<T>) {
    fuzz_within(whole, <[u8]>::to_vec, load);
}

/// The same for what is packed into a file by `pack`: the harm is done before.
fn fuzz_within<T>(
    whole: &[u8],
    pack: impl Fn(&[u8]) -> Vec<u8>,
    load: impl Fn(&Path) -> Result<T>,
) {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("file");
    std::fs::write(&path, pack(whole)).expect("room for it");
    assert!(load(&path).is_ok(), "the whole file is refused");
    let mut runner = TestRunner::new(config("FUZZ_CASES", CASES));
    // Half of the harm is done to the head, which says what the rest is.
    let strategy = (prop::collection::vec(harm(), 1..6), prop::bool::ANY);
    let result = runner.run(&strategy, |(harms, in_head)| {
        let head = if in_head {
            whole.len().min(400)
        } else {
            whole.len()
        };
        let (mut bytes, rest) = (whole[..head].to_vec(), &whole[head..]);
        for harm in &harms {
            harm.to(&mut bytes);
        }
        bytes.extend(rest);
        std::fs::write(&path, pack(&bytes)).expect("room for it");
        match load(&path) {
            Ok(_) => {}
            Err(error) => prop_assert!(error.to_string().contains("file"), "{error}"),
        }
        Ok(())
    });
    if let Err(error) = result {
        panic!("{error}");
    }
}

fn ply(format: &str) -> Vec<u8> {
    ply_of(6, format, |_, _| {})
}

/// A splat of `n` rows, each changed by `change`: position, DC, opacity, scales, rotation, and nine of the rest.
fn ply_of(n: usize, format: &str, change: impl Fn(usize, &mut Vec<f32>)) -> Vec<u8> {
    let cloud = synthetic::sphere(n);
    let mut text = format!(
        "ply\nformat {format} 1.0\ncomment of the tests\nelement vertex {}\n",
        cloud.len()
    );
    let names = [
        "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "rot_0",
        "rot_1", "rot_2", "rot_3",
    ];
    let rest: Vec<String> = (0..9).map(|i| format!("f_rest_{i}")).collect();
    let all = names.iter().copied().chain(rest.iter().map(String::as_str));
    for name in all {
        text += &format!("property float {name}\n");
    }
    text += "end_header\n";
    let mut bytes = text.into_bytes();
    for (i, p) in cloud.positions.iter().enumerate() {
        let mut row = vec![
            p.x, p.y, p.z, 0.3, 0.2, 0.1, 2.0, -1.0, -1.5, 0.9, 0.1, 0.2, 0.3,
        ];
        row.extend((0..9).map(|i| 0.01 * i as f32));
        change(i, &mut row);
        for v in row {
            if format == "ascii" {
                bytes.extend(format!("{v} ").bytes());
            } else if format == "binary_big_endian" {
                bytes.extend(v.to_be_bytes());
            } else {
                bytes.extend(v.to_le_bytes());
            }
        }
        if format == "ascii" {
            bytes.push(b'\n');
        }
    }
    bytes
}

/// Relights what was loaded by both methods: no number is lost on the way.
fn relit(cloud: &SurfelCloud) {
    if cloud.len() > MOST_RELIT {
        return;
    }
    let lights = [Illumination::even(3), Illumination::even(3).scaled(2.0)];
    for method in Method::ALL {
        let bake = Bake::new(cloud, method, 16, &no_progress).expect("not cancelled");
        let settings = TransferSettings::of(method);
        let prepared = PreparedTransfer::new(cloud, &bake, &lights[0], &settings);
        let relit = prepared
            .and_then(|p| p.relight(&lights[1], Part::Whole))
            .expect("good input");
        let values = relit.sh.iter().chain(&relit.tau).flatten();
        assert!(
            values.into_iter().all(|v| v.is_finite()),
            "{}",
            method.preset()
        );
    }
}

/// What a saving function writes.
fn written(save: impl FnOnce(&Path) -> Result<()>) -> Vec<u8> {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("file");
    save(&path).expect("room for it");
    std::fs::read(&path).expect("it is there")
}

pub fn raster() -> Raster {
    let pixels = (0..32).map(|i| [i as f32, 0.5, 0.25, 1.0]).collect();
    Raster {
        width: 8,
        height: 4,
        pixels,
        depth: vec![0.0; 32],
    }
}

fn light_of(path: &Path) -> Result<()> {
    let map = load_environment(path)?;
    let light = Illumination::of(&map, 3);
    let sum: f32 = light.radiance.coefficients.iter().flatten().sum();
    assert!(sum.is_finite());
    Ok(())
}

#[test]
fn splats() {
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        fuzz(&ply(format), splat);
    }
}

/// Loads and relights a splat.
fn splat(path: &Path) -> Result<()> {
    let (cloud, _) = load_splat(path)?;
    relit(&cloud);
    Ok(())
}

/// A few 3D Gaussians with SH of degree 1.
fn gaussians() -> SurfelCloud {
    let mut cloud = synthetic::glossy_sphere_over_plate(8, 1);
    let thick = |t: &mut Thickness| *t = Thickness::of_gaussian(0.01, true);
    cloud.thicknesses.iter_mut().for_each(thick);
    cloud
}

fn written_as(ending: &str) -> Vec<u8> {
    let cloud = gaussians();
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join(format!("splat{ending}"));
    write_splat(&cloud, &cloud.sh, &path).expect("room for it");
    std::fs::read(&path).expect("it is there")
}

#[test]
fn splats_in_every_format() {
    for (ending, _) in SplatFormat::WRITTEN {
        fuzz(&written_as(ending), splat);
    }
}

#[test]
fn splats_in_spz() {
    fuzz(&spz::tests::frames(1, &[]), splat);
    for version in 1..=3 {
        fuzz_within(&spz::tests::plain(version, 1), spz::tests::gzip, splat);
    }
}

#[test]
fn splats_in_ksplat() {
    for level in 0..=2 {
        fuzz(&ksplat::tests::made(level, 1), splat);
    }
}

#[test]
fn splats_in_sog_by_what_is_said_of_them() {
    let folder = tempfile::tempdir().expect("a folder");
    let bundle = folder.path().join("bundle");
    std::fs::write(&bundle, written_as(".sog")).expect("room for it");
    let file = std::fs::File::open(&bundle).expect("it is there");
    let mut archive = zip::ZipArchive::new(file).expect("a bundle");
    archive.extract(folder.path()).expect("room for it");
    let meta = folder.path().join("meta.json");
    let text = std::fs::read(&meta).expect("it is there");
    fuzz(&text, |path| {
        std::fs::copy(path, &meta).map_err(Error::io(path))?;
        // The harmed one is what is loaded here.
        splat(&meta).map_err(|e| Error::invalid(path, e.to_string()))
    });
}

#[test]
fn splats_in_gltf_of_text() {
    let binary = written_as(".glb");
    let length = |at: usize| u32::from_le_bytes(binary[at..at + 4].try_into().expect("4 bytes"));
    let text = 12 + 8 + length(12) as usize;
    let data = base64::Engine::encode(
        &base64::engine::general_purpose::STANDARD,
        &binary[text + 8..],
    );
    let json = String::from_utf8_lossy(&binary[20..text]).into_owned();
    let uri = format!("{{\"uri\":\"data:application/octet-stream;base64,{data}\",\"byteLength\"");
    let json = json.replacen(
        "\"buffers\":[{\"byteLength\"",
        &format!("\"buffers\":[{uri}"),
        1,
    );
    fuzz(json.as_bytes(), splat);
}

#[test]
fn odd_rows_are_relit_or_left_out() {
    let (opacity, scale, rotation) = (6, 7, 9);
    let bytes = ply_of(60, "binary_little_endian", |i, row| match i {
        0 => row[scale] = f32::NAN,
        1 => row[rotation..rotation + 4].fill(0.0),
        2 => row[opacity] = 50.0,
        3 => row[opacity] = -50.0,
        4 => row[scale..scale + 2].fill(-60.0),
        5 => row[scale..scale + 2].fill(20.0),
        6 => row[opacity] = f32::INFINITY,
        7..10 => row[..3].fill(0.25),
        10..13 => row[..3].copy_from_slice(&[i as f32, 0.0, 0.0]),
        13 => row[3..6].fill(1e4),
        14 => row[0] = 1e6,
        _ => {}
    });
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("odd.ply");
    std::fs::write(&path, bytes).expect("room for it");
    let (cloud, file) = load_splat(&path).expect("most of it is good");
    let skipped_work = &file.report.skipped_work;
    assert!(
        skipped_work.contains(&0) && skipped_work.len() <= 3,
        "{skipped_work:?}"
    );
    relit(&cloud);
}

#[test]
fn environments_in_hdr() {
    let head = "#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE=1.0\n\n-Y 4 +X 8\n";
    let plain: Vec<u8> = (0..32u8).flat_map(|i| [i, 100, 50, 128]).collect();
    fuzz(&[head.as_bytes(), &plain].concat(), light_of);
    // Counts from 129 on are runs of that less 128.
    let row = [
        2u8, 2, 0, 8, 136, 90, 4, 1, 2, 3, 4, 132, 60, 136, 40, 136, 129,
    ];
    fuzz(&[head.as_bytes(), &row.repeat(4)].concat(), light_of);
}

#[test]
fn environments_in_exr() {
    for floats in [ExrFloats::Full, ExrFloats::Half] {
        fuzz(
            &written(|path| write_exr(path, &raster(), floats)),
            light_of,
        );
    }
}

#[test]
fn pictures() {
    let rgba: Vec<[f32; 4]> = raster()
        .pixels
        .iter()
        .map(|p| [0.03 * p[0], 0.5, 0.2, 1.0])
        .collect();
    for bits in [PngBits::Eight, PngBits::Sixteen] {
        fuzz(
            &written(|path| write_png(path, 8, 4, &rgba, bits)),
            light_of,
        );
    }
}

/// Several layers in one part, as renderers write them.
#[test]
fn environments_in_layers() {
    let layer = |name: &str| {
        let channel = |letter: &str| Channel {
            name: format!("{name}{letter}"),
            values: (0..32).map(|i| i as f32).collect(),
        };
        ["R", "G", "B"].map(channel)
    };
    let channels = ["view.AO.", "view.Combined."].map(layer);
    let whole = written(|path| {
        write_layers(
            path,
            [8, 4],
            channels.clone().into_iter().flatten().collect(),
            "{}",
        )
    });
    fuzz(&whole, light_of);
    fuzz(&whole, |path| image_size(path).map(drop));
}

#[test]
fn packed_splats() {
    let plain = ply("ascii");
    fuzz(&spz::tests::gzip(&plain), splat);
    let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    let options = zip::write::SimpleFileOptions::default();
    archive
        .start_file("scan/splat.ply", options)
        .expect("memory");
    std::io::Write::write_all(&mut archive, &plain).expect("memory");
    fuzz(&archive.finish().expect("memory").into_inner(), splat);
}

#[test]
fn tables_of_colours() {
    let text =
        "TITLE \"a\"\nLUT_3D_SIZE 2\nDOMAIN_MIN 0 0 0\nDOMAIN_MAX 1 1 2\nLUT_IN_VIDEO_RANGE\n";
    let colors = "0 0 0\n1 0 0\n0 1 0\n1 1 0\n0 0 1\n1 0 1\n0 1 1\n1 1 1\n";
    fuzz(format!("{text}{colors}").as_bytes(), load_lut);
}

#[test]
fn bakes() {
    let cloud = synthetic::sphere_over_plate(12);
    for method in Method::ALL {
        let bake = Bake::new(&cloud, method, 16, &no_progress).expect("not cancelled");
        let whole = written(|path| save_bake(path, &cloud, &bake));
        let even = Illumination::even(3);
        fuzz(&whole, |path| {
            let bake = load_bake(path, &cloud)?;
            let settings = TransferSettings::of(bake.method());
            let prepared = PreparedTransfer::new(&cloud, &bake, &even, &settings)?;
            let relit = prepared.relight(&even, Part::Whole)?;
            assert!(relit.sh.iter().flatten().all(|v| v.is_finite()));
            Ok(())
        });
    }
}

#[test]
fn estimates() {
    let cloud = synthetic::sphere(200);
    let directional = DirectionalBake::bake(&cloud, &no_progress).expect("not cancelled");
    let estimate = estimate_light(&cloud, &directional, None, &no_progress).expect("not cancelled");
    let whole = written(|path| save_estimate(path, &cloud, &estimate));
    fuzz(&whole, |path| {
        let estimate = load_estimate(path, &cloud)?;
        let map = estimate.light.map(cloud.up);
        assert!(map.pixels().iter().flatten().all(|v| v.is_finite()));
        Ok(())
    });
}

#[test]
fn looks() {
    let mut look = Scene::default();
    look.objects[0].asset = Some(PathBuf::from("a.ply"));
    fuzz(&written(|path| save_look(path, &look)), load_look);
}

#[test]
fn cameras() {
    let row = "[1, 0, 0, 0], [0, 1, 0, -3], [0, 0, 1, 1], [0, 0, 0, 1]";
    let frame = format!("{{\"file_path\": \"a\", \"transform_matrix\": [{row}]}}");
    let text = format!(
        "{{\"camera_angle_x\": 0.7, \"w\": 80, \"h\": 60, \"frames\": [{frame}, {frame}]}}"
    );
    let cloud = synthetic::sphere(20);
    let load = |path: &Path| {
        let file = load_cameras(path)?.placed_for(&cloud);
        assert!(!file.frames.is_empty());
        Ok::<_, Error>(())
    };
    fuzz(text.as_bytes(), load);
    let camera = r#"{"img_name": "a", "width": 80, "height": 60, "position": [0, 1, -3],
        "rotation": [[1, 0, 0], [0, 1, 0], [0, 0, 1]], "fx": 90, "fy": 90}"#;
    fuzz(format!("[{camera}, {camera}]").as_bytes(), load);
}

#[test]
fn cameras_of_colmap() {
    let folder = tempfile::tempdir().expect("a folder");
    let lenses = "1 PINHOLE 200 100 150 150 100 50\n7 OPENCV 80 60 90 90 40 30 0.1 0 0 0\n";
    let images = "2 0.5 0.5 -0.5 0.5 1 2 3 7 b c.jpg\n1 2 -1\n1 1 0 0 0 0 0 4 1 a.jpg\n\n";
    for (harmed, other) in [("images.txt", "cameras.txt"), ("cameras.txt", "images.txt")] {
        let of = |name: &str| if name == "images.txt" { images } else { lenses };
        std::fs::write(folder.path().join(other), of(other)).expect("room for it");
        fuzz(of(harmed).as_bytes(), |path| {
            std::fs::copy(path, folder.path().join(harmed)).map_err(Error::io(path))?;
            let loaded = load_cameras(folder.path());
            // The harmed one is what is loaded here.
            loaded.map_err(|e| Error::invalid(path, e.to_string()))
        });
    }
}
