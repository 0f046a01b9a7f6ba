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
        tr_later("Exposure, tone mapping, background and transfer."),
    ),
    (
        Tab::Camera,
        Icon::Video,
        tr_later("Camera"),
        tr_later("View and lens."),
    ),
    (
        Tab::Asset,
        Icon::Box,
        tr_later("Objects"),
        tr_later("Objects of the scene, their transforms and filters."),
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
        tr_later("Run time, error and confidence."),
    ),
];
