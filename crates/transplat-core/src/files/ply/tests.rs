use glam::Vec3;

use super::*;
use crate::error::Result;
use crate::files::{AssetFile, load_asset};
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

fn load_bytes(bytes: &[u8]) -> Result<(SurfelCloud, AssetFile)> {
    let mut file = tempfile::NamedTempFile::new().expect("a temporary file");
    file.write_all(bytes).expect("room for it");
    load_asset(file.path())
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
            assert_eq!(asset.report.kind == AssetKind::Gaussians3d, scales == 3);
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
    assert_eq!(asset.report.left_out, [3, 5]);
    let broken = asset.surfel_of(3).expect("a row");
    assert_eq!((cloud.opacities[broken], cloud.len()), (0.0, 100));
    assert_eq!(asset.row_of(broken), Some(3));
    assert!(cloud.positions.iter().all(|p| p.is_finite()));
    for row in &mut table[..20] {
        row[4].1 = f32::NAN;
    }
    let message = load_bytes(&write(&table, Format::LittleEndian, false))
        .expect_err("a fifth is broken")
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
    assert!(asset.report.left_out.is_empty());
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
