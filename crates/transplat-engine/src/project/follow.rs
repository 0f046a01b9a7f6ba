//! Lights that are fixed to the camera or to an object, moved along with it.

use std::borrow::Cow;

use glam::{Affine3A, DMat3, DQuat};
use transplat_core::camera::{Camera, CameraPose};
use transplat_core::scene::{FixedTo, Light, Scene};
use transplat_core::surfels::UpAxis;

use crate::object::Followed;
use crate::project::Project;

impl Project {
    /// From the scene's coordinates to the Z-up world, in which lights stand.
    pub fn world_from_scene(&self) -> DMat3 {
        self.scene_up().asset_from_world().transpose()
    }

    /// Takes lights along with the camera and the objects that they are fixed to.
    pub fn follow(&mut self) {
        if self.comparing.is_some() {
            return;
        }
        let mut lights = self.scene.lights.iter();
        if lights.all(|light| light.fixed_to == FixedTo::World) {
            self.followed = None;
            return;
        }
        let ids = self.states.iter().map(|s| s.id);
        let places = ids.zip(self.scene.objects.iter().map(|o| o.transform));
        let now = Followed {
            camera: self.pose,
            up: self.scene_up(),
            places: places.collect(),
        };
        let Some(before) = self.followed.replace(now.clone()) else {
            return;
        };
        if before == now {
            return;
        }
        for light in &mut self.scene.lights {
            let moved = match light.fixed_to {
                FixedTo::World => None,
                FixedTo::Camera => (before.up == now.up)
                    .then(|| [&before, &now].map(|f| scene_from_camera(&f.camera, f.up))),
                FixedTo::Object(of) => place_of(&before, &now, of),
            };
            if let Some([from, to]) = moved.filter(|[from, to]| from != to) {
                take_along(light, to * from.inverse(), now.up);
            }
        }
    }

    /// Lights that are fixed to the camera as they stand for the one that is there now, where they were for another.
    pub fn bring_lights_along(&mut self, from: &CameraPose) {
        let up = self.scene_up();
        let [from, to] = [from, &self.pose].map(|pose| scene_from_camera(pose, up));
        for light in &mut self.scene.lights {
            if light.fixed_to == FixedTo::Camera && from != to {
                take_along(light, to * from.inverse(), up);
            }
        }
    }

    /// The settings as a step to come back to: where it is seen from is none, but for lights that go along with that.
    pub fn scene_as_step(&self) -> Cow<'_, Scene> {
        let goes_along = |light: &Light| light.fixed_to == FixedTo::Camera;
        if !self.scene.lights.iter().any(goes_along) {
            return Cow::Borrowed(&self.scene);
        }
        let mut scene = self.scene.clone();
        scene.camera = Some(self.pose);
        Cow::Owned(scene)
    }
}

fn scene_from_camera(pose: &CameraPose, up: UpAxis) -> Affine3A {
    // The place and the turn are those of any picture.
    let camera = Camera::from_pose(pose, up, [64, 64], 1.0);
    Affine3A::from_mat3_translation(camera.view_from_world.transpose(), camera.eye)
}

/// Where an object stood and stands, if it is still the same.
fn place_of(before: &Followed, now: &Followed, of: usize) -> Option<[Affine3A; 2]> {
    let (id, there) = now.places.get(of)?;
    let (_, was) = before.places.get(of).filter(|(last, _)| last == id)?;
    Some([was, there].map(|t| t.scene_from_object()))
}

/// Moves a light as a motion of the scene says.
fn take_along(light: &mut Light, motion: Affine3A, up: UpAxis) {
    let (scale, turn, shift) = motion.to_scale_rotation_translation();
    let world_from_scene = DQuat::from_mat3(&up.asset_from_world().transpose());
    let turn = world_from_scene * turn.as_dquat() * world_from_scene.inverse();
    let shift = world_from_scene * shift.as_dvec3();
    let scale = f64::from(scale.x);
    // What is hardly a change is none: rounding must not add up.
    let scale = if (scale - 1.0).abs() < 1e-5 {
        1.0
    } else {
        scale
    };
    light.source.go_along(scale, turn.normalize(), shift);
}

#[cfg(test)]
mod tests {
    use glam::{DVec3, Vec3};
    use transplat_core::scene::{LightKind, Placed};

    use super::*;

    /// A light that is fixed to the camera is seen where it was seen, however the scene's axes lie.
    #[test]
    fn what_is_fixed_to_the_camera_is_seen_in_the_same_place() {
        for (_, up) in UpAxis::ALL {
            let from = CameraPose {
                pivot: Vec3::new(0.1, 0.2, 0.3),
                azimuth: 20.0,
                elevation: 15.0,
                distance: 3.0,
                fov: 35.0,
                orthographic: false,
                roll: 0.0,
                aperture: 0.0,
            };
            let to = CameraPose {
                azimuth: -100.0,
                elevation: -40.0,
                distance: 4.0,
                roll: 12.0,
                ..from
            };
            let placed = Placed {
                position: DVec3::new(1.0, 2.0, 1.5),
                aim: DVec3::ZERO,
                radius: 0.5,
            };
            for kind in [LightKind::Spot, LightKind::Directional] {
                let mut light = Light::placed(kind, placed, 1.0);
                let scene_from_world = up.asset_from_world();
                let seen = |light: &Light, pose: &CameraPose| {
                    let view = scene_from_camera(pose, up).inverse();
                    let direction = light.source.direction().expect("it has one");
                    let direction = (scene_from_world * direction).as_vec3();
                    let place = light.source.position().unwrap_or_default();
                    let place = (scene_from_world * place).as_vec3();
                    let place = match kind {
                        LightKind::Spot => view.transform_point3(place),
                        _ => Vec3::ZERO,
                    };
                    [view.transform_vector3(direction), place]
                };
                let before = seen(&light, &from);
                let [a, b] = [&from, &to].map(|pose| scene_from_camera(pose, up));
                take_along(&mut light, b * a.inverse(), up);
                let after = seen(&light, &to);
                for (a, b) in before.iter().zip(after) {
                    assert!(a.distance(b) < 1e-4, "{up:?} {kind:?}: {a} {b}");
                }
            }
        }
    }
}
