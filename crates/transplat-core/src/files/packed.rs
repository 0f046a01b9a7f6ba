//! Numbers in few bits, as packed splats store them.

use std::f32::consts::{FRAC_1_SQRT_2, SQRT_2};

use crate::sh::SQRT_4PI;

/// A share of 0 to 1 in so many bits.
pub(super) fn share(code: u32, bits: u32) -> f32 {
    code as f32 / ((1u64 << bits) - 1) as f32
}

/// The code of a share; what is outside of 0 to 1 is held to it.
pub(super) fn share_code(share: f32, bits: u32) -> u32 {
    let most = ((1u64 << bits) - 1) as f32;
    (share.clamp(0.0, 1.0) * most).round() as u32
}

/// A unit quaternion of which the largest component is left out: the other three are in ascending order of their index.
pub(super) fn with_largest(largest: usize, others: [f32; 3]) -> [f32; 4] {
    let rest = 1.0 - others.iter().map(|v| v * v).sum::<f32>();
    let mut others = others.into_iter();
    std::array::from_fn(|i| {
        if i == largest {
            rest.max(0.0).sqrt()
        } else {
            others.next().unwrap_or_default()
        }
    })
}

/// The index of the largest component of a unit quaternion, and the other three, signed so that the largest is positive.
pub(super) fn without_largest(quaternion: [f32; 4]) -> (usize, [f32; 3]) {
    let larger = |a: usize, b: usize| {
        if quaternion[b].abs() > quaternion[a].abs() {
            b
        } else {
            a
        }
    };
    let largest = (1..4).fold(0, larger);
    let sign = quaternion[largest].signum();
    let mut others = (0..4).filter(|i| *i != largest);
    let others = std::array::from_fn(|_| sign * quaternion[others.next().unwrap_or_default()]);
    (largest, others)
}

/// A component that is not the largest, which is at most the root of one half, from a share.
pub(super) fn component(share: f32) -> f32 {
    (share - 0.5) * SQRT_2
}

/// The share of such a component.
pub(super) fn component_share(component: f32) -> f32 {
    component * FRAC_1_SQRT_2 + 0.5
}

/// The logit of an opacity; those of nothing and of everything are infinite, as they should be.
pub(super) fn logit(opacity: f32) -> f32 {
    (opacity / (1.0 - opacity)).ln()
}

/// The lowest SH coefficient of a colour that is shown.
pub(super) fn dc_of_color(color: f32) -> f32 {
    (color - 0.5) * SQRT_4PI as f32
}

/// The colour that is shown for the lowest SH coefficient.
pub(super) fn color_of_dc(dc: f32) -> f32 {
    dc / SQRT_4PI as f32 + 0.5
}

/// Numbers of a row, one after the other; the row is long enough.
pub(super) struct Fields<'a>(pub &'a [u8]);

impl Fields<'_> {
    pub fn u8(&mut self) -> u8 {
        u8::from_le_bytes(self.bytes())
    }

    pub fn u16(&mut self) -> u16 {
        u16::from_le_bytes(self.bytes())
    }

    pub fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.bytes())
    }

    pub fn f32(&mut self) -> f32 {
        f32::from_le_bytes(self.bytes())
    }

    pub fn f16(&mut self) -> f32 {
        half::f16::from_le_bytes(self.bytes()).to_f32()
    }

    /// So many numbers.
    pub fn each<T, const N: usize>(&mut self, read: impl Fn(&mut Self) -> T) -> [T; N] {
        std::array::from_fn(|_| read(self))
    }

    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        let (bytes, rest) = self.0.split_first_chunk().expect("a row is long enough");
        self.0 = rest;
        *bytes
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_quaternion_comes_back_whichever_component_is_left_out() {
        for i in 0..200u32 {
            let v: [f32; 4] = std::array::from_fn(|c| ((i * 7 + c as u32 * 13) as f32).sin());
            let length = v.iter().map(|v| v * v).sum::<f32>().sqrt();
            let v = v.map(|v| v / length);
            let (largest, others) = without_largest(v);
            let back = with_largest(largest, others.map(|o| component(component_share(o))));
            let dot: f32 = v.iter().zip(back).map(|(a, b)| a * b).sum();
            assert!(dot.abs() > 1.0 - 1e-6, "{v:?} {back:?}");
        }
    }

    #[test]
    fn shares_and_colors_come_back() {
        for code in 0..1024 {
            assert_eq!(share_code(share(code, 10), 10), code);
        }
        assert_eq!([share_code(-3.0, 8), share_code(7.0, 8)], [0, 255]);
        assert!((color_of_dc(dc_of_color(0.3)) - 0.3).abs() < 1e-6);
    }
}
