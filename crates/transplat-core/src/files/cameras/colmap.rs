//! COLMAP's models (Schönberger and Frahm, 2016): `cameras` and `images`, as text or binary.

use std::collections::HashMap;
use std::path::Path;

use glam::{DMat3, DMat4, DQuat, DVec3};

use super::frame::{CameraFile, CameraFrame, Offsets, UNSEEN};
use crate::error::{Error, Result};
use crate::files::read::read_all;

/// What the file of pictures is called.
pub const IMAGES: [&str; 2] = ["images.bin", "images.txt"];

const CAMERAS: [&str; 2] = ["cameras.bin", "cameras.txt"];

/// The most bytes of either file: poses and the points seen in each picture.
const MOST_BYTES: u64 = 1 << 31;

/// The lenses that COLMAP knows, by number: their names, how many numbers each has, and whether it has two focal lengths.
const MODELS: [(&str, usize, bool); 11] = [
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
];

struct Lens {
    model: usize,
    size: [usize; 2],
    numbers: Vec<f64>,
}

struct Picture {
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
    let cameras = cameras.ok_or_else(|| Error::invalid(&lenses, "no list of COLMAP cameras"))?;
    let images = images.ok_or_else(|| Error::invalid(&pictures, "no list of COLMAP images"))?;
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
    })
}

fn frame(
    image: &Picture,
    lens: &Lens,
    off: &mut Offsets,
) -> std::result::Result<CameraFrame, &'static str> {
    let (_, count, has_two) = MODELS[lens.model];
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

fn text_lenses(bytes: &[u8]) -> Option<HashMap<i64, Lens>> {
    let text = std::str::from_utf8(bytes).ok()?;
    let lines = text
        .lines()
        .filter(|l| !l.starts_with('#') && !l.trim().is_empty());
    lines
        .map(|line| {
            let mut words = line.split_whitespace();
            let id = words.next()?.parse().ok()?;
            let name = words.next()?;
            let model = MODELS.iter().position(|(known, ..)| *known == name)?;
            let size = [words.next()?.parse().ok()?, words.next()?.parse().ok()?];
            let numbers = words.map(|w| w.parse().ok()).collect::<Option<_>>()?;
            let lens = Lens {
                model,
                size,
                numbers,
            };
            Some((id, lens))
        })
        .collect()
}

/// Every other line is of the points in a picture, and may be empty.
fn text_pictures(bytes: &[u8]) -> Option<Vec<Picture>> {
    let text = std::str::from_utf8(bytes).ok()?;
    let lines = text.lines().filter(|l| !l.starts_with('#'));
    let poses = lines.step_by(2).filter(|l| !l.trim().is_empty());
    poses
        .map(|line| {
            let mut words = line.trim().splitn(10, ' ');
            words.next()?;
            let mut number = || words.next()?.parse::<f64>().ok();
            let turn = [number()?, number()?, number()?, number()?];
            let origin = [number()?, number()?, number()?];
            Some(Picture {
                turn,
                origin,
                lens: words.next()?.parse().ok()?,
                name: words.next()?.to_owned(),
            })
        })
        .collect()
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

fn binary_lenses(bytes: &[u8]) -> Option<HashMap<i64, Lens>> {
    let mut reader = Reader(bytes);
    let mut lenses = HashMap::new();
    for _ in 0..reader.u64()? {
        let (id, model) = (reader.i32()?, usize::try_from(reader.i32()?).ok()?);
        let size = [reader.u64()?, reader.u64()?];
        let (_, count, _) = MODELS.get(model)?;
        let numbers = (0..*count).map(|_| reader.f64()).collect::<Option<_>>()?;
        let lens = Lens {
            model,
            size,
            numbers,
        };
        lenses.insert(id, lens);
    }
    Some(lenses)
}

fn binary_pictures(bytes: &[u8]) -> Option<Vec<Picture>> {
    let mut reader = Reader(bytes);
    let mut pictures = Vec::new();
    for _ in 0..reader.u64()? {
        reader.i32()?;
        let mut number = || reader.f64();
        let turn = [number()?, number()?, number()?, number()?];
        let origin = [number()?, number()?, number()?];
        let (lens, name) = (reader.i32()?, reader.text()?);
        let points = reader.u64()?;
        reader.skip(points.checked_mul(24)?)?;
        pictures.push(Picture {
            turn,
            origin,
            lens,
            name,
        });
    }
    Some(pictures)
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
