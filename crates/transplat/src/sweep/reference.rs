//! The f64 oracle's results with everything at its best, on a thinned asset.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use rayon::prelude::*;
use transplat_core::camera::Camera;
use transplat_core::color::decode_sh;
use transplat_core::look::CameraPose;
use transplat_core::oracle::{OracleBest, OracleTransfer, difference, relight_asset};
use transplat_core::present::PLAIN;
use transplat_core::sh::{MAX_DEGREE, lattice};
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::{PreparedTransfer, Preset, Relit, TransferSettings};
use transplat_core::visibility::occlusion::Occlusion;
use transplat_core::visibility::{Bake, Visibility, no_progress};

use super::{Numeric, Subject};
use crate::device::{Device, Paint, Painter};
use crate::metrics::Picture;

/// Surfels of the thinned asset.
const SURFELS: usize = 800;

/// Directions of the reference's visibility, which rays ask exactly.
const DIRECTIONS: usize = 2048;

/// Width and height of the picture.
const SIZE: usize = 256;

/// The thinned asset with its exact results.
pub struct Reference {
    pub cloud: SurfelCloud,
    /// Preset `best`'s bake of it.
    pub occlusion: Bake,
    exact: Vec<Exact>,
    painter: Painter,
    camera: Camera,
}

/// What a preset would show without any numerical error.
struct Exact {
    preset: Preset,
    sh: Vec<[f64; 3]>,
    picture: Picture,
}

impl Reference {
    pub fn new(subject: &Subject) -> Result<Self> {
        let cloud = subject.cloud.thinned(SURFELS);
        let occlusion = Arc::new(Occlusion::bake(&cloud, &no_progress)?);
        let painter = Device::Cpu.painter(&Arc::new(cloud.clone()))?.0;
        let bounds = cloud.bounds();
        let pose = CameraPose {
            pivot: bounds.center,
            azimuth: 30.0,
            elevation: 25.0,
            distance: 3.2 * bounds.radius,
            fov: 40.0,
            orthographic: false,
        };
        let mut reference = Self {
            camera: Camera::from_pose(&pose, cloud.up, [SIZE, SIZE], bounds.radius),
            painter,
            occlusion: Bake::Occlusion(occlusion.clone()),
            exact: Vec::new(),
            cloud,
        };
        let [source, target] = &subject.lights;
        let best = {
            let (_, beams) = source.for_best()?;
            let (_, target) = target.for_best()?;
            let epsilon = Preset::Best.epsilon();
            OracleBest::new(&reference.cloud, &occlusion, beams, epsilon)
                .trusting(source.trust)
                .relight(target)
        };
        let paper = reference.paper(&occlusion, subject)?;
        for (preset, sh) in [(Preset::Best, best), (Preset::Paper, paper)] {
            let narrow: Vec<[f32; 3]> = sh.iter().map(|v| v.map(|v| v as f32)).collect();
            let relit = reference.as_relit(preset, narrow);
            let picture = reference.picture(&relit)?;
            reference.exact.push(Exact {
                preset,
                sh,
                picture,
            });
        }
        Ok(reference)
    }

    fn as_relit(&self, preset: Preset, sh: Vec<[f32; 3]>) -> Relit {
        Relit {
            sh,
            degree: self.cloud.sh_degree,
            encoding: match preset {
                Preset::Best => self.cloud.encoding,
                Preset::Paper => transplat_core::color::Encoding::Linear,
            },
            tau: Vec::new(),
        }
    }

    /// Preset `paper` of the highest degree, on visibility by rays.
    fn paper(&self, occlusion: &Occlusion, subject: &Subject) -> Result<Vec<[f64; 3]>> {
        let mut open = vec![0u8; self.cloud.len() * DIRECTIONS];
        let columns: Vec<Vec<bool>> = lattice(DIRECTIONS)
            .into_par_iter()
            .map(|d| occlusion.tracer.open_towards(d, |_| true))
            .collect();
        for (j, column) in columns.iter().enumerate() {
            for (i, is_open) in column.iter().enumerate() {
                open[i * DIRECTIONS + j] = if *is_open { 255 } else { 0 };
            }
        }
        let visibility = Visibility::from_open(&self.cloud, DIRECTIONS, open);
        let settings = TransferSettings {
            sh_degree: MAX_DEGREE,
            ..TransferSettings::of(Preset::Paper)
        };
        let lights = &subject.lights;
        // Which side of a two-sided surfel counts is production's choice.
        let bake = Bake::Visibility(visibility);
        let prepared = PreparedTransfer::new(&self.cloud, &bake, &lights[0], &settings)?;
        let (PreparedTransfer::Paper(prepared), Bake::Visibility(visibility)) = (prepared, bake)
        else {
            bail!("preset paper prepares something else");
        };
        let [source, target] = [0, 1].map(|side| lights[side].radiance.truncated(MAX_DEGREE));
        let oracle = OracleTransfer::new(&source, &target, &settings);
        let color = self.linear_color();
        Ok(relight_asset(
            &oracle,
            &color,
            &prepared.normals,
            &visibility,
        ))
    }

    fn linear_color(&self) -> Vec<[f32; 3]> {
        decode_sh(&self.cloud.sh, self.cloud.sh_degree, self.cloud.encoding)
    }

    fn picture(&self, relit: &Relit) -> Result<Picture> {
        let paint = Paint::Sh {
            sh: &relit.sh,
            degree: relit.degree,
            encoding: relit.encoding,
        };
        let raster = self.painter.draw(&self.camera, paint, PLAIN, &[])?;
        Ok(Picture::of_display(&raster))
    }

    /// How far a relit thinned asset is from the oracle's.
    pub fn compare(&self, preset: Preset, relit: &Relit) -> Result<Numeric> {
        let exact = self.exact.iter().find(|e| e.preset == preset);
        let exact = exact.context("a reference for each preset")?;
        let psnr = self.picture(relit)?.psnr(&exact.picture, None)?;
        Ok(Numeric {
            psnr: Some(psnr),
            ..errors(&relit.clone().of_degree(self.cloud.sh_degree).sh, &exact.sh)
        })
    }

    /// Preset `paper` with reflections that are projected by samples, in f64.
    pub fn relit_by_samples(
        &self,
        prepared: &PreparedTransfer,
        thinned: &Bake,
        subject: &Subject,
        samples: usize,
    ) -> Result<Relit> {
        let (PreparedTransfer::Paper(paper), Bake::Visibility(visibility)) = (prepared, thinned)
        else {
            bail!("only preset paper reflects by samples");
        };
        let oracle = sampled(paper.settings.clone(), subject, samples);
        let sh = relight_asset(&oracle, &self.linear_color(), &paper.normals, visibility);
        let narrow = sh.iter().map(|v| v.map(|v| v as f32)).collect();
        Ok(self.as_relit(Preset::Paper, narrow))
    }

    /// Milliseconds that reflections by samples take for the whole asset, in plain f64.
    pub fn reflection_ms(
        &self,
        prepared: &PreparedTransfer,
        subject: &Subject,
        samples: usize,
    ) -> f64 {
        let PreparedTransfer::Paper(paper) = prepared else {
            return 0.0;
        };
        let oracle = sampled(paper.settings.clone(), subject, samples);
        let start = Instant::now();
        let sums: f64 = paper
            .normals
            .par_iter()
            .map(|n| oracle.reflection(n.to_array().map(f64::from)))
            .sum();
        std::hint::black_box(sums);
        start.elapsed().as_secs_f64() * 1e3
    }
}

fn sampled(settings: TransferSettings, subject: &Subject, samples: usize) -> OracleTransfer {
    let [source, target] =
        [0, 1].map(|side| subject.lights[side].radiance.truncated(settings.sh_degree));
    OracleTransfer::new(&source, &target, &settings).with_samples(samples)
}

/// Without a picture.
pub fn errors<T: Copy + Into<f64>>(got: &[[T; 3]], exact: &[[f64; 3]]) -> Numeric {
    let (rel_l2, max_abs) = difference(got, exact);
    Numeric {
        rel_l2,
        max_abs,
        psnr: None,
    }
}
