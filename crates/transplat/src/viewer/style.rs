//! Style of the window, for both themes: one scale of type, of spacing and of colour.
//!
//! Type: 16 headings, 13 what is read, 11 what stands beside it, 20 icons. Spacing: 5 between rows, 8 between columns. Text that is read or
//! muted has a contrast of 4.5 to 1 and more on its ground, the rim of a box or a field 3 to 1 (WCAG 2.2, AA).

use eframe::egui::style::ScrollStyle;
use eframe::egui::{
    self, Color32, FontData, FontDefinitions, FontFamily, FontId, Stroke, TextStyle, Theme,
    Visuals, vec2,
};
use lucide_icons::LUCIDE_FONT_BYTES;

/// Sizes of text in points: what is read, headings, what stands beside it, and icons.
const BODY: f32 = 13.0;
const HEADING: f32 = 16.0;
const SMALL: f32 = 11.0;
const ICON: f32 = 20.0;

/// The font of icons.
const ICONS: &str = "lucide";

/// Width of the names of controls, so that the controls stand below each other.
pub const NAME_WIDTH: f32 = 96.0;

/// Width of a number, so that the numbers' right edges are one line, and room for it behind a map, with the gaps.
pub const NUMBER_WIDTH: f32 = 78.0;

/// Height of a tab.
pub const TAB_HEIGHT: f32 = 48.0;

/// Height of what is clicked or dragged, and the gaps between.
const CONTROL_HEIGHT: f32 = 21.0;
const GAPS: egui::Vec2 = vec2(8.0, 5.0);

/// Colours of a theme.
struct ThemeColors {
    theme: Theme,
    /// Text that is read.
    text: u8,
    /// Text that stands beside it.
    muted: u8,
    /// Rim of boxes, buttons and fields.
    rim: u8,
    error: Color32,
    warning: Color32,
}

const THEMES: [ThemeColors; 2] = [
    ThemeColors {
        theme: Theme::Dark,
        text: 190,
        muted: 140,
        rim: 112,
        error: Color32::from_rgb(240, 136, 120),
        warning: Color32::from_rgb(232, 184, 96),
    },
    ThemeColors {
        theme: Theme::Light,
        text: 50,
        muted: 105,
        rim: 140,
        error: Color32::from_rgb(170, 48, 36),
        warning: Color32::from_rgb(140, 92, 0),
    },
];

impl ThemeColors {
    fn apply(&self, visuals: &mut Visuals) {
        visuals.error_fg_color = self.error;
        visuals.warn_fg_color = self.warning;
        visuals.widgets.noninteractive.fg_stroke.color = Color32::from_gray(self.text);
        visuals.weak_text_color = Some(Color32::from_gray(self.muted));
        visuals.widgets.inactive.bg_stroke = Stroke::new(1.0, Color32::from_gray(self.rim));
    }
}

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
        let heading = FontId::proportional(HEADING);
        style.text_styles.insert(TextStyle::Heading, heading);
        style.spacing.item_spacing = GAPS;
        style.spacing.interact_size.y = CONTROL_HEIGHT;
    });
    let mut fonts = FontDefinitions::default();
    let icons = FontData::from_static(LUCIDE_FONT_BYTES);
    fonts.font_data.insert(ICONS.into(), icons.into());
    let alone = vec![ICONS.to_owned()];
    fonts.families.insert(FontFamily::Name(ICONS.into()), alone);
    context.set_fonts(fonts);
    for colors in THEMES {
        context.style_mut_of(colors.theme, |style| colors.apply(&mut style.visuals));
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

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance of WCAG 2.2.
    fn luminance(color: Color32) -> f64 {
        let linear = |v: u8| {
            let v = f64::from(v) / 255.0;
            match v <= 0.04045 {
                true => v / 12.92,
                false => ((v + 0.055) / 1.055).powf(2.4),
            }
        };
        0.2126 * linear(color.r()) + 0.7152 * linear(color.g()) + 0.0722 * linear(color.b())
    }

    fn contrast(a: Color32, b: Color32) -> f64 {
        let [a, b] = [a, b].map(luminance);
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn text_and_rims_are_seen_in_both_themes() {
        for colors in THEMES {
            let mut visuals = colors.theme.default_visuals();
            colors.apply(&mut visuals);
            let ground = visuals.panel_fill;
            for text in [
                visuals.text_color(),
                visuals.weak_text_color(),
                visuals.error_fg_color,
                visuals.warn_fg_color,
            ] {
                let found = contrast(text, ground);
                assert!(found >= 4.5, "{:?} {text:?}: {found:.2}", colors.theme);
            }
            let button = &visuals.widgets.inactive;
            assert!(contrast(button.text_color(), button.weak_bg_fill) >= 4.5);
            let rim = contrast(button.bg_stroke.color, ground);
            assert!(rim >= 3.0, "{:?}: {rim:.2}", colors.theme);
        }
    }
}
