//! Where the stages run: the CPU, or a GPU with the same results.

use anyhow::Result;
use transplat_core::camera::Camera;
use transplat_core::color::Encoding;
use transplat_core::environment::{EnvironmentMap, IncidentRadiance, project_environment};
use transplat_core::rasterize::{ColorSpace, Raster, rasterize, shade};
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::{PreparedTransfer, TransferLight};
use transplat_core::visibility::{BakeInput, Progress, bake_visibility};

use crate::cli::DeviceChoice;
use crate::report::Report;

/// The chosen device.
pub enum Device {
    Cpu,
}

impl Device {
    pub fn open(_choice: DeviceChoice, _report: &mut Report) -> Result<Self> {
        Ok(Self::Cpu)
    }

    pub fn name(&self) -> String {
        "cpu".into()
    }

    pub fn project_environment(&self, map: &EnvironmentMap, degree: usize) -> IncidentRadiance {
        project_environment(map, degree)
    }

    pub fn bake_visibility(&self, input: &BakeInput, progress: Progress<'_>) -> Result<Vec<u8>> {
        Ok(bake_visibility(input, progress)?)
    }

    pub fn transfer<'a>(&'a self, prepared: &'a PreparedTransfer) -> Result<Transfer<'a>> {
        Ok(Transfer::Cpu {
            prepared,
            relit: vec![[0.0; 3]; prepared.surfels * prepared.coefficients()],
        })
    }

    pub fn painter<'a>(&'a self, cloud: &'a SurfelCloud) -> Result<Painter<'a>> {
        Ok(Painter::Cpu { cloud })
    }
}

/// A prepared transfer on its device.
pub enum Transfer<'a> {
    Cpu {
        prepared: &'a PreparedTransfer,
        relit: Vec<[f32; 3]>,
    },
}

impl Transfer<'_> {
    /// Computes the result for a light; it stays where it was computed.
    pub fn change_light(&mut self, light: &TransferLight) -> Result<()> {
        match self {
            Self::Cpu { prepared, relit } => prepared.relight_into(light, relit),
        }
        Ok(())
    }

    /// The last result, linear SH `[n][K][3]`.
    pub fn finish(self) -> Result<Vec<[f32; 3]>> {
        match self {
            Self::Cpu { relit, .. } => Ok(relit),
        }
    }
}

/// What the surfels of a picture are coloured with.
#[derive(Clone, Copy)]
pub enum Paint<'a> {
    /// SH `[n][K][3]`.
    Sh {
        sh: &'a [[f32; 3]],
        encoding: Encoding,
    },
    /// One colour a surfel.
    Colors(&'a [[f32; 3]]),
}

/// An asset on its device, ready to be drawn.
pub enum Painter<'a> {
    Cpu { cloud: &'a SurfelCloud },
}

impl Painter<'_> {
    pub fn draw(&self, camera: &Camera, paint: Paint<'_>, space: ColorSpace) -> Result<Raster> {
        match self {
            Self::Cpu { cloud } => {
                let shaded;
                let colors = match paint {
                    Paint::Colors(colors) => colors,
                    Paint::Sh { sh, encoding } => {
                        shaded = shade(
                            &cloud.positions,
                            sh,
                            cloud.sh_degree,
                            encoding,
                            camera.eye,
                            space,
                        );
                        &shaded
                    }
                };
                Ok(rasterize(cloud, camera, colors))
            }
        }
    }
}
