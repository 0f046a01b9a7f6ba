//! Images in memory, their layout and provenance.

use serde::{Deserialize, Serialize};

/// An image in linear Rec. 709, premultiplied.
#[derive(Clone, Debug)]
pub struct Image {
    /// Pixels across.
    pub width: usize,
    /// Pixels down.
    pub height: usize,
    /// `[height][width]`
    pub pixels: Vec<[f32; 3]>,
    /// `[height][width]`, or empty where it is opaque.
    pub alpha: Vec<f32>,
    /// True for display-encoded images, whose highlights are clipped.
    pub is_clipped: bool,
    /// Layout of the directions, where the file has it.
    pub layout: Option<Layout>,
    /// Layer of the file, and what reading it assumed.
    pub provenance: Provenance,
}

/// The part of a file that an image is, and what reading it assumed.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Provenance {
    /// Names of all colour layers of the file, where it has several.
    pub layers: Vec<String>,
    /// The one that was read, where there are several.
    pub layer: Option<String>,
    /// For the user: what was assumed, and how to say otherwise.
    pub warnings: Vec<String>,
}

impl Image {
    /// An opaque image of its pixels.
    pub fn new(width: usize, height: usize, pixels: Vec<[f32; 3]>) -> Self {
        Self {
            width,
            height,
            pixels,
            alpha: Vec::new(),
            is_clipped: false,
            layout: None,
            provenance: Provenance::default(),
        }
    }
}

/// Layout of all directions in an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// A panorama: columns are azimuths, rows heights.
    #[default]
    Equirectangular,
    /// The six faces of a cube as a cross of 4 x 3 squares, or of 3 x 4 with what is behind upside down below.
    CubeCross,
    /// The six faces of a cube below each other, as OpenEXR's `envmap` attribute has them.
    CubeColumn,
    /// A disc in a square whose radius is the angle to what is in the middle, as light probes come (Debevec, "Rendering Synthetic Objects
    /// into Real Scenes", 1998).
    AngularMap,
    /// A photograph of a mirroring ball, cut to its outline; what is in the middle was behind the camera.
    MirrorBall,
}

/// Layout and layer that an environment's file is read by, where they are set.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImageReading {
    /// Layout; none for that of the file or its shape.
    pub layout: Option<Layout>,
    /// Layer or part of an OpenEXR file; none for the one that its names suggest.
    pub layer: Option<String>,
}
