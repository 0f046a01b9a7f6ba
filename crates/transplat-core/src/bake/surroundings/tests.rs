use glam::{Quat, Vec3};

use super::*;
use crate::progress::no_progress;
use crate::surfels::SurfelCloud;
use crate::synthetic;

fn placed(cloud: &SurfelCloud, scene_from_object: Affine3A) -> PlacedObject {
    PlacedObject {
        bake: Arc::new(DirectionalBake::all_rays(cloud)),
        scene_from_object,
        whole: None,
    }
}

/// A slab, and a ball over it that has another size and stands another way up in its own coordinates.
fn slab_and_ball() -> ([SurfelCloud; 2], [Affine3A; 2]) {
    let mut slab = synthetic::sheet(24);
    slab.add(&synthetic::sheet(24), 1.0, -0.2 * Vec3::Z);
    let turn = Quat::from_euler(glam::EulerRot::XYZ, 0.4, -1.1, 2.0);
    let place = |scale, at| Affine3A::from_scale_rotation_translation(Vec3::splat(scale), turn, at);
    let in_scene = place(1.0, Vec3::new(3.0, -1.0, 2.0));
    let over_the_slab = in_scene * place(0.4, Vec3::new(0.1, 0.2, 0.75));
    ([slab, synthetic::sphere(700)], [in_scene, over_the_slab])
}

/// One cloud of the first and the second, in the coordinates of the first.
fn merged(clouds: [&SurfelCloud; 2], first_from_second: Affine3A) -> SurfelCloud {
    SurfelCloud::composed(&[
        (clouds[0], Affine3A::IDENTITY),
        (clouds[1], first_from_second),
    ])
}

/// What an object sees among others is what it sees as a part of one cloud of them all.
#[test]
fn objects_see_each_other_as_parts_of_one_do() {
    let (clouds, places) = slab_and_ball();
    let objects = [0, 1].map(|i| placed(&clouds[i], places[i]));
    let directions = directions();
    for (own, other) in [(0, 1), (1, 0)] {
        let around = InterObjectVisibility::trace(&objects, own, Detail::Full, &no_progress)
            .expect("not cancelled");
        let all = merged(
            [&clouds[own], &clouds[other]],
            places[own].inverse() * places[other],
        );
        let expected = placed(&all, Affine3A::IDENTITY).bake;
        // In the scene the objects are in their own order; in the one cloud the one that sees comes first.
        let firsts = [0, clouds[0].len()];
        let in_the_cloud = |surfel: usize| match surfel.checked_sub(firsts[1]) {
            None if own == 0 => surfel,
            None => clouds[1].len() + surfel,
            Some(second) if own == 0 => clouds[0].len() + second,
            Some(second) => second,
        };
        // Of overlapping discs in one plane either may be named.
        let are_neighbors = |a: usize, b: usize| {
            all.positions[a].distance(all.positions[b]) < 4.0 * all.scales[a].x
        };
        let hit = |directional_visibility: &DirectionalVisibility, i: usize, j: usize| {
            let found = directional_visibility
                .hits_of(i)
                .iter()
                .find(|h| h.stratum() == j);
            found.map(|h| h.surfel())
        };
        let (mut rays, mut differ, mut named, mut others) = (0, 0, 0, 0);
        for i in 0..clouds[own].len() {
            for (j, direction) in directions.iter().enumerate() {
                if expected.normals[i].dot(*direction) < 0.05 {
                    continue;
                }
                rays += 1;
                let open = around.directional_visibility.is_open(i, j);
                differ += usize::from(open != expected.directional_visibility.is_open(i, j));
                others +=
                    usize::from(!open && objects[own].bake.directional_visibility.is_open(i, j));
                if j < STRATA {
                    let found = hit(&around.directional_visibility, i, j).map(in_the_cloud);
                    let wanted = hit(&expected.directional_visibility, i, j);
                    named += usize::from(match (found, wanted) {
                        (Some(found), Some(wanted)) => !are_neighbors(found, wanted),
                        (found, wanted) => found != wanted,
                    });
                }
            }
        }
        assert!(others * 100 > rays, "{others} of {rays} meet the other");
        // A ray that grazes a rim may round to either side of it.
        assert!(differ * 500 < rays, "{differ} of {rays}");
        assert!(named * 200 < rays, "{named} of {rays}");
    }
}

#[test]
fn suns_are_blocked_by_the_others_too() {
    let (clouds, places) = slab_and_ball();
    let objects = [0, 1].map(|i| placed(&clouds[i], places[i]));
    let around = InterObjectVisibility::trace(&objects, 0, Detail::Full, &no_progress)
        .expect("not cancelled");
    let sun = Vec3::new(0.1, -0.2, 0.97).normalize();
    let tracer = &objects[0].bake.tracer;
    let open = around.open_towards(tracer, sun, |_| true);
    let all = merged([&clouds[0], &clouds[1]], places[0].inverse() * places[1]);
    let all = placed(&all, Affine3A::IDENTITY).bake;
    let expected = all.tracer.open_towards(sun, |_| true);
    let alone = tracer.open_towards(sun, |_| true);
    let differ = |a: &[bool], b: &[bool]| a.iter().zip(b).filter(|(a, b)| a != b).count();
    assert!(differ(&open, &expected) * 100 < open.len());
    assert!(differ(&open, &alone) * 50 > open.len(), "there is a shadow");
}

#[test]
fn what_is_out_of_sight_changes_nothing() {
    let ball = placed(&synthetic::sphere(300), Affine3A::IDENTITY);
    let above = PlacedObject {
        scene_from_object: Affine3A::from_translation(4.0 * Vec3::Z),
        ..ball.clone()
    };
    let objects = [ball.clone(), above];
    let around = InterObjectVisibility::trace(&objects, 0, Detail::Full, &no_progress)
        .expect("not cancelled");
    for i in (0..ball.bake.len()).filter(|i| ball.bake.normals[*i].z < -0.6) {
        let alone = &ball.bake.directional_visibility;
        assert_eq!(
            around.directional_visibility.open_of(i),
            alone.open_of(i),
            "surfel {i}"
        );
        assert_eq!(
            around.directional_visibility.hits_of(i),
            alone.hits_of(i),
            "surfel {i}"
        );
    }
    assert!(around.changed > 0 && around.changed < ball.bake.len());
    let alone = InterObjectVisibility::trace(&objects[..1], 0, Detail::Full, &no_progress)
        .expect("not cancelled");
    assert_eq!((alone.changed, alone.first), (0, 0));
    assert_eq!(
        alone.directional_visibility.open,
        ball.bake.directional_visibility.open
    );
}

/// A coarse answer is one: as dark in the shadow, within a patch of directions that goes either way, and open where nothing stands.
#[test]
fn what_is_traced_coarsely_is_close() {
    // So many that neighbours share what they see.
    let slab = synthetic::sheet(110);
    assert!(Detail::Coarse.rows_joined(slab.len()) > 1);
    let over =
        Affine3A::from_scale_rotation_translation(Vec3::splat(0.4), Quat::IDENTITY, 0.5 * Vec3::Z);
    let objects = [
        placed(&slab, Affine3A::IDENTITY),
        placed(&synthetic::sphere(700), over),
    ];
    let openness = |detail| {
        let around =
            InterObjectVisibility::trace(&objects, 0, detail, &no_progress).expect("not cancelled");
        around
            .directional_visibility
            .openness(&objects[0].bake.normals)
    };
    let (full, coarse) = (openness(Detail::Full), openness(Detail::Coarse));
    let off = full.iter().zip(&coarse).map(|(a, b)| (a - b).abs());
    assert!(full.iter().any(|o| *o < 0.6) && full.iter().any(|o| *o > 0.95));
    let mean = off.clone().sum::<f32>() / full.len() as f32;
    assert!(mean < 0.025, "{mean}");
    // Where neighbours in the order are none in space, as at a cell's edge, one may have what is another's.
    let far = off.filter(|d| *d > 0.1).count();
    assert!(far * 20 < full.len(), "{far} of {}", full.len());
}

#[test]
fn cancelling_stops() {
    let ball = placed(&synthetic::sphere(50), Affine3A::IDENTITY);
    let stop = |_: f64| std::ops::ControlFlow::Break(());
    let result = InterObjectVisibility::trace(&[ball.clone(), ball], 0, Detail::Full, &stop);
    assert!(matches!(result, Err(Error::Cancelled)));
}
