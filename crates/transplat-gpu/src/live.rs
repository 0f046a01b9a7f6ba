//! Live stages: from the transfer on, kept on the GPU and run only where something changed.
//!
//! Each stage remembers what it last ran with. A frame asks for a picture; a stage whose inputs are the same as last time is left out,
//! and [`Passes`] counts those that ran.

mod cpu;
mod frame;
mod gpu;
mod object;
mod paint;

use std::sync::Arc;

use glam::Affine3A;
use transplat_core::color::Display;
use transplat_core::derived::Derived;
use transplat_core::environment::Illumination;
use transplat_core::present::View;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::{Part, RelitRows};

use cpu::CpuCanvas;
pub use frame::{Frame, Passes, Placement};
use gpu::GpuCanvas;
use object::{ConfidenceMap, LiveObject, ShadeKey, Shown, SidePaint, Versioned};
pub use object::{Drawing, LiveSh, LiveSplat};

use crate::context::{Context, Result};
use crate::present::{
    Around, Backdrop, Blit, GroundLit, PresentPass, Presentation, ResidentLut, SCREEN_FORMAT,
};
use crate::rasterize::{Canvas, Target, read_texture};
use crate::transfer::GpuTransfer;

#[derive(Default)]
struct Side {
    target: Option<Target>,
    /// Shading of each object in that picture.
    drawn: Derived<Vec<ShadeKey>, ()>,
}

struct Screen {
    view: wgpu::TextureView,
    texture: wgpu::Texture,
    size: [usize; 2],
    blit: wgpu::BindGroup,
}

/// Target that the surfels are drawn into.
enum Drawn {
    Gpu(GpuCanvas),
    Cpu(CpuCanvas),
}

/// Stages and pictures of one window.
pub struct Live {
    context: Arc<Context>,
    drawn: Drawn,
    present: PresentPass,
    blit: Blit,
    /// A place for each of the scene's objects; empty until its asset is there.
    objects: Vec<Option<LiveObject>>,
    objects_made: u64,
    /// Objects and their places.
    placed: Derived<Vec<(u64, Affine3A)>, ()>,
    backdrops: [Option<Backdrop>; 2],
    ground: [Option<GroundLit>; 2],
    luts: [Option<ResidentLut>; 2],
    /// Version of backdrops, ground and LUTs.
    surroundings_version: u64,
    sides: [Side; 2],
    screen: Option<Screen>,
    /// From the sides' versions and that of what is around them.
    presented: Derived<(Presentation, [u64; 2], u64), ()>,
    passes: Passes,
}

impl Live {
    /// Compiles what every frame needs, for a window of a format.
    pub fn new(context: &Arc<Context>, window: wgpu::TextureFormat, drawing: Drawing) -> Self {
        Self {
            drawn: match drawing {
                Drawing::Gpu => Drawn::Gpu(GpuCanvas::default()),
                Drawing::Cpu => Drawn::Cpu(CpuCanvas::new()),
            },
            present: PresentPass::new(context),
            blit: Blit::new(context, window),
            context: context.clone(),
            objects: Vec::new(),
            objects_made: 0,
            placed: Derived::default(),
            backdrops: [None, None],
            ground: [None, None],
            luts: [None, None],
            surroundings_version: 0,
            sides: Default::default(),
            screen: None,
            presented: Derived::default(),
            passes: Passes::default(),
        }
    }

    /// Counts of stages so far.
    pub fn passes(&self) -> Passes {
        self.passes
    }

    /// Surfels in the last frame: on the CPU those on the screen, else all that are shown.
    pub fn drawn(&self) -> usize {
        match &self.drawn {
            Drawn::Gpu(canvas) => canvas.shown(),
            Drawn::Cpu(canvas) => canvas.seen(),
        }
    }

    /// Where it draws.
    pub fn drawing(&self) -> Drawing {
        match self.drawn {
            Drawn::Gpu(_) => Drawing::Gpu,
            Drawn::Cpu(_) => Drawing::Cpu,
        }
    }

    /// True where an object has a relit colour to show.
    pub fn has_relit(&self, object: usize) -> bool {
        self.object(object).is_some_and(LiveObject::has_relit)
    }

    fn object(&self, at: usize) -> Option<&LiveObject> {
        self.objects.get(at)?.as_ref()
    }

    fn object_mut(&mut self, at: usize) -> Option<&mut LiveObject> {
        self.objects.get_mut(at)?.as_mut()
    }

    /// Objects that are there.
    fn present_objects(&self) -> impl Iterator<Item = &LiveObject> + Clone {
        self.objects.iter().flatten()
    }

    /// Shows another asset as an object; what was made of the last one is dropped.
    ///
    /// # Errors
    /// All objects together are too large for the adapter; nothing is changed then.
    pub fn set_asset(&mut self, object: usize, asset: LiveSplat) -> Result<()> {
        let all = self.objects.iter().enumerate();
        let others = all.filter(|(i, _)| *i != object);
        let others = others.filter_map(|(_, o)| o.as_ref());
        let surfels: usize = others.map(|o| o.asset.cloud.len()).sum();
        if self.drawing() == Drawing::Gpu {
            Canvas::check(&self.context, surfels + asset.cloud.len())?;
        }
        self.objects_made += 1;
        let made = LiveObject {
            id: self.objects_made,
            asset,
            relit: Versioned::default(),
            pinned: Versioned::default(),
            channel: Versioned::default(),
            confidence: Versioned::default(),
            scene_from_object: Affine3A::IDENTITY,
            projected: Derived::default(),
        };
        let slots = self.objects.len().max(object + 1);
        self.objects.resize_with(slots, || None);
        self.objects[object] = Some(made);
        Ok(())
    }

    /// Takes the objects in another order, `of` is which one each is now: one that is not named is forgotten.
    pub fn arrange(&mut self, of: &[Option<usize>]) {
        let mut last = std::mem::take(&mut self.objects);
        let mut take = |at: &Option<usize>| last.get_mut((*at)?)?.take();
        self.objects = of.iter().map(&mut take).collect();
    }

    /// Takes an object's surfels where they are held now; they are the same.
    pub fn set_cloud(&mut self, object: usize, cloud: &Arc<SurfelCloud>) {
        if let Some(object) = self.object_mut(object) {
            object.asset.cloud = cloud.clone();
            if let Some(on_gpu) = &mut object.asset.on_gpu {
                on_gpu.rasterizer.set_cloud(cloud);
            }
        }
    }

    /// Takes another preparation of the same asset; shown from the next [`Live::relight`] on.
    pub fn set_transfer(&mut self, object: usize, transfer: GpuTransfer) {
        if let Some(object) = self.object_mut(object) {
            object.relit.value = Some(Shown::Live(Box::new(transfer)));
        }
    }

    /// Shows what was relit on the CPU, with its colours in the channel *tau*.
    pub fn set_relit(&mut self, object: usize, relit: LiveSh, tau: Vec<[f32; 3]>) {
        if let Some(object) = self.object_mut(object) {
            object.relit.set(Some(Shown::Made(relit, tau)));
            self.passes.transfer += 1;
        }
    }

    /// Relights an object by another light, for a view that shows a part of it, and leaves out surfels that nobody sees (`[n]` or empty).
    ///
    /// # Errors
    /// The light was not read for the method.
    pub fn relight(
        &mut self,
        object: usize,
        target: &Illumination,
        part: Part,
        unseen: &[bool],
    ) -> transplat_core::Result<()> {
        let Some(LiveObject { relit, .. }) = self.object_mut(object) else {
            return Ok(());
        };
        if let Some(Shown::Live(transfer)) = &mut relit.value {
            transfer.submit(target, part, unseen)?;
            relit.version += 1;
            self.passes.transfer += 1;
        }
        Ok(())
    }

    /// Shows what was relit on the CPU by the adapter's own transfer, which stays.
    pub fn take_relit(&mut self, object: usize, made: &RelitRows, part: Part) {
        let Some(LiveObject { relit, .. }) = self.object_mut(object) else {
            return;
        };
        if let Some(Shown::Live(transfer)) = &mut relit.value {
            transfer.take(made, part);
            relit.version += 1;
            self.passes.transfer += 1;
        }
    }

    /// Keeps what is shown relit of an object now, to compare others with it.
    pub fn pin(&mut self, object: usize, display: Display) {
        let Some(Some(object)) = self.objects.get_mut(object) else {
            return;
        };
        let relit = object.relit.value.as_ref();
        let pinned = relit.map(|r| (r.snapshot(&self.context), display));
        object.pinned.set(pinned);
    }

    /// Pins what was relit on the CPU.
    pub fn pin_relit(&mut self, object: usize, relit: LiveSh, display: Display) {
        if let Some(object) = self.object_mut(object) {
            object.pinned.set(Some((relit, display)));
        }
    }

    /// Sets the surfel colours of a channel that no light changes, in the place of another one's.
    pub fn set_channel(&mut self, object: usize, view: View, colors: Vec<[f32; 3]>) {
        if let Some(object) = self.object_mut(object) {
            object.channel.set(Some((view, colors)));
        }
    }

    /// Sets the surfel colours of the channel *doubts*, and the marks with their weight.
    pub fn set_confidence(
        &mut self,
        object: usize,
        colors: Vec<[f32; 3]>,
        marks: impl Iterator<Item = [f32; 4]>,
    ) {
        let confidence = ConfidenceMap::new(&self.context, colors, marks.collect(), self.drawing());
        if let Some(object) = self.object_mut(object) {
            object.confidence.set(Some(confidence));
        }
    }

    /// Sets the map behind one side: 0 is what is as captured, 1 what is relit.
    pub fn set_backdrop(&mut self, side: usize, backdrop: Backdrop) {
        self.passes.backdrop += 1;
        self.backdrops[side] = Some(backdrop);
        self.surroundings_version += 1;
    }

    /// Sets a table of colours: 0 is the pinned look's, 1 the scene's.
    pub fn set_lut(&mut self, of: usize, lut: ResidentLut) {
        self.luts[of] = Some(lut);
        self.surroundings_version += 1;
    }

    /// Sets the lit share of the ground, `[GROUND_CELLS^2]`, under source and target.
    pub fn set_ground(&mut self, lit: [&[f32]; 2]) {
        self.ground = lit.map(|lit| Some(GroundLit::new(&self.context, lit)));
        self.surroundings_version += 1;
    }

    /// Brings the screen's picture up to date, and tells whether anything ran.
    pub fn frame(&mut self, frame: &Frame) -> bool {
        if self.present_objects().next().is_none() {
            return false;
        }
        let before = self.passes;
        let mut frame = frame.clone();
        self.place(&frame);
        let presentation = &mut frame.presentation;
        let units = self.present_objects().map(|o| {
            let camera = presentation.camera.seen_from(o.scene_from_object);
            o.depth_unit(&camera)
        });
        presentation.depth_unit = units.fold(0.0, f32::max);
        presentation.false_color &= presentation.view.is_light();
        let is_graded = presentation.view.is_graded() && !presentation.false_color;
        presentation.graded = presentation.graded.map(|of| of.filter(|_| is_graded));
        presentation.display = presentation.display.for_picture(presentation.false_color);
        self.draw_sides(&frame);
        let presentation = frame.presentation;
        self.size_screen(presentation.size);
        let versions = self.sides.each_ref().map(|side| side.drawn.version());
        let key = (presentation, versions, self.surroundings_version);
        if self.presented.ask(&key) {
            self.present(&presentation);
        }
        self.passes != before
    }

    /// Puts the objects where they stand, all surfels on one canvas.
    fn place(&mut self, frame: &Frame) {
        let places = self.objects.iter_mut().zip(&frame.objects);
        let key: Vec<(u64, Affine3A)> = places
            .filter_map(|(object, placement)| {
                let object = object.as_mut()?;
                object.scene_from_object = placement.scene_from_object;
                Some((object.id, placement.scene_from_object))
            })
            .collect();
        if !self.placed.ask(&key) {
            return;
        }
        if let Drawn::Gpu(canvas) = &mut self.drawn {
            canvas.join(&self.context, self.objects.iter_mut().flatten());
        }
        self.placed.accept(key, ());
    }

    fn draw_sides(&mut self, frame: &Frame) {
        let view = frame.presentation.view;
        let (objects, places) = (&mut self.objects, self.placed.version());
        let before = self.passes;
        match &mut self.drawn {
            Drawn::Gpu(canvas) => {
                canvas.project(&self.context, objects, frame, places, &mut self.passes);
            }
            Drawn::Cpu(canvas) => canvas.project(objects, frame, places, &mut self.passes),
        }
        if self.passes != before {
            // Neither side is what the camera sees any more, the one not shown now included.
            for side in &mut self.sides {
                side.drawn.ask_again();
            }
        }
        if view == View::Before || view.has_two_sides() {
            self.draw_side(frame, 0, |object| object.left_paint(frame));
        }
        if view != View::Before {
            self.draw_side(frame, 1, |object| object.right_paint(view));
        }
    }

    /// Draws the objects of a side as one.
    fn draw_side(&mut self, frame: &Frame, side: usize, paint: impl Fn(&LiveObject) -> SidePaint) {
        let camera = &frame.presentation.camera;
        let size = [camera.width, camera.height];
        let keys: Vec<_> = self
            .present_objects()
            .map(|o| o.key(paint(o), frame))
            .collect();
        let state = &mut self.sides[side];
        let is_new = state.drawn.ask(&keys);
        let has_depth = frame.presentation.view == View::Depth;
        let is_other = |t: &Target| t.size != size || t.depth.is_some() != has_depth;
        let resized = state.target.as_ref().is_none_or(is_other);
        if !is_new && !resized {
            return;
        }
        if resized {
            let target = match self.drawn {
                Drawn::Gpu(_) => Target::of_screen,
                Drawn::Cpu(_) => Target::new,
            };
            state.target = Some(target(&self.context, size, has_depth));
        }
        let Some(target) = &state.target else {
            return;
        };
        let objects = self.objects.iter().flatten().zip(&keys);
        self.passes.shade += keys.len();
        self.passes.draw += 1;
        match &mut self.drawn {
            Drawn::Gpu(canvas) => canvas.draw(objects, frame, target),
            Drawn::Cpu(canvas) => canvas.draw(&self.context, objects, frame, target),
        }
        state.drawn.accept(keys, ());
    }

    fn size_screen(&mut self, size: [usize; 2]) {
        if self.screen.as_ref().is_some_and(|s| s.size == size) {
            return;
        }
        let usage = wgpu::TextureUsages::RENDER_ATTACHMENT | wgpu::TextureUsages::COPY_SRC;
        let texture = self.context.texture("screen", size, SCREEN_FORMAT, usage);
        let view = texture.create_view(&Default::default());
        self.screen = Some(Screen {
            blit: self.blit.bind(&self.context, &view),
            texture,
            view,
            size,
        });
        self.presented.clear();
    }

    fn present(&mut self, presentation: &Presentation) {
        // A side that the view does not show stands in for the other.
        let targets = self.sides.each_ref().map(|s| s.target.as_ref());
        let (Some(screen), Some(any)) = (&self.screen, targets[0].or(targets[1])) else {
            return;
        };
        let graded = |side: usize| self.luts[presentation.graded[side]?].as_ref();
        let around = Around {
            backdrops: self.backdrops.each_ref().map(Option::as_ref),
            ground: self.ground.each_ref().map(Option::as_ref),
            luts: [0, 1].map(graded),
        };
        let targets = targets.map(|t| t.unwrap_or(any));
        let context = &self.context;
        (self.present).present(context, presentation, targets, &around, &screen.view);
        self.passes.present += 1;
    }

    /// Draws the screen's picture over the viewport of a window's pass.
    pub fn paint(&self, pass: &mut wgpu::RenderPass<'_>) {
        if let Some(screen) = &self.screen {
            self.blit.draw(pass, &screen.blit);
        }
    }

    /// Reads the screen's picture back, `[height * width]`, 0 to 1, with its size: for tests, never to show it.
    ///
    /// # Errors
    /// The driver failed.
    pub fn read_screen(&self) -> Result<(Vec<[f32; 3]>, [usize; 2])> {
        let Some(screen) = &self.screen else {
            return Ok((Vec::new(), [0, 0]));
        };
        let values = read_texture(&self.context, &screen.texture)?;
        let pixels = values.chunks_exact(4).map(|p| [p[0], p[1], p[2]]);
        Ok((pixels.collect(), screen.size))
    }
}
