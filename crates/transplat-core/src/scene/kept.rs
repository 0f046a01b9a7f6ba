//! What is kept with a scene to come back to: views, and other looks.

use super::{Object, Scene};
use crate::camera::CameraPose;
use crate::error::{Error, Result, ensure};

/// How many views, and how many looks, a scene may keep.
pub const MOST_KEPT: usize = 500;

/// A view to come back to.
#[derive(Clone, Debug, PartialEq)]
pub struct Bookmark {
    /// For the user.
    pub name: String,
    /// Where it is seen from.
    pub camera: CameraPose,
}

/// Another look of the same objects.
#[derive(Clone, Debug, PartialEq)]
pub struct Variant {
    /// For the user.
    pub name: String,
    /// What [`Scene::look_alone`] leaves.
    pub look: Scene,
}

impl Scene {
    /// The look by itself: light, mathematics and picture, without the objects, where they are seen from and how they are compared.
    pub fn look_alone(&self) -> Self {
        Self {
            objects: vec![Object::default()],
            ..Self::default().with_look(self)
        }
    }

    /// These objects, seen as they are, with the look of another scene.
    pub fn with_look(self, look: &Self) -> Self {
        Self {
            objects: self.objects,
            false_color: self.false_color,
            view: self.view,
            wipe: self.wipe,
            difference_scale: self.difference_scale,
            camera: self.camera,
            bookmarks: self.bookmarks,
            variants: self.variants,
            ..look.clone()
        }
    }

    pub(super) fn validate_kept(&self) -> Result<()> {
        let most = self.bookmarks.len().max(self.variants.len());
        ensure(most <= MOST_KEPT, || {
            format!("more than {MOST_KEPT} bookmarks or variants")
        })?;
        for Bookmark { name, camera } in &self.bookmarks {
            let named = |why| Error::Mismatch(format!("bookmark {name:?}: {why}"));
            camera.validate().map_err(named)?;
        }
        for Variant { name, look } in &self.variants {
            let named = |why| Error::Mismatch(format!("variant {name:?}: {why}"));
            look.validate().map_err(named)?;
            ensure(*look == look.look_alone(), || {
                format!(
                    "variant {name:?}: it holds a look, and no objects, camera, view, bookmarks or variants"
                )
            })?;
        }
        Ok(())
    }
}
