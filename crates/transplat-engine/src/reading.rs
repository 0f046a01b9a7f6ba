//! Settings that a splat is read with.

use glam::Vec3;
use transplat_core::response::CameraResponse;
use transplat_core::scene::{Cut, Object};

/// Settings that a splat is read with.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// Response of the capture's camera.
    pub response: CameraResponse,
    /// Positions that see its outside.
    pub outside_from: Vec<Vec3>,
    /// Part that the object is, where it is cut out of a splat.
    pub cut: Vec<Cut>,
}

impl Reading {
    /// Settings that an object's splat is to be read with.
    pub fn of(object: &Object) -> Self {
        Self {
            response: object.response,
            outside_from: object.outside_from.clone(),
            cut: object.cut.clone(),
        }
    }

    /// True where all of the splat is read alike, whatever is cut out of it.
    pub fn is_of_same_capture(&self, other: &Self) -> bool {
        self.response == other.response && self.outside_from == other.outside_from
    }

    /// Sets an object to be read so.
    pub fn give_back(&self, object: &mut Object) {
        let read = self.clone();
        object.response = read.response;
        object.outside_from = read.outside_from;
        object.cut = read.cut;
    }
}
