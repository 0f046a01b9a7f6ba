//! True images, with the same views of the splat.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context, Result, bail};
use transplat_core::camera::{Camera, NEAR};
use transplat_core::environment::Illumination;
use transplat_core::files::{load_cameras, load_environment, load_picture};
use transplat_core::present::PLAIN;
use transplat_core::rasterize::Raster;
use transplat_core::settings::Method;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::Relit;

use super::{TruthLight, TruthObject};
use crate::metrics::ComparedImage;
use transplat_engine::device::{Device, Paint, Painter};

/// The truth under one light.
pub struct TruthTarget {
    /// Target light.
    pub light: TruthLight,
    /// The light as its map holds it.
    pub illumination: Illumination,
    /// One a camera.
    pub pictures: Vec<ComparedImage>,
    /// Pixels that the object covers for the most part.
    pub masks: Vec<Vec<bool>>,
}

/// All true pictures of an object, and the cameras that they were taken by.
pub struct Views {
    painter: Painter,
    cloud: Arc<SurfelCloud>,
    cameras: Vec<Camera>,
    /// Target lights with their true images.
    pub targets: Vec<TruthTarget>,
}

impl Views {
    /// Loads the true images of an object.
    pub fn load(object: &TruthObject, cloud: &Arc<SurfelCloud>, device: &Device) -> Result<Self> {
        let file = load_cameras(&object.cameras)?;
        let targets = object
            .targets
            .iter()
            .map(|target| {
                let rasters = load_pictures(&object.pictures(target)?, file.frames.len())?;
                Ok(TruthTarget {
                    light: target.clone(),
                    illumination: light(target, device)?,
                    pictures: rasters.iter().map(ComparedImage::of_linear).collect(),
                    masks: rasters
                        .iter()
                        .map(|r| r.pixels.iter().map(|p| p[3] > 0.5).collect())
                        .collect(),
                })
            })
            .collect::<Result<Vec<TruthTarget>>>()?;
        let near = NEAR * cloud.bounds().radius;
        let first = targets.first().and_then(|t| t.pictures.first());
        let size = first.map(|p| [p.width, p.height]).or(file.size());
        let size = size.with_context(|| format!("{}: no size", object.cameras.display()))?;
        let frames = file.frames.iter();
        Ok(Self {
            painter: device.painter(cloud)?.0,
            cloud: cloud.clone(),
            cameras: frames.map(|f| f.camera(size, near)).collect(),
            targets,
        })
    }

    /// The splat as it was captured, or relit, from each camera.
    pub fn pictures(&self, relit: Option<&Relit>) -> Result<Vec<ComparedImage>> {
        let paint = relit.map_or_else(|| Paint::captured(&self.cloud), Paint::relit);
        let cameras = self.cameras.iter();
        cameras
            .map(|camera| {
                let raster = self.painter.draw(camera, paint, PLAIN, &[])?;
                Ok(ComparedImage::of_display(&raster))
            })
            .collect()
    }

    /// PSNR in dB of relit splats, the mean over all lights and cameras.
    pub fn psnr(&self, mut relight: impl FnMut(&Illumination) -> Result<Relit>) -> Result<f64> {
        let mut scores = Vec::new();
        for target in &self.targets {
            let relit = relight(&target.illumination)?;
            for (ours, truth) in self.pictures(Some(&relit))?.iter().zip(&target.pictures) {
                scores.push(ours.psnr(truth, None)?);
            }
        }
        Ok(scores.iter().sum::<f64>() / scores.len().max(1) as f64)
    }
}

/// A light in the forms that both methods need.
pub fn light(light: &TruthLight, device: &Device) -> Result<Illumination> {
    device.light(&load_environment(&light.path)?, Method::Directional)
}

/// The true pictures under one light, which are of one size and show the object.
fn load_pictures(paths: &[PathBuf], cameras: usize) -> Result<Vec<Raster>> {
    let folder = paths.first().and_then(|p| p.parent());
    let folder = folder.map_or(String::new(), |f| f.display().to_string());
    if paths.len() != cameras {
        bail!("{folder}: {} images for {cameras} cameras", paths.len());
    }
    let mut rasters: Vec<Raster> = Vec::new();
    for path in paths {
        let name = || path.display().to_string();
        let raster = load_picture(path)?;
        if let Some(first) = rasters.first()
            && (first.width, first.height) != (raster.width, raster.height)
        {
            bail!(
                "{}: {} x {} pixels, and the first image has {} x {}",
                name(),
                raster.width,
                raster.height,
                first.width,
                first.height
            );
        }
        if !raster.pixels.iter().flatten().all(|v| v.is_finite()) {
            bail!("{}: holds values that are no numbers", name());
        }
        if !raster.pixels.iter().any(|p| p[3] > 0.5) {
            bail!("{}: shows nothing of the object", name());
        }
        rasters.push(raster);
    }
    Ok(rasters)
}
