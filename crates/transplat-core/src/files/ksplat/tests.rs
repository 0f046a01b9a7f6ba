use std::io::Write as _;

use glam::Vec3;

use super::*;
use crate::files::load_splat;

/// Two splats of which the second is at (3, 1, -2), of that level and degree; the first fills a bucket, the second is alone in one.
pub(in crate::files) fn made(level: u16, degree: usize) -> Vec<u8> {
    let mut bytes = vec![0u8; HEADER];
    bytes[1] = 1;
    let mut put = |at: usize, value: &[u8]| bytes[at..at + value.len()].copy_from_slice(value);
    for at in [4, 8] {
        put(at, &1u32.to_le_bytes());
    }
    for at in [12, 16] {
        put(at, &2u32.to_le_bytes());
    }
    put(20, &level.to_le_bytes());
    put(36, &(-2f32).to_le_bytes());
    put(40, &2f32.to_le_bytes());
    let mut section = vec![0u8; SECTION_HEADER];
    let mut put = |at: usize, value: &[u8]| section[at..at + value.len()].copy_from_slice(value);
    for at in [0, 4] {
        put(at, &2u32.to_le_bytes());
    }
    if level > 0 {
        put(8, &1u32.to_le_bytes());
        put(12, &2u32.to_le_bytes());
        put(16, &8f32.to_le_bytes());
        put(20, &12u16.to_le_bytes());
        put(32, &1u32.to_le_bytes());
        put(36, &1u32.to_le_bytes());
    }
    put(40, &(degree as u16).to_le_bytes());
    bytes.extend(section);
    if level > 0 {
        // One in the partial bucket; then the middles of both.
        bytes.extend(1u32.to_le_bytes());
        bytes.extend(
            [0f32, 0.0, 0.0, 1.0, 1.0, 0.0]
                .into_iter()
                .flat_map(f32::to_le_bytes),
        );
    }
    let half = |v: f32| half::f16::from_f32(v).to_le_bytes().to_vec();
    let number = |v: f32| {
        if level == 0 {
            v.to_le_bytes().to_vec()
        } else {
            half(v)
        }
    };
    for i in 0..2 {
        let position = if i == 0 { [0.0; 3] } else { [3.0, 1.0, -2.0] };
        let middle = if i == 0 { [0.0; 3] } else { [1.0, 1.0, 0.0] };
        for a in 0..3 {
            if level == 0 {
                bytes.extend(f32::to_le_bytes(position[a]));
            } else {
                // A block is 8 wide.
                let steps = (position[a] - middle[a]) / 4.0 * POSITION_RANGE as f32;
                bytes.extend(
                    (steps.round() as i32 + POSITION_RANGE as i32).to_le_bytes()[..2].to_vec(),
                );
            }
        }
        bytes.extend([0.5, 0.25, 0.125].into_iter().flat_map(number));
        bytes.extend([1.0, 0.0, 0.0, 0.0].into_iter().flat_map(number));
        bytes.extend([255, 0, 51, 102]);
        for c in 0..3 * (coefficient_count(degree) - 1) {
            match level {
                2 => bytes.push(c as u8),
                _ => bytes.extend(number(0.125 * c as f32)),
            }
        }
    }
    bytes
}

#[test]
fn all_levels_and_degrees_hold_the_same() {
    for level in 0..=2 {
        for degree in 0..=2 {
            let mut file = tempfile::NamedTempFile::new().expect("a temporary file");
            file.write_all(&made(level, degree)).expect("room for it");
            let (cloud, asset) = load_splat(file.path()).expect("a good file");
            let i = asset.surfel_of(1).expect("a row");
            let at = cloud.positions[i];
            assert!(
                at.distance(Vec3::new(3.0, 1.0, -2.0)) < 2e-4,
                "{level}: {at}"
            );
            assert!((cloud.opacities[i] - 0.4).abs() < 1e-6);
            assert!((cloud.thicknesses[i].sigma() - 0.125).abs() < 1e-6);
            let [red, green, blue] = cloud.sh_of(i)[0].map(crate::files::packed::color_of_dc);
            assert!((red - 1.0).abs() < 1e-6 && green.abs() < 1e-6 && (blue - 0.2).abs() < 1e-6);
            let value = |c: usize| match level {
                2 => -2.0 + 4.0 * c as f32 / 255.0,
                _ => 0.125 * c as f32,
            };
            if degree > 0 {
                // All of red of a degree, then of green, then of blue.
                assert_eq!(cloud.sh_of(i)[2], [1, 4, 7].map(value));
            }
            if degree > 1 {
                assert_eq!(cloud.sh_of(i)[5], [10, 15, 20].map(value));
            }
        }
    }
}

#[test]
fn broken_files_are_refused_with_a_reason() {
    let good = made(1, 1);
    for (at, value, expected) in [
        (HEADER + 12, 9, "buckets"),
        (HEADER + 40, 3, "header"),
        (HEADER + SECTION_HEADER, 0, "fewer"),
    ] {
        let mut bytes = good.clone();
        bytes[at] = value;
        let mut file = tempfile::NamedTempFile::new().expect("a temporary file");
        file.write_all(&bytes).expect("room for it");
        let message = load_splat(file.path()).expect_err(expected).to_string();
        assert!(message.contains(expected), "{message:?} for {expected:?}");
    }
}
