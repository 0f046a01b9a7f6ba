//! SIMD lanes: many surfels or pixels at once as structure of arrays, compiled for several instruction sets.

use std::ops::{Add, Div, Mul, Neg, Sub};

use crate::sh::{Mirror, Real};

/// Values that are worked on at once.
pub(crate) const LANES: usize = 16;

/// One value of each.
#[derive(Clone, Copy, Debug)]
#[repr(align(64))]
pub(crate) struct Lanes(pub [f32; LANES]);

impl Lanes {
    pub const ZERO: Self = Self([0.0; LANES]);

    /// Broadcasts a value.
    #[inline(always)]
    pub const fn splat(x: f32) -> Self {
        Self([x; LANES])
    }

    /// The lower of each two; the other one of what is no number.
    #[inline(always)]
    pub fn min(self, other: Self) -> Self {
        self.map2(other, |a, b| if a < b { a } else { b })
    }

    /// `yes` where `self <= limit`, else `no`, and where either is no number.
    #[inline(always)]
    pub fn where_at_most(self, limit: Self, [yes, no]: [Self; 2]) -> Self {
        let mut out = no;
        for i in 0..LANES {
            out.0[i] = if self.0[i] <= limit.0[i] {
                yes.0[i]
            } else {
                no.0[i]
            };
        }
        out
    }

    #[inline(always)]
    pub fn map(self, f: impl Fn(f32) -> f32) -> Self {
        // `array::map` is not compiled for the caller's instructions.
        self.map2(self, |a, _| f(a))
    }

    #[inline(always)]
    pub fn map2(self, other: Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let mut out = [0.0; LANES];
        for i in 0..LANES {
            out[i] = f(self.0[i], other.0[i]);
        }
        Self(out)
    }
}

impl Add for Lanes {
    type Output = Self;
    #[inline(always)]
    fn add(self, other: Self) -> Self {
        self.map2(other, |a, b| a + b)
    }
}

impl Sub for Lanes {
    type Output = Self;
    #[inline(always)]
    fn sub(self, other: Self) -> Self {
        self.map2(other, |a, b| a - b)
    }
}

impl Mul for Lanes {
    type Output = Self;
    #[inline(always)]
    fn mul(self, other: Self) -> Self {
        self.map2(other, |a, b| a * b)
    }
}

impl Div for Lanes {
    type Output = Self;
    #[inline(always)]
    fn div(self, other: Self) -> Self {
        self.map2(other, |a, b| a / b)
    }
}

impl Neg for Lanes {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        self.map2(self, |a, _| -a)
    }
}

impl Real for Lanes {
    #[inline(always)]
    fn of(x: f64) -> Self {
        Self([x as f32; LANES])
    }
}

/// The mirrors of unit normals, for bands up to a degree.
#[inline(always)]
pub(crate) fn mirror_of(degree: usize, [x, y, z]: [Lanes; 3]) -> Mirror<Lanes> {
    let (mut cos, mut sin, mut sin_theta) = (Lanes::of(1.0), Lanes::ZERO, Lanes::ZERO);
    for i in 0..LANES {
        let r = (x.0[i] * x.0[i] + y.0[i] * y.0[i]).sqrt();
        sin_theta.0[i] = r;
        if r > 1e-12 {
            cos.0[i] = x.0[i] / r;
            sin.0[i] = y.0[i] / r;
        }
    }
    Mirror::new(degree, (cos, sin), (z, sin_theta))
}
