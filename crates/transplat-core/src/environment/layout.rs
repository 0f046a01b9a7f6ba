//! How a picture lays out what is all around.

use serde::{Deserialize, Serialize};

/// How a picture lays out all directions.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Layout {
    /// A panorama: columns are azimuths, rows heights.
    #[default]
    Equirectangular,
    /// The six faces of a cube as a cross of 4 x 3 squares, or of 3 x 4 with what is behind upside down below.
    CubeCross,
    /// A disc in a square whose radius is the angle to what is in the middle, as light probes come (Debevec, "Rendering Synthetic Objects
    /// into Real Scenes", 1998).
    AngularMap,
    /// A photograph of a mirroring ball, cut to its outline; what is in the middle was behind the camera.
    MirrorBall,
}
