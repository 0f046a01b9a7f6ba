//! Transmittance between a surfel and a direction through translucent layers, as a camera sees them.

use std::ops::{Mul, Range, Sub};
use std::sync::OnceLock;

use fearless_simd::prelude::*;
use fearless_simd::{Level, dispatch, f32x8, u32x8};
use glam::{Vec2, Vec3};
use multiversion::multiversion;
use obvhs::aabb::Aabb;

use super::hierarchy::{
    Ellipses, Hierarchy, LEAST_FACING, PACKET, Ray, Stack, WIDE, Wide, ellipse_box, thinning,
};
use super::scaled::ScaledObject;
use crate::morton::neighborhood_order;
use crate::surfels::SurfelCloud;

/// A surfel ends where its opacity falls below this: many that are fainter make a surface together, and each costs time.
pub(crate) const LEAST_OPACITY: f32 = 0.1;

/// It never reaches farther than this many standard deviations.
pub(crate) const MOST_REACH: f32 = 2.0;

/// A ray of which less than this is left is done.
const DARK: f32 = 0.01;

/// A surfel with its soft rim.
#[derive(Clone, Copy, Debug)]
struct TranslucentLayer {
    center: Vec3,
    normal: Vec3,
    /// Unit tangents over the standard deviations.
    inverse_axes: [Vec3; 2],
    opacity: f32,
    /// Squared standard deviations at which it ends.
    reach_squared: f32,
    surfel: u32,
}

impl TranslucentLayer {
    /// Where it ends along its axes.
    fn half_axes(&self) -> [Vec3; 2] {
        let reach = self.reach_squared.sqrt();
        self.inverse_axes.map(|a| a * (reach / a.length_squared()))
    }
}

/// The surfels of an asset as a camera sees them.
#[derive(Debug)]
pub(super) struct TranslucentLayers {
    /// Translucent layer of each surfel; those that cover nothing reach nowhere. `[n]`
    of: Vec<TranslucentLayer>,
    boxes: OnceLock<Boxes>,
    /// Centres in units of the object's radius. `[n]`
    pub positions: Vec<Vec3>,
    /// Length of these units, in scene units.
    pub radius: f32,
    /// Indices of the surfels so that neighbours follow each other. `[n]`
    pub order: Vec<u32>,
}

/// Layers that cover anything, in a hierarchy of boxes.
#[derive(Debug)]
struct Boxes {
    hierarchy: Hierarchy,
    /// By leaf.
    leaves: Vec<Leaf>,
}

/// The surfels of a leaf, side by side.
#[derive(Debug)]
struct Leaf {
    ellipses: Ellipses,
    opacity: Wide,
    reach_squared: Wide,
    surfel: [u32; WIDE],
}

impl Leaf {
    fn of(translucent_layers: &[&TranslucentLayer]) -> Self {
        let of = |value: fn(&TranslucentLayer) -> f32| {
            std::array::from_fn(|k| {
                translucent_layers
                    .get(k)
                    .map_or(0.0, |translucent_layer| value(translucent_layer))
            })
        };
        let each = translucent_layers
            .iter()
            .map(|v| (v.center, v.normal, v.inverse_axes));
        Self {
            ellipses: Ellipses::new(each),
            opacity: of(|translucent_layer| translucent_layer.opacity),
            reach_squared: of(|translucent_layer| translucent_layer.reach_squared),
            surfel: std::array::from_fn(|k| {
                translucent_layers
                    .get(k)
                    .map_or(0, |translucent_layer| translucent_layer.surfel)
            }),
        }
    }
}

impl TranslucentLayers {
    pub fn new(cloud: &SurfelCloud) -> Self {
        let object = ScaledObject::new(cloud);
        let positions: Vec<Vec3> = object.surfels.iter().map(|s| s.position).collect();
        let translucent_layer = |i: usize| {
            let opacity = cloud.opacities[i];
            let [u, v] = cloud.tangents[i];
            // Larger ones are planes all the same, and the square of their inverse is 0.
            let scale = (cloud.scales[i] / object.radius).min(Vec2::splat(1e9));
            let reach_squared = (2.0 * (opacity / LEAST_OPACITY).ln()).min(MOST_REACH * MOST_REACH);
            // A line or a point covers nothing.
            let covers = reach_squared > 0.0 && scale.min_element() >= 1e-9;
            TranslucentLayer {
                center: positions[i],
                normal: u.cross(v),
                inverse_axes: [u / scale.x, v / scale.y],
                opacity,
                reach_squared: if covers { reach_squared } else { 0.0 },
                surfel: i as u32,
            }
        };
        Self {
            of: (0..cloud.len()).map(translucent_layer).collect(),
            boxes: OnceLock::new(),
            order: neighborhood_order(&positions),
            radius: object.radius,
            positions,
        }
    }

    /// Built where rays are asked for.
    fn boxes(&self) -> &Boxes {
        self.boxes.get_or_init(|| {
            let cover = self
                .of
                .iter()
                .filter(|translucent_layer| translucent_layer.reach_squared > 0.0);
            let (all, boxes): (Vec<&TranslucentLayer>, Vec<Aabb>) = cover
                .map(|translucent_layer| {
                    (
                        translucent_layer,
                        ellipse_box(translucent_layer.center, translucent_layer.half_axes()),
                    )
                })
                .unzip();
            // Each that is kept lets through what those do together that it stands for.
            let thinning = thinning(&boxes);
            let boxes: Vec<Aabb> = boxes.into_iter().step_by(thinning).collect();
            let kept =
                all.into_iter()
                    .step_by(thinning)
                    .map(|translucent_layer| TranslucentLayer {
                        opacity: match thinning {
                            1 => translucent_layer.opacity,
                            many => 1.0 - (1.0 - translucent_layer.opacity).powi(many as i32),
                        },
                        ..*translucent_layer
                    });
            let all: Vec<TranslucentLayer> = kept.collect();
            let (hierarchy, order) = Hierarchy::new(&boxes);
            let leaf = |things: Range<usize>| {
                let translucent_layers = order[things].iter().map(|i| &all[*i as usize]);
                Leaf::of(&translucent_layers.collect::<Vec<_>>())
            };
            let leaves = hierarchy.leaves().map(leaf).collect();
            Boxes { hierarchy, leaves }
        })
    }

    /// Transmittance of light from a direction far away to the centres of the surfels `of`, at most [`PACKET`], 0 to 1. `stack` is scratch.
    pub fn transmittance(&self, of: &[u32], direction: Vec3, stack: &mut Stack) -> [f32; PACKET] {
        let boxes = self.boxes();
        let mut through = [1.0; PACKET];
        dispatch!(Level::new(), simd => for (through, i) in through.iter_mut().zip(of) {
            let from = (*i, self.positions[*i as usize]);
            *through = transmittance(simd, boxes, from, direction, stack);
        });
        through
    }
}

/// Transmittance of the light from one direction, pixel by pixel: surfels are blended into it front to back, once each, as a rasterizer does, and
/// each finds there what reaches it. It costs their coverage, not the hits of each one's ray.
#[derive(Clone)]
pub(super) struct LightGrid {
    /// Pixels along an edge.
    edge: usize,
    /// Row by row, with room for a run behind each.
    left: Vec<f32>,
    /// Surfels from the front on: how far, and which.
    order: Vec<u64>,
}

/// Pixels along an edge of the finest grid.
const FINEST: f32 = 2048.0;

/// Pixels that are blended together.
const RUN: usize = 8;

impl LightGrid {
    /// Whose pixels are as large as most surfels' larger standard deviations, or twice as large; none where they would be larger still.
    pub fn resolving(translucent_layers: &TranslucentLayers) -> Option<Self> {
        let squared_size = |translucent_layer: &TranslucentLayer| {
            let [a, b] = translucent_layer.inverse_axes.map(Vec3::length_squared);
            1.0 / a.min(b)
        };
        let mut sizes: Vec<f32> = translucent_layers.of.iter().map(squared_size).collect();
        let middle = sizes.len() / 2;
        let typical = sizes.select_nth_unstable_by(middle, f32::total_cmp).1;
        let edge = 2.0 / typical.sqrt();
        (edge <= 2.0 * FINEST).then(|| Self::new(edge.clamp(64.0, FINEST) as usize))
    }

    fn new(edge: usize) -> Self {
        Self {
            edge,
            left: vec![1.0; edge * (edge + RUN)],
            order: Vec::new(),
        }
    }

    /// [`TranslucentLayers::transmittance`] of all, 255 is all of it. `[n]`
    pub fn transmittance(
        &mut self,
        translucent_layers: &TranslucentLayers,
        direction: Vec3,
    ) -> Vec<u8> {
        let nearest_first = |(i, translucent_layer): (usize, &TranslucentLayer)| {
            let behind = translucent_layer.center.dot(-direction).to_bits();
            // Ordered as the numbers are.
            let sign = if behind >> 31 == 1 { u32::MAX } else { 1 << 31 };
            u64::from(behind ^ sign) << 32 | i as u64
        };
        self.left.fill(1.0);
        self.order.clear();
        let each = translucent_layers.of.iter().enumerate();
        self.order.extend(each.map(nearest_first));
        self.order.sort_unstable();
        let mut through = vec![u8::MAX; translucent_layers.of.len()];
        let (right, down) = direction.any_orthonormal_pair();
        blend(
            self,
            &translucent_layers.of,
            [right, down, direction],
            &mut through,
        );
        through
    }
}

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn blend(
    LightGrid { edge, left, order }: &mut LightGrid,
    translucent_layers: &[TranslucentLayer],
    [right, down, direction]: [Vec3; 3],
    through: &mut [u8],
) {
    let (stride, last) = (*edge + RUN, *edge as f32);
    let scale = 0.5 * last;
    for entry in order {
        let i = *entry as u32 as usize;
        let translucent_layer = &translucent_layers[i];
        let middle = [right, down].map(|axis| (translucent_layer.center.dot(axis) + 1.0) * scale);
        // Nothing covers what lies far out.
        if middle.iter().all(|v| (0.0..last).contains(v)) {
            let [column, row] = middle.map(|v| v as usize);
            through[i] = (255.0 * left[row * stride + column]).round() as u8;
        }
        let (half, reach) = (
            translucent_layer.half_axes(),
            translucent_layer.reach_squared.sqrt(),
        );
        let [a, b] = half.map(|axis| [axis.dot(right) * scale, axis.dot(down) * scale]);
        let over = reach / (a[0] * b[1] - a[1] * b[0]);
        if translucent_layer.normal.dot(direction).abs() < LEAST_FACING || !over.is_finite() {
            continue;
        }
        // Pixels are covered where their middles are.
        let [columns, rows] = [0, 1].map(|i| {
            let extent = (a[i] * a[i] + b[i] * b[i]).sqrt();
            let from = (middle[i] - extent - 0.5).ceil().clamp(0.0, last);
            let to = (middle[i] + extent - 0.5).floor() + 1.0;
            from as usize..to.clamp(0.0, last) as usize
        });
        // Standard deviations by pixels.
        let [by_x, by_y] = [[b[1], -a[1]], [-b[0], a[0]]].map(|by| by.map(|v| v * over));
        for row in rows {
            let y = row as f32 + 0.5 - middle[1];
            for first in columns.clone().step_by(RUN) {
                let run: &mut [f32; RUN] = (&mut left[row * stride + first..][..RUN])
                    .try_into()
                    .expect("there is room for a run behind each row");
                let x = first as f32 + 0.5 - middle[0];
                for (lane, left) in run.iter_mut().enumerate() {
                    let x = x + lane as f32;
                    let (u, v) = (x * by_x[0] + y * by_y[0], x * by_x[1] + y * by_y[1]);
                    let off = u * u + v * v;
                    let met = off <= translucent_layer.reach_squared;
                    *left *= 1.0
                        - if met {
                            translucent_layer.opacity * falloff(1.0, off)
                        } else {
                            0.0
                        };
                }
            }
        }
    }
}

/// exp(-off / 2) to 2 % of the peak, without the exponential; of one or of several.
#[inline(always)]
fn falloff<T: Copy + Mul<Output = T> + Mul<f32, Output = T> + Sub<Output = T>>(
    one: T,
    off: T,
) -> T {
    let mut falloff = one - off * (1.0 / 32.0);
    for _ in 0..4 {
        falloff = falloff * falloff;
    }
    falloff
}

/// Transmittance of the light from a direction at a surfel.
#[inline(always)]
fn transmittance<S: Simd>(
    simd: S,
    Boxes { hierarchy, leaves }: &Boxes,
    (surfel, position): (u32, Vec3),
    direction: Vec3,
    stack: &mut Stack,
) -> f32 {
    let ray = Ray::new(simd, position, direction, 0.0);
    let [zero, one] = [0.0, 1.0].map(|v| f32x8::splat(simd, v));
    let own = u32x8::splat(simd, surfel);
    let mut through = 1.0;
    hierarchy.enter(stack);
    while let Some(leaf) = hierarchy.next_leaf(&ray, f32::MAX, stack) {
        let leaf = &leaves[leaf];
        let meeting = leaf.ellipses.meet(&ray);
        let reach = simd.load_array_ref_f32x8(&leaf.reach_squared);
        let others = !simd.load_array_ref_u32x8(&leaf.surfel).simd_eq(own);
        let met = meeting.off.simd_le(reach)
            & meeting.distance.simd_gt(zero)
            // It is faced.
            & meeting.distance.simd_lt(f32::INFINITY)
            & others;
        if !met.any_true() {
            continue;
        }
        let blocked = simd.load_array_ref_f32x8(&leaf.opacity) * falloff(one, meeting.off);
        let left: [f32; WIDE] = (one - simd.select_f32x8(met, blocked, zero)).into();
        through *= left.into_iter().product::<f32>();
        if through < DARK {
            break;
        }
    }
    through
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::oracle;
    use crate::synthetic;

    #[test]
    fn it_is_what_all_surfels_between_let_through() {
        let mut cloud = synthetic::sphere_over_plate(300);
        for (i, o) in cloud.opacities.iter_mut().enumerate() {
            *o = 0.05 + 0.9 * ((i * 7 % 11) as f32 / 11.0);
            // No two in one plane: either may be in front of the other.
            cloud.positions[i].z += 0.02 * ((i * 5 % 13) as f32 / 13.0);
        }
        let translucent_layers = TranslucentLayers::new(&cloud);
        let mut stack = Vec::new();
        let (mut off, mut far, mut count) = (0f64, 0, 0);
        for d in [Vec3::Z, Vec3::new(0.48, -0.6, 0.64), -Vec3::Y] {
            for of in translucent_layers.order.chunks(PACKET) {
                let through = translucent_layers.transmittance(of, d, &mut stack);
                for (i, got) in of.iter().zip(through) {
                    let exact = oracle::transmittance(&cloud, *i as usize, d.as_dvec3());
                    let error = (f64::from(got) - exact).abs();
                    off += error;
                    far += usize::from(error > 0.2);
                    count += 1;
                }
            }
        }
        // The falloff is off by 2 %; what passes a rim may round to either side of it.
        assert!(off < 0.01 * f64::from(count), "{}", off / f64::from(count));
        assert!(far * 100 < count as usize, "{far} of {count}");
    }

    #[test]
    fn surfels_without_end_cover_as_planes() {
        let mut cloud = synthetic::sphere_over_plate(300);
        cloud.scales[0] = Vec2::splat(f32::MAX);
        cloud.scales[1].x = 1e25;
        let translucent_layers = TranslucentLayers::new(&cloud);
        for of in translucent_layers.order.chunks(PACKET) {
            let through = translucent_layers.transmittance(of, Vec3::Y, &mut Vec::new());
            assert!(through.iter().all(|t| (0.0..=1.0).contains(t)));
        }
    }

    #[test]
    fn on_a_grid_layers_cover_those_below_them_and_what_lies_far_out_nothing() {
        let mut cloud = synthetic::sheet(4);
        for layer in 1..3 {
            cloud.add(&synthetic::sheet(4), 1.0, -0.1 * layer as f32 * Vec3::Z);
        }
        cloud.add(&synthetic::sheet(1), 1.0, 50.0 * Vec3::X);
        cloud.opacities.fill(0.5);
        // Those of a sheet do not reach each other's middles.
        cloud.scales.iter_mut().for_each(|s| *s *= 0.3);
        let translucent_layers = TranslucentLayers::new(&cloud);
        let through = LightGrid::new(1024).transmittance(&translucent_layers, Vec3::Z);
        for (i, through) in through.iter().enumerate() {
            let expected = [255.0, 127.5, 63.75, 255.0][i / 16];
            // The middle of a pixel is off that of the surfel by half of one.
            assert!(
                (f32::from(*through) - expected).abs() < 6.0,
                "{i}: {through}"
            );
        }
    }

    #[test]
    fn no_grid_is_as_fine_as_an_object_that_is_small_in_what_lies_around_it() {
        let mut cloud = synthetic::sphere(3000);
        cloud.add(&synthetic::sphere(3000), 1e-4, Vec3::ZERO);
        cloud.add(&synthetic::sphere(3000), 1e-4, Vec3::X);
        assert!(LightGrid::resolving(&TranslucentLayers::new(&cloud)).is_none());
    }
}
