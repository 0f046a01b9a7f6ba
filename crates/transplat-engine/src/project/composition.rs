//! Composition of a scene: objects added, duplicated, cut out, removed, and dropped to the ground.

use std::path::{Path, PathBuf};

use glam::{Quat, Vec3};
use transplat_core::camera::Camera;
use transplat_core::files::is_same_file;
use transplat_core::numeric::quantile;
use transplat_core::scene::{
    Cut, ESTIMATE, EnvironmentLight, Keep, MOST_CUTS, MOST_OBJECTS, Object, SCALES, Transform, kept,
};
use transplat_core::support::support_of;
use transplat_core::surfels::{Bounds, SurfelFilter, UpAxis};

use crate::language::{tr, tr_format};
use crate::names::{distinct_names, name_of};
use crate::project::{Notice, Project, Remedy};
use crate::splat::OpenedWith;

/// Where an object stands on the surface below it, a robust highest point counts: that share of the surfels may stick out.
const STICKING_OUT: f32 = 0.001;

/// Share of the surfels below an object that may stick out of what it stands on: a ground is rough.
const ROUGH: f32 = 0.05;

/// Cosine to the vertical from which a surface is too steep to stand on.
const STEEP: f32 = 0.7;

/// An object of a smaller share of the others' radius is put among them.
const SMALL: f32 = 0.5;

/// An object whose radius is a smaller or larger multiple of the others' is in other units.
const OTHER_UNITS: std::ops::RangeInclusive<f32> = 0.02..=4.0;

/// Share of an object's radius around its middle under which the ground is looked for.
const FOOTPRINT: f32 = 0.5;

/// Last cut that keeps an object inside of its box, and those before.
fn cut_around(object: &Object) -> Option<(&[Cut], Cut)> {
    let is_around = |cut: &Cut| cut.keep == Keep::Inside;
    let last = object.cut.iter().rposition(is_around)?;
    Some((&object.cut[..last], object.cut[last]))
}

impl Project {
    /// Puts a splat into the scene: a small one where the camera looks, another one beside what is there.
    pub fn add_object(&mut self, asset: PathBuf) {
        self.add_in_room(asset, SMALL);
    }

    /// Puts a splat into the scene, beside what is there.
    pub fn add_beside(&mut self, asset: PathBuf) {
        self.add_in_room(asset, 0.0);
    }

    fn add_in_room(&mut self, asset: PathBuf, small: f32) {
        self.add(Object {
            asset: Some(asset),
            // Its capture light is unknown.
            source: EnvironmentLight::of(ESTIMATE),
            transform: Transform {
                translation: self.pose.pivot,
                ..Transform::default()
            },
            ..Object::default()
        });
        if let Some(added) = self.states.last_mut() {
            added.seeks_room = Some(small);
        }
    }

    /// Turns an object that stands in the scene of another so that its own up axis is up there, about its middle.
    pub fn stand_upright(&mut self, at: usize) {
        let (own, scene) = (self.up_of(at).direction(), self.scene_up().direction());
        let Some(bounds) = self.states[at].asset.as_ref().map(|a| a.bounds) else {
            return;
        };
        let transform = &mut self.scene.objects[at].transform;
        let place = |transform: &Transform| {
            transform
                .scene_from_object()
                .transform_point3(bounds.center)
        };
        let middle = place(transform);
        let turn = Quat::from_rotation_arc(transform.rotation * own, scene);
        transform.rotation = (turn * transform.rotation).normalize();
        transform.translation += middle - place(transform);
    }

    /// Bounds of the object that an opened splat replaces, in a scene of several.
    pub(crate) fn replaced(
        &self,
        at: usize,
        opened: &Path,
        opened_with: &OpenedWith,
    ) -> Option<Bounds> {
        let is_opened = matches!(opened_with, OpenedWith::Object(..));
        let is_one_of_several = is_opened && self.scene.objects.len() > 1;
        let asset = self.states[at].asset.as_ref();
        let asset = asset.filter(|last| is_one_of_several && last.path != opened)?;
        let transform = self.scene.objects[at].transform;
        Some(asset.bounds.transformed(transform.scene_from_object()))
    }

    /// Stands an object upright in the place of another; `scene_up` was the scene's up axis before.
    pub(crate) fn take_place(&mut self, at: usize, last: Bounds, scene_up: UpAxis) {
        let Some(asset) = &self.states[at].asset else {
            return;
        };
        let bounds = asset.bounds;
        self.scene.objects[at].name = None;
        self.scene.objects[at].transform = Transform {
            translation: last.center - bounds.center,
            ..Transform::default()
        };
        self.in_the_same_units(
            at,
            Bounds {
                center: last.center,
                ..bounds
            },
            &last,
        );
        if at == 0 {
            // The scene's own coordinates are its.
            self.keep_upright(scene_up);
            self.scene.objects[0].transform.rotation = Quat::IDENTITY;
        } else {
            self.stand_upright(at);
            self.drop_to_ground(at);
        }
    }

    /// Turns what stands in the scene along, where another object has become the first and with it another axis is up: it stays as it stands
    /// in the world.
    fn keep_upright(&mut self, last: UpAxis) {
        let turn = self.scene_up().asset_from_world() * last.asset_from_world().transpose();
        let turn = Quat::from_mat3(&turn.as_mat3()).normalize();
        if turn.is_near_identity() {
            return;
        }
        for object in &mut self.scene.objects {
            let transform = &mut object.transform;
            transform.rotation = (turn * transform.rotation).normalize();
            transform.translation = turn * transform.translation;
        }
        let cameras = self.scene.bookmarks.iter_mut().map(|b| &mut b.camera);
        for camera in cameras.chain([&mut self.pose]) {
            camera.pivot = turn * camera.pivot;
        }
        self.followed = None;
    }

    /// Puts what was added beside the others on their ground, unless it is smaller than such a share of them.
    pub fn find_room(&mut self, at: usize, small: f32) {
        let of = |at: usize| {
            let object = &self.scene.objects[at];
            let bounds = self.states[at].asset.as_ref()?.bounds;
            Some(bounds.transformed(object.transform.scene_from_object()))
        };
        let others = (0..self.states.len()).filter(|other| *other != at);
        let others: Vec<Bounds> = others.filter_map(of).collect();
        let (Some(own), false) = (of(at), others.is_empty()) else {
            return;
        };
        let Some(all) = Bounds::around(others.into_iter()) else {
            return;
        };
        let own = self.in_the_same_units(at, own, &all);
        let up = self.scene_up();
        if own.radius < small * all.radius {
            // Onto what the camera looks at, not into it.
            let up = up.direction();
            let above = all.center.dot(up) + all.radius + own.radius;
            self.scene.objects[at].transform.translation += (above - own.center.dot(up)) * up;
            self.drop_to_ground(at);
            return;
        }
        let camera = Camera::from_pose(&self.pose, up, [100, 100], all.radius);
        let right = camera.view_from_world.row(0);
        let level = (right - right.dot(up.direction()) * up.direction()).normalize_or(right);
        let middle = all.center + level * (all.radius + own.radius);
        self.scene.objects[at].transform.translation += middle - own.center;
        self.drop_to_ground(at);
    }

    /// Makes what was added as large as the others, where it is so much smaller or larger that it must be in other units, and says so: splats
    /// mostly are in none. Yields where it is then.
    fn in_the_same_units(&mut self, at: usize, own: Bounds, all: &Bounds) -> Bounds {
        let ratio = own.radius / all.radius;
        if !ratio.is_finite() || ratio <= 0.0 || OTHER_UNITS.contains(&ratio) {
            return own;
        }
        let last = self.scene.objects[at].transform.scale;
        let (low, high) = SCALES.into_inner();
        let scale = (last / ratio).clamp(low, high);
        let factor = scale / last;
        self.scale_about_middle(at, scale);
        let times = if ratio > 1.0 { ratio } else { 1.0 / ratio };
        let times = if times < 100.0 {
            format!("{times:.0}")
        } else {
            format!("{times:.0e}")
        };
        let text = if ratio > 1.0 {
            tr_format!(
                "The splat was {times} times larger than the scene. Its scale was matched.",
                times = times
            )
        } else {
            tr_format!(
                "The splat was {times} times smaller than the scene. Its scale was matched.",
                times = times
            )
        };
        self.offer(text, at, Remedy::ResetScale);
        Bounds {
            radius: factor * own.radius,
            ..own
        }
    }

    /// Scales an object about its middle.
    pub(crate) fn scale_about_middle(&mut self, at: usize, scale: f32) {
        let Some(bounds) = self.states[at].asset.as_ref().map(|a| a.bounds) else {
            return;
        };
        let transform = &mut self.scene.objects[at].transform;
        let middle = |t: &Transform| t.scene_from_object().transform_point3(bounds.center);
        let there = middle(transform);
        transform.scale = scale;
        transform.translation += there - middle(transform);
    }

    /// Shows all, from the same side, where the middle of an object is not in the picture.
    pub fn reveal(&mut self, at: usize) {
        let Some(asset) = &self.states[at].asset else {
            return;
        };
        let place = self.scene.objects[at].transform.scene_from_object();
        let middle = place.transform_point3(asset.bounds.center);
        let [width, height] = self.viewport;
        let camera = Camera::from_pose(&self.pose, self.scene_up(), self.viewport, 1.0);
        let ([x, y], depth) = camera.project(middle);
        let is_within = |v: f32, edge: usize| (0.0..edge as f32).contains(&v);
        if depth <= 0.0 || !is_within(x, width) || !is_within(y, height) {
            self.frame_all();
        }
    }

    /// Puts an object into the scene; its splat is loaded when its turn comes.
    fn add(&mut self, object: Object) {
        if self.scene.objects.len() >= MOST_OBJECTS {
            self.error(tr_format!(
                "A scene holds up to {MOST_OBJECTS} objects. Remove some first.",
                MOST_OBJECTS = MOST_OBJECTS
            ));
            return;
        }
        self.scene.objects.push(object);
        self.scene.light_as_captured();
        self.match_states(&self.scene.objects.clone());
        if let Some(added) = self.states.last_mut() {
            added.is_added = true;
        }
    }

    /// Name of an object in lists.
    pub fn called(&self, at: usize) -> String {
        let of_file = self.states.get(at).and_then(|s| s.asset.as_ref());
        let called = self.scene.objects[at].called();
        let called = called.or(of_file.map(|a| a.name()));
        called.unwrap_or_else(|| tr("no splat").into())
    }

    /// Adds another object of an object's splat, beside it.
    pub fn duplicate(&mut self, at: usize) {
        let mut copy = self.scene.objects[at].clone();
        let Some(asset) = &self.states[at].asset else {
            return;
        };
        let aside = copy.transform.rotation * Vec3::X;
        copy.transform.translation += 2.0 * copy.transform.scale * asset.bounds.radius * aside;
        copy.asset = Some(asset.path.clone());
        copy.locked = false;
        let called = |o: &Object| o.called().unwrap_or_default();
        let all = self.scene.objects.iter().map(called);
        copy.name = distinct_names(all.chain([called(&copy)])).pop();
        self.add(copy);
    }

    /// Makes two objects of one: what lies in its crop box, and the rest. Both know how they were lit side by side.
    pub fn cut_out(&mut self, at: usize) {
        let Some(asset) = &self.states[at].asset else {
            return;
        };
        let (object, bounds) = (&self.scene.objects[at], asset.bounds);
        let corner = |c: Vec3| bounds.center + bounds.radius * c;
        let cut = Cut {
            keep: Keep::Inside,
            min: corner(object.hide.crop_min),
            max: corner(object.hide.crop_max),
            support: None,
        };
        let cloud = &asset.cloud;
        let is_inside = |i: &usize| cut.keeps(cloud.positions[*i], cloud.opacities[*i]);
        let (inside, outside): (Vec<usize>, Vec<usize>) =
            (0..asset.cloud.len()).partition(is_inside);
        if inside.is_empty() || outside.is_empty() {
            let what = if inside.is_empty() {
                tr("Nothing")
            } else {
                tr("Everything")
            };
            self.info(tr_format!(
                "{what} lies in the crop box. Move its sides.",
                what = what
            ));
            return;
        }
        if object.cut.len() >= MOST_CUTS || self.scene.objects.len() >= MOST_OBJECTS {
            self.error(tr("Too many cuts or objects. Remove some first."));
            return;
        }
        let part = |cut: Cut, surfels: &[usize]| {
            let mut part = object.clone();
            part.asset = Some(asset.path.clone());
            part.cut.push(cut);
            // It was about the whole.
            let whole = SurfelFilter::default();
            if part.hide.max_size < whole.max_size {
                // What is large is so beside the object: the same surfels stay hidden.
                let radius = asset.cloud.selected(surfels).bounds().radius;
                let same = part.hide.max_size * bounds.radius / radius;
                part.hide.max_size = same.min(whole.max_size);
            }
            part.hide = SurfelFilter {
                crop: false,
                crop_min: whole.crop_min,
                crop_max: whole.crop_max,
                ..part.hide
            };
            part
        };
        let has_residue = support_of(cloud, &cut, self.up_of(at)).is_some();
        let called = name_of(object, &asset.path);
        let mut taken = part(cut, &inside);
        taken.name = Some(tr_format!("{called}, cut out", called = called));
        self.scene.objects[at] = part(cut.inverse(), &outside);
        self.add(taken);
        if has_residue {
            let at = self.scene.objects.len() - 1;
            let text = tr_format!(
                "Some of what {} stood on is left under it.",
                self.called(at)
            );
            self.offer(text, at, Remedy::RemoveResidue);
        }
    }

    /// True where the residue of its support goes to the rest of the capture; none where an object was not cut out by a box around it.
    pub fn is_residue_removed(&self, at: usize) -> Option<bool> {
        let (_, cut) = cut_around(&self.scene.objects[at])?;
        Some(cut.support.is_some())
    }

    /// Moves the residue of its support under an object that is cut out to the rest of the capture, or takes it back.
    pub fn remove_residue(&mut self, at: usize, removes: bool) {
        let object = &self.scene.objects[at];
        let Some(((before, cut), path)) = cut_around(object).zip(object.asset.clone()) else {
            return;
        };
        let is_of_it = |object: &Object| {
            let asset = object.asset.as_deref();
            asset.is_some_and(|asset| is_same_file(asset, &path))
        };
        let mut support = None;
        if removes {
            // The object may be loading; the rest is there.
            let mut loaded = self.states.iter().zip(&self.scene.objects);
            let splat = loaded.find_map(|(s, o)| s.asset.as_ref().filter(|_| is_of_it(o)));
            let Some(splat) = splat else {
                return;
            };
            let whole = splat.whole_cloud();
            let cut_from = kept(before, whole).map(|kept| whole.selected(&kept));
            let up = object.up.unwrap_or(splat.file_up);
            support = support_of(cut_from.as_ref().unwrap_or(whole), &cut, up);
            if support.is_none() {
                return self.info(tr("No residue was found under the object."));
            }
        }
        let parts = self.scene.objects.iter_mut().filter(|o| is_of_it(o));
        for side in parts.flat_map(|part| &mut part.cut) {
            if *side == cut || *side == cut.inverse() {
                side.support = support;
            }
        }
    }

    /// Takes an object out of the scene, unless it is the only one or locked.
    pub fn remove_unlocked(&mut self, at: usize) {
        if self.scene.objects.len() == 1 {
            return;
        }
        if self.scene.objects[at].locked {
            let called = self.called(at);
            let text = tr_format!("{called} is locked and stays.", called = called);
            self.offer(text, at, Remedy::Unlock);
            return;
        }
        self.remove(at);
    }

    /// Removes an object from the scene, locked or not.
    pub fn remove(&mut self, at: usize) {
        let scene_up = self.scene_up();
        self.scene.objects.remove(at);
        let kept = self.scene.variants.iter_mut();
        let kept = kept.flat_map(|kept| &mut kept.look.lights);
        for light in self.scene.lights.iter_mut().chain(kept) {
            light.fixed_to = light.fixed_to.without_object(at);
        }
        let others = (0..self.states.len()).filter(|other| *other != at);
        self.arrange(&others.map(Some).collect::<Vec<_>>());
        self.keep_upright(scene_up);
        self.notices.push(Notice::Removed(at));
    }

    /// Stands an object on what is below it: another object's surface, or else the ground of the scene.
    pub fn drop_to_ground(&mut self, at: usize) {
        let up = self.scene_up().direction();
        let Some(asset) = &self.states[at].asset else {
            return;
        };
        let place = self.scene.objects[at].transform.scene_from_object();
        let height = |p: Vec3| place.transform_point3(p).dot(up);
        let seen = asset.cloud.opacities.iter().map(|o| *o > 0.5);
        let heights = asset.cloud.positions.iter().zip(seen);
        let heights = heights.filter(|(_, seen)| *seen).map(|(p, _)| height(*p));
        let Some(foot) = quantile(heights.collect(), STICKING_OUT) else {
            return;
        };
        let ball = asset.bounds.transformed(place);
        let middle = ball.center - up * ball.center.dot(up);
        let mut below = Vec::new();
        for (which, (object, state)) in self.scene.objects.iter().zip(&self.states).enumerate() {
            let Some(other) = state.asset.as_ref().filter(|_| which != at && object.shown) else {
                continue;
            };
            let place = object.transform.scene_from_object();
            let (cloud, turn) = (&other.cloud, object.transform.rotation);
            // What one can stand on.
            let carries = |i: &usize| {
                let slope = (turn * cloud.stored_normal(*i)).dot(up).abs();
                cloud.opacities[*i] > 0.5 && slope > STEEP
            };
            let there = (0..cloud.len()).filter(carries);
            let there = there.map(|i| place.transform_point3(cloud.positions[i]));
            let under = there.filter(|p| {
                let aside = *p - up * p.dot(up) - middle;
                aside.length() < FOOTPRINT * ball.radius && p.dot(up) < ball.center.dot(up)
            });
            below.extend(under.map(|p| p.dot(up)));
        }
        let ground = match quantile(below, 1.0 - ROUGH) {
            Some(ground) => ground,
            None if at == 0 => return,
            None => match &self.states[0].asset {
                Some(scene) => {
                    let place = self.scene.objects[0].transform.scene_from_object();
                    place.transform_point3(scene.ground.0).dot(up)
                }
                None => return,
            },
        };
        self.scene.objects[at].transform.translation += (ground - foot) * up;
    }
}
