//! Joint preparation by preset paper: objects put into the first one's scene.

use std::sync::Arc;

use anyhow::bail;
use glam::Quat;
use transplat_core::bake::Bake;
use transplat_core::bake::insertion::{InsertionBake, Standing};
use transplat_core::environment::Illumination;
use transplat_core::settings::Method;
use transplat_core::transfer::scene::harmonic::HarmonicScene;

use crate::bake::{self, BakeRequest};
use crate::jobs::{Handle, Kind};
use crate::language::tr;
use crate::object::{InsertedKey, InsertionKey};
use crate::project::{Change, Project};

impl Project {
    /// True where an object's bake as it was captured is used: that of preset paper does not turn with it, and only a window shows it then.
    pub(crate) fn needs_own_bake(&self, at: usize) -> bool {
        let is_inserted = self.scene.transfer.method == Method::Harmonic && self.is_composed();
        self.canvas.is_some() || !(self.is_turned(at) && is_inserted)
    }

    fn is_turned(&self, at: usize) -> bool {
        self.scene.objects[at].transform.rotation != Quat::IDENTITY
    }

    /// All that is to be known of what the objects see as they stand now, once they are baked.
    fn insertion_key(&self) -> Option<InsertionKey> {
        let each = self.members().into_iter().map(|at| {
            let (state, transform) = (&self.states[at], self.scene.objects[at].transform);
            if self.is_turned(at) {
                return Some((state.id, 0, transform));
            }
            let made = state.bakes.get(&Method::Harmonic)?;
            made.current().filter(|b| b.share == 1.0)?;
            Some((state.id, made.version(), transform))
        });
        let each = each.collect::<Option<Vec<_>>>()?;
        (!each.is_empty()).then_some(InsertionKey {
            each,
            directions: self.directions(Method::Harmonic),
            shadows: self.scene.transfer.terms.shadow,
        })
    }

    /// Traces the objects where they stand now; the last answer serves until then.
    pub(crate) fn start_insertion(&mut self) {
        let kind = Kind::Insertion;
        let is_awaited = self.jobs.is_awaited(kind);
        if self.scene.transfer.method != Method::Harmonic {
            if is_awaited {
                self.jobs.cancel(kind);
                self.insertion.ask_again();
            }
            return;
        }
        let key = self.insertion_key().filter(|_| self.requested.bakes);
        let Some(key) = key.filter(|k| !self.insertion.is_asked(k)) else {
            return;
        };
        // Nobody waits for where they were.
        self.jobs.cancel(kind);
        self.insertion.ask(&key);
        let known = self.insertion.made_from().zip(self.insertion.get());
        let known = known.filter(|(of, _)| of.directions == key.directions);
        let known = known.map(|(of, bake)| (of.each.clone(), bake.clone()));
        let each = key.each.iter().filter_map(|object| {
            let state = &self.states[self.at(object.0)?];
            let own = state.bakes.get(&Method::Harmonic).and_then(|b| b.get());
            let own = own.and_then(|baked| match &*baked.bake {
                Bake::Harmonic(own) => Some(own.clone()),
                _ => None,
            });
            Some((*object, state.asset.as_ref()?.cloud.clone(), own))
        });
        let each: Vec<_> = each.collect();
        let count = each.len() as f64 + 1.0;
        let InsertionKey {
            directions,
            shadows,
            ..
        } = key;
        let optimizations = self.scene.transfer.optimizations;
        let device = self.device.clone();
        let work = move |handle: &Handle<Change>| {
            let mut standing = Vec::new();
            for (i, (object, cloud, own)) in each.iter().enumerate() {
                let last = known.as_ref().and_then(|(of, bake)| {
                    let (id, version, _) = object;
                    let at = of.iter().position(|k| (&k.0, &k.1) == (id, version))?;
                    Some((of[at].2, &bake.objects[at]))
                });
                let transform = object.2;
                let cloud = match &last {
                    Some((stood, last)) if *stood == transform => last.cloud.clone(),
                    _ => Arc::new(transform.place(cloud)),
                };
                let turned = last.filter(|(stood, _)| stood.rotation == transform.rotation);
                // Its directions do not turn with it.
                let is_unturned = transform.rotation == Quat::IDENTITY;
                let bake = if let Some(own) = own.as_ref().filter(|_| is_unturned) {
                    own.clone()
                } else if let Some((_, last)) = turned {
                    last.bake.clone()
                } else {
                    let wanted = BakeRequest {
                        cloud: cloud.clone(),
                        method: Method::Harmonic,
                        directions,
                        optimizations,
                        part_of: None,
                        place: None,
                    };
                    let progress = |done: f64| handle.progress((i as f64 + done) / count);
                    match bake::bake(&device.fastest(), &wanted, &progress)? {
                        Bake::Harmonic(bake) => bake,
                        _ => bail!(tr("The bake is for the other method.")),
                    }
                };
                standing.push(Standing {
                    cloud,
                    bake,
                    turn: transform.rotation,
                });
            }
            let progress = |done: f64| handle.progress((count - 1.0 + done) / count);
            let known = known.as_ref().map(|(_, bake)| &**bake);
            let bake = InsertionBake::new(standing, shadows, known, &progress)?;
            Ok(Arc::new(bake))
        };
        let label = tr("tracing between the objects");
        self.start(kind, label, work, move |project, made| {
            project.insertion.accept(key, made);
        });
    }

    /// All that the objects' transfers depend on now, once it is known what they see.
    fn inserted_key(&self) -> Option<InsertedKey> {
        let of = &self.insertion.made_from()?.each;
        let sources = of.iter().map(|(id, ..)| {
            let [source, _] = self.oriented_of(self.at(*id)?);
            Some((*id, source))
        });
        let settings = self.scene.transfer.clone();
        Some((
            self.insertion.version(),
            sources.collect::<Option<_>>()?,
            settings,
        ))
    }

    /// Prepares their transfers; the last ones serve until then.
    pub(crate) fn start_inserted(&mut self) {
        let kind = Kind::PrepareScene;
        if self.scene.transfer.method != Method::Harmonic || self.jobs.is_running(kind) {
            return;
        }
        let mut members = self.members().into_iter();
        if !self.requested.transfers || members.any(|at| self.waits_for_capture_light(at)) {
            return;
        }
        let key = self.inserted_key().zip(self.insertion.get().cloned());
        let Some((key, bake)) = key.filter(|(key, _)| self.inserted.ask(key)) else {
            return;
        };
        let of = key.clone();
        let work = move |_: &Handle<Change>| {
            let sources: Vec<&Illumination> = of.1.iter().map(|(_, s)| &*s.light).collect();
            Ok(Arc::new(HarmonicScene::new(bake, &sources, &of.2)?))
        };
        let label = tr("preparing the scene");
        self.start(kind, label, work, move |project, made| {
            project.inserted.accept(key, made);
        });
    }

    /// True where the joint transfer is made of the objects as they stand, and as all is set now.
    pub fn is_inserted(&self) -> bool {
        let key = self.insertion_key();
        let is_traced = key.is_some() && self.insertion.made_from() == key.as_ref();
        is_traced && self.inserted.made_from() == self.inserted_key().as_ref()
    }
}
