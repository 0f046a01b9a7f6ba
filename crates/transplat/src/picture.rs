//! One picture of the asset, as a look asks for it: what `render` writes and what the viewer saves go through here.

use std::sync::Arc;

use anyhow::Result;
use glam::DMat3;
use transplat_core::camera::Camera;
use transplat_core::color::{Display, Encoding, srgb_decode};
use transplat_core::environment::EnvironmentMap;
use transplat_core::ground::Ground;
use transplat_core::look::Look;
use transplat_core::present::{self, Background, PLAIN, View, in_space};
use transplat_core::rasterize::{ColorSpace, Raster};
use transplat_core::sh::coefficient_count;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::PreparedTransfer;
use transplat_core::visibility::Visibility;

use crate::device::{Paint, Painter};

/// A light as what is seen behind the object.
pub struct Backdrop {
    /// Blurred already.
    pub map: Arc<EnvironmentMap>,
    pub map_from_asset: DMat3,
    pub gain: [f32; 3],
}

/// What a pair of lights makes of the asset; empty where the view needs none of it.
#[derive(Default)]
pub struct Lit {
    /// Linear SH `[n][K][3]`, already the part that the view shows.
    pub sh: Vec<[f32; 3]>,
    /// Colours of a channel that is none of the light's, `[n]`.
    pub colors: Vec<[f32; 3]>,
    /// What stands before a comparison instead of the capture: linear SH and its display.
    pub before: Option<(Vec<[f32; 3]>, Display)>,
    /// Behind what is as captured, and behind what is relit.
    pub backdrops: [Option<Backdrop>; 2],
    /// Lit share of the ground's cells.
    pub ground: Vec<f32>,
}

impl Lit {
    /// The parts of a relit result that a view shows.
    pub fn of(
        view: View,
        relit: Vec<[f32; 3]>,
        cloud: &SurfelCloud,
        visibility: &Visibility,
        prepared: &PreparedTransfer,
    ) -> Self {
        let mut lit = Self::default();
        match view {
            View::Tau => lit.colors = present::tau_colors(&prepared.tau(&relit)),
            View::Doubts => {
                let doubts = present::doubts(cloud, visibility, prepared, &prepared.tau(&relit));
                lit.colors = present::doubt_colors(&doubts);
            }
            View::Diffuse | View::Specular => {
                let diffuse = view == View::Diffuse;
                lit.sh = present::part_of_sh(&relit, prepared.coefficients(), diffuse);
            }
            _ => lit.sh = relit,
        }
        lit
    }
}

/// The asset, ready to be pictured.
pub struct Studio {
    pub cloud: Arc<SurfelCloud>,
    pub look: Look,
    pub view: View,
    pub space: ColorSpace,
    pub painter: Painter,
    /// `[n]` or empty.
    pub hidden: Vec<bool>,
    /// Of the channel *visibility*, as surfel colours; empty unless it is what is shown.
    pub openness: Vec<[f32; 3]>,
    pub ground: Option<Ground>,
}

impl Studio {
    /// An asset with what its look hides.
    pub fn new(
        cloud: &Arc<SurfelCloud>,
        look: Look,
        view: View,
        linear: bool,
        painter: Painter,
    ) -> Self {
        let display = if look.false_color {
            // Made of the sRGB curve alone, which can be undone.
            Display {
                exposure: look.display.exposure,
                ..Display::default()
            }
        } else {
            look.display
        };
        let hidden = if look.hide.is_off() {
            Vec::new()
        } else {
            look.hide.hidden(cloud, &cloud.bounds())
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
            hidden,
            openness: Vec::new(),
            ground: None,
            look,
        }
    }

    /// Takes a picture with `factor` times `factor` samples a pixel.
    ///
    /// # Errors
    /// The device failed.
    pub fn take(&self, camera: &Camera, factor: usize, lit: &Lit) -> Result<Raster> {
        let camera = camera.supersampled(factor);
        let raster = match self.view {
            View::SideBySide => {
                let half = half(&camera);
                let left = self.finished(self.before(&half, lit)?, &half, lit, 0);
                let right = self.finished(self.after(&half, lit)?, &half, lit, 1);
                let mut both = present::side_by_side(&left, &right);
                // An odd column is left over at the right.
                if both.width < camera.width {
                    both = widened(&both, camera.width);
                }
                both
            }
            View::Split => {
                let left = self.finished(self.before(&camera, lit)?, &camera, lit, 0);
                let right = self.finished(self.after(&camera, lit)?, &camera, lit, 1);
                present::split(&left, &right, self.look.wipe)
            }
            View::Difference => {
                let (before, after) = (self.before(&camera, lit)?, self.after(&camera, lit)?);
                let scale = self.look.difference_scale;
                let difference = present::difference(&before, &after, self.space, scale);
                self.finished(difference, &camera, lit, 1)
            }
            View::Before => self.finished(self.before(&camera, lit)?, &camera, lit, 0),
            _ => self.finished(self.after(&camera, lit)?, &camera, lit, 1),
        };
        let mut raster = raster.downsampled(factor);
        if self.look.false_color && self.space != ColorSpace::Linear {
            present::false_color_picture(&mut raster);
        }
        Ok(raster)
    }

    fn paint(&self, camera: &Camera, paint: Paint<'_>, space: ColorSpace) -> Result<Raster> {
        self.painter.draw(camera, paint, space, &self.hidden)
    }

    fn before(&self, camera: &Camera, lit: &Lit) -> Result<Raster> {
        let cloud = &self.cloud;
        if let (Some((sh, display)), true) = (&lit.before, self.view != View::Before) {
            let space = match self.space {
                ColorSpace::Display(_) => ColorSpace::Display(*display),
                ColorSpace::Linear => ColorSpace::Linear,
            };
            let encoding = Encoding::Linear;
            return self.paint(camera, Paint::Sh { sh, encoding }, space);
        }
        let (sh, encoding) = (&cloud.sh, cloud.encoding);
        self.paint(camera, Paint::Sh { sh, encoding }, self.space)
    }

    fn after(&self, camera: &Camera, lit: &Lit) -> Result<Raster> {
        let cloud = &self.cloud;
        let colors = |colors: &[[f32; 3]]| self.paint(camera, Paint::Colors(colors), PLAIN);
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
                assert_eq!(
                    lit.sh.len(),
                    cloud.len() * coefficient_count(cloud.sh_degree)
                );
                let encoding = Encoding::Linear;
                self.paint(
                    camera,
                    Paint::Sh {
                        sh: &lit.sh,
                        encoding,
                    },
                    self.space,
                )
            }
        }
    }

    /// Puts ground and background under a picture; `side` is 0 before and 1 after.
    fn finished(&self, mut raster: Raster, camera: &Camera, lit: &Lit, side: usize) -> Raster {
        if let (Some(ground), false) = (&self.ground, lit.ground.is_empty()) {
            present::composite(&mut raster, |x, y| {
                [
                    0.0,
                    0.0,
                    0.0,
                    ground.shadow(&lit.ground, camera, x, y, self.space),
                ]
            });
        }
        let background = self.look.background;
        let height = camera.height;
        match (background, &lit.backdrops[side]) {
            (Background::Transparent, _) | (Background::Environment, None) => {}
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

fn widened(raster: &Raster, width: usize) -> Raster {
    let wider = |row: &[[f32; 4]]| {
        let last = row.last().copied().unwrap_or_default();
        let mut row = row.to_vec();
        row.resize(width, last);
        row
    };
    let deeper = |row: &[f32]| {
        let mut row = row.to_vec();
        row.resize(width, 0.0);
        row
    };
    Raster {
        width,
        height: raster.height,
        pixels: raster.pixels.chunks(raster.width).flat_map(wider).collect(),
        depth: raster.depth.chunks(raster.width).flat_map(deeper).collect(),
    }
}
