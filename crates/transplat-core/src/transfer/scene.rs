//! Joint relight of objects: each blocks the others' light, and shines on them.

pub mod harmonic;

use std::sync::{Arc, OnceLock};

use rayon::prelude::*;

use super::directional::{DirectionalTransfer, FrontAndBack, Incident, Others, Radiance, TURNS};
use super::materials::Materials;
use super::relit::{Part, Relight, Relit};
use crate::bake::scene::SceneBake;
use crate::bake::surroundings::PlacedObject;
use crate::environment::Illumination;
use crate::error::Result;
use crate::progress::Progress;
use crate::settings::optimizations::SkippedWork;
use crate::surfels::SurfelCloud;

/// The objects of a scene, each under the light of its own capture, ready for any other that they share. As one asset its surfels are
/// numbered object after object, and its lights and colours are in the scene's coordinates.
#[derive(Clone, Debug)]
pub struct SceneTransfer {
    /// Each object alone.
    pub objects: Vec<Arc<DirectionalTransfer>>,
    /// Where they stand, and what they see of each other.
    pub bake: Arc<SceneBake>,
    /// Bounced light on each object's surfels in the first turn of the fixed point: of a light only its mean counts. See [`Self::first_turn`].
    first_turn: OnceLock<Vec<Vec<FrontAndBack>>>,
}

/// A light on all objects.
struct Bounced<'a> {
    /// As each of them meets it.
    lights: Vec<Incident<'a>>,
    /// Change of the diffuse light on each object's surfels.
    taus: Vec<Vec<FrontAndBack>>,
    /// Radiance of all surfels of the scene. `[n]`
    radiance: Vec<Radiance>,
}

impl SceneTransfer {
    /// Joint relight of a scene. The radiance of one object shines on those of other captures as strongly as it shows in its own images: images and
    /// lights share a unit, as those of a renderer do.
    pub fn new(objects: Vec<Arc<DirectionalTransfer>>, bake: Arc<SceneBake>) -> Self {
        Self {
            objects,
            bake,
            first_turn: OnceLock::new(),
        }
    }

    /// The first object as it is where the others are not.
    ///
    /// # Errors
    /// [`crate::error::Error::Cancelled`] when `progress` asked for it.
    pub fn first_alone(&self, progress: Progress<'_>) -> Result<Self> {
        let bake = SceneBake::new(vec![self.bake.objects[0].clone()], progress)?;
        Ok(Self::new(vec![self.objects[0].clone()], Arc::new(bake)))
    }

    /// Change of the diffuse light on each surfel: one fixed point over all objects, since what one gains lights others.
    fn bounce(&self, target: &Illumination) -> Result<Bounced<'_>> {
        let (lights, mut taus): (Vec<_>, Vec<_>) = (0..self.objects.len())
            .into_par_iter()
            .map(|i| {
                let (transfer, around) = (&self.objects[i], &self.bake.surroundings[i]);
                let target = target.seen_by(self.bake.objects[i].scene_from_object);
                let light = transfer.light(&target)?;
                let mut light = (transfer.asset).incident(light, &transfer.settings, Some(around));
                light.others = self.others_of(i);
                Ok((light, vec![[[0.0; 3]; 2]; transfer.asset.bake.len()]))
            })
            .collect::<Result<Vec<_>>>()?
            .into_iter()
            .unzip();
        let each = self.objects.iter().zip(&lights).zip(&mut taus);
        for (((object, light), tau), first) in each.zip(self.first_turn(&lights)) {
            let bounced = |i: usize| first[i].map(|side| times(side, lights[0].mean));
            object.turn_with(light, bounced, tau);
        }
        let mut radiance = Vec::new();
        for _ in 1..TURNS {
            self.radiate(&taus, &mut radiance);
            let each = self.objects.iter().zip(&lights).zip(&mut taus);
            for ((object, light), tau) in each {
                object.turn(light, &radiance, tau);
            }
        }
        for ((object, light), tau) in self.objects.iter().zip(&lights).zip(&mut taus) {
            object.trusted(light.user_gain, tau);
        }
        self.radiate(&taus, &mut radiance);
        Ok(Bounced {
            lights,
            taus,
            radiance,
        })
    }

    /// Bounced light on each object's surfels in the first turn, for each unit of the first object's mean irradiance.
    fn first_turn(&self, lights: &[Incident<'_>]) -> &[Vec<FrontAndBack>] {
        self.first_turn.get_or_init(|| {
            let unit = f64::from(self.objects[0].light_gain);
            let start = |object: &Arc<DirectionalTransfer>| {
                let gain = (f64::from(object.light_gain) / unit).clamp(1e-12, 1e12) as f32;
                let start = object.mean_ratio([gain; 3]);
                vec![[start; 2]; object.asset.bake.len()]
            };
            let taus: Vec<_> = self.objects.iter().map(start).collect();
            let mut radiance = Vec::new();
            self.radiate(&taus, &mut radiance);
            let each = self.objects.iter().zip(lights);
            each.map(|(object, light)| {
                let surfels = (0..object.asset.bake.len()).into_par_iter();
                surfels
                    .map(|i| object.asset.bounced(i, light, &radiance))
                    .collect()
            })
            .collect()
        })
    }

    /// Writes the radiance of all surfels of the scene, `[n]`, into `all`.
    fn radiate(&self, taus: &[Vec<FrontAndBack>], all: &mut Vec<Radiance>) {
        all.clear();
        all.reserve(self.bake.normals.len());
        for (object, tau) in self.objects.iter().zip(taus) {
            all.par_extend(object.asset.radiance(tau));
        }
    }

    /// Light of the other objects on one of them, in the unit of its captured colour.
    fn others_of(&self, which: usize) -> Option<Others> {
        let placed = &self.bake.objects;
        let is_of_its_capture = |other: &usize| placed[which].is_of_capture_of(&placed[*other]);
        let others = || (0..placed.len()).filter(|other| *other != which);
        let gain = self.objects[which].light_gain;
        (gain != 1.0 && !others().all(|o| is_of_its_capture(&o))).then(|| Others {
            own: self.bake.surfels_of(which),
            parts: others()
                .filter(is_of_its_capture)
                .map(|o| self.bake.surfels_of(o))
                .collect(),
            gain,
        })
    }

    /// Joins the objects' results into one splat's.
    pub fn composed(&self, relit: Vec<Relit>) -> Relit {
        let is_one_encoding = relit.iter().all(|r| r.encoding == relit[0].encoding);
        let degree = relit.iter().map(|r| r.degree).max().unwrap_or_default();
        let turned = |(relit, placed): (Relit, &PlacedObject)| {
            let relit = if is_one_encoding {
                relit
            } else {
                relit.linear()
            };
            relit.placed(placed.scene_from_object).of_degree(degree)
        };
        let each = relit.into_iter().zip(&self.bake.objects).map(turned);
        Relit::together(each).expect("at least one object")
    }

    fn of_surfel<T>(&self, i: usize, of: impl Fn(&DirectionalTransfer, usize) -> T) -> T {
        let (object, i) = self.bake.locate(i);
        of(&self.objects[object], i)
    }
}

fn times(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|c| a[c] * b[c])
}

impl Relight for SceneTransfer {
    fn relight_objects(
        &self,
        target: &Illumination,
        part: Part,
        unseen: &[bool],
    ) -> Result<Vec<Relit>> {
        let bounced = self.bounce(target)?;
        let each = bounced.taus.into_iter().enumerate();
        Ok(each
            .map(|(i, tau)| {
                let unseen = unseen.get(self.bake.surfels_of(i)).unwrap_or_default();
                let light = (&bounced.lights[i], part);
                let (object, radiance) = (&self.objects[i], &bounced.radiance);
                let relit = object.shown(object.whole_rows(), light, tau, radiance, unseen);
                relit.into_whole()
            })
            .collect())
    }

    fn relight_after(
        &self,
        last: Option<Relit>,
        target: &Illumination,
        part: Part,
        unseen: &[bool],
    ) -> Result<Relit> {
        // Two at once would be twice the memory.
        drop(last);
        Ok(self.composed(self.relight_objects(target, part, unseen)?))
    }

    fn tau(&self, target: &Illumination) -> Result<Vec<[f32; 3]>> {
        let taus = self.bounce(target)?.taus;
        Ok(taus.into_iter().flatten().map(|t| t[0]).collect())
    }

    fn computed_part(&self, shown: Part) -> Part {
        shown
    }

    fn materials(&self, whitest: Option<f32>) -> Materials {
        let each = self.objects.iter().zip(&self.bake.objects);
        Materials::together(each.map(|(o, placed)| o.materials(whitest).turned(placed.turn())))
    }

    fn skipped_work(&self, cloud: &SurfelCloud) -> Vec<SkippedWork> {
        let each = self.objects.iter().flat_map(|o| o.skipped_work(cloud));
        let mut all: Vec<SkippedWork> = Vec::new();
        for skipped in each {
            if !all.contains(&skipped) {
                all.push(skipped);
            }
        }
        all
    }

    fn skipped_work_for(&self, light: &Illumination, on_gpu: bool) -> Option<SkippedWork> {
        self.objects[0].skipped_work_for(light, on_gpu)
    }

    /// The first object's.
    fn light_gain(&self) -> f32 {
        self.objects[0].light_gain
    }

    fn source_was_black(&self) -> bool {
        self.objects.iter().any(|o| o.source_was_black)
    }

    fn bytes(&self) -> usize {
        self.objects.iter().map(|o| o.bytes()).sum()
    }

    fn epsilon_share(&self, i: usize) -> f32 {
        self.of_surfel(i, DirectionalTransfer::epsilon_share)
    }

    fn amplification(&self, i: usize) -> f32 {
        self.of_surfel(i, DirectionalTransfer::amplification)
    }

    fn is_dark(&self, i: usize) -> bool {
        self.of_surfel(i, DirectionalTransfer::is_dark)
    }

    fn dark_share(&self) -> f32 {
        let surfels = self.bake.normals.len();
        let dark = (0..surfels).filter(|i| self.is_dark(*i)).count();
        dark as f32 / surfels.max(1) as f32
    }
}

#[cfg(test)]
mod tests;
