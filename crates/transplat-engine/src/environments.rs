//! Environments in memory: their light, a small map for thumbnails and probes, and the full map only while it is visible.

use std::collections::HashMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, LazyLock};

use anyhow::{Context as _, Result};
use glam::Vec3;
use transplat_core::color::luminance;
use transplat_core::environment::{
    EnvironmentMap, Illumination, ImageReading, LightSample, LightSamples, Sky,
};
use transplat_core::estimate::{Estimate, LEAST_TRUST};
use transplat_core::files::load_environment_as;
use transplat_core::scene::{
    ESTIMATE, EVEN, EnvironmentLight, SKY, is_estimate, is_even, is_file, is_sky,
};
use transplat_core::settings::Method;
use transplat_core::sh::MAX_DEGREE;
use transplat_core::surfels::UpAxis;

use crate::device::Device;
use crate::language::tr;
use crate::warnings::map_warnings;

/// Columns of the map of a sky that is shown.
pub const SKY_COLUMNS: usize = 2048;

/// Environments that are read at the same time.
const READ_AT_ONCE: usize = 2;

/// Columns of a completed map.
const COMPLETED_COLUMNS: usize = 1024;

/// Whole maps that are kept.
const MAPS: usize = 3;

/// All that were read, and those that are to be.
#[derive(Clone)]
pub struct Environments {
    read: HashMap<PathBuf, Arc<Environment>>,
    reading: Vec<PathBuf>,
    waiting: Vec<PathBuf>,
    /// Whole maps of the last that were seen behind the objects.
    maps: Vec<(u64, Arc<EnvironmentMap>)>,
    /// The last sky.
    sky: Option<Arc<Environment>>,
}

impl Default for Environments {
    /// There is always even light.
    fn default() -> Self {
        let even = Environment::even();
        Self {
            read: HashMap::from([(even.path.clone(), even)]),
            reading: Vec::new(),
            waiting: Vec::new(),
            maps: Vec::new(),
            sky: None,
        }
    }
}

impl Environments {
    /// One that was read.
    pub fn get(&self, path: &Path) -> Option<&Arc<Environment>> {
        self.read.get(path)
    }

    /// Makes sun and sky on the spot, unless it is there.
    pub fn make_sky(&mut self, sky: Sky) {
        let kept = self.sky.take().filter(|kept| kept.sky == Some(sky));
        let make = || Arc::new(Environment::of_sky(sky));
        self.sky = Some(kept.unwrap_or_else(make));
    }

    /// Sun and sky as they were made last.
    pub fn sky(&self) -> Option<&Arc<Environment>> {
        self.sky.as_ref()
    }

    /// True while a file is being read or waits for it.
    pub fn is_awaited(&self, path: &Path) -> bool {
        self.reading.iter().chain(&self.waiting).any(|p| p == path)
    }

    /// Has a file read unless it is there.
    pub fn request(&mut self, path: &Path) {
        if is_file(path) && !self.read.contains_key(path) && !self.is_awaited(path) {
            self.waiting.push(path.to_owned());
        }
    }

    /// Has a file read again, whatever is known of it: it may have changed.
    pub fn request_again(&mut self, path: &Path) {
        if is_file(path) {
            self.read.remove(path);
            self.request(path);
        }
    }

    /// Has a file read as is set, unless it was; until then it is as it was read.
    pub fn request_as(&mut self, path: &Path, reading: &ImageReading) {
        let is_read = self
            .read
            .get(path)
            .is_some_and(|read| read.reading == *reading);
        if is_file(path) && !is_read && !self.is_awaited(path) {
            self.waiting.push(path.to_owned());
        }
    }

    /// The next to be read, one of those that are shown first, and few at a time: maps are large.
    pub fn next(&mut self, shown: &[&Path]) -> Option<PathBuf> {
        if self.reading.len() >= READ_AT_ONCE || self.waiting.is_empty() {
            return None;
        }
        let is_shown = |p: &PathBuf| shown.contains(&&**p);
        let at = self.waiting.iter().position(is_shown).unwrap_or(0);
        let path = self.waiting.remove(at);
        self.reading.push(path.clone());
        Some(path)
    }

    /// Takes in what a file holds, if it can be read.
    pub fn has_read(&mut self, path: &Path, environment: Option<Environment>) {
        self.reading.retain(|p| p != path);
        let read = environment.map(|made| (path.to_owned(), Arc::new(made)));
        self.read.extend(read);
    }

    /// A whole map, if it is kept.
    pub fn kept_map(&self, id: u64) -> Option<Arc<EnvironmentMap>> {
        let kept = self.maps.iter().find(|(of, _)| *of == id);
        kept.map(|(_, map)| map.clone())
    }

    /// Keeps a whole map for the next time that it is seen, and of others the last few.
    pub fn keep_map(&mut self, id: u64, map: Arc<EnvironmentMap>) {
        self.maps.retain(|(of, _)| *of != id);
        self.maps.push((id, map));
        if self.maps.len() > MAPS {
            self.maps.remove(0);
        }
    }
}

/// Number of the next environment that is read.
static NEXT_ID: AtomicU64 = AtomicU64::new(1);

/// Width of the small map.
const SMALL_WIDTH: usize = 256;

/// An environment without its full map.
#[derive(Debug)]
pub struct Environment {
    /// Another one for each time that a file is read.
    pub id: u64,
    /// Its file, or `even` or `estimate`.
    pub path: PathBuf,
    /// True for uniform white light.
    pub is_even: bool,
    /// As the map lies in its file.
    pub illumination: Illumination,
    /// Map of 256 columns.
    pub small: EnvironmentMap,
    /// Size of its image, in pixels.
    pub size: [usize; 2],
    /// Layout and layer that its file was read by.
    pub reading: ImageReading,
    /// Names of the layers of its file, where it has several.
    pub layers: Vec<String>,
    /// True for an image of low dynamic range, whose highlights are clipped.
    pub is_clipped: bool,
    /// Oddities of the file, in words.
    pub warnings: Vec<String>,
    /// Factor that brings its mean luminance to middle grey, for thumbnails.
    pub thumbnail_gain: f32,
    /// Where the strongest of its suns is in the map, or what else is brightest; even light has no such place.
    pub brightest: Option<Vec3>,
    /// The whole map where there is no file.
    map: Option<Arc<EnvironmentMap>>,
    /// The small map without what is among the light's emitters, where that is another.
    dome: Option<EnvironmentMap>,
    /// Sun and sky, where it is that.
    pub sky: Option<Sky>,
}

impl Environment {
    /// Uniform white light, one for all.
    pub fn even() -> Arc<Self> {
        static SHARED: LazyLock<Arc<Environment>> = LazyLock::new(|| {
            let illumination = Illumination::even(MAX_DEGREE);
            Arc::new(Environment::uniform(EVEN.into(), illumination))
        });
        SHARED.clone()
    }

    /// In the place of an estimate that is not there yet, or was not to be had; one for all.
    pub fn assumed() -> Arc<Self> {
        static SHARED: LazyLock<Arc<Environment>> = LazyLock::new(|| {
            let even = Illumination::even(MAX_DEGREE);
            let stand_in = Illumination {
                trust: LEAST_TRUST,
                ..even
            };
            Arc::new(Environment::uniform(ESTIMATE.into(), stand_in))
        });
        SHARED.clone()
    }

    fn uniform(path: PathBuf, illumination: Illumination) -> Self {
        Self {
            id: NEXT_ID.fetch_add(1, Ordering::Relaxed),
            path,
            is_even: true,
            illumination,
            small: EnvironmentMap::even(),
            size: [0, 0],
            reading: ImageReading::default(),
            layers: Vec::new(),
            is_clipped: false,
            warnings: Vec::new(),
            thumbnail_gain: 1.0,
            brightest: None,
            map: Some(Arc::new(EnvironmentMap::even_backdrop())),
            dome: None,
            sky: None,
        }
    }

    /// The light that an asset with that up axis tells of, or even light where it tells none.
    pub fn estimated(estimate: &Estimate, up: UpAxis) -> Result<Self> {
        if !estimate.is_told() {
            return Ok(Self::uniform(ESTIMATE.into(), estimate.stand_in()));
        }
        let map = estimate.light.map(up);
        let illumination = Illumination {
            trust: estimate.trust(),
            ..Device::Cpu.light(&map, Method::Directional)?
        };
        let mut light = Self::of(ESTIMATE.into(), &map, illumination, Vec::new());
        light.map = Some(Arc::new(map));
        Ok(light)
    }

    /// A file's light from a completed map of it.
    ///
    /// # Errors
    /// The map holds no light.
    pub fn completed(&self, map: &EnvironmentMap) -> Result<Self> {
        let reading = self.reading.clone();
        let light = Self::of_map(&Device::Cpu, &self.path, map, reading, Method::Directional)?;
        Ok(Self {
            map: Some(Arc::new(map.reduced(COMPLETED_COLUMNS))),
            ..light
        })
    }

    /// The light of sun and sky.
    pub fn of_sky(sky: Sky) -> Self {
        let dome = sky.dome_map(SMALL_WIDTH);
        let illumination = sky.illumination_with(&dome, MAX_DEGREE);
        let map = sky.with_sun(dome.clone());
        let light = Self::of(SKY.into(), &map, illumination, Vec::new());
        Self {
            sky: Some(sky),
            dome: Some(dome),
            size: [0, 0],
            brightest: sky.sun().map(|_| sky.sun.toward().as_vec3()),
            ..light
        }
    }

    /// Reads a file, and projects it for a method; what is projected for the directional one serves both.
    pub fn load(
        device: &Device,
        path: &Path,
        reading: ImageReading,
        method: Method,
    ) -> Result<Self> {
        let map = load_environment_as(path, &reading)?;
        Self::of_map(device, path, &map, reading, method)
    }

    /// The light of a file's map. See [`Environment::load`].
    pub fn of_map(
        device: &Device,
        path: &Path,
        map: &EnvironmentMap,
        reading: ImageReading,
        method: Method,
    ) -> Result<Self> {
        let illumination = device.light(map, method)?;
        let warnings = map_warnings(path, map, &reading);
        Ok(Self {
            reading,
            ..Self::of(path.to_owned(), map, illumination, warnings)
        })
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
            brightest: illumination.light_samples.as_ref().and_then(brightest),
            illumination,
            size: map.picture_size(),
            reading: ImageReading::default(),
            layers: map.provenance().layers.clone(),
            is_clipped: map.has_clipped_highlights(),
            warnings,
            thumbnail_gain: 0.18 / mean,
            small,
            map: None,
            dome: None,
            sky: None,
        }
    }

    /// The small map of what is around, without what is among the light's emitters.
    pub fn small_dome(&self) -> &EnvironmentMap {
        self.dome.as_ref().unwrap_or(&self.small)
    }

    /// True where it was read from a file.
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

/// Cells at the very poles, whose few pixels say little, count as this wide, a cell at the horizon being 1.
const LEAST_CELL_WIDTH: f32 = 0.1;

fn brightest(light_samples: &LightSamples) -> Option<Vec3> {
    let among = if light_samples.suns.is_empty() {
        &light_samples.cells
    } else {
        &light_samples.suns
    };
    // Cells are the smaller the nearer they are to the poles: by their energy a bright ceiling would lose to a dim wall.
    let width = |b: &LightSample| match light_samples.suns.is_empty() {
        true => b.direction.truncate().length().max(LEAST_CELL_WIDTH),
        false => 1.0,
    };
    let power = |b: &&LightSample| luminance(b.energy) / width(b);
    let most = among.iter().max_by(|a, b| power(a).total_cmp(&power(b)));
    most.map(|light_sample| light_sample.direction)
}

/// A light's name for the user.
pub fn light_name(path: &Path) -> String {
    if is_even(path) {
        return tr("uniform white").into();
    }
    if is_estimate(path) {
        return tr("estimated from the object").into();
    }
    if is_sky(path) {
        return tr("sun and sky").into();
    }
    path.file_stem().map_or_else(
        || path.display().to_string(),
        |stem| stem.to_string_lossy().into_owned(),
    )
}

/// The environments (.hdr, .exr) in a folder, sorted by name; none that systems hide beside them.
pub fn environments_in(folder: &Path) -> Result<Vec<PathBuf>> {
    let entries = std::fs::read_dir(folder).with_context(|| folder.display().to_string())?;
    let mut inside: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|p| why_no_environment(p).is_none())
        .collect();
    inside.sort();
    Ok(inside)
}

/// Why a file in a folder of lights is none of them, by its name.
fn why_no_environment(path: &Path) -> Option<&'static str> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
    if name.starts_with('.') {
        return Some("hidden");
    }
    if path.is_dir() {
        return Some("a folder");
    }
    (extension != "hdr" && extension != "exr").then_some("neither .hdr nor .exr")
}

/// For the user: the files in a folder that are no lights, if there are any.
pub fn not_environments(folder: &Path) -> Option<String> {
    let entries = std::fs::read_dir(folder).ok()?.flatten();
    let skipped = entries.filter_map(|entry| {
        let why = why_no_environment(&entry.path())?;
        Some(format!("{} ({why})", entry.file_name().to_string_lossy()))
    });
    let mut skipped: Vec<String> = skipped.collect();
    skipped.sort();
    let some = skipped.len().min(8);
    let more = match skipped.len() - some {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    (some > 0).then(|| {
        format!(
            "{}: skipped {}{more}",
            folder.display(),
            skipped[..some].join(", ")
        )
    })
}

/// Reads the whole map again, to be seen behind the object.
pub fn load_map(light: &Environment) -> Result<Arc<EnvironmentMap>> {
    match (&light.map, light.sky) {
        (Some(map), _) => Ok(map.clone()),
        (None, Some(sky)) => Ok(Arc::new(sky.map(SKY_COLUMNS))),
        (None, None) => Ok(Arc::new(load_environment_as(&light.path, &light.reading)?)),
    }
}

/// Light of a side: the last that was requested and could be loaded.
#[derive(Clone)]
pub struct Resolved {
    /// Environment in use.
    pub light: Arc<Environment>,
    /// Settings of that light.
    pub settings: EnvironmentLight,
}

impl Default for Resolved {
    fn default() -> Self {
        Self {
            light: Environment::even(),
            settings: EnvironmentLight::of(EVEN),
        }
    }
}
