use std::sync::Arc;

use glam::{DMat3, DVec3, Vec2, Vec3};
use proptest::prelude::*;

use super::expected::ExpectedLight;
use super::fit::{held, precision};
use super::sky::{SKY, sky_basis};
use super::*;
use crate::color::Encoding;
use crate::environment::LightSamples;
use crate::oracle::EstimateProblem;
use crate::progress::no_progress;
use crate::synthetic;

/// A ball over a plate in stripes of three albedos, matte, under a light; what bounces once included.
fn lit(
    n: usize,
    sky: impl Fn(Vec3) -> [f32; 3],
    sun: Option<(Vec3, f32)>,
) -> (SurfelCloud, Arc<DirectionalBake>) {
    let mut cloud = synthetic::sphere_over_slab(n);
    let bake = Arc::new(DirectionalBake::bake(&cloud, &no_progress).expect("it is small"));
    let albedo = |i: usize| match (cloud.positions[i].y * 2.0).floor() as i32 & 1 {
        0 => [0.6, 0.55, 0.5],
        _ => [0.25, 0.3, 0.35],
    };
    let omega = 4.0 * std::f32::consts::PI / DIRECTIONS as f32;
    let toward: Vec<(Vec3, [f32; 3])> = directions().iter().map(|d| (*d, sky(*d))).collect();
    let sunny = sun.map(|(d, _)| bake.tracer.open_towards(d, |_| true));
    let direct = |i: usize| -> [f32; 3] {
        let n = bake.normals[i];
        let mut e = [0f32; 3];
        for (j, (d, l)) in toward.iter().enumerate() {
            if bake.directional_visibility.is_open(i, j) {
                e = std::array::from_fn(|c| e[c] + omega * n.dot(*d).max(0.0) * l[c]);
            }
        }
        if let (Some((d, energy)), Some(open)) = (sun, &sunny) {
            let shines = if open[i] {
                energy * n.dot(d).max(0.0)
            } else {
                0.0
            };
            e = e.map(|v| v + shines);
        }
        e
    };
    let exitance = |i: usize, e: [f32; 3]| -> [f32; 3] {
        std::array::from_fn(|c| albedo(i)[c] * e[c] / std::f32::consts::PI)
    };
    let first: Vec<[f32; 3]> = (0..cloud.len()).map(|i| exitance(i, direct(i))).collect();
    let stratum = 4.0 * std::f32::consts::PI / crate::bake::strata::STRATA as f32;
    let with_bounce: Vec<[f32; 3]> = (0..cloud.len())
        .map(|i| {
            let mut e = direct(i);
            for hit in bake.directional_visibility.hits_of(i) {
                let cosine = stratum * bake.normals[i].dot(toward[hit.stratum()].0).max(0.0);
                e = std::array::from_fn(|c| e[c] + cosine * first[hit.surfel()][c]);
            }
            exitance(i, e)
        })
        .collect();
    paint(&mut cloud, &with_bounce);
    (cloud, bake)
}

/// Gives each surfel a colour of linear radiance.
fn paint(cloud: &mut SurfelCloud, radiance: &[[f32; 3]]) {
    cloud.encoding = Encoding::Linear;
    cloud.sh_degree = 0;
    cloud.sh = radiance
        .iter()
        .map(|b| b.map(|v| v * SQRT_4PI as f32))
        .collect();
}

fn estimated(cloud: &SurfelCloud, bake: &DirectionalBake) -> Estimate {
    estimate_light(cloud, bake, None, &no_progress).expect("not cancelled")
}

fn estimate(scene: &(SurfelCloud, Arc<DirectionalBake>)) -> Estimate {
    estimated(&scene.0, &scene.1)
}

fn of_asset(cloud: &SurfelCloud) -> Estimate {
    let bake = DirectionalBake::bake(cloud, &no_progress).expect("small");
    estimated(cloud, &bake)
}

/// Brighter towards one side and bluish from above, never black.
fn slanted(d: Vec3) -> [f32; 3] {
    let s = (1.2 * d.dot(Vec3::new(0.8, 0.0, 0.6))).exp();
    [s, s, s * (1.0 + 0.2 * d.z)]
}

/// How unlike two lights are: the standard deviation of the difference of the logarithms of their irradiances, over surfaces that face
/// upwards; what shines from below the plate hides.
fn unlike(estimated: &EstimatedLight, sky: impl Fn(Vec3) -> [f32; 3]) -> f64 {
    let toward = directions();
    let lights: Vec<[[f32; 3]; 2]> = toward
        .iter()
        .map(|d| [estimated.sky_radiance(*d), sky(*d)])
        .collect();
    let irradiance = |n: Vec3, which: usize, c: usize| -> f64 {
        let each = toward.iter().zip(&lights).filter(|(d, _)| d.z > 0.0);
        each.map(|(d, l)| f64::from(n.dot(*d).max(0.0) * l[which][c]))
            .sum()
    };
    let facing = toward.iter().filter(|n| n.z > 0.3);
    let differences: Vec<[f64; 3]> = facing
        .map(|n| std::array::from_fn(|c| (irradiance(*n, 0, c) / irradiance(*n, 1, c)).ln()))
        .collect();
    let n = differences.len() as f64;
    let variance = (0..3).map(|c| {
        let mean = differences.iter().map(|d| d[c]).sum::<f64>() / n;
        differences
            .iter()
            .map(|d| (d[c] - mean).powi(2))
            .sum::<f64>()
            / n
    });
    (variance.sum::<f64>() / 3.0).sqrt()
}

#[test]
fn a_matte_object_of_a_few_albedos_returns_its_light() {
    let scene = lit(3000, slanted, None);
    let found = estimate(&scene);
    assert!(found.is_told() && found.confidence > 0.9, "{found:?}");
    assert!(found.light.sun.is_none(), "{:?}", found.light.sun);
    // Logarithms of the irradiance span 1.4.
    let off = unlike(&found.light, slanted);
    assert!(off < 0.05, "{off}");
    let toward = found.light.dominant_direction();
    assert!(toward.dot(Vec3::new(0.8, 0.0, 0.6)) > 0.99, "{toward}");
}

/// The albedo of the brighter stripes is not the one that is taken for white.
#[test]
fn strength_follows_from_what_bounces() {
    let scene = lit(4000, slanted, None);
    let found = estimate(&scene);
    let mean = |sky: &dyn Fn(Vec3) -> [f32; 3]| {
        let each = directions().into_iter().map(|d| sky(d)[1]);
        each.sum::<f32>() / DIRECTIONS as f32
    };
    let ratio = mean(&|d| found.light.sky_radiance(d)) / mean(&slanted);
    assert!((ratio - 1.0).abs() < 0.15, "{ratio}");
}

/// A sun and the brighter half of the sky are cut off by half and more of all light; the map lies rotated, in another unit.
#[test]
fn a_clipped_panorama_has_the_light_that_the_shading_shows() {
    let sun = (Vec3::new(0.5, -0.3, 0.81).normalize(), 2.0);
    let (cloud, bake) = lit(3000, slanted, Some(sun));
    let (unit, to_asset) = ([0.5; 3], DMat3::from_rotation_z(1.0));
    let radiance = |d: Vec3| {
        let angle = d.angle_between(sun.0).to_degrees();
        let disc = if angle < 3.0 { sun.1 / 0.00861 } else { 0.0 };
        slanted(d).map(|v| (v + disc) / unit[0])
    };
    let seen = |d: DVec3| (to_asset * d).as_vec3();
    let whole = EnvironmentMap::of_directions(256, 128, |d| radiance(seen(d)));
    let white = 2.0;
    let clipped = whole.pixels().iter().map(|p| p.map(|v| v.min(white)));
    let clipped = EnvironmentMap::new(256, 128, clipped.collect());
    let found = complete_light(&cloud, &bake, &clipped, Some(unit), to_asset, &no_progress);
    let found = found.expect("not cancelled");
    let each = found.map.pixels().iter().zip(clipped.pixels());
    for (after, before) in each.clone() {
        assert!(after.iter().zip(before).all(|(a, b)| a >= b));
    }
    // Light is added where the map is clipped and in a sun's disc, which covers 0.03 % of the sphere.
    let added =
        each.filter(|(after, before)| after != before && before.iter().all(|v| *v < 0.95 * white));
    assert!(added.count() < 60);
    let irradiance = |map: &EnvironmentMap, n: Vec3| -> f64 {
        let each = map.pixels().iter().enumerate();
        each.map(|(i, p)| {
            let d = seen(map.direction(i % 256, i / 256).into());
            map.pixel_solid_angle(i / 256) * f64::from(n.dot(d).max(0.0) * p[1])
        })
        .sum()
    };
    for n in [
        Vec3::Z,
        sun.0,
        Vec3::new(0.6, 0.0, 0.8),
        Vec3::new(0.0, 0.7, 0.7),
    ] {
        let [of_clipped, of_found] =
            [&clipped, &found.map].map(|m| irradiance(m, n) / irradiance(&whole, n));
        assert!(of_clipped < 0.75, "{n}: {of_clipped} of the light is there");
        assert!((of_found - 1.0).abs() < 0.1, "{n}: {of_found}");
    }
}

/// Hollows are as yellow as what they face makes them, and as the light that reaches them.
#[test]
fn the_tint_follows_from_what_bounces() {
    let yellow = |d: Vec3| {
        let [r, g, b] = slanted(d);
        [1.2 * r, g, 0.7 * b]
    };
    let found = estimate(&lit(4000, yellow, None));
    let mean = |sky: &dyn Fn(Vec3) -> [f32; 3], c: usize| -> f32 {
        directions().into_iter().map(|d| sky(d)[c]).sum()
    };
    let over_blue = |sky: &dyn Fn(Vec3) -> [f32; 3]| (mean(sky, 0) / mean(sky, 2)).ln();
    let [found, expected] = [
        over_blue(&|d| found.light.sky_radiance(d)),
        over_blue(&yellow),
    ];
    // Grey light is expected with a standard deviation of 0.15 in each channel: this is two and a half of them off.
    assert!(
        (found - expected).abs() < 0.3 * expected,
        "{found} for {expected}"
    );
}

/// Of some it would be the order of the file that decides which.
#[test]
fn all_surfels_of_a_cluster_are_asked_for_the_sun() {
    let (cloud, bake) = lit(4000, |_| [0.3; 3], None);
    let clusters = Clusters::new(&cloud, &bake, &mean_radiance(&cloud, &bake.normals));
    let is_in_one = |i: &usize| clusters.of[*i] != clusters::NONE;
    let inside: Vec<usize> = (0..cloud.len()).filter(is_in_one).collect();
    assert!(inside.len() > cloud.len() / 2);
    assert!(inside.into_iter().all(|i| clusters.share[i] > 0.0));
}

#[test]
fn a_sun_is_found_where_there_is_one() {
    let toward = Vec3::new(0.5, -0.4, 0.77).normalize();
    let scene = lit(3000, |_| [0.5; 3], Some((toward, 3.0)));
    let found = estimate(&scene);
    let (direction, energy) = found.light.sun.expect("a sun");
    assert!(
        Vec3::from_array(direction).dot(toward) > 3f32.to_radians().cos(),
        "{direction:?}"
    );
    // The sky's mean irradiance is half of pi: of the strengths only the proportion can be told.
    let mean = directions()
        .iter()
        .map(|d| found.light.sky_radiance(*d)[1])
        .sum::<f32>()
        / DIRECTIONS as f32;
    let ratio = energy[1] / mean / 6.0;
    // A peak of the sky around it takes its share.
    assert!((0.5..1.5).contains(&ratio), "{ratio}");
    // Any program that reads the map sees the same light.
    let map = found.light.map(UpAxis::default());
    let light_samples = LightSamples::of(&map);
    assert!(
        light_samples.suns[0]
            .direction
            .dot(Vec3::from_array(direction))
            > 0.5f32.to_radians().cos()
    );
    assert!((light_samples.suns[0].energy[1] / energy[1] - 1.0).abs() < 0.05);
}

#[test]
fn what_cannot_be_told_is_said() {
    let even = lit(1500, |_| [1.0; 3], None);
    let found = estimate(&even);
    assert_eq!(
        found.obstacle,
        Some(Obstacle::EvenLight),
        "{}",
        found.confidence
    );
    let (mut cloud, bake) = even;
    let n = cloud.len();
    let mut check = |radiance: &dyn Fn(usize) -> [f32; 3], expected: Obstacle| {
        let radiance: Vec<[f32; 3]> = (0..n).map(radiance).collect();
        paint(&mut cloud, &radiance);
        let found = estimated(&cloud, &bake);
        assert_eq!(found.obstacle, Some(expected), "{}", found.confidence);
        let mut numbers = found.light.log_radiance.iter().flatten();
        assert!(numbers.all(|v| v.is_finite()));
    };
    check(&|_| [0.0; 3], Obstacle::Black);
    check(&|_| [f32::NAN; 3], Obstacle::Black);
    // Grey patches all over, as bright as chance has it: paint that no light explains.
    let cells: Vec<f32> = synthetic::sphere_over_slab(1500)
        .positions
        .iter()
        .map(|p| {
            let cell = (*p / 0.17).floor().as_ivec3();
            let mixed = (cell.x * 73_856_093) ^ (cell.y * 19_349_663) ^ (cell.z * 83_492_791);
            (mixed.rem_euclid(1009) as f32 / 1009.0 * 4.0 - 4.0).exp()
        })
        .collect();
    let painted: Vec<[f32; 3]> = cells.iter().map(|v| [*v; 3]).collect();
    paint(&mut cloud, &painted);
    let of_patches = estimated(&cloud, &bake);
    assert!(of_patches.trust() < 0.6, "{}", of_patches.confidence);
    // Two paints, one above the other, under even light: their edge is no shading.
    let mut ball = synthetic::sphere(3000);
    let of = |p: &Vec3| [if p.z > 0.0 { 0.6 } else { 0.2 }; 3];
    let painted: Vec<[f32; 3]> = ball.positions.iter().map(of).collect();
    paint(&mut ball, &painted);
    assert!(!of_asset(&ball).is_told());
    for few in [0, 1, 20].map(synthetic::sphere) {
        assert_eq!(of_asset(&few).obstacle, Some(Obstacle::TooLittle));
    }
    let (mut unseen, bake) = lit(1500, slanted, None);
    unseen.opacities.fill(1e-4);
    assert_eq!(
        estimated(&unseen, &bake).obstacle,
        Some(Obstacle::TooLittle)
    );
    let flat = of_asset(&synthetic::sheet(40));
    assert_eq!(flat.obstacle, Some(Obstacle::OneWay));
    let mut at_one_place = synthetic::sphere(500);
    at_one_place.positions.fill(Vec3::ONE);
    assert!(!of_asset(&at_one_place).is_told());
}

#[test]
fn a_few_broken_surfels_change_little() {
    let (mut cloud, bake) = lit(1500, slanted, None);
    let whole = estimated(&cloud, &bake);
    for i in (0..cloud.len()).step_by(50) {
        cloud.sh[i] = [f32::NAN, f32::INFINITY, -1e30];
    }
    // And one that is brighter than all the rest together.
    cloud.sh[7] = [1e9; 3];
    let broken = estimated(&cloud, &bake);
    assert!(broken.is_told());
    let off = unlike(&broken.light, |d| whole.light.sky_radiance(d));
    assert!(off < 0.05, "{off}");
}

#[test]
fn a_black_backdrop_changes_little() {
    let (mut cloud, _) = lit(1500, slanted, None);
    // Below the plate, where it takes no light from the rest, and much larger.
    let plate = synthetic::sheet(40);
    let n = cloud.len();
    cloud.add(&plate, 4.0, -4.0 * Vec3::Z);
    cloud.sh[n..].fill([0.0; 3]);
    let area = |of: &[Vec2]| of.iter().map(|s| s.element_product()).sum::<f32>();
    let share = area(&cloud.scales[n..]) / area(&cloud.scales);
    assert!(share > 0.8, "{share}");
    let found = of_asset(&cloud);
    assert!(found.is_told(), "{:?}", found.obstacle);
    let off = unlike(&found.light, slanted);
    assert!(off < 0.1, "{off}");
}

/// Worn paint: what the object tells alone is vague.
fn worn(
    (mut cloud, bake): (SurfelCloud, Arc<DirectionalBake>),
) -> (SurfelCloud, Arc<DirectionalBake>) {
    for (i, color) in cloud.sh.iter_mut().enumerate() {
        let worn = (1.2 * (i as f32 * 2.399).sin() * (i as f32 * 0.731).sin()).exp();
        *color = color.map(|v| worn * v);
    }
    (cloud, bake)
}

/// An object in a room whose walls show the light on it as a camera does: clipped at white, and nothing where the light is no number.
fn in_a_room(
    (object, bake): &(SurfelCloud, Arc<DirectionalBake>),
    light: impl Fn(Vec3) -> [f32; 3],
) -> (Estimate, CaptureEnvironment) {
    let walls = synthetic::sphere(20_000);
    let is_there = |i: &usize| light(walls.positions[*i])[0].is_finite();
    let mut walls = walls.selected(&(0..walls.len()).filter(is_there).collect::<Vec<_>>());
    let shown: Vec<_> = (walls.positions.iter())
        .map(|d| light(*d).map(|v| v.min(1.0)))
        .collect();
    paint(&mut walls, &shown);
    walls.opacities.fill(0.999);
    walls.scales.iter_mut().for_each(|s| *s *= 2.0);
    let mut whole = object.clone();
    whole.add(&walls, 8.0, Vec3::ZERO);
    let part: Vec<usize> = (0..object.len()).collect();
    let shown = CaptureEnvironment::around(&whole, &part, Some(1.0)).expect("it is enclosed");
    let found = estimate_light(object, bake, Some(&shown), &no_progress).expect("not cancelled");
    (found, shown)
}

#[test]
fn a_room_shows_its_light_and_the_object_how_bright_its_lamp_is() {
    let to_lamp = Vec3::new(0.6, 0.0, 0.8);
    let light = |d: Vec3| match d.dot(to_lamp) > 0.93 {
        true => [9.0, 8.0, 7.0],
        false => [0.3 + 0.1 * d.y, 0.3, 0.3 - 0.1 * d.y],
    };
    let scene = worn(lit(3000, light, None));
    let (found, shown) = in_a_room(&scene, light);
    assert!(shown.cover > 0.95, "{}", shown.cover);
    // Four fifths of the light are the lamp's, and clipped.
    let off = unlike(&found.light, light);
    let without = unlike(&estimate(&scene).light, light);
    assert!(
        off < 0.12 && off < without,
        "{off}, {without} without the room"
    );
    let lamp = found.light.sky_radiance(to_lamp)[1];
    assert!((4.0..16.0).contains(&lamp), "{lamp}");
    // Walls keep their colours, but for what grey light and white surfaces say of all of it.
    let [left, right] = [1.0, -1.0].map(|y| found.light.sky_radiance(Vec3::new(-0.3, y, 0.1)));
    assert!(
        left[0] > 1.3 * left[2] && right[2] > 1.3 * right[0],
        "{left:?} {right:?}"
    );
}

#[test]
fn a_lamp_that_no_camera_saw_is_found_in_an_open_ceiling() {
    let to_lamp = Vec3::new(0.6, 0.0, 0.8);
    let light = |d: Vec3| match d.dot(to_lamp) > 0.93 {
        true => [9.0; 3],
        false => [0.3; 3],
    };
    let scene = worn(lit(3000, light, None));
    let walls = |d: Vec3| if d.z > 0.4 { [f32::NAN; 3] } else { light(d) };
    let (found, shown) = in_a_room(&scene, walls);
    assert!((0.6..0.75).contains(&shown.cover), "{}", shown.cover);
    let toward = found.light.dominant_direction();
    assert!(toward.dot(to_lamp) > 0.97, "{toward}");
    let off = unlike(&found.light, light);
    let without = unlike(&estimate(&scene).light, light);
    assert!(
        off < 0.15 && off < without,
        "{off}, {without} without the room"
    );
}

#[test]
fn what_says_nothing_has_the_light_that_the_room_shows() {
    let light = |d: Vec3| [0.3 + 0.1 * d.x, 0.3, 0.3];
    let (cloud, bake) = lit(700, light, None);
    let black = SurfelCloud {
        sh: vec![[0.0; 3]; cloud.len()].into(),
        ..cloud
    };
    let (found, _) = in_a_room(&(black, bake), light);
    assert_eq!((found.obstacle, found.confidence), (None, 0.5));
    let off = unlike(&found.light, light);
    assert!(off < 0.02, "{off}");
}

#[test]
fn a_room_is_not_enclosed_by_what_stands_in_it() {
    let mut whole = synthetic::sphere(500);
    let n = whole.len();
    whole.add(&synthetic::sphere(4000), 8.0, Vec3::ZERO);
    let [object, room] = [0..n, n..whole.len()].map(|of| of.collect::<Vec<_>>());
    assert!(CaptureEnvironment::around(&whole, &room, None).is_none());
    let mut opaque = whole.clone();
    opaque.scales[n..].iter_mut().for_each(|s| *s *= 2.0);
    assert!(CaptureEnvironment::around(&opaque, &object, None).is_some());
}

/// A warm lobe and a cold one beside it: no rotation or mirror image of it is like it.
fn lobes(d: Vec3) -> [f32; 3] {
    let lobe = |toward: [f32; 3]| (3.0 * (d.dot(Vec3::from(toward).normalize()) - 1.0)).exp();
    let (warm, cold) = (lobe([1.0, 0.0, 0.6]), lobe([0.2, 1.0, 0.4]));
    [
        0.1 + 4.0 * warm + 0.6 * cold,
        0.1 + 3.0 * warm + cold,
        0.1 + 2.0 * warm + 1.6 * cold,
    ]
}

fn samples(sky: impl Fn(Vec3) -> [f32; 3] + Sync) -> LightSamples {
    LightSamples::of(&EnvironmentMap::of_directions(256, 128, |d| {
        sky(d.as_vec3())
    }))
}

/// Alignment of an object lit by `lobes` with a light, as it is and mirrored.
fn aligned(lights: [LightSamples; 2]) -> Alignment {
    let (cloud, bake) = lit(3000, lobes, None);
    let [light, mirrored] = &lights;
    align_light(&cloud, &bake, cloud.up, [light, mirrored], &no_progress)
        .expect("not cancelled")
        .expect("it shows its light")
}

#[test]
fn a_light_is_rotated_to_where_it_explains_the_object() {
    let light = samples(lobes);
    let found = aligned([light.clone(), light.mirrored()]);
    assert_eq!(found.advice(0.0, false), Advice::Keep);
    assert_eq!(found.advice(3.0, false), Advice::Keep);
    // It was captured at 0; a light that comes rotated by 130 has to go back.
    let turned = light.rotated(DMat3::from_rotation_z(130f64.to_radians()));
    let found = aligned([turned.clone(), turned.mirrored()]);
    let Advice::Rotate(back, false) = found.advice(0.0, false) else {
        panic!("{:?}", found.advice(0.0, false));
    };
    assert!((back + 130.0).abs() < 3.0, "{back}");
    // Mirrored, too.
    let found = aligned([turned.mirrored(), turned]);
    let Advice::Rotate(back, true) = found.advice(0.0, false) else {
        panic!("{:?}", found.advice(0.0, false));
    };
    assert!((back + 130.0).abs() < 3.0, "{back}");
}

#[test]
fn a_light_of_another_place_fits_nowhere() {
    // Bright at the horizon all around, and black above: the object was lit from two sides and from above.
    let ring = samples(|d| [(-(d.z / 0.1).powi(2)).exp() + 1e-3; 3]);
    let found = aligned([ring.clone(), ring]);
    assert_eq!(found.advice(0.0, false), Advice::Replace);
}

#[test]
fn trust_grows_with_confidence_from_half_to_full() {
    let trust = |confidence| {
        let told = Estimate {
            confidence,
            obstacle: None,
            ..Estimate::none(Obstacle::Black)
        };
        told.trust()
    };
    assert_eq!([0.0, 0.97, 1.0].map(trust), [0.5, 1.0, 1.0]);
    let [less, more] = [0.1, 0.8].map(trust);
    assert!(0.5 < less && less < more && more < 1.0, "{less} {more}");
    let even = Estimate::none(Obstacle::EvenLight);
    assert_eq!(
        (even.trust(), Estimate::none(Obstacle::OneWay).trust()),
        (1.0, 0.5)
    );
}

#[test]
fn one_turn_is_that_of_the_oracle() {
    let (cloud, bake) = lit(700, slanted, None);
    let clusters = Clusters::new(&cloud, &bake, &mean_radiance(&cloud, &bake.normals));
    let expected = ExpectedLight::from_above(Vec3::Z);
    let mut fit = Fit::new(&clusters, NEIGHBORS, &expected);
    let tint = [1.2, 1.0, 0.8];
    fit.unit = Unit::Mean(tint);
    let wave = |c: usize| move |k: usize| 0.1 * ((k * 7 + c * 5) as f64).sin();
    let start = FittedLight {
        sky: std::array::from_fn(|c| (0..SKY).map(wave(c)).collect()),
        sun: None,
    };
    let explained = fit.explain(&start);
    let noise = fit.noise(&explained);
    let basis: Vec<Vec<f64>> = directions().iter().map(|d| sky_basis(*d)).collect();
    let pairs: Vec<([usize; 2], [f64; 3])> = clusters
        .pairs(NEIGHBORS)
        .iter()
        .map(|p| (p.of.map(|k| k as usize), p.weight))
        .collect();
    let precision: Vec<f64> = (0..SKY).map(|k| precision(k)[0]).collect();
    let oracle = EstimateProblem {
        radiance: &clusters.radiance,
        seen: &clusters.seen,
        basis: &basis,
        prior: &expected.coefficients,
        precision: &precision,
        coupling: std::array::from_fn(|a| std::array::from_fn(|b| held([1.0, 3.0], a, b))),
        tint,
        bounced: &clusters.bounced,
        mass: &clusters.mass,
        pairs: &pairs,
        epsilon: 0.006,
        noise,
    };
    let expected = oracle.step(&start.sky);
    let solved = fit
        .solve(&start, &explained, noise)
        .expect("it can be solved");
    for c in 0..3 {
        for k in 0..SKY {
            let (a, b) = (solved.step[c * SKY + k], expected[c][k]);
            // Products are sums of f32; steps are of the order of 1.
            assert!((a - b).abs() < 1e-3, "channel {c}, {k}: {a} for {b}");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]
    /// Neither the scene's unit nor the exposure of its images changes the light's shape. Powers of two round no product, so no ray falls
    /// otherwise and no surfel changes clusters; only logarithms round.
    #[test]
    fn unit_and_exposure_change_nothing(unit in -7i32..8, stops in -8i32..9) {
        let (cloud, bake) = lit(1000, slanted, None);
        let expected = estimated(&cloud, &bake);
        let mut other = cloud.clone();
        let (unit, gain) = (2f32.powi(unit), 2f32.powi(stops));
        for (p, s) in other.positions.iter_mut().zip(&mut other.scales) {
            *p *= unit;
            *s *= unit;
        }
        for c in other.sh.iter_mut().flatten() {
            *c *= gain;
        }
        let found = of_asset(&other);
        prop_assert_eq!(found.is_told(), expected.is_told());
        let off = unlike(&found.light, |d| expected.light.sky_radiance(d));
        prop_assert!(off < 1e-3, "{}", off);
        let strength = found.light.sky_radiance(Vec3::Z)[0] / expected.light.sky_radiance(Vec3::Z)[0];
        prop_assert!((strength / gain).ln().abs() < 1e-3, "{} for {}", strength, gain);
    }
}
