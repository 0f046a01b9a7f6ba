//! The bake as the viewer wants it: from a file where there is one, else direction by direction, usable from the first ones on.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;

use transplat_core::export::save_bake;
use transplat_core::load::{geometry_key, load_bake};
use transplat_core::surfels::SurfelCloud;
use transplat_core::visibility::{
    BakeInput, BakeSettings, Visibility, fill_unfinished, refining_order,
};

use crate::device::Device;

/// Shares of the directions after which what there is can be seen.
const STAGES: [usize; 5] = [16, 8, 4, 2, 1];

/// A bake, whole or in part.
pub struct Baked {
    pub visibility: Visibility,
    /// Share of the directions that are in it.
    pub share: f32,
    pub ms: f64,
    /// Where it came from or went to; none while unfinished.
    pub file: Option<PathBuf>,
    /// What went wrong on the way, without spoiling it.
    pub complaint: Option<String>,
}

/// Where a bake may be kept: beside the asset, or in the user's cache.
pub fn cache_files(asset: &Path, cloud: &SurfelCloud, directions: usize) -> Vec<PathBuf> {
    let mut name = asset.file_name().unwrap_or_default().to_owned();
    name.push(format!(".{directions}.bake"));
    let beside = asset.with_file_name(name);
    let cached = directories::ProjectDirs::from("", "", "transplat").map(|d| {
        d.cache_dir()
            .join(format!("{:016x}.{directions}.bake", geometry_key(cloud)))
    });
    [Some(beside), cached].into_iter().flatten().collect()
}

/// Bakes, or reads what was baked before: `saved` first of all, of as many directions as it has. `report` is told how far it is and may break off; `preview` gets what can be seen so far.
pub fn bake(
    device: &Device,
    asset: &Path,
    cloud: &Arc<SurfelCloud>,
    directions: usize,
    saved: Option<&Path>,
    report: &(dyn Fn(f64) -> std::ops::ControlFlow<()> + Sync),
    preview: impl Fn(Baked),
) -> anyhow::Result<Baked> {
    let start = Instant::now();
    let files = cache_files(asset, cloud, directions);
    let mut complaint = None;
    if let Some(file) = saved {
        match load_bake(file, cloud) {
            Ok(visibility) => {
                return Ok(Baked {
                    visibility,
                    share: 1.0,
                    ms: start.elapsed().as_secs_f64() * 1e3,
                    file: Some(file.to_owned()),
                    complaint: None,
                });
            }
            Err(error) => complaint = Some(format!("{error}; baking anew")),
        }
    }
    for file in &files {
        // One of another geometry or size is as good as none.
        if let Ok(visibility) = load_bake(file, cloud)
            && visibility.directions == directions
        {
            return Ok(Baked {
                visibility,
                share: 1.0,
                ms: start.elapsed().as_secs_f64() * 1e3,
                file: Some(file.clone()),
                complaint: None,
            });
        }
    }
    let mut input = BakeInput::new(cloud, &BakeSettings { directions });
    let frames = std::mem::take(&mut input.frames);
    let order = refining_order(directions);
    let mut open = vec![0u8; cloud.len() * directions];
    let mut done = 0;
    for share in STAGES {
        let end = directions.div_ceil(share);
        let part = &order[done..end];
        input.frames = part.iter().map(|i| frames[*i]).collect();
        let progress = |p: f64| report((done as f64 + p * part.len() as f64) / directions as f64);
        let stage = device.bake_visibility(&input, &progress)?;
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
            preview(Baked {
                visibility: Visibility::from_open(cloud, directions, filled),
                share: done as f32 / directions as f32,
                ms: start.elapsed().as_secs_f64() * 1e3,
                file: None,
                complaint: None,
            });
        }
    }
    let ms = start.elapsed().as_secs_f64() * 1e3;
    let visibility = Visibility::from_open(cloud, directions, open);
    let file = match keep(&files, cloud, &visibility) {
        Ok(file) => Some(file),
        Err(why) => {
            complaint.get_or_insert(format!("the bake could not be kept: {why}"));
            None
        }
    };
    Ok(Baked {
        visibility,
        share: 1.0,
        ms,
        file,
        complaint,
    })
}

/// Writes the bake to the first place that takes it.
fn keep(
    files: &[PathBuf],
    cloud: &SurfelCloud,
    visibility: &Visibility,
) -> Result<PathBuf, String> {
    let mut why = String::new();
    for file in files {
        if let Some(folder) = file.parent().filter(|f| !f.is_dir()) {
            // A missing cache is made; what goes wrong with it is told below.
            let _ = std::fs::create_dir_all(folder);
        }
        match save_bake(file, cloud, visibility) {
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
    use transplat_core::scenes;

    #[test]
    fn a_bake_refines_is_kept_and_is_found_again() {
        let folder = tempfile::tempdir().expect("a folder");
        let asset = folder.path().join("ball.ply");
        let cloud = Arc::new(scenes::sphere_over_plate(400));
        let shares = RefCell::new(Vec::new());
        let run = |cloud: &Arc<SurfelCloud>| {
            let preview = |b: Baked| shares.borrow_mut().push(b.share);
            bake(
                &Device::Cpu,
                &asset,
                cloud,
                64,
                None,
                &|_| ControlFlow::Continue(()),
                preview,
            )
            .expect("a bake")
        };
        let first = run(&cloud);
        assert_eq!(*shares.borrow(), [0.0625, 0.125, 0.25, 0.5]);
        let file = first.file.expect("it is kept");
        assert_eq!(file, folder.path().join("ball.ply.64.bake"));
        let again = run(&cloud);
        assert_eq!(shares.borrow().len(), 4, "the second is read");
        assert_eq!(again.visibility.open, first.visibility.open);
        // The same bake as in one go: the order of directions does not matter.
        let settings = BakeSettings { directions: 64 };
        let whole = transplat_core::visibility::bake(
            &cloud,
            &settings,
            &transplat_core::visibility::no_progress,
        );
        assert_eq!(whole.expect("a bake").open, first.visibility.open);
        // Of another geometry it is not taken.
        let other = Arc::new(scenes::sphere_over_plate(500));
        assert_eq!(run(&other).visibility.normals.len(), other.len());
    }

    #[test]
    fn a_cancelled_bake_leaves_nothing() {
        let folder = tempfile::tempdir().expect("a folder");
        let asset = folder.path().join("ball.ply");
        let cloud = Arc::new(scenes::sphere(400));
        let stop = |_| ControlFlow::Break(());
        assert!(bake(&Device::Cpu, &asset, &cloud, 32, None, &stop, |_| ()).is_err());
        assert_eq!(
            std::fs::read_dir(folder.path())
                .expect("it is there")
                .count(),
            0
        );
    }
}
