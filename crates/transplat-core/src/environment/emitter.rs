//! Near and area lights: their unshadowed irradiance on a surface.

use std::f64::consts::PI;

use glam::{Affine3A, DVec3, Vec3};

/// A light of one's own, in the coordinates of what it shines on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Emitter {
    /// Where it is, and how it spreads.
    pub shape: Shape,
    /// Linear RGB; the unit is the shape's.
    pub emission: [f32; 3],
}

/// Where a light is, and how it spreads what it emits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Shape {
    /// All around from a point; emission is intensity, W/sr.
    Point {
        /// Where.
        position: Vec3,
    },
    /// A cone from a point; emission is the intensity on its axis, W/sr.
    Spot {
        /// Where.
        position: Vec3,
        /// Unit vector along which it shines.
        axis: Vec3,
        /// Angle from the axis up to which it has its whole intensity, in radians.
        beam: f32,
        /// Angle from which on it has none, in radians; between them it falls linearly.
        cutoff: f32,
    },
    /// A parallelogram, or the ellipse in it, that shines on one side; emission is radiance, W/m²/sr.
    Area {
        /// Its middle.
        center: Vec3,
        /// From the middle to the middles of two of its edges.
        half: [Vec3; 2],
        /// Unit vector on the side where it shines.
        normal: Vec3,
        /// True where only the ellipse shines.
        is_round: bool,
    },
    /// From one direction, a disc as the sun is one; emission is the irradiance of a surface that faces it, W/m².
    Distant {
        /// Unit vector towards its middle.
        toward: Vec3,
        /// Angular radius of its disc, in radians.
        radius: f32,
    },
}

/// A place of a light as a surface sees it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sample {
    /// Unit vector towards it.
    pub direction: Vec3,
    /// Distance of the sample.
    pub distance: f32,
    /// Irradiance of a surface that faces it, for an emission of 1.
    pub strength: f32,
}

/// Samples along each edge of a light with an extent, where a few serve: one for each part.
pub const FEW: usize = 2;

/// Parts of a light with an extent, each mirrored as one: quarters.
pub const MOST_PARTS: usize = 4;

/// Lights of one's own at once, at most.
pub const MOST_LIGHTS: usize = 30;

/// Corners of the polygon that stands for a round light: its area is right, its edge to 0.3 %.
const CORNERS: usize = 24;

impl Shape {
    /// Number of samples with so many along each edge.
    pub fn samples(&self, across: usize) -> usize {
        if self.has_extent() {
            across * across
        } else {
            1
        }
    }

    /// Number of parts that a reflection distinguishes.
    pub fn parts(&self) -> usize {
        match self {
            Self::Area { .. } => MOST_PARTS,
            _ => 1,
        }
    }

    /// The part that a sample is of, with an even number of them along each edge.
    pub fn part_of(&self, sample: usize, across: usize) -> usize {
        let half = |i: usize| usize::from(i >= across / 2);
        match self {
            Self::Area { .. } => half(sample % across) + 2 * half(sample / across),
            _ => 0,
        }
    }

    /// True where an edge may cross it.
    pub fn has_extent(&self) -> bool {
        match self {
            Self::Point { .. } | Self::Spot { .. } => false,
            Self::Area { .. } => true,
            Self::Distant { radius, .. } => *radius > 0.0,
        }
    }

    /// A place of it as `at` sees that: the `sample`th of so many `across`, one of each square of its extent, moved within by `shift`, twice 0 to 1.
    /// A
    /// surface is no point: nothing is nearer to it than `nearest`.
    pub fn sample(
        &self,
        (sample, across): (usize, usize),
        shift: [f32; 2],
        at: Vec3,
        nearest: f32,
    ) -> Sample {
        let [column, row] = [sample % across, sample / across].map(|i| i as f32);
        let all = self.samples(across) as f32;
        let across = across as f32;
        let place = [(column + shift[0]) / across, (row + shift[1]) / across];
        match *self {
            Self::Point { position } => from_point(position, at, nearest),
            Self::Spot {
                position,
                axis,
                beam,
                cutoff,
            } => {
                let seen = from_point(position, at, nearest);
                let angle = (-seen.direction).angle_between(axis);
                let share = if angle <= beam {
                    1.0
                } else {
                    // Of one without a soft edge nothing is left beyond.
                    ((cutoff - angle) / (cutoff - beam).max(1e-9)).clamp(0.0, 1.0)
                };
                Sample {
                    strength: share * seen.strength,
                    ..seen
                }
            }
            Self::Area {
                center,
                half: [u, v],
                normal,
                is_round,
            } => {
                let [a, b] = if is_round {
                    on_disc(place)
                } else {
                    place.map(|p| 2.0 * p - 1.0)
                };
                let shape = if is_round { PI as f32 } else { 4.0 };
                let area = shape * u.cross(v).length();
                let seen = from_point(center + a * u + b * v, at, nearest);
                let cosine = (-seen.direction).dot(normal).max(0.0);
                let each = cosine * area / (across * across);
                Sample {
                    // Never more than a half space that shines.
                    strength: (each * seen.strength).min(PI as f32),
                    ..seen
                }
            }
            Self::Distant { toward, radius } => {
                let each = 1.0 / all;
                let [a, b] = on_disc(place).map(|p| p * radius.tan());
                let (u, v) = toward.any_orthonormal_pair();
                let offset = if radius > 0.0 {
                    a * u + b * v
                } else {
                    Vec3::ZERO
                };
                Sample {
                    direction: (toward + offset).normalize(),
                    distance: f32::MAX,
                    strength: each,
                }
            }
        }
    }

    /// Irradiance on the front and the back of a surface at a place with a unit normal that nothing blocks, for an emission of 1. Exact, where
    /// the sum of the samples is not: Lambert's formula for a polygon (Arvo 1994, "The Irradiance Jacobian").
    pub fn irradiance(&self, at: Vec3, normal: Vec3, nearest: f32) -> [f32; 2] {
        if let Self::Area {
            center,
            half,
            normal: lit,
            is_round,
        } = *self
        {
            if (at - center).dot(lit) <= 0.0 {
                return [0.0; 2];
            }
            let corners = corners(center.as_dvec3(), half.map(|h| h.as_dvec3()), is_round);
            let off = |corner: DVec3| corner - at.as_dvec3();
            let seen: Vec<DVec3> = corners.into_iter().map(off).collect();
            let n = normal.as_dvec3();
            return [n, -n].map(|n| of_polygon(&seen, n) as f32);
        }
        let mut sides = [0f32; 2];
        for k in 0..self.samples(FEW) {
            let seen = self.sample((k, FEW), [0.5; 2], at, nearest);
            let cosine = seen.direction.dot(normal);
            sides[usize::from(cosine < 0.0)] += cosine.abs() * seen.strength;
        }
        sides
    }

    /// Irradiance of a surface that faces it, nearly.
    pub fn facing(&self, at: Vec3, nearest: f32) -> f32 {
        let samples = 0..self.samples(FEW);
        let strength = |k| self.sample((k, FEW), [0.5; 2], at, nearest).strength;
        samples.map(strength).sum()
    }

    /// Light in other coordinates: rotated, moved, and scaled.
    pub fn moved(&self, to_other: Affine3A) -> Self {
        let turned = |v: Vec3| to_other.transform_vector3(v).normalize_or(Vec3::Z);
        let place = |p: Vec3| to_other.transform_point3(p);
        match *self {
            Self::Point { position } => Self::Point {
                position: place(position),
            },
            Self::Spot {
                position,
                axis,
                beam,
                cutoff,
            } => Self::Spot {
                position: place(position),
                axis: turned(axis),
                beam,
                cutoff,
            },
            Self::Area {
                center,
                half,
                normal,
                is_round,
            } => Self::Area {
                center: place(center),
                half: half.map(|h| to_other.transform_vector3(h)),
                normal: turned(normal),
                is_round,
            },
            Self::Distant { toward, radius } => Self::Distant {
                toward: turned(toward),
                radius,
            },
        }
    }
}

impl Emitter {
    /// Seen from other coordinates, as strong there as here: what falls off with the square of a distance counts that in their unit.
    pub fn moved(&self, to_other: Affine3A) -> Self {
        let scale = to_other.transform_vector3(Vec3::X).length();
        let gain = match self.shape {
            Shape::Point { .. } | Shape::Spot { .. } => scale * scale,
            Shape::Area { .. } | Shape::Distant { .. } => 1.0,
        };
        Self {
            shape: self.shape.moved(to_other),
            ..self.tinted([gain; 3])
        }
    }

    /// With each channel multiplied.
    pub fn tinted(&self, gain: [f32; 3]) -> Self {
        Self {
            emission: std::array::from_fn(|c| self.emission[c] * gain[c]),
            ..*self
        }
    }
}

/// Sample of a point light of intensity 1.
fn from_point(position: Vec3, at: Vec3, nearest: f32) -> Sample {
    let away = position - at;
    let distance = away.length();
    let counts = distance.max(nearest).max(1e-18);
    Sample {
        direction: away.try_normalize().unwrap_or(Vec3::Z),
        distance,
        strength: 1.0 / (counts * counts),
    }
}

/// From a square of edge 1 to the unit disc, equal areas to equal areas (Shirley and Chiu 1997).
fn on_disc(place: [f32; 2]) -> [f32; 2] {
    let [a, b] = place.map(|p| 2.0 * p - 1.0);
    if a == 0.0 && b == 0.0 {
        return [0.0; 2];
    }
    let quarter = std::f32::consts::FRAC_PI_4;
    let (radius, angle) = if a.abs() > b.abs() {
        (a, quarter * (b / a))
    } else {
        (b, 2.0 * quarter - quarter * (a / b))
    };
    [radius * angle.cos(), radius * angle.sin()]
}

/// Corners of a light, of a round one those of a polygon of its area.
fn corners(center: DVec3, [u, v]: [DVec3; 2], is_round: bool) -> Vec<DVec3> {
    if !is_round {
        return [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]
            .map(|[a, b]| center + a * u + b * v)
            .to_vec();
    }
    let step = 2.0 * PI / CORNERS as f64;
    let reach = (step / step.sin()).sqrt();
    let corner = |k: usize| {
        let (sin, cos) = (k as f64 * step).sin_cos();
        center + reach * (cos * u + sin * v)
    };
    (0..CORNERS).map(corner).collect()
}

/// Irradiance of a polygon of radiance 1, its corners as seen from the surface, what is behind that cut off.
fn of_polygon(corners: &[DVec3], normal: DVec3) -> f64 {
    let mut above = Vec::with_capacity(corners.len() + 2);
    for (i, a) in corners.iter().enumerate() {
        let b = corners[(i + 1) % corners.len()];
        let (ha, hb) = (a.dot(normal), b.dot(normal));
        if ha >= 0.0 {
            above.push(*a);
        }
        if (ha > 0.0 && hb < 0.0) || (ha < 0.0 && hb > 0.0) {
            above.push(*a + (b - *a) * (ha / (ha - hb)));
        }
    }
    let mut sum = 0.0;
    for (i, a) in above.iter().enumerate() {
        let b = above[(i + 1) % above.len()];
        let across = a.cross(b);
        // What an edge adds that leads straight to the surface, or is none, is nothing.
        if let Some(axis) = across.try_normalize() {
            sum += across.length().atan2(a.dot(b)) * axis.dot(normal);
        }
    }
    // Which way round its corners go is nobody's business.
    0.5 * sum.abs()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sh::lattice;

    fn square(center: Vec3, edge: f32, normal: Vec3, is_round: bool) -> Shape {
        let (u, v) = normal.any_orthonormal_pair();
        Shape::Area {
            center,
            half: [u, v].map(|axis| axis * edge * 0.5),
            normal,
            is_round,
        }
    }

    /// What leaves a point arrives, wherever in a closed surface it is.
    #[test]
    fn all_that_a_point_emits_arrives_on_what_encloses_it() {
        let around = lattice(20_000);
        let each = 4.0 * PI / around.len() as f64;
        for place in [Vec3::ZERO, Vec3::new(0.5, -0.2, 0.3)] {
            let light = Shape::Point { position: place };
            let on = |p: &Vec3| f64::from(light.irradiance(*p, -*p, 0.0)[0]);
            let power: f64 = around.iter().map(|p| each * on(p)).sum();
            assert!((power / (4.0 * PI) - 1.0).abs() < 1e-3, "{place}: {power}");
        }
    }

    /// An area light's irradiance is what the integral over it says, wherever it stands and however little of it is above the surface.
    #[test]
    fn an_area_light_is_its_integral() {
        let mut most = 0f32;
        for (i, toward) in lattice(40).into_iter().enumerate() {
            for is_round in [false, true] {
                let light = square(1.3 * toward, 0.8, -toward, is_round);
                let normal = lattice(40)[(i * 7 + 3) % 40];
                let Shape::Area {
                    center,
                    half: [u, v],
                    ..
                } = light
                else {
                    unreachable!("it is one");
                };
                let steps = 400;
                let mut sums = [0f64; 2];
                for k in 0..steps * steps {
                    let place =
                        [k % steps, k / steps].map(|j| (2 * j + 1) as f32 / steps as f32 - 1.0);
                    if is_round && place[0].hypot(place[1]) > 1.0 {
                        continue;
                    }
                    let seen = from_point(center + place[0] * u + place[1] * v, Vec3::ZERO, 0.0);
                    let area = 4.0 * u.cross(v).length() / (steps * steps) as f32;
                    let each = seen.strength * area * seen.direction.dot(toward);
                    let cosine = seen.direction.dot(normal);
                    sums[usize::from(cosine < 0.0)] += f64::from(each * cosine.abs());
                }
                let found = light.irradiance(Vec3::ZERO, normal, 0.0);
                for (found, exact) in found.into_iter().zip(sums) {
                    let off = (found - exact as f32).abs();
                    most = most.max(off);
                    assert!(off < 2e-3 * exact as f32 + 3e-4, "{found} {exact}");
                }
            }
        }
        assert!(most > 0.0);
        // On its dark side there is none.
        let light = square(Vec3::Z, 1.0, Vec3::Z, false);
        assert_eq!(light.irradiance(Vec3::ZERO, Vec3::Z, 0.0), [0.0; 2]);
    }

    /// Far away, a soft box is a directional light of the irradiance that it has there.
    #[test]
    fn an_area_light_far_away_is_a_directional_one() {
        let (toward, n) = (Vec3::new(0.6, 0.0, 0.8), Vec3::new(0.0, 0.6, 0.8));
        let sun = Shape::Distant {
            toward,
            radius: 0.0,
        };
        let mut last = f32::MAX;
        for distance in [3.0, 10.0, 100.0] {
            let light = square(distance * toward, 0.8, -toward, false);
            let facing = 0.64 / (distance * distance);
            for place in [Vec3::ZERO, Vec3::new(0.3, 0.3, -0.1)] {
                let [near, _] = light.irradiance(place, n, 0.0);
                let [far, _] = sun.irradiance(place, n, 0.0);
                let off = (near / (facing * far) - 1.0).abs();
                if place != Vec3::ZERO {
                    assert!(off < last);
                    last = off;
                }
                assert!(off < 2.0 / distance, "{distance}: {off}");
            }
        }
    }

    #[test]
    fn a_spot_falls_with_the_angle_and_a_sun_has_a_disc() {
        let light = Shape::Spot {
            position: Vec3::Z,
            axis: -Vec3::Z,
            beam: 0.2,
            cutoff: 0.4,
        };
        let at = |angle: f32| {
            let place = Vec3::Z + 2.0 * Vec3::new(angle.sin(), 0.0, -angle.cos());
            4.0 * light.sample((0, 1), [0.5; 2], place, 0.0).strength
        };
        for (angle, share) in [(0.0, 1.0), (0.19, 1.0), (0.3, 0.5), (0.41, 0.0), (3.0, 0.0)] {
            assert!((at(angle) - share).abs() < 1e-3, "{angle}: {}", at(angle));
        }
        let sun = Shape::Distant {
            toward: Vec3::X,
            radius: 0.1,
        };
        let farthest = (0..sun.samples(4))
            .map(|k| sun.sample((k, 4), [0.99; 2], Vec3::ZERO, 0.0).direction)
            .map(|d| d.angle_between(Vec3::X));
        let farthest = farthest.fold(0.0, f32::max);
        assert!((0.09..0.101).contains(&farthest), "{farthest}");
        assert!((sun.facing(Vec3::ZERO, 0.0) - 1.0).abs() < 1e-5);
    }

    #[test]
    fn what_is_moved_with_what_it_shines_on_is_as_bright() {
        let turn = glam::Quat::from_euler(glam::EulerRot::XYZ, 0.3, -1.0, 2.0);
        let there = Affine3A::from_scale_rotation_translation(
            Vec3::splat(3.0),
            turn,
            Vec3::new(1.0, -2.0, 0.5),
        );
        let (place, n) = (Vec3::new(0.2, 0.1, -0.3), Vec3::new(0.0, 0.6, 0.8));
        let position = Vec3::new(0.4, 0.3, 1.2);
        let axis = (place - position).normalize();
        let shapes = [
            Shape::Point { position },
            Shape::Spot {
                position,
                axis,
                beam: 0.1,
                cutoff: 0.3,
            },
            square(position, 0.5, axis, false),
            square(position, 0.5, axis, true),
            Shape::Distant {
                toward: -axis,
                radius: 0.05,
            },
        ];
        for shape in shapes {
            let light = Emitter {
                shape,
                emission: [1.0, 2.0, 3.0],
            };
            let moved = light.moved(there);
            let of = |light: &Emitter, place, n| {
                light.emission[1] * light.shape.irradiance(place, n, 0.0)[0]
            };
            let before = of(&light, place, n);
            let after = of(&moved, there.transform_point3(place), turn * n);
            assert!(
                before > 0.1 && (after / before - 1.0).abs() < 1e-4,
                "{shape:?}: {before} {after}"
            );
        }
    }

    #[test]
    fn nothing_is_infinite_however_near() {
        for place in [Vec3::ZERO, Vec3::splat(1e-6), Vec3::splat(1e6)] {
            for shape in [
                Shape::Point {
                    position: Vec3::ZERO,
                },
                square(Vec3::ZERO, 1.0, Vec3::Z, false),
                square(Vec3::ZERO, 0.0, Vec3::Z, true),
                square(Vec3::ZERO, 1e6, Vec3::Z, true),
            ] {
                let found = shape.irradiance(place, -Vec3::Z, 1e-3);
                assert!(
                    found.iter().all(|e| e.is_finite() && *e >= 0.0),
                    "{shape:?} {found:?}"
                );
                assert!(shape.facing(place, 1e-3).is_finite());
            }
        }
    }
}
