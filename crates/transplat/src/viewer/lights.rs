//! Environments as the viewer keeps them: their light, a small map for thumbnails and probes, and the whole map only while it is seen.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use anyhow::Result;
use transplat_core::color::luminance;
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::estimate::STAND_IN_TRUST;
use transplat_core::files::load_environment;
use transplat_core::look::{ESTIMATE, EVEN, is_estimate, is_even, is_file};
use transplat_core::settings::Method;
use transplat_core::sh::MAX_DEGREE;

use super::adapter::BackgroundDevice;
use crate::device::Device;
use crate::scene::map_warnings;

/// Number of the next light that is read.
static NEXT_ID: AtomicU64 = AtomicU64::new(1);

/// Width of the small map.
const SMALL_WIDTH: usize = 256;

/// What is kept of an environment.
#[derive(Debug)]
pub struct Light {
    /// Another one for each time that a file is read.
    pub id: u64,
    /// Its file, or `even` or `estimate`.
    pub path: PathBuf,
    /// Whether it is uniform white light.
    pub is_even: bool,
    /// As the map lies in its file.
    pub illumination: Illumination,
    pub small: EnvironmentMap,
    pub size: [usize; 2],
    pub warnings: Vec<String>,
    /// What brings its mean luminance to middle grey: for thumbnails.
    pub thumbnail_gain: f32,
    /// The whole map where there is no file.
    map: Option<Arc<EnvironmentMap>>,
}

impl Light {
    /// Uniform white light.
    pub fn even() -> Self {
        Self {
            id: NEXT_ID.fetch_add(1, Ordering::Relaxed),
            path: EVEN.into(),
            is_even: true,
            illumination: Illumination::even(MAX_DEGREE),
            small: EnvironmentMap::even(),
            size: [0, 0],
            warnings: Vec::new(),
            thumbnail_gain: 1.0,
            map: Some(Arc::new(EnvironmentMap::even_backdrop())),
        }
    }

    /// In the place of an estimate that is not there yet, or was not to be had.
    pub fn assumed() -> Self {
        Self::standing_in(Illumination {
            trust: STAND_IN_TRUST,
            ..Illumination::even(MAX_DEGREE)
        })
    }

    /// In the place of an estimate that is not good.
    pub fn standing_in(illumination: Illumination) -> Self {
        Self {
            path: ESTIMATE.into(),
            illumination,
            ..Self::even()
        }
    }

    /// The light that the asset tells of.
    pub fn estimated(map: EnvironmentMap) -> Result<Self> {
        let illumination = Device::Cpu.light(&map, Method::Directional)?;
        let mut light = Self::of(ESTIMATE.into(), &map, illumination, Vec::new());
        light.map = Some(Arc::new(map));
        Ok(light)
    }

    /// Reads a file and projects it, on the GPU where that can be had.
    pub fn load(background: &BackgroundDevice, path: &Path) -> Result<Self> {
        if is_even(path) {
            return Ok(Self::even());
        }
        let map = load_environment(path)?;
        let device = background.gpu().map_or(Device::Cpu, Device::Gpu);
        // For either method: they are changed with a click.
        let illumination = device.light(&map, Method::Directional)?;
        let warnings = map_warnings(path, &map);
        Ok(Self::of(path.to_owned(), &map, illumination, warnings))
    }

    fn of(
        path: PathBuf,
        map: &EnvironmentMap,
        illumination: Illumination,
        warnings: Vec<String>,
    ) -> Self {
        let small = map.reduced(SMALL_WIDTH);
        // The logarithmic mean is not led astray by a sun.
        let logs: f32 = small
            .pixels()
            .iter()
            .map(|p| luminance(*p).max(1e-6).ln())
            .sum();
        let mean = (logs / small.pixels().len() as f32).exp();
        Self {
            id: NEXT_ID.fetch_add(1, Ordering::Relaxed),
            path,
            is_even: false,
            illumination,
            size: [map.width(), map.height()],
            warnings,
            thumbnail_gain: 0.18 / mean,
            small,
            map: None,
        }
    }

    /// Whether it was read from a file.
    pub fn is_file(&self) -> bool {
        is_file(&self.path)
    }

    /// For the user.
    pub fn name(&self) -> String {
        light_name(if self.is_even {
            Path::new(EVEN)
        } else {
            &self.path
        })
    }
}

/// A light's name for the user.
pub fn light_name(path: &Path) -> String {
    if is_even(path) {
        return "even light".into();
    }
    if is_estimate(path) {
        return "estimated from the object".into();
    }
    path.file_stem().map_or_else(
        || path.display().to_string(),
        |stem| stem.to_string_lossy().into_owned(),
    )
}

/// Reads the whole map again, to be seen behind the object.
pub fn load_map(light: &Light) -> Result<Arc<EnvironmentMap>> {
    match &light.map {
        Some(map) => Ok(map.clone()),
        None => Ok(Arc::new(load_environment(&light.path)?)),
    }
}
