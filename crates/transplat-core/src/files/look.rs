//! Look: a scene saved as readable JSON. Settings of a single object that stands where it was captured lie at the top level, beside the scene's.

use std::io::Write;
use std::path::{Path, PathBuf};

use glam::{DVec3, Vec3};
use serde::{Deserialize, Serialize};

use super::decode;
use super::kind::{FileKind, expect_json, file_kind};
use super::read::read_all;
use super::write::{folder_of, write_atomically};
use crate::camera::CameraPose;
use crate::color::Display;
use crate::error::{self, Error};
use crate::images::Layout;
use crate::present::{Background, View};
use crate::response::CameraResponse;
use crate::scene::{
    Animation, Bookmark, Cut, EnvironmentLight, Light, MOST_OBJECTS, Object, Rig, Scene, Variant,
    is_file,
};
use crate::settings::{Method, TransferSettings};
use crate::surfels::{SurfelFilter, UpAxis};

/// The version of looks that this program writes; it reads all up to it.
const LOOK_VERSION: u32 = 7;

/// The version of those whose splats have no camera response other than sRGB, whose capture lights have no user-set trust, and whose cuts have no support.
const VERSION_WITHOUT_RESPONSE: u32 = 6;

/// The version of those that name neither a layer of a light's file nor a cube below each other, and none of whose splats has an origin.
const VERSION_WITHOUT_LAYERS: u32 = 5;

/// The version of those that have neither lights beside the environment nor a sky nor keys of the light, and the suns of their pictures.
const VERSION_WITHOUT_LIGHTS: u32 = 4;

/// The version of those that keep neither a note nor views nor other looks, and have neither a table of colours nor a lens.
const VERSION_OF_SEVERAL: u32 = 3;

/// The version of those among them that hold one object where it was captured, and neither a plate nor a rolled camera.
const VERSION_OF_ONE: u32 = 2;

/// The file; what it leaves out keeps its default. What the fields are: [`Scene`], [`Object`].
#[derive(Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct Look {
    version: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    objects: Option<Vec<Object>>,
    // Of the one object.
    #[serde(skip_serializing_if = "Option::is_none")]
    asset: Option<PathBuf>,
    /// Read where it is said; one that is cut is listed.
    #[serde(skip_serializing_if = "Option::is_none")]
    cut: Option<Vec<Cut>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    up: Option<UpAxis>,
    #[serde(
        alias = "linear",
        skip_serializing_if = "CameraResponse::is_default",
        deserialize_with = "CameraResponse::of_file"
    )]
    response: CameraResponse,
    #[serde(skip_serializing_if = "Option::is_none")]
    outside_from: Option<Vec<Vec3>>,
    #[serde(skip_serializing_if = "Option::is_none")]
    source: Option<EnvironmentLight>,
    #[serde(skip_serializing_if = "Option::is_none")]
    hide: Option<SurfelFilter>,
    // Of the scene.
    directions: usize,
    target: EnvironmentLight,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    lights: Vec<Light>,
    #[serde(skip_serializing_if = "Animation::is_empty")]
    animation: Animation,
    match_strength: bool,
    transfer: TransferSettings,
    display: Display,
    #[serde(skip_serializing_if = "Option::is_none")]
    lut: Option<PathBuf>,
    false_color: bool,
    view: View,
    wipe: f32,
    difference_scale: f32,
    background: Background,
    #[serde(skip_serializing_if = "Option::is_none")]
    plate: Option<PathBuf>,
    background_blur: f32,
    shadow_catcher: bool,
    camera: Option<CameraPose>,
    #[serde(skip_serializing_if = "String::is_empty")]
    note: String,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    bookmarks: Vec<Marked>,
    #[serde(skip_serializing_if = "Vec::is_empty")]
    variants: Vec<Kept>,
}

/// True where a scene has lights as looks have them from version 5 on.
fn is_lit_anew(scene: &Scene) -> bool {
    let environment = &scene.environment;
    let has_sky = environment.sky().is_some() || environment.without_suns;
    has_sky || !scene.lights.is_empty() || !scene.animation.is_empty()
}

/// True where a scene has readings of files that older looks lack.
fn is_read_anew(scene: &Scene) -> bool {
    let is_new = |light: &EnvironmentLight| {
        light.layer.is_some() || light.layout == Some(Layout::CubeColumn)
    };
    let has_origin = |object: &Object| object.origin != DVec3::ZERO;
    scene.environment_lights().any(is_new) || scene.objects.iter().any(has_origin)
}

/// A [`Bookmark`].
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Marked {
    name: String,
    camera: CameraPose,
}

/// A [`Variant`].
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Kept {
    name: String,
    look: Look,
}

impl Default for Look {
    fn default() -> Self {
        Self::of_none(Scene::default())
    }
}

impl Look {
    /// Without its object.
    fn of_none(scene: Scene) -> Self {
        let mut look = Self::of(scene);
        look.response = CameraResponse::default();
        (look.outside_from, look.source, look.hide) = (None, None, None);
        look
    }

    fn of(scene: Scene) -> Self {
        let is_of_newest = is_lit_anew(&scene);
        let is_read_anew =
            is_read_anew(&scene) || scene.variants.iter().any(|v| is_read_anew(&v.look));
        let mut objects = scene.objects;
        let has_capture_settings = objects.iter().any(|o| {
            let has_support = o.cut.iter().any(|cut| cut.support.is_some());
            !o.response.is_default() || o.source.trust.is_some() || has_support
        });
        let is_one = objects.len() == 1 && objects[0].is_where_it_was_captured();
        let one = objects.pop_if(|_| is_one);
        let of_one = one.clone().unwrap_or_default();
        let is_rolled = scene.camera.is_some_and(|c| c.roll != 0.0);
        let is_new = !is_one || is_rolled || scene.plate.is_some();
        let has_plate = scene.background == Background::Backplate;
        let keeps = !scene.bookmarks.is_empty() || !scene.variants.is_empty();
        let has_lens = scene.camera.is_some_and(|c| c.aperture != 0.0);
        let is_newest = keeps || has_lens || scene.lut.is_some() || !scene.note.is_empty();
        let mark = |Bookmark { name, camera }| Marked { name, camera };
        let keep = |Variant { name, look }| Kept {
            name,
            look: Self::of_none(look),
        };
        Self {
            version: if has_capture_settings {
                LOOK_VERSION
            } else if is_read_anew {
                VERSION_WITHOUT_RESPONSE
            } else if is_of_newest || scene.variants.iter().any(|v| is_lit_anew(&v.look)) {
                VERSION_WITHOUT_LAYERS
            } else if is_newest {
                VERSION_WITHOUT_LIGHTS
            } else if is_new || has_plate {
                VERSION_OF_SEVERAL
            } else {
                VERSION_OF_ONE
            },
            objects: Some(objects).filter(|_| !is_one),
            asset: of_one.asset,
            cut: None,
            up: of_one.up,
            response: of_one.response,
            outside_from: one.as_ref().map(|o| o.outside_from.clone()),
            source: one.as_ref().map(|o| o.source.clone()),
            hide: one.map(|o| o.hide),
            directions: scene.directions,
            target: scene.environment,
            lights: scene.lights,
            animation: scene.animation,
            match_strength: scene.match_strength,
            transfer: scene.transfer,
            display: scene.display,
            lut: scene.lut,
            false_color: scene.false_color,
            view: scene.view,
            wipe: scene.wipe,
            difference_scale: scene.difference_scale,
            background: scene.background,
            plate: scene.plate,
            background_blur: scene.background_blur,
            shadow_catcher: scene.shadow_catcher,
            camera: scene.camera,
            note: scene.note,
            bookmarks: scene.bookmarks.into_iter().map(mark).collect(),
            variants: scene.variants.into_iter().map(keep).collect(),
        }
    }

    fn scene(self) -> Result<Scene, String> {
        let says_of_one = self.asset.is_some()
            || self.cut.is_some()
            || self.up.is_some()
            || !self.response.is_default()
            || self.outside_from.is_some()
            || self.source.is_some()
            || self.hide.is_some();
        let objects = match self.objects {
            Some(_) if says_of_one => {
                return Err(
                    "where objects are listed, each has its own asset, cut, source, up, response, outside_from and hide"
                        .into(),
                );
            }
            Some(listed) if !(1..=MOST_OBJECTS).contains(&listed.len()) => {
                return Err(format!("1 to {MOST_OBJECTS} objects are expected"));
            }
            // One may be for whatever splat is open.
            Some(listed) if listed.len() > 1 && listed.iter().any(|o| o.asset.is_none()) => {
                return Err("where several objects are listed, each has its asset".into());
            }
            Some(listed) => listed,
            None => vec![Object {
                asset: self.asset,
                cut: self.cut.unwrap_or_default(),
                up: self.up,
                response: self.response,
                outside_from: self.outside_from.unwrap_or_default(),
                source: self.source.unwrap_or_default(),
                hide: self.hide.unwrap_or_default(),
                ..Object::default()
            }],
        };
        let mark = |Marked { name, camera }| Bookmark { name, camera };
        let keep = |Kept { name, look }| {
            let look = look.scene()?;
            Ok(Variant { name, look })
        };
        let variants: Result<_, String> = self.variants.into_iter().map(keep).collect();
        Ok(Scene {
            objects,
            environment: self.target,
            lights: self.lights,
            animation: self.animation,
            match_strength: self.match_strength,
            directions: self.directions,
            transfer: self.transfer,
            display: self.display,
            lut: self.lut,
            false_color: self.false_color,
            view: self.view,
            wipe: self.wipe,
            difference_scale: self.difference_scale,
            background: self.background,
            plate: self.plate,
            background_blur: self.background_blur,
            shadow_catcher: self.shadow_catcher,
            camera: self.camera,
            note: self.note,
            bookmarks: self.bookmarks.into_iter().map(mark).collect(),
            variants: variants?,
        })
    }
}

/// Loads a rig of lights from a file of its own; the environment in it is as it is named there.
///
/// # Errors
/// The file cannot be read or is no rig.
pub fn load_rig(path: &Path) -> error::Result<Rig> {
    expect_json(path, "a rig of lights")?;
    let text = read_all(path, 1 << 24)?;
    let rig: Rig = decode::json(&text).map_err(|why| match parse(&text) {
        Ok(_) => Error::invalid(path, "a look, where a rig of lights is expected"),
        Err(_) => Error::invalid(path, format!("not a rig: {why}")),
    })?;
    rig.validate()
        .map_err(|e| Error::invalid(path, e.to_string()))?;
    Ok(rig)
}

/// Writes a rig of lights to a file of its own.
///
/// # Errors
/// The file cannot be written; one that was there before is still there then.
pub fn save_rig(path: &Path, rig: &Rig) -> error::Result<()> {
    let text = serde_json::to_string_pretty(rig);
    let text = text.map_err(|e| Error::invalid(path, e.to_string()))?;
    write_atomically(path, |out| writeln!(out, "{text}"))
}

/// Loads a saved look; its paths are resolved against its own folder.
///
/// # Errors
/// The file cannot be read, is no look, or a setting is out of range.
pub fn load_look(path: &Path) -> error::Result<Scene> {
    if file_kind(path).is_ok_and(|kind| kind == FileKind::Rig) {
        let message = "a rig of lights, where a look is expected (--rig takes it)";
        return Err(Error::invalid(path, message));
    }
    expect_json(path, "a look")?;
    let scene = parse(&read_all(path, 1 << 24)?).map_err(|e| Error::invalid(path, e))?;
    let folder = path.parent().unwrap_or(Path::new(""));
    // Without `..` where it can be: a path is compared with others.
    Ok(with_paths(scene, |path| {
        let whole = folder.join(path);
        // As it is, or as a look has it that was written on Windows.
        let other = path
            .to_str()
            .map(|path| folder.join(path.replace('\\', "/")));
        let found = whole.canonicalize().ok();
        let found = found.or_else(|| other?.canonicalize().ok());
        found.unwrap_or(whole)
    }))
}

/// Writes a look, its paths relative to where it is written.
///
/// # Errors
/// The file cannot be written; one that was there before is still there then.
pub fn save_look(path: &Path, scene: &Scene) -> error::Result<()> {
    let scene = with_paths(scene.clone(), |file| relative(file, folder_of(path)));
    let text = look_text(&scene).map_err(|e| Error::invalid(path, e))?;
    write_atomically(path, |out| writeln!(out, "{text}"))
}

/// A scene as a look, its paths as they are.
///
/// # Errors
/// A path is not of characters.
pub fn look_text(scene: &Scene) -> Result<String, String> {
    serde_json::to_string_pretty(&Look::of(scene.clone())).map_err(|e| e.to_string())
}

fn parse(text: &[u8]) -> Result<Scene, String> {
    let look: Look = decode::json(text).map_err(|e| {
        // Most looks that are written by a program have one.
        let is_versioned =
            decode::json(text).is_ok_and(|value: serde_json::Value| value.get("version").is_some());
        match is_versioned {
            true => format!("not a look: {e}"),
            false => format!("neither a look nor a rig of lights: {e}"),
        }
    })?;
    let version = look.version;
    if !(1..=LOOK_VERSION).contains(&version) {
        return Err(format!(
            "a look of version {version}; this program reads versions up to {LOOK_VERSION}"
        ));
    }
    if version < VERSION_OF_SEVERAL && look.objects.is_some() {
        return Err(format!(
            "a look that lists objects is of version {VERSION_OF_SEVERAL}"
        ));
    }
    let mut scene = look.scene()?;
    // In the first version there was one method, and nothing to name it.
    let names_preset = |look: serde_json::Value| look.pointer("/transfer/preset").is_some();
    if version == 1 && !decode::json(text).is_ok_and(names_preset) {
        scene.transfer.method = Method::Harmonic;
    }
    scene.validate().map_err(|e| e.to_string())?;
    Ok(scene)
}

fn with_paths(mut scene: Scene, change: impl Fn(&Path) -> PathBuf) -> Scene {
    change_paths(&mut scene, &change);
    scene
}

fn change_paths(scene: &mut Scene, change: &impl Fn(&Path) -> PathBuf) {
    let of_objects = scene
        .objects
        .iter_mut()
        .flat_map(|o| [&mut o.asset, &mut o.source.file]);
    for path in of_objects.chain([&mut scene.environment.file]).flatten() {
        if is_file(path) {
            *path = change(path);
        }
    }
    for path in [&mut scene.plate, &mut scene.lut].into_iter().flatten() {
        *path = change(path);
    }
    for variant in &mut scene.variants {
        change_paths(&mut variant.look, change);
    }
}

/// `path` as seen from `folder`, with `..` where needed; as it is where the two have no root in common.
fn relative(path: &Path, folder: &Path) -> PathBuf {
    let whole = |p: &Path| p.canonicalize().or_else(|_| std::path::absolute(p));
    let (Ok(path_whole), Ok(folder)) = (whole(path), whole(folder)) else {
        return path.to_owned();
    };
    let common = path_whole
        .components()
        .zip(folder.components())
        .take_while(|(a, b)| a == b)
        .count();
    // Only the root in common: the path says more as it is.
    if common < 2 {
        return path_whole;
    }
    let up = folder.components().count() - common;
    std::iter::repeat_n(Path::new("..").as_os_str(), up)
        .chain(path_whole.components().skip(common).map(|c| c.as_os_str()))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::response::ResponseCurve;
    use crate::scene::EVEN;
    use crate::settings::Method;
    use crate::surfels::{Bounds, UpAxis};

    #[test]
    fn an_origin_and_a_layer_come_back() {
        let mut scene = Scene::default();
        scene.objects[0].asset = Some("a.ply".into());
        scene.objects[0].origin = DVec3::new(500_123.25, 5_600_456.5, 312.0);
        scene.environment.set_file("a.exr".into());
        scene.environment.layer = Some("view.Combined".into());
        let text = look_text(&scene).expect("of characters");
        assert!(text.contains("\"version\": 6"), "{text}");
        assert_eq!(parse(text.as_bytes()), Ok(scene));
    }

    #[test]
    fn a_camera_response_comes_back_and_older_looks_say_whether_colour_is_linear() {
        let mut scene = Scene::default();
        scene.objects[0].response = CameraResponse {
            curve: ResponseCurve::Aces,
            contrast: 1.25,
        };
        scene.objects[0].source.trust = Some(0.75);
        let text = look_text(&scene).expect("of characters");
        assert!(text.contains("\"version\": 7"), "{text}");
        assert_eq!(parse(text.as_bytes()), Ok(scene));
        for (said, response) in [
            ("true", CameraResponse::LINEAR),
            ("false", CameraResponse::default()),
        ] {
            let one = format!(r#"{{"version": 2, "linear": {said}}}"#);
            let listed = format!(r#"{{"version": 3, "objects": [{{"linear": {said}}}]}}"#);
            for text in [one, listed] {
                let scene = parse(text.as_bytes()).expect("a look");
                assert_eq!(scene.objects[0].response, response, "{text}");
            }
        }
    }

    #[test]
    fn what_is_cut_out_is_listed_and_comes_back() {
        let cut = r#""cut": [{"keep": "inside", "min": [0, 0, 0], "max": [1, 2, 3]}]"#;
        let alone = parse(format!(r#"{{"asset": "a.ply", {cut}}}"#).as_bytes()).expect("a look");
        let listed = format!(r#"{{"version": 3, "objects": [{{"asset": "a.ply", {cut}}}]}}"#);
        assert_eq!(parse(listed.as_bytes()), Ok(alone.clone()));
        let text = look_text(&alone).expect("of characters");
        assert!(text.contains("\"version\": 3") && text.contains("\"inside\""));
        assert_eq!(parse(text.as_bytes()), Ok(alone));
        let wrong = cut.replace("[0, 0, 0]", "[0, 3, 0]");
        let refused = parse(format!(r#"{{"asset": "a.ply", {wrong}}}"#).as_bytes());
        assert!(refused.is_err_and(|why| why.contains("min not above max")));
    }

    #[test]
    fn a_partial_look_keeps_the_defaults_and_a_misspelt_one_is_refused() {
        let partial = r#"{"transfer": {"epsilon": 0.1, "terms": {"shadow": false}}, "up": "-y", "target": {"tilt": 7}}"#;
        let scene = parse(partial.as_bytes()).expect("a good look");
        assert_eq!(scene.transfer.sh_degree, 3);
        assert!(!scene.transfer.terms.shadow && scene.transfer.terms.specular);
        assert_eq!(scene.objects.len(), 1);
        assert_eq!(scene.objects[0].up, Some(UpAxis::MinusY));
        assert_eq!(scene.environment.tilt, 7.0);
        for (old, method) in [
            (r#"{"version": 1, "up": "-y"}"#, Method::Harmonic),
            (
                r#"{"version": 1, "transfer": {"preset": "best"}}"#,
                Method::Directional,
            ),
            (r#"{"version": 2}"#, Method::Directional),
        ] {
            let scene = parse(old.as_bytes()).expect("a good look");
            assert_eq!(scene.transfer.method, method, "{old}");
        }
        for wrong in [
            r#"{"epsilom": 1}"#,
            r#"{"transfer": {"terms": {"shadows": false}}}"#,
            r#"{"display": {"exposur": 1}}"#,
            r#"{"target": {"rotatio": 1}}"#,
            r#"{"source": {"rotatio": 1}}"#,
            r#"{"target": null}"#,
            r#"{"objects": []}"#,
            r#"{"environment": {}}"#,
            r#"{"display": {"exposure": 500}}"#,
            r#"{"version": 8}"#,
            r#"{"response": {"curve": "filmic"}}"#,
            r#"{"response": {"contrast": 9}}"#,
            r#"{"source": {"trust": 2}}"#,
            r#"{"lights": [{"type": "lamp"}]}"#,
            r#"{"variants": [{"name": "a", "look": {"asset": "a.ply"}}]}"#,
            r#"{"variants": [{"name": "a", "look": {"variants": [{"name": "b", "look": {}}]}}]}"#,
            r#"{"variants": [{"name": "a", "look": {"display": {"exposure": 500}}}]}"#,
            r#"{"variants": [{"look": {}}]}"#,
            r#"{"bookmarks": [{"name": "a"}]}"#,
            r#"{"version": 2, "objects": [{}]}"#,
            r#"{"version": 3, "objects": [{}], "asset": "a.ply"}"#,
            r#"{"version": 3, "objects": [{"transform": {"scale": 0}}]}"#,
            r#"{"version": 3, "objects": [{"transfrom": {}}]}"#,
            r#"{"version": 3, "objects": [{"transform": {"rotation": [0, 0, 0, 2]}}]}"#,
            r#"{"version": 0}"#,
            r#"{"version": "2"}"#,
            r#"{"wipe": 1.5}"#,
            r#"{"target": {"tint": [1, -1, 1]}}"#,
            r#"{"outside_from": [[1e13, 0, 0]]}"#,
        ] {
            assert!(parse(wrong.as_bytes()).is_err(), "{wrong}");
        }
        let text = look_text(&scene).expect("plain data");
        assert_eq!(parse(text.as_bytes()).expect("its own text"), scene);
        // Numbers stay as short as they were typed.
        assert!(text.contains("\"epsilon\": 0.1,"), "{text}");
        assert!(
            text.contains("\"version\": 2"),
            "others can read it: {text}"
        );
    }

    #[test]
    fn objects_that_are_several_or_stand_elsewhere_come_back() {
        let text = r#"{"version": 3, "objects": [{"asset": "yard.ply"},
            {"name": "a ball", "asset": "ball.ply", "source": {"file": "even"}, "locked": true,
             "transform": {"scale": 0.5, "rotation": [0, 0, 0.6, 0.8], "translation": [1, 2, 3]}}]}"#;
        let mut scene = parse(text.as_bytes()).expect("a good look");
        let ball = &scene.objects[1];
        assert!(ball.shown && ball.locked && !scene.objects[0].locked);
        let there = ball.transform.scene_from_object();
        let there = there.transform_point3(Vec3::X);
        assert!(
            there.abs_diff_eq(Vec3::new(1.14, 2.48, 3.0), 1e-6),
            "{there}"
        );
        while !scene.objects.is_empty() {
            let text = look_text(&scene).expect("plain data");
            assert_eq!(parse(text.as_bytes()).expect("its own text"), scene);
            scene.objects.remove(0);
        }
        assert!(parse(look_text(&scene).expect("plain data").as_bytes()).is_err());
    }

    #[test]
    fn what_is_kept_with_a_look_comes_back() {
        let bounds = Bounds {
            center: Vec3::ZERO,
            radius: 1.0,
        };
        let camera = CameraPose::around(&bounds, 30.0, 10.0, 3.0, 35.0);
        let mut scene = Scene {
            note: "for the title".into(),
            ..Scene::default()
        };
        scene.objects[0].asset = Some("a.ply".into());
        scene.environment = EnvironmentLight::of("dusk.hdr");
        let name = "dusk".to_owned();
        let look = scene.look_alone();
        scene.variants.push(Variant { name, look });
        scene.environment = EnvironmentLight::of("noon.hdr");
        let name = "left".to_owned();
        scene.bookmarks.push(Bookmark { name, camera });
        let text = look_text(&scene).expect("plain data");
        assert_eq!(parse(text.as_bytes()).expect("its own text"), scene);
        assert!(text.contains("\"version\": 4"), "{text}");
        let moved = with_paths(scene.clone(), |path| Path::new("x").join(path));
        let light = moved.variants[0].look.environment.file.clone();
        assert_eq!(light, Some("x/dusk.hdr".into()));
        let back = scene.clone().with_look(&scene.variants[0].look);
        assert_eq!(back.environment.file, Some("dusk.hdr".into()));
        assert_eq!(
            (&back.objects, &back.bookmarks),
            (&scene.objects, &scene.bookmarks)
        );
        assert_eq!(back.look_alone(), scene.variants[0].look);
    }

    #[test]
    fn paths_are_relative_to_the_look_and_come_back() {
        let folder = tempfile::tempdir().expect("a folder");
        let (looks, lights) = (folder.path().join("looks"), folder.path().join("lights"));
        for made in [&looks, &lights] {
            std::fs::create_dir_all(made).expect("room");
        }
        let light = lights.join("sky.hdr");
        std::fs::write(&light, "x").expect("room");
        let mut scene = Scene::default();
        scene.objects[0].source.file = Some(EVEN.into());
        scene.environment.file = Some(light.clone());
        let look = looks.join("a.json");
        save_look(&look, &scene).expect("room");
        let text = std::fs::read_to_string(&look).expect("it is there");
        assert!(text.contains("\"../lights/sky.hdr\""), "{text}");
        assert!(text.contains("\"even\""), "{text}");
        let back = load_look(&look).expect("its own file");
        scene.environment.file = light.canonicalize().ok();
        assert_eq!(back, scene);
    }
}
