//! Drags in the viewport. What a drag does is decided where the button goes down, and stays that up to the release; each event counts with
//! its own place and keys, however many of them lie between two frames.

use eframe::egui::{Event, Modifiers, PointerButton, Pos2};
use glam::Vec2;
use serde::{Deserialize, Serialize};

/// Effect of a drag.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Gesture {
    Orbit,
    Pan,
    Zoom,
    LookAround,
    TurnLight,
    /// Moves nothing: a click selects.
    Select,
    /// Ends a transform that followed the pointer.
    EndTransform,
    /// Moves the line between before and after.
    Wipe,
    /// Pulls one of the selected object's handles.
    Handle,
    /// Pulls a handle of a light.
    LightHandle,
    /// Places a light by what it does on the object.
    Place,
}

/// Buttons and keys of the camera, as in another program.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum NavigationPreset {
    #[default]
    Transplat,
    Blender,
    Maya,
    SuperSplat,
}

impl NavigationPreset {
    /// Each with its name.
    pub const ALL: [(&str, Self); 4] = [
        ("transplat", Self::Transplat),
        ("Blender", Self::Blender),
        ("Maya", Self::Maya),
        ("SuperSplat", Self::SuperSplat),
    ];

    /// Gesture of the camera or the light that a press begins; none where it selects, or drags what is there.
    pub fn gesture(self, press: &Press) -> Option<Gesture> {
        use PointerButton::{Middle, Primary, Secondary};
        let Modifiers { shift, alt, .. } = press.modifiers;
        let ctrl = press.modifiers.ctrl || press.modifiers.command;
        if press.button == Secondary && shift {
            return Some(Gesture::TurnLight);
        }
        Some(match (self, press.button) {
            (Self::Transplat, Middle) => Gesture::Pan,
            (Self::Transplat, Primary) if shift => Gesture::Pan,
            (Self::Blender, Middle) if shift => Gesture::Pan,
            (Self::Blender, Middle) if ctrl => Gesture::Zoom,
            (Self::Blender, Middle) => Gesture::Orbit,
            (Self::Maya, Primary) if alt => Gesture::Orbit,
            (Self::Maya, Middle) => Gesture::Pan,
            (Self::Maya, Secondary) if alt => Gesture::Zoom,
            (Self::SuperSplat, Middle) => Gesture::Zoom,
            (Self::SuperSplat, Secondary) => Gesture::Pan,
            (_, Secondary) => Gesture::LookAround,
            _ => return None,
        })
    }

    /// Gesture of the primary button on nothing that can be dragged.
    pub fn on_nothing(self) -> Gesture {
        match self {
            Self::Transplat | Self::SuperSplat => Gesture::Orbit,
            Self::Blender | Self::Maya => Gesture::Select,
        }
    }
}

/// Points from where the button went down within which it is a click.
const CLICK_REACH: f32 = 6.0;

/// A button that is held.
#[derive(Clone, Copy, Debug)]
struct HeldButton {
    gesture: Gesture,
    button: PointerButton,
    from: Pos2,
    /// Up to where it was followed.
    at: Pos2,
    is_drag: bool,
}

/// A piece of a drag.
#[derive(Clone, Copy, Debug)]
pub struct DragStep {
    pub gesture: Gesture,
    /// Where the button went down.
    pub pressed_at: Pos2,
    pub from: Pos2,
    pub to: Pos2,
    pub modifiers: Modifiers,
}

impl DragStep {
    /// Distance of the drag, in points.
    pub fn by(&self) -> Vec2 {
        Vec2::new(self.to.x - self.from.x, self.to.y - self.from.y)
    }
}

/// A button that goes down.
#[derive(Clone, Copy, Debug)]
pub struct Press {
    pub at: Pos2,
    pub button: PointerButton,
    pub modifiers: Modifiers,
}

/// The drag that is under way.
#[derive(Default)]
pub struct Gestures {
    held: Option<HeldButton>,
    modifiers: Modifiers,
}

impl Gestures {
    /// Gesture of the button that is held.
    pub fn held(&self) -> Option<Gesture> {
        self.held.map(|held| held.gesture)
    }

    /// The press that an event is, where no other button is held.
    pub fn press(&self, event: &Event) -> Option<Press> {
        match *event {
            Event::PointerButton {
                pos,
                button,
                pressed: true,
                modifiers,
            } if self.held.is_none() => Some(Press {
                at: pos,
                button,
                modifiers,
            }),
            _ => None,
        }
    }

    /// Takes hold.
    pub fn begin(&mut self, gesture: Gesture, press: Press) {
        self.modifiers = press.modifiers;
        self.held = Some(HeldButton {
            gesture,
            button: press.button,
            from: press.at,
            at: press.at,
            is_drag: false,
        });
    }

    /// Follows an event; what it moves, if anything.
    pub fn follow(&mut self, event: &Event) -> Option<DragStep> {
        match *event {
            Event::ModifiersChanged(modifiers) => {
                self.modifiers = modifiers;
                None
            }
            Event::PointerMoved(to) => self.step(to),
            Event::PointerButton {
                pos,
                button,
                pressed: false,
                modifiers,
            } if self.held.is_some_and(|held| held.button == button) => {
                self.modifiers = modifiers;
                let last = self.step(pos);
                self.held = None;
                last
            }
            Event::WindowFocused(false) => {
                self.held = None;
                None
            }
            _ => None,
        }
    }

    /// Lets go of what is held by another button than those that are still down: the release was not told.
    pub fn hold_only(&mut self, is_down: impl Fn(PointerButton) -> bool) {
        self.held.take_if(|held| !is_down(held.button));
    }

    fn step(&mut self, to: Pos2) -> Option<DragStep> {
        let held = self.held.as_mut()?;
        held.is_drag |= to.distance(held.from) > CLICK_REACH;
        if !held.is_drag {
            return None;
        }
        let from = std::mem::replace(&mut held.at, to);
        Some(DragStep {
            gesture: held.gesture,
            pressed_at: held.from,
            from,
            to,
            modifiers: self.modifiers,
        })
    }
}

#[cfg(test)]
mod tests {
    use eframe::egui::pos2;

    use super::*;

    fn button(button: PointerButton, at: Pos2, pressed: bool, modifiers: Modifiers) -> Event {
        Event::PointerButton {
            pos: at,
            button,
            pressed,
            modifiers,
        }
    }

    fn steps(gestures: &mut Gestures, events: &[Event]) -> Vec<DragStep> {
        let mut steps = Vec::new();
        for event in events {
            if let Some(press) = gestures.press(event) {
                gestures.begin(Gesture::Orbit, press);
            } else {
                steps.extend(gestures.follow(event));
            }
        }
        steps
    }

    #[test]
    fn presets_orbit_pan_and_zoom_as_the_program_that_they_are_named_after() {
        use PointerButton::{Middle, Primary, Secondary};
        let [none, alt, ctrl, shift] = [
            Modifiers::NONE,
            Modifiers::ALT,
            Modifiers::CTRL,
            Modifiers::SHIFT,
        ];
        let gesture = |preset: NavigationPreset, button, modifiers| {
            let at = pos2(0.0, 0.0);
            let press = Press {
                at,
                button,
                modifiers,
            };
            preset.gesture(&press).unwrap_or(preset.on_nothing())
        };
        use NavigationPreset::{Blender, Maya, SuperSplat, Transplat};
        for (preset, orbit, pan, zoom) in [
            (Transplat, (Primary, none), (Middle, none), None),
            (
                Blender,
                (Middle, none),
                (Middle, shift),
                Some((Middle, ctrl)),
            ),
            (Maya, (Primary, alt), (Middle, alt), Some((Secondary, alt))),
            (
                SuperSplat,
                (Primary, none),
                (Secondary, none),
                Some((Middle, none)),
            ),
        ] {
            assert_eq!(gesture(preset, orbit.0, orbit.1), Gesture::Orbit);
            assert_eq!(gesture(preset, pan.0, pan.1), Gesture::Pan);
            let zooms = zoom.is_none_or(|(b, m)| gesture(preset, b, m) == Gesture::Zoom);
            assert!(zooms, "{preset:?}");
            // The light is turned alike in all of them.
            assert_eq!(gesture(preset, Secondary, shift), Gesture::TurnLight);
        }
    }

    /// A whole drag in one go: all of it counts, and nothing after the release.
    #[test]
    fn a_drag_is_what_lies_between_press_and_release() {
        let (a, none) = (PointerButton::Primary, Modifiers::NONE);
        let mut gestures = Gestures::default();
        let events = [
            Event::PointerMoved(pos2(0.0, 0.0)),
            button(a, pos2(10.0, 10.0), true, none),
            Event::PointerMoved(pos2(12.0, 10.0)),
            Event::PointerMoved(pos2(40.0, 15.0)),
            // Another button, and a key: it stays what it was.
            button(PointerButton::Secondary, pos2(40.0, 15.0), true, none),
            button(PointerButton::Secondary, pos2(40.0, 15.0), false, none),
            Event::ModifiersChanged(Modifiers::SHIFT),
            button(a, pos2(70.0, 5.0), false, Modifiers::SHIFT),
            Event::PointerMoved(pos2(500.0, 500.0)),
        ];
        let made = steps(&mut gestures, &events);
        let by = made.iter().fold(Vec2::ZERO, |sum, step| sum + step.by());
        assert_eq!(by, Vec2::new(60.0, -5.0));
        assert!(
            made.iter()
                .all(|s| s.gesture == Gesture::Orbit && s.pressed_at == pos2(10.0, 10.0))
        );
        assert!(made[made.len() - 1].modifiers.shift && gestures.held().is_none());
    }

    #[test]
    fn a_click_moves_nothing_and_a_lost_release_ends() {
        let (a, none) = (PointerButton::Primary, Modifiers::NONE);
        let mut gestures = Gestures::default();
        let at = pos2(10.0, 10.0);
        let click = [
            button(a, at, true, none),
            Event::PointerMoved(pos2(13.0, 12.0)),
            button(a, pos2(13.0, 12.0), false, none),
        ];
        assert!(steps(&mut gestures, &click).is_empty());
        assert!(steps(&mut gestures, &click[..1]).is_empty() && gestures.held().is_some());
        gestures.hold_only(|_| false);
        assert!(gestures.held().is_none());
        steps(&mut gestures, &click[..1]);
        let gone = [
            Event::WindowFocused(false),
            Event::PointerMoved(pos2(90.0, 0.0)),
        ];
        assert!(steps(&mut gestures, &gone).is_empty());
    }
}
