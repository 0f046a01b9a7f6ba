//! The objects drawn by the CPU's own rasterizer, for an adapter that is slower.

use glam::Vec3;
use rayon::{ThreadPool, ThreadPoolBuilder};
use transplat_core::camera::Camera;
use transplat_core::derived::Derived;
use transplat_core::present::normal_color;
use transplat_core::rasterize::{Placed, Raster, Rasterizer, Shading};
use transplat_core::surfels::SurfelCloud;

use crate::context::Context;
use crate::rasterize::{Layer, Target};

/// What decides on where the surfels are on the screen: the camera, the version of the places, and whether and what of each object is shown.
pub(super) type ProjectKey = (Camera, u64, Vec<(bool, u64)>);

/// What an object's surfels are coloured with.
pub(super) struct Paint<'a> {
    pub color: Color<'a>,
    /// Over the colours, as much of them as their fourth number says, `[n]`.
    pub marks: Option<&'a [[f32; 4]]>,
}

pub(super) enum Color<'a> {
    Sh(Shading<'a>),
    /// `[n]`
    Own(&'a [[f32; 3]]),
    /// Turned to an eye.
    Normals(&'a SurfelCloud, Vec3),
    White,
}

impl Paint<'_> {
    fn colors(&self, surfels: &[usize], out: &mut [[f32; 3]]) {
        let each = surfels.iter().zip(&mut *out);
        match &self.color {
            Color::Sh(shading) => shading.colors(surfels, out),
            Color::Own(colors) => each.for_each(|(i, out)| *out = colors[*i]),
            Color::Normals(cloud, eye) => {
                each.for_each(|(i, out)| *out = normal_color(cloud, *eye, *i));
            }
            Color::White => out.fill([1.0; 3]),
        }
        for (i, out) in surfels.iter().zip(out) {
            if let Some([r, g, b, share]) = self.marks.map(|marks| marks[*i]) {
                let mark = Vec3::new(r, g, b);
                *out = Vec3::from_array(*out).lerp(mark, share).to_array();
            }
        }
    }
}

/// Pictures drawn by the CPU.
pub(super) struct CpuCanvas {
    /// Its own: where jobs keep the others busy, a picture does not wait for them.
    pool: Option<ThreadPool>,
    rasterizer: Rasterizer,
    raster: Raster,
    pub projected: Derived<ProjectKey, ()>,
}

impl CpuCanvas {
    pub fn new() -> Self {
        let name = |i| format!("draw {i}");
        Self {
            pool: ThreadPoolBuilder::new().thread_name(name).build().ok(),
            rasterizer: Rasterizer::default(),
            raster: Raster::default(),
            projected: Derived::default(),
        }
    }

    /// How many surfels are on the screen.
    pub fn seen(&self) -> usize {
        self.rasterizer.seen()
    }

    /// Puts the objects on the screen.
    pub fn project(&mut self, objects: &[Placed<'_>], camera: &Camera) {
        let rasterizer = &mut self.rasterizer;
        let mut project = || rasterizer.project(objects, camera);
        match &self.pool {
            Some(pool) => pool.install(project),
            None => project(),
        }
    }

    /// Draws the objects, `(surfels, paint)` of each, into a target.
    pub fn draw(
        &mut self,
        context: &Context,
        objects: &[(usize, Paint<'_>)],
        layer: Layer,
        target: &Target,
    ) {
        let (rasterizer, raster) = (&mut self.rasterizer, &mut self.raster);
        let mut draw = || match objects {
            [(_, only)] => rasterizer.draw(|surfels, out| only.colors(surfels, out), raster),
            _ => rasterizer.draw(|surfels, out| colors_of_all(objects, surfels, out), raster),
        };
        match &self.pool {
            Some(pool) => pool.install(draw),
            None => draw(),
        }
        target.write(context, raster, layer.depth_unit);
    }
}

/// Colours of surfels that are counted one object after the other.
fn colors_of_all(objects: &[(usize, Paint<'_>)], surfels: &[usize], out: &mut [[f32; 3]]) {
    let mut first = 0;
    for (count, paint) in objects {
        let is_own = |i: usize| (first..first + count).contains(&i);
        let places: Vec<usize> = (0..surfels.len())
            .filter(|at| is_own(surfels[*at]))
            .collect();
        let own: Vec<usize> = places.iter().map(|at| surfels[*at] - first).collect();
        let mut colors = vec![[0.0; 3]; own.len()];
        paint.colors(&own, &mut colors);
        for (at, color) in places.into_iter().zip(colors) {
            out[at] = color;
        }
        first += count;
    }
}
