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
    let weight = |values: &[(f64, f64)]| values.iter().map(|(_, w)| w).sum::<f64>();
    let mut wanted = share * weight(&values);
    let mut left = &mut values[..];
    while left.len() > 1 {
        let (below, at, above) =
            left.select_nth_unstable_by(left.len() / 2, |a, b| a.0.total_cmp(&b.0));
        let weight_below = weight(below);
        if weight_below >= wanted {
            left = below;
        } else if weight_below + at.1 >= wanted || above.is_empty() {
            return Some(at.0);
        } else {
            wanted -= weight_below + at.1;
            left = above;
        }
    }
    left.first().map(|(v, _)| *v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_weighted_quantile_is_the_first_value_that_reaches_its_share() {
        let values: Vec<(f64, f64)> = (0..99)
            .map(|i| (f64::from(i * 37 % 50), f64::from(i * 13 % 4)))
            .collect();
        let all: f64 = values.iter().map(|(_, w)| w).sum();
        let up_to = |value: f64| -> f64 {
            let below = values.iter().filter(|(v, _)| *v <= value);
            below.map(|(_, w)| w).sum()
        };
        for share in [0.0, 0.1, 0.5, 0.9, 1.0] {
            let found = weighted_quantile(values.clone(), share);
            let reached = (0..50).map(f64::from).find(|v| up_to(*v) >= share * all);
            assert_eq!(found, reached, "share {share}");
        }
        assert_eq!(weighted_quantile(Vec::new(), 0.5), None);
    }
}
