//! Widgets that every panel uses: label, unit, tooltip, reset by double click.

use std::ops::RangeInclusive;

use eframe::egui::{self, PointerButton, Pos2, Rect, Response, Ui, Vec2};
use eframe::emath::Numeric;

use super::style::{NAME_WIDTH, NUMBER_WIDTH};
use transplat_engine::jobs::PROGRESS_INTERVAL;
use transplat_engine::language::{tr, tr_format};

/// Says that something is awaited: a dot goes round in the middle of a rectangle, as often as it is told how far jobs are; a picture of the window
/// for each frame would take from them.
pub fn waiting(ui: &Ui, rect: Rect) {
    let (dots, radius) = (8u32, 0.32 * rect.size().min_elem().min(24.0));
    let beat = ui.input(|i| i.time) / PROGRESS_INTERVAL.as_secs_f64();
    let lit = beat as u32 % dots;
    for dot in 0..dots {
        let turn = dot as f32 / dots as f32 * std::f32::consts::TAU;
        let color = if dot == lit {
            ui.visuals().strong_text_color()
        } else {
            ui.visuals().weak_text_color()
        };
        let place = rect.center() + radius * Vec2::angled(turn);
        ui.painter().circle_filled(place, 0.25 * radius, color);
    }
    ui.request_repaint_after(PROGRESS_INTERVAL);
}

/// Points that a slider's rail has at least.
const SHORTEST_RAIL: f32 = 40.0;

/// A slider.
pub struct Control<'a, T> {
    pub label: &'a str,
    pub unit: &'a str,
    pub tip: &'a str,
    pub range: RangeInclusive<T>,
    pub default: T,
    pub decimals: usize,
    pub logarithmic: bool,
}

impl<T: Numeric> Control<'_, T> {
    /// Without a name; of whole numbers.
    pub fn of(range: RangeInclusive<T>, default: T) -> Self {
        Self {
            label: "",
            unit: "",
            tip: "",
            range,
            default,
            decimals: 0,
            logarithmic: false,
        }
    }

    pub fn show(self, ui: &mut Ui, value: &mut T) -> Response {
        // Only what the user edits is rounded and held to the range: a look may say more than a slider shows.
        let mut shown = *value;
        let slider = egui::Slider::new(&mut shown, self.range)
            .suffix(self.unit)
            .max_decimals(self.decimals)
            .logarithmic(self.logarithmic)
            .update_while_editing(false)
            .custom_parser(parse)
            .clamping(egui::SliderClamping::Edits);
        let number = format!("{:.*}{}", self.decimals, value.to_f64(), self.unit);
        let row = ui.horizontal(|ui| {
            let label = name(ui, self.label);
            // A number that needs more room takes it from its rail: the panel would grow by it, and the rail with the panel.
            let spacing = ui.spacing();
            let needs = 2.0 * spacing.button_padding.x + width_of(ui, number);
            let (number, gap) = (needs.max(NUMBER_WIDTH), spacing.item_spacing.x);
            let rail = (ui.available_width() - gap - number).max(SHORTEST_RAIL);
            ui.spacing_mut().slider_width = rail;
            ui.spacing_mut().interact_size.x = number;
            ui.add(slider).labelled_by(label.id)
        });
        let response = row.inner;
        if response.changed() {
            *value = shown;
        }
        if is_double_clicked(ui, &row.response) {
            *value = self.default;
        }
        tip(response, self.tip)
    }
}

fn width_of(ui: &Ui, text: String) -> f32 {
    let galley = egui::WidgetText::from(text).into_galley(
        ui,
        Some(egui::TextWrapMode::Extend),
        f32::INFINITY,
        egui::TextStyle::Button,
    );
    galley.size().x
}

/// A slider's rail tells no double clicks itself.
fn is_double_clicked(ui: &Ui, response: &Response) -> bool {
    let double = ui.input(|i| i.pointer.button_double_clicked(PointerButton::Primary));
    double && response.contains_pointer()
}

/// Heading of a group of controls.
pub fn heading(ui: &mut Ui, text: &str) {
    ui.add_space(6.0);
    ui.strong(text);
}

/// A control's name before it.
pub fn name(ui: &mut Ui, text: &str) -> Response {
    let size = egui::vec2(NAME_WIDTH, ui.spacing().interact_size.y);
    let left = egui::Layout::left_to_right(egui::Align::Center);
    ui.allocate_ui_with_layout(size, left, |ui| {
        ui.set_min_width(NAME_WIDTH);
        ui.add(egui::Label::new(text).truncate().selectable(false))
    })
    .inner
}

/// The tooltip of a control that a double click resets.
fn tip(response: Response, text: &str) -> Response {
    response.on_hover_text(tr_format!(
        "{text}\n\nDouble-click the name to reset.",
        text = text
    ))
}

/// An angle in degrees that goes round.
pub fn angle(ui: &mut Ui, label: &str, tip: &str, value: &mut f64) -> Response {
    let before = super::navigation::wrap(*value);
    let mut shown = before;
    let response = Control {
        label,
        unit: "°",
        tip,
        decimals: 1,
        ..Control::of(-180.0..=180.0, 0.0)
    }
    .show(ui, &mut shown);
    // Shown alone it stays as a file has it.
    if shown != before {
        *value = shown;
    }
    response
}

/// A choice of few; a double click on its name takes the first of them, the default.
pub fn choice<T: PartialEq + Clone>(
    ui: &mut Ui,
    label: &str,
    text: &str,
    value: &mut T,
    options: &[(&str, T)],
) -> bool {
    let before = value.clone();
    let chosen = options.iter().find(|(_, v)| *v == before);
    let chosen = chosen.map_or("", |(name, _)| name);
    ui.horizontal(|ui| {
        let label = name(ui, label);
        if is_double_clicked(ui, &label) {
            *value = options[0].1.clone();
        }
        let list = egui::ComboBox::from_id_salt(label.id)
            .width(ui.available_width())
            .truncate()
            .selected_text(chosen)
            .show_ui(ui, |ui| {
                for (name, option) in options {
                    ui.selectable_value(value, option.clone(), *name);
                }
            });
        tip(list.response.labelled_by(label.id), text);
    });
    *value != before
}

/// A number that is dragged or typed: what is typed counts once it is whole, and is refused where it is no number of the range.
pub fn number<T: Numeric>(value: &mut T, range: RangeInclusive<T>) -> egui::DragValue<'_> {
    let (least, most) = (range.start().to_f64(), range.end().to_f64());
    egui::DragValue::new(value)
        .range(range)
        .update_while_editing(false)
        .custom_parser(move |text| parse(text).filter(|v| (least..=most).contains(v)))
}

/// A finite number as people write it, with a point or a comma.
fn parse(text: &str) -> Option<f64> {
    let text: String = text.chars().filter(|c| !c.is_whitespace()).collect();
    let text = text.replace('\u{2212}', "-").replace(',', ".");
    text.parse().ok().filter(|v: &f64| v.is_finite())
}

/// Folds away what is seldom wanted.
pub fn advanced<R>(ui: &mut Ui, contents: impl FnOnce(&mut Ui) -> R) {
    egui::CollapsingHeader::new(tr("Advanced")).show(ui, contents);
}

/// A drag of a widget: what it changes is what that was at the press, by all the way from there, however far a frame's first step is.
#[derive(Debug)]
pub struct Grab<T>(Option<(Pos2, T)>);

impl<T> Default for Grab<T> {
    fn default() -> Self {
        Self(None)
    }
}

impl<T: Copy> Grab<T> {
    /// Value at the press, and the pointer's distance from it; `now` is the value now.
    pub fn drag(&mut self, response: &Response, now: T) -> Option<(T, Vec2)> {
        let ends = response.drag_stopped();
        let at = response.interact_pointer_pos();
        let Some(at) = at.filter(|_| response.dragged() || ends) else {
            self.0 = None;
            return None;
        };
        let pressed_at = response.ctx.input(|i| i.pointer.press_origin());
        let (from, then) = (self.0).unwrap_or_else(|| (pressed_at.unwrap_or(at), now));
        self.0 = (!ends).then_some((from, then));
        Some((then, at - from))
    }
}

/// A button that says what it does; whether it was clicked.
pub fn button(ui: &mut Ui, name: &str, tip: &str) -> bool {
    ui.button(name).on_hover_text(tip).clicked()
}

/// An entry of a menu, which closes it.
pub fn entry(ui: &mut Ui, name: &str) -> bool {
    let clicked = ui.button(name).clicked();
    if clicked {
        ui.close();
    }
    clicked
}

/// Says what a widget is to who does not see it.
pub fn named(response: &Response, role: egui::Role, name: impl ToString) {
    response.widget_info(|| egui::WidgetInfo::labeled(role, true, name.to_string()));
}

/// A file's name, with the whole path for whoever points at it.
pub fn file(ui: &mut Ui, path: &std::path::Path) {
    let name = path.file_name().unwrap_or(path.as_os_str());
    ui.horizontal(|ui| {
        ui.weak(tr("file"));
        ui.add(egui::Label::new(name.to_string_lossy()).truncate())
            .on_hover_text(path.display().to_string());
    });
}

/// A line of a name and what is known of it.
pub fn fact(ui: &mut Ui, name: &str, value: impl Into<String>) {
    ui.horizontal_wrapped(|ui| {
        ui.weak(name);
        ui.label(value.into());
    });
}

/// `1234567` as `1,234,567`.
pub fn thousands(n: usize) -> String {
    let digits = n.to_string();
    let mut out = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            out.push(',');
        }
        out.push(digit);
    }
    out
}

#[cfg(test)]
mod tests {
    #[test]
    fn only_finite_numbers_are_taken() {
        let parsed = [
            " 0,5",
            "\u{2212}2",
            "1e3",
            "nan",
            "inf",
            "0.5+1",
            "1.0.0",
            "",
        ]
        .map(super::parse);
        let wanted = [
            Some(0.5),
            Some(-2.0),
            Some(1e3),
            None,
            None,
            None,
            None,
            None,
        ];
        assert_eq!(parsed, wanted);
    }

    #[test]
    fn large_numbers_are_grouped() {
        assert_eq!(super::thousands(30), "30");
        assert_eq!(super::thousands(1234567), "1,234,567");
        assert_eq!(super::thousands(100000), "100,000");
    }
}
