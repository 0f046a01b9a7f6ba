//! `transplat render`: pictures of an asset, as captured or relit.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use glam::Vec3;
use transplat_core::camera::{Camera, turntable};
use transplat_core::color::Encoding;
use transplat_core::environment::EnvironmentMap;
use transplat_core::export::{write_exr, write_png};
use transplat_core::load::load_cameras;
use transplat_core::look::Look;
use transplat_core::present::{self, Background, View};
use transplat_core::rasterize::{ColorSpace, Raster};
use transplat_core::surfels::SurfelCloud;
use transplat_core::visibility::Visibility;

use crate::cli::{CameraArgs, PictureFormat, RenderArgs};
use crate::commands::refuse_overwriting;
use crate::device::{Paint, Painter};
use crate::report::Report;
use crate::scene::{Lights, Scene, look_of, progress_bar, targets_of};

/// Pictures with more samples than this are refused: their buffers would not fit.
const MAX_SAMPLES: usize = 1 << 28;

/// Nothing nearer to the eye than this share of the object's radius is drawn.
const NEAR: f32 = 0.02;

pub fn run(args: &RenderArgs) -> Result<()> {
    let mut report = Report::new("render", &args.out);
    if args.camera.cameras.is_none() && args.camera.turntable.is_none() && args.camera.eye.is_none()
    {
        crate::commands::usage(
            "a camera is needed: --cameras TRANSFORMS.json, --turntable N or --eye X,Y,Z",
        );
    }
    let look = settings(args)?;
    let relit = args.light.source.is_some();
    let targets = targets_of(&args.light)?;
    if relit == targets.is_empty() {
        crate::commands::usage(
            "--source and --target belong together; \"even\" stands for a light that nobody knows",
        );
    }
    if look.background == Background::Environment && !relit {
        crate::commands::usage("--background environment needs --source and --target");
    }
    let view = match (args.view, relit) {
        (None, false) if look.view == View::After => View::Before,
        (_, false) if look.view.needs_relit() => {
            crate::commands::usage("this view needs --source and --target")
        }
        _ => look.view,
    };
    let scene = Scene::load(&args.asset, look, &mut report)?;
    let frames = frames(args, &scene.cloud)?;
    let output = Output::new(args, frames.len(), targets.len())?;
    let cameras = args.camera.cameras.as_deref();
    let inputs = args
        .light
        .inputs(&targets)
        .chain([&*args.asset.asset])
        .chain(cameras);
    refuse_overwriting(
        inputs,
        output
            .pictures(&targets, &frames)
            .iter()
            .map(PathBuf::as_path),
    )?;
    if output.format == PictureFormat::Exr && !scene.look.display.is_identity() {
        report.warn("exposure and tone map are for PNG; an EXR stays linear");
    }
    let lights = match &args.light.source {
        Some(source) if view.needs_relit() => {
            Some(scene.lights(&args.light, source, &mut report)?)
        }
        _ => None,
    };
    let needs_bake = view.needs_relit() || view == View::Visibility;
    let visibility = if needs_bake {
        Some(scene.bake(args.light.bake.as_deref(), &mut report)?)
    } else {
        report.skip("bake", "this view needs no visibility");
        None
    };
    let shots = Shots {
        args,
        view,
        frames: &frames,
        output: &output,
        space: match output.format {
            PictureFormat::Png => ColorSpace::Display(scene.look.display),
            PictureFormat::Exr => ColorSpace::Linear,
        },
        painter: scene.device.painter(&scene.cloud, &mut report)?,
        scene: &scene,
        visibility: visibility.as_ref(),
        openness: match &visibility {
            Some(visibility) if view == View::Visibility => {
                visibility.openness().iter().map(|o| [*o; 3]).collect()
            }
            _ => Vec::new(),
        },
    };
    let written = match &lights {
        Some(lights) => shots.relit(lights, &mut report)?,
        None => {
            if relit {
                report.skip("transfer", "this view shows no relit colour");
            }
            // The same picture for each target, but for its background.
            let named = targets
                .iter()
                .map(|(name, path)| (Some(&**name), Some(&**path)));
            let each: Vec<_> = if relit {
                named.collect()
            } else {
                vec![(None, None)]
            };
            let mut written = 0;
            for (name, path) in each {
                let mut nothing = Relit::default();
                if let Some(path) = path {
                    nothing.map = shots.background_map(path, &mut report)?;
                }
                written += shots.take(name, &nothing, &mut report)?;
            }
            written
        }
    };
    report.set("pictures", written);
    report.finish(&format!(
        "wrote {written} picture{} to {}",
        if written == 1 { "" } else { "s" },
        args.output.display()
    ))
}

fn settings(args: &RenderArgs) -> Result<Look> {
    let mut look = look_of(&args.asset, Some(&args.light))?;
    if let Some(view) = args.view {
        look.view = view;
    }
    if let Some(background) = args.background {
        look.background = background;
    }
    if let Some(tone_map) = args.tone_map {
        look.display.tone_map = tone_map;
    }
    if let Some(stops) = args.exposure {
        look.display.exposure = stops.clamp(-60.0, 60.0) as f32;
    }
    Ok(look)
}

/// The cameras to draw, each with its own number.
fn frames(args: &RenderArgs, cloud: &SurfelCloud) -> Result<Vec<(usize, Camera)>> {
    let all = cameras(&args.camera, args.size, cloud)?;
    let samples = all.first().map_or(0, |c| {
        c.width * c.height * usize::from(args.supersample).pow(2)
    });
    if samples > MAX_SAMPLES {
        bail!(
            "a picture of {samples} samples is too large; {MAX_SAMPLES} are possible: lower --size or --supersample"
        );
    }
    let count = all.len();
    let [first, last] = args.frames.unwrap_or([0, count - 1]);
    if first >= count {
        bail!("--frames {first}-{last}: there are {count} frames, numbered from 0");
    }
    Ok(all
        .into_iter()
        .enumerate()
        .filter(|(i, _)| (first..=last).contains(i))
        .collect())
}

fn cameras(
    args: &CameraArgs,
    size: Option<[usize; 2]>,
    cloud: &SurfelCloud,
) -> Result<Vec<Camera>> {
    let bounds = cloud.bounds();
    let near = NEAR * bounds.radius;
    if let Some(path) = &args.cameras {
        let file = load_cameras(path)?;
        let size = size.or(file.size).unwrap_or([800, 800]);
        return Ok(file
            .frames
            .iter()
            .map(|f| Camera::from_opengl_pose(f.world_from_camera, file.fov_x, size, near))
            .collect());
    }
    let size = size.unwrap_or([800, 800]);
    let fov_x = args.fov.to_radians();
    let up = cloud.up.direction();
    if let Some(eye) = args.eye {
        let target = args.look_at.map_or(bounds.center, Vec3::from_array);
        let camera = Camera::look_at(Vec3::from_array(eye), target, up, fov_x, size, near);
        return Ok(vec![camera]);
    }
    let count = args.turntable.unwrap_or(1) as usize;
    Ok(turntable(cloud, count, fov_x, size, near))
}

/// Where pictures go.
struct Output<'a> {
    path: &'a Path,
    format: PictureFormat,
    is_file: bool,
    folder_per_target: bool,
}

impl<'a> Output<'a> {
    fn new(args: &'a RenderArgs, frames: usize, targets: usize) -> Result<Self> {
        let path = &args.output;
        let named =
            path.extension()
                .and_then(|e| match e.to_string_lossy().to_lowercase().as_str() {
                    "png" => Some(PictureFormat::Png),
                    "exr" => Some(PictureFormat::Exr),
                    _ => None,
                });
        let is_file = named.is_some() && !path.is_dir();
        if is_file && frames * targets.max(1) > 1 {
            bail!(
                "{}: {} pictures do not fit into one file; give a folder",
                path.display(),
                frames * targets.max(1)
            );
        }
        if let (Some(named), Some(asked), true) = (named, args.format, is_file)
            && named != asked
        {
            bail!(
                "{}: the name says {} and --format {}",
                path.display(),
                named.extension(),
                asked.extension()
            );
        }
        let in_folder = args.light.target.iter().any(|t| t.is_dir());
        Ok(Self {
            path,
            format: args
                .format
                .or(named.filter(|_| is_file))
                .unwrap_or(PictureFormat::Png),
            is_file,
            folder_per_target: !is_file && (targets > 1 || in_folder),
        })
    }

    fn folder(&self, target: Option<&str>) -> PathBuf {
        match target {
            Some(name) if self.folder_per_target => self.path.join(name),
            _ => self.path.to_owned(),
        }
    }

    fn picture(&self, target: Option<&str>, frame: usize) -> PathBuf {
        if self.is_file {
            return self.path.to_owned();
        }
        self.folder(target)
            .join(format!("{frame:03}.{}", self.format.extension()))
    }

    /// All pictures that will be written.
    fn pictures(&self, targets: &[(String, PathBuf)], frames: &[(usize, Camera)]) -> Vec<PathBuf> {
        let names = targets.iter().map(|(name, _)| Some(&**name)).chain([None]);
        names
            .flat_map(|name| {
                frames
                    .iter()
                    .map(move |(number, _)| self.picture(name, *number))
            })
            .collect()
    }
}

/// What a target light makes of the asset; empty where nothing is relit.
#[derive(Default)]
struct Relit {
    /// Linear SH `[n][K][3]`, already the part that the view shows.
    sh: Vec<[f32; 3]>,
    /// Colours of a channel that is none of the light's.
    colors: Vec<[f32; 3]>,
    map: Option<EnvironmentMap>,
}

struct Shots<'a> {
    args: &'a RenderArgs,
    view: View,
    frames: &'a [(usize, Camera)],
    output: &'a Output<'a>,
    space: ColorSpace,
    painter: Painter<'a>,
    scene: &'a Scene,
    visibility: Option<&'a Visibility>,
    /// As surfel colours; empty unless it is what is shown.
    openness: Vec<[f32; 3]>,
}

impl Shots<'_> {
    /// One set of pictures a target, with the bake and the source's part done once.
    fn relit(&self, lights: &Lights, report: &mut Report) -> Result<usize> {
        let Some(visibility) = self.visibility else {
            bail!("a relit view without visibility");
        };
        let prepared = self.scene.prepare(visibility, &lights.source, report)?;
        let mut transfer = self.scene.device.transfer(&prepared)?;
        let mut written = 0;
        for target in &lights.targets {
            let mut relit = Relit {
                map: self.background_map(&target.path, report)?,
                ..Relit::default()
            };
            let sh = self
                .scene
                .relight(&prepared, &mut transfer, target, report)?;
            match self.view {
                View::Tau => relit.colors = present::tau_colors(&prepared.tau(&sh)),
                View::Diffuse | View::Specular => {
                    let diffuse = self.view == View::Diffuse;
                    relit.sh = present::part_of_sh(&sh, prepared.coefficients(), diffuse);
                }
                _ => relit.sh = sh,
            }
            written += self.take(Some(&target.name), &relit, report)?;
        }
        Ok(written)
    }

    /// The map behind the object, where it is shown; maps are large, so only one is held at a time.
    fn background_map(&self, path: &Path, report: &mut Report) -> Result<Option<EnvironmentMap>> {
        if self.scene.look.background == Background::Environment {
            self.scene.load_light(path, report)
        } else {
            Ok(None)
        }
    }

    fn take(&self, target: Option<&str>, relit: &Relit, report: &mut Report) -> Result<usize> {
        if !self.output.is_file {
            let folder = self.output.folder(target);
            std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        }
        let bar = progress_bar("drawing", report);
        for (done, (number, camera)) in self.frames.iter().enumerate() {
            bar.set_position((1000 * done / self.frames.len()) as u64);
            let path = self.output.picture(target, *number);
            let factor = usize::from(self.args.supersample);
            let camera = camera.supersampled(factor);
            let raster = report.time("rasterize", || {
                let mut raster = self.picture(&camera, relit)?;
                self.fill_background(&mut raster, &camera, relit);
                anyhow::Ok(raster.downsampled(factor))
            })?;
            report.time("export", || match self.output.format {
                PictureFormat::Png => write_png(
                    &path,
                    raster.width,
                    raster.height,
                    &present::straight(&raster),
                ),
                PictureFormat::Exr => write_exr(&path, &raster),
            })?;
        }
        bar.finish_and_clear();
        Ok(self.frames.len())
    }

    fn picture(&self, camera: &Camera, relit: &Relit) -> Result<Raster> {
        let cloud = &self.scene.cloud;
        let draw = |paint, space| self.painter.draw(camera, paint, space);
        let before = || {
            draw(
                Paint::Sh {
                    sh: &cloud.sh,
                    encoding: cloud.encoding,
                },
                self.space,
            )
        };
        let after = || {
            draw(
                Paint::Sh {
                    sh: &relit.sh,
                    encoding: Encoding::Linear,
                },
                self.space,
            )
        };
        Ok(match self.view {
            View::Before => before()?,
            View::After | View::Diffuse | View::Specular => after()?,
            View::Split => present::split(&before()?, &after()?),
            View::Difference => present::difference(&before()?, &after()?, self.space),
            View::Depth => {
                let white = vec![[1.0; 3]; cloud.len()];
                present::depth_picture(&draw(Paint::Colors(&white), present::PLAIN)?, self.space)
            }
            View::Normals => {
                let colors = present::normal_colors(cloud, camera.eye, self.space);
                draw(Paint::Colors(&colors), present::PLAIN)?
            }
            View::Visibility => draw(Paint::Colors(&self.openness), present::PLAIN)?,
            View::Tau => draw(Paint::Colors(&relit.colors), present::PLAIN)?,
        })
    }

    fn fill_background(&self, raster: &mut Raster, camera: &Camera, relit: &Relit) {
        let scene = self.scene;
        match scene.look.background {
            Background::Transparent => {}
            Background::Color(color) => {
                let color = match self.space {
                    ColorSpace::Display(_) => color,
                    ColorSpace::Linear => color.map(transplat_core::color::srgb_decode),
                };
                present::composite(raster, |_, _| color);
            }
            Background::Environment => {
                let even = EnvironmentMap::even();
                let map = relit.map.as_ref().unwrap_or(&even);
                let world_from_asset = scene.asset_from_light(scene.look.rotate_target).transpose();
                let behind = present::environment_behind(
                    map,
                    camera,
                    world_from_asset,
                    scene.target_gain(),
                    self.space,
                );
                present::composite(raster, behind);
            }
        }
    }
}
