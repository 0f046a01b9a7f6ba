//! Codebooks: 256 numbers that stand for many, and vectors that stand for many.

use rayon::prelude::*;

use super::layout::CODES;

/// Turns of Lloyd's algorithm for a codebook of numbers.
const TURNS: usize = 24;

/// Vectors of a node that its direction is found from.
const SAMPLED: usize = 1024;

/// Numbers that stand for all the given ones, ascending, with little squared error; what is no number is left aside.
pub(super) fn codebook(values: impl Iterator<Item = f32>) -> [f32; CODES] {
    let mut sorted: Vec<f32> = values.filter(|v| v.is_finite()).collect();
    sorted.par_sort_unstable_by(f32::total_cmp);
    let Some(last) = sorted.len().checked_sub(1) else {
        return [0.0; CODES];
    };
    let sums: Vec<f64> = std::iter::once(0.0)
        .chain(sorted.iter().scan(0.0, |sum, v| {
            *sum += f64::from(*v);
            Some(*sum)
        }))
        .collect();
    // Half by rank and half by range, so that neither the many nor the far are coarse.
    let mut codes: [f32; CODES] = std::array::from_fn(|i| {
        let share = i as f32 / (CODES - 1) as f32;
        let by_rank = sorted[(share * last as f32) as usize];
        0.5 * by_rank + 0.5 * (sorted[0] + share * (sorted[last] - sorted[0]))
    });
    for _ in 0..TURNS {
        let mut start = 0;
        for i in 0..CODES {
            let end = match codes.get(i + 1) {
                Some(next) => sorted.partition_point(|v| *v < 0.5 * (codes[i] + next)),
                None => sorted.len(),
            };
            if end > start {
                codes[i] = ((sums[end] - sums[start]) / (end - start) as f64) as f32;
            }
            start = end.max(start);
        }
    }
    codes
}

/// The code of the number that is nearest in an ascending codebook.
pub(super) fn nearest(codes: &[f32; CODES], value: f32) -> u8 {
    let above = codes.partition_point(|c| *c < value).min(CODES - 1);
    let below = above.saturating_sub(1);
    let is_below = (value - codes[below]).abs() <= (codes[above] - value).abs();
    (if is_below { below } else { above }) as u8
}

/// At most `most` vectors that stand for all the given ones `[n][d]`, `[k][d]`, and which of them each is. A tree: what is most apart is parted
/// across the direction in which it is.
pub(super) fn palette(vectors: &[f32], d: usize, most: usize) -> (Vec<f32>, Vec<u16>) {
    let n = vectors.len() / d;
    let mut order: Vec<u32> = (0..n as u32).collect();
    // Levels of the tree, each of as many parts as there is room for; the vectors of a part lie together.
    let mut parts = vec![CodebookPart::new(vectors, d, &order)];
    while parts.len() < most {
        let room = most - parts.len();
        let mut worst: Vec<usize> = (0..parts.len())
            .filter(|p| parts[*p].spread > 0.0)
            .collect();
        if worst.is_empty() {
            break;
        }
        worst.sort_unstable_by(|a, b| parts[*b].spread.total_cmp(&parts[*a].spread));
        // Only what is apart is parted, and not all at once: the errors even out.
        worst.truncate(room.min(worst.len().div_ceil(2)));
        let mut is_parted = vec![false; parts.len()];
        worst.iter().for_each(|p| is_parted[*p] = true);
        let mut rest = &mut order[..];
        let mut jobs = Vec::with_capacity(parts.len());
        for (part, is_parted) in parts.into_iter().zip(is_parted) {
            let (own, after) = rest.split_at_mut(part.count);
            rest = after;
            jobs.push((part, own, is_parted));
        }
        let made = jobs
            .into_par_iter()
            .flat_map_iter(|(part, own, is_parted)| {
                if !is_parted {
                    return vec![part];
                }
                let middle = part.divide(vectors, d, own);
                let (low, high) = own.split_at(middle);
                vec![
                    CodebookPart::new(vectors, d, low),
                    CodebookPart::new(vectors, d, high),
                ]
            });
        parts = made.collect();
    }
    let mut labels = vec![0; n];
    let mut rest = &order[..];
    for (label, part) in parts.iter().enumerate() {
        let (own, after) = rest.split_at(part.count);
        own.iter().for_each(|i| labels[*i as usize] = label as u16);
        rest = after;
    }
    let centroids = parts.into_iter().flat_map(|p| p.mean).collect();
    (centroids, labels)
}

/// Vectors that one stands for.
struct CodebookPart {
    count: usize,
    mean: Vec<f32>,
    /// Sum of squared distances from the mean.
    spread: f32,
}

impl CodebookPart {
    fn new(vectors: &[f32], d: usize, of: &[u32]) -> Self {
        let mut mean = vec![0f32; d];
        for i in of {
            let vector = &vectors[*i as usize * d..][..d];
            mean.iter_mut().zip(vector).for_each(|(m, v)| *m += v);
        }
        mean.iter_mut().for_each(|m| *m /= of.len().max(1) as f32);
        let apart = |i: &u32| -> f32 {
            let vector = &vectors[*i as usize * d..][..d];
            vector
                .iter()
                .zip(&mean)
                .map(|(v, m)| (v - m) * (v - m))
                .sum()
        };
        Self {
            count: of.len(),
            spread: of.iter().map(apart).sum(),
            mean,
        }
    }

    /// Brings those of one half before those of the other, and says how many they are: neither half is empty.
    fn divide(&self, vectors: &[f32], d: usize, own: &mut [u32]) -> usize {
        let along = |i: u32, direction: &[f32]| -> f32 {
            let vector = &vectors[i as usize * d..][..d];
            let offsets = vector.iter().zip(&self.mean).map(|(v, m)| v - m);
            offsets.zip(direction).map(|(v, w)| v * w).sum()
        };
        let step = own.len().div_ceil(SAMPLED);
        // The direction of most variance, by powers of the covariance.
        let mut direction: Vec<f32> = (0..d).map(|i| 1.0 + (i as f32).sin()).collect();
        for _ in 0..8 {
            let mut next = vec![0f32; d];
            for i in own.iter().step_by(step) {
                let weight = along(*i, &direction);
                let vector = &vectors[*i as usize * d..][..d];
                let offsets = vector.iter().zip(&self.mean).map(|(v, m)| v - m);
                next.iter_mut()
                    .zip(offsets)
                    .for_each(|(n, v)| *n += weight * v);
            }
            let length = next.iter().map(|v| v * v).sum::<f32>().sqrt();
            if length <= f32::MIN_POSITIVE {
                break;
            }
            next.iter_mut().for_each(|v| *v /= length);
            direction = next;
        }
        let mut keyed: Vec<(f32, u32)> = own.iter().map(|i| (along(*i, &direction), *i)).collect();
        keyed.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        own.iter_mut().zip(&keyed).for_each(|(o, (_, i))| *o = *i);
        let below = keyed.partition_point(|(key, _)| *key < 0.0);
        below.clamp(1, own.len() - 1)
    }
}
