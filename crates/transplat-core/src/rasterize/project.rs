//! Projection of a surfel onto the screen.

use glam::{Vec2, Vec3};

use crate::camera::Camera;
use crate::lanes::Lanes;
use crate::surfels::{MIN_ALPHA, SurfelCloud, Thickness};

/// A surfel never covers more than this.
pub const MAX_ALPHA: f32 = 0.99;

/// Variance, in pixels squared, that the low-pass adds to a 3D Gaussian on the screen.
pub const LOW_PASS_VARIANCE: f32 = 0.3;

/// Outside of the picture by more than this, a 3D Gaussian is projected as if it were there: its linear projection holds no longer.
pub const MARGIN: f32 = 1.3;

/// Where the opacity is compensated for the low-pass, at least this share of its square is left.
pub const LEAST_COMPENSATION: f32 = 2.5e-5;

/// Marks a 3D Gaussian in [`ProjectedSurfel::index`].
const GAUSSIAN: u32 = 1 << 31;

/// One surfel on the screen, as long as a cache line.
///
/// With `(x, y)` a pixel from `origin`, `(a, b, c) = to_plane[0] x + to_plane[1] y + to_plane[2]` is the homogeneous point of the surfel's plane
/// that is seen there: `(a, b) / c` in standard deviations, at the depth `1 / c`. A 3D Gaussian is on the screen a surfel parallel to it: there
/// `c` is 1.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(super) struct ProjectedSurfel {
    /// From pixels to the surfel's plane.
    pub to_plane: [Vec3; 3],
    /// A pixel near its middle: of a surfel, the centre of the screen-space low-pass.
    pub origin: Vec2,
    /// First column and row that it can touch, last column and row, in grains of the picture ([`grain`]).
    pub touches: [u16; 4],
    /// Peak opacity, 0 to 1.
    pub opacity: f32,
    /// Depth of the centre, in scene units.
    pub depth: f32,
    index: u32,
}

impl ProjectedSurfel {
    /// Index of the surfel.
    #[inline(always)]
    pub fn index(&self) -> usize {
        (self.index & !GAUSSIAN) as usize
    }

    /// True for a 3D Gaussian.
    #[inline(always)]
    pub fn is_gaussian(&self) -> bool {
        self.index & GAUSSIAN != 0
    }

    /// Surfel with others counted before it.
    pub(super) fn counted(self, before: usize) -> Self {
        let index = self.index + before as u32;
        Self { index, ..self }
    }

    /// Surfel with depths in a unit of which that of its own is `scale`.
    pub(super) fn scaled(self, scale: f32) -> Self {
        let depth = self.depth * scale;
        if scale == 1.0 || self.is_gaussian() {
            return Self { depth, ..self };
        }
        let to_plane = self.to_plane.map(|row| row / scale);
        Self {
            depth,
            to_plane,
            ..self
        }
    }

    /// Opacity and depth at a pixel, or `None` where it adds nothing.
    pub(super) fn at(&self, x: usize, y: usize, near: f32) -> Option<(f32, f32)> {
        let from = Vec2::new(x as f32, y as f32) - self.origin;
        let x = Lanes::splat(from.x);
        let (alpha, depth) = if self.is_gaussian() {
            hit::<true>(self, near, x, from.y)
        } else {
            hit::<false>(self, near, x, from.y)
        };
        let ([alpha, ..], [depth, ..]) = (alpha.0, depth.0);
        (alpha > 0.0).then_some((alpha, depth))
    }

    /// Sort key: nearest centre first, of equal ones the first.
    pub(super) fn order(&self, at: usize) -> u64 {
        // Positive floats sort as their bits do.
        u64::from(self.depth.to_bits()) << 32 | at as u64
    }
}

/// Opacity and depth of a surfel at pixels that are `(x, y)` from its origin; 0 opaque where it adds nothing. `GAUSSIAN`: it is a 3D one.
#[inline(always)]
pub(super) fn hit<const GAUSSIAN: bool>(
    s: &ProjectedSurfel,
    near: f32,
    x: Lanes,
    y: f32,
) -> (Lanes, Lanes) {
    let [column, row, middle] = &s.to_plane;
    let a = Lanes::splat(column.x) * x + Lanes::splat(row.x * y + middle.x);
    let b = Lanes::splat(column.y) * x + Lanes::splat(row.y * y + middle.y);
    let center = Lanes::splat(s.depth);
    let square = a * a + b * b;
    let (rho, depth) = if GAUSSIAN {
        (square, center)
    } else {
        let c = Lanes::splat(column.z) * x + Lanes::splat(row.z * y + middle.z);
        let depth = Lanes::splat(1.0) / c;
        let on_plane = square * (depth * depth);
        let low_pass = Lanes::splat(2.0) * (x * x + Lanes::splat(y * y));
        // Where the plane is seen edge-on, or is none at all, this is not a number and the low-pass is what there is.
        let choose = |of: [Lanes; 2]| on_plane.where_at_most(low_pass, of);
        (choose([on_plane, low_pass]), choose([depth, center]))
    };
    let alpha = Lanes::splat(s.opacity) * rho.map(exp_of_half);
    let alpha = alpha.min(Lanes::splat(MAX_ALPHA));
    let seen = Lanes::splat(MIN_ALPHA).where_at_most(alpha, [alpha, Lanes::ZERO]);
    (
        depth.where_at_most(Lanes::splat(near), [Lanes::ZERO, seen]),
        depth,
    )
}

/// `exp(-rho / 2)` of what is not negative, to 3e-6 of itself; 0 is 1, and what is far out next to nothing.
#[inline(always)]
fn exp_of_half(rho: f32) -> f32 {
    // Adding this rounds to an integer, in the lowest bits.
    const ROUND: f32 = 12_582_912.0;
    let power = rho * (-0.5 * std::f32::consts::LOG2_E);
    let power = if power > -100.0 { power } else { -100.0 };
    let shifted = power + ROUND;
    let rest = (power - (shifted - ROUND)) * std::f32::consts::LN_2;
    // Taylor's series, of at most half of ln 2.
    let series = 1.0 / 24.0 + rest * (1.0 / 120.0 + rest * (1.0 / 720.0));
    let series = 1.0 + rest * (1.0 + rest * (0.5 + rest * (1.0 / 6.0 + rest * series)));
    let exponent = shifted.to_bits().wrapping_sub(ROUND.to_bits()) << 23;
    f32::from_bits(series.to_bits().wrapping_add(exponent))
}

/// Pixels that places are told by: one, and more where a picture is so large that its columns or rows are no 16-bit numbers.
pub(super) fn grain(size: [usize; 2]) -> usize {
    size[0].max(size[1]).div_ceil(1 << 16).next_power_of_two()
}

/// Centre and half extents of the box around the ellipse `u^2 + v^2 = r2`; `None` where it reaches the camera's plane.
fn ellipse_box(t_u: Vec3, t_v: Vec3, t_w: Vec3, r2: f32) -> Option<(Vec2, Vec2)> {
    let t = Vec3::new(r2, r2, -1.0);
    let d = t.dot(t_w * t_w);
    if d > -1e-12 * t_w.z * t_w.z {
        return None;
    }
    let f = t / d;
    let center = Vec2::new(f.dot(t_u * t_w), f.dot(t_v * t_w));
    let square = Vec2::new(f.dot(t_u * t_u), f.dot(t_v * t_v));
    let half = (center * center - square).max(Vec2::splat(1e-8));
    Some((center, Vec2::new(half.x.sqrt(), half.y.sqrt())))
}

/// Projects one surfel, its axes that many times as long; `None` where it is behind the camera, off the screen or too faint.
#[inline]
pub(super) fn project_surfel(
    cloud: &SurfelCloud,
    camera: &Camera,
    index: usize,
    larger: f32,
) -> Option<ProjectedSurfel> {
    let opacity = cloud.opacities[index];
    if opacity <= MIN_ALPHA {
        return None;
    }
    let view = camera.view_from_world;
    let p = view * (cloud.positions[index] - camera.eye);
    if p.z <= camera.near {
        return None;
    }
    let [u, v] = cloud.tangents[index];
    let scales = larger * cloud.scales[index];
    let (a, b) = (view * (u * scales.x), view * (v * scales.y));
    let thickness = cloud.thicknesses[index];
    let (projected, low, high) = if thickness.is_flat() {
        project_flat(camera, p, [a, b], opacity)?
    } else {
        let c = view * (cloud.stored_normal(index) * (larger * thickness.sigma()));
        project_gaussian(camera, p, [a, b, c], opacity, thickness)?
    };
    let size = Vec2::new(camera.width as f32, camera.height as f32);
    let on_screen = high.cmpgt(Vec2::ZERO).all() && low.cmplt(size).all();
    let (first, last) = (low.ceil().max(Vec2::ZERO), high.min(size - 1.0));
    let grain = grain([camera.width, camera.height]);
    let touches = [first.x, first.y, last.x, last.y].map(|v| (v as usize / grain) as u16);
    // A speck between pixels touches none.
    let is_seen = on_screen && first.cmple(last).all();
    is_seen.then_some(ProjectedSurfel {
        touches,
        depth: p.z,
        index: projected.index | index as u32,
        ..projected
    })
}

/// A surfel in the camera's coordinates: centre, and half axes of one standard deviation.
fn project_flat(
    camera: &Camera,
    p: Vec3,
    [a, b]: [Vec3; 2],
    opacity: f32,
) -> Option<(ProjectedSurfel, Vec2, Vec2)> {
    let [cx, cy] = camera.principal_point();
    // With `s` the homogeneous point (u, v, 1) of its plane, a pixel is `(t_u.s, t_v.s) / t_w.s`.
    let t_w = Vec3::new(a.z, b.z, p.z);
    let t_u = camera.focal * Vec3::new(a.x, b.x, p.x) + cx * t_w;
    let t_v = camera.focal * Vec3::new(a.y, b.y, p.y) + cy * t_w;
    // Where alpha falls to 1/255: u^2 + v^2 = 2 ln(255 opacity).
    let r2 = 2.0 * (opacity / MIN_ALPHA).max(1.0001).ln();
    let (center, half) = ellipse_box(t_u, t_v, t_w, r2)?;
    let (low_pass, _) = ellipse_box(t_u, t_v, t_w, 9.0).unwrap_or((center, half));
    let reach = Vec2::splat((r2 / 2.0).sqrt());
    // The pixel's two planes meet the surfel's where all three rows of this are.
    let (t_u, t_v) = (t_u - low_pass.x * t_w, t_v - low_pass.y * t_w);
    let middle = t_u.cross(t_v);
    let scale = 1.0 / t_w.dot(middle);
    let to_plane = [t_v.cross(t_w), t_w.cross(t_u), middle].map(|row| row * scale);
    let is_plane = to_plane.iter().all(|row| row.is_finite());
    let projected = ProjectedSurfel {
        to_plane: if is_plane { to_plane } else { [Vec3::ZERO; 3] },
        origin: low_pass,
        opacity,
        ..ProjectedSurfel::default()
    };
    let low = (center - half).min(low_pass - reach);
    let high = (center + half).max(low_pass + reach);
    Some((projected, low, high))
}

/// A 3D Gaussian in the camera's coordinates: centre, and half axes of one standard deviation.
fn project_gaussian(
    camera: &Camera,
    p: Vec3,
    axes: [Vec3; 3],
    opacity: f32,
    thickness: Thickness,
) -> Option<(ProjectedSurfel, Vec2, Vec2)> {
    let limit = MARGIN * 0.5 * Vec2::new(camera.width as f32, camera.height as f32) / camera.focal;
    let slope = p.truncate() / p.z;
    let held = slope.clamp(-limit, limit);
    let to_pixels = camera.focal / p.z;
    // The axes on the screen: columns of the linear projection times the axes.
    let on_screen = axes.map(|axis| to_pixels * (axis.truncate() - held * axis.z));
    let [x, y] = [on_screen.map(|v| v.x), on_screen.map(|v| v.y)].map(Vec3::from_array);
    let (xx, xy, yy) = (x.length_squared(), x.dot(y), y.length_squared());
    // Without cancellation (Cauchy and Binet), however long and thin it is.
    let sharp = x.cross(y).length_squared();
    let determinant = sharp + LOW_PASS_VARIANCE * (xx + yy) + LOW_PASS_VARIANCE * LOW_PASS_VARIANCE;
    let (wide_x, wide_y) = (xx + LOW_PASS_VARIANCE, yy + LOW_PASS_VARIANCE);
    let opacity = if thickness.is_antialiased() {
        opacity * (sharp / determinant).max(LEAST_COMPENSATION).sqrt()
    } else {
        opacity
    };
    if opacity <= MIN_ALPHA || !determinant.is_finite() {
        return None;
    }
    let [cx, cy] = camera.principal_point();
    let center = camera.focal * slope + Vec2::new(cx, cy);
    let r2 = 2.0 * (opacity / MIN_ALPHA).max(1.0001).ln();
    let half = (r2 * Vec2::new(wide_x, wide_y)).map(f32::sqrt);
    // The inverse of a root of the covariance: it takes the ellipse to a disc.
    let (width, height) = (wide_x.sqrt(), (determinant / wide_x).sqrt());
    let projected = ProjectedSurfel {
        to_plane: [
            Vec3::new(1.0 / width, -xy / (wide_x * height), 0.0),
            Vec3::new(0.0, 1.0 / height, 0.0),
            Vec3::Z,
        ],
        origin: center,
        opacity,
        index: GAUSSIAN,
        ..ProjectedSurfel::default()
    };
    Some((projected, center - half, center + half))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_exponential_is_one() {
        for i in 0..4000 {
            let rho = i as f32 * 0.01;
            let (got, exact) = (exp_of_half(rho), (-0.5 * f64::from(rho)).exp());
            assert!((f64::from(got) / exact - 1.0).abs() < 3e-6, "{rho}: {got}");
        }
        assert_eq!(exp_of_half(0.0), 1.0);
        for far in [1e4, 1e30, f32::INFINITY] {
            assert!(exp_of_half(far) < 1e-20);
        }
    }

    #[test]
    fn it_fills_a_cache_line() {
        assert_eq!(size_of::<ProjectedSurfel>(), 64);
    }
}
