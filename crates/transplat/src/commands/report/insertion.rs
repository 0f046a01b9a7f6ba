//! Objects put into captured scenes, five ways, against path-traced truth.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context, Result};
use glam::{DMat3, Vec3};
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::files::{PngBits, load_environment, write_png};
use transplat_core::present::{self, PLAIN};
use transplat_core::probe::DEFAULT_ROWS;
use transplat_core::rasterize::shade;
use transplat_core::scene::{EVEN, EnvironmentLight, Object, Scene, Transform};
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::sh::lattice;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::{Part, Relit};

use crate::cli::{LightArgs, ReportArgs};
use crate::commands::headless::Headless;
use crate::commands::probe::{Lights, ProbeEnvironment, seen};
use crate::summary::Summary;
use transplat_engine::device::{Device, Paint};
use transplat_engine::output::make_folder;
use transplat_engine::splat::Splat;
use transplat_eval::ground_truth::insertion::{TruthScene, TruthView};
use transplat_eval::metrics::ComparedImage;
use transplat_eval::report::page::write;

/// Name of the table that [`run`] writes.
pub const INSERTION_CSV: &str = "insertion.csv";

/// Normals over which irradiance is compared.
const NORMALS: usize = 500;

/// Other things that an object changes count where they are more pixels of a view.
const FEW: usize = 200;

/// Ways of putting an object into a scene.
#[derive(Clone, Copy, PartialEq)]
enum Way {
    /// As both were captured.
    Pasted,
    /// Relit by the light that the scene shows at its place; nothing happens to the scene.
    Probe,
    /// Relit by the true light at the place.
    Received,
    /// Preset `paper`.
    Paper,
    /// Preset `best`.
    Best,
}

impl Way {
    const ALL: [(Self, &'static str); 5] = [
        (Self::Pasted, "pasted"),
        (Self::Probe, "probe"),
        (Self::Received, "received"),
        (Self::Paper, "paper"),
        (Self::Best, "best"),
    ];
}

/// Likeness to the true images: PSNR in dB over parts of them, the mean of the views.
#[derive(Clone, Copy, Debug, Default)]
struct Score {
    object: f64,
    ground: f64,
    walls: f64,
    full: f64,
    /// Mean of picture less truth on the ground that changes.
    bias: f64,
    /// Share of the true change of the ground that the pictures show: none is 0, all of it 1.
    effect: f64,
}

impl Score {
    const NAMES: [&'static str; 6] = ["object", "ground", "walls", "full", "bias", "effect"];

    fn values(&self) -> [f64; 6] {
        [
            self.object,
            self.ground,
            self.walls,
            self.full,
            self.bias,
            self.effect,
        ]
    }

    fn mean_of(scores: &[[f64; 6]]) -> Self {
        // A part that a view does not show is no number there.
        let mean = |i: usize| {
            let known = scores.iter().map(|s| s[i]).filter(|v| v.is_finite());
            let known: Vec<f64> = known.collect();
            known.iter().sum::<f64>() / known.len() as f64
        };
        let [object, ground, walls, full, bias, effect] = std::array::from_fn(mean);
        Self {
            object,
            ground,
            walls,
            full,
            bias,
            effect,
        }
    }
}

/// Compares all scenes and objects with their truth; writes the table and pictures, and returns the table for people.
pub fn run(
    scenes: &[TruthScene],
    args: &ReportArgs,
    device: &Device,
    summary: &mut Summary,
) -> Result<String> {
    let pictures = args.output.join("pictures");
    let mut csv = format!("scene,insert,way,{}\n", Score::NAMES.join(","));
    let mut text = format!(
        "{:<24}{:<10}{}\n",
        "object in scene",
        "way",
        Score::NAMES.map(|n| format!("{n:>8}")).join("")
    );
    for scene in scenes {
        for insert in scene.inserts() {
            let subject = InsertionSubject::load(scene, insert, device, summary)?;
            for (way, name) in Way::ALL {
                let Some(relit) = subject.relit(way, summary)? else {
                    continue;
                };
                let folder = pictures.join(&scene.name).join(insert).join(name);
                let score = subject.score(&relit, &folder)?;
                let values = score.values();
                let digits = |digits: usize| values.map(|v| format!("{v:.digits$}"));
                csv += &format!("{},{insert},{name},{}\n", scene.name, digits(4).join(","));
                let shown = digits(2).map(|v| format!("{v:>8}")).join("");
                let what = format!("{insert} in {}", scene.name);
                text += &format!("{what:<24}{name:<10}{shown}\n");
            }
            if let Some(error) = subject.probe_error()? {
                text += &format!(
                    "{insert} in {}: irradiance from the probe is {:.1} % off the light that arrives (relative L2 over all normals)\n",
                    scene.name,
                    100.0 * error
                );
            }
        }
    }
    write(&args.output.join(INSERTION_CSV), &csv)?;
    Ok(text)
}

/// A scene with an object, ready to be relit and compared.
struct InsertionSubject<'a> {
    truth: &'a TruthScene,
    insert: &'a str,
    headless: Headless,
    views: Vec<TruthView>,
    /// The light that the scene shows at the object.
    probe: EnvironmentMap,
}

impl<'a> InsertionSubject<'a> {
    fn load(
        truth: &'a TruthScene,
        insert: &'a str,
        device: &Device,
        summary: &mut Summary,
    ) -> Result<Self> {
        let headless = loaded(&truth.with(insert)?, Method::Directional, device, summary)?;
        let views = truth.views(insert, headless.shots.cloud.bounds().radius)?;
        let probe = probe(&headless, summary)?;
        Ok(Self {
            truth,
            insert,
            headless,
            views,
            probe,
        })
    }

    /// Relit scene and object of a way, each in its own coordinates; none where it does not apply.
    fn relit(&self, way: Way, summary: &mut Summary) -> Result<Option<Vec<Relit>>> {
        let shown: Vec<(&Object, &Splat)> = self.headless.shown().collect();
        let [(_, scene), (inserted, object)] = shown[..] else {
            return Ok(None);
        };
        let light = match way {
            Way::Pasted => return Ok(Some(vec![captured(&scene.cloud), captured(&object.cloud)])),
            Way::Probe => self.probe.clone(),
            Way::Received => match self.truth.received(self.insert) {
                Some(path) => load_environment(&path)?,
                None => return Ok(None),
            },
            Way::Paper => return together(&self.headless, Method::Harmonic, summary).map(Some),
            Way::Best => return together(&self.headless, Method::Directional, summary).map(Some),
        };
        let light = self
            .headless
            .shots
            .device
            .light(&light, Method::Directional)?;
        let relit = alone(&self.headless, inserted, &light, summary)?;
        Ok(Some(vec![captured(&scene.cloud), relit]))
    }

    /// Draws each view, writes it, and compares it with the truth.
    fn score(&self, relit: &[Relit], folder: &Path) -> Result<Score> {
        make_folder(folder)?;
        let (painter, _) = self
            .headless
            .shots
            .device
            .painter(&self.headless.shots.cloud)?;
        let mut scores = Vec::new();
        for (number, view) in self.views.iter().enumerate() {
            let mut colors = Vec::new();
            for ((object, asset), relit) in self.headless.shown().zip(relit) {
                let object_from_scene = object.transform.scene_from_object().inverse();
                let eye = object_from_scene.transform_point3(view.camera.eye);
                let (positions, sh) = (&asset.cloud.positions, &relit.sh);
                colors.extend(shade(
                    positions,
                    sh,
                    relit.degree,
                    relit.encoding,
                    eye,
                    PLAIN,
                ));
            }
            let raster = painter.draw(&view.camera, Paint::Colors(&colors), PLAIN, &[])?;
            let path = folder.join(format!("{number:02}.png"));
            let straight = present::straight(&raster);
            write_png(
                &path,
                raster.width,
                raster.height,
                &straight,
                PngBits::Eight,
            )?;
            scores.push(compare(&ComparedImage::of_display(&raster), view)?);
        }
        Ok(Score::mean_of(&scores))
    }

    /// Relative error of the irradiance over all normals that the probe gives.
    fn probe_error(&self) -> Result<Option<f64>> {
        let Some(path) = self.truth.received(self.insert) else {
            return Ok(None);
        };
        let truth = load_environment(&path)?;
        let (mut error, mut all) = (0.0, 0.0);
        for n in lattice(NORMALS) {
            let [ours, true_one] = [&self.probe, &truth].map(|map| irradiance(map, n));
            for c in 0..3 {
                error += (ours[c] - true_one[c]).powi(2);
                all += true_one[c].powi(2);
            }
        }
        Ok(Some((error / all).sqrt()))
    }
}

fn loaded(
    scene: &Scene,
    method: Method,
    device: &Device,
    summary: &mut Summary,
) -> Result<Headless> {
    let scene = Scene {
        transfer: TransferSettings::of(method),
        ..scene.clone()
    };
    Headless::of(scene, device.clone(), summary)
}

/// Both relit by what lights the scene.
fn together(headless: &Headless, method: Method, summary: &mut Summary) -> Result<Vec<Relit>> {
    let scene = &headless.shots.project.scene;
    let mut again = loaded(scene, method, &headless.shots.device, summary)?;
    let targets = again.light(&LightArgs::default(), summary)?;
    again.prepare(summary)?;
    let target = targets.first().context("a light")?;
    let light = again.light_by(target, summary)?;
    again.relight_splats(&target.name, &light, true, summary)
}

/// An object relit alone by a light of the scene.
fn alone(
    headless: &Headless,
    object: &Object,
    light: &Illumination,
    summary: &mut Summary,
) -> Result<Relit> {
    let scene = &headless.shots.project.scene;
    let as_captured = Scene {
        objects: vec![Object {
            transform: Transform::default(),
            ..object.clone()
        }],
        environment: EnvironmentLight::of(EVEN),
        ..scene.clone()
    };
    let mut again = Headless::of(as_captured, headless.shots.device.clone(), summary)?;
    again.light(&LightArgs::default(), summary)?;
    let prepared = again.prepare(summary)?;
    let object_from_scene = object.transform.rotation.inverse().as_dquat();
    // As the scene sees it, and as the object is turned in it.
    let light = EnvironmentLight::default().orient(light, headless.shots.cloud.up);
    let light = light.rotated(DMat3::from_quat(object_from_scene));
    Ok(prepared.relight(&light, Part::Whole)?)
}

/// As it was captured.
fn captured(cloud: &Arc<SurfelCloud>) -> Relit {
    Relit {
        sh: cloud.sh.to_vec(),
        degree: cloud.sh_degree,
        encoding: cloud.encoding,
        tau: Vec::new(),
        shadows: Vec::new(),
    }
}

/// The light that the scene shows at the object's place, which is left out.
fn probe(headless: &Headless, summary: &mut Summary) -> Result<EnvironmentMap> {
    let shown: Vec<(&Object, &Splat)> = headless.shown().collect();
    let [(scene, _), (object, asset)] = shown[..] else {
        anyhow::bail!("a scene and an object are expected");
    };
    let scene_from_object = object.transform.scene_from_object();
    let place = scene_from_object.transform_point3(asset.cloud.bounds().center);
    let light = Some(scene.source.clone());
    let around = ProbeEnvironment::load(headless, place, light, summary)?;
    let (painter, _) = headless.shots.device.painter(&headless.shots.cloud)?;
    let lights = Lights {
        around: around.as_ref(),
        ..Lights::default()
    };
    let without = std::iter::once(1);
    let probe = seen(headless, (&painter, without), place, DEFAULT_ROWS, &lights)?;
    Ok(probe.map)
}

fn irradiance(map: &EnvironmentMap, n: Vec3) -> [f64; 3] {
    let mut sum = [0f64; 3];
    for row in 0..map.height() {
        let omega = map.pixel_solid_angle(row);
        for column in 0..map.width() {
            let d = Vec3::from_array(map.direction(column, row).map(|v| v as f32));
            let cosine = f64::from(n.dot(d).max(0.0));
            let radiance = map.pixels()[row * map.width() + column];
            for c in 0..3 {
                sum[c] += omega * cosine * f64::from(radiance[c]);
            }
        }
    }
    sum
}

/// A picture against the truth of its view, in the order of [`Score`].
fn compare(ours: &ComparedImage, view: &TruthView) -> Result<[f64; 6]> {
    let [object, ground, walls] = &view.masks;
    let count = |mask: &[bool]| mask.iter().filter(|m| **m).count();
    let over = |mask: &[bool], least: usize| -> Result<f64> {
        if count(mask) < least.max(1) {
            return Ok(f64::NAN);
        }
        ours.psnr(&view.with, Some(mask))
    };
    let (mut bias, mut along, mut square) = (0.0, 0.0, 0.0);
    for i in (0..ground.len()).filter(|i| ground[*i]) {
        for c in 0..3 {
            let [ours, with, without] =
                [ours, &view.with, &view.without].map(|p| f64::from(p.pixels[i][c]));
            bias += ours - with;
            along += (with - without) * (ours - without);
            square += (with - without) * (with - without);
        }
    }
    let effect = if square > 0.0 {
        along / square
    } else {
        f64::NAN
    };
    Ok([
        over(object, 1)?,
        over(ground, 1)?,
        over(walls, FEW)?,
        ours.psnr(&view.with, None)?,
        bias / (3 * count(ground)) as f64,
        effect,
    ])
}
