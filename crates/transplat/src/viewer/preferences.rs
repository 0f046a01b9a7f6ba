//! Preferences, saved from start to start.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use transplat_core::bake::harmonic::DEFAULT_DIRECTIONS;
use transplat_core::color::Display;
use transplat_core::present::Background;
use transplat_core::scene::Scene;
use transplat_core::settings::TransferSettings;

use super::export::task::ExportSettings;
use super::gestures::NavigationPreset;
use super::tabs::Tab;

/// Files that are remembered as recent.
const RECENT: usize = 12;

/// Kept from start to start. What belongs to one scene (lights' turns, camera, what is hidden) is kept in looks instead.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Preferences {
    /// Under a name of its own: what older programs kept has the harmonic method, the only one that they had.
    #[serde(rename = "transfer_2")]
    pub transfer: TransferSettings,
    pub display: Display,
    pub background: Background,
    pub background_blur: f32,
    pub match_strength: bool,
    pub grid: bool,
    pub probes: bool,
    /// Lights on the shelf in their order; none before the first start.
    #[serde(alias = "shelf")]
    pub light_library: Option<Vec<PathBuf>>,
    pub directions: usize,
    pub shadow_catcher: bool,
    pub recent: Vec<PathBuf>,
    /// True where bakes are saved beside their splats, not in the user's cache.
    pub bakes_beside: bool,
    pub navigation: NavigationPreset,
    pub export: ExportSettings,
    pub tab: Tab,
    pub knows_how_to_turn_the_light: bool,
    /// The name of a language; none is English.
    pub language: Option<String>,
}

impl Default for Preferences {
    fn default() -> Self {
        Self {
            transfer: TransferSettings::default(),
            display: Display::default(),
            background: Background::Environment,
            background_blur: 0.3,
            match_strength: false,
            grid: false,
            probes: true,
            light_library: None,
            directions: DEFAULT_DIRECTIONS,
            shadow_catcher: false,
            recent: Vec::new(),
            bakes_beside: false,
            navigation: NavigationPreset::default(),
            export: ExportSettings::default(),
            tab: Tab::default(),
            knows_how_to_turn_the_light: false,
            language: None,
        }
    }
}

impl Preferences {
    /// A look with the settings that are kept; settings that are out of range (an older program wrote them) fall back to the defaults.
    pub fn scene(&self) -> Scene {
        let scene = Scene {
            transfer: self.transfer.clone(),
            display: self.display,
            background: self.background,
            background_blur: self.background_blur,
            match_strength: self.match_strength,
            directions: self.directions,
            shadow_catcher: self.shadow_catcher,
            ..Scene::default()
        };
        if scene.validate().is_ok() {
            scene
        } else {
            Self::default().scene()
        }
    }

    /// Takes over what is kept of a look.
    pub fn keep(&mut self, scene: &Scene) {
        self.transfer = scene.transfer.clone();
        self.display = scene.display;
        // A photograph belongs to its scene.
        if scene.background != Background::Backplate {
            self.background = scene.background;
        }
        self.background_blur = scene.background_blur;
        self.match_strength = scene.match_strength;
        self.directions = scene.directions;
        self.shadow_catcher = scene.shadow_catcher;
    }

    /// Puts a file first among the recent ones.
    pub fn remember(&mut self, path: &Path) {
        self.recent.retain(|p| p != path);
        self.recent.insert(0, path.to_owned());
        self.recent.truncate(RECENT);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_kept_comes_back_and_what_is_wrong_does_not() {
        let mut preferences = Preferences::default();
        let mut scene = preferences.scene();
        scene.transfer.sh_degree = 5;
        scene.display.exposure = 1.5;
        preferences.keep(&scene);
        let text = serde_json::to_string(&preferences).expect("plain data");
        let back: Preferences = serde_json::from_str(&text).expect("its own text");
        assert_eq!(back.scene(), scene);
        preferences.transfer.sh_degree = 99;
        assert_eq!(preferences.scene(), Preferences::default().scene());
    }

    #[test]
    fn recent_files_are_few_and_each_is_there_once() {
        let mut preferences = Preferences::default();
        for i in 0..40 {
            preferences.remember(Path::new(&format!("{}.ply", i % 15)));
        }
        assert_eq!(preferences.recent.len(), RECENT);
        assert_eq!(preferences.recent[0], Path::new("9.ply"));
    }
}
