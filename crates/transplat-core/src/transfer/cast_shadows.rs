//! Shadows that suns and placed lights cast on an asset, for shadow rays at the pixel.
//!
//! A surfel is lit or shadowed as a whole, so an edge of a shadow is as ragged as the surfels are large. What a light brings each surfel is kept beside
//! the relit colour: at the pixel it is multiplied by what a shadow ray from there sees in place of what the surfel saw.

use std::ops::Range;
use std::sync::Arc;

use glam::{Affine3A, Vec3};

use crate::bake::surroundings::InterObjectVisibility;
use crate::bake::trace::{RayStart, RaySurfel, Stack, Tracer};
use crate::environment::{FEW, Shape};

/// Samples along each edge of a light with an extent, from each pixel.
const ACROSS: usize = 2 * FEW;

/// Factor of a pixel at most: a shadow's bright side was never darker by more.
const MOST_FACTOR: f32 = 1.5;

/// Lights that cast shadows on an asset.
#[derive(Clone, Debug)]
pub struct CastShadows {
    pub(super) tracer: Arc<Tracer>,
    /// Objects around it.
    pub(super) around: Option<Arc<InterObjectVisibility>>,
    pub(super) lights: Vec<CastShadow>,
    /// Power of the change of light: trust in the capture light.
    pub(super) trust: f32,
    /// Share of the change at a pixel that counts, 0 to 1.
    pub(super) weight: f32,
}

/// A light, and what it brings each surfel.
#[derive(Clone, Debug)]
pub(super) struct CastShadow {
    /// In the tracer's coordinates.
    pub shape: Shape,
    /// `[n]`
    pub surfels: Vec<LitSurfel>,
}

/// Share of a surfel's light that one light brings.
#[derive(Clone, Copy, Debug, Default)]
pub struct LitSurfel {
    /// Share of all its diffuse light that the light would bring unblocked, by channel; 0 away from edges of shadows.
    pub share: [f32; 3],
    /// Visible share of the light, 0 to 1.
    pub seen: f32,
}

/// Shadows on one of the splats that an image is made of.
#[derive(Clone, Debug)]
pub struct PlacedShadows {
    /// Shadows on it.
    pub shadows: Arc<CastShadows>,
    /// Its surfels among those of the image.
    pub surfels: Range<usize>,
    /// From its coordinates to those of the image's camera: a turn, a move, and one scale for all axes.
    pub scene_from_object: Affine3A,
}

impl PlacedShadows {
    /// Shadows on an image of one splat of `count` surfels.
    pub fn alone(shadows: Arc<CastShadows>, count: usize) -> Self {
        Self {
            shadows,
            surfels: 0..count,
            scene_from_object: Affine3A::IDENTITY,
        }
    }

    /// Shadows on a splat that is moved, and counted after `first` other surfels.
    pub fn moved(mut self, first: usize, scene_from_object: Affine3A) -> Self {
        self.surfels = self.surfels.start + first..self.surfels.end + first;
        self.scene_from_object = scene_from_object * self.scene_from_object;
        self
    }
}

/// The surface at a pixel, in the asset's coordinates.
#[derive(Clone, Copy, Debug)]
pub struct SurfacePoint {
    /// Where.
    pub position: Vec3,
    /// Unit normal.
    pub normal: Vec3,
    /// Smaller and larger standard deviation of the surfels there.
    pub sizes: [f32; 2],
}

impl CastShadows {
    /// Number of lights.
    pub fn lights(&self) -> usize {
        self.lights.len()
    }

    /// Share of a surfel's light that a light brings.
    pub fn lit(&self, light: usize, surfel: usize) -> LitSurfel {
        self.lights[light].surfels[surfel]
    }

    /// Unit normal of a surfel, outward, and its smaller and larger standard deviation.
    pub fn surface(&self, surfel: usize) -> (Vec3, [f32; 2]) {
        let surfel = &self.tracer.surfels[surfel];
        let sizes = [surfel.minor, surfel.major];
        (surfel.normal, sizes.map(|size| size * self.tracer.radius))
    }

    /// True where an edge of a light's shadow is near a surfel.
    pub fn has_edge(&self, light: usize, surfel: usize) -> bool {
        self.lit(light, surfel).share != [0.0; 3]
    }

    /// Visible share of a light at a point of the surface, 0 to 1. `stack` is scratch.
    pub fn seen(&self, light: usize, at: &SurfacePoint, stack: &mut Stack) -> f32 {
        let (shape, unit) = (&self.lights[light].shape, 1.0 / self.tracer.radius);
        let place = (at.position - self.tracer.center) * unit;
        let [minor, major] = at.sizes.map(|size| size * unit);
        let surfel = RaySurfel {
            position: place,
            axes: [Vec3::ZERO; 2],
            normal: at.normal,
            minor,
            major,
            one_sided: true,
            opacity: 1.0,
        };
        let (mut sum, mut all) = (0.0, 0.0);
        for k in 0..shape.samples(ACROSS) {
            let to = shape.sample((k, ACROSS), [0.5; 2], place, minor);
            let weight = to.strength * at.normal.dot(to.direction);
            // Behind the surface it is dark.
            all += weight.abs();
            if weight > 0.0 {
                let start = surfel.start(to.direction);
                sum += weight
                    * transmittance(
                        &self.tracer,
                        self.around.as_deref(),
                        &surfel,
                        start,
                        to.direction,
                        to.distance,
                        stack,
                    );
            }
        }
        if all > 0.0 { sum / all } else { 0.0 }
    }

    /// Factor of a pixel's linear colour by channel, whose diffuse light changes by `gained`, relative to all.
    pub fn factor(&self, gained: [f32; 3]) -> [f32; 3] {
        gained.map(|gained| {
            let change = (1.0 + gained).clamp(0.0, MOST_FACTOR).powf(self.trust);
            1.0 + self.weight * (change - 1.0)
        })
    }
}

/// Light that is left along a shadow ray of a surfel of an object, with the others around it, 0 to 1. The ray starts somewhere, goes in a direction
/// (a unit vector), and ends at a distance, in the object's coordinates for rays.
pub(super) fn transmittance(
    own: &Tracer,
    around: Option<&InterObjectVisibility>,
    surfel: &RaySurfel,
    start: RayStart,
    direction: Vec3,
    end: f32,
    stack: &mut Stack,
) -> f32 {
    let through = own.transmittance(start, direction, end, stack);
    match around {
        Some(around) if through > 0.0 => {
            through * around.transmittance(surfel, direction, end, stack)
        }
        _ => through,
    }
}
