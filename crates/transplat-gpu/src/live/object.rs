//! An object with all that may be shown of it, and which of that a side of a picture shows.

use std::borrow::Cow;
use std::sync::Arc;

use glam::{Affine3A, Vec3};
use transplat_core::camera::Camera;
use transplat_core::color::Display;
use transplat_core::derived::Derived;
use transplat_core::present::{PLAIN, View};
use transplat_core::rasterize::ColorSpace;
use transplat_core::sh::with_degree;
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::Part;

use super::frame::Frame;
use crate::context::{Context, Result};
use crate::rasterize::{GpuRasterizer, ResidentPaint, ResidentSh, ResidentVectors};
use crate::transfer::GpuTransfer;

/// An asset on the GPU; made on any thread.
pub struct LiveAsset {
    pub(super) rasterizer: GpuRasterizer,
    pub(super) stored: ResidentSh,
    pub(super) normals: ResidentVectors,
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
        let rasterizer = GpuRasterizer::new(context, cloud)?;
        // What every frame draws with; no frame waits for it.
        rasterizer.draw_pass(false);
        Ok(Self {
            rasterizer,
            stored: ResidentSh::upload(context, &filled, degree, cloud.encoding),
            normals: ResidentVectors::upload(
                context,
                (0..cloud.len()).map(|i| cloud.stored_normal(i).extend(0.0).to_array()),
            ),
        })
    }
}

/// Where what is shown relit comes from.
pub(super) enum Relit {
    /// From the GPU's own transfer.
    Live(Box<GpuTransfer>),
    /// From the CPU, with the colours of the channel *tau*.
    Uploaded(ResidentSh, Vec<[f32; 3]>),
}

impl Relit {
    pub fn sh(&self) -> &ResidentSh {
        match self {
            Self::Live(transfer) => transfer.resident(),
            Self::Uploaded(sh, _) => sh,
        }
    }

    pub fn paint(&self, part: Part) -> ResidentPaint<'_> {
        match self {
            Self::Live(transfer) => transfer.paint(part),
            Self::Uploaded(sh, _) => ResidentPaint::Sh(sh, Part::Whole),
        }
    }
}

/// What one side of a comparison is painted with.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum SidePaint {
    Stored,
    Relit(Part),
    Pinned,
    Normals,
    Tau,
    /// A channel whose colours no light changes.
    Channel(View),
    Doubts,
    /// Depth shows no colour.
    White,
}

/// What an object looks like on a side, besides the camera's rotation and the order, which redraw it anyway.
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
pub(super) struct Doubts {
    pub colors: Vec<[f32; 3]>,
    pub marks: ResidentVectors,
}

/// An object with all that may be shown of it.
pub(super) struct LiveObject {
    /// Differs between all objects.
    pub id: u64,
    pub asset: LiveAsset,
    /// Its version is 0 until there is something relit.
    pub relit: Versioned<Option<Relit>>,
    pub pinned: Versioned<Option<(ResidentSh, Display)>>,
    /// Surfel colours of the channel that was made last.
    pub channel: Versioned<Option<(View, Vec<[f32; 3]>)>>,
    pub doubts: Versioned<Option<Doubts>>,
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
            View::Doubts if self.doubts.value.is_some() => SidePaint::Doubts,
            View::Visibility | View::Albedo | View::Glow | View::Doubts => SidePaint::White,
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
        let is_marked = frame.marks && self.doubts.value.is_some();
        ShadeKey {
            object: self.id,
            paint,
            version: match paint {
                SidePaint::Relit(_) | SidePaint::Tau => self.relit.version,
                SidePaint::Pinned => self.pinned.version,
                SidePaint::Channel(_) => self.channel.version,
                SidePaint::Doubts => self.doubts.version,
                _ => 0,
            },
            eye: self.camera(frame).eye,
            space,
            marks: is_marked.then_some(self.doubts.version),
        }
    }

    /// Colours the surfels.
    pub fn shade(&self, camera: &Camera, key: &ShadeKey) {
        let rasterizer = &self.asset.rasterizer;
        let resident = match (key.paint, &self.relit.value, &self.pinned.value) {
            (SidePaint::Relit(part), Some(relit), _) => Some(relit.paint(part)),
            (SidePaint::Tau, Some(Relit::Live(transfer)), _) => Some(transfer.ratio_paint()),
            (SidePaint::Pinned, _, Some((sh, _))) => Some(ResidentPaint::Sh(sh, Part::Whole)),
            (SidePaint::Stored, ..) => Some(ResidentPaint::Sh(&self.asset.stored, Part::Whole)),
            (SidePaint::Normals, ..) => Some(ResidentPaint::Normals(&self.asset.normals)),
            _ => None,
        };
        let doubts = &self.doubts.value;
        match (resident, key.paint, &self.relit.value, doubts) {
            (Some(resident), ..) => rasterizer.shade(camera, resident, key.space),
            (None, SidePaint::Channel(view), ..) => {
                rasterizer.set_colors(self.channel_of(view).unwrap_or_default());
            }
            (None, SidePaint::Doubts, _, Some(doubts)) => rasterizer.set_colors(&doubts.colors),
            (None, SidePaint::Tau, Some(Relit::Uploaded(_, tau)), _) => rasterizer.set_colors(tau),
            (None, ..) => rasterizer.fill_colors([1.0; 3]),
        }
        if let (Some(_), Some(doubts)) = (key.marks, doubts) {
            rasterizer.shade(camera, ResidentPaint::Marks(&doubts.marks), PLAIN);
        }
    }
}
