//! Tabs of the panel, and their names.

use lucide_icons::Icon;
use serde::{Deserialize, Serialize};
use transplat_engine::language::tr_later;

/// Subject of the panel.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Tab {
    #[default]
    Light,
    Look,
    Camera,
    Asset,
    Export,
    Report,
}

/// Page of the panel Light.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum LightPage {
    #[default]
    RelitBy,
    /// Lights of one's own.
    Lights,
    CapturedUnder,
}

/// Tab, icon, name, what it has.
pub const TABS: [(Tab, Icon, &str, &str); 6] = [
    (
        Tab::Light,
        Icon::Sun,
        tr_later("Light"),
        tr_later("New light, placed lights, and capture light."),
    ),
    (
        Tab::Look,
        Icon::Aperture,
        tr_later("Look"),
        tr_later("Exposure, tones, background, and how it is relit."),
    ),
    (
        Tab::Camera,
        Icon::Video,
        tr_later("Camera"),
        tr_later("Where it is seen from."),
    ),
    (
        Tab::Asset,
        Icon::Box,
        tr_later("Asset"),
        tr_later("The splats of the scene, where they stand, and what of them is hidden."),
    ),
    (
        Tab::Export,
        Icon::ImageDown,
        tr_later("Export"),
        tr_later("Images, turntables and the relit splat."),
    ),
    (
        Tab::Report,
        Icon::Gauge,
        tr_later("Report"),
        tr_later("What relighting costs, and how far it can be trusted."),
    ),
];
