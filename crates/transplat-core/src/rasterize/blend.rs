//! Blending of surfels over a tile, nearest first, a row of its pixels at once.

use multiversion::multiversion;

use super::project::{ProjectedSurfel, hit};
use crate::lanes::{LANES, Lanes};
use crate::numeric::over;

/// Edge of a tile in pixels: a row is blended at once.
pub(crate) const TILE: usize = LANES;

/// A pixel is finished when less than this would pass through.
const MIN_TRANSMITTANCE: f32 = 1e-4;

/// Attributes of a tile of colours, whose depth is the mean of all that is seen. That of others is the depth of the surface in front.
const COLORS: usize = 3;

/// Transmittance from which on what comes next is in front.
const HALF: f32 = 0.5;

/// A row of pixels.
#[derive(Clone, Copy)]
struct PixelRow<const N: usize> {
    color: [Lanes; N],
    depth: Lanes,
    /// Weight of what the depth is the sum of.
    depth_weight: Lanes,
    transmittance: Lanes,
    /// 1 where more may come, else 0.
    open: Lanes,
}

impl<const N: usize> PixelRow<N> {
    const EMPTY: Self = Self {
        color: [Lanes::ZERO; N],
        depth: Lanes::ZERO,
        depth_weight: Lanes::ZERO,
        transmittance: Lanes::splat(1.0),
        open: Lanes::splat(1.0),
    };

    /// Pixels to which something may be added, a bit each.
    #[inline(always)]
    fn open(&self) -> u16 {
        let mut bits = 0;
        for (x, open) in self.open.0.iter().enumerate() {
            bits |= u16::from(*open > 0.0) << x;
        }
        bits
    }

    /// Blends a surfel behind what is there; the pixels are `(x, y)` from the surfel's origin.
    #[inline(always)]
    fn blend<const GAUSSIAN: bool>(
        &mut self,
        (surfel, color): &TileSplat<'_, N>,
        x: Lanes,
        y: f32,
        near: f32,
    ) {
        let (alpha, depth) = hit::<GAUSSIAN>(surfel, near, x, y);
        let weight = alpha * self.open * self.transmittance;
        let through = self.transmittance - weight;
        let least = Lanes::splat(MIN_TRANSMITTANCE);
        let if_open = |of| least.where_at_most(through, of);
        let weight = if_open([weight, Lanes::ZERO]);
        self.open = if_open([self.open, Lanes::ZERO]);
        let front = if N == COLORS {
            weight
        } else {
            // What shines through from behind the surface does not count.
            Lanes::splat(HALF).where_at_most(self.transmittance, [weight, Lanes::ZERO])
        };
        self.transmittance = self.transmittance - weight;
        for (sum, c) in self.color.iter_mut().zip(color) {
            *sum = *sum + weight * Lanes::splat(*c);
        }
        self.depth = self.depth + front * depth;
        if N != COLORS {
            self.depth_weight = self.depth_weight + front;
        }
    }
}

/// A surfel with its colour, or what else is blended like one.
pub(super) type TileSplat<'a, const N: usize> = (&'a ProjectedSurfel, [f32; N]);

/// A part of the picture.
pub(crate) struct Tile<const N: usize> {
    rows: [PixelRow<N>; TILE],
    /// [`PixelRow::open`] of each, as it was last looked at.
    open: [u16; TILE],
    /// Position of its first pixel in the image.
    corner: [usize; 2],
    /// Pixels that places are told by.
    grain: usize,
}

impl<const N: usize> Tile<N> {
    /// One at a place of a picture of a size, in which places are told by so many pixels.
    pub(super) fn new(corner: [usize; 2], size: [usize; 2], grain: usize) -> Self {
        let mut rows = [PixelRow::EMPTY; TILE];
        let inside = [0, 1].map(|i| (size[i] - corner[i]).min(TILE));
        for (y, row) in rows.iter_mut().enumerate() {
            for (x, open) in row.open.0.iter_mut().enumerate() {
                if x >= inside[0] || y >= inside[1] {
                    *open = 0.0;
                }
            }
        }
        let mut tile = Self {
            rows,
            open: [0; TILE],
            corner,
            grain,
        };
        tile.note_open();
        tile
    }

    /// True where nothing can be added any more.
    pub(super) fn is_finished(&self) -> bool {
        self.open == [0; TILE]
    }

    /// True where a surfel may add something.
    #[inline(always)]
    pub(super) fn takes(&self, touches: [u16; 4]) -> bool {
        let ([top, bottom], columns) = self.touched(touches);
        let mut open = 0;
        for row in &self.open[top..=bottom] {
            open |= row & columns;
        }
        open != 0
    }

    /// First and last row in the tile that a surfel touches, and the columns, a bit each.
    #[inline(always)]
    fn touched(&self, [x0, y0, x1, y1]: [u16; 4]) -> ([usize; 2], u16) {
        let pixel = |edge: u16| usize::from(edge) * self.grain;
        let first = |edge: u16, i: usize| pixel(edge).saturating_sub(self.corner[i]);
        let last = |edge: u16, i: usize| (first(edge, i) + self.grain - 1).min(TILE - 1);
        let columns = (2u32 << last(x1, 0)) - (1 << first(x0, 0));
        ([first(y0, 1), last(y1, 1)], columns as u16)
    }

    fn note_open(&mut self) {
        self.open = std::array::from_fn(|y| self.rows[y].open());
    }

    /// Blends surfels behind what is there, nearest first; nothing is seen nearer than `near`.
    pub(super) fn blend(&mut self, splats: &[TileSplat<'_, N>], near: f32) {
        blend(self, splats, near);
        self.note_open();
    }

    /// Premultiplied colour, alpha, and depth of a pixel; 0 where nothing is.
    pub fn pixel(&self, x: usize, y: usize) -> ([f32; N], f32, f32) {
        let row = &self.rows[y];
        let color = row.color.map(|lanes| lanes.0[x]);
        let alpha = 1.0 - row.transmittance.0[x];
        let weight = if N == COLORS {
            alpha
        } else {
            row.depth_weight.0[x]
        };
        (color, alpha, over(row.depth.0[x], weight))
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn blend<const N: usize>(tile: &mut Tile<N>, splats: &[TileSplat<'_, N>], near: f32) {
    for splat in splats {
        let surfel = splat.0;
        let ([top, bottom], columns) = tile.touched(surfel.touches);
        let [x, y] = tile.corner.map(|edge| edge as f32);
        let (x, y) = (x - surfel.origin.x, y - surfel.origin.y);
        let x = Lanes(std::array::from_fn(|i| x + i as f32));
        for at in top..=bottom {
            if tile.open[at] & columns == 0 {
                continue;
            }
            let (row, y) = (&mut tile.rows[at], y + at as f32);
            if surfel.is_gaussian() {
                row.blend::<true>(splat, x, y, near);
            } else {
                row.blend::<false>(splat, x, y, near);
            }
        }
    }
}
