//! Inter-object visibility: an object's own bake, with the other objects where rays hit them first.
//!
//! The directions are those of the object's own bake, so that where nothing stands in the way the light is the same to the bit: a ratio of
//! the two tells what the others change, and nothing else.

use std::sync::Arc;

use glam::{Affine3A, Vec3};
use rayon::prelude::*;

use super::directional::DirectionalBake;
use super::directional_visibility::{DirectionalVisibility, is_met_on_back, sees};
use super::strata::{DIRECTIONS, Hit, MOST_SURFELS, STRATA, WORDS, directions};
use super::trace::{MISS, PACKET, RayStart, RaySurfel, Stack, Tracer, by_neighborhood};
use crate::error::{Error, Result};
use crate::progress::Progress;

/// An object of a scene, as rays see it.
#[derive(Clone, Debug)]
pub struct PlacedObject {
    /// Visibility of the object alone.
    pub bake: Arc<DirectionalBake>,
    /// From its coordinates to the scene's: a turn, a move, and one scale for all axes.
    pub scene_from_object: Affine3A,
    /// Bake of the whole that it was cut out of.
    pub whole: Option<Arc<DirectionalBake>>,
}

impl PlacedObject {
    /// True where both are parts of one capture, which knows how they were lit side by side.
    pub fn is_of_capture_of(&self, other: &Self) -> bool {
        matches!((&self.whole, &other.whole), (Some(a), Some(b)) if Arc::ptr_eq(a, b))
    }

    /// True where the two stand as they were captured, so that surfaces may go from one to the other.
    fn is_one_body_with(&self, other: &Self) -> bool {
        self.is_of_capture_of(other) && self.scene_from_object == other.scene_from_object
    }

    fn scene_from_rays(&self) -> Affine3A {
        let tracer = &self.bake.tracer;
        let scale = Affine3A::from_scale(Vec3::splat(tracer.radius));
        self.scene_from_object * Affine3A::from_translation(tracer.center) * scale
    }
}

/// Another object, seen from one.
#[derive(Clone, Debug)]
struct Other {
    bake: Arc<DirectionalBake>,
    /// From the one's coordinates for rays to its own.
    other_from_own: Affine3A,
    /// Length of the one's unit in its own.
    scale: f32,
    /// A ball around all that casts a shadow, in its coordinates.
    ball: (Vec3, f32),
    /// Its first surfel among those of the scene.
    first: u32,
    /// True where a surfel's own layer stack may go on in it, see [`PlacedObject::is_one_body_with`].
    is_one_body: bool,
}

impl Other {
    /// The start of a ray of the one's surfel, both in their own coordinates.
    fn start(&self, surfel: &RaySurfel, direction: Vec3) -> RayStart {
        let start = surfel.start(direction);
        let own = if self.is_one_body { self.scale } else { 0.0 };
        RayStart {
            origin: self.other_from_own.transform_point3(start.origin),
            nearest: own * start.nearest,
            stack: own * start.stack,
        }
    }

    fn direction(&self, own: Vec3) -> Vec3 {
        self.other_from_own.transform_vector3(own) / self.scale
    }

    /// Hit of a ray towards a direction, both in its coordinates: the side that it comes from.
    fn hit(&self, stratum: usize, surfel: u32, toward: Vec3) -> Hit {
        let i = surfel as usize;
        let (normal, two_sided) = (self.bake.normals[i], self.bake.two_sided[i]);
        let on_back = is_met_on_back(normal, two_sided, toward);
        Hit::new(stratum, self.first + surfel).on(on_back)
    }

    /// True where a ray, in this object's coordinates, may hit it.
    fn is_near(&self, origin: Vec3, direction: Vec3) -> bool {
        self.is_within(self.ball.1, origin, direction)
    }

    /// True where any ray may hit it that starts in a ball of the one's coordinates.
    fn is_near_any(&self, (middle, radius): (Vec3, f32), direction: Vec3) -> bool {
        let origin = self.other_from_own.transform_point3(middle);
        self.is_within(self.ball.1 + self.scale * radius, origin, direction)
    }

    fn is_within(&self, radius: f32, origin: Vec3, direction: Vec3) -> bool {
        let middle = self.ball.0;
        let away = middle - origin;
        let (along, squared) = (away.dot(direction), away.length_squared());
        squared < radius * radius || along > 0.0 && squared - along * along < radius * radius
    }
}

/// Rows of what an object's surfels see that are still told apart where it is traced coarsely.
const COARSE_ROWS: usize = 5000;

/// Level of detail of a trace between objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Detail {
    /// Every surfel in every direction.
    Full,
    /// Some of the surfels, one direction of a patch: an answer while an object is moved.
    Coarse,
}

impl Detail {
    /// Number of directions that are traced, those that come first.
    fn directions(self) -> usize {
        match self {
            Self::Full => DIRECTIONS,
            Self::Coarse => STRATA,
        }
    }

    /// Number of neighbouring rows whose inter-object visibility is taken to be equal.
    fn rows_joined(self, rows: usize) -> usize {
        match self {
            Self::Full => 1,
            Self::Coarse => (rows / COARSE_ROWS).clamp(1, PACKET),
        }
    }
}

/// Inter-object visibility of an object's surfels in a scene.
#[derive(Clone, Debug)]
pub struct InterObjectVisibility {
    /// Directional visibility of each surfel; hits count the surfels of all objects of the scene.
    pub directional_visibility: DirectionalVisibility,
    /// The object's first surfel among those of the scene.
    pub first: usize,
    /// Number of surfels that see another object.
    pub changed: usize,
    others: Vec<Other>,
}

/// Change of a surfel's visibility where other objects are.
#[derive(Clone, Default)]
struct VisibilityChange {
    /// Directions that are not open any more.
    closed: [u64; WORDS],
    /// Hits that there are now.
    hits: Vec<Hit>,
}

impl InterObjectVisibility {
    /// Traces the rays of one of the objects of a scene that may meet another.
    ///
    /// # Errors
    /// The objects have more surfels than can be told apart, or [`Error::Cancelled`] when `progress` asked for it.
    pub fn trace(
        objects: &[PlacedObject],
        which: usize,
        detail: Detail,
        progress: Progress<'_>,
    ) -> Result<Self> {
        let own = &objects[which];
        let mut firsts = vec![0];
        for object in objects {
            firsts.push(firsts[firsts.len() - 1] + object.bake.len());
        }
        let total = firsts[objects.len()];
        if total > MOST_SURFELS {
            return Err(Error::Mismatch(format!(
                "{total} Gaussians in one scene; preset best can be baked for up to {MOST_SURFELS}"
            )));
        }
        let others: Vec<Other> = (0..objects.len())
            .filter(|o| *o != which && !objects[*o].bake.is_empty())
            .map(|o| {
                let other_from_own = objects[o].scene_from_rays().inverse() * own.scene_from_rays();
                Other {
                    bake: objects[o].bake.clone(),
                    scale: other_from_own.transform_vector3(Vec3::X).length(),
                    other_from_own,
                    ball: objects[o].bake.tracer.reach(),
                    first: firsts[o] as u32,
                    is_one_body: own.is_one_body_with(&objects[o]),
                }
            })
            .collect();
        let first = firsts[which];
        let changes = changes(&own.bake, &others, detail, progress)?;
        Ok(Self {
            changed: own
                .bake
                .directional_visibility
                .visibility_clusters
                .count(|row| changes[row].is_any()),
            directional_visibility: changed(&own.bake, first as u32, &changes),
            first,
            others,
        })
    }

    /// Surfels among the `asked` that see all the way out towards a direction. `[n]`, false for the others
    pub fn open_towards(
        &self,
        own: &Tracer,
        direction: Vec3,
        asked: impl Fn(u32) -> bool,
    ) -> Vec<bool> {
        let mut open = own.open_towards(direction, asked);
        for other in &self.others {
            let toward = other.direction(direction);
            let rays: Vec<(u32, RayStart)> = (own.order.iter().filter(|i| open[**i as usize]))
                .map(|i| (*i, other.start(&own.surfels[*i as usize], direction)))
                .filter(|(_, start)| other.is_near(start.origin, toward))
                .collect();
            let blocked = rays.par_chunks(PACKET).map_init(Vec::new, |stack, rays| {
                let starts: Vec<RayStart> = rays.iter().map(|(_, start)| *start).collect();
                let met = other.bake.tracer.met_from(&starts, toward, true, stack);
                met.surfel.map(|s| s != MISS)
            });
            let blocked: Vec<_> = blocked.collect();
            for (rays, blocked) in rays.chunks(PACKET).zip(blocked) {
                for ((i, _), blocked) in rays.iter().zip(blocked) {
                    open[*i as usize] &= !blocked;
                }
            }
        }
        open
    }

    /// Closes, of rays of the object's surfels `of` to places at some distance, those that another object blocks; [`PACKET`] at most, in
    /// the object's coordinates for rays.
    pub fn unblocked(
        &self,
        own: &Tracer,
        of: &[u32],
        rays: &[(RayStart, Vec3, f32)],
        open: &mut [bool; PACKET],
        stack: &mut Stack,
    ) {
        for other in &self.others {
            let mut asked = Vec::new();
            let mut there = Vec::new();
            for (k, ((_, direction, distance), i)) in rays.iter().zip(of).enumerate() {
                let start = other.start(&own.surfels[*i as usize], *direction);
                let toward = other.direction(*direction);
                if open[k] && other.is_near(start.origin, toward) {
                    asked.push(k);
                    there.push((start, toward, distance * other.scale));
                }
            }
            let unblocked = other.bake.tracer.unblocked(&there, stack);
            for (k, is_open) in asked.into_iter().zip(unblocked) {
                open[k] &= is_open;
            }
        }
    }
}

impl InterObjectVisibility {
    /// Light that the other objects leave along a shadow ray of a surfel, 0 to 1: in a direction (a unit vector) up to a distance, in the object's
    /// coordinates for rays.
    pub fn transmittance(
        &self,
        surfel: &RaySurfel,
        direction: Vec3,
        end: f32,
        stack: &mut Stack,
    ) -> f32 {
        let each = self.others.iter().map(|other| {
            let start = other.start(surfel, direction);
            let toward = other.direction(direction);
            if !other.is_near(start.origin, toward) {
                return 1.0;
            }
            let end = end * other.scale;
            other.bake.tracer.transmittance(start, toward, end, stack)
        });
        each.product()
    }
}

impl VisibilityChange {
    /// Closes a direction, unless the surfel's own object does so.
    fn close(&mut self, j: usize, was_open: bool) {
        self.closed[j / 64] |= u64::from(was_open) << (j % 64);
    }

    /// Fills all directions from those that were traced.
    fn in_detail(mut self, detail: Detail) -> Self {
        for j in detail.directions()..DIRECTIONS {
            let first = j % STRATA;
            let closed = self.closed[first / 64] >> (first % 64) & 1 == 1;
            self.close(j, closed);
        }
        self
    }

    fn is_any(&self) -> bool {
        !self.hits.is_empty() || self.closed.iter().any(|c| *c != 0)
    }
}

/// Changes by other objects, for each row of visibility. `[rows]`
fn changes(
    own: &DirectionalBake,
    others: &[Other],
    detail: Detail,
    progress: Progress<'_>,
) -> Result<Vec<VisibilityChange>> {
    let directions = directions();
    let leaders = &own.directional_visibility.visibility_clusters.leaders;
    let mut rows: Vec<(u32, VisibilityChange)> = leaders
        .iter()
        .map(|i| (*i, VisibilityChange::default()))
        .collect();
    let each = detail.rows_joined(rows.len());
    by_neighborhood(&mut rows, progress, |rows| {
        let of: Vec<u32> = rows.iter().step_by(each).map(|(i, _)| *i).collect();
        let found = neighborhood(own, others, &directions[..detail.directions()], &of);
        for (rows, found) in rows.chunks_mut(each).zip(found) {
            let found = found.in_detail(detail);
            rows.iter_mut()
                .for_each(|(_, change)| *change = found.clone());
        }
    })?;
    Ok(rows.into_iter().map(|(_, change)| change).collect())
}

/// Changes of neighbouring surfels, in some of the directions.
fn neighborhood(
    own: &DirectionalBake,
    others: &[Other],
    directions: &[Vec3],
    of: &[u32],
) -> Vec<VisibilityChange> {
    let mut stack = Vec::new();
    let mut changes = vec![VisibilityChange::default(); of.len()];
    // Patches whose first ray meets the object itself.
    let strata = |i: &u32| {
        let hits = own.directional_visibility.hits_of(*i as usize).iter();
        hits.fold(0u128, |all, h| all | 1 << h.stratum())
    };
    let meet_itself: Vec<u128> = of.iter().map(strata).collect();
    let starts = own.tracer.ball_of_starts(of);
    for (j, direction) in directions.iter().enumerate() {
        let stratum = (j < STRATA).then_some(j);
        // Where the object itself is met it may be behind another one; only a patch's first ray knows.
        let meets_itself = |lane: usize| stratum.is_some_and(|p| meet_itself[lane] >> p & 1 == 1);
        let mut nearest: Vec<Option<(f32, Hit)>> = vec![None; of.len()];
        for other in others {
            let toward = other.direction(*direction);
            if !other.is_near_any(starts, toward) {
                continue;
            }
            let rays: Vec<(usize, RayStart)> = (of.iter().map(|i| *i as usize).enumerate())
                .filter(|(lane, i)| {
                    own.directional_visibility.is_open(*i, j) || meets_itself(*lane)
                })
                .map(|(lane, i)| (lane, other.start(&own.tracer.surfels[i], *direction)))
                .filter(|(_, start)| other.is_near(start.origin, toward))
                .collect();
            for rays in rays.chunks(PACKET) {
                let starts: Vec<RayStart> = rays.iter().map(|(_, start)| *start).collect();
                let tracer = &other.bake.tracer;
                let met = tracer.met_from(&starts, toward, stratum.is_none(), &mut stack);
                for ((lane, _), (surfel, distance)) in rays.iter().zip(met.each()) {
                    if surfel == MISS {
                        continue;
                    }
                    changes[*lane].close(j, !meets_itself(*lane));
                    let distance = distance / other.scale;
                    if nearest[*lane].is_none_or(|(before, _)| distance < before) {
                        let hit = other.hit(stratum.unwrap_or_default(), surfel, toward);
                        nearest[*lane] = Some((distance, hit));
                    }
                }
            }
        }
        if stratum.is_none() {
            continue;
        }
        let in_doubt: Vec<usize> = (0..of.len())
            .filter(|lane| nearest[*lane].is_some() && meets_itself(*lane))
            .collect();
        for lanes in in_doubt.chunks(PACKET) {
            let asked: Vec<u32> = lanes.iter().map(|lane| of[*lane]).collect();
            let met = own.tracer.met(&asked, *direction, &mut stack);
            for (lane, (surfel, distance)) in lanes.iter().zip(met.each()) {
                if surfel != MISS && nearest[*lane].is_some_and(|(other, _)| distance < other) {
                    nearest[*lane] = None;
                }
            }
        }
        for (change, nearest) in changes.iter_mut().zip(nearest) {
            change.hits.extend(nearest.map(|(_, hit)| hit));
        }
    }
    changes
}

/// Visibility of the surfels with these changes, `[rows]`.
fn changed(
    own: &DirectionalBake,
    first: u32,
    changes: &[VisibilityChange],
) -> DirectionalVisibility {
    let directions = directions();
    let visibility_clusters = &own.directional_visibility.visibility_clusters;
    let of_row = |(row, change): (usize, &VisibilityChange)| {
        let i = visibility_clusters.leaders[row] as usize;
        let mut open = own.directional_visibility.open[row];
        for (word, closed) in open.iter_mut().zip(change.closed) {
            *word &= !closed;
        }
        let itself = own.directional_visibility.hits_of(i).iter();
        if change.hits.is_empty() {
            return (open, itself.map(|hit| hit.counted_from(first)).collect());
        }
        let behind = change
            .hits
            .iter()
            .fold(0u128, |all, h| all | 1 << h.stratum());
        let itself = itself.filter(|h| behind >> h.stratum() & 1 == 0);
        let mut hits: Vec<Hit> = itself.map(|hit| hit.counted_from(first)).collect();
        let (normal, two_sided) = (own.normals[i], own.two_sided[i]);
        let counts = |hit: &&Hit| sees(normal, two_sided, directions[hit.stratum()]);
        hits.extend(change.hits.iter().filter(counts));
        hits.sort_unstable_by_key(|h: &Hit| h.stratum());
        (open, hits)
    };
    let each = changes.par_iter().enumerate().map(of_row);
    let (open, of_each): (Vec<_>, Vec<Vec<Hit>>) = each.unzip();
    let mut starts = vec![0u32];
    starts.extend(of_each.iter().scan(0, |sum, hits| {
        *sum += hits.len() as u32;
        Some(*sum)
    }));
    DirectionalVisibility {
        visibility_clusters: visibility_clusters.clone(),
        open,
        starts,
        hits: of_each.concat(),
    }
}

#[cfg(test)]
mod tests;
