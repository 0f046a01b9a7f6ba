//! Objects drawn by the CPU rasterizer, for a software adapter.

use rayon::{ThreadPool, ThreadPoolBuilder};
use transplat_core::camera::Camera;
use transplat_core::derived::Derived;
use transplat_core::rasterize::{ColorSpace, PlacedSplat, Raster, Rasterizer};

use super::frame::{Frame, Passes};
use super::object::{LiveObject, ShadeKey, ShownObjects, placed, shown};
use super::paint::{ObjectPaint, cast_shadows};
use crate::context::Context;
use crate::rasterize::Target;

/// Least surfels of a moving picture, if there are as many: they take a few hundredths of a second.
const LEAST_DRAWN: usize = 125_000;

/// Pictures drawn by the CPU.
pub(super) struct CpuCanvas {
    /// Its own: where jobs keep the others busy, a picture does not wait for them.
    pool: Option<ThreadPool>,
    rasterizer: Rasterizer,
    raster: Raster,
    /// From the camera, the version of the places, what of each object is shown, and one of how many.
    projected: Derived<(Camera, u64, ShownObjects, usize), ()>,
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

    /// Surfels on the screen.
    pub fn seen(&self) -> usize {
        self.rasterizer.seen()
    }

    /// Lists what is seen in each part of the picture, where anything moved.
    pub fn project(
        &mut self,
        objects: &[Option<LiveObject>],
        frame: &Frame,
        places: u64,
        passes: &mut Passes,
    ) {
        let camera = &frame.presentation.camera;
        let surfels = placed(objects, frame).map(|(o, _)| o.asset.cloud.len());
        let one_of = one_of(surfels.sum(), frame.pixel_step);
        let key = (*camera, places, shown(objects, frame), one_of);
        if !self.projected.ask(&key) {
            return;
        }
        let each = placed(objects, frame).map(|(object, placement)| PlacedSplat {
            cloud: &object.asset.cloud,
            camera: object.camera(frame),
            scale: object.scale(),
            hidden: &placement.hidden,
            shown: placement.shown,
            one_of,
        });
        let each: Vec<PlacedSplat<'_>> = each.collect();
        let rasterizer = &mut self.rasterizer;
        within(&self.pool, || rasterizer.project(&each, camera));
        self.projected.accept(key, ());
        passes.sort += 1;
        passes.project += each.len();
    }

    /// Draws the objects as one into a target, in their colours.
    pub fn draw<'a>(
        &mut self,
        context: &Context,
        objects: impl Iterator<Item = (&'a LiveObject, &'a ShadeKey)>,
        frame: &Frame,
        target: &Target,
    ) {
        let (mut first, mut space) = (0, ColorSpace::Linear);
        let paint = |(object, key): (&'a LiveObject, &ShadeKey)| {
            let paint = object.paint(&object.camera(frame), key, first);
            let count = object.asset.cloud.len();
            (first, space) = (first + count, key.space);
            (count, paint)
        };
        let paints: Vec<(usize, ObjectPaint<'_>)> = objects.map(paint).collect();
        let (rasterizer, raster) = (&mut self.rasterizer, &mut self.raster);
        let camera = &frame.presentation.camera;
        within(&self.pool, || {
            match &paints[..] {
                [(_, only)] => rasterizer.draw(|surfels, out| only.colors(surfels, out), raster),
                all => rasterizer.draw(|surfels, out| colors_of_all(all, surfels, out), raster),
            }
            // While something moves, a surfel is lit or shadowed as a whole.
            if frame.pixel_step == 1 {
                cast_shadows(&paints, rasterizer, camera, space, raster);
            }
        });
        target.write(context, raster, frame.presentation.depth_unit);
    }
}

/// One of how many surfels is drawn: as many as the picture has fewer pixels, so that as many are left for each.
fn one_of(surfels: usize, pixel_step: usize) -> usize {
    (pixel_step * pixel_step).clamp(1, (surfels / LEAST_DRAWN).max(1))
}

/// Runs something in a pool, where there is one.
fn within(pool: &Option<ThreadPool>, work: impl FnOnce() + Send) {
    match pool {
        Some(pool) => pool.install(work),
        None => work(),
    }
}

/// Colours of surfels that are counted one object after the other.
fn colors_of_all(objects: &[(usize, ObjectPaint<'_>)], surfels: &[usize], out: &mut [[f32; 3]]) {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_large_assets_are_thinned_and_only_for_fewer_pixels() {
        assert_eq!(one_of(30_000, 4), 1);
        assert_eq!(one_of(10_000_000, 1), 1);
        assert_eq!(one_of(1_000_000, 2), 4);
        assert_eq!(one_of(1_000_000, 4), 8);
        assert_eq!(one_of(0, 4), 1);
    }
}
