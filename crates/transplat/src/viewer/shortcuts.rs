//! Keyboard shortcuts: one table, read by the program and shown to the user.

use eframe::egui::{Key, Modifiers};

use super::gestures::NavigationPreset;
use super::gizmo::KeyedTransform;
use super::tabs::Tab;
use transplat_engine::language::{tr, tr_later};

/// Action of a key.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    New,
    Open,
    OpenFolder,
    Save,
    SaveAs,
    ExportSplat,
    Screenshot,
    Copy,
    Undo,
    Redo,
    Duplicate,
    Remove,
    Frame,
    Orthographic,
    Front,
    Right,
    Top,
    NextCompare,
    Pin,
    SwapPinned,
    KeepView,
    NextView,
    LastView,
    NextLook,
    LastLook,
    Transform(KeyedTransform),
    Grid,
    Probes,
    Timeline,
    Marks,
    Background,
    Match,
    Swap,
    Panels,
    Tab(Tab),
    FullScreen,
    Help,
    NudgeLeft,
    NudgeRight,
    NudgeUp,
    NudgeDown,
}

/// Key, modifiers, action, and what is said of it.
pub const SHORTCUTS: [(Modifiers, Key, Action, &str); 49] = [
    (CTRL, Key::N, Action::New, tr_later("new scene")),
    (CTRL, Key::O, Action::Open, tr_later("open files")),
    (
        CTRL_SHIFT,
        Key::O,
        Action::OpenFolder,
        tr_later("open a folder of environments"),
    ),
    (CTRL, Key::S, Action::Save, tr_later("save")),
    (CTRL_SHIFT, Key::S, Action::SaveAs, tr_later("save as")),
    (
        CTRL,
        Key::E,
        Action::ExportSplat,
        tr_later("export the relit splat"),
    ),
    (
        NONE,
        Key::F12,
        Action::Screenshot,
        tr_later("save an image"),
    ),
    (CTRL_SHIFT, Key::C, Action::Copy, tr_later("copy the image")),
    (CTRL_SHIFT, Key::Z, Action::Redo, tr_later("redo")),
    (CTRL, Key::Z, Action::Undo, tr_later("undo")),
    (CTRL, Key::Y, Action::Redo, tr_later("redo")),
    (
        CTRL,
        Key::D,
        Action::Duplicate,
        tr_later("duplicate the object"),
    ),
    (
        NONE,
        Key::Delete,
        Action::Remove,
        tr_later("remove the object"),
    ),
    (NONE, Key::F, Action::Frame, tr_later("frame the object")),
    (
        NONE,
        Key::O,
        Action::Orthographic,
        tr_later("perspective or orthographic"),
    ),
    (CTRL, Key::Num1, Action::Front, tr_later("front view")),
    (CTRL, Key::Num2, Action::Right, tr_later("right view")),
    (CTRL, Key::Num3, Action::Top, tr_later("top view")),
    (
        NONE,
        Key::C,
        Action::NextCompare,
        tr_later("next comparison"),
    ),
    (NONE, Key::P, Action::Pin, tr_later("pin the look")),
    (
        NONE,
        Key::T,
        Action::SwapPinned,
        tr_later("swap with the pinned look"),
    ),
    (CTRL, Key::B, Action::KeepView, tr_later("save the view")),
    (
        NONE,
        Key::PageDown,
        Action::NextView,
        tr_later("next saved view"),
    ),
    (
        NONE,
        Key::PageUp,
        Action::LastView,
        tr_later("previous saved view"),
    ),
    (
        CTRL,
        Key::PageDown,
        Action::NextLook,
        tr_later("next saved look"),
    ),
    (
        CTRL,
        Key::PageUp,
        Action::LastLook,
        tr_later("previous saved look"),
    ),
    (
        NONE,
        Key::G,
        Action::Transform(KeyedTransform::Move),
        tr_later("move the object (X, Y, Z: along an axis)"),
    ),
    (
        NONE,
        Key::R,
        Action::Transform(KeyedTransform::Rotate),
        tr_later("rotate the object"),
    ),
    (
        NONE,
        Key::S,
        Action::Transform(KeyedTransform::Scale),
        tr_later("scale the object"),
    ),
    (SHIFT, Key::G, Action::Grid, tr_later("grid")),
    (NONE, Key::L, Action::Probes, tr_later("reference balls")),
    (NONE, Key::J, Action::Timeline, tr_later("timeline")),
    (NONE, Key::K, Action::Marks, tr_later("mark low confidence")),
    (
        NONE,
        Key::N,
        Action::Background,
        tr_later("environment or plain background"),
    ),
    (NONE, Key::M, Action::Match, tr_later("match exposure")),
    (
        CTRL_SHIFT,
        Key::X,
        Action::Swap,
        tr_later("swap the two lights"),
    ),
    (NONE, Key::H, Action::Panels, tr_later("panels")),
    (
        NONE,
        Key::F2,
        Action::Tab(Tab::Light),
        tr_later("the panel Light"),
    ),
    (
        NONE,
        Key::F3,
        Action::Tab(Tab::Look),
        tr_later("the panel Look"),
    ),
    (
        NONE,
        Key::F4,
        Action::Tab(Tab::Camera),
        tr_later("the panel Camera"),
    ),
    (
        NONE,
        Key::F5,
        Action::Tab(Tab::Asset),
        tr_later("the panel Objects"),
    ),
    (
        NONE,
        Key::F6,
        Action::Tab(Tab::Export),
        tr_later("the panel Export"),
    ),
    (
        NONE,
        Key::F7,
        Action::Tab(Tab::Report),
        tr_later("the panel Report"),
    ),
    (NONE, Key::F11, Action::FullScreen, tr_later("full screen")),
    (NONE, Key::F1, Action::Help, tr_later("this sheet")),
    (
        NONE,
        Key::ArrowLeft,
        Action::NudgeLeft,
        tr_later("rotate the light 5° (shift: 1°)"),
    ),
    (
        NONE,
        Key::ArrowRight,
        Action::NudgeRight,
        tr_later("rotate the light back"),
    ),
    (
        NONE,
        Key::ArrowUp,
        Action::NudgeUp,
        tr_later("tilt the light 5° (shift: 1°)"),
    ),
    (
        NONE,
        Key::ArrowDown,
        Action::NudgeDown,
        tr_later("tilt the light back"),
    ),
];

const NONE: Modifiers = Modifiers::NONE;
const SHIFT: Modifiers = Modifiers::SHIFT;
const CTRL: Modifiers = Modifiers::CTRL;
const CTRL_SHIFT: Modifiers = Modifiers::CTRL.plus(Modifiers::SHIFT);

/// Keys that nudge; with shift they do it finely.
pub const ARROWS: [Key; 4] = [
    Key::ArrowLeft,
    Key::ArrowRight,
    Key::ArrowUp,
    Key::ArrowDown,
];

/// Gestures of the mouse and held keys, for the sheet.
pub const GESTURES: [(&str, &str); 14] = [
    (tr_later("wheel"), tr_later("zoom to the pointer")),
    (
        tr_later("shift + right drag"),
        tr_later("rotate and tilt the light"),
    ),
    (
        tr_later("click"),
        tr_later("select an object; inspect a Gaussian"),
    ),
    (
        tr_later("drag a handle"),
        tr_later("move, rotate, scale the object (ctrl: in steps)"),
    ),
    (tr_later("double click"), tr_later("orbit about this point")),
    (
        tr_later("shift + double click"),
        tr_later("bring the highlight there"),
    ),
    (
        tr_later("drag a ball or the light's map"),
        tr_later("rotate the light"),
    ),
    (
        tr_later("double-click on a name"),
        tr_later("back to the default"),
    ),
    (tr_later("drag the wipe's line"), tr_later("move the split")),
    (tr_later("hold B"), tr_later("before")),
    (
        tr_later("1 to 9"),
        tr_later("use this light of the library"),
    ),
    (
        tr_later("numpad"),
        tr_later("views, with Blender's navigation (lights: alt + 1 to 9)"),
    ),
    (
        tr_later("ctrl + / ctrl -"),
        tr_later("larger and smaller text"),
    ),
    ("?", tr_later("this sheet")),
];

/// Drags of the camera with a navigation preset.
pub fn camera_drags(preset: NavigationPreset) -> Vec<(&'static str, &'static str)> {
    let fly = (
        tr_later("right drag"),
        tr_later("look around; with W A S D Q E fly"),
    );
    match preset {
        NavigationPreset::Transplat => vec![
            (tr_later("left drag"), tr_later("orbit")),
            (tr_later("middle drag, shift + left drag"), tr_later("pan")),
            fly,
        ],
        NavigationPreset::Blender => vec![
            (tr_later("middle drag"), tr_later("orbit")),
            (tr_later("shift + middle drag"), tr_later("pan")),
            (tr_later("ctrl + middle drag"), tr_later("zoom")),
            fly,
        ],
        NavigationPreset::Maya => vec![
            (tr_later("alt + left drag"), tr_later("orbit")),
            (tr_later("middle drag"), tr_later("pan")),
            (tr_later("alt + right drag"), tr_later("zoom")),
            fly,
        ],
        NavigationPreset::SuperSplat => vec![
            (tr_later("left drag"), tr_later("orbit")),
            (tr_later("right drag"), tr_later("pan")),
            (tr_later("middle drag"), tr_later("zoom")),
        ],
    }
}

/// A shortcut as text.
pub fn name(modifiers: Modifiers, key: Key) -> String {
    let mut out = String::new();
    if modifiers.ctrl {
        out += tr("ctrl + ");
    }
    if modifiers.shift {
        out += tr("shift + ");
    }
    // The arrows' symbols are not in every font.
    out + if ARROWS.contains(&key) {
        key.name()
    } else {
        key.symbol_or_name()
    }
}

/// The shortcut of an action as text, for menus.
pub fn of(action: Action) -> String {
    SHORTCUTS
        .iter()
        .find(|(_, _, a, _)| *a == action)
        .map_or(String::new(), |(modifiers, key, ..)| name(*modifiers, *key))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_key_does_two_things() {
        for (i, a) in SHORTCUTS.iter().enumerate() {
            for b in &SHORTCUTS[i + 1..] {
                assert!((a.0, a.1) != (b.0, b.1), "{}", name(a.0, a.1));
            }
        }
    }
}
