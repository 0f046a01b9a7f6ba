//! Quantiles and other functions of numbers.

/// `0` below `low`, `1` above `high`, and smooth between.
pub(crate) fn smoothstep(low: f32, high: f32, x: f32) -> f32 {
    let t = ((x - low) / (high - low)).clamp(0.0, 1.0);
    t * t * (3.0 - 2.0 * t)
}

/// A ratio; 0 over nothing.
pub(crate) fn over(part: f32, whole: f32) -> f32 {
    if whole > 0.0 { part / whole } else { 0.0 }
}

/// The value that a share of them, 0 to 1, lies below; none of none.
pub fn quantile(mut values: Vec<f32>, share: f32) -> Option<f32> {
    let last = values.len().checked_sub(1)?;
    let at = (last as f32 * share) as usize;
    Some(
        *values
            .select_nth_unstable_by(at.min(last), f32::total_cmp)
            .1,
    )
}

/// The value that a share of the weights lies below; none of no values.
pub(crate) fn weighted_quantile(mut values: Vec<(f64, f64)>, share: f64) -> Option<f64> {
    values.sort_by(|a, b| a.0.total_cmp(&b.0));
    let wanted = share * values.iter().map(|(_, w)| w).sum::<f64>();
    let mut below = 0.0;
    let at = values.iter().find(|(_, w)| {
        below += w;
        below >= wanted
    });
    at.or(values.last()).map(|(v, _)| *v)
}
