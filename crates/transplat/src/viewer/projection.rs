//! Projection between the scene and points of the window, for handles.

use eframe::egui::{self, Color32, Pos2, Rect};
use glam::{Vec2, Vec3};
use transplat_core::camera::Camera;

/// Cosine between a ray and a plane under which it does not tell a place in it.
pub const GRAZING: f32 = 0.08;

/// Colour of a handle that is held, or may be grabbed.
pub const HELD: Color32 = Color32::from_rgb(255, 214, 90);

/// A picture in the window, and what it is seen by.
#[derive(Clone, Copy)]
pub struct Screen<'a> {
    pub camera: &'a Camera,
    pub part: Rect,
}

impl Screen<'_> {
    /// The point of the window where a place is seen; none of what is not in front of the camera.
    pub fn at(&self, place: Vec3) -> Option<Pos2> {
        let ([x, y], depth) = self.camera.project(place);
        let shown = depth > self.camera.near;
        shown.then(|| self.part.min + egui::vec2(x + 0.5, y + 0.5))
    }

    /// A point of the window from the picture's corner.
    pub fn inside(&self, at: Pos2) -> Vec2 {
        Vec2::new(at.x - self.part.min.x, at.y - self.part.min.y)
    }

    /// Unit direction of what is at a point of the picture.
    pub fn ray(&self, at: Vec2) -> Vec3 {
        let [cx, cy] = self.camera.principal_point();
        let view = Vec3::new(at.x - 0.5 - cx, at.y - 0.5 - cy, self.camera.focal);
        (self.camera.view_from_world.transpose() * view).normalize()
    }

    /// Where a point of the picture is on a plane through a place.
    pub fn on_plane(&self, at: Vec2, through: Vec3, normal: Vec3) -> Option<Vec3> {
        let ray = self.ray(at);
        let falls = ray.dot(normal);
        let meets = (through - self.camera.eye).dot(normal) / falls;
        (falls.abs() > GRAZING && meets > 0.0).then(|| self.camera.eye + ray * meets)
    }

    /// Distance along a line through a place of a point of the image.
    pub fn along(&self, at: Vec2, through: Vec3, axis: Vec3) -> Option<f32> {
        let ray = self.ray(at);
        let across = ray.dot(axis);
        let from = through - self.camera.eye;
        let sine = 1.0 - across * across;
        (sine > GRAZING * GRAZING).then(|| (across * from.dot(ray) - from.dot(axis)) / sine)
    }

    /// Unit direction into the picture.
    pub fn forward(&self) -> Vec3 {
        self.camera.view_from_world.row(2)
    }
}

/// Distance of a point from a segment.
pub fn from_segment(p: Pos2, a: Pos2, b: Pos2) -> f32 {
    let along = b - a;
    let t = ((p - a).dot(along) / along.length_sq().max(1e-6)).clamp(0.0, 1.0);
    p.distance(a + t * along)
}

#[cfg(test)]
pub mod tests {
    use super::*;

    pub fn camera() -> Camera {
        let eye = Vec3::new(5.0, -6.0, 4.0);
        let target = Vec3::new(1.0, 0.0, 0.5);
        Camera::look_at(eye, target, Vec3::Z, 0.7, [800, 600], 0.01)
    }

    /// That picture somewhere in the window.
    pub fn screen(camera: &Camera) -> Screen<'_> {
        let part = Rect::from_min_size(Pos2::new(40.0, 20.0), egui::vec2(800.0, 600.0));
        Screen { camera, part }
    }
}
