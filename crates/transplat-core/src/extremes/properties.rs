//! Invariants over random splats, lights and settings.

use glam::{DMat3, DVec3, Vec2, Vec3};
use proptest::prelude::*;

use crate::bake::Bake;
use crate::bake::harmonic::HarmonicBake;
use crate::color::Encoding;
use crate::environment::{EnvironmentMap, Illumination};
use crate::oracle::difference;
use crate::progress::no_progress;
use crate::settings::{Method, Terms, TransferSettings};
use crate::sh::{MAX_DEGREE, coefficient_count, rotate_functions};
use crate::surfels::{SurfelCloud, Thickness, UpAxis};
use crate::synthetic;
use crate::transfer::{Part, PreparedTransfer, Relit};

/// So many cases, unless a variable of the environment asks for more.
pub(crate) fn config(variable: &str, cases: u32) -> ProptestConfig {
    let asked = std::env::var(variable).ok();
    ProptestConfig {
        cases: asked.and_then(|n| n.parse().ok()).unwrap_or(cases),
        failure_persistence: None,
        ..ProptestConfig::default()
    }
}

fn unit() -> impl Strategy<Value = Vec3> {
    (-1f32..1.0, 0f32..std::f32::consts::TAU).prop_map(|(z, phi)| {
        let r = (1.0 - z * z).sqrt();
        Vec3::new(r * phi.cos(), r * phi.sin(), z)
    })
}

prop_compose! {
    fn surfel(k: usize)(
        position in prop::array::uniform3(-1f32..1.0),
        normal in unit(),
        size in (-7f32..0.0, -3f32..0.0),
        opacity in 0f32..1.0,
        dc in prop::array::uniform3(-1f32..2.0),
        sh in prop::collection::vec(prop::array::uniform3(-0.3f32..0.3), k - 1),
    ) -> (Vec3, Vec3, Vec2, f32, Vec<[f32; 3]>) {
        let scale = Vec2::new(size.0.exp(), (size.0 + size.1).exp());
        let colour = std::iter::once(dc).chain(sh).collect();
        (Vec3::from_array(position), normal, scale, opacity, colour)
    }
}

fn cloud() -> impl Strategy<Value = SurfelCloud> {
    (0usize..=3).prop_flat_map(|degree| {
        let surfels = prop::collection::vec(surfel(coefficient_count(degree)), 1..24);
        surfels.prop_map(move |surfels| SurfelCloud {
            positions: surfels.iter().map(|s| s.0).collect(),
            tangents: surfels
                .iter()
                .map(|s| s.1.any_orthonormal_pair().into())
                .collect(),
            scales: surfels.iter().map(|s| s.2).collect(),
            // Surfels, 3D Gaussians, and such as were trained antialiased.
            thicknesses: (surfels.iter().enumerate())
                .map(|(i, s)| match i % 3 {
                    0 => Thickness::FLAT,
                    kind => Thickness::of_gaussian(0.1 * s.2.x, kind == 2),
                })
                .collect(),
            opacities: surfels.iter().map(|s| s.3).collect(),
            sh: surfels.into_iter().flat_map(|s| s.4).collect(),
            sh_degree: degree,
            encoding: Encoding::Stored,
            up: UpAxis::PlusZ,
            outside_from: Vec::new(),
            origin: DVec3::ZERO,
        })
    })
}

/// Pixels over nine decades, some of them black.
fn light() -> impl Strategy<Value = Illumination> {
    let pixel = prop_oneof![
        1 => Just([0f32; 3]),
        4 => prop::array::uniform3(-9f32..11.0).prop_map(|v| v.map(f32::exp)),
    ];
    prop::collection::vec(pixel, 32).prop_map(|mut pixels| {
        pixels[0] = pixels[0].map(|v| v.max(1e-3));
        Illumination::of(&EnvironmentMap::new(8, 4, pixels), MAX_DEGREE)
    })
}

prop_compose! {
    fn settings(method: Method)(
        degree in 0usize..=MAX_DEGREE,
        epsilon in -13f32..1.0,
        on in prop::collection::vec(prop::bool::weighted(0.8), Terms::ALL.len()),
    ) -> TransferSettings {
        let mut settings = TransferSettings::of(method);
        settings.sh_degree = degree;
        settings.epsilon = Some(epsilon.exp().max(1e-6));
        for (term, on) in Terms::ALL.iter().zip(on) {
            *(term.of)(&mut settings.terms) = on || !term.methods.contains(&method);
        }
        settings
    }
}

fn bake(cloud: &SurfelCloud, method: Method) -> Bake {
    Bake::new(cloud, method, 32, &no_progress).expect("small")
}

fn relight(
    cloud: &SurfelCloud,
    bake: &Bake,
    lights: [&Illumination; 2],
    settings: &TransferSettings,
) -> Relit {
    let prepared = PreparedTransfer::new(cloud, bake, lights[0], settings).expect("good input");
    let relit = prepared.relight(lights[1], Part::Whole);
    relit.expect("for both").of_degree(cloud.sh_degree)
}

fn any_preset() -> impl Strategy<Value = TransferSettings> {
    prop_oneof![settings(Method::Directional), settings(Method::Harmonic)]
}

proptest! {
    #![proptest_config(config("PROPTEST_CASES", 48))]

    #[test]
    fn results_are_numbers_and_units_do_not_matter(
        cloud in cloud(), source in light(), target in light(), settings in any_preset(),
        stops in -30i32..30,
    ) {
        let bake = bake(&cloud, settings.method);
        let relit = relight(&cloud, &bake, [&source, &target], &settings);
        prop_assert!(relit.sh.iter().chain(&relit.tau).flatten().all(|v| v.is_finite()));
        let k = (stops as f32).exp2();
        let scaled = relight(&cloud, &bake, [&source.scaled(k), &target.scaled(k)], &settings);
        // Powers of two round nothing, but for what is summed with constants.
        prop_assert!(difference(&scaled.sh, &relit.sh).0 < 1e-5);
    }

    #[test]
    fn a_black_target_is_black(cloud in cloud(), source in light(), mut settings in any_preset()) {
        // But for what shines by itself.
        settings.terms.emission = false;
        let black = Illumination::of(&EnvironmentMap::new(1, 1, vec![[0.0; 3]]), MAX_DEGREE);
        let bake = bake(&cloud, settings.method);
        let relit = relight(&cloud, &bake, [&source, &black], &settings).linear();
        prop_assert!(relit.sh.iter().flatten().all(|v| v.abs() < 1e-3));
    }

    #[test]
    fn best_returns_the_asset_under_its_own_light(cloud in cloud(), source in light()) {
        let settings = TransferSettings::default();
        let bake = bake(&cloud, Method::Directional);
        let relit = relight(&cloud, &bake, [&source, &source], &settings);
        prop_assert!(difference(&relit.sh, &cloud.sh).0 < 1e-3, "{}", difference(&relit.sh, &cloud.sh).0);
    }

    #[test]
    fn paper_is_linear_in_the_target(
        cloud in cloud(), source in light(), a in light(), b in light(), mut settings in settings(Method::Harmonic),
        share in 0f32..1.0,
    ) {
        settings.sh_degree = settings.sh_degree.min(4);
        let bake = bake(&cloud, Method::Harmonic);
        let mut mixed = a.clone();
        for (m, (a, b)) in mixed.radiance.coefficients.iter_mut().zip(a.radiance.coefficients.iter().zip(&b.radiance.coefficients)) {
            *m = std::array::from_fn(|c| share * a[c] + (1.0 - share) * b[c]);
        }
        // The clamp of a negative irradiance is what is not linear.
        let linear = |light: &Illumination| relight(&cloud, &bake, [&source, light], &settings);
        let (of_a, of_b, of_mixed) = (linear(&a), linear(&b), linear(&mixed));
        let k = coefficient_count(cloud.sh_degree);
        let size = of_a.sh.iter().chain(&of_b.sh).flatten().fold(1e-6f32, |s, v| s.max(v.abs()));
        for i in 0..cloud.len() {
            let was_clamped = (0..3).any(|c| of_a.sh[i * k][c] <= 0.0 || of_b.sh[i * k][c] <= 0.0 || of_mixed.sh[i * k][c] <= 0.0);
            if was_clamped {
                continue;
            }
            for j in i * k..(i + 1) * k {
                for c in 0..3 {
                    let sum = share * of_a.sh[j][c] + (1.0 - share) * of_b.sh[j][c];
                    prop_assert!((sum - of_mixed.sh[j][c]).abs() < 1e-4 * size);
                }
            }
        }
    }

    #[test]
    fn paper_turns_with_asset_and_lights(
        mut cloud in cloud(), source in light(), target in light(), mut settings in settings(Method::Harmonic),
        axis in unit(), angle in 0f64..6.0,
    ) {
        // Stored colour is decoded at fixed directions.
        cloud.encoding = Encoding::Linear;
        // A turned lattice sees other gaps: without shadows only the mathematics is left.
        settings.terms.shadow = false;
        // Where the series cancels, a rounding of 1e-7 grows by up to 1 / epsilon times the light's own range.
        settings.epsilon = settings.epsilon.map(|e| e.max(1e-2));
        let turn = DMat3::from_axis_angle(DVec3::from(axis).normalize(), angle);
        let turned = synthetic::turned(&cloud, turn);
        let open = |cloud: &SurfelCloud| Bake::Harmonic(HarmonicBake::all_open(cloud, 16).into());
        let here = relight(&cloud, &open(&cloud), [&source, &target], &settings);
        let lights = [source.rotated(turn), target.rotated(turn)];
        let there = relight(&turned, &open(&turned), [&lights[0], &lights[1]], &settings);
        let expected = rotate_functions(turn, cloud.sh_degree, &here.sh);
        prop_assert!(difference(&there.sh, &expected).0 < 2e-3, "{}", difference(&there.sh, &expected).0);
    }
}
