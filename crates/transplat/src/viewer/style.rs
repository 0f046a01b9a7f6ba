//! Style of the window, for both themes.

use eframe::egui::style::ScrollStyle;
use eframe::egui::{
    self, Color32, FontData, FontDefinitions, FontFamily, FontId, TextStyle, Theme, vec2,
};
use lucide_icons::LUCIDE_FONT_BYTES;

/// Sizes of text in points: what is read, what stands beside it, and icons.
const BODY: f32 = 13.0;
const SMALL: f32 = 10.5;
const ICON: f32 = 20.0;

/// The font of icons.
const ICONS: &str = "lucide";

/// Width of the names of controls, so that the controls stand below each other.
pub const NAME_WIDTH: f32 = 96.0;

/// Room for the number behind a slider, and the gaps around it.
pub const NUMBER_WIDTH: f32 = 94.0;

/// Height of a tab.
pub const TAB_HEIGHT: f32 = 48.0;

/// Height of what is clicked or dragged, and the gaps between.
const CONTROL_HEIGHT: f32 = 21.0;
const GAPS: egui::Vec2 = vec2(8.0, 5.0);

/// Colour of errors, readable and calm on either ground.
const ERROR_ON_DARK: Color32 = Color32::from_rgb(240, 136, 120);
const ERROR_ON_LIGHT: Color32 = Color32::from_rgb(170, 48, 36);

/// Colour of warnings.
const WARNING_ON_DARK: Color32 = Color32::from_rgb(232, 184, 96);
const WARNING_ON_LIGHT: Color32 = Color32::from_rgb(140, 92, 0);

/// Takes the style.
pub fn apply(context: &egui::Context) {
    context.all_styles_mut(|style| {
        // A plain wheel moves the shelf, which goes one way only.
        style.always_scroll_the_only_direction = true;
        // Where there is more to see, that is seen.
        style.spacing.scroll = ScrollStyle::thin();
        for text in [TextStyle::Body, TextStyle::Button] {
            style.text_styles.insert(text, FontId::proportional(BODY));
        }
        style.text_styles.insert(TextStyle::Small, small());
        style.spacing.item_spacing = GAPS;
        style.spacing.interact_size.y = CONTROL_HEIGHT;
    });
    let mut fonts = FontDefinitions::default();
    let icons = FontData::from_static(LUCIDE_FONT_BYTES);
    fonts.font_data.insert(ICONS.into(), icons.into());
    let alone = vec![ICONS.to_owned()];
    fonts.families.insert(FontFamily::Name(ICONS.into()), alone);
    context.set_fonts(fonts);
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

/// Text beside what is read first.
pub fn small() -> FontId {
    FontId::proportional(SMALL)
}

/// An icon that stands alone.
pub fn icon() -> FontId {
    FontId::new(ICON, FontFamily::Name(ICONS.into()))
}
