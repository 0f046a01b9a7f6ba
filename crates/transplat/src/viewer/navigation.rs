//! Camera navigation: orbit, pan, zoom to the pointer, fly, frame.

use glam::{DVec3, Vec2, Vec3};
use transplat_core::camera::{Camera, CameraPose, FOV};
use transplat_core::scene::EnvironmentLight;
pub use transplat_core::scene::wrap;
use transplat_core::surfels::UpAxis;
use transplat_engine::language::tr_later;

/// Degrees of turn for a point of drag: of the camera, and of a light.
const DEGREES_A_POINT: f64 = 0.4;
const LIGHT_DEGREES_A_POINT: f64 = 0.5;

/// Where one looks from: azimuth and elevation in degrees.
pub type Viewpoint = [f64; 2];

pub const FRONT: Viewpoint = [-90.0, 0.0];
pub const RIGHT: Viewpoint = [0.0, 0.0];
pub const BACK: Viewpoint = [90.0, 0.0];
pub const LEFT: Viewpoint = [180.0, 0.0];
pub const TOP: Viewpoint = [-90.0, 90.0];
pub const BOTTOM: Viewpoint = [-90.0, -90.0];

/// All of them.
pub const VIEWPOINTS: [(&str, Viewpoint); 6] = [
    (tr_later("Front"), FRONT),
    (tr_later("Right"), RIGHT),
    (tr_later("Back"), BACK),
    (tr_later("Left"), LEFT),
    (tr_later("Top"), TOP),
    (tr_later("Bottom"), BOTTOM),
];

/// Looks from a side.
pub fn look_from(pose: &mut CameraPose, from: Viewpoint) {
    [pose.azimuth, pose.elevation] = from;
    pose.roll = 0.0;
}

/// Turns about the pivot by a drag in points.
pub fn orbit(pose: &mut CameraPose, drag: Vec2) {
    pose.azimuth = wrap(pose.azimuth - f64::from(drag.x) * DEGREES_A_POINT);
    pose.elevation = (pose.elevation + f64::from(drag.y) * DEGREES_A_POINT).clamp(-90.0, 90.0);
}

/// The camera's right and up in the asset's coordinates, and what a point of the viewport is there at the pivot.
fn picture_plane(pose: &CameraPose, up: UpAxis, shorter_edge: f32) -> (Vec3, Vec3, f32) {
    let camera = Camera::from_pose(pose, up, [100, 100], 1.0);
    let axes = camera.view_from_world.transpose();
    let unit = 2.0 * pose.distance * (pose.fov.to_radians() / 2.0).tan() as f32 / shorter_edge;
    (axes.x_axis, -axes.y_axis, unit)
}

/// Moves with a drag in points, so that the pivot stays under the pointer.
pub fn pan(pose: &mut CameraPose, up: UpAxis, drag: Vec2, shorter_edge: f32) {
    let (right, above, unit) = picture_plane(pose, up, shorter_edge);
    pose.pivot += (above * drag.y - right * drag.x) * unit;
}

/// Comes nearer by a factor; what is under the pointer (points from the viewport's middle, y down) stays there.
pub fn zoom(
    pose: &mut CameraPose,
    up: UpAxis,
    factor: f32,
    pointer: Vec2,
    shorter_edge: f32,
    radius: f32,
) {
    let distance = (pose.distance * factor).clamp(1e-3 * radius, 1e3 * radius);
    let moved = 1.0 - distance / pose.distance;
    let (right, above, unit) = picture_plane(pose, up, shorter_edge);
    pose.pivot += (right * pointer.x - above * pointer.y) * (unit * moved);
    pose.distance = distance;
}

/// Looks around from where the camera is, by a drag in points.
pub fn look_around(pose: &mut CameraPose, up: UpAxis, drag: Vec2) {
    let eye = eye(pose, up);
    orbit(pose, 0.5 * drag);
    pose.pivot = eye + (pose.pivot - self::eye(pose, up));
}

/// Flies: `along` is right, up and forward, in scene units.
pub fn fly(pose: &mut CameraPose, up: UpAxis, along: Vec3) {
    let camera = Camera::from_pose(pose, up, [100, 100], 1.0);
    let axes = camera.view_from_world.transpose();
    pose.pivot += axes.x_axis * along.x + up.direction() * along.y + axes.z_axis * along.z;
}

/// Where the camera is, as if it were a perspective one.
pub fn eye(pose: &CameraPose, up: UpAxis) -> Vec3 {
    let perspective = CameraPose {
        orthographic: false,
        ..*pose
    };
    Camera::from_pose(&perspective, up, [100, 100], 1.0).eye
}

/// Turns and tilts a light as a drag by so many points does.
pub fn turn_light(light: &mut EnvironmentLight, by: Vec2) {
    light.rotation = wrap(light.rotation + LIGHT_DEGREES_A_POINT * f64::from(by.x));
    light.tilt = wrap(light.tilt + LIGHT_DEGREES_A_POINT * f64::from(by.y));
}

/// Makes a point the pivot and leaves the camera where it is, turned to the point.
pub fn set_pivot(pose: &mut CameraPose, up: UpAxis, point: Vec3) {
    let towards = eye(pose, up) - point;
    let distance = towards.length();
    if distance <= 0.0 {
        return;
    }
    let world = up.asset_from_world().transpose() * (towards / distance).as_dvec3();
    pose.pivot = point;
    pose.distance = distance;
    pose.elevation = world.z.clamp(-1.0, 1.0).asin().to_degrees();
    if DVec3::new(world.x, world.y, 0.0).length() > 1e-6 {
        pose.azimuth = world.y.atan2(world.x).to_degrees();
    }
}

/// Changes the field of view and keeps the pivot's size in the picture.
pub fn set_fov(pose: &mut CameraPose, fov: f64) {
    let fov = fov.clamp(*FOV.start(), *FOV.end());
    let tan = |degrees: f64| (degrees.to_radians() / 2.0).tan();
    pose.distance *= (tan(pose.fov) / tan(fov)) as f32;
    pose.fov = fov;
}

#[cfg(test)]
mod tests {
    use super::*;

    fn pose() -> CameraPose {
        CameraPose {
            pivot: Vec3::new(0.3, -0.2, 0.5),
            azimuth: 30.0,
            elevation: 25.0,
            distance: 4.0,
            fov: 40.0,
            orthographic: false,
            roll: 0.0,
            aperture: 0.0,
        }
    }

    const SIZE: [usize; 2] = [601, 401];

    fn on_screen(pose: &CameraPose, point: Vec3) -> Vec2 {
        let camera = Camera::from_pose(pose, UpAxis::PlusY, SIZE, 1.0);
        let ([x, y], _) = camera.project(point);
        Vec2::new(x - 300.0, y - 200.0)
    }

    #[test]
    fn panning_moves_the_pivot_with_the_pointer() {
        for orthographic in [false, true] {
            let before = CameraPose {
                orthographic,
                ..pose()
            };
            let mut after = before;
            pan(&mut after, UpAxis::PlusY, Vec2::new(40.0, -25.0), 401.0);
            let moved = on_screen(&after, before.pivot);
            assert!(moved.distance(Vec2::new(40.0, -25.0)) < 0.1, "{moved}");
        }
    }

    #[test]
    fn zooming_keeps_what_is_under_the_pointer() {
        for orthographic in [false, true] {
            let before = CameraPose {
                orthographic,
                ..pose()
            };
            let (right, above, unit) = picture_plane(&before, UpAxis::PlusY, 401.0);
            let pointer = Vec2::new(120.0, 60.0);
            let under = before.pivot + (right * pointer.x - above * pointer.y) * unit;
            let mut after = before;
            zoom(&mut after, UpAxis::PlusY, 0.5, pointer, 401.0, 1.0);
            assert!(on_screen(&after, under).distance(pointer) < 0.1);
            assert!((after.distance - 2.0).abs() < 1e-6);
        }
    }

    #[test]
    fn a_new_pivot_leaves_the_camera_where_it_is() {
        let before = pose();
        let mut after = before;
        let point = Vec3::new(-0.4, 0.7, 0.1);
        set_pivot(&mut after, UpAxis::PlusY, point);
        assert!(eye(&after, UpAxis::PlusY).distance(eye(&before, UpAxis::PlusY)) < 1e-5);
        assert!(on_screen(&after, point).length() < 0.05);
    }

    #[test]
    fn looking_around_leaves_the_camera_where_it_is() {
        let before = pose();
        let mut after = before;
        look_around(&mut after, UpAxis::MinusX, Vec2::new(50.0, 20.0));
        let (a, b) = (eye(&before, UpAxis::MinusX), eye(&after, UpAxis::MinusX));
        assert!(a.distance(b) < 1e-5 && after.azimuth != before.azimuth);
    }

    #[test]
    fn a_wider_view_keeps_the_pivots_size() {
        let before = pose();
        let mut after = before;
        set_fov(&mut after, 80.0);
        let (right, ..) = picture_plane(&before, UpAxis::PlusY, 401.0);
        let aside = before.pivot + right * 0.3;
        assert!(on_screen(&before, aside).distance(on_screen(&after, aside)) < 0.1);
    }

    #[test]
    fn viewpoints_look_along_their_axes() {
        let mut pose = pose();
        pose.pivot = Vec3::ZERO;
        for (viewpoint, expected) in [(FRONT, Vec3::NEG_Y), (RIGHT, Vec3::X), (TOP, Vec3::Z)] {
            look_from(&mut pose, viewpoint);
            let from = eye(&pose, UpAxis::PlusZ) / pose.distance;
            assert!(from.distance(expected) < 1e-5, "{viewpoint:?}: {from}");
        }
    }
}
