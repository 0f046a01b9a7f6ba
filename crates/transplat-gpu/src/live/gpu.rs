//! Objects drawn by the adapter.

use transplat_core::derived::Derived;

use super::frame::{Frame, Passes};
use super::object::{LiveObject, ShadeKey, ShownObjects, placed, shown};
use crate::context::Context;
use crate::rasterize::order::Sorter;
use crate::rasterize::{Canvas, Layer, Order, Target};

/// Buffers that all objects share, and the order of their surfels.
#[derive(Default)]
pub(super) struct GpuCanvas {
    shared: Option<(Canvas, Sorter)>,
    /// From the version of the places and what of each object is shown, how many surfels are.
    hidden: Derived<(u64, ShownObjects), usize>,
    order: Option<Order>,
}

impl GpuCanvas {
    /// Surfels that are shown.
    pub fn shown(&self) -> usize {
        self.hidden.get().map_or(0, |shown| *shown)
    }

    /// Gives the objects one that they share.
    pub fn join<'a>(
        &mut self,
        context: &Context,
        objects: impl Iterator<Item = &'a mut LiveObject>,
    ) {
        let mut objects: Vec<_> = objects.collect();
        let surfels = objects.iter().map(|o| o.asset.cloud.len()).sum();
        let has_room = |(_, sorter): &(_, Sorter)| sorter.count() == surfels;
        if !self.shared.as_ref().is_some_and(has_room) {
            let Ok(canvas) = Canvas::new(context, surfels) else {
                return;
            };
            self.shared = Some((canvas, Sorter::new(context, surfels)));
        }
        let Some((canvas, _)) = &self.shared else {
            return;
        };
        let mut first = 0;
        for object in &mut objects {
            let scale = object.scale();
            if let Some(on_gpu) = &mut object.asset.on_gpu {
                on_gpu.rasterizer.join(canvas, first, scale);
            }
            object.projected.clear();
            first += object.asset.cloud.len();
        }
    }

    /// Projects what moved, and puts all in order where anything did.
    pub fn project(
        &mut self,
        context: &Context,
        objects: &mut [Option<LiveObject>],
        frame: &Frame,
        places: u64,
        passes: &mut Passes,
    ) {
        let Some((canvas, sorter)) = &self.shared else {
            return;
        };
        let before = *passes;
        for object in objects.iter_mut().flatten() {
            let camera = object.camera(frame);
            if object.projected.ask(&camera) {
                if let Some(on_gpu) = &object.asset.on_gpu {
                    on_gpu.rasterizer.project(&camera);
                }
                object.projected.accept(camera, ());
                passes.project += 1;
            }
        }
        let key = (places, shown(objects, frame));
        let is_shown_otherwise = self.hidden.ask(&key);
        if is_shown_otherwise {
            let hidden = hidden(objects, frame);
            sorter.hide(context, &hidden);
            let count = hidden.iter().filter(|hidden| **hidden).count();
            self.hidden.accept(key, sorter.count() - count);
        }
        if is_shown_otherwise || *passes != before {
            let camera = &frame.presentation.camera;
            let size = [camera.width, camera.height];
            self.order = Some(sorter.sort(context, &canvas.projected, size));
            passes.sort += 1;
        }
    }

    /// Colours the objects and draws them as one into a target.
    pub fn draw<'a>(
        &self,
        objects: impl Iterator<Item = (&'a LiveObject, &'a ShadeKey)>,
        frame: &Frame,
        target: &Target,
    ) {
        let mut any = None;
        for (object, key) in objects {
            object.shade(&object.camera(frame), key);
            any = any.or(object.asset.on_gpu.as_ref());
        }
        let layer = Layer {
            depth_unit: frame.presentation.depth_unit,
            ..Layer::default()
        };
        if let (Some(order), Some(any)) = (&self.order, any) {
            let camera = &frame.presentation.camera;
            any.rasterizer.draw_tile(camera, layer, order, target);
        }
    }
}

/// Surfels that are not drawn, `[n]` of all objects or empty.
fn hidden(objects: &[Option<LiveObject>], frame: &Frame) -> Vec<bool> {
    let each = placed(objects, frame);
    let mut placements = each.clone().map(|(_, p)| p);
    if placements.all(|p| p.shown && p.hidden.is_empty()) {
        return Vec::new();
    }
    each.flat_map(|(object, placement)| {
        let mut hidden = placement.hidden.to_vec();
        hidden.resize(object.asset.cloud.len(), false);
        if !placement.shown {
            hidden.fill(true);
        }
        hidden
    })
    .collect()
}
