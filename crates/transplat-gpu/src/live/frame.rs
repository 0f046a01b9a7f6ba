//! Settings of a frame, and counts of its passes.

use std::sync::Arc;

use glam::Affine3A;

use crate::present::Presentation;

/// Counts of GPU passes.
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

/// Place of an object in the scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Placement {
    /// From its coordinates to the scene's: scaled by one factor, turned, moved.
    pub scene_from_object: Affine3A,
    /// True where it is drawn.
    pub shown: bool,
    /// Its surfels that are not drawn, `[n]` or empty.
    pub hidden: Arc<Vec<bool>>,
    /// Differs where they do.
    pub hidden_version: u64,
}

/// Settings of a frame.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Everything that is not the surfels' own colour.
    pub presentation: Presentation,
    /// True where the left side of a comparison is the pinned look instead of the capture.
    pub against_pinned: bool,
    /// True where marks are laid over the surfels.
    pub marks: bool,
    /// By how much the edges of the picture are shorter than the screen's, while something moves: 1 is all pixels.
    pub pixel_step: usize,
    /// Places of the objects in the scene.
    pub objects: Vec<Placement>,
}
