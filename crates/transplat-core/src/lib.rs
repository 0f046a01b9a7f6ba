//! Relighting of Gaussian splats by radiance transfer on the CPU, splat and image files: without GPU or window.
//!
//! The folders are the pipeline, and one stage has one name everywhere:
//!
//! ```text
//! load -> project environment -> bake -> transfer -> rasterize -> present / export
//! ```
//!
//! Source: "TranSplat: Instant Object Relighting in Gaussian Splatting via Spherical Harmonic Radiance Transfer"
//! (Yu, Jin, He, Dave, Ramamoorthi, Balakrishnan); equation numbers in the code are its.
//!
//! ```
//! use transplat_core::bake::Bake;
//! use transplat_core::bake::harmonic::DEFAULT_DIRECTIONS;
//! use transplat_core::environment::{EnvironmentMap, Illumination};
//! use transplat_core::progress::no_progress;
//! use transplat_core::synthetic;
//! use transplat_core::settings::TransferSettings;
//! use transplat_core::transfer::{Part, PreparedTransfer};
//!
//! // An asset (here a grey sphere; `files::load_splat` reads a PLY), the light it was captured in, and another one.
//! let cloud = synthetic::sphere(500);
//! let source = Illumination::even(3);
//! let sky = EnvironmentMap::new(1, 2, vec![[2.0, 2.0, 3.0], [0.0; 3]]);
//! let target = Illumination::of(&sky, 3);
//!
//! // Once for the asset, once for asset and source light, and then once for each new light.
//! let settings = TransferSettings::default();
//! let bake = Bake::new(&cloud, settings.method, DEFAULT_DIRECTIONS, &no_progress)?;
//! let prepared = PreparedTransfer::new(&cloud, &bake, &source, &settings)?;
//! let relit = prepared.relight(&target, Part::Whole)?;
//! assert!(relit.tau[0][2] > relit.tau[499][2], "the top of the sphere is the brighter one");
//! # Ok::<(), transplat_core::Error>(())
//! ```

pub mod backplate;
pub mod bake;
pub mod camera;
pub mod capture_environment;
pub mod color;
pub mod color_rows;
pub mod crop;
pub mod derived;
pub mod environment;
mod error;
pub mod estimate;
pub mod extremes;
pub mod files;
pub mod ground;
pub mod images;
mod lanes;
pub mod lut;
mod memory;
mod morton;
mod nearest;
pub mod numeric;
pub mod oracle;
pub mod pixel_shadows;
pub mod present;
pub mod probe;
pub mod progress;
pub mod rasterize;
pub mod response;
pub mod scene;
pub mod settings;
pub mod sh;
pub mod support;
pub mod surfels;
pub mod synthetic;
pub mod transfer;
pub mod up_axis;

pub use error::{Error, Result, refusal};
