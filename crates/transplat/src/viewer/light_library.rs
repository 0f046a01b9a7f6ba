//! Light library (the shelf): the two slots, and pages of lights, saved looks and saved views.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use eframe::egui::{self, Align2, Color32, Rect, Sense, TextureHandle, Ui};
use transplat_core::scene::is_even;

use super::bookmarks::Thumbnails;
use super::probes::thumbnail;
use super::session::{SIDES, Session};
use super::thumbnail::{NAME_HEIGHT, THUMBNAIL, add_button, paint_thumbnail};
use super::widgets::{entry, named, waiting};
use transplat_engine::environments::{Environment, light_name};
use transplat_engine::language::{tr, tr_format};
use transplat_engine::project::{SOURCE, TARGET};

/// Pixels across a thumbnail.
const THUMBNAIL_PIXELS: usize = 224;

/// The shelf's height in points.
pub const HEIGHT: f32 = 104.0;

/// Width of the list of pages in points.
const PAGES_WIDTH: f32 = 64.0;

/// Page of the shelf beside the slots.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum LibraryPage {
    #[default]
    Lights,
    Looks,
    Views,
}

/// State of the shelf.
#[derive(Default)]
pub struct LightLibrary {
    pub paths: Vec<PathBuf>,
    /// Lights that were here and are not to be found now.
    pub absent: Vec<PathBuf>,
    thumbnails: HashMap<u64, TextureHandle>,
    /// Where the slots are in the window, for what is dropped on them.
    pub slots: [Option<Rect>; 2],
    /// The clicked "add" asks for files.
    pub wants_files: bool,
    /// Files that are the same as one on the shelf, and which.
    twins: HashMap<PathBuf, PathBuf>,
    /// The one that was last brought into view.
    shown: Option<PathBuf>,
    page: LibraryPage,
}

/// A light that is dragged along the shelf or onto a slot.
#[derive(Clone)]
struct Dragged(PathBuf);

impl LightLibrary {
    /// Puts a light on the shelf, unless it is there, under whatever path.
    pub fn add(&mut self, session: &mut Session, path: &Path) {
        if !self.paths.iter().any(|p| p == path) {
            match self.paths.iter().find(|p| is_copy(p, path)) {
                Some(twin) => {
                    self.twins.insert(path.to_owned(), twin.clone());
                }
                None => self.paths.push(path.to_owned()),
            }
        }
        session.project.environments.request(path);
    }

    /// The light on the shelf that a file is.
    fn listed<'a>(&'a self, path: &'a Path) -> &'a Path {
        self.twins.get(path).map_or(path, PathBuf::as_path)
    }

    /// A light that could not be read leaves the shelf.
    pub fn forget(&mut self, path: &Path) {
        self.paths.retain(|p| p != path);
        self.twins.retain(|_, twin| twin != path);
    }

    fn texture(&mut self, ui: &Ui, light: &Environment) -> TextureHandle {
        let new = || thumbnail(ui.ctx(), light, THUMBNAIL_PIXELS);
        self.thumbnails.entry(light.id).or_insert_with(new).clone()
    }

    pub fn show(&mut self, ui: &mut Ui, session: &mut Session, kept: &Thumbnails) {
        ui.horizontal_top(|ui| {
            self.slot(ui, session, SOURCE);
            ui.vertical(|ui| {
                ui.add_space(26.0);
                let swap = ui
                    .button(tr("swap"))
                    .on_hover_text(tr("Swaps new light and capture light. (ctrl + shift + X)"));
                named(&swap, egui::Role::Button, tr("Swap lights"));
                if swap.clicked() {
                    session.swap_lights();
                }
            });
            self.slot(ui, session, TARGET);
            ui.separator();
            self.pages(ui, session);
            let scroll = egui::ScrollArea::horizontal().id_salt(self.page as usize);
            scroll.auto_shrink([false, false]).show(ui, |ui| {
                ui.horizontal_top(|ui| {
                    // For the frame of the first.
                    ui.add_space(3.0);
                    match self.page {
                        LibraryPage::Looks => return kept.looks(ui, session),
                        LibraryPage::Views => return kept.views(ui, session),
                        LibraryPage::Lights => {}
                    }
                    for i in 0..self.paths.len() {
                        if i >= self.paths.len() {
                            break;
                        }
                        self.entry(ui, session, i);
                    }
                    self.add_button(ui);
                });
            });
        });
        self.draw_dragged(ui, session);
    }

    fn pages(&mut self, ui: &mut Ui, session: &Session) {
        let count = |n: usize| {
            if n == 0 {
                String::new()
            } else {
                format!(" {n}")
            }
        };
        let (looks, views) = (
            &session.project.scene.variants,
            &session.project.scene.bookmarks,
        );
        ui.vertical(|ui| {
            ui.set_width(PAGES_WIDTH);
            ui.add_space(NAME_HEIGHT);
            for (page, name, tip) in [
                (
                    LibraryPage::Lights,
                    tr("Lights").to_owned(),
                    tr("Environments to relight by."),
                ),
                (
                    LibraryPage::Looks,
                    tr_format!("Looks{}", count(looks.len())),
                    tr("Saved looks: light and display settings to return to and to compare."),
                ),
                (
                    LibraryPage::Views,
                    tr_format!("Views{}", count(views.len())),
                    tr("Saved views."),
                ),
            ] {
                ui.selectable_value(&mut self.page, page, name)
                    .on_hover_text(tip);
            }
        });
    }

    /// Draws a dragged light under the pointer.
    fn draw_dragged(&mut self, ui: &Ui, session: &Session) {
        let dragged = egui::DragAndDrop::payload::<Dragged>(ui.ctx());
        let pointer = ui.ctx().pointer_latest_pos();
        let (Some(dragged), Some(pointer)) = (dragged, pointer) else {
            return;
        };
        let Some(light) = session.project.environments.get(&dragged.0).cloned() else {
            return;
        };
        let texture = self.texture(ui, &light);
        let layer = egui::LayerId::new(egui::Order::Tooltip, egui::Id::unique("dragged light"));
        let rect = Rect::from_center_size(pointer, 0.75 * THUMBNAIL);
        let uv = Rect::from_min_max(egui::pos2(0.0, 0.0), egui::pos2(1.0, 1.0));
        let painter = ui.ctx().layer_painter(layer);
        painter.image(texture.id(), rect, uv, Color32::from_white_alpha(200));
    }

    fn slot(&mut self, ui: &mut Ui, session: &mut Session, side: usize) {
        let light = session.light(side).clone();
        let settings = session.side(side);
        let wanted = settings.file.clone().unwrap_or_else(|| light.path.clone());
        ui.vertical(|ui| {
            ui.set_width(THUMBNAIL.x);
            ui.label(egui::RichText::new(tr(SIDES[side])).small().strong());
            let (rect, response) = ui.allocate_exact_size(THUMBNAIL, Sense::click());
            self.slots[side] = Some(rect);
            let name = if side == SOURCE && light.is_even {
                if session.is_loading(&wanted) {
                    tr("estimating").to_owned()
                } else {
                    match is_even(&light.path) {
                        true => tr("uniform white (assumed)").to_owned(),
                        false => tr("unknown").to_owned(),
                    }
                }
            } else {
                light.name()
            };
            named(
                &response,
                egui::Role::Button,
                format!("{}: {name}", tr(SIDES[side])),
            );
            let texture = Some(self.texture(ui, &light));
            paint_thumbnail(
                ui,
                rect,
                texture.as_ref(),
                false,
                response.contains_pointer(),
            );
            if session.is_loading(&wanted) {
                waiting(ui, rect);
            }
            ui.add(egui::Label::new(egui::RichText::new(&name).small()).truncate());
            let tip = if side == SOURCE {
                tr("Light of the capture. Drop its environment here, or drag it from the library.")
            } else {
                tr("Light to relight by. Drop an environment here, or click one in the library.")
            };
            let response = response.on_hover_text(format!("{name}\n\n{tip}"));
            if let Some(dragged) = response.dnd_release_payload::<Dragged>() {
                session.set_light(side, dragged.0.clone());
            }
            response.context_menu(|ui| {
                if entry(ui, tr("Uniform white")) {
                    session.set_light(side, transplat_core::scene::EVEN.into());
                }
                if side == SOURCE && entry(ui, tr("Estimate from the object")) {
                    session.ask_for_estimate();
                }
                if light.is_file() && entry(ui, tr("Add to library")) {
                    self.add(session, &light.path);
                }
            });
        });
    }

    fn entry(&mut self, ui: &mut Ui, session: &mut Session, index: usize) {
        let path = self.paths[index].clone();
        let name = light_name(&path);
        let target = session.light(TARGET).path.clone();
        let selected = self.listed(&target) == path;
        let mut removed = false;
        ui.vertical(|ui| {
            ui.set_width(THUMBNAIL.x);
            ui.add_space(NAME_HEIGHT);
            let (rect, response) = ui.allocate_exact_size(THUMBNAIL, Sense::click_and_drag());
            named(&response, egui::Role::Button, tr_format!("Environment {name}", name = name));
            if selected && self.shown.as_ref() != Some(&path) {
                response.scroll_to_me(None);
                self.shown = Some(path.clone());
            }
            let light = session.project.environments.get(&path).cloned();
            let texture = light.map(|light| self.texture(ui, &light));
            paint_thumbnail(ui, rect, texture.as_ref(), selected, response.hovered());
            if session.is_loading(&path) {
                waiting(ui, rect);
            }
            if index < 9 {
                let badge = rect.left_top() + egui::vec2(10.0, 9.0);
                ui.painter().circle_filled(badge, 8.0, Color32::from_black_alpha(150));
                let font = egui::FontId::proportional(11.0);
                ui.painter().text(badge, Align2::CENTER_CENTER, index + 1, font, Color32::WHITE);
            }
            ui.add(egui::Label::new(egui::RichText::new(&name).small()).truncate());
            response.dnd_set_drag_payload(Dragged(path.clone()));
            if let Some(dragged) = response.dnd_release_payload::<Dragged>() {
                self.paths.retain(|p| *p != dragged.0);
                let at = index.min(self.paths.len());
                self.paths.insert(at, dragged.0.clone());
            }
            let tip = match session.project.environments.get(&path) {
                Some(light) => tr_format!(
                    "{}\n{} x {} pixels\nClick: use as new light. Drag: onto a slot, or to reorder. Right-click: more.",
                    path.display(),
                    light.size[0],
                    light.size[1]),
                None => path.display().to_string(),
            };
            let response = response.on_hover_text(tip);
            if response.clicked() {
                session.set_light(TARGET, path.clone());
            }
            response.context_menu(|ui| {
                if entry(ui, tr("Use as new light")) {
                    session.set_light(TARGET, path.clone());
                }
                if entry(ui, tr("Use as capture light")) {
                    session.set_light(SOURCE, path.clone());
                }
                if index > 0 && entry(ui, tr("Move left")) {
                    self.paths.swap(index, index - 1);
                }
                if index + 1 < self.paths.len() && entry(ui, tr("Move right")) {
                    self.paths.swap(index, index + 1);
                }
                removed |= entry(ui, tr("Remove from library"));
            });
        });
        if removed {
            self.forget(&path);
        }
    }

    fn add_button(&mut self, ui: &mut Ui) {
        let response = add_button(ui, tr("Add environments")).on_hover_text(tr(
            "Adds environments: .hdr, .exr or images. Files and folders can be dropped on the window, too.",
        ));
        self.wants_files |= response.clicked();
    }
}

/// True for a file that is a copy of another of its name.
fn is_copy(a: &Path, b: &Path) -> bool {
    let length = |path: &Path| path.metadata().map(|m| m.len()).ok();
    let is_alike = a.file_name() == b.file_name() && length(a).is_some() && length(a) == length(b);
    is_alike && std::fs::read(a).ok() == std::fs::read(b).ok()
}
