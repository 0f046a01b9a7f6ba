use glam::Vec3;

use super::*;
use crate::error::Result;
use crate::files::{SplatFile, load_splat};
use crate::surfels::{SurfelCloud, UpAxis};
use std::io::Write;

/// A splat of `n` surfels as rows of (name, value).
fn rows(n: usize, degree: usize, scales: usize) -> Vec<Vec<(String, f32)>> {
    let k = coefficient_count(degree);
    (0..n)
        .map(|i| {
            let t = i as f32;
            let mut row: Vec<(String, f32)> = Vec::new();
            let mut put = |name: String, value: f32| row.push((name, value));
            for (axis, v) in ["x", "y", "z"].iter().zip([t, 2.0 * t, -t]) {
                put((*axis).into(), v);
            }
            for c in 0..3 {
                put(format!("f_dc_{c}"), 0.1 * (c as f32 + t));
            }
            for r in 0..3 * (k - 1) {
                put(format!("f_rest_{r}"), r as f32 + 1000.0 * t);
            }
            put("opacity".into(), 0.0);
            for s in 0..scales {
                put(format!("scale_{s}"), [-1.0, -2.0, -6.0][s]);
            }
            for (r, v) in [1.0, 0.0, 0.0, 0.0].into_iter().enumerate() {
                put(format!("rot_{r}"), v);
            }
            row
        })
        .collect()
}

fn write(rows: &[Vec<(String, f32)>], format: Format, double: bool) -> Vec<u8> {
    let name = match format {
        Format::Ascii => "ascii",
        Format::LittleEndian => "binary_little_endian",
        Format::BigEndian => "binary_big_endian",
    };
    let mut out = format!(
        "ply\nformat {name} 1.0\ncomment Vertical axis: -y\nelement vertex {}\n",
        rows.len()
    );
    let kind = if double { "double" } else { "float" };
    for (name, _) in &rows[0] {
        out += &format!("property {kind} {name}\n");
    }
    out += "end_header\n";
    let mut out = out.into_bytes();
    for row in rows {
        for (_, value) in row {
            match (format, double) {
                (Format::Ascii, _) => write!(out, "{value} ").expect("memory"),
                (Format::LittleEndian, false) => out.extend(value.to_le_bytes()),
                (Format::BigEndian, false) => out.extend(value.to_be_bytes()),
                (Format::LittleEndian, true) => out.extend(f64::from(*value).to_le_bytes()),
                (Format::BigEndian, true) => out.extend(f64::from(*value).to_be_bytes()),
            }
        }
        if format == Format::Ascii {
            out.push(b'\n');
        }
    }
    out
}

fn load_bytes(bytes: &[u8]) -> Result<(SurfelCloud, SplatFile)> {
    let mut file = tempfile::NamedTempFile::new().expect("a temporary file");
    file.write_all(bytes).expect("room for it");
    load_splat(file.path())
}

#[test]
fn every_format_type_degree_and_order_loads_alike() {
    for degree in [0, 1, 3, 8] {
        for scales in [2, 3] {
            let mut table = rows(5, degree, scales);
            let (expected, asset) =
                load_bytes(&write(&table, Format::LittleEndian, false)).expect("a good file");
            assert_eq!(expected.sh_degree, degree);
            assert_eq!(expected.up, UpAxis::MinusY);
            assert_eq!(asset.report.kind == SplatKind::Gaussians3d, scales == 3);
            let k = coefficient_count(degree);
            if k > 1 {
                // Channel-major: coefficient 1 of green is the first of the second third.
                assert_eq!(
                    expected.sh_of(asset.surfel_of(2).expect("a row"))[1],
                    [
                        2000.0,
                        2000.0 + (k - 1) as f32,
                        2000.0 + 2.0 * (k - 1) as f32
                    ]
                );
            }
            for row in &mut table {
                row.reverse();
                row.insert(2, ("extra".into(), 7.0));
            }
            for format in [Format::Ascii, Format::LittleEndian, Format::BigEndian] {
                for double in [false, true] {
                    let (cloud, _) =
                        load_bytes(&write(&table, format, double)).expect("a good file");
                    assert_eq!(cloud.positions, expected.positions);
                    assert_eq!(cloud.tangents, expected.tangents);
                    assert_eq!(cloud.scales, expected.scales);
                    assert_eq!(cloud.opacities, expected.opacities);
                    assert_eq!(cloud.sh, expected.sh);
                }
            }
        }
    }
}

#[test]
fn the_shortest_axis_becomes_the_normal() {
    for (shortest, normal) in [(0, Vec3::X), (1, Vec3::Y), (2, Vec3::Z)] {
        let mut table = rows(1, 0, 3);
        for (name, value) in &mut table[0] {
            if let Some(axis) = name.strip_prefix("scale_") {
                let axis: usize = axis.parse().expect("a digit");
                *value = if axis == shortest {
                    -9.0
                } else {
                    -2.0 - axis as f32
                };
            }
        }
        let (cloud, asset) =
            load_bytes(&write(&table, Format::LittleEndian, false)).expect("a good file");
        assert_eq!(cloud.stored_normal(0), normal);
        assert!(cloud.scales[0].min_element() > 0.01);
        assert!(asset.report.median_flatness.expect("a 3D Gaussian") < 0.01);
    }
}

#[test]
fn bad_files_are_refused_with_a_reason() {
    let good = write(&rows(20, 1, 2), Format::LittleEndian, false);
    let text = String::from_utf8_lossy(&good).into_owned();
    let with = |from: &str, to: &str| text.replacen(from, to, 1).into_bytes();
    let cases: Vec<(Vec<u8>, &str)> = vec![
        (Vec::new(), "empty"),
        (b"not a ply\n".to_vec(), "of no kind"),
        (good[..good.len() - 10].to_vec(), "truncated"),
        (good[..good.len() - 1].to_vec(), "truncated"),
        (good[..100].to_vec(), "end_header"),
        (
            with("element vertex 20", "element vertex 1099511627776"),
            "1099511627776",
        ),
        (
            with("element vertex 20", "element vertex 18446744073709551615"),
            "claims",
        ),
        (with("element vertex 20", "element vertex -3"), "count"),
        (with("element vertex 20", "element vertex 0"), "no vertices"),
        (with("float x", "banana x"), "unknown type"),
        (with("float opacity", "uint opacity"), "integer"),
        (with("float f_rest_8", "float other"), "f_rest"),
        (with("float rot_3", "float rot_9"), "rot_3"),
        (with("float rot_3", "float rot_2"), "twice"),
        (
            with("property float x", "property list uchar int x"),
            "list",
        ),
        (with("element vertex", "element point"), "vertex"),
    ];
    for (bytes, expected) in cases {
        let message = load_bytes(&bytes).expect_err(expected).to_string();
        assert!(
            message.contains(expected),
            "{message:?} does not say {expected:?}"
        );
    }
}

#[test]
fn a_few_broken_rows_are_left_out_and_many_refused() {
    let mut table = rows(100, 1, 2);
    table[3][0].1 = f32::NAN;
    table[5].last_mut().expect("a row").1 = f32::INFINITY;
    let (cloud, asset) =
        load_bytes(&write(&table, Format::LittleEndian, false)).expect("mostly good");
    assert_eq!(asset.report.skipped_work, [3, 5]);
    let broken = asset.surfel_of(3).expect("a row");
    assert_eq!((cloud.opacities[broken], cloud.len()), (0.0, 100));
    assert_eq!(asset.row_of(broken), Some(3));
    assert!(cloud.positions.iter().all(|p| p.is_finite()));
    for row in &mut table[..20] {
        row[4].1 = f32::NAN;
    }
    let (_, asset) = load_bytes(&write(&table, Format::LittleEndian, false)).expect("four fifths");
    assert_eq!(asset.report.skipped_work.len(), 20);
    for row in &mut table[..95] {
        row[4].1 = f32::NAN;
    }
    let message = load_bytes(&write(&table, Format::LittleEndian, false))
        .expect_err("nothing is left")
        .to_string();
    assert!(message.contains("no numbers"), "{message}");
}

#[test]
fn infinite_logits_and_flattened_scales_are_fine() {
    let mut table = rows(2, 0, 3);
    for (name, value) in &mut table[0] {
        match name.as_str() {
            "opacity" => *value = f32::INFINITY,
            "scale_2" => *value = f32::NEG_INFINITY,
            _ => {}
        }
    }
    let (cloud, asset) = load_bytes(&write(&table, Format::BigEndian, false)).expect("a good file");
    assert_eq!(cloud.opacities[0], 1.0);
    assert!(asset.report.skipped_work.is_empty());
}

#[test]
fn antialiased_training_is_read_from_what_trainers_write() {
    let table = rows(3, 0, 3);
    let good = write(&table, Format::LittleEndian, false);
    let text = String::from_utf8_lossy(&good[..good.len() - 3 * table[0].len() * 4]).into_owned();
    let body = &good[text.len()..];
    let told = |comment: &str| {
        let head = text.replace("comment Vertical axis: -y", &format!("comment {comment}"));
        let (cloud, _) = load_bytes(&[head.as_bytes(), body].concat()).expect("a good file");
        let told = |t: &crate::surfels::Thickness| !t.is_flat() && t.is_antialiased();
        cloud.thicknesses.iter().all(told)
    };
    assert!(told("SplatRenderMode: mip") && told("antialiased 1"));
    assert!(!told("SplatRenderMode: default") && !told("antialiased 0") && !told("mip"));
}

#[test]
fn the_smoothing_filter_of_mip_splatting_widens_and_fades() {
    let mut table = rows(1, 0, 3);
    table[0].push(("filter_3D".into(), 0.2));
    let (cloud, _) = load_bytes(&write(&table, Format::LittleEndian, false)).expect("a good file");
    let scales = [-1f32, -2.0, -6.0].map(f32::exp);
    let wide = scales.map(|s| s.hypot(0.2));
    assert!((cloud.thicknesses[0].sigma() - wide[2]).abs() < 1e-6);
    assert!(cloud.scales[0].distance(glam::Vec2::new(wide[0], wide[1])) < 1e-6);
    let share: f32 = scales.iter().zip(wide).map(|(s, w)| s / w).product();
    assert!((cloud.opacities[0] - 0.5 * share).abs() < 1e-6);
    assert!(cloud.thicknesses[0].is_antialiased());
}

/// Names and values of `n` rows in ascii, each value by its row.
fn ascii(properties: &[&str], n: usize, row: impl Fn(usize) -> Vec<f64>) -> String {
    let mut text = format!("ply\nformat ascii 1.0\nelement vertex {n}\n");
    for property in properties {
        text += &format!("property {property}\n");
    }
    text += "end_header\n";
    for i in 0..n {
        let values: Vec<String> = row(i).iter().map(f64::to_string).collect();
        text += &format!("{}\n", values.join(" "));
    }
    text
}

const SPLAT: [&str; 14] = [
    "double x",
    "double y",
    "double z",
    "float f_dc_0",
    "float f_dc_1",
    "float f_dc_2",
    "float opacity",
    "float scale_0",
    "float scale_1",
    "float scale_2",
    "float rot_0",
    "float rot_1",
    "float rot_2",
    "float rot_3",
];

/// A row of [`SPLAT`] somewhere on a sphere of radius 1.
fn on_sphere(i: usize, opacity: f64, scales: [f64; 3]) -> Vec<f64> {
    let place = crate::sh::lattice(200)[i].as_dvec3().to_array();
    let mut row = [&place[..], &[0.1, 0.2, 0.3, opacity], &scales].concat();
    row.extend([1.0, 0.0, 0.0, 0.0]);
    row
}

/// Comments are in any encoding and are kept, and a byte order mark is none of the file's.
#[test]
fn a_header_is_in_whatever_encoding_its_writer_had() {
    let text = ascii(&SPLAT, 3, |i| on_sphere(i, 2.0, [-3.0; 3]));
    let comment = b"comment made in Z\xfcrich\n";
    let (head, rest) = text.split_once("element").expect("a header");
    for start in [&b"\xef\xbb\xbf"[..], b""] {
        let bytes = [start, head.as_bytes(), comment, b"element", rest.as_bytes()].concat();
        let (cloud, asset) = load_bytes(&bytes).expect("a good file");
        assert_eq!(cloud.len(), 3);
        assert_eq!(asset.report.comments, ["made in Zürich"]);
        let folder = tempfile::tempdir().expect("a folder");
        let (path, out) = (folder.path().join("in.ply"), folder.path().join("out.ply"));
        std::fs::write(&path, &bytes).expect("room for it");
        let (cloud, asset) = load_splat(&path).expect("a good file");
        crate::files::write_relit(&asset, &cloud, &cloud.sh, &out).expect("room for it");
        let written = std::fs::read(&out).expect("it is there");
        assert!(written.windows(comment.len()).any(|w| w == comment));
    }
}

#[test]
fn a_colour_as_it_is_shown_stands_for_the_lowest_band() {
    let shown: Vec<&str> = SPLAT
        .iter()
        .filter(|p| !p.contains("f_dc"))
        .copied()
        .chain(["uchar red", "uchar green", "uchar blue"])
        .collect();
    let text = ascii(&shown, 4, |i| {
        let mut row = on_sphere(i, 2.0, [-3.0; 3]);
        row.drain(3..6);
        row.extend([255.0, 51.0, 0.0]);
        row
    });
    let folder = tempfile::tempdir().expect("a folder");
    let (path, out) = (folder.path().join("in.ply"), folder.path().join("out.ply"));
    std::fs::write(&path, &text).expect("room for it");
    let (cloud, asset) = load_splat(&path).expect("a good file");
    let color = cloud.sh_of(0)[0].map(super::super::packed::color_of_dc);
    assert!(
        (color[0] - 1.0).abs() < 1e-6 && (color[1] - 0.2).abs() < 1e-6,
        "{color:?}"
    );
    // What is written again is what came in, and half as bright where it is relit so.
    crate::files::write_relit(&asset, &cloud, &cloud.sh, &out).expect("room for it");
    let same = std::fs::read_to_string(&out).expect("text");
    assert!(
        same.lines().last().is_some_and(|l| l.ends_with("255 51 0")),
        "{same}"
    );
    let half = [dc_of_color(0.5); 3];
    crate::files::write_relit(&asset, &cloud, &[half; 4], &out).expect("room for it");
    let relit = std::fs::read_to_string(&out).expect("text");
    assert!(
        relit
            .lines()
            .last()
            .is_some_and(|l| l.ends_with("128 128 128")),
        "{relit}"
    );
}

#[test]
fn numbers_that_are_stored_otherwise_are_read_as_they_are_meant() {
    let load = |opacity: f64, scales: [f64; 3]| {
        let text = ascii(&SPLAT, 200, |i| on_sphere(i, opacity, scales));
        let (cloud, asset) = load_bytes(text.as_bytes()).expect("a good file");
        (cloud, asset.report)
    };
    // As trainers store it, whatever its unit is.
    for scales in [[-3.0; 3], [0.5, 0.4, -2.0], [0.1, 0.2, 0.3]] {
        let (cloud, report) = load(3.0, scales);
        assert!(report.warnings.is_empty(), "{:?}", report.warnings);
        let largest = scales.into_iter().fold(f64::MIN, f64::max).exp();
        assert!((f64::from(cloud.scales[0].max_element()) - largest).abs() < 1e-3 * largest);
    }
    let (cloud, report) = load(0.9, [0.05, 0.05, 0.001]);
    assert!(report.warnings[0].contains("already exponentiated"));
    assert!((cloud.scales[0].x - 0.05).abs() < 1e-6 && (cloud.opacities[0] - 0.9).abs() < 1e-6);
    let (cloud, report) = load(3.0, [-3.0, -3.0, 0.0]);
    assert!(report.warnings[0].contains("2D Gaussians"));
    assert!(cloud.thicknesses.iter().all(|t| t.is_flat()));
}

#[test]
fn what_is_no_splat_or_more_than_one_says_what_it_is() {
    let moving: Vec<&str> = [&SPLAT[..], &["float motion_0", "float motion_1"]].concat();
    let text = ascii(&moving, 3, |i| {
        [on_sphere(i, 2.0, [-3.0; 3]), vec![0.0, 0.0]].concat()
    });
    let (_, asset) = load_bytes(text.as_bytes()).expect("a good file");
    assert!(asset.report.warnings[0].contains("motion_0 and 1 more"));
    let points = ascii(&["float x", "float y", "float z", "uchar red"], 3, |_| {
        vec![0.0; 4]
    });
    let why = load_bytes(points.as_bytes())
        .expect_err("points")
        .to_string();
    assert!(why.contains("a point cloud, not a splat"), "{why}");
    let mesh = points.replace(
        "end_header",
        "element face 1\nproperty list uchar int vertex_indices\nend_header",
    );
    let why = load_bytes(mesh.as_bytes()).expect_err("a mesh").to_string();
    assert!(why.contains("a mesh, not a splat"), "{why}");
}

/// A splat far from the origin is the same splat: its positions are as exact as in its file, and it is written where it was.
#[test]
fn a_georeferenced_splat_is_read_relative_to_a_point_in_it() {
    let far = [500_123.25, 5_600_456.5, 312.125];
    let placed = |offset: [f64; 3]| {
        ascii(&SPLAT, 200, |i| {
            let mut row = on_sphere(i, 2.0, [-3.0; 3]);
            row.iter_mut().zip(offset).for_each(|(v, o)| *v += o);
            row
        })
    };
    let (near, there) = (placed([0.0; 3]), placed(far));
    let (near, _) = load_bytes(near.as_bytes()).expect("a good file");
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("far.ply");
    std::fs::write(&path, there).expect("room for it");
    let (cloud, asset) = load_splat(&path).expect("a good file");
    assert_eq!(near.origin, glam::DVec3::ZERO);
    assert!(
        asset.report.warnings.is_empty(),
        "{:?}",
        asset.report.warnings
    );
    let moved = (glam::DVec3::from_array(far) - cloud.origin).as_vec3();
    assert!(moved.length() < 2.0);
    for p in &near.positions {
        assert!(
            cloud
                .positions
                .iter()
                .any(|q| q.distance(*p + moved) < 1e-6)
        );
    }
    let write = |name: &str| {
        let out = folder.path().join(name);
        crate::files::write_relit(&asset, &cloud, &cloud.sh, &out).map(|()| out)
    };
    for name in ["a.ply", "a.glb", "a.sog"] {
        let (back, asset) = load_splat(&write(name).expect(name)).expect("it opens");
        let off = back.origin + back.bounds().center.as_dvec3();
        let off = match name {
            // In its format y is up.
            "a.glb" => glam::DVec3::new(off.x, -off.z, off.y),
            _ => off,
        };
        assert!(
            off.distance(glam::DVec3::from_array(far)) < 0.05,
            "{name}: {off}"
        );
        assert!(
            asset.report.warnings.is_empty(),
            "{name}: {:?}",
            asset.report.warnings
        );
    }
    for name in ["a.spz", "a.splat", "a.compressed.ply"] {
        let why = write(name).expect_err(name).to_string();
        assert!(
            why.contains("in steps of") && why.contains("0.050 large"),
            "{why}"
        );
        assert!(!folder.path().join(name).exists());
    }
    // In 32 bits it is torn already.
    let torn = std::fs::read_to_string(&path)
        .expect("text")
        .replace("double", "float");
    let (_, asset) = load_bytes(torn.as_bytes()).expect("a good file");
    assert!(asset.report.warnings[0].contains("it is torn"));
}
