//! How the window looks: what of egui's style is changed, for both themes.

use eframe::egui::{self, Color32, Theme};

/// What went wrong, readable and calm on either ground.
const ERROR_ON_DARK: Color32 = Color32::from_rgb(240, 136, 120);
const ERROR_ON_LIGHT: Color32 = Color32::from_rgb(170, 48, 36);

/// What is worth a look.
const WARNING_ON_DARK: Color32 = Color32::from_rgb(232, 184, 96);
const WARNING_ON_LIGHT: Color32 = Color32::from_rgb(140, 92, 0);

/// Takes the style.
pub fn apply(context: &egui::Context) {
    context.all_styles_mut(|style| {
        // A plain wheel moves the shelf, which goes one way only.
        style.always_scroll_the_only_direction = true;
    });
    let colors = [
        (Theme::Dark, ERROR_ON_DARK, WARNING_ON_DARK),
        (Theme::Light, ERROR_ON_LIGHT, WARNING_ON_LIGHT),
    ];
    for (theme, error, warning) in colors {
        context.style_mut_of(theme, |style| {
            style.visuals.error_fg_color = error;
            style.visuals.warn_fg_color = warning;
        });
    }
}
