//! Reference of the sweep: the f64 oracle at its best, on a thinned splat.

use std::sync::Arc;
use std::time::Instant;

use anyhow::{Context, Result, bail};
use rayon::prelude::*;
use transplat_core::bake::Bake;
use transplat_core::bake::directional::DirectionalBake;
use transplat_core::bake::harmonic::HarmonicBake;
use transplat_core::camera::{Camera, CameraPose};
use transplat_core::color::decode_sh;
use transplat_core::oracle::{OracleDirectional, OracleHarmonic, difference, relight_asset};
use transplat_core::present::PLAIN;
use transplat_core::progress::no_progress;
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::sh::{MAX_DEGREE, lattice};
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::{PreparedTransfer, Relit};

use super::subject::{Numeric, Subject};
use crate::metrics::ComparedImage;
use transplat_engine::device::{Device, Paint, Painter};

/// Surfels of the thinned asset.
const SURFELS: usize = 800;

/// Directions of the reference's visibility, which rays ask exactly.
const DIRECTIONS: usize = 2048;

/// Width and height of the picture.
const SIZE: usize = 256;

/// The thinned asset with its exact results.
pub struct Reference {
    pub cloud: SurfelCloud,
    /// The directional method's bake of it.
    pub directional: Bake,
    exact: Vec<Exact>,
    painter: Painter,
    camera: Camera,
}

/// Image of a method without numerical error.
struct Exact {
    method: Method,
    sh: Vec<[f64; 3]>,
    picture: ComparedImage,
}

impl Reference {
    pub fn new(subject: &Subject) -> Result<Self> {
        let cloud = subject.cloud.thinned(SURFELS);
        let directional = Arc::new(DirectionalBake::bake(&cloud, &no_progress)?);
        let painter = Device::Cpu.painter(&Arc::new(cloud.clone()))?.0;
        let bounds = cloud.bounds();
        let pose = CameraPose::around(&bounds, 30.0, 25.0, 3.2, 40.0);
        let mut reference = Self {
            camera: Camera::from_pose(&pose, cloud.up, [SIZE, SIZE], bounds.radius),
            painter,
            directional: Bake::Directional(directional.clone()),
            exact: Vec::new(),
            cloud,
        };
        let [source, target] = &subject.lights;
        let by_directions = {
            let (_, light_samples) = source.for_directional()?;
            let (_, target) = target.for_directional()?;
            let epsilon = Method::Directional.epsilon();
            OracleDirectional::new(&reference.cloud, &directional, light_samples, epsilon)
                .trusting(source.trust)
                .relight(target)
        };
        let by_harmonics = reference.harmonic(&directional, subject)?;
        for (method, sh) in [
            (Method::Directional, by_directions),
            (Method::Harmonic, by_harmonics),
        ] {
            let narrow: Vec<[f32; 3]> = sh.iter().map(|v| v.map(|v| v as f32)).collect();
            let relit = reference.as_relit(method, narrow);
            let picture = reference.picture(&relit)?;
            reference.exact.push(Exact {
                method,
                sh,
                picture,
            });
        }
        Ok(reference)
    }

    fn as_relit(&self, method: Method, sh: Vec<[f32; 3]>) -> Relit {
        Relit {
            sh,
            degree: self.cloud.sh_degree,
            encoding: match method {
                Method::Directional => self.cloud.encoding,
                Method::Harmonic => transplat_core::color::Encoding::Linear,
            },
            shadows: Vec::new(),
            tau: Vec::new(),
        }
    }

    /// The harmonic method of the highest degree, on visibility by rays.
    fn harmonic(&self, directional: &DirectionalBake, subject: &Subject) -> Result<Vec<[f64; 3]>> {
        let mut open = vec![0u8; self.cloud.len() * DIRECTIONS];
        let columns: Vec<Vec<bool>> = lattice(DIRECTIONS)
            .into_par_iter()
            .map(|d| directional.tracer.open_towards(d, |_| true))
            .collect();
        for (j, column) in columns.iter().enumerate() {
            for (i, is_open) in column.iter().enumerate() {
                open[i * DIRECTIONS + j] = if *is_open { 255 } else { 0 };
            }
        }
        let visibility = HarmonicBake::from_open(&self.cloud, DIRECTIONS, open);
        let settings = TransferSettings {
            sh_degree: MAX_DEGREE,
            ..TransferSettings::of(Method::Harmonic)
        };
        let lights = &subject.lights;
        // Which side of a two-sided surfel counts is production's choice.
        let bake = Bake::Harmonic(visibility.into());
        let prepared = PreparedTransfer::new(&self.cloud, &bake, &lights[0], &settings)?;
        let (PreparedTransfer::Harmonic(prepared), Bake::Harmonic(visibility)) = (prepared, bake)
        else {
            bail!("preset paper prepares something else");
        };
        let [source, target] = [0, 1].map(|side| lights[side].radiance.truncated(MAX_DEGREE));
        let oracle = OracleHarmonic::new(&source, &target, &settings);
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

    fn picture(&self, relit: &Relit) -> Result<ComparedImage> {
        let paint = Paint::relit(relit);
        let raster = self.painter.draw(&self.camera, paint, PLAIN, &[])?;
        Ok(ComparedImage::of_display(&raster))
    }

    /// Error of a relit thinned splat against the oracle's.
    pub fn compare(&self, method: Method, relit: &Relit) -> Result<Numeric> {
        let exact = self.exact.iter().find(|e| e.method == method);
        let exact = exact.context("a reference for each preset")?;
        let psnr = self.picture(relit)?.psnr(&exact.picture, None)?;
        Ok(Numeric {
            psnr: Some(psnr),
            ..errors(&relit.clone().of_degree(self.cloud.sh_degree).sh, &exact.sh)
        })
    }

    /// The harmonic method with reflections that are projected by samples, in f64.
    pub fn relit_by_samples(
        &self,
        prepared: &PreparedTransfer,
        thinned: &Bake,
        subject: &Subject,
        samples: usize,
    ) -> Result<Relit> {
        let (PreparedTransfer::Harmonic(harmonic), Bake::Harmonic(visibility)) =
            (prepared, thinned)
        else {
            bail!("only preset paper reflects by samples");
        };
        let oracle = sampled(harmonic.settings.clone(), subject, samples);
        let sh = relight_asset(&oracle, &self.linear_color(), &harmonic.normals, visibility);
        let narrow = sh.iter().map(|v| v.map(|v| v as f32)).collect();
        Ok(self.as_relit(Method::Harmonic, narrow))
    }

    /// Milliseconds that reflections by samples take for the whole asset, in plain f64.
    pub fn reflection_ms(
        &self,
        prepared: &PreparedTransfer,
        subject: &Subject,
        samples: usize,
    ) -> f64 {
        let PreparedTransfer::Harmonic(harmonic) = prepared else {
            return 0.0;
        };
        let oracle = sampled(harmonic.settings.clone(), subject, samples);
        let start = Instant::now();
        let sums: f64 = harmonic
            .normals
            .par_iter()
            .map(|n| oracle.reflection(n.to_array().map(f64::from)))
            .sum();
        std::hint::black_box(sums);
        start.elapsed().as_secs_f64() * 1e3
    }
}

fn sampled(settings: TransferSettings, subject: &Subject, samples: usize) -> OracleHarmonic {
    let [source, target] =
        [0, 1].map(|side| subject.lights[side].radiance.truncated(settings.sh_degree));
    OracleHarmonic::new(&source, &target, &settings).with_samples(samples)
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
