//! Diffuse surfels whose stored colour is a power of their light: relit by a factor, without quadrature.

use multiversion::multiversion;

use super::asset::{DirectionalCache, FrontAndBack};
use super::nodes::{QuadratureNodes, SurfelFrame};
use crate::color::Encoding;
use crate::color_rows::ColorRows;
use crate::lanes::{LANES, Lanes, mirror_of};
use crate::numeric::smoothstep;
use crate::sh::{SQRT_4PI, band, coefficient_count};

/// The back of a two-sided surfel changes by at most this factor more or less than its front.
pub const BACK_RANGE: f32 = 20.0;

/// Cosine to the horizon within which a two-sided surfel's sides blend.
pub const HORIZON: f32 = 0.2;

/// Added to both encoded brightnesses whose ratio scales the residual.
pub const RESIDUAL_FLOOR: f32 = 0.02;

/// Diffuse surfels of a transfer.
#[derive(Clone, Copy)]
pub(super) struct DiffuseSurfels<'a> {
    pub asset: &'a DirectionalCache,
    /// The least colour at the nodes in each channel. `[n]`
    pub darkest: &'a [[f32; 3]],
    /// Stored colour that the model of the source misses. `[n][K]`
    pub residual: &'a ColorRows,
    /// Mean encoded colour that the model has. `[n]`
    pub encoded_mean: &'a [[f32; 3]],
    /// True where the unexplained residual is kept, and true where backs have a light of their own.
    pub with_residual: bool,
    pub with_backs: bool,
}

/// Scratch for [`LANES`] surfels.
#[derive(Default)]
pub(super) struct BackLanes {
    /// Stored colour in the surfels' frames, so that light multiplies it, and what is added to it. `[3][K]` each
    stored: Vec<Lanes>,
    added: Vec<Lanes>,
    /// Factor of the colour at each height beyond the front's. `[3][2 heights]`
    factors: Vec<Lanes>,
}

impl DiffuseSurfels<'_> {
    /// Visible share of a surfel's back, where backs count.
    pub fn two_sided(&self, i: usize) -> f32 {
        if self.with_backs {
            self.asset.bake.two_sided[i]
        } else {
            0.0
        }
    }

    /// Relights a surfel where its stored colour is a power of its light, as if its back changed as its front does. Tells whether it did. `read`
    /// is what its residual is read by.
    pub fn multiply(
        &self,
        i: usize,
        (tau, two_sided): (FrontAndBack, f32),
        read: &mut Vec<[f32; 3]>,
        out: &mut [[f32; 3]],
    ) -> bool {
        let (asset, k) = (self.asset, out.len());
        let encoding = asset.encoding;
        let back = if two_sided > 0.0 {
            within_range(tau)
        } else {
            tau[0]
        };
        let is_power = |c: usize| {
            let [front, back] = [tau[0][c], back[c]];
            encoding.is_power(self.darkest[i][c], [front.min(back), front.max(back)])
        };
        if !(0..3).all(is_power) {
            return false;
        }
        let mut front = tau[0];
        encoding.gains(&mut front);
        let shift = encoding.shift();
        let stored = &asset.sh[i * k..][..k];
        let rest: [f32; 3] = std::array::from_fn(|c| {
            let then = self.encoded_mean[i][c];
            let now = then + (front[c] - 1.0) * (then + shift - encoding.offset());
            let kept = if self.with_residual {
                residual_scale(now, then)
            } else {
                0.0
            };
            kept - front[c]
        });
        for (o, (f, r)) in out
            .iter_mut()
            .zip(stored.iter().zip(self.residual.row(i, read)))
        {
            *o = std::array::from_fn(|c| front[c] * f[c] + rest[c] * r[c]);
        }
        for (o, g) in out[0].iter_mut().zip(front) {
            *o += (g - 1.0) * constant(encoding);
        }
        true
    }

    /// Adds what changes of surfels that were multiplied because their backs have a light of their own; `out` begins with surfel `first`.
    pub fn add_backs(
        &self,
        first: usize,
        tau: &[FrontAndBack],
        backs: &[usize],
        lanes: &mut BackLanes,
        out: &mut [[f32; 3]],
    ) {
        let asset = self.asset;
        let (nodes, encoding) = (&asset.nodes, asset.encoding);
        let k = coefficient_count(nodes.degree);
        let heights: Vec<f32> = nodes.heights().collect();
        let heights = || heights.iter().copied().chain(heights.iter().map(|z| -z));
        let rows = 2 * (nodes.degree + 1);
        for surfels in backs.chunks(LANES) {
            // The last one stands in for those that lack.
            let of = |lane: usize| surfels[lane.min(surfels.len() - 1)];
            let gather =
                |value: &dyn Fn(usize) -> f32| Lanes(std::array::from_fn(|j| value(of(j))));
            lanes.stored.clear();
            lanes.factors.clear();
            for c in 0..3 {
                let at = |q: usize| gather(&|i| asset.sh[i * k + q][c]);
                lanes.stored.extend((0..k).map(at));
                for v in &mut lanes.stored[c * k].0 {
                    *v += constant(encoding);
                }
                let front = gather(&|i| tau[i][0][c]);
                let back = gather(&|i| within_range(tau[i])[c]);
                let two_sided = gather(&|i| self.two_sided(i));
                lanes.factors.extend(heights().map(|z| {
                    Lanes(std::array::from_fn(|j| {
                        let share = share_of_back(two_sided.0[j], z);
                        front.0[j] + share * (back.0[j] - front.0[j])
                    }))
                }));
            }
            let mut front: [Lanes; 3] = std::array::from_fn(|c| gather(&|i| tau[i][0][c]));
            for values in lanes.factors.iter_mut().chain(&mut front) {
                encoding.gains(&mut values.0);
            }
            for (factors, front) in lanes.factors.chunks_exact_mut(rows).zip(front) {
                for f in factors {
                    *f = *f - front;
                }
            }
            let mirrors: [Lanes; 3] = std::array::from_fn(|axis| {
                gather(&|i| SurfelFrame::new(asset.bake.normals[i]).mirror[axis])
            });
            lanes.added.clear();
            lanes.added.resize(3 * k, Lanes::ZERO);
            by_height(nodes, mirrors, lanes);
            for (lane, i) in surfels.iter().enumerate() {
                for (q, o) in out[(i - first) * k..][..k].iter_mut().enumerate() {
                    for c in 0..3 {
                        o[c] += lanes.added[c * k + q].0[lane];
                    }
                }
            }
        }
    }
}

/// The first coefficient of the constant that makes stored colour a power of light; the fit has no other.
fn constant(encoding: Encoding) -> f32 {
    encoding.shift() * SQRT_4PI as f32
}

/// Adds the factors by height to the stored colour: all in the surfels' frames, and back.
#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn by_height(nodes: &QuadratureNodes, mirrors: [Lanes; 3], lanes: &mut BackLanes) {
    let (degree, k) = (nodes.degree, coefficient_count(nodes.degree));
    let mirror = mirror_of(degree, mirrors);
    let rows = 2 * (degree + 1);
    for c in 0..3 {
        let stored = &mut lanes.stored[c * k..][..k];
        let added = &mut lanes.added[c * k..][..k];
        for l in 1..=degree {
            mirror.reflect_band(l, &mut stored[band(l)]);
        }
        nodes.add_by_height(&lanes.factors[c * rows..][..rows], stored, added);
        for l in 1..=degree {
            mirror.reflect_band(l, &mut added[band(l)]);
        }
    }
}

/// The back's change, held to what is believed beside the front's.
pub(super) fn within_range([front, back]: FrontAndBack) -> [f32; 3] {
    std::array::from_fn(|c| back[c].clamp(front[c] / BACK_RANGE, front[c] * BACK_RANGE))
}

/// Share of the back's change in a view from that height over the front.
pub(super) fn share_of_back(two_sided: f32, height: f32) -> f32 {
    two_sided * smoothstep(-HORIZON, HORIZON, -height)
}

/// By how much the residual changes with the encoded brightness: in proportion when it falls, to nothing in the dark; less when it rises,
/// since what the source hardly lit is mostly noise.
pub(super) fn residual_scale(now: f32, then: f32) -> f32 {
    if now < then {
        now / then
    } else {
        (now + RESIDUAL_FLOOR) / (then + RESIDUAL_FLOOR)
    }
}
