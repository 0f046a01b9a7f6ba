//! Nearest neighbours of points among themselves.

use std::num::NonZeroUsize;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

/// The `count` points that are nearest to each of some places, `[places]`; none where points cannot be told apart.
pub(crate) fn nearest_to<const D: usize>(
    points: &[[f32; D]],
    places: &[[f32; D]],
    count: usize,
) -> Vec<Vec<u32>> {
    let (Some(count), Ok(tree)) = (
        NonZeroUsize::new(count),
        ImmutableKdTree::<f32, D>::new_from_slice(points),
    ) else {
        return vec![Vec::new(); places.len()];
    };
    let near = |place: &[f32; D]| {
        let nearest = tree.query(place).nearest_n::<SquaredEuclidean<f32>>(count);
        nearest.execute().into_iter().map(|f| f.item).collect()
    };
    places.par_iter().map(near).collect()
}

/// Points that lie together, at most `most` each: halved across where they reach farthest, until they are so few.
pub(crate) fn grouped<'a, const D: usize>(
    points: &[[f32; D]],
    of: &'a mut [u32],
    most: usize,
) -> Vec<&'a [u32]> {
    if of.len() <= most.max(1) {
        return vec![of];
    }
    let reach = |axis: usize| {
        let each = of.iter().map(|i| points[*i as usize][axis]);
        let (low, high) = each.fold((f32::MAX, f32::MIN), |(a, b), x| (a.min(x), b.max(x)));
        high - low
    };
    let reaches: [f32; D] = std::array::from_fn(reach);
    let widest = (0..D).max_by(|a, b| reaches[*a].total_cmp(&reaches[*b]));
    let axis = widest.unwrap_or_default();
    let along = |i: &u32| points[*i as usize][axis];
    let half = of.len() / 2;
    of.select_nth_unstable_by(half, |a, b| along(a).total_cmp(&along(b)));
    let (low, high) = of.split_at_mut(half);
    let (mut low, high) = rayon::join(
        || grouped(points, low, most),
        || grouped(points, high, most),
    );
    low.extend(high);
    low
}

/// The points nearest to each, itself left out.
#[derive(Clone, Debug)]
pub(crate) struct Nearest {
    /// `[n][each]`
    pub all: Vec<u32>,
    /// Neighbours of a point: fewer than requested where there are not so many.
    pub each: usize,
}

impl Nearest {
    /// `count` neighbours of each point.
    pub fn new<const D: usize>(points: &[[f32; D]], count: usize) -> Self {
        let each = count.min(points.len().saturating_sub(1));
        let (Some(asked), Ok(tree)) = (
            NonZeroUsize::new(each + 1).filter(|_| each > 0),
            ImmutableKdTree::<f32, D>::new_from_slice(points),
        ) else {
            return Self {
                each: 0,
                all: Vec::new(),
            };
        };
        let mut all = vec![0; each * points.len()];
        let places = points.par_iter().enumerate();
        places
            .zip(all.par_chunks_exact_mut(each))
            .for_each(|((i, place), out)| {
                let nearest = tree.query(place).nearest_n::<SquaredEuclidean<f32>>(asked);
                let found = nearest.execute().into_iter().map(|f| f.item);
                let others = found.filter(|j| *j as usize != i);
                out.iter_mut()
                    .zip(others)
                    .for_each(|(out, other)| *out = other);
            });
        Self { each, all }
    }

    /// Neighbours of point `i`.
    pub fn of(&self, i: usize) -> impl Iterator<Item = usize> + '_ {
        let range = i * self.each..(i + 1) * self.each;
        self.all[range].iter().map(|j| *j as usize)
    }
}
