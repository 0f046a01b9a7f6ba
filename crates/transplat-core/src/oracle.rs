//! The same mathematics in plain f64, one surfel at a time, as the formulas read: slow, and obviously right.
//! Production code and the GPU passes are held against it.

mod best;
mod estimate;
mod transfer;

use glam::DVec3;

use crate::environment::EnvironmentMap;
use crate::sh::{coefficient_count, evaluate_basis, fibonacci_sphere};
use crate::surfels::SurfelCloud;
use crate::visibility::trace::{NEAREST_SCALES, RaySurfel, STACK_SCALES, START_SCALES};
use crate::visibility::transmittance::{LEAST_OPACITY, MOST_REACH};
use crate::visibility::{BakeInput, EDGE_ON, MIN_SLOPE_COSINE, SHARPNESS, TAPS, Visibility};

pub use best::OracleBest;
pub use estimate::EstimateProblem;
pub use transfer::{OracleTransfer, relight_asset, relight_surfel};

/// `L_k = sum over pixels of L(d) Y_k(d) omega`, `[K][3]`.
pub fn project_environment(map: &EnvironmentMap, degree: usize) -> Vec<[f64; 3]> {
    let k = coefficient_count(degree);
    let mut sums = vec![[0f64; 3]; k];
    let mut y = vec![0f64; k];
    for row in 0..map.height() {
        let omega = map.pixel_solid_angle(row);
        for column in 0..map.width() {
            evaluate_basis(map.direction(column, row), degree, &mut y);
            let pixel = map.pixels()[row * map.width() + column];
            for (sum, y) in sums.iter_mut().zip(&y) {
                for (s, p) in sum.iter_mut().zip(pixel) {
                    *s += omega * y * f64::from(p);
                }
            }
        }
    }
    sums
}

/// How far values are from exact ones: the L2 norm of the difference over theirs, and the largest difference.
pub fn difference<T: Copy + Into<f64>>(got: &[[T; 3]], exact: &[[f64; 3]]) -> (f64, f64) {
    let (mut off, mut all, mut largest) = (0.0, 0.0, 0f64);
    for (got, exact) in got.iter().flatten().zip(exact.iter().flatten()) {
        let difference = (*got).into() - exact;
        off += difference * difference;
        all += exact * exact;
        largest = largest.max(difference.abs());
    }
    ((off / f64::max(all, 1e-30)).sqrt(), largest)
}

/// The same from point samples, evenly spread: what they miss of a sun is lost.
pub fn project_samples(map: &EnvironmentMap, degree: usize, samples: usize) -> Vec<[f64; 3]> {
    let k = coefficient_count(degree);
    let mut sums = vec![[0f64; 3]; k];
    let mut y = vec![0f64; k];
    let weight = 4.0 * std::f64::consts::PI / samples.max(1) as f64;
    for d in fibonacci_sphere(samples) {
        evaluate_basis(d, degree, &mut y);
        let radiance = map.sample(DVec3::from_array(d).as_vec3());
        for (sum, y) in sums.iter_mut().zip(&y) {
            for (s, r) in sum.iter_mut().zip(radiance) {
                *s += weight * y * f64::from(r);
            }
        }
    }
    sums
}

/// `V_k` and the cosine transfer vector `T_k` of surfel `i`, in pairs, as sums over the lattice. `[K]`
pub fn visibility_coefficients(
    visibility: &Visibility,
    i: usize,
    degree: usize,
) -> Vec<(f64, f64)> {
    let n = visibility.normals[i].as_dvec3();
    let mut sums = vec![(0.0, 0.0); coefficient_count(degree)];
    let mut y = vec![0.0; sums.len()];
    for (j, w) in fibonacci_sphere(visibility.directions)
        .into_iter()
        .enumerate()
    {
        let open = f64::from(visibility.open[i * visibility.directions + j]) / 255.0;
        let cosine = n.dot(DVec3::from_array(w)).max(0.0);
        evaluate_basis(w, degree, &mut y);
        let share = 4.0 * std::f64::consts::PI / visibility.directions as f64;
        for (sum, y) in sums.iter_mut().zip(&y) {
            sum.0 += share * open * y;
            sum.1 += share * open * cosine * y;
        }
    }
    sums
}

/// Openness of surfel `i` towards direction `j`: the height map's texels are found by asking every occluder.
pub fn openness(input: &BakeInput, i: usize, j: usize) -> f64 {
    let frame = &input.frames[j];
    let (right, up, towards) = (
        frame.right.as_dvec3(),
        frame.up.as_dvec3(),
        frame.direction.as_dvec3(),
    );
    let texel = 2.0 / input.resolution as f64;
    let height_at = |x: f64, y: f64| {
        let mut highest = f64::from(crate::visibility::EMPTY);
        for surfel in &input.surfels {
            let [a, b] = surfel.axes.map(|v| v.as_dvec3());
            let p = surfel.position.as_dvec3();
            let (ax, ay, bx, by) = (a.dot(right), a.dot(up), b.dot(right), b.dot(up));
            let det = ax * by - ay * bx;
            if det.abs() <= f64::from(EDGE_ON) * a.length() * b.length() {
                continue;
            }
            let (dx, dy) = (x - p.dot(right), y - p.dot(up));
            let s = (dx * by - dy * bx) / det;
            let t = (dy * ax - dx * ay) / det;
            if s * s + t * t <= 1.0 {
                highest = highest.max((p + a * s + b * t).dot(towards));
            }
        }
        highest
    };
    let receiver = &input.surfels[i];
    let (p, n) = (receiver.position.as_dvec3(), receiver.normal.as_dvec3());
    let facing = n.dot(towards);
    let cosine = facing
        .abs()
        .max(f64::from(MIN_SLOPE_COSINE))
        .copysign(facing);
    let (px, py) = (p.dot(right), p.dot(up));
    let mut sum = 0.0;
    for [ox, oy] in TAPS {
        let column = ((px + 1.0) / texel + f64::from(ox)).floor();
        let row = ((py + 1.0) / texel + f64::from(oy)).floor();
        let size = input.resolution as f64;
        if !(0.0..size).contains(&column) || !(0.0..size).contains(&row) {
            sum += 1.0;
            continue;
        }
        let (x, y) = ((column + 0.5) * texel - 1.0, (row + 0.5) * texel - 1.0);
        let plane = p.dot(towards) - (n.dot(right) * (x - px) + n.dot(up) * (y - py)) / cosine;
        let above = height_at(x, y) - plane - f64::from(receiver.bias);
        sum += (-f64::from(SHARPNESS) * above.max(0.0)).exp();
    }
    sum / TAPS.len() as f64
}

/// How far a ray from surfel `i` towards `direction` goes until it meets the disc of surfel `j`, if it does.
pub fn hit_distance(surfels: &[RaySurfel], i: usize, direction: DVec3, j: usize) -> Option<f64> {
    let (from, met) = (&surfels[i], &surfels[j]);
    let (normal, minor) = (from.normal.as_dvec3(), f64::from(from.minor));
    let in_front = normal.dot(direction) >= 0.0;
    let side = if in_front { 1.0 } else { -1.0 };
    let origin = from.position.as_dvec3() + normal * (side * f64::from(START_SCALES) * minor);
    let [a, b] = met.axes.map(|v| v.as_dvec3());
    let facing = met.normal.as_dvec3().dot(direction);
    if a.length() == 0.0 || b.length() == 0.0 || facing.abs() < 1e-6 {
        return None;
    }
    let center = met.position.as_dvec3();
    let t = (center - origin).dot(met.normal.as_dvec3()) / facing;
    let p = origin + direction * t - center;
    let (u, v) = (p.dot(a) / a.length_squared(), p.dot(b) / b.length_squared());
    // Out of the front of what is seen from its front alone: a member of the surfel's own stack.
    let nearest = if in_front && met.one_sided && facing > 0.0 {
        f64::from(STACK_SCALES) * f64::from(from.major)
    } else {
        f64::from(NEAREST_SCALES) * minor
    };
    (u * u + v * v <= 1.0 && t > nearest).then_some(t)
}

/// What of the light from far away towards `direction` reaches the centre of surfel `i`: all surfels between, each as far as it
/// reaches.
pub fn transmittance(cloud: &SurfelCloud, i: usize, direction: DVec3) -> f64 {
    let origin = cloud.positions[i].as_dvec3();
    let lets_through = |j: usize| {
        let [u, v] = cloud.tangents[j].map(|t| t.as_dvec3());
        let [a, b] = cloud.scales[j].as_dvec2().to_array();
        let n = u.cross(v);
        let center = cloud.positions[j].as_dvec3();
        let t = (center - origin).dot(n) / n.dot(direction);
        if j == i || !(t > 0.0 && t.is_finite()) {
            return 1.0;
        }
        let p = origin + direction * t - center;
        let off = (p.dot(u) / a).powi(2) + (p.dot(v) / b).powi(2);
        let alpha = f64::from(cloud.opacities[j]) * (-0.5 * off).exp();
        let reaches = alpha >= f64::from(LEAST_OPACITY) && off <= f64::from(MOST_REACH).powi(2);
        if reaches { 1.0 - alpha } else { 1.0 }
    };
    (0..cloud.len()).map(lets_through).product()
}

/// The nearest of those distances over all surfels.
pub fn first_hit(surfels: &[RaySurfel], i: usize, direction: DVec3) -> Option<f64> {
    (0..surfels.len())
        .filter_map(|j| hit_distance(surfels, i, direction, j))
        .min_by(f64::total_cmp)
}

/// Means over what is around each surfel.
fn pooled<const N: usize>(around: &[Vec<(usize, f64)>], values: &[[f64; N]]) -> Vec<[f64; N]> {
    let mean = |of: &Vec<(usize, f64)>, v: usize| of.iter().map(|(j, s)| s * values[*j][v]).sum();
    let each = around.iter();
    each.map(|of| std::array::from_fn(|v| mean(of, v)))
        .collect()
}

/// From 0 at `low` to 1 at `high`, both flat.
fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
