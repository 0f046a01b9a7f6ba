//! Cube crosses, mirror balls and angular maps, unfolded into panoramas.

use std::f64::consts::PI;

use glam::DVec3;

use super::map::{EnvironmentMap, bilinear, direction};
use crate::color::luminance;
use crate::error::{Error, Result};
use crate::images::Layout;
use crate::numeric::quantile;

/// Largest difference of pixels in empty parts, of a brightness that is neither that of the empty parts, half of a cross and a fifth of a disc's
/// square, nor a sun's.
const EMPTY: f32 = 0.01;
const LIT: f32 = 0.75;

/// Rows of a panorama that is made, at most.
const MOST_ROWS: usize = 4096;

/// Samples along each edge of a pixel.
const SAMPLES: usize = 3;

impl Layout {
    /// The one that a picture's shape and its empty parts tell: a cross has six empty squares and a disc four empty corners. Whether a disc is
    /// an angular map or a mirror ball cannot be told; light probes are the former.
    pub fn of_shape(picture: &EnvironmentMap) -> Self {
        if Cross::of(picture).is_some_and(|cross| cross.is_explicit) {
            Self::CubeCross
        } else if picture.width == picture.height && Empty::around_disc(picture) {
            Self::AngularMap
        } else {
            Self::Equirectangular
        }
    }
}

impl EnvironmentMap {
    /// The panorama of what a picture shows, laid out as is told or as its shape says.
    ///
    /// # Errors
    /// It has not the shape of what is told.
    pub fn laid_out(self, told: Option<Layout>) -> Result<Self> {
        let layout = told.unwrap_or_else(|| Layout::of_shape(&self));
        let [width, height] = [self.width, self.height];
        let is_square = width.abs_diff(height) * 50 <= width.max(height);
        let needs =
            |what: &str| Error::Mismatch(format!("{what}, and this has {width} x {height} pixels"));
        Ok(match layout {
            Layout::Equirectangular => self,
            Layout::CubeCross => {
                let cross = Cross::of(&self)
                    .ok_or_else(|| needs("a cube cross has 4 x 3 or 3 x 4 squares"))?;
                self.unfolded(layout, 2 * cross.edge, |d| cross.place(d))
            }
            Layout::CubeColumn if height != 6 * width => {
                return Err(needs("a cube column has six squares below each other"));
            }
            Layout::CubeColumn => self.unfolded(layout, 2 * width, |d| cube_column(d, width)),
            Layout::AngularMap | Layout::MirrorBall if !is_square => {
                return Err(needs("an angular map and a mirror ball fill a square"));
            }
            Layout::AngularMap => self.unfolded(layout, height, |d| in_disc(&self, angular_map(d))),
            Layout::MirrorBall => self.unfolded(layout, height, |d| in_disc(&self, mirror_ball(d))),
        })
    }

    /// A panorama of what the picture shows at the place of each direction, in pixels from its upper left corner.
    fn unfolded(
        &self,
        layout: Layout,
        rows: usize,
        place: impl Fn(DVec3) -> [f64; 2] + Sync,
    ) -> Self {
        let rows = rows.clamp(1, MOST_ROWS);
        let [width, height] = [2 * rows, rows];
        let samples = [SAMPLES * width, SAMPLES * height];
        self.read_as(layout, [width, height], |column, row| {
            let mut sum = [0f32; 3];
            for i in 0..SAMPLES * SAMPLES {
                let [x, y] = [SAMPLES * column + i % SAMPLES, SAMPLES * row + i / SAMPLES];
                let color = self.at(place(DVec3::from(direction(x, y, samples))));
                sum = std::array::from_fn(|c| sum[c] + color[c]);
            }
            sum.map(|s| s / (SAMPLES * SAMPLES) as f32)
        })
    }

    /// The picture between the pixels around a place.
    fn at(&self, [x, y]: [f64; 2]) -> [f32; 3] {
        let (x, y) = (x - 0.5, y - 0.5);
        let (column, row) = (x.floor(), y.floor());
        let clamped = |v: f64, size: usize| v.clamp(0.0, (size - 1) as f64) as usize;
        let texel = |dx: f32, dy: f32| {
            let x = clamped(column + f64::from(dx), self.width);
            let y = clamped(row + f64::from(dy), self.height);
            self.pixels[y * self.width + x]
        };
        bilinear(texel, [(x - column) as f32, (y - row) as f32])
    }
}

/// Where a direction is in a square of edge 2 around its middle, right and up: its angle to what is ahead over pi, from the middle.
fn angular_map(d: DVec3) -> [f64; 2] {
    let aside = d.y.hypot(d.z);
    let over = if aside > 1e-12 {
        aside.atan2(d.x) / (PI * aside)
    } else {
        0.0
    };
    // What is to the right of what is ahead is -Y.
    [-d.y * over, d.z * over]
}

/// Position in a mirror ball: on the normal halfway to the camera, which sees +Y on its right.
fn mirror_ball(d: DVec3) -> [f64; 2] {
    let n = (d + DVec3::X).normalize_or(DVec3::Y);
    [n.y, n.z]
}

/// The place of a direction in six faces of a cube below each other, +X, -X, +Y, -Y, +Z, -Z, in pixels from the upper left corner: the
/// `envmap` attribute of OpenEXR (ImfEnvmap.h), in whose axes +Y is up and its panoramas have +Z in the middle and +X a quarter from the left.
fn cube_column(d: DVec3, edge: usize) -> [f64; 2] {
    let [x, y, z] = [d.y, d.z, d.x];
    let last = (edge - 1) as f64;
    let on = |v: f64, of: f64| 0.5 * (v / of + 1.0) * last;
    let [ax, ay, az] = [x.abs(), y.abs(), z.abs()];
    let (face, column, row) = if ax >= ay && ax >= az {
        let (across, down) = (on(z, ax), last - on(y, ax));
        if x > 0.0 {
            (0, across, down)
        } else {
            (1, last - across, down)
        }
    } else if ay >= az {
        let (across, down) = (on(x, ay), on(z, ay));
        if y > 0.0 {
            (2, across, last - down)
        } else {
            (3, across, down)
        }
    } else {
        let (across, down) = (on(x, az), last - on(y, az));
        if z > 0.0 {
            (4, last - across, down)
        } else {
            (5, across, down)
        }
    };
    [column + 0.5, (face * edge) as f64 + row + 0.5]
}

fn in_disc(picture: &EnvironmentMap, [right, up]: [f64; 2]) -> [f64; 2] {
    let [w, h] = [picture.width, picture.height].map(|size| size as f64);
    // What is straight behind, or ahead of the camera, is the whole rim: half a pixel within, where the picture still is.
    let within = (1.0 - 1.0 / w) / right.hypot(up);
    let shrunk = |v: f64| v * within.min(1.0);
    [
        0.5 * w * (1.0 + shrunk(right)),
        0.5 * h * (1.0 - shrunk(up)),
    ]
}

/// An unfolded cube.
struct Cross {
    /// Pixels along a face's edge.
    edge: usize,
    /// True where the back is below, not beside.
    is_upright: bool,
    /// The column that has a face above and below: it is ahead.
    ahead: usize,
    /// True where its empty squares show it.
    is_explicit: bool,
}

impl Cross {
    fn of(picture: &EnvironmentMap) -> Option<Self> {
        let edge = picture.width.max(picture.height) / 4;
        let is_upright = picture.height > picture.width;
        let [columns, rows] = if is_upright { [3, 4] } else { [4, 3] };
        if edge == 0 || [columns, rows].map(|n| n * edge) != [picture.width, picture.height] {
            return None;
        }
        let empty = Empty::of(picture);
        let square = |column: usize, row: usize| {
            let lines = picture.pixels.chunks_exact(picture.width);
            let lines = lines.skip(row * edge).take(edge);
            lines.flat_map(move |line| &line[column * edge..][..edge])
        };
        let is_cross = |ahead: &usize| {
            let squares = (0..columns * rows).map(|i| (i % columns, i / columns));
            let others = squares.filter(|(c, r)| c != ahead && *r != 1);
            empty.are(others.flat_map(|(c, r)| square(c, r)))
        };
        let is_something = !empty.are(picture.pixels.iter());
        let among = if is_upright { 1..2 } else { 0..4 };
        let found = among.into_iter().find(is_cross).filter(|_| is_something);
        Some(Self {
            edge,
            is_upright,
            ahead: found.unwrap_or(1),
            is_explicit: found.is_some(),
        })
    }

    /// Where a direction is, in pixels from the upper left corner.
    fn place(&self, d: DVec3) -> [f64; 2] {
        let (ahead, right, up) = (d.x, -d.y, d.z);
        let largest = ahead.abs().max(right.abs()).max(up.abs());
        let columns = if self.is_upright { 3 } else { 4 };
        // The face, in columns from the one ahead and in rows, and where on it, right and up.
        let ([column, row], [x, y]) = if up.abs() == largest {
            let row = if up > 0.0 { 0 } else { 2 };
            ([0, row], [right, -ahead * up.signum()])
        } else if right.abs() == largest {
            let side = if right > 0.0 { 1 } else { columns - 1 };
            ([side, 1], [-ahead * right.signum(), up])
        } else if ahead > 0.0 {
            ([0, 1], [right, up])
        } else if self.is_upright {
            ([0, 3], [right, -up])
        } else {
            ([2, 1], [-right, up])
        };
        let column = (self.ahead + column) % columns;
        let edge = self.edge as f64;
        // Faces end at the middles of their outermost pixels: beyond lies what is elsewhere.
        let on_face = |cell: usize, v: f64| {
            let within = (0.5 * edge * (1.0 + v / largest)).clamp(0.5, edge - 0.5);
            cell as f64 * edge + within
        };
        [on_face(column, x), on_face(row, -y)]
    }
}

/// Empty pixels: of one colour.
struct Empty {
    tolerance: f32,
}

impl Empty {
    fn of(picture: &EnvironmentMap) -> Self {
        let brightness = picture.pixels.iter().map(|p| luminance(*p)).collect();
        Self {
            tolerance: EMPTY * quantile(brightness, LIT).unwrap_or(0.0),
        }
    }

    /// True where all pixels are empty; there is at least one.
    fn are<'a>(&self, mut pixels: impl Iterator<Item = &'a [f32; 3]>) -> bool {
        let Some(first) = pixels.next() else {
            return false;
        };
        let (mut low, mut high) = (*first, *first);
        pixels.all(|pixel| {
            low = std::array::from_fn(|c| low[c].min(pixel[c]));
            high = std::array::from_fn(|c| high[c].max(pixel[c]));
            (0..3).all(|c| high[c] - low[c] <= self.tolerance)
        })
    }

    /// True where all around the disc in the image is empty, and not the disc.
    fn around_disc(picture: &EnvironmentMap) -> bool {
        let radius = 0.5 * picture.width as f64;
        let off = |v: usize| v as f64 + 0.5 - radius;
        let is_outside = |x: usize, y: usize| off(x).hypot(off(y)) > radius + 1.0;
        let pixels = picture.pixels.iter().enumerate();
        let outside = pixels.filter(|(i, _)| is_outside(i % picture.width, i / picture.width));
        let outside = outside.map(|(_, pixel)| pixel);
        let empty = Self::of(picture);
        empty.are(outside) && !empty.are(picture.pixels.iter())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::Vec3;

    /// A sky that differs everywhere, and smoothly.
    fn sky(d: DVec3) -> [f32; 3] {
        [1.2 + d.x, 1.1 + d.y, 1.3 + d.z].map(|v| (0.3 * v * v) as f32)
    }

    /// A picture of what is all around, by the direction at each place, right and down from the upper left corner; black where there is none.
    fn picture(
        width: usize,
        height: usize,
        direction: impl Fn(f64, f64) -> Option<DVec3>,
    ) -> EnvironmentMap {
        let pixel = |i: usize| {
            let at = [i % width, i / width].map(|v| v as f64 + 0.5);
            direction(at[0], at[1]).map_or([0.0; 3], |d| sky(d.normalize()))
        };
        EnvironmentMap::new(width, height, (0..width * height).map(pixel).collect())
    }

    /// Faces by column and row, told one by one: what is ahead, to its right and up.
    fn cross(columns: usize, rows: usize, faces: &[([usize; 2], [DVec3; 3])]) -> EnvironmentMap {
        let edge = 32.0;
        picture(columns * 32, rows * 32, |x, y| {
            let cell = [x, y].map(|v| (v / edge) as usize);
            let (_, [ahead, right, up]) = faces.iter().find(|(at, _)| *at == cell)?;
            let [right_by, down_by] = [x, y].map(|v| 2.0 * (v / edge).fract() - 1.0);
            Some(*ahead + *right * right_by - *up * down_by)
        })
    }

    fn check(picture: &EnvironmentMap, told: Option<Layout>, expected: Layout, within: f32) {
        let panorama = picture.clone().laid_out(told).expect("it has the shape");
        assert_eq!(panorama.layout(), expected);
        assert_eq!(panorama.width(), 2 * panorama.height());
        for i in 0..500 {
            let (z, turn) = (1.0 - (i as f64 + 0.5) / 250.0, 2.4 * i as f64);
            let flat = (1.0 - z * z).sqrt();
            let d = DVec3::new(flat * turn.cos(), flat * turn.sin(), z);
            // Straight behind is the whole rim of a disc.
            if d.x < -0.97 && expected != Layout::CubeCross {
                continue;
            }
            let (found, wanted) = (panorama.sample(d.as_vec3()), sky(d));
            for c in 0..3 {
                assert!(
                    (found[c] - wanted[c]).abs() < within,
                    "{expected:?} {d}: {found:?} {wanted:?}"
                );
            }
        }
    }

    #[test]
    fn a_cross_is_known_by_its_empty_squares_however_it_lies() {
        let (x, y, z) = (DVec3::X, DVec3::Y, DVec3::Z);
        // What is to the right of +X is -Y.
        let around = [[x, -y, z], [-y, -x, z], [-x, y, z], [y, x, z]];
        for ahead in 0..4 {
            let mut faces: Vec<_> = (0..4).map(|i| ([(ahead + i) % 4, 1], around[i])).collect();
            faces.push(([ahead, 0], [z, -y, -x]));
            faces.push(([ahead, 2], [-z, -y, x]));
            check(&cross(4, 3, &faces), None, Layout::CubeCross, 0.03);
        }
        let upright = [
            ([1, 1], around[0]),
            ([2, 1], around[1]),
            ([0, 1], around[3]),
            ([1, 0], [z, -y, -x]),
            ([1, 2], [-z, -y, x]),
            // Upside down.
            ([1, 3], [-x, -y, -z]),
        ];
        check(&cross(3, 4, &upright), None, Layout::CubeCross, 0.03);
    }

    #[test]
    fn a_disc_is_an_angular_map_unless_it_is_told_to_be_a_mirror_ball() {
        let size = 128;
        let on_disc = |x: f64, y: f64| {
            let [right, up] = [2.0 * x / 128.0 - 1.0, 1.0 - 2.0 * y / 128.0];
            let r = right.hypot(up);
            (r <= 1.0).then_some((right, up, r))
        };
        let probe = picture(size, size, |x, y| {
            let (right, up, r) = on_disc(x, y)?;
            let (sin, cos) = (PI * r).sin_cos();
            Some(DVec3::new(cos, -right * sin / r, up * sin / r))
        });
        check(&probe, None, Layout::AngularMap, 0.05);
        let ball = picture(size, size, |x, y| {
            let (right, up, r) = on_disc(x, y)?;
            // A camera far off on +X, whose right is +Y.
            let n = DVec3::new((1.0 - r * r).sqrt(), right, up);
            Some(2.0 * n.x * n - DVec3::X)
        });
        check(&ball, Some(Layout::MirrorBall), Layout::MirrorBall, 0.08);
        // What its corners show is no part of it, and a photograph is not cut to the pixel.
        let told = ball.laid_out(None).expect("a disc");
        assert_eq!(told.layout(), Layout::AngularMap);
    }

    #[test]
    fn other_pictures_are_panoramas_and_what_has_another_shape_is_refused() {
        for (width, height) in [(128, 64), (128, 96), (96, 128), (64, 64), (5, 3)] {
            let panorama = EnvironmentMap::of_directions(width, height, sky);
            let read = panorama.clone().laid_out(None).expect("any shape");
            assert_eq!(read.layout(), Layout::Equirectangular);
            assert_eq!(read.pixels(), panorama.pixels());
        }
        let map = EnvironmentMap::of_directions(128, 64, sky);
        for told in [Layout::CubeCross, Layout::AngularMap, Layout::MirrorBall] {
            let refused = map.clone().laid_out(Some(told));
            assert!(matches!(refused, Err(Error::Mismatch(_))), "{told:?}");
        }
        // Nor is a square panorama with a sun, beside which all else is black, a disc.
        let sun = |d: DVec3| sky(d).map(|v| if d.z > 0.99 { 1e5 } else { v });
        let square = EnvironmentMap::of_directions(64, 64, sun);
        assert_eq!(Layout::of_shape(&square), Layout::Equirectangular);
        // Black and even pictures are no cross and no disc.
        for value in [0.0, 1.0] {
            for size in [[4, 3], [3, 4], [2, 2], [1, 1]] {
                let blank =
                    EnvironmentMap::new(size[0], size[1], vec![[value; 3]; size[0] * size[1]]);
                let read = blank.laid_out(None).expect("any shape");
                assert_eq!(read.layout(), Layout::Equirectangular);
            }
        }
        // A pixel a face of one colour is one.
        let mut least = EnvironmentMap::new(4, 3, vec![[0.0; 3]; 12]);
        for i in [1, 4, 5, 6, 7, 9] {
            least.pixels[i] = [1.0; 3];
        }
        let all = least.laid_out(None).expect("a cross");
        assert_eq!(all.layout(), Layout::CubeCross);
        assert_eq!(all.sample(Vec3::NEG_Z), [1.0; 3]);
    }
}
