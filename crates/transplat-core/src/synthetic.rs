//! Synthetic scenes with known answers, for tests here and in other crates.

use glam::{Affine3A, DMat3, DQuat, Vec2, Vec3};

use crate::color::Encoding;
use crate::sh::{MAX_COEFFICIENTS, SQRT_4PI, coefficient_count, evaluate_basis, lattice};
use crate::surfels::{SurfelCloud, Thickness, UpAxis};

/// Surfels at given points with given normals, all of one size, opaque, and grey (linear radiance 1/2) from everywhere.
pub fn from_points(points: &[Vec3], normals: &[Vec3], scale: f32) -> SurfelCloud {
    let n = points.len();
    SurfelCloud {
        positions: points.to_vec(),
        tangents: normals
            .iter()
            .map(|n| {
                let (u, v) = n.any_orthonormal_pair();
                [u, v]
            })
            .collect(),
        scales: vec![Vec2::splat(scale); n],
        thicknesses: vec![Thickness::FLAT; n],
        opacities: vec![0.95; n],
        sh: vec![[0.5 * SQRT_4PI as f32; 3]; n].into(),
        sh_degree: 0,
        encoding: Encoding::Linear,
        up: UpAxis::PlusZ,
        outside_from: Vec::new(),
        origin: glam::DVec3::ZERO,
    }
}

/// A unit sphere of `n` surfels with outward normals.
pub fn sphere(n: usize) -> SurfelCloud {
    let points = lattice(n);
    // Spacing sqrt(4 pi / n); 0.64 of it is what training comes to.
    let scale = 0.64 * (4.0 * std::f32::consts::PI / n as f32).sqrt();
    from_points(&points, &points, scale)
}

/// A square sheet of `n` x `n` surfels in the plane z = 0, of edge 2.
pub fn sheet(n: usize) -> SurfelCloud {
    let step = 2.0 / n as f32;
    let points: Vec<Vec3> = (0..n * n)
        .map(|i| {
            Vec3::new(
                (i % n) as f32 * step - 1.0 + step / 2.0,
                (i / n) as f32 * step - 1.0 + step / 2.0,
                0.0,
            )
        })
        .collect();
    from_points(&points, &vec![Vec3::Z; n * n], 0.64 * step)
}

/// A sphere of half the plate's width hovering over a plate: a scene with a cast shadow. About `n` surfels each.
pub fn sphere_over_plate(n: usize) -> SurfelCloud {
    let mut points = sphere(n).positions;
    let mut normals = points.clone();
    for p in &mut points {
        *p = *p * 0.5 + Vec3::Z * 0.7;
    }
    let plate = sheet((n as f32).sqrt() as usize);
    normals.extend(vec![Vec3::Z; plate.len()]);
    points.extend(plate.positions);
    from_points(&points, &normals, plate.scales[0].x)
}

/// A sphere over a slab: the plate has an underside, so that every surfel has one front.
pub fn sphere_over_slab(n: usize) -> SurfelCloud {
    let mut cloud = sphere_over_plate(n);
    cloud.add(&sheet((n as f32).sqrt() as usize), 1.0, -0.15 * Vec3::Z);
    cloud
}

/// An asset turned about the origin, its colour with it.
pub fn turned(cloud: &SurfelCloud, turn: DMat3) -> SurfelCloud {
    let turn = DQuat::from_mat3(&turn).as_quat();
    cloud.transformed(Affine3A::from_quat(turn))
}

/// A sphere over a plate with some view dependence of a degree, different on every surfel; linear colour.
pub fn glossy_sphere_over_plate(n: usize, degree: usize) -> SurfelCloud {
    let mut cloud = sphere_over_plate(n);
    let k = coefficient_count(degree);
    cloud.sh_degree = degree;
    cloud.sh = (0..cloud.len())
        .flat_map(|i| {
            (0..k).map(move |j| {
                let v = ((i * 31 + j * 17) % 29) as f32 / 29.0 - 0.5;
                if j == 0 {
                    [1.0 + v, 1.2, 0.7 - v]
                } else {
                    [0.2 * v, -0.1 * v, 0.05]
                }
            })
        })
        .collect();
    cloud
}

/// A sheet with two sides over a ball on a plate, all of which show what they mirror of a sun; colour of a degree, encoded as trainers
/// store it. About 1000 surfels.
pub fn mirroring_ball_plate_and_sheet(toward_sun: Vec3, degree: usize) -> SurfelCloud {
    let mut cloud = sphere_over_plate(500);
    let sheet = sheet(6);
    let (ball_and_plate, k) = (cloud.len(), coefficient_count(degree));
    let grey = cloud.sh[0];
    cloud.add(&sheet, 0.5, 2.5 * Vec3::Z);
    cloud.sh_degree = degree;
    cloud.sh = (0..cloud.len())
        .flat_map(|i| {
            let n = cloud.stored_normal(i);
            // The plate is below, and faces up; the ball faces away from its middle.
            let outward = i >= ball_and_plate || n.dot(cloud.positions[i]) > 0.0;
            let n = if outward { n } else { -n };
            let away = toward_sun - 2.0 * n * n.dot(toward_sun);
            let mut y = [0f32; MAX_COEFFICIENTS];
            evaluate_basis(away.to_array(), degree, &mut y);
            (0..k).map(move |j| match j {
                0 => grey,
                _ => std::array::from_fn(|c| {
                    let noise = 0.03 * ((i * 13 + j * 7 + c) as f32).sin() / j as f32;
                    noise + 0.1 * y[j]
                }),
            })
        })
        .collect();
    cloud
}
