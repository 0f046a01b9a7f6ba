use std::path::PathBuf;

use glam::{Mat3, Quat, Vec2, Vec3};

use super::*;
use crate::color::Encoding;
use crate::files::{FileKind, SplatFile, file_kind, load_splat, write_relit, write_splat};
use crate::sh::coefficient_count;
use crate::surfels::Thickness;
use crate::synthetic;

/// 3D Gaussians of many sizes, turns, opacities and colours, with SH of a degree.
fn gaussians(n: usize, degree: usize) -> SurfelCloud {
    let points = crate::sh::lattice(n);
    let mut cloud = synthetic::from_points(&points, &points, 0.1);
    let wave = |i: usize, step: f32| (i as f32 * step).sin();
    for i in 0..n {
        cloud.positions[i] = points[i] * (1.5 + wave(i, 0.7)) + Vec3::new(0.3, -2.0, 0.1);
        let axis = Vec3::new(1.1 + wave(i, 1.1), wave(i, 2.3), wave(i, 3.7)).normalize();
        let turn = Mat3::from_quat(Quat::from_axis_angle(axis, i as f32));
        cloud.tangents[i] = [turn.x_axis, turn.y_axis];
        cloud.scales[i] = 0.05 * Vec2::new((wave(i, 0.9)).exp(), (1.0 + wave(i, 1.9)).exp());
        cloud.thicknesses[i] = Thickness::of_gaussian(0.01 * (0.5 * wave(i, 2.9)).exp(), true);
        cloud.opacities[i] = 0.5 + 0.45 * wave(i, 5.3);
    }
    let k = coefficient_count(degree);
    cloud.sh_degree = degree;
    cloud.encoding = Encoding::Stored;
    cloud.up = UpAxis::MinusY;
    cloud.sh = (0..n * k)
        .map(|i| {
            let size = if i % k == 0 { 1.2 } else { 0.3 };
            std::array::from_fn(|c| size * wave(i * 3 + c, 0.37))
        })
        .collect();
    cloud
}

struct Made {
    folder: tempfile::TempDir,
    name: PathBuf,
}

/// Writes a splat under a name with that ending and reads it again.
fn through(cloud: &SurfelCloud, ending: &str) -> (Made, SurfelCloud, SplatFile) {
    let folder = tempfile::tempdir().expect("a folder");
    let name = folder.path().join(format!("splat{ending}"));
    write_splat(cloud, &cloud.sh, &name).expect("room for it");
    let (back, asset) = load_splat(&name).expect("what was written is read");
    assert_eq!(
        (back.len(), asset.report.vertices),
        (cloud.len(), cloud.len())
    );
    (Made { folder, name }, back, asset)
}

/// The covariance of a Gaussian: what its axes are without their order and signs.
fn covariance(cloud: &SurfelCloud, i: usize) -> Mat3 {
    let [u, v] = cloud.tangents[i];
    let turn = Mat3::from_cols(u, v, u.cross(v));
    let scales = cloud.scales[i].extend(cloud.thicknesses[i].sigma());
    turn * Mat3::from_diagonal(scales * scales) * turn.transpose()
}

/// How far a splat is from another: positions, relative covariance, opacities, colours, higher SH.
fn distances(a: &SurfelCloud, b: &SurfelCloud, rows: &SplatFile, degree: usize) -> [f32; 5] {
    let mut most = [0f32; 5];
    let k = coefficient_count(degree);
    for i in 0..a.len() {
        let j = rows.surfel_of(i).expect("it was written");
        let (was, is) = (covariance(a, i), covariance(b, j));
        let apart = [was - is, was].map(|m| m.to_cols_array().map(|v| v * v).iter().sum::<f32>());
        let sh = a.sh_of(i)[..k].iter().zip(b.sh_of(j));
        let sh = sh.map(|(a, b)| Vec3::from_array(*a) - Vec3::from_array(*b));
        let sh: Vec<f32> = sh.map(|v| v.abs().max_element()).collect();
        let each = [
            a.positions[i].distance(b.positions[j]),
            (apart[0] / apart[1]).sqrt(),
            (a.opacities[i] - b.opacities[j]).abs(),
            sh[0],
            sh[1..].iter().copied().fold(0.0, f32::max),
        ];
        most.iter_mut().zip(each).for_each(|(m, e)| *m = m.max(e));
    }
    most
}

#[test]
fn every_format_gives_back_what_it_was_given_within_its_quantum() {
    let byte = 0.5 / 255.0;
    // A step of a byte is that in an SH coefficient of degree 0.
    let dc = byte / 0.282;
    // Positions span 7, at most; a rotation by an angle turns the covariance by twice that.
    for (ending, degree, limits) in [
        (".ply", 5, [1e-6, 1e-4, 1e-6, 1e-6, 1e-6]),
        (".glb", 3, [1e-6, 1e-4, 1e-6, 1e-6, 1e-6]),
        // 6 % in steps of the logarithm, half of it either way and squared; rotations of 9 bits.
        (".spz", 4, [1e-6, 0.08, byte, byte / 0.15, 0.5 / 128.0]),
        // 11 bits of the chunk's range, here of the whole object.
        (
            ".compressed.ply",
            3,
            [7.0 / 1023.0, 0.03, byte, 2.0 * dc, 8.0 / 512.0],
        ),
        // 16 bits of logarithms up to ln 5; 256 scales of a range of some 4; rotations of 8 bits.
        (".sog", 3, [5.0 * 4.0 / 65535.0, 0.05, byte, 0.01, 0.02]),
        (".splat", 0, [1e-6, 0.04, byte, dc, 0.0]),
    ] {
        let cloud = gaussians(600, degree);
        let (_made, back, asset) = through(&cloud, ending);
        assert_eq!(back.sh_degree, degree, "{ending}");
        let found = distances(&cloud, &back, &asset, degree);
        println!("{ending}: {found:?}");
        for (found, limit) in found.iter().zip(limits) {
            assert!(*found <= 1.001 * limit, "{ending}: {found} of {limit}");
        }
        let marked = back.thicknesses.iter().all(|t| t.is_antialiased());
        assert_eq!(marked, ![".splat", ".glb"].contains(&ending), "{ending}");
    }
}

#[test]
fn what_was_packed_once_is_packed_again_without_loss() {
    let cloud = gaussians(300, 2);
    for (ending, _) in SplatFormat::WRITTEN {
        let (_made, once, _) = through(&cloud, ending);
        let (_made, twice, asset) = through(&once, ending);
        let found = distances(&once, &twice, &asset, once.sh_degree);
        // A turn may be rounded again where its axes have changed their places; ranges and codebooks are found anew.
        let limits = match ending {
            ".sog" => [1e-3, 0.05, 1e-6, 0.01, 0.02],
            ".compressed.ply" => [7.0 / 1023.0, 0.03, 1e-6, 0.02, 1e-6],
            _ => [1e-6, 0.03, 1e-6, 1e-6, 1e-6],
        };
        for (found, limit) in found.iter().zip(limits) {
            assert!(*found <= limit, "{ending}: {found} of {limit}");
        }
    }
}

#[test]
fn formats_are_known_by_what_they_hold() {
    let cloud = gaussians(40, 1);
    for (ending, format) in SplatFormat::WRITTEN {
        let (made, _, asset) = through(&cloud, ending);
        assert_eq!(asset.format, format, "{ending}");
        // Under the name of another.
        let other = made.folder.path().join("misnamed.png");
        std::fs::copy(&made.name, &other).expect("room for it");
        let (_, asset) = load_splat(&other).expect("the same");
        assert_eq!(asset.format, format, "{ending}");
        assert!(matches!(file_kind(&other), Ok(FileKind::Splat(_))));
        assert_eq!(SplatFormat::of_name(&made.name), Some(format));
    }
}

#[test]
fn a_file_that_is_cut_anywhere_is_refused() {
    let cloud = gaussians(60, 1);
    for (ending, format) in SplatFormat::WRITTEN {
        let (made, ..) = through(&cloud, ending);
        let bytes = std::fs::read(&made.name).expect("it is there");
        let cuts = (0..40)
            .map(|i| i * bytes.len() / 40)
            .chain(bytes.len() - 12..bytes.len());
        for cut in cuts {
            // Nothing tells how many rows a .splat had.
            if format == SplatFormat::Splat && cut.is_multiple_of(32) && cut > 0 {
                continue;
            }
            let name = made.folder.path().join("cut");
            std::fs::write(&name, &bytes[..cut]).expect("room for it");
            let message = load_splat(&name).expect_err("it is cut").to_string();
            assert!(!message.is_empty(), "{ending} at {cut}");
        }
    }
}

#[test]
fn a_relit_splat_keeps_its_format_or_takes_the_one_that_is_asked_for() {
    let mut cloud = gaussians(50, 2);
    cloud.up = UpAxis::PlusY;
    let (made, back, asset) = through(&cloud, ".spz");
    let relit: Vec<[f32; 3]> = back.sh.iter().map(|f| f.map(|v| 0.5 * v)).collect();
    for (name, format, up) in [
        ("relit", SplatFormat::Spz, UpAxis::PlusY),
        ("relit.glb", SplatFormat::Gltf, UpAxis::PlusY),
        ("relit.ply", SplatFormat::Ply, UpAxis::MinusY),
    ] {
        let to = made.folder.path().join(name);
        write_relit(&asset, &back, &relit, &to).expect("room for it");
        let (again, file) = load_splat(&to).expect("what was written is read");
        assert_eq!((file.format, again.up), (format, up));
        // Upright there as here: what is up is as high.
        for row in 0..50 {
            let (i, j) = (asset.surfel_of(row), file.surfel_of(row));
            let (i, j) = (i.expect("a row"), j.expect("a row"));
            let heights = [back.positions[i].y, again.positions[j].dot(up.direction())];
            assert!(
                (heights[0] - heights[1]).abs() < 1e-4,
                "{name}: {heights:?}"
            );
        }
    }
}

#[test]
fn a_made_up_count_allocates_nothing() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("claims");
    let mut spz = b"NGSP\x04\0\0\0".to_vec();
    spz.extend(u32::MAX.to_le_bytes());
    spz.extend([3, 12, 0, 6]);
    spz.extend(32u32.to_le_bytes());
    spz.extend([0; 12 + 96]);
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::best());
    let mut head = b"NGSP\x03\0\0\0".to_vec();
    head.extend(100_000_000u32.to_le_bytes());
    head.extend([0, 12, 0, 0]);
    gzip.write_all(&head).expect("memory");
    gzip.write_all(&vec![0; 1 << 24]).expect("memory");
    let mut ksplat = vec![0; 4096 + 1024];
    ksplat[1] = 1;
    for at in [4, 8] {
        ksplat[at] = 1;
    }
    for at in [12, 16, 4096, 4100] {
        ksplat[at..at + 4].copy_from_slice(&u32::MAX.to_le_bytes());
    }
    for bytes in [spz, gzip.finish().expect("memory"), ksplat] {
        std::fs::write(&path, bytes).expect("room for it");
        let message = load_splat(&path)
            .expect_err("nobody holds that")
            .to_string();
        assert!(message.contains("claims"), "{message}");
    }
}

/// One splat in a gzip stream or an archive, in whatever folder, is that splat; and it is written again from there.
#[test]
fn what_packs_one_splat_is_that_splat() {
    let cloud = gaussians(40, 0);
    let folder = tempfile::tempdir().expect("a folder");
    let plain = folder.path().join("splat.ply");
    write_splat(&cloud, &cloud.sh, &plain).expect("room for it");
    let bytes = std::fs::read(&plain).expect("it is there");
    let zip = |files: &[(&str, &[u8])]| {
        let mut archive = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        for (name, bytes) in files {
            let options = zip::write::SimpleFileOptions::default();
            archive.start_file(*name, options).expect("memory");
            Write::write_all(&mut archive, bytes).expect("memory");
        }
        archive.finish().expect("memory").into_inner()
    };
    let (plain, _) = load_splat(&plain).expect("a good file");
    let packed = [
        spz::tests::gzip(&bytes),
        zip(&[("scan/point_cloud.ply", &bytes)]),
        zip(&[
            ("__MACOSX/._a.ply", b"x"),
            ("a.ply", &bytes),
            (".DS_Store", b""),
        ]),
    ];
    for packed in packed {
        let path = folder.path().join("packed");
        std::fs::write(&path, packed).expect("room for it");
        assert_eq!(
            file_kind(&path).ok(),
            Some(FileKind::Splat(SplatFormat::Ply))
        );
        let (back, asset) = load_splat(&path).expect("a good file");
        assert_eq!(back.positions, plain.positions);
        let out = folder.path().join("out.ply");
        write_relit(&asset, &back, &back.sh, &out).expect("room for it");
        assert_eq!(std::fs::read(&out).ok().as_deref(), Some(&bytes[..]));
    }
    let several = zip(&[("a.ply", &bytes), ("b.ply", &bytes)]);
    let path = folder.path().join("several");
    std::fs::write(&path, several).expect("room for it");
    let why = load_splat(&path).expect_err("two").to_string();
    assert!(
        why.contains("2 files") && why.contains("a.ply, b.ply"),
        "{why}"
    );
}

/// A bundle may have its files in a folder, and another word for the degree of its palette.
#[test]
fn a_bundle_is_found_below_a_folder() {
    let (made, cloud, _) = through(&gaussians(40, 1), ".sog");
    let file = std::fs::File::open(&made.name).expect("it is there");
    let mut archive = zip::ZipArchive::new(file).expect("a bundle");
    let mut below = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for i in 0..archive.len() {
        let mut file = archive.by_index(i).expect("a file");
        let mut bytes = Vec::new();
        std::io::Read::read_to_end(&mut file, &mut bytes).expect("whole");
        let name = format!("scene/{}", file.name().expect("a name"));
        if name.ends_with("meta.json") {
            let text = String::from_utf8(bytes).expect("text");
            assert!(text.contains("\"bands\":1"), "{text}");
            bytes = text.replace("\"bands\":1", "\"bands\":0").into();
        }
        let options = zip::write::SimpleFileOptions::default();
        below.start_file(name, options).expect("memory");
        Write::write_all(&mut below, &bytes).expect("memory");
    }
    let bytes = below.finish().expect("memory").into_inner();
    let path = made.folder.path().join("below.zip");
    std::fs::write(&path, bytes).expect("room for it");
    let (back, asset) = load_splat(&path).expect("a good file");
    assert_eq!((back.len(), back.sh_degree), (cloud.len(), 1));
    assert!(asset.report.warnings[0].contains("palette is of degree 1"));
}

#[test]
fn a_streamed_bundle_names_its_parts() {
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("lod-meta.json");
    let text = r#"{"lodLevels": 3, "filenames": ["0_0/meta.json", "1_0/meta.json"], "tree": {}}"#;
    std::fs::write(&path, text).expect("room for it");
    let why = load_splat(&path).expect_err("a list of parts").to_string();
    assert!(
        why.contains("3 levels") && why.contains("0_0/meta.json"),
        "{why}"
    );
}

#[test]
fn a_compressed_ply_keeps_the_object_among_floaters() {
    let n = 3000;
    let mut cloud = gaussians(n, 0);
    for i in (0..n).step_by(50) {
        cloud.positions[i] *= 2e4;
    }
    let (made, back, _) = through(&cloud, ".compressed.ply");
    // The file's order is another one. A chunk of the object at most is shared with what floats.
    let is_off = |i: usize| {
        let distances = back
            .positions
            .iter()
            .map(|p| p.distance(cloud.positions[i]));
        distances.fold(f32::INFINITY, f32::min) > cloud.scales[i].max_element()
    };
    let off = (0..n).filter(|i| i % 50 != 0 && is_off(*i)).count();
    assert!(off < ply::compressed::CHUNK, "{off} of the object are off");
    let ply = made.folder.path().join("splat.ply");
    write_splat(&cloud, &cloud.sh, &ply).expect("room for it");
    let (cloud, asset) = load_splat(&ply).expect("a good file");
    let said = crate::files::losses(&asset, &cloud, &made.name).expect("another format");
    assert!(said.contains("of the splats in steps"), "{said}");
}
