//! Pooling of a surfel's neighbours in f64.

/// Means over what is around each surfel.
pub(super) fn pooled<const N: usize>(
    around: &[Vec<(usize, f64)>],
    values: &[[f64; N]],
) -> Vec<[f64; N]> {
    let mean = |of: &Vec<(usize, f64)>, v: usize| of.iter().map(|(j, s)| s * values[*j][v]).sum();
    let each = around.iter();
    each.map(|of| std::array::from_fn(|v| mean(of, v)))
        .collect()
}

/// From 0 at `low` to 1 at `high`, both flat.
pub(super) fn smoothstep(low: f64, high: f64, x: f64) -> f64 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}
