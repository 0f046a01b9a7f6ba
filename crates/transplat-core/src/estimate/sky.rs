//! Basis of the sky's logarithm.

use glam::Vec3;

use crate::bake::strata::DIRECTIONS;
use crate::sh::{SQRT_4PI, coefficient_count, evaluate_basis};

/// SH degree of the logarithm of the light.
pub const DEGREE: usize = 6;

/// Unknowns of the sky in a channel.
pub(super) const SKY: usize = coefficient_count(DEGREE);

/// Basis functions towards a direction, of mean square 1. `[SKY]`
pub(super) fn sky_basis(d: Vec3) -> Vec<f64> {
    let mut values = vec![0f64; SKY];
    evaluate_basis(d.as_dvec3().to_array(), DEGREE, &mut values);
    values.iter().map(|v| v * SQRT_4PI).collect()
}

/// Bake's direction, of all of them, next to one.
pub(super) fn nearest_direction(directions: &[Vec3], d: Vec3) -> usize {
    let nearer = |a: &usize, b: &usize| directions[*a].dot(d).total_cmp(&directions[*b].dot(d));
    (0..DIRECTIONS).max_by(nearer).unwrap_or_default()
}
