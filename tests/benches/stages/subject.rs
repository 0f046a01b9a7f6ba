//! What is measured: an asset of any size that every machine can make.

use glam::Vec3;
use transplat_core::color::Encoding;
use transplat_core::sh::coefficient_count;
use transplat_core::surfels::SurfelCloud;
use transplat_core::synthetic::{from_points, sheet, sphere};

/// Layers of surfels on the surface: trained assets have some 26 of them behind a pixel.
const LAYERS: usize = 2;

/// A rough ball over a slab, about `n` surfels, with colour of a degree as trainers store it.
pub fn rough_ball_over_slab(n: usize, degree: usize) -> SurfelCloud {
    let layer = n / LAYERS;
    let (ball, edge) = (layer * 2 / 3, ((layer / 6) as f32).sqrt() as usize);
    let rough = |d: Vec3| 1.0 + 0.1 * (7.0 * d.x).sin() * (9.0 * d.y).sin() * (8.0 * d.z).cos();
    let base = sphere(ball);
    let points: Vec<Vec3> = base.positions.iter().map(|d| *d * rough(*d)).collect();
    // The normal of r(d) d, by differences.
    let normal = |d: &Vec3| {
        let (u, v) = d.any_orthonormal_pair();
        let at = |d: Vec3| d.normalize() * rough(d.normalize());
        let step = 1e-3;
        let along = |t: Vec3| at(*d + step * t) - at(*d - step * t);
        along(u).cross(along(v)).normalize()
    };
    let normals: Vec<Vec3> = base.positions.iter().map(normal).collect();
    let mut one = from_points(&points, &normals, base.scales[0].x);
    let slab = sheet(edge);
    one.add(&slab, 2.0, -1.3 * Vec3::Z);
    one.add(&slab, 2.0, -1.4 * Vec3::Z);
    let mut cloud = one.clone();
    for i in 1..LAYERS {
        cloud.add(&one, 1.0 + 1e-3 * i as f32, Vec3::ZERO);
    }
    let k = coefficient_count(degree);
    cloud.encoding = Encoding::Stored;
    cloud.sh_degree = degree;
    cloud.sh = (0..cloud.len() * k)
        .map(|i| {
            let (surfel, j) = (i / k, i % k);
            let v = ((surfel * 31 + j * 17) % 29) as f32 / 29.0 - 0.5;
            if j == 0 {
                [1.8 + v, 1.8, 1.8 - v]
            } else {
                [0.05 * v, 0.05 * v, 0.02]
            }
        })
        .collect();
    cloud
}
