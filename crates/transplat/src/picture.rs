//! One picture of the asset, as a look asks for it: what `render` writes and what the viewer saves go through here.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, Result};
use glam::{DMat3, Vec3};
use transplat_core::bake::Bake;
use transplat_core::camera::{Camera, NEAR};
use transplat_core::color::{Display, srgb_decode};
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::files::load_plate;
use transplat_core::ground::Ground;
use transplat_core::plate::Plate;
use transplat_core::present::{self, Background, PLAIN, View, in_space};
use transplat_core::probe::{Beyond, Cube, Probe};
use transplat_core::rasterize::{ColorSpace, Raster};
use transplat_core::scene::{EnvironmentLight, Object, Scene};
use transplat_core::surfels::{SurfelCloud, UpAxis};
use transplat_core::transfer::{PreparedTransfer, Relit};

use crate::device::{Paint, Painter};

/// A light as what is seen behind the object.
pub struct Backdrop {
    /// Blurred already.
    pub map: Arc<EnvironmentMap>,
    pub map_from_asset: DMat3,
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
    object: &Object,
    maps: [&Illumination; 2],
    up: UpAxis,
) -> [Vec<f32>; 2] {
    let lights = scene.lights_on(object, maps, up);
    lights.map(|light| ground.lit_share(&light.radiance))
}

/// What a pair of lights makes of the asset; empty where the view needs none of it.
#[derive(Default)]
pub struct Lit {
    /// The part of the relit colour that the view shows.
    pub relit: Option<Relit>,
    /// Colours of a channel that is none of the light's, `[n]`.
    pub colors: Vec<[f32; 3]>,
    /// What stands before a comparison instead of the capture, and its display.
    pub before: Option<(Relit, Display)>,
    /// Behind what is as captured, and behind what is relit.
    pub backdrops: [Option<Backdrop>; 2],
    /// Lit share of the ground's cells under source and target.
    pub ground: [Vec<f32>; 2],
}

impl Lit {
    /// What a view shows of a relit result, which has only the view's part.
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
            View::Doubts => {
                let doubts = present::doubts(cloud, bake, prepared, &relit.tau);
                lit.colors = present::doubt_colors(&doubts);
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

/// What one picture is taken with.
#[derive(Clone, Copy)]
struct Shot<'a> {
    camera: &'a Camera,
    /// Samples a pixel along each edge.
    factor: usize,
    lit: &'a Lit,
}

/// The asset, ready to be pictured.
pub struct Studio {
    pub cloud: Arc<SurfelCloud>,
    pub scene: Scene,
    pub view: View,
    pub space: ColorSpace,
    pub painter: Painter,
    /// `[n]` or empty.
    pub hidden: Vec<bool>,
    /// Of the channel *visibility*, as surfel colours; empty unless it is what is shown.
    pub openness: Vec<[f32; 3]>,
    pub ground: Option<Ground>,
    /// Behind it, where that is the background.
    pub plate: Option<Plate>,
}

impl Studio {
    /// What a scene shows, with nothing hidden.
    pub fn new(
        cloud: &Arc<SurfelCloud>,
        scene: Scene,
        view: View,
        linear: bool,
        painter: Painter,
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
            scene,
        }
    }

    /// Reads the plate that is behind it, where there is one.
    ///
    /// # Errors
    /// It cannot be read.
    pub fn load_plate(&mut self) -> Result<()> {
        let path = self.scene.plate.as_ref();
        let path = path.filter(|_| self.scene.background == Background::Plate);
        self.plate = path.map(|path| load_plate(path)).transpose()?;
        Ok(())
    }

    /// Takes a picture with `factor` times `factor` samples a pixel.
    ///
    /// # Errors
    /// The device failed.
    pub fn take(&self, camera: &Camera, factor: usize, lit: &Lit) -> Result<Raster> {
        let shot = Shot {
            camera,
            factor,
            lit,
        };
        let mut raster = match self.view {
            View::SideBySide => {
                let half = half(camera);
                let shot = Shot {
                    camera: &half,
                    ..shot
                };
                let both = present::side_by_side(
                    &self.finished(self.before(shot)?, shot, 0),
                    &self.finished(self.after(shot)?, shot, 1),
                );
                // An odd column is left over at the right.
                if both.width < camera.width {
                    widened(&both)
                } else {
                    both
                }
            }
            View::Split => {
                let left = self.finished(self.before(shot)?, shot, 0);
                let right = self.finished(self.after(shot)?, shot, 1);
                present::split(&left, &right, self.scene.wipe)
            }
            View::Difference => {
                let (before, after) = (self.before(shot)?, self.after(shot)?);
                let scale = self.scene.difference_scale;
                let difference = present::difference(&before, &after, self.space, scale);
                self.finished(difference, shot, 1)
            }
            View::Before => self.finished(self.before(shot)?, shot, 0),
            _ => self.finished(self.after(shot)?, shot, 1),
        };
        if self.scene.false_color && self.view.is_light() && self.space != ColorSpace::Linear {
            present::false_color_picture(&mut raster);
        }
        Ok(raster)
    }

    fn paint(&self, shot: Shot<'_>, paint: Paint<'_>, space: ColorSpace) -> Result<Raster> {
        let camera = shot.camera.supersampled(shot.factor);
        let drawn = self.painter.draw(&camera, paint, space, &self.hidden)?;
        Ok(drawn.downsampled(shot.factor))
    }

    fn before(&self, shot: Shot<'_>) -> Result<Raster> {
        if let (Some((relit, display)), true) = (&shot.lit.before, self.view != View::Before) {
            let space = match self.space {
                ColorSpace::Display(_) => {
                    ColorSpace::Display(display.for_picture(self.scene.false_color))
                }
                ColorSpace::Linear => ColorSpace::Linear,
            };
            return self.paint(shot, Paint::relit(relit), space);
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
            View::Tau | View::Doubts => colors(&lit.colors),
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
            (Background::Plate, _) => {
                let shorter = camera.width.min(camera.height);
                if let Some(plate) = self.plate.as_ref().map(|p| p.reduced(shorter)) {
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
