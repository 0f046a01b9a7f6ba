//! CPU-or-GPU decision: the chosen device, with the same results on both.

use std::path::PathBuf;
use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use transplat_core::bake::directional::DirectionalBake;
use transplat_core::bake::harmonic::{BakeInput, bake_harmonic};
use transplat_core::bake::strata::SurfelHits;
use transplat_core::bake::trace::Tracer;
use transplat_core::camera::Camera;
use transplat_core::environment::{
    EnvironmentMap, Illumination, IncidentRadiance, LightSamples, project_environment,
};
use transplat_core::pixel_shadows::PixelShadows;
use transplat_core::progress::Progress;
use transplat_core::rasterize::{ColorSpace, Raster, rasterize, shade};
use transplat_core::settings::Method;
use transplat_core::settings::optimizations::Optimizations;
use transplat_core::sh::MAX_DEGREE;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::cast_shadows::PlacedShadows;
use transplat_core::transfer::{Part, PreparedTransfer, Relit};
use transplat_gpu::bake::directional::GpuTracer;
use transplat_gpu::rasterize::GpuRasterizer;
use transplat_gpu::transfer::GpuTransfer;
use transplat_gpu::{Context, GpuError};

pub use transplat_gpu::rasterize::Paint;

/// Device that the user chose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DeviceChoice {
    /// The GPU where there is one, else the CPU.
    Auto,
    /// A GPU; a software Vulkan driver counts.
    Gpu,
    /// The CPU, without any graphics driver.
    Cpu,
}

/// Where compiled pipelines are kept from start to start.
pub fn pipelines_folder() -> Option<PathBuf> {
    let folders = directories::ProjectDirs::from("", "", "transplat")?;
    Some(folders.cache_dir().join("pipelines"))
}

/// The chosen device.
#[derive(Clone, Debug)]
pub enum Device {
    /// All cores, by rayon.
    Cpu,
    /// A wgpu adapter.
    Gpu(Arc<Context>),
}

impl Device {
    /// `auto` takes a real GPU or else the CPU; `gpu` takes any adapter or fails.
    pub fn open(choice: DeviceChoice) -> Result<Self> {
        Ok(match choice {
            DeviceChoice::Cpu => Self::Cpu,
            DeviceChoice::Gpu => Self::gpu(true)?,
            DeviceChoice::Auto => Self::gpu(false).unwrap_or(Self::Cpu),
        })
    }

    /// The best adapter, a software driver if that may count and nothing better is there.
    pub fn gpu(allow_software: bool) -> Result<Self> {
        let context = Context::new(allow_software)?;
        let context = context.with_pipelines_in(pipelines_folder().as_deref());
        Ok(Self::Gpu(Arc::new(context)))
    }

    /// Name of the adapter, or `cpu`.
    pub fn name(&self) -> String {
        match self {
            Self::Cpu => "cpu".into(),
            Self::Gpu(context) => context.name(),
        }
    }

    /// Projects an environment map onto SH of a degree.
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

    /// A map's light, as a method needs it, of the highest SH degree.
    pub fn light(&self, map: &EnvironmentMap, method: Method) -> Result<Illumination> {
        let light_samples = match method {
            Method::Directional => Some(LightSamples::of(map)),
            Method::Harmonic => None,
        };
        let radiance = self.project_environment(map, MAX_DEGREE)?;
        Ok(Illumination::new(radiance, light_samples))
    }

    /// Bakes visibility of the harmonic method.
    pub fn bake_harmonic(&self, input: &BakeInput, progress: Progress<'_>) -> Result<Vec<u8>> {
        Ok(match self {
            Self::Cpu => bake_harmonic(input, progress)?,
            Self::Gpu(context) => {
                transplat_gpu::bake::harmonic::bake_harmonic(context, input, progress)?
            }
        })
    }

    /// The rays of the directional method, stage by stage as [`DirectionalBake::bake_in_stages`] does them.
    pub fn bake_directional(
        &self,
        cloud: &SurfelCloud,
        tracer: &Arc<Tracer>,
        stages: (&[usize], &Optimizations),
        progress: Progress<'_>,
        preview: impl Fn(DirectionalBake, f32),
    ) -> Result<DirectionalBake> {
        let Self::Gpu(context) = self else {
            return Ok(DirectionalBake::bake_through(
                cloud, tracer, stages, progress, preview,
            )?);
        };
        let rays = match GpuTracer::new(context, tracer) {
            // On the CPU, as drawing does.
            Err(_) if !context.is_lost() => {
                return Ok(DirectionalBake::bake_through(
                    cloud, tracer, stages, progress, preview,
                )?);
            }
            made => made?,
        };
        let by = |strata: &[usize], found: &mut [SurfelHits], progress: Progress<'_>| {
            Ok(rays.trace(strata, found, progress)?)
        };
        DirectionalBake::bake_by(cloud, tracer, stages, by, progress, preview)
    }

    /// Ready to relight; what the adapter has no room for is relit on the CPU, and the message says so.
    pub fn transfer(&self, prepared: &PreparedTransfer) -> Result<(Transfer, Option<String>)> {
        let on_cpu = Transfer::Cpu(prepared.clone(), None);
        let Self::Gpu(context) = self else {
            return Ok((on_cpu, None));
        };
        match GpuTransfer::new(context, prepared) {
            Err(GpuError::OnCpu(_)) => Ok((on_cpu, None)),
            Err(error) if !context.is_lost() => {
                Ok((on_cpu, Some(format!("relighting on the CPU: {error}"))))
            }
            made => Ok((
                Transfer::Gpu {
                    transfer: Box::new(made?),
                    prepared: prepared.clone(),
                    last: None,
                },
                None,
            )),
        }
    }

    /// Ready to relight on this device alone, to measure it.
    pub fn transfer_here(&self, prepared: &PreparedTransfer) -> Result<Transfer> {
        match self.transfer(prepared)? {
            (transfer, None) => Ok(transfer),
            (_, Some(why)) => bail!(why),
        }
    }

    /// Relights once, where that device is measured.
    pub fn relight(&self, prepared: &PreparedTransfer, light: &Illumination) -> Result<Relit> {
        let mut transfer = self.transfer_here(prepared)?;
        transfer.change_light(light, Part::Whole, &[])?;
        transfer.result()
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

/// A prepared transfer on its device, and its last result.
pub enum Transfer {
    /// On the CPU, with the last result.
    Cpu(PreparedTransfer, Option<Relit>),
    /// On a GPU.
    Gpu {
        /// Transfer on the GPU.
        transfer: Box<GpuTransfer>,
        /// Transfer that it is made from.
        prepared: PreparedTransfer,
        /// Last light, and what of the colour was requested.
        last: Option<(Illumination, Part)>,
    },
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
            Self::Cpu(prepared, relit) => {
                *relit = Some(prepared.relight_after(relit.take(), light, wanted, unseen)?);
            }
            Self::Gpu { transfer, last, .. } => {
                transfer.submit(light, wanted, unseen)?;
                transfer.finish()?;
                *last = Some((light.clone(), wanted));
            }
        }
        Ok(())
    }

    /// The last result; there is one for each light, to be taken once.
    pub fn result(&mut self) -> Result<Relit> {
        match self {
            Self::Cpu(_, relit) => relit.take().context("no light was given yet"),
            Self::Gpu {
                transfer,
                prepared,
                last,
            } => {
                let mut relit = transfer.read()?;
                // Rays at the pixel are traced on the CPU.
                if let Some((light, Part::Whole | Part::Diffuse)) = last {
                    let shadows = prepared.shadows(light, &relit.tau)?;
                    let alone = |shadows| PlacedShadows::alone(shadows, relit.tau.len());
                    relit.shadows = shadows.into_iter().map(alone).collect();
                }
                Ok(relit)
            }
        }
    }
}

/// An asset on its device, ready to be drawn.
pub enum Painter {
    /// On the CPU.
    Cpu(Arc<SurfelCloud>),
    /// On a GPU.
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
        let cloud = match self {
            Self::Cpu(cloud) => cloud,
            Self::Gpu(rasterizer) => rasterizer.cloud(),
        };
        let colors = |sh, degree, encoding, space| {
            shade(&cloud.positions, sh, degree, encoding, camera.eye, space)
        };
        let mut raster = match (self, paint) {
            (Self::Gpu(rasterizer), _) => rasterizer.draw(camera, paint, space, hidden)?,
            (Self::Cpu(_), Paint::Colors(colors)) => rasterize(cloud, camera, colors, hidden),
            (
                Self::Cpu(_),
                Paint::Sh {
                    sh,
                    degree,
                    encoding,
                    ..
                },
            ) => rasterize(cloud, camera, &colors(sh, degree, encoding, space), hidden),
        };
        if let Paint::Sh {
            sh,
            degree,
            encoding,
            shadows: shadows @ [_, ..],
        } = paint
        {
            let linear = colors(sh, degree, encoding, ColorSpace::Linear);
            let pixel_shadows = PixelShadows {
                shadows,
                camera,
                space,
            };
            pixel_shadows.cast(cloud, hidden, &linear, &mut raster);
        }
        Ok(raster)
    }
}
