//! Placement of lights: how they are made, moved and aimed.

use glam::{DMat3, DQuat, DVec3};

use super::light::{Light, LightSource};

/// The kinds of lights.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LightKind {
    /// [`LightSource::Directional`].
    Directional,
    /// [`LightSource::Point`].
    Point,
    /// [`LightSource::Spot`].
    Spot,
    /// [`LightSource::Rect`].
    Rect,
    /// [`LightSource::Disc`].
    Disc,
}

impl LightKind {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Directional,
        Self::Point,
        Self::Spot,
        Self::Rect,
        Self::Disc,
    ];

    /// Name in files.
    pub fn name(self) -> &'static str {
        match self {
            Self::Directional => "directional",
            Self::Point => "point",
            Self::Spot => "spot",
            Self::Rect => "rect",
            Self::Disc => "disc",
        }
    }

    /// The unit of what it emits.
    pub fn unit(self) -> &'static str {
        match self {
            Self::Directional => "W/m²",
            Self::Point | Self::Spot => "W/sr",
            Self::Rect | Self::Disc => "W/m²/sr",
        }
    }
}

/// Where a light is to stand: what a photographer says of it.
#[derive(Clone, Copy, Debug)]
pub struct Placed {
    /// Where, in the Z-up world.
    pub position: DVec3,
    /// Where it shines.
    pub aim: DVec3,
    /// Radius of what is lit there: a light with an extent is made as large as that needs.
    pub radius: f64,
}

/// Diameter of the sun's disc, in degrees.
pub const SUN_DEG: f64 = 0.53;

/// Factors of a spot's cone over its target, and of its inner cone.
const CONE: f64 = 1.3;
const BEAM: f64 = 0.7;

/// Angles of a spot's cone from its axis as it is made, in degrees.
const CONES: std::ops::RangeInclusive<f64> = 5.0..=60.0;

/// A soft box as it is made, relative to what it lights.
const BOX: [f64; 2] = [1.2, 0.8];
const DISC: f64 = 0.6;

impl Light {
    /// A white light of a kind that makes the irradiance on a surface which faces it where it is aimed.
    pub fn placed(kind: LightKind, placed: Placed, irradiance: f32) -> Self {
        let Placed {
            position,
            aim,
            radius,
        } = placed;
        let away = aim - position;
        let direction = away.normalize_or(-DVec3::Z);
        let distance = away.length().max(f64::MIN_POSITIVE);
        let white = [1.0; 3];
        let source = match kind {
            LightKind::Directional => LightSource::Directional {
                to_light: -direction,
                irradiance: white,
                angle_deg: SUN_DEG,
            },
            LightKind::Point => LightSource::Point {
                position,
                intensity: white,
            },
            LightKind::Spot => {
                let (least, most) = CONES.into_inner();
                let cone = (CONE * radius).atan2(distance).to_degrees();
                let cutoff_deg = cone.clamp(least, most);
                LightSource::Spot {
                    position,
                    direction,
                    intensity: white,
                    cutoff_deg,
                    beam_deg: BEAM * cutoff_deg,
                    reach: Some(distance),
                }
            }
            LightKind::Rect => {
                let [right, up] = upright(direction);
                LightSource::Rect {
                    center: position,
                    edges: [BOX[0] * radius * right, BOX[1] * radius * up],
                    normal: direction,
                    radiance: white,
                    reach: Some(distance),
                }
            }
            LightKind::Disc => LightSource::Disc {
                center: position,
                radius: DISC * radius,
                normal: direction,
                radiance: white,
                reach: Some(distance),
            },
        };
        let mut light = Self::of(source);
        let makes = light.emitter().shape.facing(aim.as_vec3(), 0.0);
        if makes > 0.0 && makes.is_finite() {
            *light.source.emission_mut() = [irradiance / makes; 3];
        }
        light
    }
}

impl LightSource {
    /// Kind of the light.
    pub fn kind(&self) -> LightKind {
        match self {
            Self::Directional { .. } => LightKind::Directional,
            Self::Point { .. } => LightKind::Point,
            Self::Spot { .. } => LightKind::Spot,
            Self::Rect { .. } => LightKind::Rect,
            Self::Disc { .. } => LightKind::Disc,
        }
    }

    /// Where it is; one that is infinitely far away is nowhere.
    pub fn position(&self) -> Option<DVec3> {
        match self {
            Self::Directional { .. } => None,
            Self::Point { position, .. } | Self::Spot { position, .. } => Some(*position),
            Self::Rect { center, .. } | Self::Disc { center, .. } => Some(*center),
        }
    }

    /// Moves it.
    pub(in crate::scene) fn move_by(&mut self, by: DVec3) {
        match self {
            Self::Directional { .. } => {}
            Self::Point { position, .. } | Self::Spot { position, .. } => *position += by,
            Self::Rect { center, .. } | Self::Disc { center, .. } => *center += by,
        }
    }

    /// Unit vector along which it shines; a point shines along all.
    pub fn direction(&self) -> Option<DVec3> {
        match self {
            Self::Directional { to_light, .. } => Some(-*to_light),
            Self::Point { .. } => None,
            Self::Spot { direction, .. } => Some(*direction),
            Self::Rect { normal, .. } | Self::Disc { normal, .. } => Some(*normal),
        }
    }

    /// Emission, in its kind's unit.
    pub fn emission(&self) -> [f32; 3] {
        match self {
            Self::Directional { irradiance, .. } => *irradiance,
            Self::Point { intensity, .. } | Self::Spot { intensity, .. } => *intensity,
            Self::Rect { radiance, .. } | Self::Disc { radiance, .. } => *radiance,
        }
    }

    /// Emission, to be changed. See [`LightSource::emission`].
    pub fn emission_mut(&mut self) -> &mut [f32; 3] {
        match self {
            Self::Directional { irradiance, .. } => irradiance,
            Self::Point { intensity, .. } | Self::Spot { intensity, .. } => intensity,
            Self::Rect { radiance, .. } | Self::Disc { radiance, .. } => radiance,
        }
    }

    /// Distance to its target, where that is set.
    pub fn reach(&self) -> Option<f64> {
        match self {
            Self::Directional { .. } | Self::Point { .. } => None,
            Self::Spot { reach, .. } | Self::Rect { reach, .. } | Self::Disc { reach, .. } => {
                *reach
            }
        }
    }

    /// Where it shines; where that is not told, as far along its direction as `middle` is away. What shines along all directions shines there, too.
    pub fn aim(&self, middle: DVec3) -> DVec3 {
        match (self.position(), self.direction()) {
            (Some(position), Some(direction)) => {
                let away = position.distance(middle);
                position + self.reach().unwrap_or(away) * direction
            }
            _ => middle,
        }
    }

    /// Puts it somewhere and turns it to where it shines, its horizon as level as it was.
    pub fn put(&mut self, there: DVec3, aim: DVec3) {
        let Some(wanted) = (aim - there).try_normalize() else {
            return;
        };
        let turn = self.direction().map(|now| {
            let [from, to] = [now, wanted].map(frame);
            DQuat::from_mat3(&(to * from.transpose()))
        });
        self.turn(turn.unwrap_or_default());
        let away = Some(there.distance(aim));
        match self {
            // What rounding leaves must not add up.
            Self::Directional { to_light, .. } => *to_light = -wanted,
            Self::Point { position, .. } => *position = there,
            Self::Spot {
                position,
                direction,
                reach,
                ..
            } => (*position, *direction, *reach) = (there, wanted, away),
            Self::Rect {
                center,
                normal,
                reach,
                ..
            }
            | Self::Disc {
                center,
                normal,
                reach,
                ..
            } => (*center, *normal, *reach) = (there, wanted, away),
        }
    }

    /// Gives it that width and height, of a round one the mean of them, as bright a light as before: of less extent its radiance is more.
    pub fn resize(&mut self, [width, height]: [f64; 2]) {
        let grown = match self {
            Self::Rect { edges, .. } => {
                let before = edges[0].length() * edges[1].length();
                let sizes = [width, height];
                *edges = std::array::from_fn(|i| sizes[i] * edges[i].normalize_or_zero());
                width * height / before
            }
            Self::Disc { radius, .. } => {
                let wide = 0.25 * (width + height);
                let grown = (wide / *radius).powi(2);
                *radius = wide;
                grown
            }
            _ => return,
        };
        if grown > 0.0 && grown.is_finite() {
            *self.emission_mut() = self.emission().map(|e| e / grown as f32);
        }
    }

    /// Width and height of one that has an extent.
    pub fn size(&self) -> Option<[f64; 2]> {
        match self {
            Self::Rect { edges, .. } => Some(edges.map(DVec3::length)),
            Self::Disc { radius, .. } => Some([2.0 * radius; 2]),
            _ => None,
        }
    }

    /// Takes it along with what moves to `scale * turn * place + shift`, as bright there as it was.
    pub fn go_along(&mut self, scale: f64, turn: DQuat, shift: DVec3) {
        self.turn(turn);
        let there = |place: DVec3| scale * (turn * place) + shift;
        if let Self::Spot { reach, .. } | Self::Rect { reach, .. } | Self::Disc { reach, .. } = self
        {
            *reach = reach.map(|r| scale * r);
        }
        match self {
            Self::Directional { .. } => {}
            Self::Point {
                position,
                intensity,
            }
            | Self::Spot {
                position,
                intensity,
                ..
            } => {
                *position = there(*position);
                // What falls off with the square of a distance counts that in the world's unit.
                *intensity = intensity.map(|i| i * (scale * scale) as f32);
            }
            Self::Rect { center, edges, .. } => {
                *center = there(*center);
                *edges = edges.map(|e| scale * e);
            }
            Self::Disc { center, radius, .. } => {
                *center = there(*center);
                *radius *= scale;
            }
        }
    }

    fn turn(&mut self, by: DQuat) {
        match self {
            Self::Directional { to_light, .. } => *to_light = (by * *to_light).normalize(),
            Self::Point { .. } => {}
            Self::Spot { direction, .. } => *direction = (by * *direction).normalize(),
            Self::Rect { edges, normal, .. } => {
                *edges = edges.map(|e| by * e);
                *normal = (by * *normal).normalize();
            }
            Self::Disc { normal, .. } => *normal = (by * *normal).normalize(),
        }
    }
}

/// To the right and up for whoever looks along a direction, level; of straight up and down along x.
fn upright(direction: DVec3) -> [DVec3; 2] {
    let right = direction.cross(DVec3::Z);
    let right = if right.length() < 1e-6 {
        DVec3::X
    } else {
        right.normalize()
    };
    [right, right.cross(direction)]
}

/// Axes of a level frame.
fn frame(direction: DVec3) -> DMat3 {
    let [right, up] = upright(direction);
    DMat3::from_cols(right, up, direction)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn placed(position: DVec3) -> Placed {
        Placed {
            position,
            aim: DVec3::new(0.2, 0.1, 0.3),
            radius: 0.7,
        }
    }

    /// A light is as bright as it was asked for, and shines where it is aimed.
    #[test]
    fn a_light_is_made_as_bright_as_it_is_wanted() {
        let placed = placed(DVec3::new(1.0, -2.0, 1.5));
        for kind in LightKind::ALL {
            let light = Light::placed(kind, placed, 3.0);
            let emitter = light.emitter();
            let facing = emitter.shape.facing(placed.aim.as_vec3(), 0.0) * emitter.emission[0];
            assert!((facing / 3.0 - 1.0).abs() < 1e-4, "{kind:?}: {facing}");
            assert!(light.source.aim(placed.aim).distance(placed.aim) < 1e-9);
            assert_eq!(light.source.kind(), kind);
        }
    }

    /// A soft box that is moved around keeps its size and stays level; back where it was it is as it was.
    #[test]
    fn what_is_put_somewhere_else_keeps_its_size_and_its_level() {
        let start = placed(DVec3::new(1.0, -2.0, 1.5));
        for kind in LightKind::ALL {
            let first = Light::placed(kind, start, 3.0);
            let mut light = first.clone();
            for place in [[2.0, 0.0, 0.3], [0.0, 2.0, -1.0], [-1.0, 1.0, 3.0]] {
                let there = DVec3::from_array(place);
                light.source.put(there, start.aim);
                let wanted = (start.aim - there).normalize();
                assert!(light.source.direction().unwrap_or(wanted).distance(wanted) < 1e-9);
                if let LightSource::Rect { edges, normal, .. } = &light.source {
                    assert!(edges[0].z.abs() < 1e-9, "level");
                    assert!((edges[0].length() / (BOX[0] * 0.7) - 1.0).abs() < 1e-9);
                    assert!(edges[0].dot(*normal).abs() + edges[1].dot(*normal).abs() < 1e-9);
                }
            }
            light.source.put(start.position, start.aim);
            let parts = |light: &Light| format!("{:.6?}", light.source);
            assert_eq!(parts(&light), parts(&first));
        }
    }

    /// What goes along with an object lights it as before.
    #[test]
    fn what_goes_along_lights_as_before() {
        let start = placed(DVec3::new(1.0, -2.0, 1.5));
        let (scale, turn) = (2.5, DQuat::from_rotation_y(0.7));
        let shift = DVec3::new(0.3, -4.0, 1.0);
        for kind in LightKind::ALL {
            let mut light = Light::placed(kind, start, 3.0);
            light.source.go_along(scale, turn, shift);
            let aim = scale * (turn * start.aim) + shift;
            let emitter = light.emitter();
            let facing = emitter.shape.facing(aim.as_vec3(), 0.0) * emitter.emission[0];
            assert!((facing / 3.0 - 1.0).abs() < 1e-3, "{kind:?}: {facing}");
        }
    }

    #[test]
    fn one_that_is_put_where_it_shines_stays() {
        let start = placed(DVec3::new(1.0, -2.0, 1.5));
        let mut light = Light::placed(LightKind::Spot, start, 1.0);
        let before = light.clone();
        light.source.put(start.aim, start.aim);
        assert_eq!(light, before);
    }
}
