//! Bakes of a splat: read from a file where there is one, else made whole, or in stages that a window shows.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Instant, SystemTime};

use anyhow::{Context as _, Result};
use transplat_core::bake::Bake;
use transplat_core::bake::directional::DirectionalBake;
use transplat_core::bake::harmonic::{BakeInput, HarmonicBake, fill_unfinished};
use transplat_core::files::{geometry_key, load_bake, save_bake};
use transplat_core::progress::Progress;
use transplat_core::settings::Method;
use transplat_core::settings::optimizations::{Optimization, Optimizations};
use transplat_core::sh::refining_order;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::ensure_room;

use crate::device::Device;

/// Shares of the directions after which what there is can be seen.
const STAGES: [usize; 5] = [16, 8, 4, 2, 1];

/// Shares of the directions for the directional method, which takes longer to be prepared.
const STAGES_OF_DIRECTIONAL: [usize; 3] = [8, 2, 1];

/// A bake, whole or in part.
#[derive(Clone)]
pub struct Baked {
    /// Visibility of the surfels.
    pub bake: Arc<Bake>,
    /// Share of the directions that are in it.
    pub share: f32,
    /// Milliseconds that it took.
    pub ms: f64,
    /// Where it came from or went to; none while unfinished.
    pub file: Option<PathBuf>,
    /// Problem on the way that did not spoil the bake.
    pub complaint: Option<String>,
}

/// Inputs of a bake.
pub struct BakeRequest {
    /// Surfels to bake.
    pub cloud: Arc<SurfelCloud>,
    /// Method that needs the bake.
    pub method: Method,
    /// Directions of the harmonic method.
    pub directions: usize,
    /// Optimizations that are on.
    pub optimizations: Optimizations,
    /// Whole that the cloud was cut out of.
    pub part_of: Option<PartOf>,
    /// Place that the bake is saved in; none where it is not saved.
    pub place: Option<BakePlace>,
}

/// Place of the bakes of a splat: the user's cache, or the splat's folder. Both are read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct BakePlace {
    /// File of the splat.
    pub splat: PathBuf,
    /// True where it is saved beside the splat.
    pub is_beside: bool,
    /// True for a part of the splat: beside it lies the bake of the whole.
    pub is_part: bool,
}

impl BakePlace {
    /// In the user's cache.
    pub fn cached(splat: &Path) -> Self {
        Self {
            splat: splat.to_owned(),
            is_beside: false,
            is_part: false,
        }
    }

    /// Files that it may be in, the preferred first.
    pub fn files(&self, cloud: &SurfelCloud, suffix: &str) -> Vec<PathBuf> {
        let mut name = self.splat.file_name().unwrap_or_default().to_owned();
        name.push(format!(".{suffix}"));
        let beside = (!self.is_part).then(|| self.splat.with_file_name(name));
        let mut files: Vec<PathBuf> = beside.into_iter().collect();
        files.extend(cached_file(cloud, suffix));
        if !self.is_beside {
            files.reverse();
        }
        files
    }
}

/// Some surfels of an asset.
pub struct PartOf {
    /// Its bake.
    pub whole: Arc<DirectionalBake>,
    /// Indices of the part's surfels.
    pub surfels: Arc<[usize]>,
}

impl BakeRequest {
    /// A bake, given what the whole tells of a part.
    fn known(&self, bake: DirectionalBake) -> Bake {
        Bake::Directional(Arc::new(match &self.part_of {
            Some(PartOf { whole, surfels }) => bake.as_part_of(whole, surfels),
            None => bake,
        }))
    }

    fn cache_files(&self) -> Vec<PathBuf> {
        let kind = match self.method {
            Method::Harmonic => self.directions.to_string(),
            Method::Directional => "best".into(),
        };
        let Some(place) = &self.place else {
            return Vec::new();
        };
        match self.part_of {
            Some(_) => cached_file(&self.cloud, &format!("part.{kind}.bake"))
                .into_iter()
                .collect(),
            None => place.files(&self.cloud, &format!("{kind}.bake")),
        }
    }
}

fn cache_folder() -> Option<PathBuf> {
    let folders = directories::ProjectDirs::from("", "", "transplat")?;
    Some(folders.cache_dir().to_owned())
}

fn is_cached(file: &Path) -> bool {
    has_key(file) && file.parent() == cache_folder().as_deref()
}

/// True for the name of a file of the cache; one of the user's own is called otherwise.
fn has_key(file: &Path) -> bool {
    let name = file.file_name().unwrap_or_default().to_string_lossy();
    let key = name.split('.').next().unwrap_or_default();
    key.len() == 16 && key.chars().all(|c| c.is_ascii_hexdigit())
}

fn cached_file(cloud: &SurfelCloud, suffix: &str) -> Option<PathBuf> {
    let key = geometry_key(cloud);
    Some(cache_folder()?.join(format!("{key:016x}.{suffix}")))
}

/// Bytes of bakes that the cache keeps.
const MOST_CACHED: u64 = 8 << 30;

/// Removes bakes beside the newest one in the cache, those first that nobody has needed for longest, until there is room.
fn forget_old_bakes(newest: &Path) {
    let entries = newest
        .parent()
        .and_then(|folder| std::fs::read_dir(folder).ok());
    let is_bake = |path: &PathBuf| has_key(path) && path.extension().is_some_and(|e| e == "bake");
    let files = entries.into_iter().flatten().flatten().map(|e| e.path());
    let known = |path: PathBuf| {
        let told = path.metadata().ok()?;
        Some((told.modified().ok()?, told.len(), path))
    };
    let mut bakes: Vec<_> = files.filter(is_bake).filter_map(known).collect();
    bakes.sort();
    let mut all: u64 = bakes.iter().map(|(_, bytes, _)| bytes).sum();
    for (_, bytes, path) in bakes {
        if all > MOST_CACHED && path != newest && std::fs::remove_file(path).is_ok() {
            all -= bytes;
        }
    }
}

/// Bakes from start to end.
pub fn bake(device: &Device, wanted: &BakeRequest, progress: Progress<'_>) -> Result<Bake> {
    in_stages(device, wanted, &[1], progress, &|_, _| ())
}

/// Bakes from start to end, or reads a saved bake.
///
/// # Errors
/// The saved one is of another asset, or for another method.
pub fn whole(
    device: &Device,
    wanted: &BakeRequest,
    saved: Option<&Path>,
    progress: Progress<'_>,
) -> Result<Baked> {
    let start = Instant::now();
    let bake = match saved {
        None => bake(device, wanted, progress)?,
        Some(file) => {
            let read = load_bake(file, &wanted.cloud)?;
            let of_method = read.of_method(wanted.method);
            of_method
                .with_context(|| file.display().to_string())?
                .clone()
        }
    };
    Ok(Baked {
        bake: Arc::new(bake),
        share: 1.0,
        ms: start.elapsed().as_secs_f64() * 1e3,
        file: saved.map(Path::to_owned),
        complaint: None,
    })
}

/// Bakes so that what there is can be used before it is whole, or reads what was baked before: `saved` first of all, of as many directions
/// as it has. `progress` may break off; `preview` gets what can be seen so far.
pub fn refined(
    device: &Device,
    wanted: &BakeRequest,
    saved: Option<&Path>,
    progress: Progress<'_>,
    preview: impl Fn(Baked),
) -> Result<Baked> {
    let start = Instant::now();
    let baked = |bake: Bake, share: f32, file: Option<PathBuf>, complaint| Baked {
        bake: Arc::new(bake),
        share,
        ms: start.elapsed().as_secs_f64() * 1e3,
        file,
        complaint,
    };
    // A bake that leaves out nothing is for this time.
    let files = if wanted.optimizations == Optimizations::default() {
        wanted.cache_files()
    } else {
        Vec::new()
    };
    let mut complaint = None;
    if let Some(file) = saved {
        let loaded = load_bake(file, &wanted.cloud);
        match loaded.and_then(|b| b.of_method(wanted.method).cloned()) {
            Ok(bake) => return Ok(baked(bake, 1.0, Some(file.to_owned()), None)),
            Err(error) => complaint = Some(format!("{error}; baking anew")),
        }
    }
    for file in &files {
        // One of another geometry, kind or size is as good as none.
        if let Ok(bake) = load_bake(file, &wanted.cloud)
            && bake.method() == wanted.method
            && bake.directions() == wanted.directions
        {
            if is_cached(file) {
                // That it was needed keeps it; one that cannot be marked may go.
                let opened = File::options().append(true).open(file);
                let _ = opened.and_then(|f| f.set_modified(SystemTime::now()));
            }
            let bake = match bake {
                Bake::Directional(bake) => wanted.known(Arc::unwrap_or_clone(bake)),
                other => other,
            };
            return Ok(baked(bake, 1.0, Some(file.clone()), None));
        }
    }
    let stages: &[usize] = match wanted.method {
        Method::Harmonic => &STAGES,
        Method::Directional => &STAGES_OF_DIRECTIONAL,
    };
    let so_far = |bake: Bake, share: f32| preview(baked(bake, share, None, None));
    let bake = in_stages(device, wanted, stages, progress, &so_far)?;
    let mut whole = baked(bake, 1.0, None, complaint);
    match keep(&files, |file| save_bake(file, &wanted.cloud, &whole.bake)) {
        Ok(file) => {
            if is_cached(&file) {
                forget_old_bakes(&file);
            }
            whole.file = Some(file);
        }
        Err(_) if files.is_empty() => {}
        Err(why) => {
            let why = format!("the bake could not be kept: {why}");
            whole.complaint.get_or_insert(why);
        }
    }
    Ok(whole)
}

/// Bakes by growing shares of the directions, of which each entry of `stages` is one over.
fn in_stages(
    device: &Device,
    wanted: &BakeRequest,
    stages: &[usize],
    progress: Progress<'_>,
    preview: &dyn Fn(Bake, f32),
) -> Result<Bake> {
    ensure_room(&wanted.cloud, wanted.method)?;
    Ok(match wanted.method {
        Method::Harmonic => harmonic(device, wanted, stages, progress, preview)?,
        Method::Directional => {
            let preview = |so_far: DirectionalBake, share| preview(wanted.known(so_far), share);
            let stages = (stages, &wanted.optimizations);
            let cloud = &wanted.cloud;
            let tracer = match &wanted.part_of {
                Some(PartOf { whole, surfels }) => whole.tracer_of_part(cloud, surfels),
                None => DirectionalBake::tracer(cloud, progress)?,
            };
            wanted.known(device.bake_directional(cloud, &tracer, stages, progress, preview)?)
        }
    })
}

/// The harmonic method's bake, direction by direction.
fn harmonic(
    device: &Device,
    wanted: &BakeRequest,
    stages: &[usize],
    progress: Progress<'_>,
    preview: &dyn Fn(Bake, f32),
) -> Result<Bake> {
    let (cloud, directions) = (&wanted.cloud, wanted.directions);
    if progress(0.0).is_break() {
        return Err(transplat_core::Error::Cancelled.into());
    }
    if wanted.optimizations.has(Optimization::OpenObject)
        && let Some(open) = HarmonicBake::of_open_object(cloud, directions)
    {
        return Ok(Bake::Harmonic(open.into()));
    }
    let mut input = BakeInput::new(cloud, directions);
    if let [1] = stages {
        let open = device.bake_harmonic(&input, progress)?;
        let whole = HarmonicBake::from_open(cloud, directions, open);
        return Ok(Bake::Harmonic(whole.into()));
    }
    let frames = std::mem::take(&mut input.frames);
    let order = refining_order(directions);
    let mut open = vec![0u8; cloud.len() * directions];
    let mut done = 0;
    for &share in stages {
        let end = directions.div_ceil(share);
        let part = &order[done..end];
        input.frames = part.iter().map(|i| frames[*i]).collect();
        let of_all = |p: f64| progress((done as f64 + p * part.len() as f64) / directions as f64);
        let stage = device.bake_harmonic(&input, &of_all)?;
        for (row, stage) in open
            .chunks_exact_mut(directions)
            .zip(stage.chunks_exact(part.len()))
        {
            for (i, value) in part.iter().zip(stage) {
                row[*i] = *value;
            }
        }
        done = end;
        if share > 1 {
            let mut filled = open.clone();
            fill_unfinished(&mut filled, directions, &order[..done]);
            let so_far = HarmonicBake::from_open(cloud, directions, filled);
            preview(
                Bake::Harmonic(so_far.into()),
                done as f32 / directions as f32,
            );
        }
    }
    let whole = HarmonicBake::from_open(cloud, directions, open);
    Ok(Bake::Harmonic(whole.into()))
}

/// Saves to the first place that takes it.
pub fn keep(
    files: &[PathBuf],
    save: impl Fn(&Path) -> transplat_core::Result<()>,
) -> std::result::Result<PathBuf, String> {
    let mut why = String::new();
    for file in files {
        if let Some(folder) = file.parent().filter(|f| !f.is_dir()) {
            // A missing cache is made; what goes wrong with it is told below.
            let _ = std::fs::create_dir_all(folder);
        }
        match save(file) {
            Ok(()) => return Ok(file.clone()),
            Err(error) => why = error.to_string(),
        }
    }
    Err(why)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;
    use std::ops::ControlFlow;
    use transplat_core::bake::strata::DIRECTIONS;
    use transplat_core::progress::no_progress;
    use transplat_core::synthetic;

    #[test]
    fn a_bake_refines_is_kept_and_is_found_again() {
        let folder = tempfile::tempdir().expect("a folder");
        let asset = folder.path().join("ball.ply");
        let cloud = Arc::new(synthetic::sphere_over_plate(400));
        let paper = (
            Method::Harmonic,
            64,
            "ball.ply.64.bake",
            &[0.0625, 0.125, 0.25, 0.5][..],
        );
        let best = (
            Method::Directional,
            DIRECTIONS,
            "ball.ply.best.bake",
            &[0.125, 0.5][..],
        );
        for (method, directions, name, stages) in [paper, best] {
            let shares = RefCell::new(Vec::new());
            let run = |cloud: &Arc<SurfelCloud>| {
                let preview = |b: Baked| shares.borrow_mut().push(b.share);
                let wanted = BakeRequest {
                    cloud: cloud.clone(),
                    method,
                    directions,
                    optimizations: Optimizations::default(),
                    part_of: None,
                    place: Some(BakePlace {
                        splat: asset.clone(),
                        is_beside: true,
                        is_part: false,
                    }),
                };
                refined(&Device::Cpu, &wanted, None, &no_progress, preview).expect("a bake")
            };
            let first = run(&cloud);
            assert_eq!(*shares.borrow(), stages);
            let file = first.file.expect("it is kept");
            assert_eq!(file, folder.path().join(name));
            let again = run(&cloud);
            assert_eq!(shares.borrow().len(), stages.len(), "the second is read");
            // The same bake as in one go: the order of directions does not matter.
            let whole = Bake::new(&cloud, method, directions, &no_progress).expect("a bake");
            for other in [&*again.bake, &whole] {
                match (&*first.bake, other) {
                    (Bake::Harmonic(a), Bake::Harmonic(b)) => assert_eq!(a.open, b.open),
                    (Bake::Directional(a), Bake::Directional(b)) => {
                        assert_eq!(
                            (
                                &a.directional_visibility.open,
                                &a.directional_visibility.hits.len()
                            ),
                            (
                                &b.directional_visibility.open,
                                &b.directional_visibility.hits.len()
                            )
                        );
                    }
                    _ => panic!("of another kind"),
                }
            }
            // Of another geometry it is not taken.
            let other = Arc::new(synthetic::sphere_over_plate(500));
            assert_eq!(run(&other).bake.len(), other.len());
        }
    }

    #[test]
    fn the_oldest_bakes_of_the_cache_make_room() {
        let folder = tempfile::tempdir().expect("a folder");
        let made = |name: &str, bytes: u64, age: u64| {
            let path = folder.path().join(name);
            let file = File::create(&path).expect("room");
            // A file with a hole takes no room.
            file.set_len(bytes).expect("room");
            let then = SystemTime::now() - std::time::Duration::from_secs(age);
            file.set_modified(then).expect("a time");
            path
        };
        let key = "0123456789abcde";
        let cached = |name: &str, bytes, age| made(&format!("{key}{name}"), bytes, age);
        let own = made("vase.bake", MOST_CACHED, 1000);
        let other = cached("0.best.light", MOST_CACHED, 900);
        let oldest = cached("1.best.bake", MOST_CACHED / 2, 300);
        let kept = cached("2.part.best.bake", MOST_CACHED / 2, 200);
        let newest = cached("3.best.bake", MOST_CACHED / 2, 100);
        forget_old_bakes(&newest);
        assert!(!oldest.exists());
        assert!(kept.exists() && newest.exists() && other.exists() && own.exists());
    }

    /// Both places are read, the preferred one first.
    #[test]
    fn a_place_names_the_cache_first_unless_it_is_beside_the_splat() {
        let cloud = synthetic::sphere_over_plate(50);
        let [cached, beside] = [false, true].map(|is_beside| {
            let splat = PathBuf::from("folder/ball.ply");
            BakePlace {
                splat,
                is_beside,
                is_part: false,
            }
            .files(&cloud, "best.bake")
        });
        let own = Path::new("folder/ball.ply.best.bake");
        assert_eq!(beside[0], own);
        assert_eq!(cached.last().map(PathBuf::as_path), Some(own));
        assert_eq!(cached.len(), beside.len());
    }

    #[test]
    fn a_cancelled_bake_leaves_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let asset = folder.path().join("ball.ply");
        let cloud = Arc::new(synthetic::sphere_over_plate(400));
        let stop = |done: f64| match done > 0.1 {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        };
        for method in Method::ALL {
            let wanted = BakeRequest {
                cloud: cloud.clone(),
                method,
                directions: 32,
                optimizations: Optimizations::default(),
                part_of: None,
                place: Some(BakePlace {
                    splat: asset.clone(),
                    is_beside: true,
                    is_part: false,
                }),
            };
            assert!(refined(&Device::Cpu, &wanted, None, &stop, |_| ()).is_err());
            let left = std::fs::read_dir(folder.path()).expect("it is there");
            assert_eq!(left.count(), 0);
        }
    }
}
