//! Rays and their hits in f64.

use glam::DVec3;

use crate::bake::harmonic::{BakeInput, EDGE_ON, MIN_SLOPE_COSINE, SHARPNESS, TAPS};
use crate::bake::trace::{NEAREST_SCALES, RaySurfel, STACK_SCALES, START_SCALES};
use crate::bake::transmittance::{LEAST_OPACITY, MOST_REACH};
use crate::surfels::SurfelCloud;

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
        let mut highest = f64::from(crate::bake::harmonic::EMPTY);
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

/// Distance of a ray from surfel `i` towards `direction` to the disc of surfel `j`, if it hits that.
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

/// Transmittance of light from far away towards `direction` to the centre of surfel `i`: all surfels between, each as far as it reaches.
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
