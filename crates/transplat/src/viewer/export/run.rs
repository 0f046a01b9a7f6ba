//! What an export makes of what it was started with.

use std::borrow::Cow;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, Result, bail};
use transplat_core::bake::Bake;
use transplat_core::bake::patches::DIRECTIONS;
use transplat_core::camera::{Camera, CameraPose};
use transplat_core::color::Encoding;
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::files::{
    ExrFloats, PngBits, folder_of, is_same_file, load_lut, look_text, save_look, write_exr,
    write_layers, write_png, write_relit, write_splat,
};
use transplat_core::ground::Ground;
use transplat_core::present::{self, Background, View};
use transplat_core::progress::{Progress, no_progress, tell};
use transplat_core::rasterize::Raster;
use transplat_core::scene::{EnvironmentLight, MOST_FRAMES, Scene};
use transplat_core::settings::Method;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::{Part, PreparedTransfer, Relit};

use super::{ExportSettings, ExportSides, Format, Made, Snapshot, Task, Turn, free_name};
use crate::engine::bake::{self, Wanted};
use crate::engine::delight::Delit;
use crate::engine::environments::{Environment, load_map};
use crate::engine::film::Film;
use crate::engine::jobs::Handle;
use crate::engine::layers::Layers;
use crate::engine::picture::MAX_SAMPLES;
use crate::engine::picture::{Backdrop, Before, Lit, Studio, lit_ground};
use crate::engine::project::{Pinned, SOURCE, TARGET};
use crate::language::{tr, tr_format};
use crate::viewer::navigation::wrap;
use crate::viewer::session::Outcome;

impl Snapshot {
    pub(super) fn run(mut self, task: &Task, handle: &Handle<Outcome>) -> Result<Made> {
        if let Some(whole) = self.whole.take() {
            self.cloud = whole.cloud().context(tr("no object is shown"))?;
        }
        if matches!(task, Task::Splat(_) | Task::Delit(_)) && self.cloud.up != self.up {
            // As it stands here, not as its file was taken.
            let up = self.up;
            let cloud = (*self.cloud).clone();
            self.cloud = Arc::new(SurfelCloud { up, ..cloud });
        }
        match task {
            Task::Splat(path) => return self.write_splat(path, handle),
            Task::Delit(path) => return self.write_delit(path, handle),
            _ => {}
        }
        let [width, height] = self.settings.size;
        let factor = self.settings.supersample;
        if width * height * factor * factor > MAX_SAMPLES {
            bail!(tr_format!(
                "a picture of {width} x {height} with {factor} x {factor} samples a pixel is too large; {MAX_SAMPLES} samples are possible",
                width = width,
                height = height,
                factor = factor,
                MAX_SAMPLES = MAX_SAMPLES
            ));
        }
        if self.scene.shadow_catcher && self.ground.is_none() {
            let report = |_| handle.progress(0.0);
            self.ground = Some(Ground::bake(
                &self.cloud,
                self.up,
                self.scene.directions,
                &report,
            )?);
        }
        if let Some(bake) = self.missing_bake(handle)? {
            self.bakes.push(bake);
        }
        match task {
            Task::Screenshot(Some(path)) => {
                let report = |done| handle.progress(done);
                self.save(path, self.scene.view, &self.lights[TARGET], &report)?;
                Ok(Made::Files(vec![path.clone()]))
            }
            Task::Screenshot(None) => {
                let views = match self.settings.sides {
                    // Layers are of what is relit alone.
                    ExportSides::Each if self.settings.format == Format::ExrLayers => {
                        vec![View::After]
                    }
                    ExportSides::Shown => vec![self.scene.view],
                    ExportSides::Each => vec![View::Before, View::After],
                };
                let pictures = views.into_iter().map(|view| (view, &self.lights[TARGET]));
                self.each(handle, pictures)
            }
            Task::Clipboard | Task::Preview => {
                let report = |done| handle.progress(done);
                let raster = self.picture(self.scene.view, &self.lights[TARGET], &report)?;
                let bytes = present::straight(&raster)
                    .iter()
                    .flatten()
                    .map(|v| (v * 255.0 + 0.5) as u8)
                    .collect();
                let size = [raster.width, raster.height];
                Ok(match task {
                    Task::Preview => Made::Preview(size, bytes),
                    _ => Made::Picture(size, bytes),
                })
            }
            Task::EachLight => {
                self.need_shelf()?;
                let lights = self.shelf.iter();
                self.each(handle, lights.map(|light| (self.scene.view, light)))
            }
            Task::ContactSheet => self.contact_sheet(handle),
            Task::Turntable => {
                let frames = self.settings.frames.max(1);
                let turn = |frame| 360.0 * frame as f64 / frames as f64;
                // The camera's turn changes no light: one relight does for all frames.
                match self.settings.turn {
                    Turn::Camera => self.sequence(handle, "", (frames, true), |frame, _, pose| {
                        pose.azimuth = wrap(pose.azimuth + turn(frame));
                    }),
                    Turn::Light => self.sequence(handle, "", (frames, false), |frame, scene, _| {
                        scene.environment.rotation += turn(frame);
                    }),
                }
            }
            Task::Animation => {
                let frame_rate = self.settings.frame_rate;
                let frames = self.scene.animation.frames(frame_rate);
                if frames > MOST_FRAMES {
                    bail!(tr_format!(
                        "the animation has {frames} frames; {MOST_FRAMES} are possible: fewer a second, or less time between its keys",
                        frames = frames,
                        MOST_FRAMES = MOST_FRAMES
                    ));
                }
                self.sequence(handle, "_animation", (frames, false), |frame, scene, _| {
                    scene.go_to(frame as f64 / f64::from(frame_rate));
                })
            }
            Task::Splat(_) | Task::Delit(_) => bail!("not a picture"),
        }
    }

    /// A picture of each view and light, by folder and pattern.
    fn each<'a>(
        &self,
        handle: &Handle<Outcome>,
        pictures: impl ExactSizeIterator<Item = (View, &'a Arc<Environment>)>,
    ) -> Result<Made> {
        let count = pictures.len();
        let mut written = Vec::new();
        for (i, (view, light)) in pictures.enumerate() {
            handle_step(handle, i, count)?;
            let path = self.named(&light.name(), view);
            let report = step(handle, i, count);
            self.save(&path, view, light, &report)?;
            written.push(path);
        }
        Ok(Made::Files(written))
    }

    /// The bake of a pinned look whose method has none yet.
    fn missing_bake(&self, handle: &Handle<Outcome>) -> Result<Option<Arc<Bake>>> {
        let Some(Pinned { scene, .. }) = &self.pinned else {
            return Ok(None);
        };
        let method = scene.transfer.method;
        let mut there = self.bakes.iter().chain([&self.bake]);
        if there.any(|bake| bake.method() == method) {
            return Ok(None);
        }
        let (report, device) = (|done| handle.progress(done), self.device.fastest());
        let skips = scene.transfer.skips;
        let part = self.part.as_ref();
        let part = part.filter(|_| method == Method::Directional);
        let part_of = part.map(|part| part.of_whole(&device, skips, &report));
        let wanted = Wanted {
            cloud: self.cloud.clone(),
            method,
            directions: match method {
                Method::Harmonic => scene.directions,
                Method::Directional => DIRECTIONS,
            },
            skips,
            part_of: part_of.transpose()?,
            beside: None,
        };
        Ok(Some(Arc::new(bake::bake(&device, &wanted, &report)?)))
    }

    pub(super) fn need_shelf(&self) -> Result<()> {
        if self.shelf.is_empty() {
            bail!(tr(
                "the shelf holds no light yet; drop environments on the window first"
            ));
        }
        Ok(())
    }

    pub(super) fn picture(
        &self,
        view: View,
        target: &Arc<Environment>,
        progress: Progress<'_>,
    ) -> Result<Raster> {
        let studio = self.studio(view)?;
        let lit = self.lit(&self.scene, view, target)?;
        self.take(&studio, &self.pose, &lit, progress)
    }

    fn save(
        &self,
        path: &Path,
        view: View,
        target: &Arc<Environment>,
        progress: Progress<'_>,
    ) -> Result<()> {
        let studio = self.studio(view)?;
        let lit = self.lit(&self.scene, view, target)?;
        let of = (&self.scene, &self.pose);
        self.save_shot(path, &studio, of, (target, &lit), progress)
    }

    /// Saves what a camera sees, as a picture or in layers.
    fn save_shot(
        &self,
        path: &Path,
        studio: &Studio,
        (scene, pose): (&Scene, &CameraPose),
        (target, lit): (&Arc<Environment>, &Lit),
        progress: Progress<'_>,
    ) -> Result<()> {
        if self.settings.format != Format::ExrLayers {
            let taken = self.take(studio, pose, lit, progress)?;
            tell(progress, 1.0)?;
            return self.write(path, &taken);
        }
        let relit = lit.relit.clone().filter(|_| studio.view == View::After);
        let relit = relit.context("layers are of what is relit: choose After")?;
        let alone = self.scene_alone(scene, target)?;
        let layers = Layers::new(&self.objects, relit, alone);
        let camera = Camera::from_pose(pose, self.up, self.settings.size, self.radius);
        let channels = layers.take(studio, &camera, self.settings.supersample, lit)?;
        let mut look = scene.clone();
        look.camera = Some(*pose);
        look.environment.set_file(target.path.clone());
        self.make_folder(path)?;
        let made_by = look_text(&look).map_err(anyhow::Error::msg)?;
        write_layers(path, self.settings.size, channels, &made_by)?;
        let name = path.with_extension("look");
        let (folder, stem) = (folder_of(path), name.file_name().unwrap_or_default());
        let beside = free_name(folder, &stem.to_string_lossy(), "json");
        Ok(save_look(&beside, &look)?)
    }

    /// The scene that objects were put into, relit without them; none where it is not shown.
    fn scene_alone(&self, scene: &Scene, target: &Environment) -> Result<Option<Relit>> {
        if self.scene_alone.get().is_none() {
            let shows_first = self.is_composed && scene.first_is_a_place();
            let prepared = self.prepared.get().filter(|_| shows_first);
            let alone = prepared.map(|p| p.first_alone(&no_progress)).transpose()?;
            let _ = self.scene_alone.set(alone.flatten());
        }
        let Some(alone) = self.scene_alone.get().and_then(Option::as_ref) else {
            return Ok(None);
        };
        let [_, light] = self.lights_on(scene, target);
        Ok(Some(alone.relight(&light, Part::Whole)?))
    }

    /// The light of the capture and a target as the object sees them.
    fn lights_on(&self, scene: &Scene, target: &Environment) -> [Illumination; 2] {
        let maps = [&self.lights[SOURCE].illumination, &target.illumination];
        scene.lights_on(&scene.objects[self.object], maps, self.up)
    }

    /// The transfer from the source, prepared once.
    fn prepared(&self, scene: &Scene, source: &Illumination) -> Result<&PreparedTransfer> {
        if self.prepared.get().is_none() {
            let _ = self.prepared.set(self.prepare(scene, source)?);
        }
        self.prepared.get().context("a transfer is prepared")
    }

    fn take(
        &self,
        studio: &Studio,
        pose: &CameraPose,
        lit: &Lit,
        progress: Progress<'_>,
    ) -> Result<Raster> {
        let camera = Camera::from_pose(pose, self.up, self.settings.size, self.radius);
        studio.take(&camera, self.settings.supersample, lit, progress)
    }

    fn studio(&self, view: View) -> Result<Studio> {
        let linear = self.settings.format.is_linear();
        let (painter, _) = self.device.fastest().painter(&self.cloud)?;
        let mut studio = Studio::new(&self.cloud, self.scene.clone(), view, linear, painter);
        studio.hidden = self.hidden.clone();
        if view == View::Visibility {
            studio.openness = self.bake.openness().iter().map(|o| [*o; 3]).collect();
        }
        studio.ground = self.ground.clone();
        studio.load_plate()?;
        studio.load_lut()?;
        Ok(studio)
    }

    /// Relights by a target: the source's part is the same for all of them.
    fn relit(
        &self,
        scene: &Scene,
        target: &Environment,
        part: Part,
    ) -> Result<(&PreparedTransfer, Relit)> {
        let [source, target] = self.lights_on(scene, target);
        let prepared = self.prepared(scene, &source)?;
        // A turntable of the light has many targets and one source.
        let mut transfer = self.transfer.borrow_mut();
        let transfer = match &mut *transfer {
            Some(kept) => kept,
            none => none.insert(self.device.fastest().transfer(prepared)?.0),
        };
        transfer.change_light(&target, part, &[])?;
        Ok((prepared, transfer.result()?))
    }

    fn prepare(&self, scene: &Scene, source: &Illumination) -> Result<PreparedTransfer> {
        let (cloud, settings) = (&self.cloud, &scene.transfer);
        // A pinned look may be of the other method.
        let mut bakes = [&self.bake].into_iter().chain(&self.bakes);
        let bake = bakes.find(|bake| bake.method() == settings.method);
        let bake = bake.context("the pinned look's preset is not baked")?;
        if let (Some(part), Method::Directional) = (&self.part, settings.method) {
            return part.prepare(bake, source, settings);
        }
        Ok(PreparedTransfer::new(cloud, bake, source, settings)?)
    }

    /// A light's map as it is seen behind the object.
    fn backdrop_map(
        &self,
        light: &Environment,
        settings: &EnvironmentLight,
    ) -> Result<Arc<EnvironmentMap>> {
        let key = (light.id, settings.without_suns);
        if let Some(map) = self.maps.borrow().get(&key) {
            return Ok(map.clone());
        }
        let map = load_map(light)?;
        let map = settings
            .backdrop(&map, &light.illumination)
            .blurred(self.scene.background_blur);
        let map = Arc::new(map);
        // A sheet of many lights is not to hold all their maps.
        let mut maps = self.maps.borrow_mut();
        if maps.len() >= 2 {
            maps.clear();
        }
        maps.insert(key, map.clone());
        Ok(map)
    }

    fn maps_of<'a>(&self, pinned: &'a Pinned) -> [&'a Illumination; 2] {
        [&pinned.sources[self.object], &pinned.environment].map(|light| &light.illumination)
    }

    /// What the lights make of the asset, for a view.
    fn lit(&self, scene: &Scene, view: View, target: &Arc<Environment>) -> Result<Lit> {
        // Suns are taken out of the look's own light.
        let mut of_other = Cow::Borrowed(scene);
        if scene.environment.without_suns && target.id != self.lights[TARGET].id {
            of_other.to_mut().environment.without_suns = false;
        }
        let scene = &*of_other;
        let source = &self.lights[SOURCE];
        let object = &scene.objects[self.object];
        let maps = [&source.illumination, &target.illumination];
        let mut lit = if view.needs_relit() {
            let (prepared, relit) = self.relit(scene, target, view.part())?;
            Lit::of(view, relit, &self.cloud, &self.bake, prepared)
        } else {
            Lit::default()
        };
        if let (Some(pinned), true) = (&self.pinned, view.has_two_sides()) {
            let scene = &pinned.scene;
            if self.pinned_relit.get().is_none() {
                let object = &scene.objects[self.object];
                let [source, target] = scene.lights_on(object, self.maps_of(pinned), self.up);
                let prepared = self.prepare(scene, &source)?;
                let mut transfer = self.device.fastest().transfer(&prepared)?.0;
                transfer.change_light(&target, Part::Whole, &[])?;
                let _ = self.pinned_relit.set(transfer.result()?);
            }
            let relit = self
                .pinned_relit
                .get()
                .context("the pinned look is relit")?;
            if self.pinned_lut.get().is_none() {
                let path = scene.lut.as_ref();
                let path = path.filter(|_| !self.settings.format.is_linear());
                let lut = path.map(|path| load_lut(path)).transpose()?;
                let _ = self.pinned_lut.set(lut.map(Arc::new));
            }
            lit.before = Some(Before {
                relit: relit.clone(),
                display: scene.display,
                lut: self.pinned_lut.get().cloned().flatten(),
            });
        }
        if let Some(ground) = &self.ground {
            lit.ground = lit_ground(ground, scene, object, maps, self.up);
        }
        if view.background(scene.background) == Background::Environment {
            let matched = scene.environment_gain(object, maps);
            // Behind a pinned look is that look's light.
            let left = match &self.pinned {
                Some(pinned) if view.has_two_sides() => {
                    let scene = &pinned.scene;
                    let object = &scene.objects[self.object];
                    let gain = scene.environment_gain(object, self.maps_of(pinned));
                    (&pinned.environment, &scene.environment, gain)
                }
                _ => (source, &object.source, 1.0),
            };
            let sides = [left, (target, &scene.environment, matched)];
            for (side, (light, settings, gain)) in sides.into_iter().enumerate() {
                if view.backdrops()[side] {
                    let map = self.backdrop_map(light, settings)?;
                    lit.backdrops[side] = Some(Backdrop::new(map, settings, self.up, gain));
                }
            }
        }
        Ok(lit)
    }

    fn make_folder(&self, path: &Path) -> Result<()> {
        if let Some(folder) = path.parent().filter(|f| !f.as_os_str().is_empty()) {
            std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
        }
        Ok(())
    }

    pub(super) fn write(&self, path: &Path, raster: &Raster) -> Result<()> {
        self.make_folder(path)?;
        let (width, height) = (raster.width, raster.height);
        let png = |bits| write_png(path, width, height, &present::straight(raster), bits);
        match self.settings.format {
            Format::Png8 => png(PngBits::Eight)?,
            Format::Png16 => png(PngBits::Sixteen)?,
            Format::ExrHalf | Format::ExrLayers => write_exr(path, raster, ExrFloats::Half)?,
            Format::ExrFloat => write_exr(path, raster, ExrFloats::Full)?,
        }
        Ok(())
    }

    /// A file's name by the pattern; one that is taken gets a number, nothing is written over.
    pub(super) fn named(&self, light: &str, view: View) -> PathBuf {
        let stem = self.stem(light, view, None);
        let folder = Path::new(&self.settings.folder);
        free_name(folder, &stem, self.settings.format.extension())
    }

    /// What the pattern makes of a picture, or of a frame of several.
    fn stem(&self, light: &str, view: View, frame: Option<usize>) -> String {
        let view = serde_json::to_value(view).ok();
        let view = view.as_ref().and_then(|v| v.as_str()).unwrap_or("picture");
        let pattern = match self.settings.pattern.trim() {
            // A file without a name is hidden.
            "" => ExportSettings::default().pattern,
            pattern => pattern.to_owned(),
        };
        let mut stem = pattern
            .replace("{asset}", &self.name)
            .replace("{light}", light)
            .replace("{view}", view)
            .replace(['/', '\\'], "-");
        if let Some(frame) = frame {
            let number = format!("{frame:03}");
            if stem.contains("{n}") {
                stem = stem.replace("{n}", &number);
            } else {
                stem = format!("{stem}_{number}");
            }
        }
        let stem = stem.replace("{n}", "");
        if stem.is_empty() {
            return self.name.clone();
        }
        stem
    }

    /// So many frames, each set from how it is now; where the light stays, it is relit once. Film and folder are named as a picture is, with what
    /// they hold behind.
    fn sequence(
        &self,
        handle: &Handle<Outcome>,
        what: &str,
        (frames, light_stays): (usize, bool),
        set: impl Fn(usize, &mut Scene, &mut CameraPose),
    ) -> Result<Made> {
        let target = &self.lights[TARGET];
        let view = self.scene.view;
        let studio = self.studio(view)?;
        let fixed = match light_stays {
            true => Some(self.lit(&self.scene, view, target)?),
            false => None,
        };
        let mut written = Vec::new();
        let stem = self.stem(&target.name(), view, None) + what;
        let named = |extension| free_name(Path::new(&self.settings.folder), &stem, extension);
        let mut film = match self.settings.film {
            Some(format) => {
                let path = named(format.extension());
                self.make_folder(&path)?;
                let film = Film::new(&path, self.settings.size, self.settings.frame_rate)?;
                written.push(path);
                Some(film)
            }
            None => None,
        };
        // A sequence has a folder of its own: in one with others it would be numbered around them.
        let folder = named("");
        for frame in 0..frames {
            handle_step(handle, frame, frames)?;
            let report = step(handle, frame, frames);
            let (mut pose, mut scene) = (self.pose, self.scene.clone());
            set(frame, &mut scene, &mut pose);
            // A sky is another light for each place of its sun.
            let sky = scene.environment.sky().filter(|_| target.sky.is_some());
            let target = match sky {
                Some(sky) => &Arc::new(Environment::of_sky(sky)),
                None => target,
            };
            let relit;
            let lit = match &fixed {
                Some(lit) => lit,
                None => {
                    relit = self.lit(&scene, view, target)?;
                    &relit
                }
            };
            if let Some(film) = &mut film {
                film.add(&self.take(&studio, &pose, lit, &report)?)?;
                continue;
            }
            let stem = self.stem(&target.name(), view, Some(frame));
            let extension = self.settings.format.extension();
            let path = free_name(&folder, &stem, extension);
            self.save_shot(&path, &studio, (&scene, &pose), (target, lit), &report)?;
            written.push(path);
        }
        if let Some(film) = film {
            film.finish()?;
        }
        Ok(Made::Files(written))
    }

    /// Refuses to write over what is shown.
    fn spare_captures(&self, path: &Path) -> Result<()> {
        let is_it = |capture: &PathBuf| is_same_file(capture, path);
        if path.exists() && self.captures.iter().any(is_it) {
            bail!(tr_format!(
                "{}: is the capture itself and would be lost; choose another name",
                path.display()
            ));
        }
        Ok(())
    }

    fn write_delit(&self, path: &Path, handle: &Handle<Outcome>) -> Result<Made> {
        self.spare_captures(path)?;
        let settings = &self.settings;
        if settings.materials {
            self.file.written_format(path).check_materials(path)?;
        }
        let [source, _] = self.lights_on(&self.scene, &self.lights[TARGET]);
        let prepared = self.prepared(&self.scene, &source)?;
        let whitest = settings.whitest;
        let delit = Delit::of(prepared, &self.cloud, settings.delit_as, whitest)?;
        handle_step(handle, 0, 1)?;
        delit.write(&self.file, settings.materials, path)?;
        Ok(Made::Delit(path.to_owned(), delit.warnings(whitest)))
    }

    fn write_splat(&self, path: &Path, handle: &Handle<Outcome>) -> Result<Made> {
        self.spare_captures(path)?;
        let target = &self.lights[TARGET];
        let (_, relit) = self.relit(&self.scene, target, Part::Whole)?;
        handle_step(handle, 0, 1)?;
        if self.is_composed {
            let stored = relit.stored_as(self.cloud.sh_degree, Encoding::Stored);
            write_splat(&self.cloud, &stored, path)?;
        } else {
            write_relit(&self.file, &self.cloud, &relit.stored(&self.cloud), path)?;
        }
        Ok(Made::Files(vec![path.to_owned()]))
    }
}

/// The progress of one of so many pictures, as all of theirs.
pub(super) fn step(
    handle: &Handle<Outcome>,
    done: usize,
    of: usize,
) -> impl Fn(f64) -> ControlFlow<()> + Sync {
    move |share| handle.progress((done as f64 + share) / of as f64)
}

pub(super) fn handle_step(handle: &Handle<Outcome>, done: usize, of: usize) -> Result<()> {
    if handle.progress(done as f64 / of as f64).is_break() {
        bail!("cancelled");
    }
    Ok(())
}
