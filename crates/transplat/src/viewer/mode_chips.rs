//! Chips of the modes that hide something.

use eframe::egui;
use transplat_core::present::View;
use transplat_core::surfels::SurfelFilter;

use super::menus::CHANNELS;
use super::rigs::called;
use super::session::Session;
use transplat_engine::language::{tr, tr_format};

/// Button that turns a mode off.
struct ModeChip {
    name: String,
    turn_off: fn(&mut Session),
}

/// Shows modes that hide something, each with a button that turns it off, in a corner of the viewport.
pub fn show(context: &egui::Context, rect: egui::Rect, session: &mut Session) {
    let mut chips: Vec<ModeChip> = Vec::new();
    let mut add = |name, turn_off| chips.push(ModeChip { name, turn_off });
    let scene = &session.project.scene;
    if session.project.pose.aperture > 0.0 {
        let off = |s: &mut Session| s.project.pose.aperture = 0.0;
        add(tr("Depth of field").into(), off);
    }
    if let Some((name, ..)) = CHANNELS.iter().find(|(_, view, _)| *view == scene.view) {
        let off = |s: &mut Session| s.project.scene.view = View::After;
        add(tr(name).into(), off);
    }
    if scene.false_color {
        let off = |s: &mut Session| s.project.scene.false_color = false;
        add(tr("False colours").into(), off);
    }
    if let Some(light) = scene.lights.iter().find(|light| light.solo) {
        let off = |s: &mut Session| {
            (s.project.scene.lights.iter_mut()).for_each(|light| light.solo = false);
        };
        add(tr_format!("Solo: {name}", name = called(light)), off);
    }
    let hidden = scene.objects.iter().filter(|object| !object.shown).count();
    if hidden > 0 {
        let off = |s: &mut Session| {
            (s.project.scene.objects.iter_mut()).for_each(|object| object.shown = true);
        };
        let text = match hidden {
            1 => tr("1 hidden object").into(),
            n => tr_format!("{n} hidden objects", n = n),
        };
        add(text, off);
    }
    if !session.object().hide.is_off() {
        let off = |s: &mut Session| s.object_mut().hide = SurfelFilter::default();
        add(tr("Hidden Gaussians").into(), off);
    }
    if chips.is_empty() || session.asset().is_none() {
        return;
    }
    let mut chosen = None;
    egui::Area::new(egui::Id::unique("modes"))
        .fixed_pos(rect.left_top() + egui::vec2(10.0, 36.0))
        .order(egui::Order::Middle)
        .show(context, |ui| {
            ui.horizontal(|ui| {
                for ModeChip { name, turn_off } in chips {
                    let chip = egui::Button::new(format!("{name}  ×")).corner_radius(10.0);
                    let tip = tr("Turn off");
                    if ui.add(chip).on_hover_text(tip).clicked() {
                        chosen = Some(turn_off);
                    }
                }
            });
        });
    if let Some(turn_off) = chosen {
        turn_off(session);
    }
}
