//! Object on the GPU, with all colours that a side of an image may show.

use std::sync::Arc;

use glam::{Affine3A, Vec3};
use transplat_core::camera::Camera;
use transplat_core::color::Display;
use transplat_core::derived::Derived;
use transplat_core::present::{PLAIN, View};
use transplat_core::rasterize::{ColorSpace, Functions, Shading};
use transplat_core::sh::{coefficient_count, with_degree};
use transplat_core::surfels::{Bounds, SurfelCloud};
use transplat_core::transfer::cast_shadows::PlacedShadows;
use transplat_core::transfer::{Part, Relit, RelitRows};

use super::frame::{Frame, Placement};
use super::paint::{Color, ObjectPaint};
use crate::context::{Context, Result};
use crate::rasterize::{GpuRasterizer, ResidentPaint, ResidentSh, ResidentVectors, depth_unit};
use crate::transfer::GpuTransfer;

/// Where a window's objects are drawn.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Drawing {
    /// By the adapter.
    Gpu,
    /// By the CPU's own rasterizer; the adapter shows its pictures.
    Cpu,
}

impl Drawing {
    /// Drawing that is fastest with an adapter: a software driver draws far slower than the CPU rasterizer.
    pub fn fastest(context: &Context) -> Self {
        if context.is_software() {
            Self::Cpu
        } else {
            Self::Gpu
        }
    }

    /// A result as it is kept where this draws: the adapter takes it whole.
    pub fn kept(self, relit: Relit) -> RelitRows {
        match self {
            Self::Gpu => RelitRows::whole(relit),
            Self::Cpu => RelitRows::of(relit),
        }
    }
}

/// An asset where it is drawn; made on any thread.
pub struct LiveSplat {
    pub(super) cloud: Arc<SurfelCloud>,
    pub(super) bounds: Bounds,
    /// SH degree of its colour, empty bands left out.
    degree: usize,
    /// None where the CPU draws, which takes the surfels as they are.
    pub(super) on_gpu: Option<AssetOnGpu>,
}

pub(super) struct AssetOnGpu {
    pub rasterizer: GpuRasterizer,
    stored: ResidentSh,
    normals: ResidentVectors,
}

impl LiveSplat {
    /// Brings an asset there.
    ///
    /// # Errors
    /// It is too large for the adapter, or the driver failed.
    pub fn new(context: &Arc<Context>, cloud: &Arc<SurfelCloud>, drawing: Drawing) -> Result<Self> {
        let degree = cloud.filled_degree();
        let on_gpu = (drawing == Drawing::Gpu).then(|| AssetOnGpu::new(context, cloud, degree));
        Ok(Self {
            cloud: cloud.clone(),
            bounds: cloud.bounds(),
            degree,
            on_gpu: on_gpu.transpose()?,
        })
    }
}

impl AssetOnGpu {
    fn new(context: &Arc<Context>, cloud: &Arc<SurfelCloud>, degree: usize) -> Result<Self> {
        let filled = with_degree(cloud.sh.clone(), cloud.sh_degree, degree);
        let normals = (0..cloud.len()).map(|i| cloud.stored_normal(i).extend(0.0).to_array());
        let normals: Vec<[f32; 4]> = normals.collect();
        let rasterizer = GpuRasterizer::new(context, cloud)?;
        rasterizer.warm_up();
        Ok(Self {
            rasterizer,
            stored: ResidentSh::upload(context, &filled, degree, cloud.encoding),
            normals: ResidentVectors::upload(context, &normals),
        })
    }
}

/// Colour that was relit on the CPU, where it is drawn; made on any thread.
#[derive(Clone)]
pub enum LiveSh {
    /// Uploaded.
    Gpu(ResidentSh),
    /// As it is.
    Cpu(Arc<RelitRows>),
    /// Captured colour times a factor by surfel, `[n]`: drawn by the CPU alone.
    Coarse(Arc<Vec<[f32; 3]>>),
}

impl LiveSh {
    /// Brings it there.
    pub fn new(context: &Context, relit: &Arc<RelitRows>, drawing: Drawing) -> Self {
        match drawing {
            Drawing::Gpu => Self::Gpu(ResidentSh::upload(
                context,
                &relit.sh.values(),
                relit.degree,
                relit.encoding,
            )),
            Drawing::Cpu => Self::Cpu(relit.clone()),
        }
    }
}

/// Where what is shown relit comes from.
pub(super) enum Shown {
    /// From the GPU's own transfer.
    Live(Box<GpuTransfer>),
    /// From the CPU, with the colours of the channel *tau*.
    Made(LiveSh, Vec<[f32; 3]>),
}

impl Shown {
    /// A copy that later transfers do not change.
    pub fn snapshot(&self, context: &Context) -> LiveSh {
        match self {
            Self::Live(transfer) => LiveSh::Gpu(transfer.resident().snapshot(context)),
            // That is never written again.
            Self::Made(sh, _) => sh.clone(),
        }
    }

    fn paint(&self, part: Part) -> Option<ResidentPaint<'_>> {
        match self {
            Self::Live(transfer) => Some(transfer.paint(part)),
            Self::Made(sh, _) => sh.paint(),
        }
    }
}

impl LiveSh {
    fn paint(&self) -> Option<ResidentPaint<'_>> {
        match self {
            Self::Gpu(sh) => Some(ResidentPaint::Sh(sh, Part::Whole)),
            Self::Cpu(_) | Self::Coarse(_) => None,
        }
    }
}

/// Paint of one side of a comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SidePaint {
    Stored,
    Relit(Part),
    Pinned,
    Normals,
    Tau,
    /// A channel whose colours no light changes.
    Channel(View),
    ConfidenceMap,
    /// Depth shows no colour.
    White,
}

/// Inputs of an object's colours on a side, besides the camera's rotation and the order, which redraw it anyway.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct ShadeKey {
    pub object: u64,
    pub paint: SidePaint,
    /// Version of what it is painted with.
    pub version: u64,
    pub eye: Vec3,
    pub space: ColorSpace,
    /// Version of the marks over it, where there are any.
    pub marks: Option<u64>,
}

/// Something that is shown, and a number that differs where it does.
#[derive(Default)]
pub(super) struct Versioned<T> {
    pub value: T,
    pub version: u64,
}

impl<T> Versioned<T> {
    pub fn set(&mut self, value: T) {
        self.value = value;
        self.version += 1;
    }
}

/// Surfel colours of the channel *doubts*, and the marks with their weight.
pub(super) struct ConfidenceMap {
    colors: Vec<[f32; 3]>,
    marks: Marks,
}

/// `[n]`, where they are laid over the colours.
enum Marks {
    Gpu(ResidentVectors),
    Cpu(Vec<[f32; 4]>),
}

impl ConfidenceMap {
    pub fn new(
        context: &Context,
        colors: Vec<[f32; 3]>,
        marks: Vec<[f32; 4]>,
        drawing: Drawing,
    ) -> Self {
        let marks = match drawing {
            Drawing::Gpu => Marks::Gpu(ResidentVectors::upload(context, &marks)),
            Drawing::Cpu => Marks::Cpu(marks),
        };
        Self { colors, marks }
    }
}

/// An object with all that may be shown of it.
pub(super) struct LiveObject {
    /// Differs between all objects.
    pub id: u64,
    pub asset: LiveSplat,
    /// Its version is 0 until there is something relit.
    pub relit: Versioned<Option<Shown>>,
    pub pinned: Versioned<Option<(LiveSh, Display)>>,
    /// Surfel colours of the channel that was made last.
    pub channel: Versioned<Option<(View, Vec<[f32; 3]>)>>,
    pub confidence: Versioned<Option<ConfidenceMap>>,
    pub scene_from_object: Affine3A,
    pub projected: Derived<Camera, ()>,
}

impl LiveObject {
    pub fn has_relit(&self) -> bool {
        self.relit.version > 0 && self.relit.value.is_some()
    }

    /// The camera as the object sees it.
    pub fn camera(&self, frame: &Frame) -> Camera {
        let camera = &frame.presentation.camera;
        if self.scene_from_object == Affine3A::IDENTITY {
            return *camera;
        }
        camera.seen_from(self.scene_from_object)
    }

    pub fn left_paint(&self, frame: &Frame) -> SidePaint {
        let is_pinned = frame.against_pinned && self.pinned.value.is_some();
        if is_pinned && frame.presentation.view != View::Before {
            SidePaint::Pinned
        } else {
            SidePaint::Stored
        }
    }

    pub fn right_paint(&self, view: View) -> SidePaint {
        match view {
            View::Normals => SidePaint::Normals,
            View::Depth => SidePaint::White,
            _ if self.channel_of(view).is_some() => SidePaint::Channel(view),
            View::Confidence if self.confidence.value.is_some() => SidePaint::ConfidenceMap,
            View::Visibility | View::Albedo | View::Emission | View::Confidence => SidePaint::White,
            // Until something is relit, the capture is what there is.
            _ if !self.has_relit() => SidePaint::Stored,
            View::Tau => SidePaint::Tau,
            _ => SidePaint::Relit(view.part()),
        }
    }

    /// Surfel colours of a channel, if it is the one that was made last.
    fn channel_of(&self, view: View) -> Option<&[[f32; 3]]> {
        let channel = self.channel.value.as_ref();
        let channel = channel.filter(|(of, _)| *of == view);
        channel.map(|(_, colors)| &colors[..])
    }

    pub fn key(&self, paint: SidePaint, frame: &Frame) -> ShadeKey {
        let space = match (paint, &self.pinned.value) {
            (SidePaint::Stored | SidePaint::Relit(_), _) => {
                ColorSpace::Display(frame.presentation.display)
            }
            (SidePaint::Pinned, Some((_, display))) => ColorSpace::Display(*display),
            _ => PLAIN,
        };
        let is_marked = frame.marks && self.confidence.value.is_some();
        ShadeKey {
            object: self.id,
            paint,
            version: match paint {
                SidePaint::Relit(_) | SidePaint::Tau => self.relit.version,
                SidePaint::Pinned => self.pinned.version,
                SidePaint::Channel(_) => self.channel.version,
                SidePaint::ConfidenceMap => self.confidence.version,
                _ => 0,
            },
            eye: self.camera(frame).eye,
            space,
            marks: is_marked.then_some(self.confidence.version),
        }
    }

    /// The object's distance and size together: depths are around 1 in it, whatever the scene's unit.
    pub fn depth_unit(&self, camera: &Camera) -> f32 {
        self.scale() * depth_unit(&self.asset.bounds, camera)
    }

    /// Length of its unit in the scene's.
    pub fn scale(&self) -> f32 {
        self.scene_from_object.to_scale_rotation_translation().0.x
    }

    /// Colours that are a surfel's own, whoever looks.
    fn own_colors(&self, paint: SidePaint) -> Option<&[[f32; 3]]> {
        match (paint, &self.relit.value) {
            (SidePaint::Channel(view), _) => self.channel_of(view),
            (SidePaint::ConfidenceMap, _) => self.confidence.value.as_ref().map(|d| &d.colors[..]),
            (SidePaint::Tau, Some(Shown::Made(_, tau))) => Some(tau),
            _ => None,
        }
    }

    /// Marks that are laid over the colours.
    fn marks(&self, key: &ShadeKey) -> Option<&Marks> {
        let confidence = self
            .confidence
            .value
            .as_ref()
            .filter(|_| key.marks.is_some());
        confidence.map(|confidence| &confidence.marks)
    }

    /// Colours the surfels on the GPU.
    pub fn shade(&self, camera: &Camera, key: &ShadeKey) {
        let Some(AssetOnGpu {
            rasterizer,
            stored,
            normals,
        }) = &self.asset.on_gpu
        else {
            return;
        };
        let resident = match (key.paint, &self.relit.value, &self.pinned.value) {
            (SidePaint::Relit(part), Some(relit), _) => relit.paint(part),
            (SidePaint::Tau, Some(Shown::Live(transfer)), _) => Some(transfer.ratio_paint()),
            (SidePaint::Pinned, _, Some((sh, _))) => sh.paint(),
            (SidePaint::Stored, ..) => Some(ResidentPaint::Sh(stored, Part::Whole)),
            (SidePaint::Normals, ..) => Some(ResidentPaint::Normals(normals)),
            _ => None,
        };
        match (resident, self.own_colors(key.paint)) {
            (Some(resident), _) => rasterizer.shade(camera, resident, key.space),
            (None, Some(colors)) => rasterizer.set_colors(colors),
            (None, None) => rasterizer.fill_colors([1.0; 3]),
        }
        if let Some(Marks::Gpu(marks)) = self.marks(key) {
            rasterizer.shade(camera, ResidentPaint::Marks(marks), PLAIN);
        }
    }

    /// Colours of the surfels on the CPU, which are counted after `first` others.
    pub fn paint<'a>(&'a self, camera: &Camera, key: &ShadeKey, first: usize) -> ObjectPaint<'a> {
        let cloud = &*self.asset.cloud;
        let shading = |sh: Functions<'a>, [degree, filled]: [usize; 2], encoding| Shading {
            positions: &cloud.positions,
            sh,
            degree,
            encoding,
            gains: None,
            coefficients: 0..coefficient_count(filled),
            eye: camera.eye,
            space: key.space,
        };
        let stored = || {
            let degrees = [cloud.sh_degree, self.asset.degree];
            shading(Functions::Flat(&cloud.sh), degrees, cloud.encoding)
        };
        let mut shadows = Vec::new();
        let shading = match (key.paint, &self.relit.value, &self.pinned.value) {
            (SidePaint::Relit(_), Some(Shown::Made(LiveSh::Cpu(relit), _)), _)
            | (SidePaint::Pinned, _, Some((LiveSh::Cpu(relit), _))) => {
                let placed = |s: &PlacedShadows| s.clone().moved(first, self.scene_from_object);
                shadows = relit.shadows.iter().map(placed).collect();
                let functions = Functions::Rows(&relit.sh);
                Some(shading(functions, [relit.degree; 2], relit.encoding))
            }
            (SidePaint::Relit(_), Some(Shown::Made(LiveSh::Coarse(gains), _)), _) => {
                Some(Shading {
                    gains: Some(gains),
                    ..stored()
                })
            }
            (SidePaint::Stored, ..) => Some(stored()),
            _ => None,
        };
        let color = match (shading, self.own_colors(key.paint)) {
            (Some(shading), _) => Color::Sh(shading),
            (None, Some(colors)) => Color::Own(colors),
            (None, None) if key.paint == SidePaint::Normals => Color::Normals(cloud, camera.eye),
            (None, None) => Color::White,
        };
        ObjectPaint {
            color,
            shadows,
            marks: match self.marks(key) {
                Some(Marks::Cpu(marks)) => Some(marks),
                _ => None,
            },
        }
    }
}

/// Objects that are there, with their places.
pub(super) fn placed<'a>(
    objects: &'a [Option<LiveObject>],
    frame: &'a Frame,
) -> impl Iterator<Item = (&'a LiveObject, &'a Placement)> + Clone {
    let each = objects.iter().zip(&frame.objects);
    each.filter_map(|(object, placement)| Some((object.as_ref()?, placement)))
}

/// Visibility and version of each object.
pub(super) type ShownObjects = Vec<(bool, u64)>;

pub(super) fn shown(objects: &[Option<LiveObject>], frame: &Frame) -> ShownObjects {
    let each = placed(objects, frame);
    each.map(|(_, p)| (p.shown, p.hidden_version)).collect()
}
