//! Shots of a project: the lit scene and its studio, for files, frames and layers.

use std::path::Path;
use std::sync::Arc;

use anyhow::{Context as _, Result, anyhow};
use transplat_core::bake::Bake;
use transplat_core::camera::Camera;
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::files::{Channel, load_lut, look_text, save_look, write_layers};
use transplat_core::present::{Background, View};
use transplat_core::progress::no_progress;
use transplat_core::scene::Scene;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::{Part, PreparedTransfer, Relit};

use crate::device::{Device, Transfer};
use crate::environments::{Environment, load_map};
use crate::jobs::{Jobs, Watch};
use crate::language::tr;
use crate::layers::Layers;
use crate::names::name_of;
use crate::project::{Project, SOURCE, TARGET};
use crate::render::{Backdrop, Before, Lit, Studio, lit_ground};

/// Maps that are kept: a picture has two sides, and many lights are not to be held all at a time.
const KEPT: usize = 2;

/// Takes pictures of a headless project, under one light after the other.
pub struct Shots {
    /// Copy that the images are of.
    pub project: Project,
    /// All that is shown, where it stands.
    pub cloud: Arc<SurfelCloud>,
    device: Device,
    by: Option<(PreparedTransfer, Arc<Bake>, Transfer)>,
    /// Shown before a comparison in the place of the capture.
    before: Option<Before>,
    /// Transfer of a place without what was put into it, once it was requested.
    place: Option<Option<PreparedTransfer>>,
    backdrops: Backdrops,
}

impl Shots {
    /// Has a copy of a project ready; what it lacks is made here, followed by `watch`.
    ///
    /// # Errors
    /// Nothing is shown.
    pub fn of(mut project: Project, watch: Watch) -> Result<Self> {
        project.jobs = Jobs::at_once(watch);
        Ok(Self {
            cloud: project.whole().cloud().context(tr("no object is shown"))?,
            device: project.device.fastest(),
            project,
            by: None,
            before: None,
            place: None,
            backdrops: Backdrops::default(),
        })
    }

    /// Shows a look before comparisons in the place of the capture: that of another copy.
    pub fn set_before(&mut self, look: Project, watch: Watch, is_linear: bool) -> Result<()> {
        let scene = look.scene.clone();
        let lut = scene.lut.as_ref().filter(|_| !is_linear);
        let lut = lut.map(|path| load_lut(path)).transpose()?;
        self.before = Some(Before {
            relit: Self::of(look, watch)?.relit(Part::Whole, &[])?,
            display: scene.display,
            lut: lut.map(Arc::new),
        });
        Ok(())
    }

    /// Lights the project by another environment. What is set of the last one's file, suns and sky is not its.
    pub fn light_by(&mut self, light: &Environment) {
        let project = &mut self.project;
        if project.environment.light.id != light.id {
            project.scene.environment.set_file(light.path.clone());
            project.scene.environment.set_reading(&light.reading);
        }
    }

    /// Transfer of all that is shown.
    pub fn prepared(&mut self) -> Result<&PreparedTransfer> {
        self.project.requested.bakes = true;
        self.project.requested.transfers = true;
        self.project.settle()?;
        let (prepared, ..) = self.by()?;
        Ok(prepared)
    }

    /// Relights by the light that is set, all or what a view shows of it; some surfels may be left out, `[n]` or empty.
    pub fn relit(&mut self, part: Part, unseen: &[bool]) -> Result<Relit> {
        self.prepared()?;
        let light = self.project.target_light();
        let (.., transfer) = self.by()?;
        transfer.change_light(&light, part, unseen)?;
        transfer.result()
    }

    /// Transfer, bake, and the transfer on its device, once the project has settled.
    fn by(&mut self) -> Result<&mut (PreparedTransfer, Arc<Bake>, Transfer)> {
        Ok(match &mut self.by {
            Some(by) => by,
            none => {
                let prepared = self.project.shown_transfer();
                let made = prepared.zip(self.project.shown_bake());
                let (prepared, bake) = made.context(tr(
                    "the objects are still being prepared; try again when that is done",
                ))?;
                let (transfer, _) = self.device.transfer(&prepared)?;
                none.insert((prepared, bake, transfer))
            }
        })
    }

    /// Lights a view: relit where it needs that, and with what is around.
    pub fn lit(&mut self, view: View) -> Result<Lit> {
        self.project.requested.ground = true;
        let mut lit = Lit::default();
        if !view.needs_relit() {
            self.project.settle()?;
        } else {
            let relit = self.relit(view.part(), &self.project.spared_surfels())?;
            let cloud = self.cloud.clone();
            let (prepared, bake, _) = self.by()?;
            lit = Lit::of(view, relit, &cloud, bake, prepared);
        }
        if view.has_two_sides() {
            lit.before.clone_from(&self.before);
        }
        self.backdrops.surround(&mut lit, &self.project, view)?;
        Ok(lit)
    }

    /// A studio with plate and LUT.
    pub fn studio(&mut self, view: View, is_linear: bool) -> Result<Studio> {
        self.project.requested.bakes |= view == View::Visibility;
        self.project.requested.ground = true;
        self.project.settle()?;
        let of = (view, is_linear);
        let (mut studio, _) = studio(&self.project, &self.cloud, of, &self.device)?;
        studio.load_backplate()?;
        studio.load_lut()?;
        Ok(studio)
    }

    /// Takes a picture in layers of what is lit now.
    pub fn layers(
        &mut self,
        studio: &Studio,
        camera: &Camera,
        factor: usize,
        lit: &Lit,
    ) -> Result<Vec<Channel>> {
        let relit = lit.relit.clone().context("nothing is relit")?;
        if self.place.is_none() {
            let (prepared, ..) = self.by()?;
            let prepared = prepared.clone();
            self.place = Some(place_alone(&self.project.scene, &prepared)?);
        }
        let place = self.place.as_ref().and_then(Option::as_ref);
        let layers = layers(&self.project, relit, place, &self.project.target_light())?;
        layers.take(studio, camera, factor, lit)
    }
}

/// Transfer of the place that objects were put into without them, where the first object is one.
pub fn place_alone(scene: &Scene, prepared: &PreparedTransfer) -> Result<Option<PreparedTransfer>> {
    match scene.first_is_a_place() {
        true => Ok(prepared.first_alone(&no_progress)?),
        false => Ok(None),
    }
}

/// Layers of all that a project shows relit by a light, and of the place without what was put into it.
pub fn layers(
    project: &Project,
    relit: Relit,
    place: Option<&PreparedTransfer>,
    light: &Illumination,
) -> Result<Layers> {
    let alone = place.map(|place| place.relight(light, Part::Whole));
    let objects = project.shown();
    let objects = objects.map(|(_, o, a)| (name_of(o, &a.path), a.cloud.len()));
    let objects: Vec<_> = objects.collect();
    Ok(Layers::new(&objects, relit, alone.transpose()?))
}

/// Writes a picture in layers, and the look that makes it into a second file.
pub fn save_layers(
    path: &Path,
    look_path: &Path,
    look: &Scene,
    size: [usize; 2],
    channels: Vec<Channel>,
) -> Result<()> {
    let made_by = look_text(look).map_err(|why| anyhow!(why))?;
    write_layers(path, size, channels, &made_by)?;
    Ok(save_look(look_path, look)?)
}

/// A studio for all that a project shows, `cloud` being that as one splat, and why it draws on another device than the one asked for. Plate and
/// LUT are not read yet.
pub fn studio(
    project: &Project,
    cloud: &Arc<SurfelCloud>,
    (view, linear): (View, bool),
    device: &Device,
) -> Result<(Studio, Option<String>)> {
    let (painter, warning) = device.painter(cloud)?;
    let mut studio = Studio::new(cloud, project.scene.clone(), view, linear, painter);
    studio.hidden = project.unseen_surfels();
    studio.ground = project.ground().cloned();
    if let (View::Visibility, Some(bake)) = (view, project.shown_bake()) {
        studio.openness = bake.openness().iter().map(|o| [*o; 3]).collect();
    }
    Ok((studio, warning))
}

/// Maps behind the objects, as they are seen: by the light, whether its suns are taken out, and their blur.
#[derive(Default)]
pub struct Backdrops(Vec<((u64, bool, f32), Arc<EnvironmentMap>)>);

impl Backdrops {
    /// Puts around what is lit what its lights are seen as: maps behind it, where they are shown, and the shadow on the ground.
    ///
    /// # Errors
    /// A map cannot be read.
    pub fn surround(&mut self, lit: &mut Lit, project: &Project, view: View) -> Result<()> {
        let (scene, up) = (&project.scene, project.scene_up());
        if let Some(ground) = project.ground() {
            let maps = project
                .sides_of(0)
                .map(|(_, there)| &there.light.illumination);
            lit.ground = lit_ground(ground, scene, &scene.objects[0], maps, up);
        }
        if view.background(scene.background) != Background::Environment {
            return Ok(());
        }
        for side in [SOURCE, TARGET] {
            if !view.backdrops()[side] {
                continue;
            }
            let (light, settings, gain) = project.behind(side, view);
            let key = (light.id, settings.without_suns, scene.background_blur);
            let known = self.0.iter().position(|(of, _)| *of == key);
            let map = match known {
                Some(at) => {
                    let last_seen = self.0.remove(at);
                    self.0.insert(0, last_seen);
                    self.0[0].1.clone()
                }
                None => {
                    // What is not seen any more goes before the next is read: maps are large.
                    self.0.truncate(KEPT - 1);
                    let map = load_map(light)?;
                    let shown = settings.backdrop(&map, &light.illumination);
                    let map = Arc::new(shown.blurred(scene.background_blur));
                    self.0.insert(0, (key, map.clone()));
                    map
                }
            };
            lit.backdrops[side] = Some(Backdrop::new(map, settings, up, gain));
        }
        Ok(())
    }
}
