//! The keyboard: one table, read by the program and shown to the user.

use eframe::egui::{Key, Modifiers};

use super::tabs::Tab;

/// What a key does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    Open,
    OpenFolder,
    SaveLook,
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
    Grid,
    Probes,
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
pub const SHORTCUTS: [(Modifiers, Key, Action, &str); 43] = [
    (CTRL, Key::O, Action::Open, "open files"),
    (
        CTRL_SHIFT,
        Key::O,
        Action::OpenFolder,
        "open a folder of environments",
    ),
    (CTRL, Key::S, Action::SaveLook, "save the look"),
    (CTRL, Key::E, Action::ExportSplat, "export the relit splat"),
    (NONE, Key::F12, Action::Screenshot, "save a picture"),
    (CTRL_SHIFT, Key::C, Action::Copy, "copy the picture"),
    (CTRL_SHIFT, Key::Z, Action::Redo, "redo"),
    (CTRL, Key::Z, Action::Undo, "undo"),
    (CTRL, Key::Y, Action::Redo, "redo"),
    (CTRL, Key::D, Action::Duplicate, "double the object"),
    (
        NONE,
        Key::Delete,
        Action::Remove,
        "take the object out of the scene",
    ),
    (NONE, Key::F, Action::Frame, "frame the object"),
    (
        NONE,
        Key::O,
        Action::Orthographic,
        "perspective or orthographic",
    ),
    (CTRL, Key::Num1, Action::Front, "look from the front"),
    (CTRL, Key::Num2, Action::Right, "look from the right"),
    (CTRL, Key::Num3, Action::Top, "look from the top"),
    (NONE, Key::C, Action::NextCompare, "next way to compare"),
    (
        NONE,
        Key::P,
        Action::Pin,
        "pin the look, to compare others with it",
    ),
    (
        NONE,
        Key::T,
        Action::SwapPinned,
        "the pinned look and this one, in turn",
    ),
    (CTRL, Key::B, Action::KeepView, "keep this view"),
    (NONE, Key::PageDown, Action::NextView, "next kept view"),
    (NONE, Key::PageUp, Action::LastView, "kept view before"),
    (CTRL, Key::PageDown, Action::NextLook, "next kept look"),
    (CTRL, Key::PageUp, Action::LastLook, "kept look before"),
    (NONE, Key::G, Action::Grid, "grid"),
    (NONE, Key::L, Action::Probes, "light probes"),
    (NONE, Key::K, Action::Marks, "mark doubtful surfels"),
    (
        NONE,
        Key::N,
        Action::Background,
        "environment or plain background",
    ),
    (NONE, Key::M, Action::Match, "match the lights' strength"),
    (NONE, Key::X, Action::Swap, "swap the two lights"),
    (NONE, Key::H, Action::Panels, "panels on and off"),
    (NONE, Key::F2, Action::Tab(Tab::Light), "the panel Light"),
    (NONE, Key::F3, Action::Tab(Tab::Look), "the panel Look"),
    (NONE, Key::F4, Action::Tab(Tab::Camera), "the panel Camera"),
    (NONE, Key::F5, Action::Tab(Tab::Asset), "the panel Asset"),
    (NONE, Key::F6, Action::Tab(Tab::Export), "the panel Export"),
    (NONE, Key::F7, Action::Tab(Tab::Report), "the panel Report"),
    (NONE, Key::F11, Action::FullScreen, "all of the screen"),
    (NONE, Key::F1, Action::Help, "this sheet"),
    (
        NONE,
        Key::ArrowLeft,
        Action::NudgeLeft,
        "turn the light 5° (shift: 1°)",
    ),
    (
        NONE,
        Key::ArrowRight,
        Action::NudgeRight,
        "turn the light back",
    ),
    (
        NONE,
        Key::ArrowUp,
        Action::NudgeUp,
        "tilt the light 5° (shift: 1°)",
    ),
    (
        NONE,
        Key::ArrowDown,
        Action::NudgeDown,
        "tilt the light back",
    ),
];

const NONE: Modifiers = Modifiers::NONE;
const CTRL: Modifiers = Modifiers::CTRL;
const CTRL_SHIFT: Modifiers = Modifiers::CTRL.plus(Modifiers::SHIFT);

/// Keys that nudge; with shift they do it finely.
pub const ARROWS: [Key; 4] = [
    Key::ArrowLeft,
    Key::ArrowRight,
    Key::ArrowUp,
    Key::ArrowDown,
];

/// What the mouse and held keys do, for the sheet.
pub const GESTURES: [(&str, &str); 16] = [
    ("left drag", "orbit"),
    ("middle drag, shift + left drag", "pan"),
    ("wheel", "zoom to the pointer"),
    ("right drag", "look around; with W A S D Q E fly"),
    ("shift + right drag", "turn and tilt the target light"),
    ("click", "select an object; inspect a surfel"),
    (
        "drag a handle",
        "move, turn, scale the object (ctrl: in steps)",
    ),
    ("double click", "turn about this point of the surface"),
    (
        "shift + double click",
        "turn the light so that its highlight is there",
    ),
    ("drag a ball or the light's map", "turn the light"),
    ("double click on a slider", "back to the default"),
    ("drag the wipe's line", "move the split"),
    ("hold B", "before"),
    ("1 to 9", "relight by this light of the shelf"),
    ("ctrl + / ctrl -", "larger and smaller text"),
    ("?", "this sheet"),
];

/// A shortcut as text.
pub fn name(modifiers: Modifiers, key: Key) -> String {
    let mut out = String::new();
    if modifiers.ctrl {
        out += "ctrl + ";
    }
    if modifiers.shift {
        out += "shift + ";
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
