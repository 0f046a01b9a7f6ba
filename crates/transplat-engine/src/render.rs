//! Rendering of one image: surfels, ground, background, lens and grading.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, Result};
use glam::{DMat3, Vec2, Vec3};
use rayon::prelude::*;
use transplat_core::backplate::Backplate;
use transplat_core::bake::Bake;
use transplat_core::camera::{Camera, NEAR};
use transplat_core::color::{Display, srgb_decode, srgb_decode_all, srgb_encode};
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::files::{load_backplate, load_lut};
use transplat_core::ground::Ground;
use transplat_core::lut::Lut;
use transplat_core::present::{self, Background, PLAIN, View, in_space};
use transplat_core::probe::{Beyond, Cube, Probe};
use transplat_core::progress::{Progress, part, tell};
use transplat_core::rasterize::{ColorSpace, Raster};
use transplat_core::scene::{EnvironmentLight, Scene};
use transplat_core::surfels::{SurfelCloud, UpAxis};
use transplat_core::transfer::{PreparedTransfer, Relit};

use crate::device::{Paint, Painter};

/// Pictures with more samples than this are refused: their buffers would not fit.
pub const MAX_SAMPLES: usize = 1 << 28;

/// A light as what is seen behind the object.
pub struct Backdrop {
    /// Blurred already.
    pub map: Arc<EnvironmentMap>,
    /// Rotation from the scene to the map.
    pub map_from_asset: DMat3,
    /// Factor of each channel.
    pub gain: [f32; 3],
}

impl Backdrop {
    /// A light's map, turned and as strong as its settings say; `matched` is what brings it to the source's strength.
    pub fn new(
        map: Arc<EnvironmentMap>,
        settings: &EnvironmentLight,
        up: UpAxis,
        matched: f32,
    ) -> Self {
        Self {
            map,
            map_from_asset: settings.map_from_asset(up),
            gain: settings.gain().map(|g| g * matched),
        }
    }
}

/// The light at a place: what a splat shows around it as captured, some surfels left out (`[n]` or empty), and what is told beyond that.
pub fn light_at(
    (cloud, painter, hidden): (&Arc<SurfelCloud>, &Painter, &[bool]),
    (place, rows): (Vec3, usize),
    beyond: Beyond<'_>,
) -> Result<Probe> {
    let near = NEAR * cloud.bounds().radius;
    let cube = Cube::seen_from(place, near, rows, |camera| {
        let space = ColorSpace::Display(Display::default());
        painter.draw(camera, Paint::captured(cloud), space, hidden)
    })?;
    Ok(cube.light(rows, cloud.up, beyond))
}

/// Lit share of the ground's cells under an object's source and target, from the light of their maps.
pub fn lit_ground(
    ground: &Ground,
    scene: &Scene,
    maps: [&Illumination; 2],
    up: UpAxis,
) -> [Vec<f32>; 2] {
    let lights = scene.lights_on(maps, up);
    lights.map(|light| ground.lit_share(&light))
}

/// A look that another is compared with.
#[derive(Clone)]
pub struct Before {
    /// Relit colour of the surfels.
    pub relit: Relit,
    /// Exposure and tone curve.
    pub display: Display,
    /// LUT that it is graded by.
    pub lut: Option<Arc<Lut>>,
}

/// Surfels and surroundings under a pair of lights; empty where the view needs none of it.
#[derive(Default)]
pub struct Lit {
    /// The part of the relit colour that the view shows.
    pub relit: Option<Relit>,
    /// Colours of a channel that is none of the light's, `[n]`.
    pub colors: Vec<[f32; 3]>,
    /// Look that stands before a comparison in place of the capture.
    pub before: Option<Before>,
    /// Behind what is as captured, and behind what is relit.
    pub backdrops: [Option<Backdrop>; 2],
    /// Lit share of the ground's cells under source and target.
    pub ground: [Vec<f32>; 2],
}

impl Lit {
    /// Selects what a view shows of a relit result, which has only the view's part.
    pub fn of(
        view: View,
        relit: Relit,
        cloud: &SurfelCloud,
        bake: &Bake,
        prepared: &PreparedTransfer,
    ) -> Self {
        let mut lit = Self::default();
        match view {
            View::Tau => lit.colors = present::tau_colors(&relit.tau),
            View::Albedo | View::Emission => lit.colors = present::material_colors(view, prepared),
            View::Confidence => {
                let confidence = present::confidence(cloud, bake, prepared, &relit.tau);
                lit.colors = present::confidence_colors(&confidence);
            }
            _ => lit.relit = Some(relit),
        }
        lit
    }
}

/// Endings of photographs, for names that have none.
const ENDINGS: [&str; 6] = ["", "png", "jpg", "jpeg", "JPG", "exr"];

/// A photograph's file, whether its name has the ending or not.
pub fn photographs_named(file: &Path) -> impl Iterator<Item = PathBuf> + '_ {
    ENDINGS.iter().map(move |ending| match *ending {
        "" => file.to_owned(),
        ending => {
            let mut whole = file.as_os_str().to_owned();
            whole.push(format!(".{ending}"));
            whole.into()
        }
    })
}

/// Inputs of one image.
#[derive(Clone, Copy)]
struct Shot<'a> {
    camera: &'a Camera,
    /// Samples a pixel along each edge.
    factor: usize,
    lit: &'a Lit,
    /// Reduced to the picture's size.
    plate: Option<&'a Backplate>,
    progress: Progress<'a>,
}

/// Pixels that a lens may spread a point over without being seen to.
const SHARP: f32 = 0.5;

/// Square pixels that a part of a lens stands for, and how many parts a picture is the mean of.
const BLUR_PER_SAMPLE: f32 = 12.0;
const LENS_SAMPLES: [usize; 2] = [16, 256];

/// The asset, ready to be pictured.
pub struct Studio {
    /// Surfels that are drawn.
    pub cloud: Arc<SurfelCloud>,
    /// Settings of the image.
    pub scene: Scene,
    /// View that is drawn.
    pub view: View,
    /// Linear light, or display values.
    pub space: ColorSpace,
    /// Rasterizer with the surfels on its device.
    pub painter: Arc<Painter>,
    /// `[n]` or empty.
    pub hidden: Vec<bool>,
    /// Colours of the channel *visibility*; empty unless it is shown.
    pub openness: Vec<[f32; 3]>,
    /// Ground that catches shadows.
    pub ground: Option<Ground>,
    /// Behind it, where that is the background.
    pub plate: Option<Backplate>,
    /// LUT of an image for display.
    pub lut: Option<Arc<Lut>>,
}

impl Studio {
    /// A studio of a scene with nothing hidden.
    pub fn new(
        cloud: &Arc<SurfelCloud>,
        scene: Scene,
        view: View,
        linear: bool,
        painter: Arc<Painter>,
    ) -> Self {
        let display = scene
            .display
            .for_picture(scene.false_color && view.is_light());
        let scene = Scene {
            background: view.background(scene.background),
            ..scene
        };
        Self {
            cloud: cloud.clone(),
            view,
            space: if linear {
                ColorSpace::Linear
            } else {
                ColorSpace::Display(display)
            },
            painter,
            hidden: Vec::new(),
            openness: Vec::new(),
            ground: None,
            plate: None,
            lut: None,
            scene,
        }
    }

    /// Reads the plate that is behind it, where there is one.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn load_backplate(&mut self) -> Result<()> {
        let path = self.scene.plate.as_ref();
        let path = path.filter(|_| self.scene.background == Background::Backplate);
        self.plate = path.map(|path| load_backplate(path)).transpose()?;
        Ok(())
    }

    /// Reads the table of colours that it is graded by, where there is one.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn load_lut(&mut self) -> Result<()> {
        let path = self.scene.lut.as_ref().filter(|_| self.is_graded());
        let lut = path.map(|path| load_lut(path)).transpose()?;
        self.lut = lut.map(Arc::new);
        Ok(())
    }

    /// True for display values that a LUT may change.
    fn is_graded(&self) -> bool {
        let shows_stops = self.scene.false_color;
        self.view.is_graded() && self.space != ColorSpace::Linear && !shows_stops
    }

    /// Takes a picture with `factor` times `factor` samples a pixel, or as many as the lens needs.
    ///
    /// # Errors
    /// The device failed, or `progress` asked to stop.
    pub fn take(
        &self,
        camera: &Camera,
        factor: usize,
        lit: &Lit,
        progress: Progress<'_>,
    ) -> Result<Raster> {
        let shorter = camera.width.min(camera.height);
        let is_behind = self.scene.background == Background::Backplate;
        let plate = self.plate.as_ref().filter(|_| is_behind);
        let plate = plate.map(|plate| plate.reduced(shorter));
        let shot = Shot {
            camera,
            factor,
            lit,
            plate: plate.as_ref(),
            progress,
        };
        let mut raster = match self.view {
            View::SideBySide => {
                let half = half(camera);
                let shot = Shot {
                    camera: &half,
                    ..shot
                };
                let [left, right] = self.sides(shot)?;
                let both = present::side_by_side(&left, &right);
                // An odd column is left over at the right.
                if both.width < camera.width {
                    widened(&both)
                } else {
                    both
                }
            }
            View::Split => {
                let [left, right] = self.sides(shot)?;
                present::split(&left, &right, self.scene.wipe)
            }
            View::Difference => {
                let (before, after) = (self.before(shot)?, self.after(shot)?);
                let scale = self.scene.difference_scale;
                let difference = present::difference(&before, &after, self.space, scale);
                self.finished(difference, shot, 1)
            }
            View::Before => self.side(shot, 0)?,
            _ => self.side(shot, 1)?,
        };
        if self.scene.false_color && self.view.is_light() && self.space != ColorSpace::Linear {
            present::false_color_picture(&mut raster);
        }
        Ok(raster)
    }

    fn sides(&self, shot: Shot<'_>) -> Result<[Raster; 2]> {
        let of_before = part(shot.progress, 0.0, 0.5);
        let of_after = part(shot.progress, 0.5, 1.0);
        let progress: [Progress<'_>; 2] = [&of_before, &of_after];
        let side = |side: usize| {
            let progress = progress[side];
            self.side(Shot { progress, ..shot }, side)
        };
        Ok([side(0)?, side(1)?])
    }

    /// One side of a picture, 0 before and 1 after: through the lens, and graded.
    fn side(&self, shot: Shot<'_>, side: usize) -> Result<Raster> {
        let camera = shot.camera;
        let mut blur = camera.blur(present::depth_range(camera, &self.cloud.bounds()));
        let is_behind = self.scene.background == Background::Environment;
        if is_behind && shot.lit.backdrops[side].is_some() {
            blur = blur.max(camera.backdrop_blur());
        }
        let mut raster = if self.view.is_graded() && blur > SHARP {
            let by_blur = (blur * blur / BLUR_PER_SAMPLE) as usize;
            let fewest = LENS_SAMPLES[0].max(shot.factor * shot.factor);
            self.through_lens(shot, side, by_blur.clamp(fewest, LENS_SAMPLES[1]))?
        } else {
            self.sharp(shot, side)?
        };
        let lut = match &shot.lit.before {
            Some(before) if side == 0 && self.view != View::Before => &before.lut,
            _ => &self.lut,
        };
        if let Some(lut) = lut.as_ref().filter(|_| self.is_graded()) {
            present::recolor(&mut raster, |color| lut.apply(color));
        }
        Ok(raster)
    }

    /// The mean of what its parts see, as light adds up.
    fn through_lens(&self, shot: Shot<'_>, side: usize, count: usize) -> Result<Raster> {
        let mut mean: Option<Raster> = None;
        for (i, camera) in shot.camera.through_lens(count).enumerate() {
            tell(shot.progress, i as f64 / count as f64)?;
            let shot = Shot {
                camera: &camera,
                factor: 1,
                ..shot
            };
            let mut seen = self.sharp(shot, side)?;
            if self.space != ColorSpace::Linear {
                light_of(&mut seen);
            }
            let Some(mean) = &mut mean else {
                mean = Some(seen);
                continue;
            };
            let pixels = mean.pixels.par_iter_mut().zip(&seen.pixels);
            pixels.for_each(|(sum, seen)| sum.iter_mut().zip(seen).for_each(|(s, v)| *s += v));
            let depths = mean.depth.par_iter_mut().zip(&seen.depth);
            depths.for_each(|(sum, seen)| *sum += seen);
        }
        let mut mean = mean.context("a lens has parts")?;
        let share = 1.0 / count as f32;
        let pixels = mean.pixels.par_iter_mut();
        pixels.for_each(|pixel| pixel.iter_mut().for_each(|v| *v *= share));
        mean.depth.par_iter_mut().for_each(|depth| *depth *= share);
        if self.space != ColorSpace::Linear {
            present::recolor(&mut mean, |color| color.map(srgb_encode));
        }
        Ok(mean)
    }

    /// One side as a pinhole sees it.
    fn sharp(&self, shot: Shot<'_>, side: usize) -> Result<Raster> {
        let raster = match side {
            0 => self.before(shot)?,
            _ => self.after(shot)?,
        };
        Ok(self.finished(raster, shot, side))
    }

    fn paint(&self, shot: Shot<'_>, paint: Paint<'_>, space: ColorSpace) -> Result<Raster> {
        let camera = shot.camera.supersampled(shot.factor);
        let drawn = self.painter.draw(&camera, paint, space, &self.hidden)?;
        Ok(drawn.downsampled(shot.factor))
    }

    fn before(&self, shot: Shot<'_>) -> Result<Raster> {
        if let (Some(before), true) = (&shot.lit.before, self.view != View::Before) {
            let space = match self.space {
                ColorSpace::Display(_) => {
                    ColorSpace::Display(before.display.for_picture(self.scene.false_color))
                }
                ColorSpace::Linear => ColorSpace::Linear,
            };
            return self.paint(shot, Paint::relit(&before.relit), space);
        }
        self.paint(shot, Paint::captured(&self.cloud), self.space)
    }

    fn after(&self, shot: Shot<'_>) -> Result<Raster> {
        let (cloud, camera, lit) = (&self.cloud, shot.camera, shot.lit);
        let colors = |colors: &[[f32; 3]]| self.paint(shot, Paint::Colors(colors), PLAIN);
        match self.view {
            View::Depth => {
                let white = vec![[1.0; 3]; cloud.len()];
                let range = present::depth_range(camera, &cloud.bounds());
                Ok(present::depth_picture(&colors(&white)?, self.space, range))
            }
            View::Normals => colors(&present::normal_colors(cloud, camera.eye, self.space)),
            View::Visibility => colors(&self.openness),
            View::Albedo | View::Emission | View::Tau | View::Confidence => colors(&lit.colors),
            _ => {
                let relit = lit.relit.as_ref().context("nothing is relit")?;
                self.paint(shot, Paint::relit(relit), self.space)
            }
        }
    }

    /// Puts ground and background under a picture; `side` is 0 before and 1 after.
    fn finished(&self, mut raster: Raster, shot: Shot<'_>, side: usize) -> Raster {
        let (camera, lit) = (shot.camera, shot.lit);
        let share = &lit.ground[side];
        if let (Some(ground), false) = (&self.ground, share.is_empty()) {
            present::composite(&mut raster, |x, y| {
                let shadow = ground.shadow(share, camera, x, y, self.space);
                [0.0, 0.0, 0.0, shadow]
            });
        }
        let background = self.scene.background;
        let height = camera.height;
        match (background, &lit.backdrops[side]) {
            (Background::Transparent, _) | (Background::Environment, None) => {}
            (Background::Backplate, _) => {
                if let Some(plate) = shot.plate {
                    // A photograph has its own lens behind it.
                    let camera = &Camera {
                        shift: Vec2::ZERO,
                        ..*camera
                    };
                    present::composite(&mut raster, |x, y| {
                        let color = plate.at(camera, x, y, self.space);
                        color.map_or([0.0; 4], opaque)
                    });
                }
            }
            (Background::Environment, Some(backdrop)) => {
                let turn = backdrop.map_from_asset.as_mat3();
                present::composite(&mut raster, |x, y| {
                    let radiance = backdrop.map.sample(turn * camera.backdrop_ray(x, y));
                    let gained = std::array::from_fn(|c| radiance[c] * backdrop.gain[c]);
                    opaque(in_space(gained, self.space))
                });
            }
            _ => present::composite(&mut raster, |x, y| {
                let color = present::plain_background(background, x, y, height);
                color.map_or([0.0; 4], |color| match self.space {
                    ColorSpace::Display(_) => opaque(color),
                    ColorSpace::Linear => opaque(color.map(srgb_decode)),
                })
            }),
        }
        raster
    }
}

/// From values for display, beyond white too, to the display's light.
fn light_of(raster: &mut Raster) {
    raster.pixels.par_chunks_mut(4096).for_each(|pixels| {
        let straight = |[r, g, b, a]: &[f32; 4]| {
            let by = if *a > 0.0 { 1.0 / a } else { 0.0 };
            [r, g, b].map(|v| (v * by).max(0.0))
        };
        let mut values: Vec<f32> = pixels.iter().flat_map(straight).collect();
        srgb_decode_all(&mut values);
        for (pixel, light) in pixels.iter_mut().zip(values.chunks_exact(3)) {
            let [r, g, b, a] = pixel;
            for (v, light) in [r, g, b].into_iter().zip(light) {
                *v = light * *a;
            }
        }
    });
}

fn opaque([r, g, b]: [f32; 3]) -> [f32; 4] {
    [r, g, b, 1.0]
}

/// The camera of one of two pictures beside each other, which shows as much of the object.
pub fn half(camera: &Camera) -> Camera {
    let width = (camera.width / 2).max(1);
    let edge = |width: usize| width.min(camera.height) as f32;
    let scale = edge(width) / edge(camera.width);
    Camera {
        width,
        focal: camera.focal * scale,
        backdrop_focal: camera.backdrop_focal * scale,
        ..*camera
    }
}

/// With its last column twice.
fn widened(raster: &Raster) -> Raster {
    let wider = |row: &[[f32; 4]]| [row, &row[row.len() - 1..]].concat();
    let deeper = |row: &[f32]| [row, &[0.0]].concat();
    Raster {
        width: raster.width + 1,
        height: raster.height,
        pixels: raster.pixels.chunks(raster.width).flat_map(wider).collect(),
        depth: raster.depth.chunks(raster.width).flat_map(deeper).collect(),
    }
}
