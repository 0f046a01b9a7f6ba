//! The stages from the transfer on, kept on the GPU and run only where something changed: what a window shows.
//!
//! Each stage remembers what it last ran with. A frame asks for a picture; a stage whose inputs are the same as last time is left out,
//! and [`Passes`] counts those that ran.

use std::borrow::Cow;
use std::sync::Arc;

use glam::Vec3;
use transplat_core::camera::Camera;
use transplat_core::color::Display;
use transplat_core::environment::Illumination;
use transplat_core::present::{PLAIN, View};
use transplat_core::rasterize::ColorSpace;
use transplat_core::sh::with_degree;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::Part;

use crate::context::{Context, Result};
use crate::present::{Backdrop, Blit, GroundLit, PresentPass, Presentation, SCREEN_FORMAT};
use crate::rasterize::{
    GpuRasterizer, Order, ResidentPaint, ResidentSh, ResidentVectors, Target, extent, read_texture,
};
use crate::transfer::GpuTransfer;

/// How often each stage ran.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Passes {
    /// Transfers to another light.
    pub transfer: usize,
    /// Sorts by depth.
    pub sort: usize,
    /// Projections of the surfels to the screen.
    pub project: usize,
    /// Colourings of the surfels.
    pub shade: usize,
    /// Blendings of all surfels.
    pub draw: usize,
    /// Pictures made for the screen.
    pub present: usize,
    /// Maps uploaded to be seen behind the object.
    pub backdrop: usize,
}

/// An asset on the GPU; made on any thread.
pub struct LiveAsset {
    rasterizer: GpuRasterizer,
    stored: ResidentSh,
    normals: ResidentVectors,
}

impl LiveAsset {
    /// Uploads an asset.
    ///
    /// # Errors
    /// It is too large for the adapter, or the driver failed.
    pub fn new(context: &Arc<Context>, cloud: &Arc<SurfelCloud>) -> Result<Self> {
        let degree = cloud.filled_degree();
        let filled = if degree == cloud.sh_degree {
            Cow::Borrowed(&cloud.sh)
        } else {
            Cow::Owned(with_degree(cloud.sh.clone(), cloud.sh_degree, degree))
        };
        Ok(Self {
            rasterizer: GpuRasterizer::new(context, cloud)?,
            stored: ResidentSh::upload(context, &filled, degree, cloud.encoding),
            normals: ResidentVectors::upload(
                context,
                (0..cloud.len()).map(|i| cloud.stored_normal(i).extend(0.0).to_array()),
            ),
        })
    }
}

/// Where what is shown relit comes from.
enum Relit {
    /// From the GPU's own transfer.
    Live(Box<GpuTransfer>),
    /// From the CPU, with the colours of the channel *tau*.
    Uploaded(ResidentSh, Vec<[f32; 3]>),
}

impl Relit {
    fn sh(&self) -> &ResidentSh {
        match self {
            Self::Live(transfer) => transfer.resident(),
            Self::Uploaded(sh, _) => sh,
        }
    }

    fn paint(&self, part: Part) -> ResidentPaint<'_> {
        match self {
            Self::Live(transfer) => transfer.paint(part),
            Self::Uploaded(sh, _) => ResidentPaint::Sh(sh, Part::Whole),
        }
    }
}

/// What is asked of a frame.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Everything that is not the surfels' own colour.
    pub presentation: Presentation,
    /// Whether the left side of a comparison is the pinned look instead of the capture.
    pub against_pinned: bool,
    /// Whether marks are laid over the surfels.
    pub marks: bool,
    /// Surfels that are not drawn, `[n]` or empty, and a number that differs where they do.
    pub hidden: (Arc<Vec<bool>>, u64),
}

/// A stage's memory: whether its inputs are new.
#[derive(Debug)]
struct Memory<T>(Option<T>);

impl<T> Default for Memory<T> {
    fn default() -> Self {
        Self(None)
    }
}

impl<T: PartialEq> Memory<T> {
    fn is_new(&mut self, inputs: T) -> bool {
        let new = self.0.as_ref() != Some(&inputs);
        self.0 = Some(inputs);
        new
    }
}

/// What one side of a comparison is painted with.
#[derive(Clone, Copy, Debug, PartialEq)]
enum SidePaint {
    Stored,
    Relit(Part),
    Pinned,
    Normals,
    Tau,
    Visibility,
    Doubts,
    /// Depth shows no colour.
    White,
}

/// What a side's picture depends on besides the camera's rotation and the order, which redraw it anyway.
#[derive(Debug, PartialEq)]
struct ShadeKey {
    paint: SidePaint,
    eye: Vec3,
    space: ColorSpace,
    /// Version of the marks over it, where there are any.
    marks: Option<u64>,
    /// Versions of what it is painted with, and of the asset.
    versions: [u64; 2],
}

#[derive(Default)]
struct Side {
    target: Option<Target>,
    shaded: Memory<ShadeKey>,
    /// Counts up whenever the target is drawn anew.
    version: u64,
}

struct Screen {
    view: wgpu::TextureView,
    texture: wgpu::Texture,
    size: [usize; 2],
    blit: wgpu::BindGroup,
}

/// Stages and pictures of one window.
pub struct Live {
    context: Arc<Context>,
    present: PresentPass,
    blit: Blit,
    asset: Option<LiveAsset>,
    relit: Option<Relit>,
    pinned: Option<(ResidentSh, Display)>,
    visibility: Vec<[f32; 3]>,
    doubts: Vec<[f32; 3]>,
    marks: Option<ResidentVectors>,
    backdrops: [Option<Backdrop>; 2],
    ground: [Option<GroundLit>; 2],
    sides: [Side; 2],
    order: Option<Order>,
    screen: Option<Screen>,
    sorted: Memory<(Vec3, Vec3, u64, u64)>,
    projected: Memory<(Camera, u64)>,
    presented: Memory<(Presentation, [u64; 2], u64)>,
    /// Count up with each new asset, relight, set of colours, marks and texture.
    asset_version: u64,
    relit_version: u64,
    pinned_version: u64,
    visibility_version: u64,
    doubts_version: u64,
    marks_version: u64,
    texture_version: u64,
    passes: Passes,
}

impl Live {
    /// Compiles what every frame needs, for a window of a format.
    pub fn new(context: &Arc<Context>, window: wgpu::TextureFormat) -> Self {
        Self {
            present: PresentPass::new(context),
            blit: Blit::new(context, window),
            context: context.clone(),
            asset: None,
            relit: None,
            pinned: None,
            visibility: Vec::new(),
            doubts: Vec::new(),
            marks: None,
            backdrops: [None, None],
            ground: [None, None],
            sides: Default::default(),
            order: None,
            screen: None,
            sorted: Memory::default(),
            projected: Memory::default(),
            presented: Memory::default(),
            asset_version: 0,
            relit_version: 0,
            pinned_version: 0,
            visibility_version: 0,
            doubts_version: 0,
            marks_version: 0,
            texture_version: 0,
            passes: Passes::default(),
        }
    }

    /// How often each stage ran so far.
    pub fn passes(&self) -> Passes {
        self.passes
    }

    /// How many surfels the last frame drew.
    pub fn drawn(&self) -> usize {
        self.order.as_ref().map_or(0, |o| o.drawn)
    }

    /// Whether there is something relit to be shown.
    pub fn has_relit(&self) -> bool {
        self.relit_version > 0 && self.relit.is_some()
    }

    /// Shows another asset; what was made of the last one is dropped.
    pub fn set_asset(&mut self, asset: LiveAsset) {
        self.asset = Some(asset);
        self.relit = None;
        self.relit_version = 0;
        self.pinned = None;
        self.visibility.clear();
        self.doubts.clear();
        self.marks = None;
        self.ground = [None, None];
        self.asset_version += 1;
        self.texture_version += 1;
    }

    /// Takes another preparation of the same asset; shown from the next [`Live::relight`] on.
    pub fn set_transfer(&mut self, transfer: GpuTransfer) {
        self.relit = Some(Relit::Live(Box::new(transfer)));
    }

    /// Shows what was relit on the CPU, with its colours in the channel *tau*.
    pub fn set_relit(&mut self, relit: ResidentSh, tau: Vec<[f32; 3]>) {
        self.relit = Some(Relit::Uploaded(relit, tau));
        self.relit_version += 1;
        self.passes.transfer += 1;
    }

    /// Relights by another light, for a view that shows a part of it, and leaves out surfels that nobody sees (`[n]` or empty).
    ///
    /// # Errors
    /// The light was not read for the method.
    pub fn relight(
        &mut self,
        target: &Illumination,
        part: Part,
        unseen: &[bool],
    ) -> transplat_core::Result<()> {
        if let Some(Relit::Live(transfer)) = &mut self.relit {
            transfer.submit(target, part, unseen)?;
            self.relit_version += 1;
            self.passes.transfer += 1;
        }
        Ok(())
    }

    /// Keeps what is shown relit now, to compare others with it.
    pub fn pin(&mut self, display: Display) {
        let relit = self.relit.as_ref().map(Relit::sh);
        self.pinned = relit.map(|r| (r.snapshot(&self.context), display));
        self.pinned_version += 1;
    }

    /// The same with what was relit on the CPU.
    pub fn pin_relit(&mut self, relit: ResidentSh, display: Display) {
        self.pinned = Some((relit, display));
        self.pinned_version += 1;
    }

    /// Sets the surfel colours of the channel *visibility*.
    pub fn set_visibility(&mut self, colors: Vec<[f32; 3]>) {
        self.visibility = colors;
        self.visibility_version += 1;
    }

    /// Sets the surfel colours of the channel *doubts*, and the marks with their weight.
    pub fn set_doubts(&mut self, colors: Vec<[f32; 3]>, marks: impl Iterator<Item = [f32; 4]>) {
        self.doubts = colors;
        self.marks = Some(ResidentVectors::upload(&self.context, marks));
        self.doubts_version += 1;
        self.marks_version += 1;
    }

    /// Sets the map behind one side: 0 is what is as captured, 1 what is relit.
    pub fn set_backdrop(&mut self, side: usize, backdrop: Backdrop) {
        self.passes.backdrop += 1;
        self.backdrops[side] = Some(backdrop);
        self.texture_version += 1;
    }

    /// Sets the lit share of the ground, `[GROUND_CELLS^2]`, under source and target.
    pub fn set_ground(&mut self, lit: [&[f32]; 2]) {
        self.ground = lit.map(|lit| Some(GroundLit::new(&self.context, lit)));
        self.texture_version += 1;
    }

    /// Brings the screen's picture up to date, and tells whether anything ran.
    pub fn frame(&mut self, frame: &Frame) -> bool {
        let Some(asset) = self.asset.take() else {
            return false;
        };
        let before = self.passes;
        let mut frame = frame.clone();
        let presentation = &mut frame.presentation;
        presentation.depth_unit = asset.rasterizer.depth_unit(&presentation.camera);
        presentation.false_color &= presentation.view.is_light();
        presentation.display = presentation.display.for_picture(presentation.false_color);
        self.draw_sides(&asset, &frame);
        let presentation = &frame.presentation;
        self.size_screen(presentation.size);
        let versions = [self.sides[0].version, self.sides[1].version];
        if self
            .presented
            .is_new((*presentation, versions, self.texture_version))
        {
            self.present(presentation);
        }
        self.asset = Some(asset);
        self.passes != before
    }

    fn draw_sides(&mut self, asset: &LiveAsset, frame: &Frame) {
        let view = frame.presentation.view;
        let camera = &frame.presentation.camera;
        let forward = camera.view_from_world.transpose() * Vec3::Z;
        let (hidden, hidden_version) = &frame.hidden;
        let sort_key = (camera.eye, forward, *hidden_version, self.asset_version);
        let mut moved = false;
        if self.sorted.is_new(sort_key) || self.order.is_none() {
            self.order = Some(asset.rasterizer.sort(camera, hidden));
            self.passes.sort += 1;
            moved = true;
        }
        if self.projected.is_new((*camera, self.asset_version)) {
            asset.rasterizer.project(camera);
            self.passes.project += 1;
            moved = true;
        }
        if moved {
            // Neither side is what the camera sees any more, the one not shown now included.
            for side in &mut self.sides {
                side.shaded = Memory::default();
            }
        }
        let wanted = [
            (view == View::Before || view.has_two_sides()).then(|| self.left_paint(frame)),
            (view != View::Before).then(|| self.right_paint(view)),
        ];
        for (side, paint) in wanted.into_iter().enumerate() {
            if let Some(paint) = paint {
                self.draw_side(asset, frame, side, paint);
            }
        }
    }

    fn left_paint(&self, frame: &Frame) -> SidePaint {
        if frame.against_pinned && self.pinned.is_some() && frame.presentation.view != View::Before
        {
            SidePaint::Pinned
        } else {
            SidePaint::Stored
        }
    }

    fn right_paint(&self, view: View) -> SidePaint {
        match view {
            View::Normals => SidePaint::Normals,
            View::Depth => SidePaint::White,
            View::Visibility if !self.visibility.is_empty() => SidePaint::Visibility,
            View::Doubts if !self.doubts.is_empty() => SidePaint::Doubts,
            View::Visibility | View::Doubts => SidePaint::White,
            // Until something is relit, the capture is what there is.
            _ if !self.has_relit() => SidePaint::Stored,
            View::Tau => SidePaint::Tau,
            _ => SidePaint::Relit(view.part()),
        }
    }

    fn draw_side(&mut self, asset: &LiveAsset, frame: &Frame, side: usize, paint: SidePaint) {
        let camera = &frame.presentation.camera;
        let size = [camera.width, camera.height];
        let pinned = self.pinned.as_ref();
        let space = match paint {
            SidePaint::Stored | SidePaint::Relit(_) => {
                ColorSpace::Display(frame.presentation.display)
            }
            SidePaint::Pinned => pinned.map_or(PLAIN, |(_, display)| ColorSpace::Display(*display)),
            _ => PLAIN,
        };
        let marks = (frame.marks && self.marks.is_some()).then_some(self.marks_version);
        let paint_version = match paint {
            SidePaint::Relit(_) | SidePaint::Tau => self.relit_version,
            SidePaint::Pinned => self.pinned_version,
            SidePaint::Visibility => self.visibility_version,
            SidePaint::Doubts => self.doubts_version,
            _ => 0,
        };
        let state = &mut self.sides[side];
        let resized = state.target.as_ref().is_none_or(|t| t.size != size);
        let key = ShadeKey {
            paint,
            eye: camera.eye,
            space,
            marks,
            versions: [paint_version, self.asset_version],
        };
        if !state.shaded.is_new(key) && !resized {
            return;
        }
        if resized {
            state.target = Some(Target::new(&self.context, size));
        }
        let rasterizer = &asset.rasterizer;
        let resident = match (paint, &self.relit) {
            (SidePaint::Relit(part), Some(relit)) => Some(relit.paint(part)),
            (SidePaint::Tau, Some(Relit::Live(transfer))) => Some(transfer.ratio_paint()),
            (SidePaint::Pinned, _) => pinned.map(|(sh, _)| ResidentPaint::Sh(sh, Part::Whole)),
            (SidePaint::Stored, _) => Some(ResidentPaint::Sh(&asset.stored, Part::Whole)),
            (SidePaint::Normals, _) => Some(ResidentPaint::Normals(&asset.normals)),
            _ => None,
        };
        match (resident, paint) {
            (Some(resident), _) => rasterizer.shade(camera, resident, space),
            (None, SidePaint::Visibility) => rasterizer.set_colors(&self.visibility),
            (None, SidePaint::Doubts) => rasterizer.set_colors(&self.doubts),
            (None, SidePaint::Tau) if let Some(Relit::Uploaded(_, tau)) = &self.relit => {
                rasterizer.set_colors(tau)
            }
            (None, _) => rasterizer.fill_colors([1.0; 3]),
        }
        self.passes.shade += 1;
        if let (Some(_), Some(marks)) = (marks, &self.marks) {
            rasterizer.overlay(camera, marks);
        }
        if let (Some(order), Some(target)) = (&self.order, &self.sides[side].target) {
            rasterizer.draw_tile(camera, [0, 0], order, target);
            self.passes.draw += 1;
            self.sides[side].version += 1;
        }
    }

    fn size_screen(&mut self, size: [usize; 2]) {
        if self.screen.as_ref().is_some_and(|s| s.size == size) {
            return;
        }
        let texture = self
            .context
            .device
            .create_texture(&wgpu::TextureDescriptor {
                label: Some("screen"),
                size: extent(size),
                mip_level_count: 1,
                sample_count: 1,
                dimension: wgpu::TextureDimension::D2,
                format: SCREEN_FORMAT,
                usage: wgpu::TextureUsages::RENDER_ATTACHMENT
                    | wgpu::TextureUsages::TEXTURE_BINDING
                    | wgpu::TextureUsages::COPY_SRC,
                view_formats: &[],
            });
        let view = texture.create_view(&Default::default());
        self.screen = Some(Screen {
            blit: self.blit.bind(&self.context, &view),
            texture,
            view,
            size,
        });
        self.presented = Memory::default();
    }

    fn present(&mut self, presentation: &Presentation) {
        // A side that the view does not show stands in for the other.
        let targets = self.sides.each_ref().map(|s| s.target.as_ref());
        let (Some(screen), Some(any)) = (&self.screen, targets[0].or(targets[1])) else {
            return;
        };
        self.present.present(
            &self.context,
            presentation,
            targets.map(|t| t.unwrap_or(any)),
            self.backdrops.each_ref().map(Option::as_ref),
            self.ground.each_ref().map(Option::as_ref),
            &screen.view,
        );
        self.passes.present += 1;
    }

    /// Draws the screen's picture over the viewport of a window's pass.
    pub fn paint(&self, pass: &mut wgpu::RenderPass<'_>) {
        if let Some(screen) = &self.screen {
            self.blit.draw(pass, &screen.blit);
        }
    }

    /// Reads the screen's picture back, `[height][width][4]`, 0 to 1: for tests, never to show it.
    ///
    /// # Errors
    /// The driver failed.
    pub fn read_screen(&self) -> Result<(Vec<f32>, [usize; 2])> {
        match &self.screen {
            Some(screen) => Ok((
                read_texture(&self.context, &screen.texture, screen.size, 4)?,
                screen.size,
            )),
            None => Ok((Vec::new(), [0, 0])),
        }
    }
}
