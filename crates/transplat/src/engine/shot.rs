//! A project as its pictures show it: the studio that takes them, and what is around the objects in it.

use std::sync::Arc;

use anyhow::Result;
use transplat_core::environment::EnvironmentMap;
use transplat_core::present::{Background, View};
use transplat_core::surfels::SurfelCloud;

use crate::engine::device::Device;
use crate::engine::environments::load_map;
use crate::engine::picture::{Backdrop, Lit, Studio, lit_ground};
use crate::engine::project::{Project, SOURCE, TARGET};

/// Maps that are kept: a picture has two sides, and many lights are not to be held all at a time.
const KEPT: usize = 2;

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
                Some(at) => self.0[at].1.clone(),
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
