//! LUT: display-encoded colour in, display-encoded colour out.

/// A table over a part of the line of each channel, or over the cube of all three.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// Entries along an edge; at least 2.
    pub size: usize,
    /// Input of the first entry, by channel.
    pub from: [f32; 3],
    /// Input of the last entry; above `from`.
    pub to: [f32; 3],
    /// `[size]`, or `[size, size, size]` with red running fastest.
    pub entries: Vec<[f32; 3]>,
}

/// A grade: a curve a channel, then a table of colours; either may be missing.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Lut {
    /// Each channel by itself.
    pub curves: Option<Table>,
    /// All three together.
    pub cube: Option<Table>,
    /// Remarks on the file for the user: what was assumed or skipped.
    pub warnings: Vec<String>,
}

impl Lut {
    /// The colour that stands for a colour; what lies outside a table is what lies at its border.
    pub fn apply(&self, mut color: [f32; 3]) -> [f32; 3] {
        if let Some(curves) = &self.curves {
            color = curves.along_channels(color);
        }
        if let Some(cube) = &self.cube {
            color = cube.within_cube(color);
        }
        color
    }
}

impl Table {
    /// The entry below a value, and how far it is from there to the next one.
    fn place(&self, color: [f32; 3], c: usize) -> (usize, f32) {
        let share = (color[c] - self.from[c]) / (self.to[c] - self.from[c]);
        let last = (self.size - 1) as f32;
        // What is no number is taken for the first entry.
        let at = if share > 0.0 {
            share.min(1.0) * last
        } else {
            0.0
        };
        let below = at.floor().min(last - 1.0);
        (below as usize, at - below)
    }

    fn along_channels(&self, color: [f32; 3]) -> [f32; 3] {
        std::array::from_fn(|c| {
            let (below, far) = self.place(color, c);
            let [low, high] = [below, below + 1].map(|i| self.entries[i][c]);
            low + (high - low) * far
        })
    }

    /// Tetrahedral interpolation: from the lowest corner of a cell to the highest along its edges, the channel that is farthest first.
    /// Greys stay on the diagonal, which trilinear interpolation does not keep.
    fn within_cube(&self, color: [f32; 3]) -> [f32; 3] {
        let places = [0, 1, 2].map(|c| self.place(color, c));
        let strides = [1, self.size, self.size * self.size];
        let mut at: usize = (0..3).map(|c| places[c].0 * strides[c]).sum();
        let mut order = [0, 1, 2];
        order.sort_by(|a, b| places[*b].1.total_cmp(&places[*a].1));
        let mut out = self.entries[at];
        for c in order {
            let last = self.entries[at];
            at += strides[c];
            let next = self.entries[at];
            for (out, (next, last)) in out.iter_mut().zip(next.iter().zip(last)) {
                *out += (next - last) * places[c].1;
            }
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube(size: usize, color: impl Fn([f32; 3]) -> [f32; 3]) -> Table {
        let share = |i: usize| i as f32 / (size - 1) as f32;
        let entry = |i: usize| {
            let [r, g, b] = [i % size, i / size % size, i / size / size];
            color([share(r), share(g), share(b)])
        };
        Table {
            size,
            from: [0.0; 3],
            to: [1.0; 3],
            entries: (0..size.pow(3)).map(entry).collect(),
        }
    }

    /// Whatever is linear comes out exactly, between the entries too; a table that turns the channels turns them.
    #[test]
    fn a_linear_table_is_its_formula() {
        let formula = |[r, g, b]: [f32; 3]| [0.1 + 0.5 * g, 0.2 * r + 0.3 * b, 1.0 - b];
        let lut = Lut {
            warnings: Vec::new(),
            curves: None,
            cube: Some(cube(5, formula)),
        };
        for color in [
            [0.0; 3],
            [1.0; 3],
            [0.13, 0.77, 0.5],
            [0.9, 0.1, 0.33],
            [0.26, 0.24, 0.25],
        ] {
            let (found, expected) = (lut.apply(color), formula(color));
            for c in 0..3 {
                assert!((found[c] - expected[c]).abs() < 1e-6, "{color:?} {found:?}");
            }
        }
        assert_eq!(lut.apply([-3.0, 7.0, f32::NAN]), formula([0.0, 1.0, 0.0]));
    }

    /// Of a table that is curved, greys are interpolated between greys alone.
    #[test]
    fn greys_stay_grey() {
        let squared = |[r, g, b]: [f32; 3]| [r * r, g * g, b * b];
        let lut = Lut {
            warnings: Vec::new(),
            curves: None,
            cube: Some(cube(4, squared)),
        };
        for i in 0..=50 {
            let [r, g, b] = lut.apply([i as f32 / 50.0; 3]);
            assert!((r - g).abs() < 1e-6 && (g - b).abs() < 1e-6);
        }
    }

    #[test]
    fn curves_come_first_and_over_their_own_range() {
        let curves = Table {
            size: 3,
            from: [0.0, 0.0, -1.0],
            to: [2.0, 1.0, 1.0],
            entries: vec![[0.0, 1.0, 0.2], [0.5, 0.5, 0.2], [1.0, 0.0, 1.0]],
        };
        let mut lut = Lut {
            warnings: Vec::new(),
            curves: Some(curves),
            cube: None,
        };
        assert_eq!(lut.apply([0.5, 0.25, 0.5]), [0.25, 0.75, 0.6]);
        lut.cube = Some(cube(2, |[r, g, b]| [g, b, r]));
        assert_eq!(lut.apply([0.5, 0.25, 0.5]), [0.75, 0.6, 0.25]);
    }
}
