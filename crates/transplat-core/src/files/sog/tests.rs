use std::path::Path;

use serde_json::{Value, json};

use super::*;
use crate::files::{load_splat, write_splat};
use crate::surfels::SurfelCloud;
use crate::synthetic;
use std::fs::File;
use zip::ZipArchive;

/// A bundle of some surfels, unpacked: a folder.
fn unpacked(folder: &Path, degree: usize) -> (PathBuf, Value) {
    let cloud = synthetic::glossy_sphere_over_plate(40, degree);
    let bundle = folder.join("splat.sog");
    write_splat(&cloud, &cloud.sh, &bundle).expect("room for it");
    let mut archive = ZipArchive::new(File::open(&bundle).expect("it is there")).expect("a bundle");
    archive.extract(folder).expect("room for it");
    let meta = folder.join(META);
    let text = std::fs::read(&meta).expect("it is there");
    (meta, serde_json::from_slice(&text).expect("JSON"))
}

fn load(meta: &Path, said: &Value) -> Result<SurfelCloud> {
    std::fs::write(meta, said.to_string()).expect("room for it");
    load_splat(meta).map(|(cloud, _)| cloud)
}

#[test]
fn version_1_holds_the_same_between_least_and_greatest() {
    let folder = tempfile::tempdir().expect("a folder");
    let (meta, second) = unpacked(folder.path(), 2);
    let ramp = |least: f32, most: f32| -> Value {
        (0..CODES)
            .map(|i| lerp(least, most, share(i as u32, 8)))
            .collect()
    };
    let (mut second, mut first) = (second.clone(), second);
    second["scales"]["codebook"] = ramp(-6.0, -1.0);
    second["sh0"]["codebook"] = ramp(-2.0, 2.0);
    second["shN"]["codebook"] = ramp(-0.5, 0.25);
    let object = first.as_object_mut().expect("an object");
    object.remove("version");
    let count = object.remove("count").expect("a count");
    first["means"]["shape"] = json!([count, 3]);
    let files = |name: &str| second[name]["files"].clone();
    first["scales"] =
        json!({"mins": [-6.0, -6.0, -6.0], "maxs": [-1.0, -1.0, -1.0], "files": files("scales")});
    first["sh0"] = json!({"mins": [-2.0, -2.0, -2.0, -4.0], "maxs": [2.0, 2.0, 2.0, 4.0], "files": files("sh0")});
    first["shN"] = json!({"mins": -0.5, "maxs": 0.25, "files": files("shN")});
    let [a, b] = [&second, &first].map(|said| load(&meta, said).expect("a good file"));
    assert_eq!((a.sh_degree, b.sh_degree), (2, 2));
    assert_eq!(
        (&a.positions, &a.scales, &a.sh),
        (&b.positions, &b.scales, &b.sh)
    );
    // The first one's opacities are logits.
    for (a, b) in a.opacities.iter().zip(&b.opacities) {
        let expected = 1.0 / (1.0 + (4.0 - 8.0 * a).exp());
        assert!((b - expected).abs() < 1e-5, "{a} {b}");
    }
}

#[test]
fn broken_ones_are_refused_with_a_reason() {
    let folder = tempfile::tempdir().expect("a folder");
    let (meta, good) = unpacked(folder.path(), 1);
    type Change = fn(&mut Value);
    let cases: [(Change, &str); 5] = [
        (|m| m["version"] = json!(3), "version 3"),
        (|m| m["count"] = json!(4_000_000_000u64), "claims"),
        (|m| m["count"] = json!(5000), "pixels"),
        (|m| m["quats"]["files"] = json!(["../quats.webp"]), "beside"),
        (|m| m["sh0"]["codebook"] = json!([1.0, 2.0]), "codebook"),
    ];
    for (change, expected) in cases {
        let mut said = good.clone();
        change(&mut said);
        let message = load(&meta, &said).expect_err(expected).to_string();
        assert!(message.contains(expected), "{message:?} for {expected:?}");
    }
    std::fs::remove_file(folder.path().join("sh0.webp")).expect("it was there");
    assert!(
        load(&meta, &good)
            .expect_err("gone")
            .to_string()
            .contains("sh0.webp")
    );
}
