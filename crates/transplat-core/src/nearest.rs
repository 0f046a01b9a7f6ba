//! Nearest neighbours of points among themselves.

use std::num::NonZeroUsize;

use kiddo::{ImmutableKdTree, SquaredEuclidean};
use rayon::prelude::*;

/// The `count` points that are nearest to each of some places, `[places][count]`: there must be so many.
pub(crate) fn nearest_to<const D: usize>(
    points: &[[f32; D]],
    places: &[[f32; D]],
    count: usize,
) -> Vec<u32> {
    let (Some(count), Ok(tree)) = (
        NonZeroUsize::new(count),
        ImmutableKdTree::<f32, D>::new_from_slice(points),
    ) else {
        return Vec::new();
    };
    let near = |place: &[f32; D]| -> Vec<u32> {
        let nearest = tree.query(place).nearest_n::<SquaredEuclidean<f32>>(count);
        nearest.execute().into_iter().map(|f| f.item).collect()
    };
    places.par_iter().flat_map_iter(near).collect()
}

/// The points nearest to each, itself left out.
#[derive(Clone, Debug)]
pub(crate) struct Nearest {
    /// `[n][each]`
    pub all: Vec<u32>,
    /// How many a point has: fewer than asked for where there are not so many.
    pub each: usize,
}

impl Nearest {
    /// `count` neighbours of each point.
    pub fn new<const D: usize>(points: &[[f32; D]], count: usize) -> Self {
        let each = count.min(points.len().saturating_sub(1));
        let (Some(wanted), Ok(tree)) = (
            NonZeroUsize::new(each + 1).filter(|_| each > 0),
            ImmutableKdTree::<f32, D>::new_from_slice(points),
        ) else {
            return Self {
                all: Vec::new(),
                each: 0,
            };
        };
        let near = |(i, p): (usize, &[f32; D])| -> Vec<u32> {
            let nearest = tree.query(p).nearest_n::<SquaredEuclidean<f32>>(wanted);
            let found = nearest.execute().into_iter().map(|f| f.item);
            found.filter(|j| *j as usize != i).take(each).collect()
        };
        Self {
            all: points.par_iter().enumerate().flat_map_iter(near).collect(),
            each,
        }
    }

    /// Those of point `i`.
    pub fn of(&self, i: usize) -> impl Iterator<Item = usize> + '_ {
        let range = i * self.each..(i + 1) * self.each;
        self.all[range].iter().map(|j| *j as usize)
    }
}
