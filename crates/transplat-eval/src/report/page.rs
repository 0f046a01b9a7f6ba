//! The report as one self-contained page: HTML with its plots in SVG.

use std::io::Write as _;
use std::path::Path;

use anyhow::{Result, anyhow};
use plotters::coord::Shift;
use plotters::coord::ranged1d::{AsRangedCoord, ValueFormatter};
use plotters::prelude::*;
use plotters::style::text_anchor::{HPos, Pos, VPos};
use transplat_core::files::write_atomically;

/// A page that grows from top to bottom.
pub struct Page {
    body: String,
}

/// A point of a plot.
#[derive(Clone, Debug)]
pub struct Dot {
    /// Position on the horizontal axis.
    pub x: f64,
    /// Position on the vertical axis.
    pub y: f64,
    /// Text beside the dot, in a tooltip.
    pub label: String,
    /// Group that it belongs to, which gives its colour.
    pub group: usize,
    /// True for a default, which gets a ring.
    pub is_default: bool,
    /// True where a line joins it with others of its group, such as those on the front; it is named then.
    pub is_joined: bool,
}

/// A plot of dots over a logarithmic axis.
pub struct Plot<'a> {
    /// Title above the plot.
    pub title: &'a str,
    /// Label of the horizontal axis.
    pub x: &'a str,
    /// Label of the vertical axis.
    pub y: &'a str,
    /// True for a logarithmic vertical axis.
    pub is_y_logarithmic: bool,
    /// Names of the groups, in the order of their colours.
    pub groups: &'a [&'a str],
    /// True where the groups have one front between them.
    pub is_front_shared: bool,
}

const SIZE: (u32, u32) = (960, 520);

/// Blue, orange, green, purple: told apart by most eyes, on white and in print.
const COLORS: [RGBColor; 4] = [
    RGBColor(0, 90, 181),
    RGBColor(220, 80, 0),
    RGBColor(0, 130, 90),
    RGBColor(130, 60, 160),
];

const STYLE: &str = "body{font:15px/1.5 system-ui,sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem;color:#222;background:#fff}
table{border-collapse:collapse;margin:1rem 0;font-size:13px}td,th{padding:.15rem .6rem;border-bottom:1px solid #ddd;text-align:right}
td:first-child,th:first-child{text-align:left}tr.default{font-weight:600}tr.bad{background:#fdd}svg{max-width:100%;height:auto}
details{margin:.5rem 0}summary{cursor:pointer}p.note{color:#555}";

impl Page {
    /// An empty page.
    pub fn new(title: &str) -> Self {
        let mut page = Self {
            body: String::new(),
        };
        page.line(&format!("<h1>{}</h1>", escaped(title)));
        page
    }

    fn line(&mut self, text: &str) {
        self.body.push_str(text);
        self.body.push('\n');
    }

    /// Adds a heading.
    pub fn heading(&mut self, text: &str) {
        self.line(&format!("<h2>{}</h2>", escaped(text)));
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) {
        self.line(&format!("<p>{}</p>", escaped(text)));
    }

    /// Text whose columns are aligned.
    pub fn preformatted(&mut self, text: &str) {
        self.line(&format!("<pre>{}</pre>", escaped(text)));
    }

    /// Adds a list.
    pub fn list<'a>(&mut self, items: impl IntoIterator<Item = &'a String>) {
        self.line("<ul>");
        for item in items {
            self.line(&format!("<li>{}</li>", escaped(item)));
        }
        self.line("</ul>");
    }

    /// A table behind a fold; a row may have a class of its own.
    pub fn table(&mut self, name: &str, head: &[&str], rows: &[(&str, Vec<String>)]) {
        self.line(&format!(
            "<details open><summary>{}</summary><table>",
            escaped(name)
        ));
        let cell = |tag: &str, text: &str| format!("<{tag}>{}</{tag}>", escaped(text));
        let head: String = head.iter().map(|name| cell("th", name)).collect();
        self.line(&format!("<tr>{head}</tr>"));
        for (class, row) in rows {
            let row: String = row.iter().map(|text| cell("td", text)).collect();
            self.line(&format!("<tr class=\"{class}\">{row}</tr>"));
        }
        self.line("</table></details>");
    }

    /// Adds a plot as SVG.
    pub fn plot(&mut self, plot: &Plot<'_>, dots: &[Dot]) -> Result<()> {
        if dots.is_empty() {
            return Ok(());
        }
        // Nothing is exact on a logarithmic axis.
        let least = |v: f64, is_logarithmic: bool| if is_logarithmic { v.max(1e-12) } else { v };
        let dots: Vec<Dot> = dots
            .iter()
            .map(|d| Dot {
                x: least(d.x, true),
                y: least(d.y, plot.is_y_logarithmic),
                ..d.clone()
            })
            .collect();
        let svg = draw(plot, &dots)?;
        self.line(&svg);
        Ok(())
    }

    /// Yields the page as HTML.
    pub fn finish(self, title: &str) -> String {
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><meta name=\"viewport\" content=\"width=device-width\"><title>{}</title><style>{STYLE}</style></head><body>\n{}</body></html>\n",
            escaped(title),
            self.body
        )
    }
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('>', "&gt;")
        .replace('"', "&quot;")
}

fn draw(plot: &Plot<'_>, dots: &[Dot]) -> Result<String> {
    let mut svg = String::new();
    {
        let area = SVGBackend::with_string(&mut svg, SIZE).into_drawing_area();
        let x = logarithmic(dots.iter().map(|d| d.x));
        let failed = |e: DrawingAreaErrorKind<_>| anyhow!("the plot {}: {e}", plot.title);
        area.fill(&WHITE).map_err(failed)?;
        if plot.is_y_logarithmic {
            let y = logarithmic(dots.iter().map(|d| d.y));
            chart(&area, plot, dots, x, y.log_scale())
        } else {
            chart(&area, plot, dots, x, linear(dots.iter().map(|d| d.y)))
        }
        .map_err(|e| anyhow!("the plot {}: {e}", plot.title))?;
        area.present().map_err(failed)?;
    }
    Ok(svg)
}

/// A range with some room around all values, which are above 0.
fn logarithmic(values: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let (low, high) = extent(values);
    let (low, high) = (low.max(1e-12), high.max(1e-11));
    let room = (high / low).powf(0.08).max(1.3);
    low / room..high * room
}

fn linear(values: impl Iterator<Item = f64>) -> std::ops::Range<f64> {
    let (low, high) = extent(values);
    let room = 0.08 * (high - low).max(1e-6);
    low - room..high + room
}

fn extent(values: impl Iterator<Item = f64>) -> (f64, f64) {
    values.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
        (low.min(v), high.max(v))
    })
}

fn chart<'a, Y>(
    area: &DrawingArea<SVGBackend<'a>, Shift>,
    plot: &Plot<'_>,
    dots: &[Dot],
    x: std::ops::Range<f64>,
    y: Y,
) -> Result<(), DrawingAreaErrorKind<std::io::Error>>
where
    Y: AsRangedCoord<Value = f64>,
    Y::CoordDescType: ValueFormatter<f64>,
{
    let middle = (x.start * x.end).sqrt();
    let mut chart = ChartBuilder::on(area)
        .caption(plot.title, ("sans-serif", 18))
        .margin(12)
        .x_label_area_size(44)
        .y_label_area_size(70)
        .build_cartesian_2d(x.log_scale(), y)?;
    chart
        .configure_mesh()
        .x_desc(plot.x)
        .y_desc(plot.y)
        .x_label_formatter(&|v| number(*v))
        .y_label_formatter(&|v| number(*v))
        .bold_line_style(RGBColor(215, 215, 215))
        .light_line_style(TRANSPARENT)
        .draw()?;
    let fronts = if plot.is_front_shared {
        1
    } else {
        plot.groups.len()
    };
    for group in 0..fronts {
        let mut front: Vec<(f64, f64)> = dots
            .iter()
            .filter(|d| d.is_joined && (plot.is_front_shared || d.group == group))
            .map(|d| (d.x, d.y))
            .collect();
        front.sort_by(|a, b| a.0.total_cmp(&b.0));
        let grey = RGBColor(150, 150, 150).stroke_width(2);
        chart.draw_series(LineSeries::new(front, grey))?;
    }
    let mut labels = PlotLabels::default();
    let is_used = |group: &usize| dots.iter().any(|d| d.group == *group);
    for group in (0..plot.groups.len()).filter(is_used) {
        let name = plot.groups[group];
        let color = COLORS[group % COLORS.len()];
        let of_group = || dots.iter().filter(move |d| d.group == group);
        chart
            .draw_series(of_group().map(|d| Circle::new((d.x, d.y), 4, color.filled())))?
            .label(name)
            .legend(move |(x, y)| Circle::new((x + 10, y), 4, color.filled()));
        let rings = of_group().filter(|d| d.is_default);
        chart.draw_series(rings.map(|d| Circle::new((d.x, d.y), 9, color.stroke_width(2))))?;
        // Only what is on the front is named: the table has the rest.
        let named = of_group().filter(|d| (d.is_joined || d.is_default) && !d.label.is_empty());
        let places: Vec<(&Dot, i32)> = named
            .map(|d| {
                let at = chart.backend_coord(&(d.x, d.y));
                (d, labels.place(at, &d.label, d.x > middle))
            })
            .collect();
        chart.draw_series(places.into_iter().map(|(d, dy)| {
            let style = ("sans-serif", 12).into_font().color(&color);
            // Towards the middle, where there is room.
            let (h_pos, dx) = if d.x > middle {
                (HPos::Right, -LABEL_GAP)
            } else {
                (HPos::Left, LABEL_GAP)
            };
            let v_pos = VPos::Center;
            let text = Text::new(d.label.clone(), (dx, dy), style.pos(Pos { h_pos, v_pos }));
            EmptyElement::at((d.x, d.y)) + text
        }))?;
    }
    chart
        .configure_series_labels()
        .background_style(WHITE.mix(0.8))
        .border_style(RGBColor(200, 200, 200))
        .draw()
}

/// Pixels between a dot's ring and its label, and the size of the label's letters.
const LABEL_GAP: i32 = 13;
const LETTER: (i32, i32) = (7, 13);

/// Where labels are, so that none lies on another: left, right and middle height, in pixels.
#[derive(Default)]
struct PlotLabels(Vec<[i32; 3]>);

impl PlotLabels {
    /// Pixels that a label goes below its dot, as near as there is room.
    fn place(&mut self, (x, y): (i32, i32), label: &str, is_on_left: bool) -> i32 {
        let width = LETTER.0 * label.chars().count() as i32;
        let (left, right) = if is_on_left {
            (x - LABEL_GAP - width, x - LABEL_GAP)
        } else {
            (x + LABEL_GAP, x + LABEL_GAP + width)
        };
        let is_free = |dy: &i32| {
            let mut taken = self.0.iter();
            !taken.any(|[l, r, h]| left < *r && *l < right && (h - y - dy).abs() < LETTER.1)
        };
        let steps = (0..20).flat_map(|i| [-i, i]).map(|i| i * LETTER.1 / 2);
        let dy = steps.into_iter().find(is_free).unwrap_or(0);
        self.0.push([left, right, y + dy]);
        dy
    }
}

/// A number as short as it can be read.
fn number(v: f64) -> String {
    let size = v.abs();
    if size == 0.0 {
        "0".into()
    } else if !(1e-3..1e5).contains(&size) {
        format!("{v:.0e}")
    } else if size < 1.0 {
        format!("{v:.3}")
    } else if size < 100.0 {
        format!("{v:.1}")
    } else {
        format!("{v:.0}")
    }
}

/// Writes a file of the report.
pub fn write(path: &Path, text: &str) -> Result<()> {
    let text = text.as_bytes();
    Ok(write_atomically(path, |out| out.write_all(text))?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_page_is_whole_and_its_names_are_no_markup() {
        let mut page = Page::new("a < b");
        let dot = |x: f64, y: f64| Dot {
            x,
            y,
            label: "<script>".into(),
            group: 0,
            is_default: x == 1.0,
            is_joined: true,
        };
        for is_y_logarithmic in [true, false] {
            let plot = Plot {
                title: "t & u",
                x: "ms",
                y: "dB",
                is_y_logarithmic,
                groups: &["one"],
                is_front_shared: !is_y_logarithmic,
            };
            page.plot(&plot, &[dot(1.0, 2.0), dot(10.0, 1e-9)])
                .expect("it is drawn");
            page.plot(&plot, &[dot(1.0, 0.0)]).expect("one dot, too");
            page.plot(&plot, &[]).expect("and none");
        }
        page.table("rows", &["a"], &[("default", vec!["1 < 2".into()])]);
        let html = page.finish("a < b");
        assert_eq!(html.matches("<svg").count(), 4);
        assert!(!html.contains("<script>") && html.contains("1 &lt; 2"));
    }
}
