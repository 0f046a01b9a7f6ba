//! Placed lights drawn into an environment map as seen from a place, and suns extracted from one.

use glam::{DVec3, Vec3};
use rayon::prelude::*;

use super::emitter::{Emitter, Shape};
use super::light_samples::{LightSample, SUN_RADIUS};
use super::map::{EnvironmentMap, direction_at};
use crate::color::luminance;

/// Places around a sun whose sky takes its place.
const RIM: usize = 128;

/// Rays along each edge of a pixel that an edge of a light may cross.
const ACROSS: usize = 8;

/// So many rays tell how large a light is seen; of fewer, what it shines tells how bright it is.
const MANY_RAYS: f64 = 400.0;

impl EnvironmentMap {
    /// The map with lights in it as they are seen from a place that nothing blocks. What is smaller than a pixel is spread over one, and what
    /// each light shines onto a surface there that faces it is as it was.
    #[must_use]
    pub fn with_lights(mut self, lights: &[Emitter], place: Vec3) -> Self {
        for light in lights {
            self.add_light(light, place);
        }
        self
    }

    /// The map without some of its suns: over each lies the sky of the rim around it, as smooth as that allows (harmonic, by Poisson's integral),
    /// where it is darker.
    #[must_use]
    pub fn without_suns(mut self, suns: &[LightSample]) -> Self {
        // A sun's direction is that of its middle, which need not be its brightest pixel.
        let radius = (1.25 * SUN_RADIUS).to_radians();
        for sun in suns {
            let toward = sun.direction.as_dvec3();
            let (east, north) = toward.any_orthonormal_pair();
            let azimuth = |k: usize| std::f64::consts::TAU * k as f64 / RIM as f64;
            let rim: Vec<[f32; 3]> = (0..RIM)
                .map(|k| {
                    let (sin, cos) = azimuth(k).sin_cos();
                    let aside = cos * east + sin * north;
                    self.sample((radius.cos() * toward + radius.sin() * aside).as_vec3())
                })
                .collect();
            let sky = |d: DVec3| {
                let inward = (d.angle_between(toward) / radius).min(1.0 - 1e-3);
                let at = d.dot(north).atan2(d.dot(east));
                let weight = |k: usize| {
                    let cosine = (azimuth(k) - at).cos();
                    (1.0 - inward * inward) / (1.0 - 2.0 * inward * cosine + inward * inward)
                };
                let (mut sum, mut all) = ([0f64; 3], 0.0);
                for (k, value) in rim.iter().enumerate() {
                    let weight = weight(k);
                    all += weight;
                    for (sum, value) in sum.iter_mut().zip(value) {
                        *sum += weight * f64::from(*value);
                    }
                }
                sum.map(|s| (s / all) as f32)
            };
            let (width, height) = (self.width, self.height);
            let pixels = self.pixels.par_iter_mut().enumerate();
            pixels.for_each(|(i, pixel)| {
                let place = [(i % width) as f64 + 0.5, (i / width) as f64 + 0.5];
                let d = direction_at(place, [width, height]);
                if d.dot(toward) < radius.cos() {
                    return;
                }
                let sky = sky(d);
                if luminance(*pixel) > luminance(sky) {
                    *pixel = sky;
                }
            });
        }
        self
    }

    fn add_light(&mut self, light: &Emitter, place: Vec3) {
        // One that stands right there comes from nowhere.
        let is_there = match light.shape {
            Shape::Point { position } | Shape::Spot { position, .. } => position == place,
            Shape::Area { .. } | Shape::Distant { .. } => false,
        };
        if is_there || light.emission == [0.0; 3] {
            return;
        }
        // In one sample: all of it.
        let seen = light.shape.sample((0, 1), [0.5; 2], place, 0.0);
        let energy = light.emission.map(|e| f64::from(e * seen.strength));
        let cone = cone(&light.shape, place, seen.direction);
        let covered = cone.map_or_else(Vec::new, |cone| self.covered(&light.shape, place, cone));
        let solid_angle: f64 = covered
            .iter()
            .map(|(i, share)| share * self.pixel_solid_angle(i / self.width))
            .sum();
        let rays = covered.iter().map(|(_, share)| share).sum::<f64>() * (ACROSS * ACROSS) as f64;
        let radiance = match light.shape {
            Shape::Area { .. } if rays > MANY_RAYS => light.emission.map(f64::from),
            _ => energy.map(|e| e / solid_angle),
        };
        if solid_angle > 0.0 && radiance.iter().all(|r| r.is_finite()) {
            for (i, share) in covered {
                self.add_to_pixel(i, radiance.map(|r| r * share));
            }
            return;
        }
        let i = self.pixel_towards(seen.direction.as_dvec3());
        let solid_angle = self.pixel_solid_angle(i / self.width);
        self.add_to_pixel(i, energy.map(|e| e / solid_angle));
    }

    /// The pixels that show some of a light, and how much of each does.
    fn covered(&self, shape: &Shape, place: Vec3, (axis, reach): (Vec3, f32)) -> Vec<(usize, f64)> {
        let size = [self.width, self.height];
        let pixel = std::f32::consts::PI / self.height as f32;
        let nearest = (reach + 2.0 * pixel).min(std::f32::consts::PI).cos();
        let rays = (ACROSS * ACROSS) as f64;
        // Others are farther away than it reaches.
        let polar = axis.z.clamp(-1.0, 1.0).acos();
        let row = |angle: f32| (angle / pixel).clamp(0.0, self.height as f32) as usize;
        let first = row(polar - reach - 2.0 * pixel);
        let last = (row(polar + reach + 2.0 * pixel) + 1).min(self.height);
        (first * self.width..last * self.width)
            .into_par_iter()
            .filter_map(|i| {
                let (column, row) = ((i % size[0]) as f64, (i / size[0]) as f64);
                let middle = direction_at([column + 0.5, row + 0.5], size);
                if middle.as_vec3().dot(axis) < nearest {
                    return None;
                }
                let shows = |k: &usize| {
                    let [x, y] =
                        [k % ACROSS, k / ACROSS].map(|at| (at as f64 + 0.5) / ACROSS as f64);
                    let ray = direction_at([column + x, row + y], size);
                    is_met(shape, place, axis, reach, ray.as_vec3())
                };
                let met = (0..ACROSS * ACROSS).filter(shows).count();
                (met > 0).then(|| (i, met as f64 / rays))
            })
            .collect()
    }

    fn add_to_pixel(&mut self, i: usize, radiance: [f64; 3]) {
        for (value, more) in self.pixels[i].iter_mut().zip(radiance) {
            *value = (f64::from(*value) + more).min(f64::from(Self::BRIGHTEST)) as f32;
        }
    }

    fn pixel_towards(&self, d: DVec3) -> usize {
        let column = 0.5 - d.y.atan2(d.x) / std::f64::consts::TAU;
        let row = d.z.clamp(-1.0, 1.0).acos() / std::f64::consts::PI;
        let at = |share: f64, of: usize| ((share * of as f64) as usize).min(of - 1);
        at(row, self.height) * self.width + at(column, self.width)
    }
}

/// Axis and angle of a cone around a light that has an extent.
fn cone(shape: &Shape, place: Vec3, toward: Vec3) -> Option<(Vec3, f32)> {
    match *shape {
        Shape::Distant { radius, .. } => (radius > 0.0).then_some((toward, radius)),
        Shape::Area {
            center,
            half: [u, v],
            normal,
            ..
        } => {
            if (place - center).dot(normal) <= 0.0 {
                return None;
            }
            let corners = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]];
            let angle = |[a, b]: [f32; 2]| toward.angle_between(center + a * u + b * v - place);
            let reach = corners.map(angle).into_iter().fold(0.0, f32::max);
            reach.is_finite().then_some((toward, reach))
        }
        Shape::Point { .. } | Shape::Spot { .. } => None,
    }
}

/// True where a ray from a place hits a light that has an extent.
fn is_met(shape: &Shape, place: Vec3, axis: Vec3, reach: f32, ray: Vec3) -> bool {
    match *shape {
        Shape::Area {
            center,
            half: [u, v],
            normal,
            is_round,
        } => {
            let falls = ray.dot(normal);
            let away = (center - place).dot(normal) / falls;
            if falls >= 0.0 || away <= 0.0 {
                return false;
            }
            let off = place + away * ray - center;
            // In halves of its edges, which may be aslant.
            let (uu, uv, vv) = (u.dot(u), u.dot(v), v.dot(v));
            let area = uu * vv - uv * uv;
            let (a, b) = (off.dot(u), off.dot(v));
            let [a, b] = [(a * vv - b * uv) / area, (b * uu - a * uv) / area];
            if is_round {
                a * a + b * b <= 1.0
            } else {
                a.abs() <= 1.0 && b.abs() <= 1.0
            }
        }
        _ => ray.angle_between(axis) <= reach,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::environment::{Illumination, project_environment};

    /// Where a saturated sun was, its rim's sky is: within what that holds in each channel; and nothing else is another.
    #[test]
    fn where_a_sun_was_its_rims_sky_is() {
        let sun = DVec3::new(0.6, 0.3, 0.2).normalize();
        let map = EnvironmentMap::of_directions(512, 256, |d| {
            let degrees = d.angle_between(sun).to_degrees();
            let lamp = (4.0 - 0.3 * degrees).max(0.0) as f32;
            match degrees < 1.0 {
                true => [3000.0, 500.0, 0.0],
                false => [
                    lamp + 0.5,
                    0.6 * lamp + 0.5,
                    0.3 * lamp + 0.1 * d.x as f32 + 0.5,
                ],
            }
        });
        let light_sample = LightSample {
            direction: sun.as_vec3(),
            energy: [1.0; 3],
        };
        let without = map.clone().without_suns(&[light_sample]);
        let degrees = |i: usize| {
            let d = map.direction(i % map.width(), i / map.width());
            DVec3::from_array(d).angle_between(sun).to_degrees()
        };
        let all = || (0..map.pixels().len()).map(|i| (i, degrees(i)));
        let rim: Vec<[f32; 3]> = all()
            .filter(|(_, a)| (4.0..6.0).contains(a))
            .map(|(i, _)| map.pixels()[i])
            .collect();
        for (i, angle) in all() {
            let [before, after] = [&map, &without].map(|m| m.pixels()[i]);
            if angle > 5.0 {
                assert_eq!(before, after);
                continue;
            }
            for c in 0..3 {
                let of_rim = rim.iter().map(|p| p[c]);
                let [low, high] = of_rim.fold([f32::MAX, 0.0], |[l, h], v| [v.min(l), v.max(h)]);
                assert!((low..=high).contains(&after[c]), "{angle}: {after:?}");
            }
        }
    }

    /// A light whose suns are taken out is that of the map without them, and has none.
    #[test]
    fn a_light_without_its_suns_is_that_of_the_map_without_them() {
        let sun = DVec3::new(0.5, -0.6, 0.7).normalize();
        let map = EnvironmentMap::of_directions(1024, 512, |d| {
            if d.dot(sun) > 1f64.to_radians().cos() {
                [1000.0, 900.0, 700.0]
            } else {
                [0.2, 0.3, 0.2 + 0.1 * d.z as f32]
            }
        });
        let light = Illumination::of(&map, 4);
        let suns = light
            .light_samples
            .as_ref()
            .expect("read with them")
            .suns
            .clone();
        assert_eq!(suns.len(), 1);
        let without = light.without_suns();
        let expected = Illumination::of(&map.without_suns(&suns), 4);
        assert!(
            expected
                .light_samples
                .as_ref()
                .is_some_and(|b| b.suns.is_empty())
        );
        let of = |l: &Illumination| {
            l.light_samples
                .as_ref()
                .map_or(0.0, |b| b.mean_irradiance())
        };
        for (found, expected) in [
            (of(&without), of(&expected)),
            (without.mean_irradiance(), expected.mean_irradiance()),
        ] {
            assert!((found / expected - 1.0).abs() < 0.01, "{found} {expected}");
        }
        let all = |l: &Illumination| l.radiance.coefficients.clone();
        let scale = expected.radiance.coefficients[0][0];
        for (found, expected) in all(&without).iter().zip(all(&expected)) {
            // The sun's width is all that they differ by.
            assert!(
                (found[0] - expected[0]).abs() < 0.02 * scale,
                "{found:?} {expected:?}"
            );
        }
    }

    /// A light in the map shines on a surface as it does beside it: in any direction, near and far, large and smaller than a pixel.
    #[test]
    fn a_light_in_the_map_is_as_strong_as_beside_it() {
        let place = Vec3::new(0.3, -0.2, 0.1);
        for (i, toward) in crate::sh::lattice(12).into_iter().enumerate() {
            let position = place + 2.0 * toward;
            let area = |edge: f32, is_round| {
                let (u, v) = toward.any_orthonormal_pair();
                Shape::Area {
                    center: position,
                    half: [u, v].map(|axis| 0.5 * edge * axis),
                    normal: -toward,
                    is_round,
                }
            };
            for shape in [
                Shape::Point { position },
                Shape::Spot {
                    position,
                    axis: -toward,
                    beam: 0.1,
                    cutoff: 0.2,
                },
                area(0.9, false),
                area(0.9, true),
                area(1e-3, false),
                area(0.01, true),
                area(0.05, false),
                Shape::Distant {
                    toward,
                    radius: 0.0,
                },
                Shape::Distant {
                    toward,
                    radius: 0.05,
                },
            ] {
                let light = Emitter {
                    shape,
                    emission: [1.0, 2.0, 3.0],
                };
                let dark = EnvironmentMap::new(256, 128, vec![[0.0; 3]; 256 * 128]);
                let map = dark.with_lights(&[light], place);
                // All that arrives, four times the mean irradiance, is within what the cosine loses on a wide light what faces it.
                let arrives = 4.0 * project_environment(&map, 1).mean_irradiances()[0];
                let facing = shape.irradiance(place, toward, 0.0)[0];
                assert!(
                    (arrives / facing - 1.0).abs() < 0.05,
                    "{i} {shape:?}: {arrives} {facing}"
                );
                let brightest = (map.pixels().iter().enumerate())
                    .max_by(|a, b| a.1[0].total_cmp(&b.1[0]))
                    .map(|(i, _)| map.direction(i % 256, i / 256));
                let there = DVec3::from_array(brightest.expect("it has pixels")).as_vec3();
                assert!(there.angle_between(toward) < 0.35, "{shape:?}");
            }
        }
    }
}
