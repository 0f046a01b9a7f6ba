//! Inferred visibility: where the nearest rays agree, a direction takes their answer without a ray.

use glam::Vec3;

use super::strata::{DIRECTIONS, STRATA, WORDS};
use crate::sh::refining_order;

/// Surfels from which on that is done.
const MANY: usize = 1 << 17;

/// So many of the nearest directions have to agree.
const NEAREST: usize = 3;

/// Error of the relit colour of single surfels (relative L2) by inferred visibility: at most that on five objects of 70,000 to 240,000 surfels under
/// five lights, a plant under lamps; a quarter of it on most.
pub const INFERRED_ERROR: f32 = 0.05;

/// Directions whose visibility is inferred from others.
pub(super) struct InferredVisibility {
    /// The nearest ones to each direction, as bits; none where it is traced in any case. `[DIRECTIONS]`
    nearest: Vec<Option<[u64; WORDS]>>,
}

impl InferredVisibility {
    /// Inference for so many surfels and the rays of some patches, which follow in [`refining_order`] on others that are done. Traced in any case are
    /// the patches' first directions, and those with a nearest one that is not known by then.
    pub fn of(directions: &[Vec3], strata: &[usize], surfels: usize) -> Self {
        if surfels < MANY {
            return Self::none();
        }
        Self::of_many(directions, strata)
    }

    /// No direction tells of another.
    pub fn none() -> Self {
        Self {
            nearest: vec![None; DIRECTIONS],
        }
    }

    /// Inference as for very many surfels.
    pub fn of_many(directions: &[Vec3], strata: &[usize]) -> Self {
        let order = refining_order(STRATA);
        let last = order.iter().position(|p| strata.last() == Some(p));
        let done = &order[..last.map_or(0, |last| last + 1)];
        let nearest = |j: usize| {
            // The places before, which are known by then.
            let mut near: Vec<usize> = (0..j / STRATA * STRATA).collect();
            let cosine = |k: &usize| directions[*k].dot(directions[j]);
            near.sort_by(|a, b| cosine(b).total_cmp(&cosine(a)));
            let near = near.get(..NEAREST)?;
            let are_done = near.iter().all(|k| done.contains(&(k % STRATA)));
            are_done.then(|| {
                let mut mask = [0; WORDS];
                near.iter().for_each(|k| mask[k / 64] |= 1 << (k % 64));
                mask
            })
        };
        Self {
            nearest: (0..DIRECTIONS).map(nearest).collect(),
        }
    }

    /// Visibility of a direction, where the nearest ones agree.
    #[inline(always)]
    pub fn tells(&self, j: usize, open: &[u64; WORDS]) -> Option<bool> {
        let mask = self.nearest[j].as_ref()?;
        let is = |of: fn(u64) -> u64| (open.iter().zip(mask)).all(|(o, m)| of(*o) & m == 0);
        if is(|o| o) {
            return Some(false);
        }
        is(|o| !o).then_some(true)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::directional::DirectionalBake;
    use crate::bake::strata::directions;
    use crate::synthetic;

    #[test]
    fn a_third_of_the_rays_is_told_by_others_and_nearly_all_of_that_is_so() {
        let cloud = synthetic::sphere_over_plate(3000);
        let (exact, told) = [false, true]
            .map(|is| DirectionalBake::traced(&cloud, is))
            .into();
        assert_eq!(exact.inferred_share, 0.0);
        assert!(told.inferred_share > 0.3, "{}", told.inferred_share);
        let (mut off, mut seen) = (0f32, 0f32);
        for i in 0..cloud.len() {
            for (j, d) in directions().iter().enumerate() {
                let cosine = exact.normals[i].dot(*d).max(0.0);
                let open = exact.directional_visibility.is_open(i, j);
                seen += cosine * f32::from(u8::from(open));
                off +=
                    cosine * f32::from(u8::from(open != told.directional_visibility.is_open(i, j)));
            }
        }
        // Rims of what blocks may pass between three rays that agree, and nothing else may be told wrongly.
        assert!(off < 0.01 * seen, "{off} of {seen}");
    }

    #[test]
    fn of_few_surfels_every_ray_is_traced_and_of_many_the_first_of_each_patch() {
        let (directions, order) = (directions(), refining_order(STRATA));
        let known = |inferred_visibility: &InferredVisibility, j| {
            inferred_visibility.tells(j, &[0; WORDS]).is_some()
        };
        let few = InferredVisibility::of(&directions, &order, MANY - 1);
        assert!((0..DIRECTIONS).all(|j| !known(&few, j)));
        let many = InferredVisibility::of(&directions, &order, MANY);
        assert!((0..DIRECTIONS).all(|j| known(&many, j) == (j >= STRATA)));
        // Of some patches alone, those whose surroundings are not traced yet.
        let some = InferredVisibility::of(&directions, &order[..STRATA / 2], MANY);
        let told = (STRATA..DIRECTIONS).filter(|j| known(&some, *j)).count();
        assert!(told < STRATA / 2, "{told}");
        assert_eq!(many.tells(STRATA, &[u64::MAX; WORDS]), Some(true));
        assert_eq!(many.tells(STRATA, &[0; WORDS]), Some(false));
        assert_eq!(many.tells(STRATA, &[0x5555_5555_5555_5555; WORDS]), None);
    }
}
