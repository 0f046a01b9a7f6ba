//! The tabs of the panel, and how they are named.

use lucide_icons::Icon;
use serde::{Deserialize, Serialize};

/// What the panel is about.
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

/// Tab, icon, name, what it has.
pub const TABS: [(Tab, Icon, &str, &str); 6] = [
    (
        Tab::Light,
        Icon::Sun,
        "Light",
        "The light it is relit by, and the one that it was captured under.",
    ),
    (
        Tab::Look,
        Icon::Aperture,
        "Look",
        "Exposure, tones, background, and how it is relit.",
    ),
    (Tab::Camera, Icon::Video, "Camera", "Where it is seen from."),
    (
        Tab::Asset,
        Icon::Box,
        "Asset",
        "The splats of the scene, where they stand, and what of them is hidden.",
    ),
    (
        Tab::Export,
        Icon::ImageDown,
        "Export",
        "Pictures, turntables and the relit splat.",
    ),
    (
        Tab::Report,
        Icon::Gauge,
        "Report",
        "What it costs, and how far it can be trusted.",
    ),
];
