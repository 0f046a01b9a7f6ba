//! Text in saved images, by the fonts of the window.

use eframe::egui::epaint::text::{
    FontDefinitions, Fonts, LayoutJob, TextFormat, TextOptions, TextWrapping,
};
use eframe::egui::{Color32, FontId};

/// A line of text as the share of each pixel that it covers.
pub struct Label {
    pub width: usize,
    pub height: usize,
    /// 0 to 1. `[height][width]`
    pub coverage: Vec<f32>,
}

/// Draws lines of one size.
pub struct Captions {
    fonts: Fonts,
    size: f32,
}

impl Captions {
    /// Letters of a height in pixels.
    pub fn new(size: f32) -> Self {
        Self {
            fonts: Fonts::new(TextOptions::default(), FontDefinitions::default()),
            size,
        }
    }

    /// A line that is at most so wide; what does not fit is left out, and dots say so.
    pub fn line(&mut self, text: &str, width: f32) -> Label {
        let format = TextFormat::simple(FontId::proportional(self.size), Color32::WHITE);
        let mut job = LayoutJob::single_section(text.to_owned(), format);
        job.wrap = TextWrapping::truncate_at_width(width);
        let galley = self.fonts.with_pixels_per_point(1.0).layout_job(job);
        let atlas = self.fonts.image();
        let [width, height] = [galley.size().x, galley.size().y].map(|v| v.ceil() as usize);
        let mut label = Label {
            width,
            height,
            coverage: vec![0.0; width * height],
        };
        for row in &galley.rows {
            for glyph in &row.row.glyphs {
                let from = glyph.uv_rect;
                let at = row.pos + (glyph.pos + from.offset).to_vec2().round();
                for v in from.min[1]..from.max[1] {
                    for u in from.min[0]..from.max[0] {
                        let x = at.x as isize + (u - from.min[0]) as isize;
                        let y = at.y as isize + (v - from.min[1]) as isize;
                        let inside = |v: isize, end: usize| (0..end as isize).contains(&v);
                        if inside(x, width) && inside(y, height) {
                            let alpha = atlas[(usize::from(u), usize::from(v))].a();
                            let covered = &mut label.coverage[y as usize * width + x as usize];
                            *covered = covered.max(f32::from(alpha) / 255.0);
                        }
                    }
                }
            }
        }
        label
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_is_drawn_and_cut_where_it_does_not_fit() {
        let mut captions = Captions::new(20.0);
        let covered = |l: &Label| l.coverage.iter().sum::<f32>();
        let short = captions.line("noon", 500.0);
        assert!(covered(&short) > 50.0 && short.width < 100);
        // Twice the words cover twice as much.
        let twice = captions.line("noonnoon", 500.0);
        let ratio = covered(&twice) / covered(&short);
        assert!((1.9..2.1).contains(&ratio), "{ratio}");
        let cut = captions.line(&"noon ".repeat(50), 100.0);
        assert!(cut.width <= 100 && cut.height <= short.height + 1);
        assert_eq!(captions.line("", 100.0).width, 0);
    }
}
