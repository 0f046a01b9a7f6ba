use std::io::Write as _;

use super::*;
use crate::files::load_splat;
use crate::surfels::SurfelCloud;

pub(in crate::files) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut gzip = GzEncoder::new(Vec::new(), Compression::fast());
    gzip.write_all(bytes).expect("memory");
    gzip.finish().expect("memory")
}

fn head(version: u32, degree: u8, flags: u8, last: u8) -> Vec<u8> {
    let mut head = MAGIC.to_vec();
    head.extend(version.to_le_bytes());
    head.extend(1u32.to_le_bytes());
    head.extend([degree, 8, flags, last]);
    head
}

/// One point at (1.5, -2, 0.25), opacity 0.2, the reddest colour, scales e^-2, e^-1, e^-6, turned by 180 degrees about x.
fn streams(version: u32, degree: usize) -> Vec<Vec<u8>> {
    let position = if version == 1 {
        let halves = [1.5, -2.0, 0.25].map(|v| half::f16::from_f32(v).to_le_bytes());
        halves.concat()
    } else {
        let fixed = [384i32, -512, 64].map(|v| v.to_le_bytes());
        fixed.iter().flat_map(|b| b[..3].to_vec()).collect()
    };
    let rotation = if version < 3 {
        vec![255, 128, 128]
    } else {
        // The largest is x, the others are 0.
        vec![0, 0, 0, 0]
    };
    let sh = (0..3 * (coefficient_count(degree) - 1)).map(|i| 128 + i as u8);
    let logs = [-2.0, -1.0, -6.0].map(|log: f32| ((log + 10.0) * 16.0) as u8);
    vec![
        position,
        vec![51],
        vec![255, 128, 0],
        logs.to_vec(),
        rotation,
        sh.collect(),
    ]
}

/// Version 4 with that before its table of contents.
pub(in crate::files) fn frames(degree: usize, extensions: &[u8]) -> Vec<u8> {
    let streams: Vec<_> = (streams(4, degree).into_iter())
        .filter(|s| !s.is_empty())
        .collect();
    let flags = if extensions.is_empty() {
        0
    } else {
        HAS_EXTENSIONS
    };
    let mut bytes = head(4, degree as u8, flags, streams.len() as u8);
    bytes.extend((32 + extensions.len() as u32).to_le_bytes());
    bytes.extend([0; 12]);
    bytes.extend(extensions);
    let level = ruzstd::encoding::CompressionLevel::Fastest;
    let packed = streams
        .iter()
        .map(|s| ruzstd::encoding::compress_to_vec(&s[..], level));
    let packed: Vec<Vec<u8>> = packed.collect();
    for (packed, plain) in packed.iter().zip(&streams) {
        bytes.extend((packed.len() as u64).to_le_bytes());
        bytes.extend((plain.len() as u64).to_le_bytes());
    }
    bytes.extend(packed.concat());
    bytes
}

/// Versions 1 to 3 before they are compressed.
pub(in crate::files) fn plain(version: u32, degree: usize) -> Vec<u8> {
    [
        head(version, degree as u8, 0, 0),
        streams(version, degree).concat(),
    ]
    .concat()
}

fn load(bytes: &[u8]) -> Result<SurfelCloud> {
    let mut file = tempfile::NamedTempFile::new().expect("a temporary file");
    file.write_all(bytes).expect("room for it");
    load_splat(file.path()).map(|(cloud, _)| cloud)
}

#[test]
fn all_four_versions_hold_the_same() {
    for version in 1..=4 {
        for degree in [0, 1, 4] {
            let bytes = if version == 4 {
                frames(degree, &[])
            } else {
                gzip(&plain(version, degree))
            };
            let cloud = load(&bytes).expect("a good file");
            assert_eq!(
                cloud.positions[0],
                glam::Vec3::new(1.5, -2.0, 0.25),
                "{version}"
            );
            assert!((cloud.opacities[0] - 0.2).abs() < 1e-6);
            assert_eq!((cloud.sh_degree, cloud.up), (degree, UpAxis::PlusY));
            let [red, green, blue] = cloud.sh_of(0)[0];
            assert!((red - 0.5 / 0.15).abs() < 1e-5 && green.abs() < 0.02 && blue == -red);
            let scales = cloud.scales[0].to_array();
            let expected = [-2f32, -1.0].map(f32::exp);
            assert!(
                scales
                    .iter()
                    .zip(expected)
                    .all(|(s, e)| (s / e - 1.0).abs() < 1e-5)
            );
            // x stays, y and z are turned over; the bytes of versions 1 and 2 have no 0.
            let [u, v] = cloud.tangents[0];
            let close = |a: glam::Vec3, b: glam::Vec3| a.distance(b) < 0.02;
            assert!(
                close(u, glam::Vec3::X) && close(v, glam::Vec3::NEG_Y),
                "{u} {v}"
            );
            if degree > 0 {
                // Coefficient by coefficient, channel by channel.
                assert_eq!(cloud.sh_of(0)[2], [3.0, 4.0, 5.0].map(|v| v / 128.0));
            }
        }
    }
}

#[test]
fn an_extension_says_which_way_is_up() {
    let of_system = |system: u32| {
        let unknown = [7u32, 4, 0].map(u32::to_le_bytes).concat();
        let told = [COORDINATES, 4, system].map(u32::to_le_bytes).concat();
        frames(0, &[unknown, told].concat())
    };
    // RDF, RUB, RFU, LBD.
    for (system, up) in [
        (6, UpAxis::MinusY),
        (4, UpAxis::PlusY),
        (12, UpAxis::PlusZ),
        (13, UpAxis::MinusZ),
    ] {
        let cloud = load(&of_system(system)).expect("a good file");
        assert_eq!(cloud.up, up, "{system}");
    }
    let whole = head(3, 0, HAS_EXTENSIONS, 0);
    let told = [COORDINATES, 4, 6].map(u32::to_le_bytes).concat();
    let cloud = load(&gzip(&[whole, streams(3, 0).concat(), told].concat())).expect("a good file");
    assert_eq!(cloud.up, UpAxis::MinusY);
}

#[test]
fn broken_files_are_refused_with_a_reason() {
    let good = frames(1, &[]);
    let with = |at: usize, value: u8| {
        let mut bytes = good.clone();
        bytes[at] = value;
        bytes
    };
    let longer = gzip(&[head(3, 9, 0, 0), streams(3, 1).concat()].concat());
    for (bytes, expected) in [
        (with(4, 9), "version 9"),
        (with(15, 5), "streams"),
        (with(16, 31), "table of contents"),
        (with(13, 99), "bits"),
        (with(40, 200), "expected"),
        (longer, "degree 9"),
        (gzip(b"a text, and nothing else at all"), "no kind that"),
    ] {
        let message = load(&bytes).expect_err(expected).to_string();
        assert!(message.contains(expected), "{message:?} for {expected:?}");
    }
}
