//! What is measured: an asset of any size that every machine can make.

use std::io::{BufWriter, Write as _};
use std::path::Path;

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

/// The asset as trainers write it.
pub fn write_ply(cloud: &SurfelCloud, path: &Path) {
    let rest = 3 * (coefficient_count(cloud.sh_degree) - 1);
    let named = |prefix: &str, count: usize| {
        (0..count)
            .map(|i| format!("{prefix}{i}"))
            .collect::<Vec<_>>()
    };
    let names = [
        ["x", "y", "z"].map(String::from).to_vec(),
        named("f_dc_", 3),
        named("f_rest_", rest),
        vec!["opacity".into()],
        named("scale_", 2),
        named("rot_", 4),
    ]
    .concat();
    let file = std::fs::File::create(path).expect("it can be written");
    let mut out = BufWriter::new(file);
    let mut head = format!(
        "ply\nformat binary_little_endian 1.0\nelement vertex {}\n",
        cloud.len()
    );
    for name in names {
        head += &format!("property float {name}\n");
    }
    writeln!(out, "{head}end_header").expect("there is room");
    for i in 0..cloud.len() {
        let [u, v] = cloud.tangents[i];
        let turn = glam::Quat::from_mat3(&glam::Mat3::from_cols(u, v, u.cross(v)));
        let sh = cloud.sh_of(i);
        let opacity = cloud.opacities[i];
        let mut row = cloud.positions[i].to_array().to_vec();
        row.extend(sh[0].map(|v| v - 1.772_453_9));
        row.extend((0..3).flat_map(|c| sh[1..].iter().map(move |v| v[c])));
        row.push((opacity / (1.0 - opacity)).ln());
        row.extend(cloud.scales[i].to_array().map(f32::ln));
        row.extend([turn.w, turn.x, turn.y, turn.z]);
        for value in row {
            out.write_all(&value.to_le_bytes()).expect("there is room");
        }
    }
    out.flush().expect("there is room");
}
