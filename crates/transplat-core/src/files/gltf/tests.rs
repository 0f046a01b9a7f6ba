use glam::Vec3;
use serde_json::json;

use super::*;
use crate::files::{load_splat, write_splat};
use crate::synthetic;

/// A binary glTF of four surfels whose document was changed.
fn changed(change: impl FnOnce(&mut Value)) -> Result<SurfelCloud> {
    let points = [Vec3::ZERO, Vec3::X, Vec3::Y, Vec3::Z];
    let mut cloud = synthetic::from_points(&points, &[Vec3::Z; 4], 0.1);
    cloud.encoding = Encoding::Stored;
    let folder = tempfile::tempdir().expect("a folder");
    let path = folder.path().join("splat.glb");
    write_splat(&cloud, &cloud.sh, &path).expect("room for it");
    let bytes = std::fs::read(&path).expect("it is there");
    let (text, binary) = chunks(&bytes).expect("both chunks");
    let mut document: Value = serde_json::from_slice(text).expect("JSON");
    change(&mut document);
    let mut text = serde_json::to_vec(&document).expect("JSON");
    text.resize(text.len().next_multiple_of(4), b' ');
    let mut out = MAGIC.to_vec();
    let total = 28 + text.len() + binary.len();
    for number in [2, total as u32, text.len() as u32, JSON_CHUNK] {
        out.extend(number.to_le_bytes());
    }
    out.extend(text);
    out.extend((binary.len() as u32).to_le_bytes());
    out.extend(BINARY_CHUNK.to_le_bytes());
    out.extend(binary);
    std::fs::write(&path, out).expect("room for it");
    load_splat(&path).map(|(cloud, _)| cloud)
}

fn holds(cloud: &SurfelCloud, place: Vec3) -> bool {
    cloud.positions.iter().any(|p| p.distance(place) < 1e-5)
}

#[test]
fn splats_are_where_their_nodes_are() {
    let half = std::f32::consts::FRAC_1_SQRT_2;
    let moved = changed(|d| {
        // A quarter about z within a node that is twice as large; a quaternion of any length.
        d["nodes"] = json!([
            {"children": [1], "scale": [2, 2, 2], "translation": [5, 0, 0]},
            {"mesh": 0, "rotation": [0, 0, 3.0 * half, 3.0 * half]},
        ]);
    });
    let moved = moved.expect("a good file");
    assert!(holds(&moved, Vec3::new(5.0, 2.0, 0.0)) && holds(&moved, Vec3::new(3.0, 0.0, 0.0)));
    assert!((moved.scales[0].x - 0.2).abs() < 1e-6);
    // Without a scene, what is in another node is not placed by itself, too.
    let twice = changed(|d| {
        d.as_object_mut().expect("an object").remove("scenes");
        d["nodes"] = json!([
            {"children": [2]},
            {"mesh": 0},
            {"mesh": 0, "matrix": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 7, 1]},
        ]);
    });
    let twice = twice.expect("a good file");
    assert_eq!(twice.len(), 8);
    assert!(holds(&twice, Vec3::new(0.0, 0.0, 8.0)) && holds(&twice, Vec3::X));
}

#[test]
fn what_the_drafts_and_linear_files_hold_is_the_same() {
    let plain = changed(|_| {}).expect("a good file");
    let draft = changed(|d| {
        let attributes = &mut d["meshes"][0]["primitives"][0]["attributes"];
        let attributes = attributes.as_object_mut().expect("an object");
        for (now, then) in [
            ("ROTATION", "_ROTATION"),
            ("SCALE", "_SCALE"),
            ("OPACITY", "_OPACITY"),
        ] {
            let of = attributes
                .remove(&format!("{EXTENSION}:{now}"))
                .expect("one");
            attributes.insert(then.into(), of);
        }
    });
    let draft = draft.expect("a good file");
    assert_eq!(
        (&draft.positions, &draft.scales),
        (&plain.positions, &plain.scales)
    );
    let extension = |d: &mut Value| {
        d["meshes"][0]["primitives"][0]["extensions"][EXTENSION]["colorSpace"] =
            json!("lin_rec709_display");
    };
    let linear = changed(extension).expect("a good file");
    assert_eq!(linear.encoding, Encoding::Linear);
    // What is shown of it, half and the coefficient's part, is the light.
    let shown = plain.sh[0][0] / SQRT_4PI as f32 + 0.5;
    assert!((linear.sh[0][0] / SQRT_4PI as f32 - shown).abs() < 1e-6);
}

/// A node may mirror and stretch, and lie as far from the origin as a georeferenced one.
#[test]
fn a_node_may_be_any_linear_map_anywhere() {
    let placed = changed(|d| {
        d["nodes"] = json!([{"mesh": 0, "scale": [-2, 1, 1], "translation": [4.5e6, 0.25, 7.0]}]);
    });
    let placed = placed.expect("a good file");
    assert_eq!(placed.origin.x, 4.5e6 - 1.0);
    let at = |place: [f64; 3]| (DVec3::from_array(place) - placed.origin).as_vec3();
    assert!(holds(&placed, at([4.5e6 - 2.0, 0.25, 7.0])) && holds(&placed, at([4.5e6, 1.25, 7.0])));
    assert!((placed.scales[0].max_element() - 0.2).abs() < 1e-6);
    assert!((placed.scales[0].min_element() - 0.1).abs() < 1e-6);
}

#[test]
fn a_buffer_is_found_below_whatever_codes_its_name_has() {
    let folder = tempfile::tempdir().expect("a folder");
    let inner = folder.path().join("buffers of it");
    std::fs::create_dir(&inner).expect("room for it");
    std::fs::write(inner.join("a é.bin"), b"bytes").expect("room for it");
    for uri in [
        "buffers%20of%20it/a%20%C3%A9.bin",
        "./buffers of it/a é.bin",
    ] {
        let file = below(folder.path(), uri).expect("within");
        assert_eq!(
            std::fs::read(file).ok().as_deref(),
            Some(&b"bytes"[..]),
            "{uri}"
        );
    }
    for uri in ["../a.bin", "/a.bin", "a/../../b", "%2E%2E/a", ""] {
        assert_eq!(below(folder.path(), uri), None, "{uri}");
    }
}

#[test]
fn broken_documents_are_refused_with_a_reason() {
    type Change = fn(&mut Value);
    let cases: [(Change, &str); 11] = [
        (
            |d| d["nodes"] = json!([{"mesh": 0, "children": [0]}]),
            "without end",
        ),
        (
            |d| {
                // Each places the next one twice.
                let nodes = (0..60).map(|i| json!({"children": [i + 1, i + 1]}));
                d["nodes"] = nodes.chain([json!({"mesh": 0})]).collect();
            },
            "without end",
        ),
        (
            |d| d["nodes"] = json!([{"mesh": 0, "scale": [1, 0, 1]}]),
            "flattens",
        ),
        (
            |d| d["extensionsRequired"] = json!(["EXT_of_tomorrow"]),
            "EXT_of_tomorrow",
        ),
        (
            |d| {
                let compressed = json!({"buffer": 1, "byteLength": 9, "mode": "ATTRIBUTES"});
                d["buffers"]
                    .as_array_mut()
                    .expect("a list")
                    .push(json!({"byteLength": 9}));
                d["bufferViews"][0]["extensions"] = json!({"EXT_meshopt_compression": compressed});
            },
            "EXT_meshopt_compression",
        ),
        (
            |d| d["buffers"] = json!([{"uri": "../a.bin"}]),
            "not in its folder",
        ),
        (
            |d| d["buffers"] = json!([{"uri": "%2e%2e/a.bin"}]),
            "not in its folder",
        ),
        (|d| d["nodes"] = json!([{"mesh": 9}]), "mesh"),
        (
            |d| d["accessors"][0]["count"] = json!(4_000_000_000u64),
            "no room",
        ),
        (|d| d["accessors"][1]["count"] = json!(3), "lengths"),
        (
            |d| d["meshes"][0]["primitives"][0]["extensions"] = json!({}),
            "no splat",
        ),
    ];
    for (change, expected) in cases {
        let message = changed(change).expect_err(expected).to_string();
        assert!(message.contains(expected), "{message:?} for {expected:?}");
    }
}
