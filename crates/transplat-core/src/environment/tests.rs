use std::f64::consts::PI;

use glam::Vec3;

use super::*;
use crate::oracle;
use crate::sh::{MAX_DEGREE, SQRT_4PI, evaluate_sh};

fn test_map(width: usize, height: usize) -> EnvironmentMap {
    let pixels = (0..width * height)
        .map(|i| {
            let v = ((i * 7919) % 1013) as f32 / 1013.0;
            [v, v * v, if i % 97 == 0 { 500.0 } else { 0.1 }]
        })
        .collect();
    EnvironmentMap::new(width, height, pixels)
}

#[test]
fn projection_agrees_with_the_oracle() {
    for (w, h) in [(64, 32), (37, 19), (1, 1), (2, 200)] {
        let map = test_map(w, h);
        let exact = oracle::project_environment(&map, MAX_DEGREE);
        let got = project_environment(&map, MAX_DEGREE);
        // Short sums of 32 terms in f32: 32 * 2^-24 of the light's total, times |Y| <= 2.
        let bound = 4e-6 * exact[0].iter().fold(0f64, |a, b| a.max(*b));
        for (e, g) in exact
            .iter()
            .flatten()
            .zip(got.coefficients.iter().flatten())
        {
            assert!((e - f64::from(*g)).abs() <= bound, "{e} {g}");
        }
    }
}

#[test]
fn an_even_map_has_a_dc_and_nothing_else() {
    let map = EnvironmentMap::new(256, 128, vec![[2.0, 1.0, 0.5]; 256 * 128]);
    let light = project_environment(&map, 6);
    assert!((light.coefficients[0][1] - SQRT_4PI as f32).abs() < 1e-5);
    for c in light.coefficients[1..].iter().flatten() {
        // Pixel centres stand for pixels: an error of (pi / 128)^2 / 24 of the light, halved by symmetry.
        assert!(c.abs() < 1e-3, "{c}");
    }
}

#[test]
fn solid_angles_cover_the_sphere() {
    let map = test_map(48, 24);
    let sum: f64 = (0..24).map(|r| map.pixel_solid_angle(r) * 48.0).sum();
    assert!((sum - 4.0 * PI).abs() < 1e-12);
}

#[test]
fn conventions_are_blenders() {
    // One bright pixel; where is it seen, by SH and by look-up?
    let at = |column: usize, row: usize| {
        let mut pixels = vec![[0f32; 3]; 64 * 32];
        pixels[row * 64 + column] = [100.0; 3];
        EnvironmentMap::new(64, 32, pixels)
    };
    for (column, row, d) in [
        (32, 16, Vec3::X),
        (16, 16, Vec3::Y),
        (48, 16, Vec3::NEG_Y),
        (0, 16, Vec3::NEG_X),
        (10, 0, Vec3::Z),
        (10, 31, Vec3::NEG_Z),
    ] {
        let map = at(column, row);
        let light = project_environment(&map, 4);
        let value = |d: Vec3| evaluate_sh(&light.coefficients, 4, d.to_array())[0];
        for other in [
            Vec3::X,
            Vec3::Y,
            Vec3::Z,
            Vec3::NEG_X,
            Vec3::NEG_Y,
            Vec3::NEG_Z,
        ] {
            assert!(other == d || value(other) < value(d) / 2.0);
        }
        let [x, y, z] = map.direction(column, row).map(|v| v as f32);
        assert!(map.sample(Vec3::new(x, y, z))[0] > 99.0);
    }
}

#[test]
fn the_brightest_share_of_an_even_map_is_its_size_and_of_a_lamp_all() {
    let even = EnvironmentMap::new(100, 50, vec![[1.0; 3]; 5000]);
    assert!((even.brightest_share(0.25) - 0.25).abs() < 0.001);
    let mut pixels = vec![[0f32; 3]; 5000];
    pixels[2050] = [1.0; 3];
    let lamp = EnvironmentMap::new(100, 50, pixels);
    assert_eq!(lamp.brightest_share(0.001), 1.0);
}

#[test]
fn bad_pixels_are_counted_and_black() {
    let map = EnvironmentMap::new(
        2,
        2,
        vec![
            [f32::NAN, 1.0, 1.0],
            [-1.0, 2.0, 0.0],
            [f32::INFINITY; 3],
            [1.0; 3],
        ],
    );
    assert_eq!((map.repaired(), map.infinite()), (2, 1));
    assert_eq!(map.pixels()[2], [INFINITE_RADIANCE; 3]);
    assert_eq!(map.pixels()[0], [0.0, 1.0, 1.0]);
    assert_eq!(map.pixels()[1], [0.0, 2.0, 0.0]);
    let light = project_environment(&map, 8);
    assert!(light.coefficients.iter().flatten().all(|v| v.is_finite()));
    let huge = EnvironmentMap::new(64, 32, vec![[f32::MAX; 3]; 64 * 32]);
    assert_eq!(huge.repaired(), 64 * 32);
    let light = project_environment(&huge, 8);
    assert!(light.coefficients.iter().flatten().all(|v| v.is_finite()));
}

#[test]
fn reducing_and_blurring_keep_the_light() {
    let map = test_map(200, 100);
    let light = project_environment(&map, 2);
    for (changed, tolerance) in [
        (map.reduced(64), 0.02),
        (map.blurred(6.0), 0.02),
        // A wide blur takes from the higher bands what it should: exp(-l(l+1) sigma^2 / 2); band 0 stays.
        (map.blurred(40.0), 0.05),
    ] {
        assert_eq!(changed.width(), 2 * changed.height());
        let found = project_environment(&changed, 2);
        for c in 0..3 {
            let (a, b) = (light.coefficients[0][c], found.coefficients[0][c]);
            assert!((a - b).abs() < tolerance * a, "{a} {b}");
        }
    }
    assert_eq!(map.blurred(0.0).pixels(), map.pixels());
}

#[test]
fn a_blurred_point_is_round_at_every_latitude() {
    for row in [2, 30, 64] {
        let mut pixels = vec![[0f32; 3]; 256 * 128];
        pixels[row * 256 + 40] = [1e3; 3];
        let map = EnvironmentMap::new(256, 128, pixels);
        let point = Vec3::from_array(map.direction(40, row).map(|v| v as f32));
        let blurred = map.blurred(8.0);
        let (a, b) = point.any_orthonormal_pair();
        let at = |axis: Vec3, degrees: f32| {
            let (sin, cos) = degrees.to_radians().sin_cos();
            blurred.sample(point * cos + axis * sin)[0]
        };
        let around = [a, b, -a, -b].map(|axis| at(axis, 8.0));
        // exp(-1/2) of the peak; at the pole a spot is drawn towards it.
        let shares = around.map(|value| value / at(a, 0.0));
        let mean = shares.iter().sum::<f32>() / 4.0;
        assert!((mean - 0.607).abs() < 0.1, "row {row}: {shares:?}");
        assert!(
            shares.iter().all(|s| (s - 0.607).abs() < 0.3),
            "row {row}: {shares:?}"
        );
    }
}

#[test]
fn mirroring_mirrors() {
    let light = project_environment(&test_map(64, 32), 4);
    let mirrored = light.mirrored();
    for d in crate::sh::fibonacci_sphere(20) {
        let d = d.map(|v| v as f32);
        let a = evaluate_sh(&light.coefficients, 4, [d[0], -d[1], d[2]]);
        let b = evaluate_sh(&mirrored.coefficients, 4, d);
        assert!((a[0] - b[0]).abs() < 1e-4 * (1.0 + a[0].abs()));
    }
}
