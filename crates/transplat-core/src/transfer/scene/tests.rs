use std::sync::Arc;

use glam::{Affine3A, DMat3, Quat, Vec3};

use super::*;
use crate::bake::directional::DirectionalBake;
use crate::bake::scene::SceneBake;
use crate::bake::surroundings::PlacedObject;
use crate::environment::{Emitter, Illumination, LightSample, Shape};
use crate::progress::no_progress;
use crate::settings::TransferSettings;
use crate::settings::optimizations::Optimizations;
use crate::surfels::SurfelCloud;
use crate::synthetic;
use crate::transfer::directional::DirectionalCache;

/// Objects where they stand, each captured under even light of radiance 1.
fn scene_of(objects: &[(SurfelCloud, Affine3A)]) -> SceneTransfer {
    let light = Illumination::even(3);
    let settings = TransferSettings::default();
    let transfers: Vec<Arc<DirectionalTransfer>> = (objects.iter())
        .map(|(cloud, _)| {
            let bake = Arc::new(DirectionalBake::all_rays(cloud));
            let asset = Arc::new(DirectionalCache::new(
                cloud,
                bake,
                &Optimizations::default(),
            ));
            let transfer = DirectionalTransfer::new(&asset, &light, &settings);
            Arc::new(transfer.expect("with beams"))
        })
        .collect();
    let placed: Vec<PlacedObject> = (transfers.iter().zip(objects))
        .map(|(t, (_, place))| PlacedObject {
            bake: t.asset.bake.clone(),
            scene_from_object: *place,
            whole: None,
        })
        .collect();
    let bake = SceneBake::new(placed, &no_progress).expect("not cancelled");
    SceneTransfer::new(transfers, Arc::new(bake))
}

/// The same relit by that light, together and each alone.
fn relit(objects: &[(SurfelCloud, Affine3A)]) -> (Vec<Relit>, Vec<Relit>) {
    let (scene, light) = (scene_of(objects), Illumination::even(3));
    let whole = |t: &dyn Relight| t.relight_seen(&light, Part::Whole, &[]);
    let alone = (scene.objects.iter()).map(|t| whole(&**t).expect("with beams"));
    let alone = alone.collect();
    let together = scene.relight_objects(&light, Part::Whole, &[]);
    (together.expect("with beams"), alone)
}

/// Up to rounding: a scene's bounces start from what it keeps.
fn are_alike(a: &Relit, b: &Relit) -> bool {
    let close = |a: &[f32; 3], b: &[f32; 3]| (0..3).all(|c| (a[c] - b[c]).abs() < 1e-5);
    let all = |a: &[[f32; 3]], b: &[[f32; 3]]| a.iter().zip(b).all(|(a, b)| close(a, b));
    all(&a.sh, &b.sh) && all(&a.tau, &b.tau)
}

#[test]
fn an_object_alone_and_objects_out_of_sight_are_relit_as_ever() {
    let cloud = synthetic::glossy_sphere_over_plate(300, 2);
    let (together, alone) = relit(&[(cloud.clone(), Affine3A::IDENTITY)]);
    assert!(are_alike(&together[0], &alone[0]));
    // So far away that it stands between two of the 384 directions.
    let far = Affine3A::from_translation(Vec3::new(0.0, 500.0, 0.0));
    let (together, alone) = relit(&[(cloud.clone(), Affine3A::IDENTITY), (cloud, far)]);
    for (together, alone) in together.iter().zip(alone) {
        assert!(are_alike(together, &alone));
    }
}

/// A ball of radius r at height d over a plate takes `(r / d)^2` of the light of an even sky from the point right below it (the form factor of a
/// sphere), and gives what it radiates itself from there.
#[test]
fn a_plate_loses_what_the_ball_over_it_takes_and_gains_what_it_throws() {
    let (radius, height) = (0.5, 1.0);
    let factor = radius * radius / (height * height);
    for color in [0.0, 0.5] {
        let mut ball = synthetic::sphere(2000);
        let mut plate = synthetic::sheet(41);
        // Black, so that nothing comes back to the ball from it.
        plate.sh.fill([0.0; 3]);
        for f in &mut ball.sh {
            *f = f.map(|v| 2.0 * color * v);
        }
        let place = Affine3A::from_scale_rotation_translation(
            Vec3::splat(radius),
            Quat::from_rotation_x(0.7),
            height * Vec3::Z,
        );
        let (together, _) = relit(&[(plate.clone(), Affine3A::IDENTITY), (ball.clone(), place)]);
        let middle = (0..plate.len())
            .filter(|i| plate.positions[*i].length() < 0.2)
            .map(|i| together[0].tau[i][1])
            .collect::<Vec<_>>();
        let mean = middle.iter().sum::<f32>() / middle.len() as f32;
        // What it radiates downwards: darker than it was captured, since the plate blocks its light.
        let below = |i: &usize| place.transform_vector3(ball.positions[*i]).z < -0.8 * radius;
        let below: Vec<usize> = (0..ball.len()).filter(below).collect();
        let radiates = below
            .iter()
            .map(|i| color * together[1].tau[*i][1])
            .sum::<f32>()
            / below.len() as f32;
        let expected = 1.0 - factor + factor * radiates;
        assert!((mean - expected).abs() < 0.02, "{color}: {mean} {expected}");
        // At the corners far from it little changes.
        let corner = together[0].tau[0][1];
        assert!(corner > 0.93 && corner <= 1.0, "{corner}");
    }
}

/// A light stands in the scene, whatever coordinates its objects have: a ball throws its shadow on a plate that is another object, as wide as
/// the light is near.
#[test]
fn a_near_light_shines_from_one_place_on_all_objects() {
    let (mut ball, mut plate) = (synthetic::sphere(1500), synthetic::sheet(41));
    // Black, so that nothing bounces.
    ball.sh.fill([0.0; 3]);
    plate.sh.fill([0.05; 3]);
    let (radius, height, lamp) = (0.2f32, 0.5f32, 1.5f32);
    let place = Affine3A::from_scale_rotation_translation(
        Vec3::splat(radius),
        Quat::from_rotation_y(2.0),
        height * Vec3::Z,
    );
    // The plate has its own coordinates as well: twice as large there, and turned.
    let turned = Affine3A::from_scale_rotation_translation(
        Vec3::splat(0.5),
        Quat::from_rotation_z(0.4),
        Vec3::ZERO,
    );
    let large = plate.transformed(turned.inverse());
    let scene = scene_of(&[(large, turned), (ball, place)]);
    let mut light = Illumination::even(3).scaled(0.0);
    light.emitters.push(Emitter {
        shape: Shape::Point {
            position: lamp * Vec3::Z,
        },
        emission: [2.0; 3],
    });
    let tau = &scene
        .relight_objects(&light, Part::Whole, &[])
        .expect("with beams")[0]
        .tau;
    let touches = (radius / (lamp - height)).asin().tan() * lamp;
    let mut seen = [0, 0];
    for (p, tau) in plate.positions.iter().zip(tau) {
        let from_middle = p.length();
        if from_middle < touches - 0.1 {
            assert!(tau[1] < 0.02, "{p}: {tau:?}");
            seen[0] += 1;
        } else if from_middle > touches + 0.1 {
            let d = p.distance(lamp * Vec3::Z);
            // Under even light of radiance 1 it got pi; what is added is epsilon's.
            let exact = 2.0 * lamp / d.powi(3) / std::f32::consts::PI;
            assert!((tau[1] / exact - 1.0).abs() < 0.03, "{p}: {tau:?} {exact}");
            seen[1] += 1;
        }
    }
    assert!(seen[0] > 40 && seen[1] > 800, "{seen:?}");
}

/// Where a scene stands and which way it is turned is nothing to it.
#[test]
fn a_scene_that_is_turned_as_a_whole_is_relit_alike() {
    let cloud = synthetic::glossy_sphere_over_plate(300, 1);
    let beside = Affine3A::from_translation(Vec3::new(1.7, 0.2, 0.3))
        * Affine3A::from_scale(Vec3::splat(0.6));
    let whole = Affine3A::from_scale_rotation_translation(
        Vec3::splat(3.0),
        Quat::from_rotation_y(1.0),
        Vec3::new(-2.0, 5.0, 1.0),
    );
    let scene =
        |whole: Affine3A| relit(&[(cloud.clone(), whole), (cloud.clone(), whole * beside)]).0;
    let (straight, turned) = (scene(Affine3A::IDENTITY), scene(whole));
    for (a, b) in straight.iter().zip(&turned) {
        let off = |(a, b): (&[f32; 3], &[f32; 3])| {
            (0..3).map(|c| (a[c] - b[c]).abs()).fold(0.0, f32::max)
        };
        // A ray at a rim may go either way: a direction of 384.
        let far =
            a.sh.iter()
                .zip(&b.sh)
                .map(off)
                .filter(|d| *d > 0.02)
                .count();
        assert!(far * 100 < a.sh.len(), "{far} of {}", a.sh.len());
    }
}

/// Some surfels of a capture, and their transfer.
type Cutting = (Vec<usize>, Arc<DirectionalTransfer>);

/// A capture of a ball on a plate, under a light from one side, in two parts: each with how it was lit among the other.
fn parts() -> (Arc<DirectionalTransfer>, [Cutting; 2]) {
    let cloud = synthetic::glossy_sphere_over_plate(400, 2);
    let ball: Vec<usize> = (0..400).collect();
    let plate: Vec<usize> = (400..cloud.len()).collect();
    parts_of(&cloud, [ball, plate])
}

fn parts_of(
    cloud: &SurfelCloud,
    parts: [Vec<usize>; 2],
) -> (Arc<DirectionalTransfer>, [Cutting; 2]) {
    let bake = Arc::new(DirectionalBake::all_rays(cloud));
    let asset = DirectionalCache::new(cloud, bake, &Optimizations::default());
    let settings = TransferSettings::default();
    let transfer = DirectionalTransfer::new(&Arc::new(asset), &from_a_side(), &settings);
    let whole = Arc::new(transfer.expect("with beams"));
    let parts = parts.map(|surfels| {
        let part = cloud.selected(&surfels);
        let tracer = whole.asset.bake.tracer_of_part(&part, &surfels);
        let all = (&[1][..], &Optimizations::NONE);
        let bake = DirectionalBake::bake_through(&part, &tracer, all, &no_progress, |_, _| ());
        let bake = bake.expect("not cancelled");
        let bake = Arc::new(bake.as_part_of(&whole.asset.bake, &surfels));
        let transfer = Arc::new(whole.part(bake, &surfels));
        (surfels, transfer)
    });
    (whole, parts)
}

/// Even light, and a sun.
fn from_a_side() -> Illumination {
    let mut light = Illumination::even(3);
    light.add(LightSample {
        direction: Vec3::new(1.0, 0.4, 1.5).normalize(),
        energy: [2.0, 1.5, 1.0],
    });
    light
}

fn together(
    (whole, parts): (&Arc<DirectionalTransfer>, &[Cutting]),
    place: Affine3A,
) -> SceneTransfer {
    let places = [place, Affine3A::IDENTITY];
    let placed = parts
        .iter()
        .zip(places)
        .map(|((_, t), place)| PlacedObject {
            bake: t.asset.bake.clone(),
            scene_from_object: place,
            whole: Some(whole.asset.bake.clone()),
        });
    let bake = SceneBake::new(placed.collect(), &no_progress).expect("not cancelled");
    SceneTransfer::new(
        parts.iter().map(|(_, t)| t.clone()).collect(),
        Arc::new(bake),
    )
}

/// Relative difference of what is relit where the parts stand as captured, over their surfels.
fn difference(whole: &Relit, parts: &[Cutting], relit: &[Relit]) -> f32 {
    let k = whole.sh.len() / whole.tau.len();
    let (mut error, mut all) = (0.0, 0.0);
    for ((surfels, _), relit) in parts.iter().zip(relit) {
        for (at, i) in surfels.iter().enumerate() {
            for (a, b) in whole.sh[i * k..][..k].iter().zip(&relit.sh[at * k..][..k]) {
                for c in 0..3 {
                    error += (a[c] - b[c]).powi(2);
                    all += a[c].powi(2);
                }
            }
        }
    }
    (error / all).sqrt()
}

#[test]
fn parts_of_a_capture_where_they_were_captured_are_relit_as_the_whole() {
    let (whole, parts) = parts();
    let scene = together((&whole, &parts), Affine3A::IDENTITY);
    let other = Illumination::even(3)
        .rotated(DMat3::from_rotation_x(1.0))
        .scaled(0.7);
    for light in [from_a_side(), other] {
        let of_whole = whole
            .relight_seen(&light, Part::Whole, &[])
            .expect("with beams");
        let of_parts = scene
            .relight_objects(&light, Part::Whole, &[])
            .expect("with beams");
        // Which of the plate's discs a ray meets first, all in one plane and each of its own colour, is a matter of rounding.
        let off = difference(&of_whole, &parts, &of_parts);
        assert!(off < 0.02, "{off}");
    }
}

/// Surfels of a surface that is cut through lie in each other's stack as before, and do not shade each other: there is no seam.
#[test]
fn a_cut_through_a_surface_leaves_no_seam() {
    // As training leaves a surface: in layers.
    let mut cloud = synthetic::sphere(800);
    cloud.add(&synthetic::sphere(900), 0.985, Vec3::ZERO);
    let is_left = |i: &usize| cloud.positions[*i].x < 0.1;
    let (left, right) = (0..cloud.len()).partition(is_left);
    let (whole, parts) = parts_of(&cloud, [left, right]);
    let light = from_a_side();
    let scene = together((&whole, &parts), Affine3A::IDENTITY);
    let relit = scene.relight_objects(&light, Part::Whole, &[]);
    for (relit, (surfels, _)) in relit.expect("with beams").iter().zip(&parts) {
        for (tau, i) in relit.tau.iter().zip(surfels) {
            let off = tau.iter().fold(0f32, |off, t| off.max((t - 1.0).abs()));
            assert!(off < 1e-3, "surfel {i} at {}: {tau:?}", cloud.positions[*i]);
        }
    }
    // A half that stands elsewhere is another body, and blocks as any does.
    let aside = Affine3A::from_translation(0.5 * Vec3::X);
    let apart = together((&whole, &parts), aside).relight_objects(&light, Part::Whole, &[]);
    let changes = |r: &Relit| r.tau.iter().any(|t| (t[0] - 1.0).abs() > 0.05);
    assert!(apart.expect("with beams").iter().any(changes));
}

/// Where the ball is taken away, the plate below it is lit as if it had never stood there.
#[test]
fn what_is_cut_out_and_taken_away_leaves_no_shadow() {
    let (whole, parts) = parts();
    let light = from_a_side();
    let far = Affine3A::from_translation(Vec3::new(0.0, 500.0, 0.0));
    let without = together((&whole, &parts), far).relight_objects(&light, Part::Whole, &[]);
    let without = &without.expect("with beams")[1];
    let plate = &parts[1].1;
    let alone = DirectionalTransfer::new(&plate.asset, &light, &plate.settings);
    let alone = alone.expect("with beams");
    let expected: Vec<f32> = (0..alone.divisor.len())
        .map(|i| alone.divisor[i][0][1] / plate.divisor[i][0][1])
        .collect();
    let most = expected.iter().copied().fold(0.0, f32::max);
    assert!(most > 1.3, "there is a shadow: {most}");
    for (tau, expected) in without.tau.iter().zip(&expected) {
        assert!((tau[1] / expected - 1.0).abs() < 0.02, "{tau:?} {expected}");
    }
}
