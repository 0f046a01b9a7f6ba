//! Shots of a project: the lit scene and its studio, for files, frames and layers.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, Result, anyhow};
use transplat_core::bake::Bake;
use transplat_core::color::Encoding;
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::files::{
    Channel, folder_of, load_lut, look_text, save_look, write_layers, write_relit, write_splat,
};
use transplat_core::present::{Background, View};
use transplat_core::progress::no_progress;
use transplat_core::scene::Scene;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::{Part, PreparedTransfer, Relit};

use crate::device::{Device, Painter, Transfer};
use crate::environments::{Environment, load_map};
use crate::language::tr;
use crate::layers::Layers;
use crate::names::name_of;
use crate::output::make_folder;
use crate::project::{Project, SOURCE, TARGET};
use crate::render::{Backdrop, Before, Lit, Studio, lit_ground};

/// Maps that are kept: a picture has two sides, and many lights are not to be held all at a time.
const KEPT: usize = 2;

/// Relights all that is shown, on its device.
pub struct Relighter {
    /// Transfer from the source light.
    pub prepared: PreparedTransfer,
    /// The bake that it was prepared from.
    pub bake: Arc<Bake>,
    /// The transfer on its device.
    pub transfer: Transfer,
}

/// Images and relit splats of a headless project, under one light after the other.
pub struct Shots {
    /// Project that the images are of.
    pub project: Project,
    /// All that is shown, where it stands.
    pub cloud: Arc<SurfelCloud>,
    /// Device that relights and draws.
    pub device: Device,
    /// Notes of work that is done on another device than that, and why.
    pub warnings: Vec<String>,
    relighter: Option<Relighter>,
    painter: Option<Arc<Painter>>,
    /// Shown before a comparison in the place of the capture.
    before: Option<Before>,
    /// Transfer of a place without what was put into it, once it was requested.
    place: Option<Option<PreparedTransfer>>,
    backdrops: Backdrops,
}

impl Shots {
    /// Takes a headless project; what it lacks is made when it is needed.
    ///
    /// # Errors
    /// Nothing is shown.
    pub fn of(project: Project) -> Result<Self> {
        Ok(Self {
            cloud: project
                .whole()
                .cloud()
                .context(tr("No object is visible."))?,
            device: project.device.fastest(),
            project,
            warnings: Vec::new(),
            relighter: None,
            painter: None,
            before: None,
            place: None,
            backdrops: Backdrops::default(),
        })
    }

    /// Shows a look before comparisons in the place of the capture: that of another copy.
    pub fn set_before(&mut self, look: Project, is_linear: bool) -> Result<()> {
        let scene = look.scene.clone();
        let lut = scene.lut.as_ref().filter(|_| !is_linear);
        let lut = lut.map(|path| load_lut(path)).transpose()?;
        self.before = Some(Before {
            relit: Self::of(look)?.relit(Part::Whole, &[])?,
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
        Ok(&self.relighter()?.prepared)
    }

    /// Relights by the light that is set, all or what a view shows of it; some surfels may be left out, `[n]` or empty.
    pub fn relit(&mut self, part: Part, unseen: &[bool]) -> Result<Relit> {
        self.prepared()?;
        let light = self.project.target_light();
        let transfer = &mut self.relighter()?.transfer;
        transfer.change_light(&light, part, unseen)?;
        transfer.result()
    }

    /// Relighter of what the project has prepared.
    ///
    /// # Errors
    /// It has prepared nothing yet, or the device failed.
    pub fn relighter(&mut self) -> Result<&mut Relighter> {
        Ok(match &mut self.relighter {
            Some(relighter) => relighter,
            none => {
                let prepared = self.project.shown_transfer();
                let made = prepared.zip(self.project.shown_bake());
                let (prepared, bake) = made.context(tr(
                    "The objects are still being prepared. Try again when that is done.",
                ))?;
                let (transfer, warning) = self.device.transfer(&prepared)?;
                self.warnings.extend(warning);
                none.insert(Relighter {
                    prepared,
                    bake,
                    transfer,
                })
            }
        })
    }

    /// Lights a view: relit where it needs that, and with what is around.
    pub fn lit(&mut self, view: View) -> Result<Lit> {
        let relit = if view.needs_relit() {
            Some(self.relit(view.part(), &self.project.spared_surfels())?)
        } else {
            self.project.settle()?;
            None
        };
        self.lit_by(view, relit)
    }

    /// Lights a view by a relit result, which has only the view's part, and with what is around.
    pub fn lit_by(&mut self, view: View, relit: Option<Relit>) -> Result<Lit> {
        let mut lit = match relit {
            Some(relit) => {
                let cloud = self.cloud.clone();
                let Relighter { prepared, bake, .. } = self.relighter()?;
                Lit::of(view, relit, &cloud, bake, prepared)
            }
            None => Lit::default(),
        };
        if view.has_two_sides() {
            lit.before.clone_from(&self.before);
        }
        self.backdrops.surround(&mut lit, &self.project, view)?;
        Ok(lit)
    }

    /// A studio for all that is shown. Plate and LUT are not read yet.
    pub fn studio(&mut self, view: View, is_linear: bool) -> Result<Studio> {
        self.project.requested.bakes |= view == View::Visibility;
        self.project.settle()?;
        let painter = self.painter()?;
        let project = &self.project;
        let mut studio = Studio::new(&self.cloud, project.scene.clone(), view, is_linear, painter);
        studio.hidden = project.unseen_surfels();
        studio.ground = project.ground().cloned();
        if let (View::Visibility, Some(bake)) = (view, project.shown_bake()) {
            studio.openness = bake.openness().iter().map(|o| [*o; 3]).collect();
        }
        Ok(studio)
    }

    fn painter(&mut self) -> Result<Arc<Painter>> {
        Ok(match &self.painter {
            Some(painter) => painter.clone(),
            None => {
                let (painter, warning) = self.device.painter(&self.cloud)?;
                self.warnings.extend(warning);
                self.painter.insert(Arc::new(painter)).clone()
            }
        })
    }

    /// Layers of a relit result, and of the place without what was put into it.
    pub fn layers(&mut self, relit: Relit) -> Result<Layers> {
        let light = self.project.target_light();
        let place = self.place_alone()?;
        let alone = place.map(|place| place.relight(&light, Part::Whole));
        let alone = alone.transpose()?;
        let objects = self.project.shown();
        let objects = objects.map(|(_, o, a)| (name_of(o, &a.path), a.cloud.len()));
        Ok(Layers::new(&objects.collect::<Vec<_>>(), relit, alone))
    }

    /// Relights each object in its own coordinates by a light that the scene sees.
    pub fn relit_objects(&mut self, light: &Illumination) -> Result<Vec<Relit>> {
        let prepared = &self.relighter()?.prepared;
        Ok(prepared.relight_objects(light, Part::Whole, &[])?)
    }

    /// Writes relit splats: each object, in its own coordinates, as its own file is, with everything that it had; or all that is shown as one
    /// splat, which of a single object is that.
    ///
    /// # Errors
    /// One cannot be written.
    pub fn write_splats(&self, relit: Vec<Relit>, files: &[PathBuf], is_each: bool) -> Result<()> {
        let project = &self.project;
        for (((at, _, asset), relit), file) in project.shown().zip(relit).zip(files) {
            make_folder(folder_of(file))?;
            let cloud = match is_each {
                true => asset.upright(project.up_of(at)),
                false => self.cloud.clone(),
            };
            if project.is_composed() && !is_each {
                let stored = relit.stored_as(cloud.sh_degree, Encoding::Stored);
                write_splat(&cloud, &stored, file)?;
            } else {
                write_relit(&asset.file, &cloud, &relit.stored(&cloud), file)?;
            }
        }
        Ok(())
    }

    /// Transfer of the place that objects were put into without them, where the first object is one.
    pub fn place_alone(&mut self) -> Result<Option<&PreparedTransfer>> {
        if self.place.is_none() {
            let place = match self.project.scene.first_is_a_place() {
                true => self.relighter()?.prepared.first_alone(&no_progress)?,
                false => None,
            };
            self.place = Some(place);
        }
        Ok(self.place.as_ref().and_then(Option::as_ref))
    }
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

/// Maps behind the objects, as they are seen: by the light, whether its suns are taken out, and their blur.
#[derive(Default)]
struct Backdrops(Vec<((u64, bool, f32), Arc<EnvironmentMap>)>);

impl Backdrops {
    /// Puts around what is lit what its lights are seen as: maps behind it, where they are shown, and the shadow on the ground.
    ///
    /// # Errors
    /// A map cannot be read.
    fn surround(&mut self, lit: &mut Lit, project: &Project, view: View) -> Result<()> {
        let (scene, up) = (&project.scene, project.scene_up());
        if let Some(ground) = project.ground() {
            let maps = project
                .matched_sides()
                .map(|(_, there)| &there.light.illumination);
            lit.ground = lit_ground(ground, scene, maps, up);
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
