//! The bake of the directional method: for every surfel and direction whether a ray leaves the object, and for some of the directions which
//! surfel it meets instead. Rays start on the side of the surfel that the direction is on, so one bit serves both sides.

use std::sync::Arc;

use glam::Vec3;
use rayon::prelude::*;

use super::directional_visibility::{
    DirectionalVisibility, is_met_on_back, is_open, openness, sees,
};
use super::inferred_visibility::InferredVisibility;
use super::open_object::OpenObject;
use super::outward_side::{OutwardSide, OutwardSides};
use super::strata::{DIRECTIONS, Hit, MOST_SURFELS, PER_STRATUM, STRATA, SurfelHits, directions};
use super::trace::{MISS, PACKET, RaySurfel, Tracer, by_neighborhood};
use super::visibility_clusters::VisibilityClusters;
use crate::error::{Error, Result};
use crate::numeric::{smoothstep, weighted_quantile};
use crate::progress::Progress;
use crate::settings::optimizations::{Optimization, Optimizations};
use crate::sh::refining_order;
use crate::surfels::SurfelCloud;

/// Patches that are traced before it is asked which sides need the others.
const PROBES: usize = 16;

/// A back that is less open than this towards the probed patches is closed: nowhere near two-sided (see [`TWO_SIDED`]).
const CLOSED: f32 = 0.02;

/// Share of a bake that finding the fronts takes, for its progress.
const FRONTS_SHARE: f64 = 0.2;

/// Share of the rest that finds visibility clusters.
const SHARING_SHARE: f64 = 0.1;

/// Error of the relit colour (relative L2) by closed sides: at most that on eight objects, a plant of single sheets being the worst; on solid ones a
/// fifth of that and less.
pub const CLOSED_SIDES_ERROR: f32 = 3e-3;

/// Openness of a surfel's back at which it begins to be two-sided, and at which it wholly is: at the edge of a closed object
/// a few rays pass behind.
pub const TWO_SIDED: [f32; 2] = [0.08, 0.38];

/// Visibility of a splat for the directional method.
#[derive(Clone, Debug)]
pub struct DirectionalBake {
    /// Directional visibility of each surfel.
    pub directional_visibility: DirectionalVisibility,
    /// Unit normals of the surface, towards the front. `[n]`
    pub normals: Vec<Vec3>,
    /// Visible weight of each surfel, sums to 1. `[n]`
    pub visible_weight: Vec<f32>,
    /// Share of what is seen that is ambiguous, 0 to 1: [`DirectionalBake::is_ambiguous`].
    pub ambiguous_share: f32,
    /// Angle between a surfel's own normal and that of the surface that it is part of, in degrees: half of what is seen is below it. 0 of no
    /// surfel.
    pub normal_noise: f32,
    /// Degree to which a surfel is two-sided, 0 to 1. `[n]`
    pub two_sided: Vec<f32>,
    /// Number of stored normals that pointed to the back.
    pub flipped: usize,
    /// Surfels that are closed on both sides.
    pub buried: usize,
    /// The rays' way through the asset, for suns.
    pub tracer: Arc<Tracer>,
    /// Where nothing was traced, since nothing blocks anything: [`OpenObject::mean_error`].
    pub open_object_error: Option<f32>,
    /// Share of the rays that were not traced, since they go into closed sides.
    pub closed_share: f32,
    /// Share of rays whose visibility is inferred.
    pub inferred_share: f32,
}

impl DirectionalBake {
    /// Traces all rays.
    ///
    /// # Errors
    /// The asset is too large, or [`Error::Cancelled`] when `progress` asked for it.
    pub fn bake(cloud: &SurfelCloud, progress: Progress<'_>) -> Result<Self> {
        Self::bake_in_stages(
            cloud,
            (&[1], &Optimizations::default()),
            progress,
            |_, _| (),
        )
    }

    /// Bakes in stages: after each share of the patches (one in so many, the last of them 1), `preview` gets what there is, with the rest as the
    /// nearest patch has it, and the share that is done.
    ///
    /// # Errors
    /// As [`DirectionalBake::bake`].
    pub fn bake_in_stages(
        cloud: &SurfelCloud,
        stages: (&[usize], &Optimizations),
        progress: Progress<'_>,
        preview: impl Fn(Self, f32),
    ) -> Result<Self> {
        let tracer = Self::tracer(cloud, progress)?;
        Self::bake_through(cloud, &tracer, stages, progress, preview)
    }

    /// Bakes with a tracer that is built already.
    ///
    /// # Errors
    /// [`Error::Cancelled`] when `progress` asked for it.
    pub fn bake_through(
        cloud: &SurfelCloud,
        tracer: &Arc<Tracer>,
        stages: (&[usize], &Optimizations),
        progress: Progress<'_>,
        preview: impl Fn(Self, f32),
    ) -> Result<Self> {
        let directions = directions();
        let (_, optimizations) = stages;
        let by = |strata: &[usize], found: &mut [SurfelHits], progress: Progress<'_>| {
            let inferred_visibility = match optimizations.has(Optimization::InferredRays) {
                true => InferredVisibility::of(&directions, strata, tracer.surfels.len()),
                false => InferredVisibility::none(),
            };
            trace(
                tracer,
                (&directions, &inferred_visibility),
                strata,
                found,
                progress,
            )
        };
        Self::bake_by(cloud, tracer, stages, by, progress, preview)
    }

    /// By rays all over, also where a ball needs none and into sides that are closed.
    #[cfg(test)]
    pub(crate) fn all_rays(cloud: &SurfelCloud) -> Self {
        let all = (&[1][..], &Optimizations::NONE);
        let no_progress = &crate::progress::no_progress;
        Self::bake_in_stages(cloud, all, no_progress, |_, _| ()).expect("not cancelled")
    }

    /// By rays all over, of which so many surfels at most share those of one.
    #[cfg(test)]
    pub(crate) fn shared(cloud: &SurfelCloud, together: usize) -> Self {
        let no_progress = &crate::progress::no_progress;
        let tracer = Self::tracer(cloud, no_progress).expect("not cancelled");
        let (directions, strata) = (directions(), refining_order(STRATA));
        let asked: Vec<Vec3> = strata[..PROBES].iter().map(|p| directions[*p]).collect();
        let visibility_clusters = VisibilityClusters::find(&tracer, &asked, together, no_progress);
        Self::traced_by(
            cloud,
            &tracer,
            visibility_clusters.expect("not cancelled"),
            false,
        )
    }

    /// By rays all over, or without those that others tell of.
    #[cfg(test)]
    pub(crate) fn traced(cloud: &SurfelCloud, are_inferred: bool) -> Self {
        let tracer = Self::tracer(cloud, &crate::progress::no_progress).expect("not cancelled");
        let own = VisibilityClusters::each_own(&tracer.order);
        Self::traced_by(cloud, &tracer, own, are_inferred)
    }

    #[cfg(test)]
    fn traced_by(
        cloud: &SurfelCloud,
        tracer: &Arc<Tracer>,
        visibility_clusters: VisibilityClusters,
        are_inferred: bool,
    ) -> Self {
        let (directions, strata) = (directions(), refining_order(STRATA));
        let inferred_visibility = match are_inferred {
            true => InferredVisibility::of_many(&directions, &strata),
            false => InferredVisibility::none(),
        };
        let mut found: Vec<SurfelHits> = visibility_clusters
            .leaders
            .iter()
            .map(|i| SurfelHits::of(*i))
            .collect();
        let rays = (&directions[..], &inferred_visibility);
        let no_progress = &crate::progress::no_progress;
        trace(tracer, rays, &strata, &mut found, no_progress).expect("not cancelled");
        Self::of(cloud, tracer, &Arc::new(visibility_clusters), &found)
    }

    /// What the rays are traced through: the beginning of a bake.
    ///
    /// # Errors
    /// The asset is too large, or [`Error::Cancelled`] when `progress` asked for it.
    pub fn tracer(cloud: &SurfelCloud, progress: Progress<'_>) -> Result<Arc<Tracer>> {
        if cloud.len() > MOST_SURFELS {
            return Err(Error::Mismatch(format!(
                "{} surfels; preset best can be baked for up to {MOST_SURFELS}",
                cloud.len()
            )));
        }
        let outward_sides = OutwardSides::find(cloud, &|p| progress(FRONTS_SHARE * p))?;
        Ok(Arc::new(Tracer::new(cloud, outward_sides)))
    }

    /// The same for a part of the surfels: which side is the front is told by the whole, since a cut opens what was closed.
    pub fn tracer_of_part(&self, part: &SurfelCloud, surfels: &[usize]) -> Arc<Tracer> {
        let outward_sides = self.tracer.outward_sides.selected(surfels);
        Arc::new(Tracer::new(part, outward_sides))
    }

    /// What a part of the surfels sees, traced without the others: a back that was closed when they were captured has no colour that any light
    /// could change, open as it may be now.
    pub fn as_part_of(mut self, whole: &Self, surfels: &[usize]) -> Self {
        let directions = directions();
        let two_sided: Vec<f32> = surfels.iter().map(|i| whole.two_sided[*i]).collect();
        let DirectionalVisibility {
            visibility_clusters,
            starts,
            hits,
            ..
        } = &mut self.directional_visibility;
        let (mut new_starts, mut new_hits) = (vec![0u32], Vec::with_capacity(hits.len()));
        for (i, range) in visibility_clusters.leaders.iter().zip(starts.windows(2)) {
            let i = *i as usize;
            let toward = |hit: &Hit| directions[hit.stratum()];
            let counts = |hit: &&Hit| sees(self.normals[i], two_sided[i], toward(hit));
            let of_surfel = hits[range[0] as usize..range[1] as usize].iter();
            new_hits.extend(of_surfel.filter(counts).map(|hit| {
                let met = hit.surfel();
                hit.on(is_met_on_back(
                    self.normals[met],
                    two_sided[met],
                    toward(hit),
                ))
            }));
            new_starts.push(new_hits.len() as u32);
        }
        (*starts, *hits) = (new_starts, new_hits);
        self.two_sided = two_sided;
        self.ambiguous_share = (0..self.len())
            .filter(|i| self.is_ambiguous(*i))
            .fold(0.0, |share, i| share + self.visible_weight[i]);
        self
    }

    /// The same, the rays traced by `trace`: it gets some patches, and adds to what some surfels found, of which neighbours follow each other.
    ///
    /// # Errors
    /// `trace` failed, or [`Error::Cancelled`] when `progress` asked for it.
    pub fn bake_by<E: From<Error>>(
        cloud: &SurfelCloud,
        tracer: &Arc<Tracer>,
        (stages, optimizations): (&[usize], &Optimizations),
        trace: impl Fn(&[usize], &mut [SurfelHits], Progress<'_>) -> Result<(), E>,
        progress: Progress<'_>,
        preview: impl Fn(Self, f32),
    ) -> Result<Self, E> {
        let progress = |p: f64| progress(FRONTS_SHARE + (1.0 - FRONTS_SHARE) * p);
        if progress(0.0).is_break() {
            return Err(Error::Cancelled.into());
        }
        if optimizations.has(Optimization::OpenObject)
            && let Some(open) = OpenObject::probe(tracer)
        {
            let visibility_clusters = Arc::new(VisibilityClusters::each_own(&tracer.order));
            return Ok(Self {
                open_object_error: Some(open.mean_error),
                ..Self::of(
                    cloud,
                    tracer,
                    &visibility_clusters,
                    &open.found(&tracer.order),
                )
            });
        }
        let directions = directions();
        let strata = refining_order(STRATA);
        let together = VisibilityClusters::together(cloud.len());
        let visibility_clusters = if together > 1
            && optimizations.has(Optimization::SharedVisibility)
        {
            let asked = strata[..PROBES].iter().map(|p| directions[*p]);
            let asked: Vec<Vec3> = asked.collect();
            VisibilityClusters::find(tracer, &asked, together, &|p| progress(SHARING_SHARE * p))?
        } else {
            VisibilityClusters::each_own(&tracer.order)
        };
        let (visibility_clusters, progress) = (Arc::new(visibility_clusters), |p: f64| {
            progress(SHARING_SHARE + (1.0 - SHARING_SHARE) * p)
        });
        let is_closed =
            |f: &OutwardSide| optimizations.has(Optimization::ClosedSides) && f.hides_its_back();
        let begin = |i: &u32| SurfelHits {
            back_is_closed: is_closed(&tracer.outward_sides.of[*i as usize]),
            ..SurfelHits::of(*i)
        };
        let mut found: Vec<SurfelHits> = visibility_clusters.leaders.iter().map(begin).collect();
        let mut done = 0;
        let mut ends: Vec<usize> = stages.iter().map(|s| STRATA.div_ceil(*s)).collect();
        let shown = ends.clone();
        if optimizations.has(Optimization::ClosedSides) {
            ends.push(PROBES);
            ends.sort_unstable();
            ends.dedup();
        }
        for end in ends {
            let part = &strata[done..end];
            let within = |p: f64| progress((done as f64 + p * part.len() as f64) / STRATA as f64);
            trace(part, &mut found, &within)?;
            done = end;
            if done == PROBES && optimizations.has(Optimization::ClosedSides) {
                close_backs(tracer, &directions, &strata[..done], &mut found);
            }
            if done < STRATA && shown.contains(&done) {
                let mut filled = found.clone();
                fill_unfinished_strata(&directions, &strata[..done], &mut filled);
                let share = done as f32 / STRATA as f32;
                preview(
                    Self::of(cloud, tracer, &visibility_clusters, &filled),
                    share,
                );
            }
        }
        Ok(Self::of(cloud, tracer, &visibility_clusters, &found))
    }

    /// From what the rays of the leaders found, `[rows]`.
    pub(crate) fn of(
        cloud: &SurfelCloud,
        tracer: &Arc<Tracer>,
        visibility_clusters: &Arc<VisibilityClusters>,
        found: &[SurfelHits],
    ) -> Self {
        let directions = &directions();
        let normals: Vec<Vec3> = (tracer.outward_sides.of.iter())
            .map(|f| f.surface_normal())
            .collect();
        // Front and back by the leader's own normal, and both together by its surface's.
        let open: Vec<([f32; 2], f32)> = (found.par_iter())
            .map(|f| {
                let i = f.surfel as usize;
                let own = openness(&f.open, directions, tracer.surfels[i].normal);
                let all = openness(&f.open, directions, normals[i]).iter().sum();
                (own, all)
            })
            .collect();
        let of_rows: Vec<f32> = (open.iter())
            .map(|([_, back], _)| smoothstep(TWO_SIDED[0], TWO_SIDED[1], *back))
            .collect();
        let two_sided = visibility_clusters.spread(&of_rows);
        let visible_weight = tracer.outward_sides.visible_weight(cloud);
        let (mut starts, mut hits) = (vec![0u32], Vec::new());
        for (f, two) in found.iter().zip(&of_rows) {
            let n = normals[f.surfel as usize];
            let toward = |hit: &Hit| directions[hit.stratum()];
            let from_its_side = |hit: &Hit| {
                let met = hit.surfel();
                hit.on(is_met_on_back(normals[met], two_sided[met], toward(hit)))
            };
            let from = hits.len();
            let counts = |h: &&Hit| sees(n, *two, toward(h));
            hits.extend(f.hits.iter().filter(counts).map(from_its_side));
            hits[from..].sort_unstable_by_key(|h: &Hit| h.stratum());
            starts.push(hits.len() as u32);
        }
        hits.shrink_to_fit();
        Self {
            flipped: (tracer.outward_sides.of.iter())
                .filter(|f| f.is_turned())
                .count(),
            buried: visibility_clusters.count(|row| open[row].1 < 0.02),
            ambiguous_share: (0..normals.len())
                .filter(|i| is_ambiguous(&tracer.outward_sides.of[*i], two_sided[*i]))
                .fold(0.0, |share, i| share + visible_weight[i]),
            normal_noise: normal_noise(tracer, &normals, &visible_weight),
            visible_weight,
            closed_share: closed_share(tracer, directions, found),
            inferred_share: {
                let told: usize = found.iter().map(|f| usize::from(f.told)).sum();
                told as f32 / (found.len() * DIRECTIONS).max(1) as f32
            },
            normals,
            two_sided,
            directional_visibility: DirectionalVisibility {
                visibility_clusters: visibility_clusters.clone(),
                open: found.iter().map(|f| f.open).collect(),
                starts,
                hits,
            },
            tracer: tracer.clone(),
            open_object_error: None,
        }
    }

    /// Whether it is little better than a guess which side of surfel `i` is its front, and matters: of a leaf both are lit.
    pub fn is_ambiguous(&self, i: usize) -> bool {
        is_ambiguous(&self.tracer.outward_sides.of[i], self.two_sided[i])
    }

    /// Number of surfels.
    pub fn len(&self) -> usize {
        self.normals.len()
    }

    /// Whether there is no surfel.
    pub fn is_empty(&self) -> bool {
        self.normals.is_empty()
    }

    /// Cosine-weighted share of the front side's hemisphere that is open, `[n]`, 0 to 1: ambient occlusion.
    pub fn openness(&self) -> Vec<f32> {
        self.directional_visibility.openness(&self.normals)
    }
}

fn normal_noise(tracer: &Tracer, normals: &[Vec3], visible_weight: &[f32]) -> f32 {
    let off = |(surfel, n): (&RaySurfel, &Vec3)| f64::from(surfel.normal.angle_between(*n));
    let weights = visible_weight.iter().map(|p| f64::from(*p));
    let off: Vec<(f64, f64)> = (tracer.surfels.iter().zip(normals).map(off))
        .zip(weights)
        .collect();
    weighted_quantile(off, 0.5).map_or(0.0, f64::to_degrees) as f32
}

fn is_ambiguous(front: &OutwardSide, two_sided: f32) -> bool {
    front.is_guess() && two_sided < 0.5
}

/// Traces the rays of some patches.
fn trace(
    tracer: &Tracer,
    rays: (&[Vec3], &InferredVisibility),
    strata: &[usize],
    found: &mut [SurfelHits],
    progress: Progress<'_>,
) -> Result<()> {
    by_neighborhood(found, progress, |found| {
        trace_neighborhood(tracer, rays, strata, found);
    })
}

/// The rays of surfels that are neighbours: of each direction those whose side is not known to be closed, and which others do not tell.
fn trace_neighborhood(
    tracer: &Tracer,
    (directions, inferred_visibility): (&[Vec3], &InferredVisibility),
    strata: &[usize],
    found: &mut [SurfelHits],
) {
    let mut stack = Vec::new();
    let (mut places, mut asked) = (Vec::new(), Vec::new());
    for place in 0..PER_STRATUM {
        for stratum in strata {
            let j = place * STRATA + stratum;
            places.clear();
            asked.clear();
            for (lane, f) in found.iter_mut().enumerate() {
                let cosine = tracer.surfels[f.surfel as usize].normal.dot(directions[j]);
                if f.is_closed(cosine) {
                    continue;
                }
                if let Some(open) = inferred_visibility.tells(j, &f.open) {
                    f.set_open(j, open);
                    f.told += 1;
                    continue;
                }
                places.push(lane);
                asked.push(f.surfel);
            }
            for (places, asked) in places.chunks(PACKET).zip(asked.chunks(PACKET)) {
                let hits = tracer.hits(asked, directions[j], place > 0, &mut stack);
                for (lane, hit) in places.iter().zip(hits) {
                    found[*lane].set_open(j, hit == MISS);
                    if place == 0 && hit != MISS {
                        found[*lane].hits.push(Hit::new(*stratum, hit));
                    }
                }
            }
        }
    }
}

/// Share of the rays that were not traced, since they go into closed sides.
fn closed_share(tracer: &Tracer, directions: &[Vec3], found: &[SurfelHits]) -> f32 {
    let order = refining_order(STRATA);
    let skipped: usize = found
        .par_iter()
        .filter(|f| f.back_is_closed)
        .map(|f| {
            let i = f.surfel as usize;
            let (surfel, front) = (&tracer.surfels[i], &tracer.outward_sides.of[i]);
            let traced = if front.hides_its_back() { 0 } else { PROBES };
            let rays = order[traced..]
                .iter()
                .flat_map(|p| (0..PER_STRATUM).map(move |k| k * STRATA + p));
            rays.filter(|j| f.is_closed(surfel.normal.dot(directions[*j])))
                .count()
        })
        .sum();
    skipped as f32 / (found.len() * DIRECTIONS).max(1) as f32
}

/// Closes the backs from which the first patches saw nothing: all that their rays could tell is how much of a two-sided surfel it is, and it
/// is none.
fn close_backs(tracer: &Tracer, directions: &[Vec3], strata: &[usize], found: &mut [SurfelHits]) {
    let probes: Vec<usize> = (0..PER_STRATUM)
        .flat_map(|place| strata.iter().map(move |stratum| place * STRATA + stratum))
        .collect();
    found.par_iter_mut().for_each(|f| {
        let surfel = &tracer.surfels[f.surfel as usize];
        let (mut seen, mut all) = (0f32, 1e-9f32);
        for j in &probes {
            let behind = (-surfel.normal.dot(directions[*j])).max(0.0);
            all += behind;
            if is_open(&f.open, *j) {
                seen += behind;
            }
        }
        f.back_is_closed = seen < CLOSED * all;
    });
}

/// Gives patches that are not traced yet what the nearest one that is has.
fn fill_unfinished_strata(directions: &[Vec3], done: &[usize], found: &mut [SurfelHits]) {
    let nearest = |p: usize| {
        let cosine = |q: &usize| directions[p].dot(directions[*q]);
        let from = done
            .iter()
            .copied()
            .max_by(|a, b| cosine(a).total_cmp(&cosine(b)));
        from.unwrap_or(p)
    };
    let from: Vec<usize> = (0..STRATA).map(nearest).collect();
    found.par_iter_mut().for_each(|f| {
        let mut met = [None; STRATA];
        for hit in &f.hits {
            met[hit.stratum()] = Some(hit.surfel() as u32);
        }
        let before = std::mem::replace(f, SurfelHits::of(f.surfel));
        for (p, q) in from.iter().enumerate() {
            let open = |place: usize| is_open(&before.open, place * STRATA + q);
            f.add(p, met[*q], std::array::from_fn(open));
        }
    });
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::oracle;
    use crate::synthetic;

    #[test]
    fn a_sphere_sees_its_upper_half_and_nothing_of_itself() {
        let cloud = synthetic::sphere(1500);
        let baked = DirectionalBake::all_rays(&cloud);
        let directions = directions();
        for (i, n) in baked.normals.iter().enumerate() {
            assert!(n.dot(cloud.positions[i]) > 0.0);
            assert_eq!(baked.two_sided[i], 0.0);
            let wrong = (0..DIRECTIONS)
                .filter(|j| {
                    let cosine = n.dot(directions[*j]);
                    cosine.abs() > 0.2
                        && baked.directional_visibility.is_open(i, *j) != (cosine > 0.0)
                })
                .count();
            assert!(wrong < 4, "surfel {i}: {wrong}");
        }
    }

    #[test]
    fn hits_agree_with_asking_every_disc() {
        let cloud = synthetic::sphere_over_plate(300);
        let baked = DirectionalBake::all_rays(&cloud);
        let surfels = &baked.tracer.surfels;
        let directions = directions();
        let (mut differ, mut all) = (0, 0);
        for i in 0..cloud.len() {
            // Both those that know what they meet, and those that stop at anything.
            for j in (0..DIRECTIONS).step_by(3) {
                let direction = directions[j].as_dvec3();
                let exact = oracle::first_hit(surfels, i, direction);
                all += 1;
                differ +=
                    usize::from(exact.is_none() != baked.directional_visibility.is_open(i, j));
                let hit = baked
                    .directional_visibility
                    .hits_of(i)
                    .iter()
                    .find(|h| h.stratum() == j);
                let knows = j < STRATA && baked.normals[i].dot(directions[j]) > 0.0;
                differ += usize::from(knows && hit.is_some() != exact.is_some());
                if let (Some(hit), Some(exact)) = (hit, exact) {
                    // Of discs in one plane, either may be named.
                    let met = hit.surfel();
                    let distance = oracle::hit_distance(surfels, i, direction, met);
                    differ += usize::from(distance.is_none_or(|t| (t - exact).abs() > 1e-5));
                }
            }
        }
        // A ray that grazes a rim may round to either side of it.
        assert!(differ * 1000 < all, "{differ} of {all}");
    }

    /// Mean openness of both sides over the surfels that are `asked`, and how many of these are two-sided.
    fn openness_of(baked: &DirectionalBake, asked: impl Fn(usize) -> bool) -> ([f32; 2], usize) {
        let asked: Vec<usize> = (0..baked.len()).filter(|i| asked(*i)).collect();
        let directions = directions();
        let mut sum = [0f32; 2];
        for i in &asked {
            let sides = openness(
                baked.directional_visibility.open_of(*i),
                &directions,
                baked.normals[*i],
            );
            sum = [sum[0] + sides[0], sum[1] + sides[1]];
        }
        let two_sided = asked.iter().filter(|i| baked.two_sided[**i] > 0.5).count();
        (sum.map(|s| s / asked.len() as f32), two_sided)
    }

    #[test]
    fn the_faces_of_a_thin_plate_of_wide_surfels_are_open_in_front() {
        // As trainers make them: far wider than they are apart.
        let mut top = synthetic::sheet(24);
        for scale in &mut top.scales {
            *scale *= 2.0;
        }
        for thickness in [0.4, 2.0] {
            let mut plate = top.clone();
            let below = thickness * top.scales[0].x * Vec3::Z;
            plate.add(&top, 1.0, -below);
            let baked = DirectionalBake::all_rays(&plate);
            let middle = |i: usize| plate.positions[i].truncate().abs().max_element() < 0.6;
            let ([front, back], two_sided) = openness_of(&baked, middle);
            assert!(front > 0.98, "{thickness}: {front}");
            for i in (0..plate.len()).filter(|i| middle(*i)) {
                assert_eq!(baked.normals[i].z > 0.0, i < top.len(), "surfel {i}");
            }
            // What is nearer than the surfel is wide is taken for its own surface: then nobody sees the back, but it is lit.
            if thickness > 1.0 {
                assert!(back < 0.05 && two_sided == 0, "{back} {two_sided}");
            }
        }
    }

    /// A ball whose surfels are tilted at random.
    fn tilted_ball(n: usize) -> SurfelCloud {
        let mut ball = synthetic::sphere(n);
        for (i, tangents) in ball.tangents.iter_mut().enumerate() {
            let tilt = Vec3::new(
                (i as f32).sin(),
                (2.3 * i as f32).sin(),
                (5.1 * i as f32).sin(),
            );
            let (u, v) = (ball.positions[i] + 0.2 * tilt)
                .normalize()
                .any_orthonormal_pair();
            *tangents = [u, v];
        }
        ball
    }

    #[test]
    fn the_noise_of_normals_is_how_far_they_are_off() {
        let smooth = DirectionalBake::all_rays(&synthetic::sphere(1500));
        assert!(smooth.normal_noise < 0.2, "{}", smooth.normal_noise);
        let mut ball = tilted_ball(6000);
        ball.scales.iter_mut().for_each(|s| *s *= 4.0);
        let mut off: Vec<f32> = (0..ball.len())
            .map(|i| {
                let cosine = ball.stored_normal(i).dot(ball.positions[i]).abs();
                cosine.min(1.0).acos().to_degrees()
            })
            .collect();
        off.sort_unstable_by(f32::total_cmp);
        let (noise, known) = (
            DirectionalBake::all_rays(&ball).normal_noise,
            off[off.len() / 2],
        );
        // It is compared with an average of which it is a part, the smaller one: it counts as four of up to 32 neighbours.
        assert!((0.5 * known..known).contains(&noise), "{noise} of {known}");
    }

    #[test]
    fn what_lies_inside_of_a_closed_ball_is_not_lit_and_blocks_nothing() {
        let ball = synthetic::sphere(1500);
        let mut filled = ball.clone();
        filled.add(&synthetic::sphere(300), 0.5, Vec3::ZERO);
        let (hollow, filled) = (
            DirectionalBake::all_rays(&ball),
            DirectionalBake::all_rays(&filled),
        );
        let seen = |bake: &DirectionalBake, i| *bake.directional_visibility.open_of(i);
        assert!((0..ball.len()).all(|i| seen(&hollow, i) == seen(&filled, i)));
        let inside = ball.len()..filled.len();
        assert!(
            inside
                .clone()
                .all(|i| seen(&filled, i).iter().all(|w| *w == 0))
        );
        let counted: f32 = filled.visible_weight[inside].iter().sum();
        // A fifth of all area, behind a ball whose surfels have soft rims.
        assert!(counted < 0.02, "{counted}");
    }

    #[test]
    fn layers_of_one_surface_do_not_shade_each_other() {
        // Four layers within one of the surfels' own extents.
        let mut stack = tilted_ball(6000);
        for i in 0..stack.len() {
            stack.scales[i] *= 2.0;
            stack.positions[i] *= 1.0 - 0.25 * (i % 4) as f32 * stack.scales[i].x;
            stack.opacities[i] = 0.5;
        }
        let ([front, back], two_sided) = openness_of(&DirectionalBake::all_rays(&stack), |_| true);
        assert!(front > 0.9 && back < 0.02, "{front} {back}");
        assert!(two_sided * 100 < stack.len(), "{two_sided}");
    }

    #[test]
    fn a_lone_sheet_is_two_sided() {
        let baked = DirectionalBake::all_rays(&synthetic::sheet(20));
        assert!(baked.two_sided.iter().all(|t| *t == 1.0));
        assert!(baked.directional_visibility.hits.is_empty());
    }

    #[test]
    fn cancelling_stops() {
        for share in [-1.0, 0.0, 0.5] {
            let stop = |done: f64| match done > share {
                true => std::ops::ControlFlow::Break(()),
                false => std::ops::ControlFlow::Continue(()),
            };
            let result = DirectionalBake::bake(&synthetic::sphere_over_plate(500), &stop);
            assert!(matches!(result, Err(Error::Cancelled)), "{share}");
        }
    }
}
