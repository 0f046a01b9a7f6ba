//! Frames of `transplat render`: cameras, and the photographs behind.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result, bail};
use transplat_core::camera::{
    Camera, CameraPose, FIELD_OF_VIEW, NEAR, first_pose, framed, turntable,
};
use transplat_core::files::{image_size, load_cameras};
use transplat_core::present::Background;

use crate::cli::RenderArgs;
use crate::commands::headless::{Headless, up_warning_of};
use crate::summary::Summary;
use transplat_engine::render::{MAX_SAMPLES, photographs_named};

/// A picture to be taken.
pub struct Frame {
    /// Its own, whichever are left out.
    pub number: usize,
    pub camera: Camera,
    /// The photograph behind it.
    pub plate: Option<PathBuf>,
}

/// The cameras to draw.
pub fn frames(args: &RenderArgs, headless: &Headless, summary: &mut Summary) -> Result<Vec<Frame>> {
    let mut frames = cameras(args, headless, summary)?;
    if let Some(aperture) = args.camera.aperture {
        let middle = headless.shots.cloud.bounds().center;
        let place = args.camera.look_at.map_or(middle, |at| headless.place(at));
        for Frame { camera, .. } in &mut frames {
            if camera.lens.focus.is_infinite() {
                camera.lens.focus = camera.project(place).1.max(camera.near);
            }
            camera.lens.radius = aperture as f32 * camera.lens.focus;
        }
    }
    let samples = |f: &Frame| {
        let of_a_pixel = usize::from(args.supersample).pow(2);
        f.camera.width.saturating_mul(f.camera.height) * of_a_pixel
    };
    let samples = frames.iter().map(samples).max().unwrap_or_default();
    if samples > MAX_SAMPLES {
        bail!(
            "an image of {samples} samples is too large; {MAX_SAMPLES} are possible: lower --size or --supersample"
        );
    }
    Ok(frames)
}

/// Range of the frames that are requested.
fn asked(args: &RenderArgs, count: usize) -> Result<std::ops::RangeInclusive<usize>> {
    let [first, last] = args.frames.unwrap_or([0, count - 1]);
    if first >= count {
        bail!("--frames {first}-{last}: the frames are 0 to {}", count - 1);
    }
    Ok(first..=last.min(count - 1))
}

fn cameras(args: &RenderArgs, headless: &Headless, summary: &mut Summary) -> Result<Vec<Frame>> {
    let (scene, cloud) = (&headless.shots.project.scene, &headless.shots.cloud);
    let bounds = cloud.bounds();
    let near = NEAR * bounds.radius;
    let plate = scene.plate.as_ref();
    let plate = plate.filter(|_| scene.background == Background::Backplate);
    let one_for_all = plate.filter(|p| !p.is_dir());
    // A photograph is covered pixel for pixel.
    let size_of_all = one_for_all.map(|path| image_size(path)).transpose()?;
    if let Some(path) = &args.camera.cameras {
        let file = load_cameras(path)?.placed_for(cloud);
        let (object, asset) = headless.first();
        if let Some(warning) = up_warning_of(object, asset, &file) {
            summary.warn(warning);
        }
        for warning in &file.warnings {
            summary.warn(warning.clone());
        }
        let of_file = |number: usize| -> Result<Frame> {
            let mut frame = file.frames[number].clone();
            let plate = plate.map(|p| plate_of(p, frame.picture.as_deref()));
            let plate = plate.transpose()?;
            if frame.size.is_none() {
                let of_frame = || plate.as_ref().map(|path| image_size(path)).transpose();
                frame.size = size_of_all.map_or_else(of_frame, |size| Ok(Some(size)))?;
            }
            let size = args.size.or(frame.size).unwrap_or([800, 800]);
            Ok(Frame {
                number,
                camera: frame.camera(size, near),
                plate,
            })
        };
        return asked(args, file.frames.len())?.map(of_file).collect();
    }
    let plate = plate.map(|path| plate_of(path, None)).transpose()?;
    let numbered = |cameras: Vec<Camera>| -> Result<Vec<Frame>> {
        let range = asked(args, cameras.len())?;
        let all = cameras.into_iter().enumerate();
        let frames = all.filter(|(number, _)| range.contains(number));
        Ok(frames
            .map(|(number, camera)| Frame {
                number,
                camera,
                plate: plate.clone(),
            })
            .collect())
    };
    let numbered = |cameras: Vec<Camera>| match (&cameras[..], args.animation) {
        // One sees all of it.
        ([one], true) => {
            let frames = scene.animation.frames(args.frame_rate);
            numbered(vec![*one; frames])
        }
        _ => numbered(cameras),
    };
    let size = args.size.or(size_of_all).unwrap_or([800, 800]);
    let camera = &args.camera;
    let fov_x = camera.fov.unwrap_or(FIELD_OF_VIEW).to_radians();
    let up = cloud.up.direction();
    if let Some(eye) = camera.eye {
        let eye = headless.place(eye);
        let target = camera
            .look_at
            .map_or(bounds.center, |at| headless.place(at));
        if eye == target {
            bail!("--eye is where it looks at: the two need to be apart");
        }
        let camera = Camera::look_at(eye, target, up, fov_x, size, near);
        return numbered(vec![camera]);
    }
    if let (Some(pose), None) = (&scene.camera, camera.turntable) {
        let fov = camera
            .fov
            .map_or(pose.fov, |fov| across_shorter_edge(fov, size));
        let pose = CameraPose { fov, ..*pose };
        let camera = Camera::from_pose(&pose, cloud.up, size, bounds.radius);
        return numbered(vec![camera]);
    }
    let Some(count) = camera.turntable else {
        // As the window opens it.
        let mut pose = first_pose(&cloud.positions, cloud.up, &bounds, size);
        if let Some(fov) = camera.fov {
            pose.fov = across_shorter_edge(fov, size);
            pose = framed(&cloud.positions, cloud.up, &bounds, &pose, size);
        }
        let camera = Camera::from_pose(&pose, cloud.up, size, bounds.radius);
        return numbered(vec![camera]);
    };
    numbered(turntable(cloud, count as usize, fov_x, size, near))
}

/// The field of view of the shorter edge, as a pose has it, from that of the width; both in degrees.
fn across_shorter_edge(fov_x: f64, [width, height]: [usize; 2]) -> f64 {
    let slope = (fov_x.to_radians() / 2.0).tan();
    let shorter = slope * width.min(height) as f64 / width as f64;
    2.0 * shorter.atan().to_degrees()
}

/// A photograph, or all that lie in a folder of them: those that no frame is drawn over are not to be lost either.
pub fn photographs(plate: Option<&Path>) -> Vec<PathBuf> {
    let Some(plate) = plate else {
        return Vec::new();
    };
    match plate.read_dir() {
        Ok(files) => files.flatten().map(|file| file.path()).collect(),
        Err(_) => vec![plate.to_owned()],
    }
}

/// The photograph behind a frame: one for all, or out of a folder that of its camera, which calls it `picture`.
fn plate_of(plate: &Path, picture: Option<&str>) -> Result<PathBuf> {
    if !plate.is_dir() {
        return Ok(plate.to_owned());
    }
    let picture = picture.with_context(|| {
        format!(
            "{}: a folder of photographs needs cameras that name theirs (--cameras)",
            plate.display()
        )
    })?;
    let name = Path::new(picture).file_name().unwrap_or_default();
    let named = plate.join(name);
    let found = photographs_named(&named).find(|path| path.is_file());
    found.with_context(|| {
        format!(
            "{}: holds no photograph {}",
            plate.display(),
            name.display()
        )
    })
}
