//! Stage *present*: from images of surfels to the image that is shown or saved: views, channels, background, tone mapping.

use glam::Vec3;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};

use crate::bake::Bake;
use crate::camera::Camera;
use crate::color::{Display, STORED_OFFSET, luminance, srgb_decode};
use crate::rasterize::{ColorSpace, Raster};
use crate::surfels::{Bounds, SurfelCloud};
use crate::transfer::{Part, PreparedTransfer};

/// View of the scene that an image shows.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum View {
    /// The asset relit.
    #[default]
    After,
    /// The asset as it was captured.
    Before,
    /// Left of the wipe before, right of it after.
    Split,
    /// Before in the left half, after in the right one, each whole.
    SideBySide,
    /// After minus before in display values; grey is none.
    Difference,
    /// Diffuse part of the relit colour.
    Diffuse,
    /// Specular part of the relit colour.
    Specular,
    /// World normals, turned to face the eye; 0 to 1 stands for -1 to 1.
    Normals,
    /// Depth along the view: white is the near end of the object, dark grey the far one.
    Depth,
    /// Cosine-weighted open share of each surfel's front side.
    Visibility,
    /// Albedo: the share of light that is scattered, or mirrored by metal, by channel.
    Albedo,
    /// Share of each surfel's colour that is emission.
    #[serde(rename = "glow", alias = "emission")]
    Emission,
    /// The transfer ratio in stops: blue is -3 and less, white 0, red +3 and more.
    Tau,
    /// Surfels that were relit with less than all that the method knows, by the colours of [`LowConfidence`].
    #[serde(rename = "doubts", alias = "confidence")]
    Confidence,
}

impl View {
    /// All of them, as they are listed.
    pub const ALL: [Self; 14] = [
        Self::After,
        Self::Before,
        Self::Split,
        Self::SideBySide,
        Self::Difference,
        Self::Diffuse,
        Self::Specular,
        Self::Normals,
        Self::Depth,
        Self::Visibility,
        Self::Albedo,
        Self::Emission,
        Self::Tau,
        Self::Confidence,
    ];

    /// True where an image of it needs the relit colour.
    pub fn needs_relit(self) -> bool {
        self.has_two_sides()
            || matches!(
                self,
                Self::After | Self::Diffuse | Self::Specular | Self::Tau | Self::Confidence
            )
            || self.is_of_materials()
    }

    /// True for materials, which no target light changes.
    pub fn is_of_materials(self) -> bool {
        matches!(self, Self::Albedo | Self::Emission)
    }

    /// Part of the relit colour that it shows.
    pub fn part(self) -> Part {
        match self {
            Self::Diffuse => Part::Diffuse,
            Self::Specular => Part::Specular,
            _ => Part::Whole,
        }
    }

    /// True where it shows before and after.
    pub fn has_two_sides(self) -> bool {
        matches!(self, Self::Split | Self::SideBySide | Self::Difference)
    }

    /// Environments behind it: the source's behind the capture, the target's behind what is relit.
    pub fn backdrops(self) -> [bool; 2] {
        match self {
            Self::Before => [true, false],
            Self::Split | Self::SideBySide => [true, true],
            _ => [false, true],
        }
    }

    /// Background of the view: values that are no light, and differences, are not to be mistaken for scenery.
    pub fn background(self, wanted: Background) -> Background {
        match (self, wanted) {
            (Self::Difference, Background::Environment) => Background::Color([0.5; 3]),
            (view, Background::Environment) if !view.is_light() => Background::Color([0.2; 3]),
            _ => wanted,
        }
    }

    /// True where a LUT and a lens apply: a difference is of values as they are.
    pub fn is_graded(self) -> bool {
        self.is_light() && self != Self::Difference
    }

    /// True for colours of light, that exposure and tone curve apply to.
    pub fn is_light(self) -> bool {
        self.has_two_sides()
            || matches!(
                self,
                Self::After | Self::Before | Self::Diffuse | Self::Specular
            )
    }
}

/// Surfel colours of a view of [`View::is_of_materials`], display-encoded. `[n]`
pub fn material_colors(view: View, prepared: &PreparedTransfer) -> Vec<[f32; 3]> {
    let materials = prepared.materials(None);
    match view {
        View::Emission => materials
            .each
            .iter()
            .map(|m| emission_color(m.emission_share))
            .collect(),
        _ => materials.colors(),
    }
}

/// The display colour of a surfel in [`View::Emission`] of whose colour so much is its own light, 0 to 1.
pub fn emission_color(emission_share: f32) -> [f32; 3] {
    let [none, whole] = [[0.12, 0.12, 0.14], [1.0, 0.85, 0.35]];
    std::array::from_fn(|c| none[c] + emission_share * (whole[c] - none[c]))
}

/// Reason for low confidence in a relit colour; the first that applies is shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LowConfidence {
    /// Its values are no numbers, or it is too faint to be seen: it is not drawn.
    LeftOut,
    /// The source light on it is darker than epsilon: its ratio is epsilon's, not the light's.
    DarkSource,
    /// The capture was clipped at white there: how bright it was nobody knows.
    Clipped,
    /// The ratio is beyond 3 stops either way.
    AtLimit,
    /// Both its sides are seen about equally, and nothing else tells: which one is the front is a guess.
    AmbiguousNormal,
}

impl LowConfidence {
    /// All of them, the gravest first.
    pub const ALL: [Self; 5] = [
        Self::LeftOut,
        Self::DarkSource,
        Self::Clipped,
        Self::AtLimit,
        Self::AmbiguousNormal,
    ];

    /// Its display colour.
    pub fn color(self) -> [f32; 3] {
        match self {
            Self::LeftOut => [0.45, 0.45, 0.45],
            Self::DarkSource => [0.35, 0.25, 0.95],
            Self::Clipped => [0.95, 0.85, 0.1],
            Self::AtLimit => [0.95, 0.25, 0.15],
            Self::AmbiguousNormal => [0.1, 0.75, 0.7],
        }
    }
}

/// The display colour of surfels in [`View::Confidence`] of which nothing is doubtful.
pub const NO_DOUBT: [f32; 3] = [0.85, 0.85, 0.85];

/// Reasons for low confidence by surfel, `[n]`; `tau` is that of a [`crate::transfer::Relit`].
pub fn confidence(
    cloud: &SurfelCloud,
    bake: &Bake,
    prepared: &PreparedTransfer,
    tau: &[[f32; 3]],
) -> Vec<Option<LowConfidence>> {
    // A stored DC at white, less what an 8-bit picture cannot tell.
    let white = (1.0 - STORED_OFFSET - 2.0 / 255.0) * crate::sh::SQRT_4PI as f32;
    (0..cloud.len())
        .map(|i| {
            let dc = cloud.sh_of(i)[0];
            let (least, most) = tau[i]
                .iter()
                .fold((f32::INFINITY, 0f32), |(a, b), t| (a.min(*t), b.max(*t)));
            if cloud.opacities[i] <= crate::surfels::MIN_ALPHA {
                Some(LowConfidence::LeftOut)
            } else if prepared.is_dark(i) {
                Some(LowConfidence::DarkSource)
            } else if dc.iter().any(|c| *c >= white) {
                Some(LowConfidence::Clipped)
            } else if most >= 8.0 || least <= 0.125 {
                Some(LowConfidence::AtLimit)
            } else {
                bake.is_ambiguous(i)
                    .then_some(LowConfidence::AmbiguousNormal)
            }
        })
        .collect()
}

/// Doubts as surfel colours.
pub fn confidence_colors(confidence: &[Option<LowConfidence>]) -> Vec<[f32; 3]> {
    confidence
        .iter()
        .map(|d| d.map_or(NO_DOUBT, LowConfidence::color))
        .collect()
}

/// Background behind the objects.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Background {
    /// Nothing: the picture keeps its alpha.
    #[default]
    Transparent,
    /// A display-encoded colour.
    Color([f32; 3]),
    /// From the first display-encoded colour at the top to the second at the bottom.
    Gradient([f32; 3], [f32; 3]),
    /// A checkerboard of greys, to judge edges on.
    Checker,
    /// The environment: the target's behind what is relit, the source's behind what is not.
    Environment,
    /// The scene's plate.
    #[serde(rename = "plate")]
    Backplate,
}

/// Edge of a square of the checkerboard, in pixels.
pub const CHECKER_EDGE: usize = 16;

/// The two greys of the checkerboard, display-encoded.
pub const CHECKER_GREYS: [f32; 2] = [0.32, 0.42];

/// A background without a light: its display-encoded colour at a pixel of a picture of a size; `None` where it has none.
pub fn plain_background(
    background: Background,
    x: usize,
    y: usize,
    height: usize,
) -> Option<[f32; 3]> {
    match background {
        Background::Transparent | Background::Environment | Background::Backplate => None,
        Background::Color(color) => Some(color),
        Background::Gradient(top, bottom) => {
            let t = (y as f32 + 0.5) / height as f32;
            Some(std::array::from_fn(|c| top[c] + (bottom[c] - top[c]) * t))
        }
        Background::Checker => {
            let odd = (x / CHECKER_EDGE + y / CHECKER_EDGE) % 2;
            Some([CHECKER_GREYS[odd]; 3])
        }
    }
}

/// Puts `behind` (premultiplied, in the raster's own space) under each pixel.
pub fn composite(raster: &mut Raster, behind: impl Fn(usize, usize) -> [f32; 4] + Sync) {
    let width = raster.width;
    raster
        .pixels
        .par_iter_mut()
        .enumerate()
        .for_each(|(i, pixel)| {
            let through = 1.0 - pixel[3];
            if through > 0.0 {
                let color = behind(i % width, i / width);
                for (p, c) in pixel.iter_mut().zip(color) {
                    *p += through * c;
                }
            }
        });
}

/// Radiance in a picture's own space.
pub fn in_space(radiance: [f32; 3], space: ColorSpace) -> [f32; 3] {
    match space {
        ColorSpace::Display(display) => display.encode(radiance),
        ColorSpace::Linear => radiance,
    }
}

/// Straight colour and alpha for an 8-bit picture, clamped to what it can hold.
pub fn straight(raster: &Raster) -> Vec<[f32; 4]> {
    raster
        .pixels
        .iter()
        .map(|&[r, g, b, a]| {
            if a <= 0.0 {
                return [0.0; 4];
            }
            [r / a, g / a, b / a, a].map(|v| v.clamp(0.0, 1.0))
        })
        .collect()
}

/// One picture left of `wipe` (0 to 1), the other right of it, with a line between.
pub fn split(left: &Raster, right: &Raster, wipe: f32) -> Raster {
    let mut out = right.clone();
    let middle = wipe_column(wipe, out.width);
    for y in 0..out.height {
        for x in 0..middle.min(out.width) {
            let i = y * out.width + x;
            out.pixels[i] = left.pixels[i];
        }
        if out.width > 2 && middle < out.width {
            out.pixels[y * out.width + middle] = WIPE_LINE;
        }
    }
    out
}

/// The column of a wipe's line.
pub fn wipe_column(wipe: f32, width: usize) -> usize {
    (wipe * width as f32) as usize
}

/// The line of a wipe, premultiplied.
pub const WIPE_LINE: [f32; 4] = [0.5, 0.5, 0.5, 1.0];

/// Two pictures beside each other.
pub fn side_by_side(left: &Raster, right: &Raster) -> Raster {
    let rows = |a: &[[f32; 4]], b: &[[f32; 4]]| {
        let pairs = a.chunks(left.width).zip(b.chunks(right.width));
        pairs.flat_map(|(a, b)| [a, b].concat()).collect()
    };
    let depths = left.depth.chunks(left.width);
    Raster {
        width: left.width + right.width,
        height: left.height,
        pixels: rows(&left.pixels, &right.pixels),
        depth: depths
            .zip(right.depth.chunks(right.width))
            .flat_map(|(a, b)| [a, b].concat())
            .collect(),
    }
}

/// After minus before, `scale` times: as display values over `[0, 1]`, 0.5 where they are equal; of linear pictures the plain signed difference.
pub fn difference(before: &Raster, after: &Raster, space: ColorSpace, scale: f32) -> Raster {
    let mut out = after.clone();
    for (out, before) in out.pixels.iter_mut().zip(&before.pixels) {
        let alpha = out[3];
        for c in 0..3 {
            let value = scale * (out[c] - before[c]);
            out[c] = match space {
                ColorSpace::Display(_) => (0.5 * alpha + value).clamp(0.0, alpha),
                ColorSpace::Linear => value,
            };
        }
    }
    out
}

/// The depths that a camera sees an object between: where the sphere around it begins and ends.
pub fn depth_range(camera: &Camera, bounds: &Bounds) -> [f32; 2] {
    let (_, center) = camera.project(bounds.center);
    let near = (center - bounds.radius).max(camera.near);
    [near, (center + bounds.radius).max(1.001 * near)]
}

/// The depth of a picture as its colour. For display it runs from white at the near end of the range to dark grey at the far one.
pub fn depth_picture(raster: &Raster, space: ColorSpace, [near, far]: [f32; 2]) -> Raster {
    let mut out = raster.clone();
    for (pixel, depth) in out.pixels.iter_mut().zip(&raster.depth) {
        let value = match space {
            ColorSpace::Linear => *depth,
            ColorSpace::Display(_) => (1.0 - 0.8 * (depth - near) / (far - near)).clamp(0.0, 1.0),
        };
        let alpha = pixel[3];
        *pixel = [value * alpha, value * alpha, value * alpha, alpha];
    }
    out
}

/// Bands of the false colours: up to how many stops over middle grey (0.18), and the display colour.
pub const FALSE_COLORS: [(f32, [f32; 3]); 9] = [
    (-6.0, [0.15, 0.0, 0.3]),
    (-4.0, [0.1, 0.15, 0.8]),
    (-2.0, [0.0, 0.5, 0.75]),
    (-0.5, [0.25, 0.45, 0.45]),
    (0.5, [0.45, 0.45, 0.45]),
    (1.5, [0.4, 0.65, 0.35]),
    (2.47, [0.95, 0.85, 0.2]),
    (4.0, [0.95, 0.4, 0.1]),
    (f32::INFINITY, [0.9, 0.05, 0.1]),
];

/// Exposure as false colour: display values (sRGB curve, not clipped) are brought back to luminance and told in stops over middle grey.
/// Everything over 2.47 stops is over white.
pub fn false_color(encoded: [f32; 3]) -> [f32; 3] {
    let stops = (luminance(encoded.map(srgb_decode)).max(1e-9) / 0.18).log2();
    FALSE_COLORS
        .iter()
        .find(|(to, _)| stops < *to)
        .unwrap_or(&FALSE_COLORS[FALSE_COLORS.len() - 1])
        .1
}

/// A whole picture in false colours; what shows through of nothing stays so.
pub fn false_color_picture(raster: &mut Raster) {
    recolor(raster, false_color);
}

/// A whole picture by a function of straight colour.
pub fn recolor(raster: &mut Raster, color: impl Fn([f32; 3]) -> [f32; 3] + Sync) {
    raster.pixels.par_iter_mut().for_each(|pixel| {
        let alpha = pixel[3];
        if alpha > 0.0 {
            let [r, g, b] = color([pixel[0] / alpha, pixel[1] / alpha, pixel[2] / alpha]);
            *pixel = [r * alpha, g * alpha, b * alpha, alpha];
        }
    });
}

/// Normals as surfel colours: each turned to face the eye. For display 0 to 1 stands for -1 to 1. `[n][3]`
pub fn normal_colors(cloud: &SurfelCloud, eye: Vec3, space: ColorSpace) -> Vec<[f32; 3]> {
    let each = 0..cloud.len();
    match space {
        ColorSpace::Display(_) => each.map(|i| normal_color(cloud, eye, i)).collect(),
        ColorSpace::Linear => each.map(|i| normal(cloud, eye, i).to_array()).collect(),
    }
}

/// Colour of a surfel's normal, turned to the eye.
pub fn normal_color(cloud: &SurfelCloud, eye: Vec3, i: usize) -> [f32; 3] {
    (normal(cloud, eye, i) * 0.5 + 0.5).to_array()
}

/// A surfel's normal, turned to the eye.
fn normal(cloud: &SurfelCloud, eye: Vec3, i: usize) -> Vec3 {
    let n = cloud.stored_normal(i);
    if n.dot(cloud.positions[i] - eye) > 0.0 {
        -n
    } else {
        n
    }
}

/// The ratio's heat map: stops on the mean of the channels, -3 blue, 0 white, +3 red.
pub fn tau_colors(tau: &[[f32; 3]]) -> Vec<[f32; 3]> {
    tau.iter()
        .map(|t| {
            let mean = (t[0] + t[1] + t[2]) / 3.0;
            let stops = (mean.max(1e-6).log2() / 3.0).clamp(-1.0, 1.0);
            if stops < 0.0 {
                [1.0 + 0.9 * stops, 1.0 + 0.7 * stops, 1.0]
            } else {
                [1.0, 1.0 - 0.75 * stops, 1.0 - 0.9 * stops]
            }
        })
        .collect()
}

/// Display values show as they are: for channels that are no colours.
pub const PLAIN: ColorSpace = ColorSpace::Display(Display {
    exposure: 0.0,
    tone_map: crate::color::ToneMap::Srgb,
});

#[cfg(test)]
mod tests {
    use super::*;
    use crate::color::srgb_encode;

    fn raster(pixel: [f32; 4]) -> Raster {
        Raster {
            width: 4,
            height: 1,
            pixels: vec![pixel; 4],
            depth: vec![1.0; 4],
        }
    }

    #[test]
    fn compositing_fills_what_is_open() {
        let mut r = raster([0.25, 0.0, 0.0, 0.25]);
        composite(&mut r, |_, _| [0.0, 1.0, 0.5, 1.0]);
        assert_eq!(r.pixels[0], [0.25, 0.75, 0.375, 1.0]);
    }

    #[test]
    fn straight_undoes_premultiplication_and_clamps() {
        assert_eq!(
            straight(&raster([0.25, 1.0, 0.0, 0.5]))[0],
            [0.5, 1.0, 0.0, 0.5]
        );
        assert_eq!(straight(&raster([0.0; 4]))[0], [0.0; 4]);
    }

    #[test]
    fn no_difference_is_grey() {
        let r = raster([0.3, 0.9, 0.0, 1.0]);
        assert_eq!(
            difference(&r, &r, PLAIN, 3.0).pixels[0],
            [0.5, 0.5, 0.5, 1.0]
        );
    }

    #[test]
    fn split_shows_both() {
        let black = [0.0, 0.0, 0.0, 1.0];
        let s = split(&raster([1.0; 4]), &raster(black), 0.5);
        assert_eq!(s.pixels[0], [1.0; 4]);
        assert_eq!(s.pixels[3], black);
        let all = split(&raster([1.0; 4]), &raster(black), 1.0);
        assert_eq!(all.pixels, vec![[1.0; 4]; 4]);
        let both = side_by_side(&raster([1.0; 4]), &raster(black));
        assert_eq!(
            (both.width, both.pixels[3], both.pixels[4]),
            (8, [1.0; 4], black)
        );
    }

    #[test]
    fn false_colors_tell_stops_over_middle_grey() {
        let of = |stops: f32| false_color([srgb_encode(0.18 * stops.exp2()); 3]);
        assert_eq!(of(0.0), FALSE_COLORS[4].1);
        assert_eq!(of(2.3), FALSE_COLORS[6].1);
        assert_eq!(of(2.6), FALSE_COLORS[7].1);
        assert_eq!(of(40.0), FALSE_COLORS[8].1);
        assert_eq!(false_color([0.0; 3]), FALSE_COLORS[0].1);
    }

    #[test]
    fn gradients_and_checkers_are_where_they_belong() {
        let gradient = Background::Gradient([1.0; 3], [0.0; 3]);
        let at = |y| plain_background(gradient, 0, y, 100).map(|c| c[0]);
        assert!(at(0) > Some(0.99) && at(99) < Some(0.01));
        let checker = |x, y| plain_background(Background::Checker, x, y, 100);
        assert_ne!(checker(0, 0), checker(CHECKER_EDGE, 0));
        assert_eq!(checker(0, 0), checker(CHECKER_EDGE, CHECKER_EDGE));
    }
}
