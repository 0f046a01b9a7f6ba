//! Where the stages run: the CPU, or a GPU with the same results.

use std::sync::Arc;

use anyhow::{Context as _, Result};
use transplat_core::camera::Camera;
use transplat_core::environment::{
    Beams, EnvironmentMap, Illumination, IncidentRadiance, project_environment,
};
use transplat_core::rasterize::{ColorSpace, Raster, rasterize, shade};
use transplat_core::sh::MAX_DEGREE;
use transplat_core::skips::Skips;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::best::BestTransfer;
use transplat_core::transfer::paper::PaperTransfer;
use transplat_core::transfer::{Part, PreparedTransfer, Preset, Relit};
use transplat_core::visibility::occlusion::{Found, Occlusion};
use transplat_core::visibility::{BakeInput, Progress, bake_visibility};
use transplat_gpu::rasterize::GpuRasterizer;
use transplat_gpu::transfer::best::GpuBest;
use transplat_gpu::transfer::paper::GpuPaper;
use transplat_gpu::visibility::occlusion::GpuTracer;
use transplat_gpu::{Context, GpuError};

pub use transplat_gpu::rasterize::Paint;

use crate::cli::DeviceChoice;

/// The chosen device.
#[derive(Clone, Debug)]
pub enum Device {
    Cpu,
    Gpu(Arc<Context>),
}

impl Device {
    /// `auto` takes a real GPU or else the CPU; `gpu` takes any adapter or fails.
    pub fn open(choice: DeviceChoice) -> Result<Self> {
        Ok(match choice {
            DeviceChoice::Cpu => Self::Cpu,
            DeviceChoice::Gpu => Self::Gpu(Arc::new(Context::new(true)?)),
            DeviceChoice::Auto => match Context::new(false) {
                Ok(context) => Self::Gpu(Arc::new(context)),
                Err(_) => Self::Cpu,
            },
        })
    }

    pub fn name(&self) -> String {
        match self {
            Self::Cpu => "cpu".into(),
            Self::Gpu(context) => context.name(),
        }
    }

    pub fn project_environment(
        &self,
        map: &EnvironmentMap,
        degree: usize,
    ) -> Result<IncidentRadiance> {
        Ok(match self {
            Self::Cpu => project_environment(map, degree),
            Self::Gpu(context) => {
                transplat_gpu::environment::project_environment(context, map, degree)?
            }
        })
    }

    /// A map's light, as a preset needs it, of the highest SH degree.
    pub fn light(&self, map: &EnvironmentMap, preset: Preset) -> Result<Illumination> {
        Ok(Illumination {
            radiance: self.project_environment(map, MAX_DEGREE)?,
            beams: (preset == Preset::Best).then(|| Beams::of(map)),
            trust: 1.0,
        })
    }

    pub fn bake_visibility(&self, input: &BakeInput, progress: Progress<'_>) -> Result<Vec<u8>> {
        Ok(match self {
            Self::Cpu => bake_visibility(input, progress)?,
            Self::Gpu(context) => {
                transplat_gpu::visibility::bake_visibility(context, input, progress)?
            }
        })
    }

    /// The rays of preset `best`, stage by stage as [`Occlusion::bake_in_stages`] does them.
    pub fn bake_occlusion(
        &self,
        cloud: &SurfelCloud,
        stages: (&[usize], &Skips),
        progress: Progress<'_>,
        preview: impl Fn(Occlusion, f32),
    ) -> Result<Occlusion> {
        let Self::Gpu(context) = self else {
            return Ok(Occlusion::bake_in_stages(cloud, stages, progress, preview)?);
        };
        let tracer = Occlusion::tracer(cloud, progress)?;
        let rays = match GpuTracer::new(context, &tracer) {
            // On the CPU, as drawing does.
            Err(_) if !context.is_lost() => {
                return Ok(Occlusion::bake_through(
                    cloud, &tracer, stages, progress, preview,
                )?);
            }
            made => made?,
        };
        let by = |patches: &[usize], found: &mut [Found], progress: Progress<'_>| {
            Ok(rays.trace(patches, found, progress)?)
        };
        Occlusion::bake_by(cloud, &tracer, stages, by, progress, preview)
    }

    /// Ready to relight; what the adapter has no room for is relit on the CPU, and the message says so.
    pub fn transfer(&self, prepared: &PreparedTransfer) -> Result<(Transfer, Option<String>)> {
        let part = Part::Whole;
        let transfer = match (self, prepared.clone()) {
            (Self::Cpu, PreparedTransfer::Paper(paper)) => Transfer::PaperOnCpu {
                relit: vec![[0.0; 3]; paper.surfels * paper.coefficients()],
                paper,
                part,
            },
            (Self::Gpu(context), PreparedTransfer::Paper(paper)) => Transfer::PaperOnGpu {
                transfer: Box::new(GpuPaper::new(context, &paper)?),
                paper,
                part,
            },
            (Self::Cpu, PreparedTransfer::Best(best)) => Transfer::BestOnCpu(best, None),
            (Self::Gpu(context), PreparedTransfer::Best(best)) => {
                match GpuBest::new(context, &best) {
                    Err(error) if !context.is_lost() => {
                        let why = format!("relighting on the CPU: {error}");
                        return Ok((Transfer::BestOnCpu(best, None), Some(why)));
                    }
                    made => Transfer::BestOnGpu(best, Box::new(made?)),
                }
            }
        };
        Ok((transfer, None))
    }

    /// Ready to draw an asset; one too large for the GPU is drawn on the CPU, and the message says so.
    pub fn painter(&self, cloud: &Arc<SurfelCloud>) -> Result<(Painter, Option<String>)> {
        let Self::Gpu(context) = self else {
            return Ok((Painter::Cpu(cloud.clone()), None));
        };
        match GpuRasterizer::new(context, cloud) {
            Ok(rasterizer) => Ok((Painter::Gpu(Box::new(rasterizer)), None)),
            Err(error @ GpuError::TooLarge { .. }) => Ok((
                Painter::Cpu(cloud.clone()),
                Some(format!("drawing on the CPU: {error}")),
            )),
            Err(error) => Err(error.into()),
        }
    }
}

/// A prepared transfer on its device, and its last result where it was computed.
pub enum Transfer {
    PaperOnCpu {
        paper: Arc<PaperTransfer>,
        relit: Vec<[f32; 3]>,
        part: Part,
    },
    PaperOnGpu {
        paper: Arc<PaperTransfer>,
        transfer: Box<GpuPaper>,
        part: Part,
    },
    BestOnCpu(Arc<BestTransfer>, Option<Relit>),
    BestOnGpu(Arc<BestTransfer>, Box<GpuBest>),
}

impl Transfer {
    /// Computes the result for a light, or what a view shows of it; what of surfels that nobody sees (`[n]` or empty) is not said.
    pub fn change_light(
        &mut self,
        light: &Illumination,
        wanted: Part,
        unseen: &[bool],
    ) -> Result<()> {
        match self {
            Self::PaperOnCpu { paper, relit, part } => {
                paper.relight_into(&paper.light(&light.radiance), relit);
                *part = wanted;
            }
            Self::PaperOnGpu {
                paper,
                transfer,
                part,
            } => {
                transfer.relight(&paper.light(&light.radiance))?;
                *part = wanted;
            }
            Self::BestOnCpu(best, relit) => {
                let light = best.light(light.for_best()?);
                *relit = Some(best.relight_seen(light, wanted, unseen));
            }
            Self::BestOnGpu(best, transfer) => {
                transfer.set_unseen(unseen);
                transfer.relight(&best.light(light.for_best()?), wanted)?;
            }
        }
        Ok(())
    }

    /// The last result; there is one for each light.
    pub fn result(&mut self) -> Result<Relit> {
        match self {
            Self::PaperOnCpu { paper, relit, part } => Ok(paper.relit(relit.clone(), *part)),
            Self::PaperOnGpu {
                paper,
                transfer,
                part,
            } => Ok(paper.relit(transfer.read()?, *part)),
            Self::BestOnCpu(_, relit) => relit.take().context("no light was given yet"),
            Self::BestOnGpu(_, transfer) => Ok(transfer.read()?),
        }
    }
}

/// An asset on its device, ready to be drawn.
pub enum Painter {
    Cpu(Arc<SurfelCloud>),
    Gpu(Box<GpuRasterizer>),
}

impl Painter {
    /// Draws all surfels but the hidden ones (`[n]` or empty).
    pub fn draw(
        &self,
        camera: &Camera,
        paint: Paint<'_>,
        space: ColorSpace,
        hidden: &[bool],
    ) -> Result<Raster> {
        match (self, paint) {
            (Self::Gpu(rasterizer), _) => Ok(rasterizer.draw(camera, paint, space, hidden)?),
            (Self::Cpu(cloud), Paint::Colors(colors)) => {
                Ok(rasterize(cloud, camera, colors, hidden))
            }
            (
                Self::Cpu(cloud),
                Paint::Sh {
                    sh,
                    degree,
                    encoding,
                },
            ) => {
                let colors = shade(&cloud.positions, sh, degree, encoding, camera.eye, space);
                Ok(rasterize(cloud, camera, &colors, hidden))
            }
        }
    }
}
