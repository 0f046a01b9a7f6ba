//! Images as they are read from files, whatever they are for.

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
    /// Whether it was display-encoded, so that its highlights are clipped.
    pub is_clipped: bool,
    /// How it lays out what is all around, where its file says so.
    pub layout: Option<Layout>,
    /// Which part of the file it is, and what reading it assumed.
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

/// How a picture lays out all directions.
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

/// How an environment's file is read, where that is set: its layout, and its layer.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct ImageReading {
    /// How it lays out all directions; none where the file or its shape says.
    pub layout: Option<Layout>,
    /// Which layer or part of an OpenEXR file is read; none where its names say.
    pub layer: Option<String>,
}
