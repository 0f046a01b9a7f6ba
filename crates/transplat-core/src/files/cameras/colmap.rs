//! COLMAP's models (Schönberger and Frahm, 2016): `cameras` and `images`, as text or binary.

use std::collections::HashMap;
use std::path::Path;

use glam::{DMat3, DMat4, DQuat, DVec3};

use super::frame::{CameraFile, CameraFrame, Offsets, UNSEEN};
use crate::error::{Error, Result};
use crate::files::read::read_all;

/// Names of the file of images.
pub const IMAGES: [&str; 2] = ["images.bin", "images.txt"];

const CAMERAS: [&str; 2] = ["cameras.bin", "cameras.txt"];

/// The most bytes of either file: poses and the points seen in each picture.
const MOST_BYTES: u64 = 1 << 31;

/// The lenses that are read, by their number in COLMAP: their names, how many numbers each has, and whether it has two focal lengths.
const MODELS: [(&str, usize, bool); 14] = [
    ("SIMPLE_PINHOLE", 3, false),
    ("PINHOLE", 4, true),
    ("SIMPLE_RADIAL", 4, false),
    ("RADIAL", 5, false),
    ("OPENCV", 8, true),
    ("OPENCV_FISHEYE", 8, true),
    ("FULL_OPENCV", 12, true),
    ("FOV", 5, true),
    ("SIMPLE_RADIAL_FISHEYE", 4, false),
    ("RADIAL_FISHEYE", 5, false),
    ("THIN_PRISM_FISHEYE", 12, true),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16, true),
    ("SIMPLE_DIVISION", 4, false),
    ("DIVISION", 5, true),
];

struct ColmapLens {
    model: usize,
    size: [usize; 2],
    numbers: Vec<f64>,
}

struct ColmapImage {
    /// w, x, y, z, of the turn from the world to the camera.
    turn: [f64; 4],
    /// The world's origin as the camera sees it.
    origin: [f64; 3],
    lens: i64,
    name: String,
}

/// Loads the model in a folder.
///
/// # Errors
/// It is not there, or broken.
pub fn load(folder: &Path) -> Result<CameraFile> {
    let found = (0..2).find(|i| folder.join(IMAGES[*i]).is_file());
    let Some(found) = found else {
        return Err(Error::invalid(
            folder,
            "neither images.bin nor images.txt of a COLMAP model is there",
        ));
    };
    let (lenses, pictures) = (folder.join(CAMERAS[found]), folder.join(IMAGES[found]));
    let [lens_bytes, picture_bytes] = [&lenses, &pictures].map(|path| read_all(path, MOST_BYTES));
    let (lens_bytes, picture_bytes) = (lens_bytes?, picture_bytes?);
    let (cameras, images) = if found == 0 {
        (binary_lenses(&lens_bytes), binary_pictures(&picture_bytes))
    } else {
        (text_lenses(&lens_bytes), text_pictures(&picture_bytes))
    };
    let no_list = |path: &Path, of: &str, why: String| {
        Error::invalid(path, format!("no list of COLMAP {of}: {why}"))
    };
    let cameras = cameras.map_err(|why| no_list(&lenses, "cameras", why))?;
    let images = images.map_err(|why| no_list(&pictures, "images", why))?;
    if images.is_empty() {
        return Err(Error::invalid(&pictures, "holds no frames"));
    }
    let mut off = Offsets::default();
    let mut frames = Vec::new();
    for image in images {
        let name = &image.name;
        let broken = |why| Error::invalid(&pictures, format!("{name}: {why}"));
        let lens = cameras.get(&image.lens);
        let lens = lens.ok_or_else(|| broken("its camera is not listed"))?;
        frames.push(frame(&image, lens, &mut off).map_err(broken)?);
    }
    frames.sort_by(|a, b| a.picture.cmp(&b.picture));
    Ok(CameraFile {
        frames,
        warnings: off.warnings(&lenses),
        sees: true,
        path: pictures,
        placements: Vec::new(),
    })
}

fn frame(
    image: &ColmapImage,
    lens: &ColmapLens,
    off: &mut Offsets,
) -> std::result::Result<CameraFrame, &'static str> {
    let (name, count, has_two) = MODELS[lens.model];
    let numbers = &lens.numbers;
    if numbers.len() != count || lens.size.iter().any(|s| !(1..65536).contains(s)) {
        return Err("its camera is broken");
    }
    let [focal, other] = [numbers[0], numbers[usize::from(has_two)]];
    let rest = &numbers[1 + usize::from(has_two)..];
    let fov_x = 2.0 * (0.5 * lens.size[0] as f64 / focal).atan();
    if !(fov_x > 1e-4 && fov_x < 3.1) {
        return Err("its camera's focal length is no length");
    }
    off.center(lens.size, [rest[0], rest[1]]);
    if name.contains("FISHEYE") || name == "FOV" {
        off.other_lens(name, fov_x);
    }
    off.distorted |= rest[2..].iter().any(|k| k.abs() > 1e-6);
    off.stretched |= (other / focal - 1.0).abs() > UNSEEN;
    let [w, x, y, z] = image.turn;
    let turn = DQuat::from_xyzw(x, y, z, w);
    let origin = DVec3::from_array(image.origin);
    if !(turn.length() > 1e-9 && turn.is_finite() && origin.is_finite()) {
        return Err("its pose is none");
    }
    let world_from_view = DMat3::from_quat(turn.normalize()).transpose();
    let eye = -(world_from_view * origin);
    let axes = world_from_view * DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
    Ok(CameraFrame {
        picture: Some(image.name.clone()),
        world_from_camera: DMat4::from_translation(eye) * DMat4::from_mat3(axes),
        fov_x,
        size: Some(lens.size),
    })
}

type Read<T> = std::result::Result<T, String>;

/// Lines that say something, with their numbers from 1.
fn lines(bytes: &[u8]) -> impl Iterator<Item = (usize, String)> {
    let lines = bytes.split(|b| *b == b'\n').enumerate();
    let lines = lines.map(|(i, line)| (i + 1, String::from_utf8_lossy(line).trim().to_owned()));
    lines.filter(|(_, line)| !line.starts_with('#') && *line != "\u{feff}")
}

fn text_lenses(bytes: &[u8]) -> Read<HashMap<i64, ColmapLens>> {
    let lines = lines(bytes).filter(|(_, line)| !line.is_empty());
    lines
        .map(|(at, line)| {
            let broken =
                || format!("line {at} is no camera (number, model, width, height, parameters)");
            let mut words = line.split_whitespace();
            let id = words
                .next()
                .and_then(|w| w.parse().ok())
                .ok_or_else(broken)?;
            let name = words.next().ok_or_else(broken)?;
            let model = MODELS.iter().position(|(known, ..)| *known == name);
            let model = model.ok_or_else(|| format!("line {at}: {}", unknown_lens(name)))?;
            let mut edge = || words.next()?.parse().ok();
            let size = [edge().ok_or_else(broken)?, edge().ok_or_else(broken)?];
            let numbers: Option<Vec<f64>> = words.map(|w| w.parse().ok()).collect();
            let lens = ColmapLens {
                model,
                size,
                numbers: numbers.ok_or_else(broken)?,
            };
            Ok((id, lens))
        })
        .collect()
}

fn unknown_lens(name: &str) -> String {
    let known: Vec<&str> = MODELS.iter().map(|(known, ..)| *known).collect();
    format!(
        "the lens {name} is not known; undistort the images (colmap image_undistorter), or use one of {}",
        known.join(", ")
    )
}

/// A line of the points that are seen in an image: numbers by threes, or none.
fn is_of_points(line: &str) -> bool {
    let count = line.split_whitespace().count();
    count.is_multiple_of(3)
        && line
            .split_whitespace()
            .all(|word| word.parse::<f64>().is_ok())
}

/// Lines of images, each of which may be followed by one of the points in it.
fn text_pictures(bytes: &[u8]) -> Read<Vec<ColmapImage>> {
    let mut pictures = Vec::new();
    let mut points_may_follow = false;
    for (at, line) in lines(bytes) {
        if line.is_empty() || points_may_follow && is_of_points(&line) {
            points_may_follow = false;
            continue;
        }
        let broken =
            || format!("line {at} is no image (number, quaternion, translation, camera, name)");
        pictures.push(text_picture(&line).ok_or_else(broken)?);
        points_may_follow = true;
    }
    // As COLMAP counts them in its comments.
    let text = String::from_utf8_lossy(bytes);
    let claimed = text
        .lines()
        .find_map(|l| l.strip_prefix("# Number of images: "));
    let claimed = claimed.and_then(|l| l.split(',').next()?.trim().parse::<usize>().ok());
    match claimed.filter(|n| *n != pictures.len()) {
        Some(claimed) => Err(format!(
            "it says that it holds {claimed} images, and {} are in it",
            pictures.len()
        )),
        None => Ok(pictures),
    }
}

fn text_picture(line: &str) -> Option<ColmapImage> {
    // A name may hold spaces, and what stands before it any number of them.
    let mut rest = line;
    let mut word = || {
        let (word, after) = rest.trim_start().split_once(char::is_whitespace)?;
        rest = after;
        Some(word)
    };
    word()?.parse::<i64>().ok()?;
    let mut number = || word()?.parse::<f64>().ok();
    let turn = [number()?, number()?, number()?, number()?];
    let origin = [number()?, number()?, number()?];
    let lens = word()?.parse().ok()?;
    let name = rest.trim();
    (!name.is_empty()).then(|| ColmapImage {
        turn,
        origin,
        lens,
        name: name.to_owned(),
    })
}

/// Little-endian numbers from the front.
struct Reader<'a>(&'a [u8]);

impl<'a> Reader<'a> {
    fn bytes<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (first, rest) = self.0.split_first_chunk()?;
        self.0 = rest;
        Some(*first)
    }

    fn i32(&mut self) -> Option<i64> {
        Some(i64::from(i32::from_le_bytes(self.bytes()?)))
    }

    fn u64(&mut self) -> Option<usize> {
        usize::try_from(u64::from_le_bytes(self.bytes()?)).ok()
    }

    fn f64(&mut self) -> Option<f64> {
        Some(f64::from_le_bytes(self.bytes()?))
    }

    fn skip(&mut self, bytes: usize) -> Option<()> {
        self.0 = self.0.get(bytes..)?;
        Some(())
    }

    fn text(&mut self) -> Option<String> {
        let end = self.0.iter().position(|b| *b == 0)?;
        let text = String::from_utf8_lossy(&self.0[..end]).into_owned();
        self.skip(end + 1)?;
        Some(text)
    }
}

fn binary_lenses(bytes: &[u8]) -> Read<HashMap<i64, ColmapLens>> {
    let mut reader = Reader(bytes);
    let cut = || "it ends too early".to_owned();
    let mut lenses = HashMap::new();
    for _ in 0..reader.u64().ok_or_else(cut)? {
        let id = reader.i32().ok_or_else(cut)?;
        let number = reader.i32().ok_or_else(cut)?;
        let model = usize::try_from(number).ok().filter(|m| *m < MODELS.len());
        let model = model.ok_or_else(|| unknown_lens(&format!("of number {number}")))?;
        let mut edge = || reader.u64().ok_or_else(cut);
        let size = [edge()?, edge()?];
        let count = MODELS[model].1;
        let numbers: Option<Vec<f64>> = (0..count).map(|_| reader.f64()).collect();
        let lens = ColmapLens {
            model,
            size,
            numbers: numbers.ok_or_else(cut)?,
        };
        lenses.insert(id, lens);
    }
    Ok(lenses)
}

fn binary_pictures(bytes: &[u8]) -> Read<Vec<ColmapImage>> {
    let mut reader = Reader(bytes);
    let cut = || "it ends too early".to_owned();
    let mut pictures = Vec::new();
    for _ in 0..reader.u64().ok_or_else(cut)? {
        pictures.push(binary_picture(&mut reader).ok_or_else(cut)?);
    }
    Ok(pictures)
}

fn binary_picture(reader: &mut Reader<'_>) -> Option<ColmapImage> {
    reader.i32()?;
    let mut number = || reader.f64();
    let turn = [number()?, number()?, number()?, number()?];
    let origin = [number()?, number()?, number()?];
    let (lens, name) = (reader.i32()?, reader.text()?);
    let points = reader.u64()?;
    reader.skip(points.checked_mul(24)?)?;
    Some(ColmapImage {
        turn,
        origin,
        lens,
        name,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::Camera;
    use crate::files::load_cameras;
    use glam::Vec3;

    const LENSES: &str =
        "# Camera list\n1 PINHOLE 200 100 150 150 100 50\n7 OPENCV 80 60 90 90 40 30 0.1 0 0 0\n";
    const PICTURES: &str =
        "# Image list\n2 0.5 0.5 -0.5 0.5 1 2 3 7 b c.jpg\n1 2 -1\n1 1 0 0 0 0 0 4 1 a.jpg\n\n";

    fn folder(lenses: &[u8], pictures: &[u8], kind: usize) -> tempfile::TempDir {
        let folder = tempfile::tempdir().expect("a folder");
        std::fs::write(folder.path().join(CAMERAS[kind]), lenses).expect("room");
        std::fs::write(folder.path().join(IMAGES[kind]), pictures).expect("room");
        folder
    }

    fn binary() -> (Vec<u8>, Vec<u8>) {
        let (mut lenses, mut pictures) = (Vec::new(), Vec::new());
        lenses.extend(2u64.to_le_bytes());
        for (id, model, size, numbers) in [
            (
                1i32,
                1i32,
                [200u64, 100],
                &[150.0, 150.0, 100.0, 50.0f64][..],
            ),
            (
                7,
                4,
                [80, 60],
                &[90.0, 90.0, 40.0, 30.0, 0.1, 0.0, 0.0, 0.0],
            ),
        ] {
            lenses.extend(id.to_le_bytes().into_iter().chain(model.to_le_bytes()));
            lenses.extend(size.iter().flat_map(|v| v.to_le_bytes()));
            lenses.extend(numbers.iter().flat_map(|v| v.to_le_bytes()));
        }
        pictures.extend(2u64.to_le_bytes());
        for (id, pose, lens, name, points) in [
            (
                2i32,
                [0.5, 0.5, -0.5, 0.5, 1.0, 2.0, 3.0f64],
                7i32,
                "b c.jpg",
                1u64,
            ),
            (1, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 4.0], 1, "a.jpg", 0),
        ] {
            pictures.extend(id.to_le_bytes());
            pictures.extend(pose.iter().flat_map(|v| v.to_le_bytes()));
            pictures.extend(lens.to_le_bytes());
            pictures.extend(name.bytes().chain([0]));
            pictures.extend(points.to_le_bytes());
            pictures.extend(vec![0; 24 * points as usize]);
        }
        (lenses, pictures)
    }

    #[test]
    fn text_and_binary_are_the_same_cameras() {
        let text = folder(LENSES.as_bytes(), PICTURES.as_bytes(), 1);
        let (lenses, pictures) = binary();
        let binary = folder(&lenses, &pictures, 0);
        let [a, b] = [&text, &binary].map(|f| load_cameras(f.path()).expect("a model"));
        assert_eq!(a.frames, b.frames);
        assert_eq!(a.warnings.len(), 1, "distorted: {:?}", a.warnings);
        let names: Vec<_> = a
            .frames
            .iter()
            .filter_map(|f| f.picture.as_deref())
            .collect();
        assert_eq!(names, ["a.jpg", "b c.jpg"]);
        // Four in front of the world's origin, looking along z with y down.
        let camera: Camera = a.frames[0].camera([200, 100], 0.1);
        let ([x, y], depth) = camera.project(Vec3::new(0.4, 0.2, 0.0));
        assert!(
            (depth - 4.0).abs() < 1e-6 && (x - 114.5).abs() < 1e-3,
            "{x} {depth}"
        );
        assert!((y - 57.0).abs() < 1e-3, "{y}");
        let by_file = load_cameras(&text.path().join("images.txt")).expect("a model");
        assert_eq!(by_file.frames, a.frames);
    }

    /// Points may be left out of any image, and names hold spaces.
    #[test]
    fn images_without_points_are_all_there() {
        let images: String = (1..=3)
            .map(|i| format!("{i} 1 0 0 0  0 0 {i} 1 view {i} (402).jpg\n"))
            .collect();
        let with_some = images.replacen("1 (402).jpg\n", "1 (402).jpg\n10.5 20.5 -1\n", 1);
        for text in [&images, &with_some] {
            let model = folder(LENSES.as_bytes(), text.as_bytes(), 1);
            let file = load_cameras(model.path()).expect("a model");
            let names = file.frames.iter().filter_map(|f| f.picture.as_deref());
            let expected = ["view 1 (402).jpg", "view 2 (402).jpg", "view 3 (402).jpg"];
            assert_eq!(names.collect::<Vec<_>>(), expected);
        }
        let fewer = format!("# Number of images: 4, mean observations per image: 0\n{images}");
        let model = folder(LENSES.as_bytes(), fewer.as_bytes(), 1);
        let why = load_cameras(model.path())
            .expect_err("one is missing")
            .to_string();
        assert!(why.contains("4 images, and 3"), "{why}");
    }

    #[test]
    fn a_project_is_found_and_an_unknown_lens_named() {
        let project = tempfile::tempdir().expect("a folder");
        let model = project.path().join("sparse/0");
        std::fs::create_dir_all(&model).expect("room");
        let write = |name: &str, text: &str| std::fs::write(model.join(name), text).expect("room");
        write("images.txt", PICTURES);
        write("cameras.txt", LENSES);
        assert_eq!(
            load_cameras(project.path()).expect("a model").frames.len(),
            2
        );
        write("cameras.txt", &LENSES.replace("OPENCV", "SPIRAL"));
        let why = load_cameras(project.path())
            .expect_err("no lens")
            .to_string();
        assert!(why.contains("the lens SPIRAL is not known"), "{why}");
        write("cameras.txt", &LENSES.replace("OPENCV", "OPENCV_FISHEYE"));
        let file = load_cameras(project.path()).expect("a model");
        assert!(file.warnings[0].contains("OPENCV_FISHEYE is drawn as a pinhole"));
    }

    #[test]
    fn broken_models_are_errors() {
        for (from, to) in [
            ("PINHOLE", "PINHOLES"),
            (" 7 b", " 8 b"),
            ("150 150", "0 150"),
        ] {
            let [lenses, pictures] = [LENSES, PICTURES].map(|t| t.replace(from, to));
            let broken = folder(lenses.as_bytes(), pictures.as_bytes(), 1);
            assert!(load_cameras(broken.path()).is_err(), "{from}");
        }
        let (lenses, pictures) = binary();
        for i in 0..pictures.len() {
            let broken = folder(&lenses, &pictures[..i], 0);
            assert!(load_cameras(broken.path()).is_err(), "cut to {i} bytes");
        }
        for i in 0..lenses.len() {
            let broken = folder(&lenses[..i], &pictures, 0);
            assert!(load_cameras(broken.path()).is_err(), "cut to {i} bytes");
        }
    }
}
