use std::f32::consts::PI;

use glam::{DMat3, DVec3, Vec3};

use super::neighbors::Neighbors;
use super::specular_lobe::LEAST_GLOSS;
use super::*;
use crate::bake::directional::DirectionalBake;
use crate::bake::trace::places_and_normals;
use crate::color::Encoding;
use crate::color_rows::SHORT_FROM;
use crate::environment::{EnvironmentMap, Illumination};
use crate::progress::no_progress;
use crate::settings::GLOW_ABOVE;
use crate::settings::optimizations::Optimizations;
use crate::surfels::SurfelCloud;
use crate::synthetic;
use crate::transfer::materials::Material;
use crate::transfer::{Relight, Relit};

fn asset_of(cloud: &SurfelCloud) -> Arc<DirectionalCache> {
    let bake = Arc::new(DirectionalBake::all_rays(cloud));
    Arc::new(DirectionalCache::new(
        cloud,
        bake,
        &Optimizations::default(),
    ))
}

fn prepared(asset: &Arc<DirectionalCache>, source: &Illumination) -> DirectionalTransfer {
    DirectionalTransfer::new(asset, source, &TransferSettings::default()).expect("with beams")
}

impl DirectionalTransfer {
    fn relight_by(&self, target: &Illumination) -> Relit {
        let light = self.light(target).expect("with beams");
        self.relight(light, Part::Whole, &[])
    }
}

/// What the window shows is what is exported, but for sixteen bits: every part, and surfels that nobody sees.
#[test]
fn rows_hold_what_is_relit() {
    let asset = asset_of(&specular());
    let transfer = prepared(&asset, &sky(DVec3::new(0.4, 0.2, 0.9), [1.0; 3]));
    let target = sky(DVec3::new(-0.6, 0.5, 0.6), [1.2, 1.0, 0.7]);
    let light = transfer.light(&target).expect("with beams");
    let (n, k) = (asset.bake.len(), coefficient_count(asset.nodes.degree));
    let unseen: Vec<bool> = (0..n).map(|i| i % 7 == 0).collect();
    for part in [Part::Whole, Part::Diffuse, Part::Specular] {
        let whole = transfer.relight(light.clone(), part, &unseen);
        let rows = (transfer.relight_rows(&target, part, &unseen)).expect("with beams");
        // So few are as they are.
        assert_eq!((&*rows.sh.values(), &rows.tau), (&whole.sh[..], &whole.tau));
        let short = ColorRows::new(n, k, SHORT_FROM);
        let short = transfer.relight_in(short, light.clone(), part, &unseen);
        assert_eq!(short.tau, whole.tau);
        let held = short.sh.values();
        for (a, b) in whole.sh.chunks(k).zip(held.chunks(k)) {
            let largest = a.iter().flatten().fold(0f32, |l, v| l.max(v.abs()));
            for (a, b) in a.iter().flatten().zip(b.iter().flatten()) {
                // Half of a unit, of which the largest has 32,767.
                assert!((a - b).abs() <= 1.6e-5 * largest, "{part:?}: {a} {b}");
            }
        }
    }
}

/// A gradient with a sun, and its colours.
fn sky(sun: DVec3, tint: [f32; 3]) -> Illumination {
    let map = EnvironmentMap::of_directions(256, 128, |d| {
        let is_sun = d.dot(sun.normalize()) > 0.9994;
        let glare = if is_sun { 300.0 } else { 0.0 };
        tint.map(|t| t * (0.6 + 0.5 * d.z as f32) + glare)
    });
    Illumination::of(&map, 3)
}

/// A sphere over a plate whose colour varies with the place and the view.
fn specular() -> SurfelCloud {
    let mut cloud = synthetic::sphere_over_plate(500);
    let k = coefficient_count(3);
    cloud.sh = cloud
        .sh
        .iter()
        .enumerate()
        .flat_map(|(i, dc)| {
            (0..k).map(move |j| match j {
                0 => *dc,
                _ => std::array::from_fn(|c| 0.1 * ((i * 13 + j * 7 + c) as f32).sin() / j as f32),
            })
        })
        .collect();
    cloud.sh_degree = 3;
    cloud
}

fn farthest(a: &[[f32; 3]], b: &[[f32; 3]]) -> f32 {
    assert!(a.iter().chain(b).flatten().all(|v| v.is_finite()));
    a.iter()
        .flatten()
        .zip(b.iter().flatten())
        .map(|(a, b)| (a - b).abs())
        .fold(0.0, f32::max)
}

#[test]
fn the_source_light_returns_the_asset() {
    let cloud = specular();
    let source = sky(DVec3::new(0.4, 0.2, 0.9), [1.0, 0.9, 0.8]);
    let relit = prepared(&asset_of(&cloud), &source).relight_by(&source);
    // The bounced light's fixed point starts at the source's own radiance, so nothing but rounding is left.
    let off = farthest(&relit.sh, &cloud.sh);
    assert!(off < 1e-3, "{off}");
    assert!(relit.tau.iter().flatten().all(|t| (t - 1.0).abs() < 1e-3));
}

#[test]
fn the_strength_of_both_lights_changes_nothing() {
    let cloud = specular();
    let asset = asset_of(&cloud);
    let source = sky(DVec3::new(0.4, 0.2, 0.9), [1.0, 0.9, 0.8]);
    let target = sky(DVec3::new(-0.8, 0.3, 0.4), [0.4, 0.6, 1.0]);
    let relit = prepared(&asset, &source).relight_by(&target);
    for gain in [1e-6, 1e6] {
        let same =
            prepared(&asset, &source.tinted([gain; 3])).relight_by(&target.tinted([gain; 3]));
        assert!(farthest(&relit.sh, &same.sh) < 1e-3, "gain {gain}");
    }
}

#[test]
fn a_matte_sphere_takes_its_analytic_irradiance() {
    // Open all around: E of a gradient a + b z is pi a + 2 pi b n.z / 3, and the sphere was lit evenly.
    let cloud = synthetic::sphere(800);
    let transfer = prepared(&asset_of(&cloud), &Illumination::even(3));
    let gradient = EnvironmentMap::of_directions(128, 64, |d| [0.5 + 0.4 * d.z as f32; 3]);
    let relit = transfer.relight_by(&Illumination::of(&gradient, 3));
    let mut worst = 0f32;
    for (i, tau) in relit.tau.iter().enumerate() {
        let z = cloud.positions[i].normalize().z;
        let exact = 0.5 + 0.4 * 2.0 / 3.0 * z;
        worst = worst.max((tau[0] / exact - 1.0).abs());
    }
    // 384 directions, of which those at the horizon are cut by the neighbours' discs in both lights.
    assert!(worst < 0.03, "{worst}");
}

#[test]
fn a_black_target_is_black_and_a_black_source_is_finite() {
    let cloud = specular();
    let asset = asset_of(&cloud);
    let black = Illumination::even(3).scaled(0.0);
    let relit = prepared(&asset, &Illumination::even(3)).relight_by(&black);
    // Bounced light falls from turn to turn, each a product of albedo and occlusion, and starts from nothing.
    assert!(relit.tau.iter().flatten().all(|t| *t == 0.0));
    let linear = crate::color::decode_sh(&relit.sh, cloud.sh_degree, cloud.encoding);
    assert!(linear.iter().flatten().all(|v| v.abs() < 1e-4));
    let relit = prepared(&asset, &black).relight_by(&Illumination::even(3));
    assert!(relit.sh.iter().flatten().all(|v| v.is_finite()));
}

#[test]
fn turning_asset_and_lights_turns_the_result() {
    let cloud = specular();
    let turn = DMat3::from_axis_angle(DVec3::new(0.3, -0.2, 0.9).normalize(), 1.1);
    let turned = synthetic::turned(&cloud, turn);
    let source = sky(DVec3::new(0.4, 0.2, 0.9), [1.0, 0.9, 0.8]);
    let target = sky(DVec3::new(-0.8, 0.3, 0.4), [0.4, 0.6, 1.0]);
    let here = prepared(&asset_of(&cloud), &source).relight_by(&target);
    let there =
        prepared(&asset_of(&turned), &source.rotated(turn)).relight_by(&target.rotated(turn));
    // The lattice stays where it is, so the sums differ by its coarseness: in the mean, not surfel by surfel.
    let mean = |tau: &[[f32; 3]]| tau.iter().map(|t| t[1]).sum::<f32>() / tau.len() as f32;
    let (a, b) = (mean(&here.tau), mean(&there.tau));
    assert!((a / b - 1.0).abs() < 0.02, "{a} {b}");
    let apart = here.tau.iter().zip(&there.tau);
    let apart = apart.map(|(a, b)| (a[1] - b[1]).abs());
    let typical = apart.sum::<f32>() / here.tau.len() as f32;
    assert!(typical < 0.1 * a, "{typical} of {a}");
}

#[test]
fn a_metal_is_found_and_a_matte_surface_is_not() {
    // Each surfel of a sphere shows what it mirrors (a metal), or its irradiance (plaster), under a sky with a sun.
    let source = sky(DVec3::new(0.4, 0.2, 0.9), [1.0, 0.9, 0.8]);
    for metal in [true, false] {
        let mut cloud = synthetic::sphere(600);
        cloud.sh_degree = 3;
        cloud.encoding = Encoding::Linear;
        // Something in each band, so that none is left out; replaced below.
        cloud.sh = vec![[0.1; 3]; cloud.len() * 16].into();
        let asset = asset_of(&cloud);
        let settings = TransferSettings::default();
        let light_samples = source.for_directional().expect("with beams");
        let light = asset.light(
            (light_samples.0, light_samples.1, &[]),
            (1.0, [1.0; 3]),
            &settings,
            [0.0; 3],
        );
        let light = asset.incident(light, &settings, None);
        let radiance = asset.captured_radiance();
        let mut rays = Rays::default();
        let mut values = vec![0f32; 3 * asset.nodes.count()];
        for i in 0..cloud.len() {
            asset.rays_of(i, &light, &radiance, &mut rays);
            let frame = SurfelFrame::new(asset.bake.normals[i]);
            mirrored(&asset.nodes, frame, 4, &rays, &mut values);
            let q = asset.nodes.count();
            let shown: Vec<[f32; 3]> = (0..q)
                .map(|s| {
                    std::array::from_fn(|c| {
                        if metal {
                            0.8 * values[c * q + s]
                        } else {
                            0.5 / PI * light.irradiance[i][0][c]
                        }
                    })
                })
                .collect();
            let mut f = asset.nodes.function(&asset.nodes.fit, &shown);
            frame.apply_sh(3, &mut f);
            cloud.sh[i * 16..][..16].copy_from_slice(&f);
        }
        let transfer = prepared(&asset_of(&cloud), &source);
        let is_metal = |g: &&SpecularLobe| !g.is_diffuse() && !g.has_fresnel;
        let metals = transfer.specular_lobe.iter().filter(is_metal).count();
        if metal {
            assert!(metals * 10 > 9 * cloud.len(), "{metals}");
            // The colour was made under the light as it is, and is explained by the light that the transfer works in.
            let sum: f32 = transfer
                .specular_lobe
                .iter()
                .map(|g| g.reflectance[1])
                .sum();
            let mean = sum * transfer.light_gain / cloud.len() as f32;
            assert!((mean - 0.8).abs() < 0.1, "{mean}");
            let mean = |of: fn(&Material) -> f32| mean_of(&transfer, of);
            assert!((mean(|m| m.base_color[1]) - 0.8).abs() < 0.1);
            assert!(mean(|m| m.metallic) > 0.85);
            // The exponent is 16.
            assert!((mean(|m| m.roughness) - 0.5).abs() < 0.05);
            // One in four tells it of the others as well.
            let mut asset = asset_of(&cloud);
            let few = Arc::get_mut(&mut asset).expect("nobody else has it");
            let bake = &few.bake;
            let points = places_and_normals(&bake.tracer.surfels, &bake.normals);
            few.neighbors = Neighbors::new(&points, 4, &bake.visible_weight);
            assert!(few.neighbors.asked().len() * 3 < cloud.len());
            let told = prepared(&asset, &source);
            let off = |(a, b): (&SpecularLobe, &SpecularLobe)| {
                assert!(
                    a.has_fresnel == b.has_fresnel && a.width == b.width,
                    "{a:?} {b:?}"
                );
                (a.reflectance[1] / b.reflectance[1] - 1.0).abs()
            };
            let off: f32 = told
                .specular_lobe
                .iter()
                .zip(&transfer.specular_lobe)
                .map(off)
                .sum();
            assert!(off < 0.02 * cloud.len() as f32, "{off}");
        } else {
            assert_eq!(metals, 0);
            let mean = |of: fn(&Material) -> f32| mean_of(&transfer, of);
            assert!((mean(|m| m.base_color[1]) - 0.5).abs() < 0.02);
            assert!(mean(|m| m.metallic) == 0.0);
            let most = transfer
                .specular_lobe
                .iter()
                .map(|g| g.reflectance[1])
                .fold(0f32, f32::max);
            assert!(most < 0.02, "{most}");
            // What regression finds of it all the same is too faint to be seen, and leaving it out changes what is seen by no more.
            assert!(transfer.faintly_specular > 0);
            let settings = TransferSettings {
                optimizations: Optimizations::default().without(Optimization::DiffuseSurfels),
                ..TransferSettings::default()
            };
            let asset = asset_of(&cloud);
            let exact = DirectionalTransfer::new(&asset, &source, &settings).expect("with beams");
            let target = sky(DVec3::new(-0.6, 0.3, 0.7), [0.8, 0.9, 1.0]);
            let (exact, skipped_work) = (exact.relight_by(&target), transfer.relight_by(&target));
            let brightest = exact.sh.iter().flatten().fold(0f32, |a, b| a.max(*b));
            let off = farthest(&exact.sh, &skipped_work.sh);
            assert!(off < LEAST_GLOSS * brightest, "{off} of {brightest}");
        }
    }
}

/// The mean of something over all materials.
fn mean_of(transfer: &DirectionalTransfer, of: fn(&Material) -> f32) -> f32 {
    let each = transfer.materials_of(None).each;
    each.iter().map(of).sum::<f32>() / each.len() as f32
}

/// Of 0.5 of the light a white surface scatters 0.5 / pi; the widest lobe's peak is 9 / 4 pi.
#[test]
fn gloss_that_does_not_show_beside_white_is_taken_away() {
    let specular_lobe = |green: f32| SpecularLobe {
        reflectance: [0.0, green, 0.0],
        width: 3,
        has_fresnel: true,
    };
    let least = 1e-3 * 0.5 * 4.0 / 9.0;
    let mut all = [
        specular_lobe(0.9 * least),
        specular_lobe(1.1 * least),
        SpecularLobe::default(),
    ];
    assert_eq!(SpecularLobe::take_unseen(&mut all, 0.5), 1);
    assert_eq!(all.map(|g| g.is_diffuse()), [true, false, true]);
}

#[test]
fn extreme_lights_are_finite_and_what_the_source_lacks_stays_bounded() {
    let cloud = specular();
    let asset = asset_of(&cloud);
    let white = sky(DVec3::Z, [1.0; 3]);
    let red = white.tinted([1.0, 0.0, 0.0]);
    let relit = prepared(&asset, &red).relight_by(&white);
    // White has three times red's mean; a surfel that faces its sun has four times that, over a twentieth: 240, and what bounces.
    assert!(relit.tau.iter().flatten().all(|t| *t < 500.0));
    assert!(farthest(&prepared(&asset, &red).relight_by(&red).sh, &cloud.sh) < 1e-3);
    let (faint, glaring) = (white.scaled(1e-25), white.scaled(1e12));
    let relit = prepared(&asset, &faint).relight_by(&glaring);
    assert!(relit.sh.iter().flatten().all(|v| v.is_finite()));
    assert!(relit.tau.iter().flatten().all(|v| v.is_finite()));
}

#[test]
fn odd_assets_are_relit_to_numbers() {
    let one = synthetic::sphere(1);
    let mut clear = synthetic::sphere(50);
    clear.opacities.fill(0.1);
    let mut heap = synthetic::sphere(300);
    heap.positions.fill(Vec3::new(1.0, 2.0, 3.0));
    let mut flat = synthetic::sheet(20);
    flat.scales[3] = glam::Vec2::ZERO;
    flat.scales[4] = glam::Vec2::splat(1e6);
    for (name, cloud) in [
        ("one", one),
        ("clear", clear),
        ("heap", heap),
        ("flat", flat),
    ] {
        let source = sky(DVec3::new(0.4, 0.2, 0.9), [1.0, 0.9, 0.8]);
        let relit = prepared(&asset_of(&cloud), &source).relight_by(&Illumination::even(3));
        assert_eq!(relit.sh.len(), cloud.sh.len());
        assert!(relit.sh.iter().flatten().all(|v| v.is_finite()), "{name}");
    }
}

#[test]
fn matte_and_mirrored_light_are_the_parts_of_the_colour() {
    let sun = DVec3::new(0.4, 0.2, 0.9).normalize();
    let mut cloud = synthetic::mirroring_ball_plate_and_sheet(sun.as_vec3(), 3);
    // Linear colour, so that the parts add up; what the model misses is of neither.
    cloud.encoding = Encoding::Linear;
    let source = sky(sun, [1.0, 0.9, 0.8]);
    let mut settings = TransferSettings::default();
    settings.terms.residual = false;
    let transfer =
        DirectionalTransfer::new(&asset_of(&cloud), &source, &settings).expect("with beams");
    let target = sky(DVec3::new(-0.7, 0.1, 0.5), [0.3, 0.5, 0.9]);
    let light = transfer.light(&target).expect("with beams");
    let [whole, diffuse, mirrored] = [Part::Whole, Part::Diffuse, Part::Specular]
        .map(|part| transfer.relight(light.clone(), part, &[]).sh);
    let size = |f: &[[f32; 3]]| f.iter().flatten().fold(0f32, |a, b| a.max(b.abs()));
    assert!(size(&diffuse) > 0.1 && size(&mirrored) > 0.1);
    for ((w, a), b) in whole.iter().zip(&diffuse).zip(&mirrored) {
        for c in 0..3 {
            assert!((w[c] - a[c] - b[c]).abs() < 1e-5 * size(&whole));
        }
    }
    // A surface without gloss mirrors nothing.
    let k = coefficient_count(cloud.sh_degree);
    for (specular_lobe, f) in transfer.specular_lobe.iter().zip(mirrored.chunks_exact(k)) {
        assert!(!specular_lobe.is_diffuse() || size(f) < 1e-6);
    }
}

/// Where stored colour is a power of light, it is multiplied; elsewhere it is worked out at the nodes. Both are the same.
#[test]
fn a_multiplied_colour_is_what_the_nodes_say() {
    let sun = DVec3::new(0.4, 0.2, 0.9).normalize();
    let mut cloud = synthetic::mirroring_ball_plate_and_sheet(sun.as_vec3(), 3);
    let target = sky(DVec3::new(-0.7, 0.1, 0.5), [0.3, 0.5, 0.9]);
    for encoding in [Encoding::Stored, Encoding::StoredLinear, Encoding::Linear] {
        cloud.encoding = encoding;
        let transfer = prepared(&asset_of(&cloud), &sky(sun, [1.0, 0.9, 0.8]));
        let mut at_nodes = transfer.clone();
        at_nodes.darkest.fill([f32::NAN; 3]);
        let (fast, slow) = (transfer.relight_by(&target), at_nodes.relight_by(&target));
        let (mut multiplied, mut of_two_sides) = (0, 0);
        for (i, (a, b)) in fast.sh.chunks(16).zip(slow.sh.chunks(16)).enumerate() {
            let size = b.iter().flatten().fold(1f32, |a, b| a.max(b.abs()));
            assert!(
                farthest(a, b) < 1e-4 * size,
                "{encoding:?} {i}: {a:?} {b:?}"
            );
            multiplied += usize::from(a != b);
            of_two_sides += usize::from(a != b && transfer.asset.bake.two_sided[i] > 0.1);
        }
        let enough = multiplied * 20 > cloud.len() && of_two_sides > 10;
        assert!(enough, "{encoding:?}: {multiplied} and {of_two_sides}");
    }
}

#[test]
fn production_follows_the_oracle() {
    let sun = DVec3::new(0.4, 0.2, 0.9).normalize();
    let cloud = synthetic::mirroring_ball_plate_and_sheet(sun.as_vec3(), 3);
    let bake = Arc::new(DirectionalBake::bake(&cloud, &no_progress).expect("not cancelled"));
    assert!(bake.two_sided.iter().filter(|t| **t > 0.5).count() > 10);
    let source = sky(sun, [1.0, 0.9, 0.8]);
    let target = sky(DVec3::new(-0.7, 0.1, 0.5), [0.3, 0.5, 0.9]);
    let asset = DirectionalCache::new(&cloud, bake.clone(), &Optimizations::default());
    let transfer = prepared(&Arc::new(asset), &source);
    let specular = transfer.specular_surfels;
    assert!(specular > 100, "{specular} of {}", cloud.len());
    let relit = transfer.relight_by(&target);
    let [source, target] = [&source, &target].map(|l| l.for_directional().expect("with beams").1);
    let oracle = crate::oracle::OracleDirectional::new(&cloud, &bake, source, 0.006);
    let exact = oracle.relight(target);
    let k = coefficient_count(cloud.sh_degree);
    let mut errors: Vec<f64> = relit
        .sh
        .chunks_exact(k)
        .zip(exact.chunks_exact(k))
        .map(|(got, exact)| {
            let errors = got.iter().flatten().zip(exact.iter().flatten());
            errors.fold(0f64, |most, (g, e)| most.max((f64::from(*g) - e).abs()))
        })
        .collect();
    assert!(relit.sh.iter().flatten().all(|v| v.is_finite()));
    errors.sort_by(f64::total_cmp);
    // f32 sums of a few hundred terms. Where two lobes fit alike, or a ray grazes a rim, either may be taken: a few surfels.
    let n = errors.len();
    assert!(errors[n / 2] < 2e-5, "median {:.1e}", errors[n / 2]);
    let most = errors[n * 97 / 100];
    assert!(most < 1e-3, "97 % {most:.1e}");
}

#[test]
fn under_a_light_that_is_half_believed_half_of_the_change_is_made() {
    let sun = DVec3::new(0.5, 0.3, 0.8).normalize();
    let mut cloud = synthetic::sphere_over_slab(200);
    cloud.encoding = Encoding::Linear;
    let asset = asset_of(&cloud);
    let even = Illumination::even(3);
    let half = Illumination {
        trust: 0.5,
        ..even.clone()
    };
    let target = sky(sun, [0.3, 0.5, 0.9]);
    let whole = prepared(&asset, &even).relight_by(&target);
    let halfway = prepared(&asset, &half);
    assert_eq!(halfway.specular_surfels, 0);
    let halfway = halfway.relight_by(&target);
    for (w, h) in whole.tau.iter().zip(&halfway.tau) {
        for c in 0..3 {
            assert!((h[c] * h[c] / w[c] - 1.0).abs() < 1e-4, "{h:?} {w:?}");
        }
    }
    // What the user makes of the light is known, and counts in full.
    let told = [0.125, 0.5, 2.0];
    let made = prepared(&asset, &half).relight_by(&target.told(told));
    for (made, h) in made.tau.iter().zip(&halfway.tau) {
        for c in 0..3 {
            let change = made[c] / (told[c] * h[c]);
            assert!((change - 1.0).abs() < 1e-3, "{made:?} {h:?}");
        }
    }
    let [from, to] = [&half, &target].map(|l| l.for_directional().expect("with beams").1);
    let oracle = crate::oracle::OracleDirectional::new(&cloud, &asset.bake, from, 0.006);
    for (i, (f, exact)) in (halfway.sh.iter().zip(oracle.trusting(0.5).relight(to))).enumerate() {
        for c in 0..3 {
            assert!(
                (f64::from(f[c]) - exact[c]).abs() < 1e-4 * exact[c],
                "surfel {i}"
            );
        }
    }
    // One colour from everywhere: where nothing of a back is seen, it changes as told.
    for (i, (h, f)) in halfway.tau.iter().zip(&halfway.sh).enumerate() {
        if asset.bake.two_sided[i] > 0.0 {
            continue;
        }
        let expected = h[0] * cloud.sh_of(i)[0][0];
        assert!((f[0] - expected).abs() < 0.02 * expected, "surfel {i}");
    }
}

/// A grey sphere with a lamp on it, a cap of some fifty surfels of that colour, and which they are.
fn with_lamp(color: [f32; 3]) -> (SurfelCloud, Vec<usize>) {
    let mut cloud = synthetic::sphere(1500);
    let is_lamp = |i: &usize| cloud.positions[*i].dot(Vec3::new(0.6, 0.0, 0.8)) > 0.94;
    let lamp: Vec<usize> = (0..cloud.len()).filter(is_lamp).collect();
    let unit = crate::sh::SQRT_4PI as f32;
    for f in &mut cloud.sh {
        *f = [0.3 * unit; 3];
    }
    for i in &lamp {
        cloud.sh[*i] = color.map(|c| c * unit);
    }
    (cloud, lamp)
}

#[test]
fn a_lamp_keeps_shining_and_paint_does_not() {
    let (even, red) = (Illumination::even(3), sky(DVec3::Z, [0.9, 0.1, 0.05]));
    let relit = |color: [f32; 3], emission_share: bool| {
        let (cloud, lamp) = with_lamp(color);
        let mut settings = TransferSettings::default();
        settings.terms.emission = emission_share;
        let asset = asset_of(&cloud);
        let transfer = DirectionalTransfer::new(&asset, &even, &settings).expect("with beams");
        let relit = transfer.relight_by(&red);
        // In its middle.
        let middle = |i: &&usize| cloud.positions[**i].dot(Vec3::new(0.6, 0.0, 0.8)) > 0.985;
        let ratios = lamp.iter().filter(middle).map(|i| {
            std::array::from_fn::<f32, 3, _>(|c| relit.sh[*i][c] / cloud.sh[*i][c].max(1e-3))
        });
        let ratios: Vec<[f32; 3]> = ratios.collect();
        assert!(ratios.len() > 4);
        let grey: f32 = relit
            .tau
            .iter()
            .map(|t| (t[0] - 1.0).abs())
            .fold(0.0, f32::max);
        assert!(grey > 0.2, "what does not shine follows the light");
        ratios
    };
    // White beyond white, and a blue as pure as no paint.
    for shines in [[2.0, 1.6, 1.2], [0.002, 0.5, 0.75]] {
        for ratio in relit(shines, true) {
            assert!(
                (ratio[1] - 1.0).abs() < 0.05 && (ratio[2] - 1.0).abs() < 0.05,
                "{ratio:?}"
            );
        }
        for ratio in relit(shines, false) {
            assert!(ratio[1] < 0.7 && ratio[2] < 0.7, "{ratio:?}");
        }
    }
    // White paint, and blue paint.
    for paint in [[0.6; 3], [0.06, 0.3, 0.6]] {
        for ratio in relit(paint, true) {
            assert!(ratio[1] < 0.7 && ratio[2] < 0.7, "{ratio:?}");
        }
    }
}

#[test]
fn the_limit_of_glow_and_how_far_the_light_is_known_say_what_a_lamp_is() {
    let even = Illumination::even(3);
    // Of the lamp's middle.
    let emission_share = |color: [f32; 3], above: f32, trust: f32| {
        let (cloud, lamp) = with_lamp(color);
        let settings = TransferSettings {
            glow_above: above,
            ..TransferSettings::default()
        };
        let source = Illumination {
            trust,
            ..even.clone()
        };
        let transfer = DirectionalTransfer::new(&asset_of(&cloud), &source, &settings);
        let transfer = transfer.expect("with beams");
        let middle = |i: &&usize| cloud.positions[**i].dot(Vec3::new(0.6, 0.0, 0.8)) > 0.985;
        let emits = lamp
            .iter()
            .filter(middle)
            .map(|i| transfer.emission_share_of(*i));
        emits.fold((1f32, 0f32), |(least, most), g| (least.min(g), most.max(g)))
    };
    let (white_lamp, blue_lamp, paint) = ([2.0, 1.6, 1.2], [0.002, 0.5, 0.75], [0.6; 3]);
    assert!(emission_share(white_lamp, GLOW_ABOVE, 1.0).0 > 0.95);
    assert!(
        emission_share(white_lamp, 50.0, 1.0).1 == 0.0,
        "it is not so bright"
    );
    assert!(emission_share(paint, GLOW_ABOVE, 1.0).1 == 0.0);
    assert!(
        emission_share(paint, 0.1, 1.0).0 > 0.95,
        "all that is bright"
    );
    // Where the light is not known, it may have been as bright as that.
    assert!(emission_share(white_lamp, GLOW_ABOVE, 0.5).1 == 0.0);
    assert!(emission_share(blue_lamp, GLOW_ABOVE, 0.5).0 > 0.95);
    // And what the user makes of the new light is nothing to a lamp.
    let (cloud, lamp) = with_lamp(blue_lamp);
    let half = Illumination { trust: 0.5, ..even };
    let transfer = prepared(&asset_of(&cloud), &half);
    let tau = transfer.relight_by(&half.told([0.1; 3])).tau;
    let emissive: Vec<usize> = (lamp.into_iter())
        .filter(|i| transfer.emission_share_of(*i) > 0.9)
        .collect();
    assert!(!emissive.is_empty());
    for i in emissive {
        // What of it does not glow goes with the light.
        let emission_share = transfer.emission_share_of(i);
        let with_light = |at: f32| emission_share + (1.0 - emission_share) * at;
        let expected = with_light(0.1f32.sqrt()) * with_light(0.1).sqrt();
        for t in tau[i] {
            assert!((t - expected).abs() < 0.01, "{t} {expected}");
        }
    }
    // A surfel that does not glow is darker as told, but for epsilon; what stays as it is, however told, changes nothing.
    for t in tau[0] {
        assert!((t - 0.1).abs() < 0.01, "{t}");
    }
    let told = half.told([0.5, 2.0, 1.0]);
    let same = prepared(&asset_of(&cloud), &told).relight_by(&told).tau;
    assert!(same.iter().flatten().all(|t| (t - 1.0).abs() < 1e-3));
}

#[test]
fn a_lamp_is_made_of_light() {
    let (cloud, lamp) = with_lamp([2.0, 1.6, 1.2]);
    let transfer = prepared(&asset_of(&cloud), &Illumination::even(3));
    let materials = transfer.materials_of(None);
    let middle = |i: &&usize| cloud.positions[**i].dot(Vec3::new(0.6, 0.0, 0.8)) > 0.985;
    for i in lamp.iter().filter(middle) {
        let m = &materials.each[*i];
        assert!(m.base_color[0] < 0.05 && m.emission_share > 0.95, "{m:?}");
        let shown = cloud.encoding.decode(2.0 - cloud.encoding.offset());
        assert!((m.emission[0] / shown - 1.0).abs() < 0.06, "{m:?} {shown}");
    }
}

/// What is shown while a light is turned.
#[test]
fn a_coarse_ratio_is_near_the_one_that_follows() {
    let asset = asset_of(&specular());
    let sun = DVec3::new(0.4, 0.2, 0.9);
    let transfer = prepared(&asset, &sky(sun, [1.0, 0.9, 0.8]));
    let target = sky(DVec3::new(-0.7, 0.1, 0.5), [0.3, 0.5, 0.9]);
    let coarse = transfer.coarse_ratio(&target).expect("with beams");
    let exact = transfer.ratio(transfer.light(&target).expect("with beams"));
    let (mut off, mut sum, mut left) = (0f32, 0f32, 0f32);
    for ((coarse, exact), share) in coarse.iter().zip(&exact).zip(&asset.bake.visible_weight) {
        for c in 0..3 {
            off += share * (coarse[c] - exact[c]).abs();
            left += share * (1.0 - exact[c]).abs();
            sum += share * exact[c];
        }
    }
    // The edge of the sun's shadow is one of 384 directions, ten degrees apart.
    assert!(off < 0.08 * sum, "{off} of {sum}");
    // It is far nearer than to leave the light as it was.
    assert!(off < 0.2 * left, "{off} for {left}");
}
