//! A pinhole camera with OpenCV axes: x right, y down, z forward.

use glam::{Affine3A, DMat3, DMat4, DVec2, DVec3, Mat3, Vec2, Vec3};
use serde::{Deserialize, Serialize};

use crate::error::{Result, ensure};
use crate::surfels::{Bounds, SurfelCloud, UpAxis};

/// Nothing is drawn that is nearer to the camera than this share of the object's radius.
pub const NEAR: f32 = 0.02;

/// Where the camera is, around a pivot. Angles are those of the asset's own upright frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct CameraPose {
    /// Point that the camera orbits, in the splat's coordinates.
    pub pivot: Vec3,
    /// Direction from pivot to camera: azimuth in degrees, counter-clockwise seen from above.
    pub azimuth: f64,
    /// Elevation over the horizon, in degrees.
    pub elevation: f64,
    /// Distance to the pivot in scene units; in an orthographic view that at which a perspective one would show as much.
    pub distance: f32,
    /// Field of view of the picture's shorter edge, in degrees.
    pub fov: f64,
    /// Parallel lines stay parallel.
    pub orthographic: bool,
    /// Roll about the viewing direction, clockwise, in degrees.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub roll: f64,
    /// Radius of the lens as a share of the distance to the pivot, which is sharp; 0: everything is.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub aperture: f64,
}

fn is_zero(value: &f64) -> bool {
    *value == 0.0
}

impl CameraPose {
    /// A perspective view of an object, from so many of its radii away.
    pub fn around(bounds: &Bounds, azimuth: f64, elevation: f64, radii: f32, fov: f64) -> Self {
        Self {
            pivot: bounds.center,
            azimuth,
            elevation,
            distance: radii * bounds.radius,
            fov,
            orthographic: false,
            roll: 0.0,
            aperture: 0.0,
        }
    }

    /// The pose of a perspective camera, around what it sees at a place's distance.
    pub fn of(camera: &Camera, up: UpAxis, place: Vec3) -> Self {
        let world_from_asset = up.asset_from_world().transpose();
        let [right, _, forward] = [0, 1, 2].map(|i| {
            let axis = camera.view_from_world.row(i).as_dvec3();
            (world_from_asset * axis).normalize()
        });
        let towards = -forward;
        let horizontal = towards.truncate().length();
        let azimuth = if horizontal > 1e-6 {
            towards.y.atan2(towards.x)
        } else {
            (-right.x).atan2(right.y)
        };
        let level = DVec3::new(-azimuth.sin(), azimuth.cos(), 0.0);
        let roll = right.dot(level.cross(towards)).atan2(right.dot(level));
        let forward = camera.view_from_world.row(2);
        let seen = (place - camera.eye).dot(forward);
        let distance = seen.max(1e-3 * place.distance(camera.eye)).max(1e-6);
        let half_edge = 0.5 * camera.width.min(camera.height) as f64;
        let fov = 2.0 * (half_edge / f64::from(camera.focal)).atan();
        Self {
            pivot: camera.eye + forward * distance,
            azimuth: azimuth.to_degrees(),
            elevation: towards.z.clamp(-1.0, 1.0).asin().to_degrees(),
            distance,
            fov: fov.to_degrees().clamp(*FOV.start(), *FOV.end()),
            orthographic: false,
            roll: roll.to_degrees(),
            aperture: f64::from(camera.lens.radius / distance).min(*APERTURE.end()),
        }
    }

    /// Checks the ranges.
    ///
    /// # Errors
    /// A value is no number or out of range.
    pub(crate) fn validate(&self) -> Result<()> {
        let finite = self.pivot.is_finite()
            && self.azimuth.is_finite()
            && (-90.0..=90.0).contains(&self.elevation)
            && self.distance.is_finite()
            && self.roll.is_finite()
            && self.distance > 0.0
            && APERTURE.contains(&self.aperture)
            && FOV.contains(&self.fov);
        ensure(finite, || {
            "the camera is out of range (elevation -90 to 90, fov 1 to 150, distance above 0, aperture 0 to 0.2)"
                .into()
        })
    }
}

/// Radii of the lens that a camera pose may have.
pub const APERTURE: std::ops::RangeInclusive<f64> = 0.0..=0.2;

/// Fields of view in degrees that a camera pose may have.
pub const FOV: std::ops::RangeInclusive<f64> = 1.0..=150.0;

/// A view of the world and the picture it makes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Rows are the camera's right, down and forward axes.
    pub view_from_world: Mat3,
    /// Where the camera is.
    pub eye: Vec3,
    /// Focal length in pixels, the same in x and y.
    pub focal: f32,
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// Depth under which nothing is drawn, in scene units.
    pub near: f32,
    /// Focal length in pixels for what is infinitely far: an orthographic view shows one direction of it otherwise.
    pub backdrop_focal: f32,
    /// Where the optical axis meets the picture, in pixels from its middle.
    pub shift: Vec2,
    /// Lens that blurs images; a camera itself is a pinhole.
    pub lens: Lens,
}

/// A thin lens.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lens {
    /// In scene units; 0: everything is sharp.
    pub radius: f32,
    /// Depth that is sharp, in scene units.
    pub focus: f32,
}

impl Default for Lens {
    /// A pinhole.
    fn default() -> Self {
        Self {
            radius: 0.0,
            focus: f32::INFINITY,
        }
    }
}

/// Field of view that stands for parallel projection, in degrees: over an object's radius it widens things by 0.2 %, and the distance
/// (some 600 radii) leaves f32 positions a hundredth of a pixel.
const ORTHOGRAPHIC_FOV: f64 = 0.2;

impl Camera {
    /// From a camera-to-world pose with OpenGL axes, as NeRF camera files hold it, and a horizontal field of view in radians.
    pub fn from_opengl_pose(
        world_from_camera: DMat4,
        fov_x: f64,
        [width, height]: [usize; 2],
        near: f32,
    ) -> Self {
        let axis = |i: usize| world_from_camera.col(i).truncate().normalize_or_zero();
        // Columns of this are the camera's axes in the world.
        let world_from_view = DMat3::from_cols(axis(0), -axis(1), -axis(2));
        Self {
            view_from_world: world_from_view.transpose().as_mat3(),
            eye: world_from_camera.col(3).truncate().as_vec3(),
            focal: (0.5 * width as f64 / (fov_x / 2.0).tan()) as f32,
            width,
            height,
            near,
            backdrop_focal: (0.5 * width as f64 / (fov_x / 2.0).tan()) as f32,
            shift: Vec2::ZERO,
            lens: Lens::default(),
        }
    }

    /// From a look's pose, around an asset with that up axis. `radius` is the object's, and sets what is too near to be drawn.
    pub fn from_pose(pose: &CameraPose, up: UpAxis, size: [usize; 2], radius: f32) -> Self {
        let (azimuth, elevation) = (pose.azimuth.to_radians(), pose.elevation.to_radians());
        let asset_from_world = up.asset_from_world();
        let towards = asset_from_world * direction(azimuth, elevation);
        let level = asset_from_world * DVec3::new(-azimuth.sin(), azimuth.cos(), 0.0);
        let (sin, cos) = pose.roll.to_radians().sin_cos();
        let right = level * cos + level.cross(towards) * sin;
        let shown = (pose.fov.to_radians() / 2.0).tan();
        let half_edge = size[0].min(size[1]) as f64 / 2.0;
        let (slope, distance) = if pose.orthographic {
            let slope = (ORTHOGRAPHIC_FOV.to_radians() / 2.0).tan();
            (slope, f64::from(pose.distance) * shown / slope)
        } else {
            (shown, f64::from(pose.distance))
        };
        let eye = pose.pivot.as_dvec3() + towards * distance;
        let world_from_view = DMat3::from_cols(right, right.cross(towards), -towards);
        Self {
            view_from_world: world_from_view.transpose().as_mat3(),
            eye: eye.as_vec3(),
            focal: (half_edge / slope) as f32,
            width: size[0],
            height: size[1],
            near: NEAR * radius.min(pose.distance),
            backdrop_focal: (half_edge / shown) as f32,
            shift: Vec2::ZERO,
            lens: Lens {
                radius: (pose.aperture * distance) as f32,
                focus: distance as f32,
            },
        }
    }

    /// A camera at `eye` that looks at `target` with `up` upwards in the picture.
    pub fn look_at(
        eye: Vec3,
        target: Vec3,
        up: Vec3,
        fov_x: f64,
        size: [usize; 2],
        near: f32,
    ) -> Self {
        let forward = (target - eye).as_dvec3().normalize_or(DVec3::X);
        let right = forward.cross(up.as_dvec3());
        let right = if right.length_squared() > 1e-12 {
            right.normalize()
        } else {
            // Looking along up: any right will do.
            forward.any_orthonormal_vector()
        };
        let pose = DMat4::from_cols(
            right.extend(0.0),
            right.cross(forward).extend(0.0),
            (-forward).extend(0.0),
            eye.as_dvec3().extend(1.0),
        );
        Self::from_opengl_pose(pose, fov_x, size, near)
    }

    /// Camera with `factor` times the pixels along each edge.
    pub fn supersampled(&self, factor: usize) -> Self {
        Self {
            focal: self.focal * factor as f32,
            backdrop_focal: self.backdrop_focal * factor as f32,
            shift: self.shift * factor as f32,
            width: self.width * factor,
            height: self.height * factor,
            ..*self
        }
    }

    /// Camera in the coordinates and unit of an object that stands in the scene.
    pub fn seen_from(&self, scene_from_object: Affine3A) -> Self {
        let (scale, turn, _) = scene_from_object.to_scale_rotation_translation();
        Self {
            view_from_world: self.view_from_world * Mat3::from_quat(turn),
            eye: scene_from_object.inverse().transform_point3(self.eye),
            near: self.near / scale.x,
            ..*self
        }
    }

    /// The pinhole cameras whose mean is what the lens shows: each `count`-th part of it, and a part of a pixel, by the golden angle (Vogel
    /// 1979), seen so that what is in focus stays where it is.
    pub fn through_lens(&self, count: usize) -> impl ExactSizeIterator<Item = Self> {
        let Lens { radius, focus } = self.lens;
        let [right, down] = [0, 1].map(|i| self.view_from_world.row(i));
        (0..count).map(move |i| {
            let far = ((i as f32 + 0.5) / count as f32).sqrt();
            let aside = far * Vec2::from_angle(i as f32 * GOLDEN_ANGLE);
            let step = radius * aside;
            // Independent of the place on the lens: the additive sequence of Roberts (2018).
            let in_pixel = Vec2::new(i as f32 * 0.754_877_7, i as f32 * 0.569_840_3).fract();
            Self {
                eye: self.eye + right * step.x + down * step.y,
                shift: self.shift + step * (self.focal / focus) + in_pixel - 0.5,
                ..*self
            }
        })
    }

    /// Across how many pixels a point between two depths is spread by the lens at most.
    pub fn blur(&self, [near, far]: [f32; 2]) -> f32 {
        let Lens { radius, focus } = self.lens;
        let off = |depth: f32| (1.0 / focus - 1.0 / depth.max(self.near)).abs();
        2.0 * radius * self.focal * off(near).max(off(far))
    }

    /// Blur of what is infinitely far, in pixels, as the backdrop's focal length shows it.
    pub fn backdrop_blur(&self) -> f32 {
        2.0 * self.lens.radius * self.backdrop_focal / self.lens.focus
    }

    /// Where the optical axis meets the picture; pixel centres are at integers.
    pub fn principal_point(&self) -> [f32; 2] {
        [
            (self.width as f32 - 1.0) / 2.0 + self.shift.x,
            (self.height as f32 - 1.0) / 2.0 + self.shift.y,
        ]
    }

    /// Unit direction in the world of a pixel's centre.
    pub fn ray(&self, x: usize, y: usize) -> Vec3 {
        let [cx, cy] = self.principal_point();
        let view = Vec3::new(x as f32 - cx, y as f32 - cy, self.focal);
        (self.view_from_world.transpose() * view).normalize()
    }

    /// Ray through the backdrop's focal length.
    pub fn backdrop_ray(&self, x: usize, y: usize) -> Vec3 {
        // What a lens shifts, it shifts as far as the focal length is.
        let aside = self.shift * (self.backdrop_focal / self.focal - 1.0);
        let [cx, cy] = self.principal_point();
        let (x, y) = (x as f32 - cx - aside.x, y as f32 - cy - aside.y);
        let view = Vec3::new(x, y, self.backdrop_focal);
        (self.view_from_world.transpose() * view).normalize()
    }

    /// Where a point is in the picture, and its depth; meaningful for positive depths.
    pub fn project(&self, point: Vec3) -> ([f32; 2], f32) {
        let view = self.view_from_world * (point - self.eye);
        let [cx, cy] = self.principal_point();
        let scale = self.focal / view.z;
        ([view.x * scale + cx, view.y * scale + cy], view.z)
    }
}

/// Unit vector of an azimuth and an elevation in radians, in the Z-up world.
fn direction(azimuth: f64, elevation: f64) -> DVec3 {
    (elevation.cos() * DVec2::from_angle(azimuth)).extend(elevation.sin())
}

/// Between neighbours on a sunflower, in radians.
const GOLDEN_ANGLE: f32 = 2.399_963_2;

/// Elevation of a turntable's cameras over the object, in degrees.
const TURNTABLE_ELEVATION: f64 = 20.0;

/// `count` cameras around an object, all at the distance at which it fills most of the picture.
pub fn turntable(
    cloud: &SurfelCloud,
    count: usize,
    fov_x: f64,
    size: [usize; 2],
    near: f32,
) -> Vec<Camera> {
    let bounds = cloud.bounds();
    let asset_from_world = cloud.up.asset_from_world();
    let elevation = TURNTABLE_ELEVATION.to_radians();
    let towards: Vec<Vec3> = (0..count)
        .map(|i| {
            let azimuth = std::f64::consts::TAU * i as f64 / count as f64;
            (asset_from_world * direction(azimuth, elevation)).as_vec3()
        })
        .collect();
    let camera = |towards: Vec3, distance: f32| {
        let eye = bounds.center + towards * distance;
        Camera::look_at(eye, bounds.center, cloud.up.direction(), fov_x, size, near)
    };
    // A few of the views decide.
    let distance = towards
        .iter()
        .step_by(count.div_ceil(16).max(1))
        .map(|t| fitting_distance(&cloud.positions, &bounds, &camera(*t, 1.0), *t))
        .fold(0f32, f32::max);
    towards.iter().map(|t| camera(*t, distance)).collect()
}

/// The pose that shows all of an object's points, with room around them for what lies over the picture, from a direction, its picture `size` pixels.
pub fn framed(
    points: &[Vec3],
    up: UpAxis,
    bounds: &Bounds,
    pose: &CameraPose,
    size: [usize; 2],
) -> CameraPose {
    let mut pose = CameraPose {
        pivot: bounds.center,
        distance: 1.0,
        orthographic: false,
        ..*pose
    };
    let camera = Camera::from_pose(&pose, up, size, bounds.radius);
    let towards = (camera.eye - bounds.center).normalize_or(Vec3::X);
    pose.distance = ROOM * fitting_distance(points, bounds, &camera, towards);
    pose
}

/// Degrees of a first look: enough of the light's own place behind the object to know it.
pub const FIELD_OF_VIEW: f64 = 40.0;

/// Factor of the least distance, for room around the object.
const ROOM: f32 = 1.15;

/// The pose of a first look: from the front, a little from the right and above.
pub fn first_pose(points: &[Vec3], up: UpAxis, bounds: &Bounds, size: [usize; 2]) -> CameraPose {
    let pose = CameraPose::around(bounds, -60.0, 10.0, 1.0, FIELD_OF_VIEW);
    framed(points, up, bounds, &pose, size)
}

/// Distance from the object's centre from which a camera in direction `towards` sees all of it; floaters do not count.
fn fitting_distance(points: &[Vec3], bounds: &Bounds, camera: &Camera, towards: Vec3) -> f32 {
    let slope = |pixels: usize| 0.92 * 0.5 * pixels as f32 / camera.focal;
    let (across, down) = (slope(camera.width), slope(camera.height));
    let needed = points
        .iter()
        .map(|p| *p - bounds.center)
        .filter(|p| p.length() <= bounds.radius)
        .map(|p| {
            let view = camera.view_from_world * p;
            p.dot(towards) + (view.x.abs() / across).max(view.y.abs() / down)
        })
        .fold(0f32, f32::max);
    // Where everything lies in one point, any distance will do but none.
    needed.max(0.1 * bounds.radius)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// However it is held: upright, rolled, straight down.
    #[test]
    fn a_camera_has_a_pose_that_is_that_camera() {
        let place = Vec3::new(1.0, -2.0, 0.5);
        for (_, up) in UpAxis::ALL {
            for (azimuth, elevation, roll) in [
                (30.0, 20.0, 0.0),
                (-170.0, -60.0, 35.0),
                (100.0, 90.0, 0.0),
                (10.0, 5.0, -170.0),
            ] {
                let pose = CameraPose {
                    pivot: place,
                    azimuth,
                    elevation,
                    distance: 4.0,
                    fov: 50.0,
                    orthographic: false,
                    roll,
                    aperture: 0.01,
                };
                let camera = Camera::from_pose(&pose, up, [300, 200], 1.0);
                let found = CameraPose::of(&camera, up, place);
                let again = Camera::from_pose(&found, up, [300, 200], 1.0);
                assert!((found.fov - 50.0).abs() < 1e-3 && (found.roll - roll).abs() < 1e-3);
                assert!((found.aperture - 0.01).abs() < 1e-6);
                assert!(again.eye.distance(camera.eye) < 1e-4, "{found:?}");
                let axes = [again, camera].map(|c| c.view_from_world);
                assert!(axes[0].abs_diff_eq(axes[1], 1e-5), "{pose:?} {found:?}");
            }
        }
        // Clockwise: what was above is to the left of it.
        let mut pose = CameraPose::of(
            &Camera::look_at(
                Vec3::new(4.0, 0.0, 0.0),
                Vec3::ZERO,
                Vec3::Z,
                1.0,
                [80, 80],
                0.1,
            ),
            UpAxis::PlusZ,
            Vec3::ZERO,
        );
        pose.roll = 90.0;
        let camera = Camera::from_pose(&pose, UpAxis::PlusZ, [80, 80], 1.0);
        let ([x, _], _) = camera.project(Vec3::Z);
        assert!(x < 39.0, "{x}");
    }

    #[test]
    fn looks_where_it_is_told() {
        let camera = Camera::look_at(
            Vec3::new(3.0, 0.0, 0.0),
            Vec3::ZERO,
            Vec3::Z,
            0.7,
            [101, 51],
            0.1,
        );
        assert!(camera.ray(50, 25).distance(Vec3::NEG_X) < 1e-6);
        // Looking along -X with Z up, the right of the picture is +Y, and its top is +Z.
        assert!(camera.ray(100, 25).y > 0.2);
        assert!(camera.ray(50, 0).z > 0.05);
        let edge = camera.ray(100, 25);
        // Half the field of view, less half a pixel.
        assert!((edge.y.atan2(-edge.x) - 0.35).abs() < 0.01);
    }

    /// Perspective or not: what is in focus stays, and what is not is spread as widely as is told.
    #[test]
    fn a_lens_keeps_what_is_in_focus() {
        for orthographic in [false, true] {
            let pose = CameraPose {
                pivot: Vec3::new(0.5, -1.0, 2.0),
                azimuth: 40.0,
                elevation: 25.0,
                distance: 4.0,
                fov: 40.0,
                orthographic,
                roll: 10.0,
                aperture: 0.03,
            };
            let camera = Camera::from_pose(&pose, UpAxis::PlusZ, [400, 300], 1.0);
            let forward = camera.view_from_world.row(2);
            let spread = |place: Vec3| {
                let seen: Vec<Vec2> = camera
                    .through_lens(200)
                    .map(|c| Vec2::from(c.project(place).0))
                    .collect();
                let apart = |a: &Vec2| seen.iter().map(|b| a.distance(*b)).fold(0f32, f32::max);
                seen.iter().map(apart).fold(0f32, f32::max)
            };
            // A diagonal of a pixel, by which edges are smooth.
            let smooth = 2f32.sqrt() + 0.1;
            let aside = camera.view_from_world.row(0) * 0.4;
            assert!(spread(pose.pivot + aside) < smooth);
            for away in [-1.0, 1.5] {
                let place = pose.pivot + forward * away + aside;
                let depth = camera.project(place).1;
                let told = camera.blur([depth, camera.lens.focus]);
                let found = spread(place);
                assert!(
                    told > 5.0 && (found - told).abs() < smooth,
                    "{told} {found}"
                );
            }
            // And so is what is infinitely far, whose rays the pixel in the middle meets.
            let rays: Vec<Vec3> = camera
                .through_lens(200)
                .map(|c| c.backdrop_ray(200, 150))
                .collect();
            let apart = |a: &Vec3| rays.iter().map(|b| a.distance(*b)).fold(0f32, f32::max);
            let found = rays.iter().map(apart).fold(0f32, f32::max) * camera.backdrop_focal;
            let told = camera.backdrop_blur();
            assert!(
                told > 5.0 && (found - told).abs() < smooth,
                "{told} {found}"
            );
        }
    }

    #[test]
    fn a_turntable_shows_all_of_the_object_and_not_much_more() {
        let cloud = crate::synthetic::sphere(500);
        for size in [[100, 100], [160, 90], [90, 160]] {
            for camera in turntable(&cloud, 5, 0.7, size, 0.02) {
                let half = size[0].min(size[1]) as f32 / 2.0;
                let reach = cloud
                    .positions
                    .iter()
                    .map(|p| {
                        let view = camera.view_from_world * (*p - camera.eye);
                        (view.truncate() * camera.focal / view.z)
                            .abs()
                            .max_element()
                    })
                    .fold(0f32, f32::max);
                assert!(
                    (0.85 * half..half).contains(&reach),
                    "{size:?}: {reach} of {half}"
                );
            }
        }
    }
}
