//! Places of the lights' handles, and what a drag of one changes.

use eframe::egui::{Pos2, Vec2};
use glam::{DVec3, Vec3};
use transplat_core::scene::{Light, LightSource, RigTarget};

use crate::viewer::projection::{GRAZING, Screen};

/// Distance from a handle at which it is grabbed, in points.
const REACH: f32 = 9.0;

/// Points from a light outward to the handle that moves it in and out.
const OUTWARD: f32 = 34.0;

/// Points from the picture's rim to the handle of a light that is out of it.
const MARGIN: f32 = 22.0;

/// Distance at which a light is drawn that is infinitely far, in radii of all that is shown.
const SUN_AWAY: f64 = 1e4;

/// Cosine to straight up of a light at most: beyond that its turn about the up axis says nothing.
const STEEPEST: f64 = 0.9999;

/// Handle of a light.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum LightHandle {
    /// Moves a light around where it shines.
    Around(usize),
    /// Where the chosen one shines.
    Aim,
    /// Distance of the light.
    Away,
    /// Size of the light, or angle of its cone.
    Size,
}

/// A drag, and from where it started.
pub struct LightDrag {
    pub handle: LightHandle,
    pub at: usize,
    pub from: Light,
    /// Where the pointer was in the picture, and from there to what is held.
    pub pointer: glam::Vec2,
    pub off: glam::Vec2,
    /// On which side of where it shines the light is, where it can be held under the pointer itself; otherwise it goes as the pointer goes.
    pub side: Option<Side>,
}

/// Side of a sphere, of two places that are seen as one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Side {
    Near,
    Far,
}

/// Where the handles of a light are.
pub struct LightHandleView<'a> {
    pub screen: Screen<'a>,
    pub lit: RigTarget,
    pub scene_from_world: glam::DMat3,
}

impl LightHandleView<'_> {
    fn in_scene(&self, world: DVec3) -> Vec3 {
        (self.scene_from_world * world).as_vec3()
    }

    fn in_world(&self, scene: Vec3) -> DVec3 {
        self.scene_from_world.transpose() * scene.as_dvec3()
    }

    pub fn point(&self, world: DVec3) -> Option<Pos2> {
        self.screen.at(self.in_scene(world))
    }

    /// Where the handle of a light is, and whether that is only the way to it: one that is out of the picture has its handle at the rim.
    pub fn bulb(&self, source: &LightSource) -> (Pos2, bool) {
        let place = self.in_scene(self.place(source));
        let shown = self.screen.part.shrink(MARGIN);
        if let Some(at) = self.screen.at(place).filter(|at| shown.contains(*at)) {
            return (at, false);
        }
        let camera = self.screen.camera;
        let seen = camera.view_from_world * (place - camera.eye);
        let way = Vec2::new(seen.x, seen.y);
        let way = if way.length() < 1e-6 * seen.length() || way == Vec2::ZERO {
            Vec2::new(0.0, -1.0)
        } else {
            way.normalized()
        };
        let half = 0.5 * shown.size();
        let reach = (half.x / way.x.abs()).min(half.y / way.y.abs());
        (shown.center() + reach * way, true)
    }

    /// Where a light is drawn, in the world: a sun where it is in the sky.
    pub fn place(&self, source: &LightSource) -> DVec3 {
        let toward = source.direction().map_or(DVec3::ZERO, |d| -d);
        let eye = self.in_world(self.screen.camera.eye);
        let far = eye + SUN_AWAY * self.lit.radius * toward;
        source.position().unwrap_or(far)
    }

    /// Where it stands for what it shines at: a sun as far away as a light that one walks around.
    fn stand(&self, source: &LightSource) -> DVec3 {
        let toward = source.direction().map_or(DVec3::ZERO, |d| -d);
        let near = self.lit.center + 2.0 * self.lit.radius * toward;
        source.position().unwrap_or(near)
    }

    /// Where the handle of its size is, in the world.
    pub fn rim(&self, source: &LightSource) -> Option<DVec3> {
        match source {
            LightSource::Rect { center, edges, .. } => Some(*center + 0.5 * (edges[0] + edges[1])),
            LightSource::Disc {
                center,
                radius,
                normal,
                ..
            } => Some(*center + *radius * normal.any_orthonormal_vector()),
            LightSource::Spot {
                direction,
                cutoff_deg,
                ..
            } => {
                let aim = source.aim(self.lit.center);
                let reach = source.position()?.distance(aim);
                let wide = cutoff_deg.min(85.0).to_radians().tan() * reach;
                Some(aim + wide * direction.any_orthonormal_vector())
            }
            _ => None,
        }
    }

    /// Where the handle is that moves a light in and out: beyond it, as seen from where it shines.
    pub fn away(&self, source: &LightSource) -> Option<Pos2> {
        source.position()?;
        let (here, is_away) = self.bulb(source);
        if is_away {
            return None;
        }
        let aim = self.point(source.aim(self.lit.center))?;
        let outward = (here - aim).normalized();
        let outward = if outward == Vec2::ZERO {
            Vec2::new(0.0, -1.0)
        } else {
            outward
        };
        Some(here + OUTWARD * outward)
    }

    /// The handle at a point of the window: one of some lights, of which that is chosen.
    pub fn handle_at(
        &self,
        (lights, chosen): (&[Light], Option<usize>),
        at: Pos2,
    ) -> Option<LightHandle> {
        let is_near = |point: Option<Pos2>| point.is_some_and(|p| p.distance(at) <= REACH);
        if let Some(chosen) = chosen {
            let source = &lights[chosen].source;
            if is_near(self.away(source)) {
                return Some(LightHandle::Away);
            }
            if is_near(self.rim(source).and_then(|rim| self.point(rim))) {
                return Some(LightHandle::Size);
            }
            let has_aim = source.position().is_some() && source.direction().is_some();
            if has_aim && is_near(self.point(source.aim(self.lit.center))) {
                return Some(LightHandle::Aim);
            }
        }
        let found = lights
            .iter()
            .enumerate()
            .find(|(_, light)| is_near(Some(self.bulb(&light.source).0)));
        found.map(|(at, _)| LightHandle::Around(at))
    }

    /// Where what is held was, in the world.
    pub fn held(&self, handle: LightHandle, light: &Light) -> Option<DVec3> {
        match handle {
            LightHandle::Around(_) | LightHandle::Away => Some(self.place(&light.source)),
            LightHandle::Aim => Some(light.source.aim(self.lit.center)),
            LightHandle::Size => self.rim(&light.source),
        }
    }

    /// The light as a drag to a point of the picture makes it.
    pub fn dragged(&self, drag: &LightDrag, to: glam::Vec2) -> Option<Light> {
        let mut made = drag.from.clone();
        let (source, at) = (&drag.from.source, to + drag.off);
        let aim = source.aim(self.lit.center);
        match drag.handle {
            LightHandle::Around(_) => {
                let center = self.in_scene(aim);
                let far = self.stand(source).distance(aim);
                let there = match drag.side {
                    // A sun is where the ray goes.
                    Some(_) if source.position().is_none() => center + self.screen.ray(at),
                    Some(side) => self.on_sphere(at, center, far as f32, side),
                    None => self.gone_along(source, (drag.pointer, to), center),
                };
                let toward = (self.in_world(there) - aim).try_normalize()?;
                let flat = (1.0 - STEEPEST * STEEPEST).sqrt();
                let toward = if toward.z.abs() > STEEPEST {
                    let along = DVec3::new(toward.x, toward.y, 0.0).normalize_or(DVec3::X);
                    flat * along + STEEPEST * toward.z.signum() * DVec3::Z
                } else {
                    toward
                };
                made.source.put(aim + far * toward, aim);
            }
            LightHandle::Aim => {
                let held = self.in_scene(aim);
                let there = self.screen.on_plane(at, held, self.screen.forward())?;
                made.source.put(source.position()?, self.in_world(there));
            }
            LightHandle::Away => {
                let (here, far) = (source.position()?, source.position()?.distance(aim));
                let axis = self.in_scene((here - aim).try_normalize()?);
                let moved = f64::from(self.screen.along(at, self.in_scene(here), axis)?);
                let least = 0.05 * self.lit.radius;
                let far = (far + moved).clamp(least.min(far), 1e3 * self.lit.radius.max(far));
                made.source.put(aim + far * self.in_world(axis), aim);
            }
            LightHandle::Size => self.size(&mut made.source, at)?,
        }
        Some(made)
    }

    /// Where a light is that goes as the pointer does, as far as that goes where it shines.
    fn gone_along(
        &self,
        source: &LightSource,
        (from, to): (glam::Vec2, glam::Vec2),
        center: Vec3,
    ) -> Vec3 {
        let camera = self.screen.camera;
        let depth = (center - camera.eye).dot(self.screen.forward()).max(0.0);
        let by = (to - from).extend(0.0) * (depth / camera.focal);
        self.in_scene(self.stand(source)) + camera.view_from_world.transpose() * by
    }

    /// On which side of where it shines a light is that is held under the pointer: a light that is seen, around what is before the camera.
    pub fn side(&self, source: &LightSource) -> Option<Side> {
        let (place, aim) = (self.place(source), source.aim(self.lit.center));
        let eye = self.screen.camera.eye;
        let [there, middle] = [place, aim].map(|p| self.in_scene(p) - eye);
        let is_outside = middle.length() > place.distance(aim) as f32;
        let is_far = there.dot(self.screen.forward()) > middle.dot(self.screen.forward());
        let (_, is_away) = self.bulb(source);
        match is_far {
            _ if is_away => None,
            true => Some(Side::Far),
            false => is_outside.then_some(Side::Near),
        }
    }

    /// Where a point of the picture is on a sphere, on its near or far side; outside of it the nearest of its outline.
    fn on_sphere(&self, at: glam::Vec2, center: Vec3, radius: f32, side: Side) -> Vec3 {
        let (eye, ray) = (self.screen.camera.eye, self.screen.ray(at));
        let to_center = center - eye;
        let middle = to_center.dot(ray);
        let beside = (eye + middle * ray) - center;
        let within = radius * radius - beside.length_squared();
        if within <= 0.0 {
            return center + radius * beside.normalize_or_zero();
        }
        let half = match side {
            Side::Near => -within.sqrt(),
            Side::Far => within.sqrt(),
        };
        eye + (middle + half) * ray
    }

    /// Makes a light so large that its rim is at a point of the picture.
    fn size(&self, source: &mut LightSource, at: glam::Vec2) -> Option<()> {
        let least = 1e-3 * self.lit.radius;
        let aim = source.aim(self.lit.center);
        let on_plane = |through: DVec3, normal: DVec3| {
            let normal = self.in_scene(normal);
            // Seen from its edge, it grows as the pointer goes from its middle.
            let facing = self.screen.ray(at).dot(normal).abs() > GRAZING;
            let normal = if facing {
                normal
            } else {
                self.screen.forward()
            };
            let there = self.screen.on_plane(at, self.in_scene(through), normal)?;
            Some(self.in_world(there) - through)
        };
        match source {
            LightSource::Rect {
                center,
                edges,
                normal,
                ..
            } => {
                let out = on_plane(*center, *normal)?;
                let wide = edges.map(|e| (2.0 * out.dot(e.normalize_or_zero()).abs()).max(least));
                source.resize(wide);
            }
            LightSource::Disc { center, normal, .. } => {
                let wide = on_plane(*center, *normal)?.length().max(least);
                source.resize([2.0 * wide; 2]);
            }
            LightSource::Spot {
                position,
                direction,
                cutoff_deg,
                beam_deg,
                ..
            } => {
                let wide = on_plane(aim, *direction)?.length();
                let soft = *beam_deg / cutoff_deg.max(1e-6);
                *cutoff_deg = wide
                    .atan2(position.distance(aim))
                    .to_degrees()
                    .clamp(1.0, 85.0);
                *beam_deg = soft * *cutoff_deg;
            }
            LightSource::Directional { .. } | LightSource::Point { .. } => {}
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use transplat_core::camera::Camera;
    use transplat_core::scene::{KEY, LightKind, Placed};

    use super::*;
    use crate::viewer::projection::tests::{camera, screen};

    fn view(camera: &Camera) -> LightHandleView<'_> {
        LightHandleView {
            screen: screen(camera),
            lit: RigTarget {
                center: DVec3::new(0.5, 0.2, 0.3),
                radius: 0.8,
                seen_from: 0.0,
            },
            scene_from_world: glam::DMat3::from_rotation_y(0.3),
        }
    }

    fn light(kind: LightKind, view: &LightHandleView<'_>, toward: DVec3) -> Light {
        let placed = Placed {
            position: view.lit.center + 2.0 * toward.normalize(),
            aim: view.lit.center,
            radius: view.lit.radius,
        };
        Light::placed(kind, placed, KEY)
    }

    fn drag_of(view: &LightHandleView<'_>, from: &Light) -> LightDrag {
        LightDrag {
            handle: LightHandle::Around(0),
            at: 0,
            pointer: glam::Vec2::ZERO,
            off: glam::Vec2::ZERO,
            side: view.side(&from.source),
            from: from.clone(),
        }
    }

    fn drag(
        view: &LightHandleView<'_>,
        handle: LightHandle,
        from: &Light,
    ) -> (LightDrag, glam::Vec2) {
        let held = view.held(handle, from).expect("a handle");
        let at = view.screen.inside(view.point(held).expect("in front"));
        let drag = LightDrag {
            handle,
            pointer: at,
            ..drag_of(view, from)
        };
        (drag, at)
    }

    /// What was under the pointer stays there; a light keeps its distance from where it shines, or what it shines at.
    #[test]
    fn a_light_follows_the_pointer() {
        let camera = camera();
        let view = view(&camera);
        let near = LightKind::ALL.into_iter();
        for kind in near.filter(|kind| *kind != LightKind::Directional) {
            for toward in [DVec3::new(1.0, -1.0, 0.8), DVec3::new(-1.0, 0.6, 0.4)] {
                let from = light(kind, &view, toward);
                let by = glam::Vec2::new(25.0, 14.0);
                let (held, at) = drag(&view, LightHandle::Around(0), &from);
                let made = view.dragged(&held, at + by).expect("a place");
                let now = view
                    .screen
                    .inside(view.point(view.place(&made.source)).expect("seen"));
                assert!(now.distance(at + by) < 0.1, "{kind:?} {now} {at}");
                let aim = made.source.aim(view.lit.center);
                assert!(aim.distance(view.lit.center) < 1e-3, "{kind:?}");
                let (held, at) = drag(&view, LightHandle::Away, &from);
                // Outward: away from where it shines.
                let aim = view
                    .screen
                    .inside(view.point(view.lit.center).expect("seen"));
                let out = 30.0 * (at - aim).normalize();
                let made = view.dragged(&held, at + out).expect("a place");
                let far = |l: &Light| l.source.position().map(|p| p.distance(view.lit.center));
                assert!(far(&made) > far(&from), "{kind:?}");
                if made.source.direction().is_none() {
                    continue;
                }
                let (held, at) = drag(&view, LightHandle::Aim, &from);
                let made = view.dragged(&held, at + by).expect("a place");
                let now = made.source.aim(view.lit.center);
                let now = view.screen.inside(view.point(now).expect("seen"));
                assert!(now.distance(at + by) < 6.0, "{kind:?} {now} {at}");
                assert_eq!(made.source.position(), from.source.position());
            }
        }
    }

    /// A sun is dragged where it is in the sky.
    #[test]
    fn a_sun_follows_the_pointer() {
        let camera = camera();
        let view = view(&camera);
        let ahead = view.in_world(Vec3::ZERO + camera.view_from_world.row(2));
        let from = light(
            LightKind::Directional,
            &view,
            ahead + DVec3::new(0.1, 0.05, 0.2),
        );
        let (held, at) = drag(&view, LightHandle::Around(0), &from);
        let by = glam::Vec2::new(25.0, -14.0);
        let made = view.dragged(&held, at + by).expect("a place");
        let now = view
            .screen
            .inside(view.point(view.place(&made.source)).expect("seen"));
        assert!(now.distance(at + by) < 0.1, "{now} {at}");
    }

    /// A light behind the camera has its handle at the rim of the picture, and goes as the pointer goes.
    #[test]
    fn a_light_that_is_not_seen_can_be_taken_all_the_same() {
        let camera = camera();
        let view = view(&camera);
        let to_eye = view.in_world(camera.eye) - view.lit.center;
        let mut from = light(LightKind::Rect, &view, to_eye);
        let aim = view.lit.center;
        let beyond = aim + 1.4 * to_eye.length() * (to_eye + DVec3::Z).normalize();
        from.source.put(beyond, aim);
        let (at, is_away) = view.bulb(&from.source);
        assert!(is_away && view.screen.part.contains(at));
        let mut held = drag_of(&view, &from);
        held.pointer = view.screen.inside(at);
        for by in [glam::Vec2::new(40.0, 0.0), glam::Vec2::new(0.0, -40.0)] {
            let made = view.dragged(&held, held.pointer + by).expect("a place");
            let moved = view.in_scene(view.place(&made.source)) - view.in_scene(beyond);
            let seen = camera.view_from_world * moved;
            assert!(seen.truncate().dot(by) > 0.0, "{by}: {seen}");
            let far = view.place(&made.source).distance(aim);
            assert!((far / beyond.distance(aim) - 1.0).abs() < 1e-6);
        }
    }

    /// A larger soft box is as bright a light, and a wider cone is as soft.
    #[test]
    fn a_light_grows_with_the_pointer() {
        let camera = camera();
        let view = view(&camera);
        for kind in [LightKind::Rect, LightKind::Disc, LightKind::Spot] {
            let from = light(kind, &view, DVec3::new(1.0, -1.0, 0.8));
            let (held, at) = drag(&view, LightHandle::Size, &from);
            let middle = match kind {
                LightKind::Spot => view.lit.center,
                _ => view.place(&from.source),
            };
            let middle = view.screen.inside(view.point(middle).expect("seen"));
            let to = at + 0.4 * (at - middle);
            let made = view.dragged(&held, to).expect("a place");
            let rim = view.point(view.rim(&made.source).expect("it has one"));
            let now = view.screen.inside(rim.expect("seen"));
            assert!(now.distance(to) < 12.0, "{kind:?}: {now} {to}");
            let center = view.lit.center.as_vec3();
            let power = |l: &Light| l.emitter().emission[0] * l.emitter().shape.facing(center, 0.0);
            assert!((power(&made) / power(&from) - 1.0).abs() < 0.1, "{kind:?}");
        }
    }
}
