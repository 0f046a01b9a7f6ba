//! Object of a scene: a splat, how it is read, where it stands, and its capture light.

use std::path::{Path, PathBuf};

use glam::{Affine3A, DVec3, Quat, Vec3};
use serde::{Deserialize, Serialize};

use super::cut::{Cut, FARTHEST, MOST_CUTS};
use super::light::EnvironmentLight;
use crate::error::{Result, ensure};
use crate::response::CameraResponse;
use crate::surfels::{SurfelCloud, SurfelFilter, UpAxis};

/// The most objects of a scene.
pub const MOST_OBJECTS: usize = 256;

/// The most places that may be said to see the outside: each costs a pass over the asset.
pub const MOST_PLACES: usize = 32;

/// Range of an object's scale.
pub const SCALES: std::ops::RangeInclusive<f32> = 1e-6..=1e6;

/// A splat in a scene.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Object {
    /// Name, where that is not its file's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Its file; none where the scene is for any.
    pub asset: Option<PathBuf>,
    /// Cuts that leave the object of the file's splat. It was captured beside the rest, which shaded it and shone on it.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub cut: Vec<Cut>,
    /// True where it is there at all: what is not shown neither casts a shadow nor shines on anything.
    pub shown: bool,
    /// True where it stays where it stands.
    pub locked: bool,
    /// Offset from the scene's places to the coordinates of its file: zero but for a splat that lies far from their origin.
    #[serde(skip_serializing_if = "is_none")]
    pub origin: DVec3,
    /// The asset's up axis, where the file's own is not to be believed.
    pub up: Option<UpAxis>,
    /// Response of the camera that it was captured with. Earlier files say of it whether the colour is linear.
    #[serde(
        alias = "linear",
        skip_serializing_if = "CameraResponse::is_default",
        deserialize_with = "CameraResponse::of_file"
    )]
    pub response: CameraResponse,
    /// Places, in the asset's coordinates, that see its outside: where which side of a surface is its front could not be told.
    pub outside_from: Vec<Vec3>,
    /// Where it stands.
    pub transform: Transform,
    /// The light that it was captured under.
    pub source: EnvironmentLight,
    /// Filters of surfels that are not drawn.
    pub hide: SurfelFilter,
}

impl Default for Object {
    fn default() -> Self {
        Self {
            name: None,
            asset: None,
            cut: Vec::new(),
            shown: true,
            locked: false,
            origin: DVec3::ZERO,
            up: None,
            response: CameraResponse::default(),
            outside_from: Vec::new(),
            transform: Transform::default(),
            source: EnvironmentLight::default(),
            hide: SurfelFilter::default(),
        }
    }
}

fn is_none(origin: &DVec3) -> bool {
    *origin == DVec3::ZERO
}

impl Object {
    /// Takes over another origin of its splat, in a scene that is moved by a step: it stands where it stood, cut and seen as before.
    pub fn take_origin(&mut self, origin: DVec3, scene_step: DVec3) {
        let moved = origin - self.origin;
        let place = |place: &mut Vec3| *place = (place.as_dvec3() - moved).as_vec3();
        for cut in &mut self.cut {
            place(&mut cut.min);
            place(&mut cut.max);
            if let Some(support) = &mut cut.support {
                let raised = moved.dot(support.up.direction().as_dvec3());
                for height in [&mut support.height, &mut support.residue_up_to] {
                    *height = (f64::from(*height) - raised) as f32;
                }
            }
        }
        self.outside_from.iter_mut().for_each(place);
        let there =
            self.transform.moved(moved) + scene_step + self.transform.translation.as_dvec3();
        self.transform.translation = there.as_vec3();
        self.origin = origin;
    }

    /// Applies the settings of reading the file: that makes a cloud of it, which stays whatever else is set.
    pub fn apply_to(&self, cloud: &mut SurfelCloud) {
        self.response.decode(cloud);
        cloud.outside_from.clone_from(&self.outside_from);
    }

    /// Name: the user's, or that of its file without the ending.
    pub fn called(&self) -> Option<String> {
        let stem = || self.asset.as_deref().map(splat_name);
        let given = self.name.clone().filter(|name| !name.trim().is_empty());
        given.or_else(stem)
    }

    /// True where it is as it was captured, with no settings that are for several.
    pub fn is_where_it_was_captured(&self) -> bool {
        let is_plain = self.name.is_none() && self.shown && !self.locked && self.cut.is_empty();
        is_plain && is_none(&self.origin) && self.transform == Transform::default()
    }

    pub(super) fn validate(&self) -> Result<()> {
        let is_place = |p: &Vec3| p.abs().max_element() <= FARTHEST;
        let places = &self.outside_from;
        ensure(
            places.len() <= MOST_PLACES && places.iter().all(is_place),
            || {
                format!(
                    "outside_from: up to {MOST_PLACES} places of three numbers up to {FARTHEST:e} are expected"
                )
            },
        )?;
        ensure(self.cut.len() <= MOST_CUTS, || {
            format!("cut: up to {MOST_CUTS} boxes are expected")
        })?;
        for cut in &self.cut {
            cut.validate()?;
        }
        ensure(
            self.origin.abs().max_element() <= f64::from(FARTHEST),
            || format!("origin: three numbers up to {FARTHEST:e} are expected"),
        )?;
        self.response.validate()?;
        self.transform.validate()?;
        self.hide.validate()?;
        // What a capture was made under is told by a map of it.
        ensure(self.source.sky().is_none(), || {
            "the light of sun and sky is one to relight by; of a capture, write it to a file first"
                .into()
        })?;
        self.source.validate("source")
    }
}

/// From an object's own coordinates to the scene's: scaled, turned, moved.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Transform {
    /// Factor of lengths.
    pub scale: f32,
    /// After the scale: a unit quaternion x, y, z, w.
    pub rotation: Quat,
    /// In scene units.
    pub translation: Vec3,
}

impl Transform {
    /// From the object's coordinates to the scene's, which are those of the first object as it was captured.
    pub fn scene_from_object(&self) -> Affine3A {
        let scale = Vec3::splat(self.scale);
        Affine3A::from_scale_rotation_translation(scale, self.rotation, self.translation)
    }

    /// A step in the object's coordinates as one in the scene's.
    pub(super) fn moved(&self, step: DVec3) -> DVec3 {
        f64::from(self.scale) * (self.rotation.as_dquat() * step)
    }

    /// An object's splat where it stands; highlights turn with it.
    pub fn place(&self, cloud: &SurfelCloud) -> SurfelCloud {
        cloud.transformed(self.scene_from_object())
    }

    /// Checks ranges.
    ///
    /// # Errors
    /// Says what is expected.
    pub fn validate(&self) -> Result<()> {
        ensure(SCALES.contains(&self.scale), || {
            let (low, high) = SCALES.into_inner();
            format!("scale {} is out of range {low} to {high}", self.scale)
        })?;
        ensure(self.rotation.is_normalized(), || {
            let [x, y, z, w] = self.rotation.to_array();
            format!(
                "rotation [{x}, {y}, {z}, {w}] is no unit quaternion x, y, z, w: the sum of its squares is to be 1"
            )
        })?;
        ensure(self.translation.abs().max_element() <= FARTHEST, || {
            let [x, y, z] = self.translation.to_array();
            format!("translation [{x}, {y}, {z}]: three numbers up to {FARTHEST:e} are expected")
        })
    }
}

impl Default for Transform {
    /// Where it was captured.
    fn default() -> Self {
        Self {
            scale: 1.0,
            rotation: Quat::IDENTITY,
            translation: Vec3::ZERO,
        }
    }
}

/// The name of a splat's file without its ending; of a folder that is one, its name.
pub fn splat_name(path: &Path) -> String {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let folder = path.parent().and_then(Path::file_name);
    match folder.filter(|_| path.ends_with("meta.json")) {
        Some(folder) => folder.to_string_lossy().into(),
        None => stem.strip_suffix(".compressed").unwrap_or(&stem).into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::present::PLAIN;
    use crate::rasterize::shade;
    use crate::synthetic;

    fn somewhere() -> Transform {
        Transform {
            scale: 1.7,
            rotation: Quat::from_euler(glam::EulerRot::XYZ, 0.3, 1.2, -2.0),
            translation: Vec3::new(0.4, -3.0, 2.0),
        }
    }

    #[test]
    fn an_object_that_is_turned_shows_the_same_to_an_eye_that_is_turned_with_it() {
        let cloud = synthetic::glossy_sphere_over_plate(200, 3);
        let (transform, eye) = (somewhere(), Vec3::new(2.0, -1.5, 3.0));
        let (placed, scene_from_object) = (transform.place(&cloud), transform.scene_from_object());
        let seen =
            |c: &SurfelCloud, eye| shade(&c.positions, &c.sh, c.sh_degree, c.encoding, eye, PLAIN);
        let there = scene_from_object.transform_point3(eye);
        for (a, b) in seen(&cloud, eye).iter().zip(seen(&placed, there)) {
            assert!((0..3).all(|c| (a[c] - b[c]).abs() < 1e-4), "{a:?} {b:?}");
        }
        for i in 0..cloud.len() {
            let normal = transform.rotation * cloud.stored_normal(i);
            assert!(placed.stored_normal(i).distance(normal) < 1e-5);
            let place = scene_from_object.transform_point3(cloud.positions[i]);
            assert!(placed.positions[i].distance(place) < 1e-5);
            assert!(placed.scales[i].distance(1.7 * cloud.scales[i]) < 1e-6);
        }
    }

    /// What a scene says in a georeferenced file's coordinates is said of the same places once they are relative to a point in it.
    #[test]
    fn another_origin_changes_no_place() {
        let far = DVec3::new(500_000.0, 5_600_000.0, 300.0);
        let mut scene = crate::scene::Scene::default();
        let places = |scene: &crate::scene::Scene| {
            let origin = scene.objects[0].origin;
            let of = |o: &Object, place: Vec3| {
                let there = o.transform.scene_from_object().as_daffine3();
                origin + there.transform_point3(place.as_dvec3())
            };
            let [first, second] = [&scene.objects[0], &scene.objects[1]];
            let camera = scene
                .camera
                .map_or(DVec3::ZERO, |c| c.pivot.as_dvec3() + origin);
            let support = first.cut[0].support.expect("it has one");
            let surface = of(first, Vec3::new(0.0, 0.0, support.height))
                .with_x(0.0)
                .with_y(0.0);
            [
                of(first, first.cut[0].min),
                surface,
                of(second, Vec3::ONE),
                camera,
            ]
        };
        scene.objects[0].cut.push(Cut {
            keep: crate::scene::Keep::Inside,
            min: far.as_vec3(),
            max: far.as_vec3() + 2.0,
            support: Some(crate::scene::Support {
                up: UpAxis::PlusZ,
                height: far.z as f32 + 0.5,
                residue_up_to: far.z as f32 + 0.6,
            }),
        });
        scene.objects.push(Object {
            transform: Transform {
                translation: far.as_vec3() + Vec3::new(3.0, 0.0, 0.5),
                ..somewhere()
            },
            ..Object::default()
        });
        let around = crate::surfels::Bounds {
            center: far.as_vec3(),
            radius: 2.0,
        };
        scene.camera = Some(crate::camera::CameraPose::around(
            &around, 10.0, 20.0, 2.0, 40.0,
        ));
        let before = places(&scene);
        let moved = scene.take_origin(0, far, UpAxis::PlusZ);
        assert_eq!((moved, scene.objects[0].origin), (-far, far));
        // Those that were said in 32 bits were off by up to a half.
        for (a, b) in before.into_iter().zip(places(&scene)) {
            assert!(a.distance(b) < 1e-3, "{a} {b}");
        }
        assert_eq!(scene.objects[0].transform, Transform::default());
        assert_eq!(scene.take_origin(0, far, UpAxis::PlusZ), DVec3::ZERO);
    }

    #[test]
    fn transforms_that_are_none_are_refused() {
        let refused = |change: fn(&mut Transform)| {
            let mut object = Object {
                transform: somewhere(),
                ..Object::default()
            };
            assert!(object.validate().is_ok());
            change(&mut object.transform);
            object.validate().is_err()
        };
        assert!(refused(|t| t.scale = 0.0) && refused(|t| t.scale = f32::NAN));
        assert!(refused(|t| t.rotation = Quat::from_xyzw(0.0, 0.0, 0.0, 2.0)));
        assert!(refused(|t| t.translation.x = f32::INFINITY));
    }
}
