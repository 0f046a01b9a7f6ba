//! Export of the light that a scene shows at one of its objects: what the command `probe` writes.

use std::path::{Path, PathBuf};

use anyhow::{Context as _, Result};
use glam::Vec3;
use transplat_core::environment::EnvironmentMap;
use transplat_core::files::write_environment;
use transplat_core::probe::{Beyond, DEFAULT_ROWS, RadianceToward};

use super::session::{Event, Session};
use transplat_engine::environments::load_map;
use transplat_engine::jobs::Kind;
use transplat_engine::language::{tr, tr_format};
use transplat_engine::names::{as_file_name, name_of};
use transplat_engine::output::free_name;
use transplat_engine::render::light_at;
use transplat_engine::words::percent;

/// Share of the light that may come from where the capture is clipped before it is worth a word.
const CLIPPED: f64 = 0.05;

impl Session {
    /// Saves the light that the other objects show at the selected one, as they were captured and under the light of the first one's capture,
    /// and puts it on the shelf.
    pub fn save_light_here(&mut self, folder: &str) {
        let at = self.selected;
        let Some(asset) = self.asset() else {
            self.error(tr("There is nothing to preview yet."));
            return;
        };
        let object = self.object();
        let place = object.transform.scene_from_object();
        let place = place.transform_point3(asset.bounds.center);
        let hidden = self
            .project
            .shown()
            .flat_map(|(other, _, asset)| std::iter::repeat_n(other == at, asset.cloud.len()));
        let hidden: Vec<bool> = hidden.collect();
        let name = as_file_name(&format!("light_at_{}", name_of(object, &asset.path)));
        let (source, settings) = (
            &self.project.states[0].source.light,
            &self.project.scene.objects[0].source,
        );
        let (source, up) = (source.clone(), self.project.scene_up());
        let (turn, gain) = (settings.map_from_asset(up).as_mat3(), settings.gain());
        let (device, whole) = (self.project.device.clone(), self.project.whole());
        let folder = PathBuf::from(folder);
        let label = tr_format!("rendering a probe at {}", asset.name());
        let work = move |_: &_| -> Result<_> {
            let map: EnvironmentMap = (*load_map(&source)?).clone();
            let sky = |d: Vec3| {
                let radiance = map.sample(turn * d);
                std::array::from_fn(|c| gain[c] * radiance[c])
            };
            let cloud = whole.cloud().context(tr("No object is visible."))?;
            let (painter, _) = device.fastest().painter(&cloud)?;
            let beyond = Beyond {
                environment: Some(&sky as RadianceToward<'_>),
                ..Beyond::default()
            };
            let seen = (&cloud, &painter, &hidden[..]);
            let probe = light_at(seen, (place, DEFAULT_ROWS), beyond)?;
            std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
            let path = free_name(Path::new(&folder), &name, "exr");
            write_environment(&path, &probe.map)?;
            Ok((path, probe.clipped_light))
        };
        self.start(Kind::Export, label, work, |session, (path, clipped)| {
            session.info(tr_format!("Saved {} and added it to the library.", path.display()));
            if clipped > CLIPPED {
                session.info(tr_format!(
                    "{} of this light is clipped at white. transplat probe --clipped-like restores some of it.",
                    percent(clipped)));
            }
            session.events.push(Event::Light(path));
        });
    }
}
