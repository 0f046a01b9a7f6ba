use super::*;
use crate::bake::harmonic::bake;
use crate::environment::{EnvironmentMap, project_environment};
use crate::oracle::{OracleHarmonic, relight_surfel};
use crate::progress::no_progress;
use crate::settings::Method;
use crate::settings::optimizations::{Optimization, Optimizations};
use crate::sh::rotate_functions;
use crate::synthetic;
use glam::{DMat3, DVec3};

fn sky(seed: usize) -> EnvironmentMap {
    let (w, h) = (32, 16);
    let pixels = (0..w * h)
        .map(|i| {
            let v = ((i * 7919 + seed * 104_729) % 1013) as f32 / 1013.0;
            let sun = if i == 100 + 37 * seed { 40.0 } else { 0.0 };
            [v + sun, 0.5 * v + 0.8 * sun, 0.2 + v * v + 0.5 * sun]
        })
        .collect();
    EnvironmentMap::new(w, h, pixels)
}

fn light(seed: usize, degree: usize) -> IncidentRadiance {
    project_environment(&sky(seed), degree)
}

fn glossy_scene(degree: usize) -> SurfelCloud {
    synthetic::glossy_sphere_over_plate(200, degree)
}

fn settings(sh_degree: usize) -> TransferSettings {
    TransferSettings {
        sh_degree,
        // Bands are looked at one by one.
        optimizations: Optimizations::default().without(Optimization::EmptyBands),
        ..TransferSettings::of(Method::Harmonic)
    }
}

fn baked(cloud: &SurfelCloud) -> HarmonicBake {
    bake(cloud, 128, &no_progress).expect("not cancelled")
}

fn prepare(
    cloud: &SurfelCloud,
    visibility: &HarmonicBake,
    source: &IncidentRadiance,
    settings: &TransferSettings,
) -> HarmonicTransfer {
    HarmonicTransfer::new(cloud, visibility, source, settings).expect("good input")
}

fn largest(values: &[[f32; 3]]) -> f32 {
    values.iter().flatten().fold(0f32, |a, v| a.max(v.abs()))
}

/// Largest difference over the largest value.
fn relative_difference(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
    largest(&combined(a, b, |a, b| a - b)) / largest(a).max(1e-30)
}

fn combined(a: &[[f32; 3]], b: &[[f32; 3]], of: fn(f32, f32) -> f32) -> Vec<[f32; 3]> {
    let each = a.iter().zip(b);
    each.map(|(a, b)| std::array::from_fn(|c| of(a[c], b[c])))
        .collect()
}

#[test]
fn production_follows_the_oracle_with_every_term_on_and_off() {
    for (light_degree, asset_degree) in [(3, 3), (0, 2), (5, 3), (2, 4)] {
        let cloud = glossy_scene(asset_degree);
        let visibility = baked(&cloud);
        let (source, target) = (light(1, light_degree), light(2, light_degree));
        for off in ["", "shadow", "specular", "reflection", "attenuation"] {
            let mut settings = settings(light_degree);
            if !off.is_empty() {
                settings = settings.without(off).expect("a term of the preset");
            }
            let prepared = prepare(&cloud, &visibility, &source, &settings);
            let got = prepared.relight(&target);
            let oracle = OracleHarmonic::new(&source, &target, &settings);
            let v = visibility.coefficients(light_degree);
            let (ka, kl) = (
                coefficient_count(asset_degree),
                coefficient_count(light_degree),
            );
            let mut worst = 0f64;
            for i in 0..cloud.len() {
                let color: Vec<[f64; 3]> =
                    cloud.sh_of(i).iter().map(|c| c.map(f64::from)).collect();
                let v: Vec<f64> = v[i * kl..][..kl].iter().map(|v| f64::from(*v)).collect();
                let exact = relight_surfel(
                    &oracle,
                    &color,
                    prepared.normals[i].to_array().map(f64::from),
                    &v,
                );
                for (e, g) in exact.iter().flatten().zip(got[i * ka..].iter().flatten()) {
                    worst = worst.max((e - f64::from(*g)).abs() / (1.0 + e.abs()));
                }
            }
            // K roundings of the light (2^-24 each), over a source irradiance that the clamp leaves as small as epsilon (5 %): 20 K 2^-24.
            assert!(
                worst < 1e-4,
                "degree {light_degree}/{asset_degree} without {off:?}: {worst}"
            );
        }
    }
}

#[test]
fn scaling_both_lights_changes_nothing_and_the_target_scales_the_result() {
    let cloud = glossy_scene(3);
    let visibility = baked(&cloud);
    let (source, target) = (light(1, 3), light(2, 3));
    let relit = |source: &IncidentRadiance, target: &IncidentRadiance| {
        prepare(&cloud, &visibility, source, &settings(3)).relight(target)
    };
    let reference = relit(&source, &target);
    for k in [1e-12, 0.37, 1e9] {
        let both = relit(&source.scaled(k), &target.scaled(k));
        // Only roundings of the scaled coefficients differ, amplified by small denominators.
        assert!(relative_difference(&reference, &both) < 1e-4, "both by {k}");
    }
    let doubled = relit(&source, &target.scaled(2.0));
    for (a, b) in reference.iter().flatten().zip(doubled.iter().flatten()) {
        assert_eq!(2.0 * a, *b);
    }
}

#[test]
fn the_result_is_linear_in_the_target() {
    // Irradiance is clamped at zero, so linearity holds where no clamp acts: an even light keeps it away.
    let cloud = glossy_scene(3);
    let visibility = baked(&cloud);
    let prepared = prepare(&cloud, &visibility, &light(1, 3), &settings(3));
    let (a, b) = (light(2, 3), IncidentRadiance::even(3).scaled(20.0));
    let with_b = |light: &IncidentRadiance| IncidentRadiance {
        degree: 3,
        coefficients: combined(&light.coefficients, &b.coefficients, |a, b| a + b),
    };
    let once = with_b(&a);
    // f(a + 2b) - f(a + b) = f(b).
    let [one, two, even] = [&once, &with_b(&once), &b].map(|light| prepared.relight(light));
    assert!(relative_difference(&even, &combined(&two, &one, |t, o| t - o)) < 1e-4);
}

#[test]
fn turning_asset_and_lights_together_turns_the_result() {
    let cloud = glossy_scene(3);
    let visibility = baked(&cloud);
    let (source, target) = (light(1, 3), light(2, 3));
    let turn = DMat3::from_axis_angle(DVec3::new(0.6, -0.48, 0.64).normalize(), 1.1);
    let turned = synthetic::turned(&cloud, turn);
    // The bake's lattice does not turn with the object, so the transfer is asked with visibility that sees everything.
    let mut open = HarmonicBake::all_open(&cloud, 16);
    open.normals.clone_from(&visibility.normals);
    let mut open_turned = open.clone();
    for n in &mut open_turned.normals {
        *n = turn.as_mat3() * *n;
    }
    let mut without_shadow = settings(3);
    without_shadow.terms.shadow = false;
    let [source_turned, target_turned] = [&source, &target].map(|l| l.rotated(turn));
    let straight = prepare(&cloud, &open, &source, &without_shadow).relight(&target);
    let around = prepare(&turned, &open_turned, &source_turned, &without_shadow);
    let around = around.relight(&target_turned);
    let expected = rotate_functions(turn, 3, &straight);
    assert!(relative_difference(&expected, &around) < 1e-3);
    // With the bake: the mean changes by no more than what 128 directions resolve.
    let mean = |cloud: &SurfelCloud, source: &IncidentRadiance, target: &IncidentRadiance| {
        let relit = prepare(cloud, &baked(cloud), source, &settings(3)).relight(target);
        relit
            .chunks_exact(16)
            .map(|f| f64::from(f[0][0]))
            .sum::<f64>()
            / cloud.len() as f64
    };
    let a = mean(&cloud, &source, &target);
    let b = mean(&turned, &source_turned, &target_turned);
    assert!((a - b).abs() < 0.02 * a, "{a} {b}");
}

#[test]
fn black_targets_give_black_and_black_sources_stay_finite() {
    let cloud = glossy_scene(3);
    let visibility = baked(&cloud);
    let black = IncidentRadiance::even(3).scaled(0.0);
    let prepared = prepare(&cloud, &visibility, &light(1, 3), &settings(3));
    assert_eq!(largest(&prepared.relight(&black)), 0.0);
    let dark = prepare(&cloud, &visibility, &black, &settings(3));
    assert!(dark.source_was_black);
    let relit = dark.relight(&light(2, 3));
    assert!(relit.iter().flatten().all(|v| v.is_finite()) && largest(&relit) > 0.0);
}

#[test]
fn full_visibility_and_no_shadow_agree() {
    let cloud = glossy_scene(3);
    let open = HarmonicBake::all_open(&cloud, 4096);
    let (source, target) = (light(1, 3), light(2, 3));
    let mut unshadowed = settings(3);
    unshadowed.terms.shadow = false;
    let a = prepare(&cloud, &open, &source, &settings(3));
    let b = prepare(&cloud, &open, &source, &unshadowed);
    // The constant 1 on 4096 directions has other coefficients up to some 1/4096, which meet a light with a peak of 40 over a mean of 1.
    let difference = relative_difference(&b.relight(&target), &a.relight(&target));
    assert!(difference < 2e-2, "{difference}");
}

#[test]
fn a_lambertian_sphere_takes_its_analytic_irradiance() {
    // Source: even light of radiance 1, E = pi. Target: radiance 1 + z, of which E = pi + 2 pi/3 n.z exactly.
    let cloud = synthetic::sphere(300);
    let mut no_shadow = settings(2);
    no_shadow.terms.shadow = false;
    no_shadow.epsilon = Some(1e-6);
    let open = HarmonicBake::all_open(&cloud, 16);
    let even = IncidentRadiance::even(2);
    let prepared = prepare(&cloud, &open, &even, &no_shadow);
    let mut target = IncidentRadiance::even(2);
    target.coefficients[2] = [(4.0 * PI / 3.0).sqrt(); 3];
    for (relit, p) in prepared.relight(&target).iter().zip(&cloud.positions) {
        let y0 = 1.0 / SQRT_4PI as f32;
        let expected = 0.5 * (1.0 + 2.0 / 3.0 * p.z);
        assert!(
            (relit[0] * y0 - expected).abs() < 2e-6,
            "{} for {expected}",
            relit[0] * y0
        );
    }
}

#[test]
fn extreme_lights_and_assets_stay_finite() {
    let mut cloud = glossy_scene(3);
    for (i, c) in cloud.sh.iter_mut().enumerate() {
        match i % 5 {
            0 => *c = [1e6; 3],
            1 => *c = [-1e6; 3],
            2 => *c = [0.0; 3],
            _ => {}
        }
    }
    let visibility = baked(&cloud);
    for encoding in [Encoding::Stored, Encoding::Linear] {
        cloud.encoding = encoding;
        for (a, b) in [(1e-30, 1e30), (1e30, 1e-30), (1.0, 1e20), (1e-20, 1.0)] {
            for epsilon in [1e-6, 1.0] {
                let mut settings = settings(3);
                settings.epsilon = Some(epsilon);
                let source = light(1, 3).scaled(a);
                let prepared = prepare(&cloud, &visibility, &source, &settings);
                let relit = prepared.relight(&light(2, 3).scaled(b));
                assert!(
                    relit.iter().flatten().all(|v| v.is_finite()),
                    "{a} {b} {epsilon}"
                );
                let stored = crate::color::encode_sh(relit, 3, Encoding::Stored);
                assert!(
                    stored.iter().flatten().all(|v| v.is_finite()),
                    "{a} {b} {epsilon}"
                );
            }
        }
    }
}

#[test]
fn what_a_scene_lacks_is_left_out() {
    let cloud = synthetic::sphere(100);
    let visibility = HarmonicBake::all_open(&cloud, 16);
    let mut no_shadow = settings(3);
    no_shadow.terms.shadow = false;
    let prepared = prepare(&cloud, &visibility, &light(1, 3), &no_shadow);
    assert_eq!(prepared.specular_degree, 0);
    assert!(prepared.visibility.is_empty() && prepared.attenuation.is_empty());
}

#[test]
fn an_even_source_tells_nothing_of_gloss() {
    let cloud = glossy_scene(3);
    let even = IncidentRadiance::even(3);
    let prepared = prepare(&cloud, &baked(&cloud), &even, &settings(3));
    assert_eq!(prepared.specular_degree, 0);
    let relit = prepared.relight(&light(2, 3));
    assert!(
        relit
            .chunks_exact(16)
            .all(|f| f[1..].iter().flatten().all(|v| *v == 0.0))
    );
}

#[test]
fn a_light_of_another_degree_is_refused_or_fitted() {
    let cloud = glossy_scene(3);
    let visibility = baked(&cloud);
    let wrong = HarmonicTransfer::new(&cloud, &visibility, &light(1, 2), &settings(3));
    assert!(wrong.is_err_and(|e| e.to_string().contains("degree 2")));
    let prepared = prepare(&cloud, &visibility, &light(1, 3), &settings(3));
    let [short, exact, longer] = [1, 3, 5].map(|degree| prepared.relight(&light(2, degree)));
    assert!(relative_difference(&exact, &longer) < 1e-5);
    assert!(short.iter().flatten().all(|v| v.is_finite()));
}
