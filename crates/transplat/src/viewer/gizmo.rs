//! Gizmo of the selected object: arrows move it, rings rotate it, the disc in the middle moves it over the ground, the circle around scales it.

use std::f32::consts::{PI, TAU};

use eframe::egui::{self, Color32, Pos2, Response, Stroke, Ui};
use glam::{Quat, Vec2, Vec3};
use transplat_core::scene::Transform;

use super::frame::grid_spacing;
use super::projection::{HELD, Screen, from_segment};
use super::session::Session;

/// Points from the middle to an arrow's tip, to the rings, and to the circle that scales.
const ARROW: f32 = 88.0;
const RING: f32 = 66.0;
const CIRCLE: f32 = 104.0;

/// Points of the disc in the middle, and how near to a handle it is taken.
const DISC: f32 = 9.0;
const REACH: f32 = 7.0;

/// Corners of a ring.
const CORNERS: usize = 48;

/// In steps: of a turn in degrees, and of a scale.
const TURN_STEP: f32 = 15.0;
const SCALE_STEP: f32 = 0.1;

const AXES: [Vec3; 3] = [Vec3::X, Vec3::Y, Vec3::Z];

const COLORS: [Color32; 3] = [
    Color32::from_rgb(226, 82, 82),
    Color32::from_rgb(112, 190, 82),
    Color32::from_rgb(86, 138, 240),
];

/// Handle of the gizmo.
#[derive(Clone, Copy, Debug, PartialEq)]
enum GizmoHandle {
    Move(usize),
    /// Over the ground.
    Slide,
    /// In the plane of the image.
    Shift,
    Turn(usize),
    /// About the line of sight.
    Roll,
    Scale,
}

/// Transform that follows the pointer from a key on, as in Blender.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum KeyedTransform {
    Move,
    Rotate,
    Scale,
}

/// A drag, and from where it started.
struct GizmoDrag {
    handle: GizmoHandle,
    /// The state of what is dragged.
    object: u64,
    from: Transform,
    pointer: Vec2,
}

/// The handles as they are held.
#[derive(Default)]
pub struct Gizmo {
    drag: Option<GizmoDrag>,
}

/// Where the handles are on the screen.
struct GizmoView<'a> {
    screen: Screen<'a>,
    /// The object's middle in the scene, and in its own coordinates.
    middle: Vec3,
    own_middle: Vec3,
    up: Vec3,
    /// Scene units to a point at the middle.
    unit: f32,
}

impl GizmoView<'_> {
    fn at(&self, point: Vec3) -> Option<Pos2> {
        self.screen.at(point)
    }

    /// Where a place is on the plane through the middle.
    fn on_plane(&self, at: Vec2, normal: Vec3) -> Option<Vec3> {
        self.screen.on_plane(at, self.middle, normal)
    }

    /// Distance of a place along a line through the middle.
    fn along(&self, at: Vec2, axis: Vec3) -> Option<f32> {
        self.screen.along(at, self.middle, axis)
    }

    fn ring(&self, axis: usize) -> Vec<Option<Pos2>> {
        let [a, b] = [AXES[(axis + 1) % 3], AXES[(axis + 2) % 3]];
        let corner = |i: usize| {
            let (sin, cos) = (TAU * i as f32 / CORNERS as f32).sin_cos();
            let outward = a * cos + b * sin;
            // The half that is turned away is hidden.
            let towards = self.middle - self.screen.camera.eye;
            let is_near = outward.dot(towards) <= 0.15 * towards.length();
            is_near.then(|| self.at(self.middle + RING * self.unit * outward))?
        };
        (0..=CORNERS).map(corner).collect()
    }

    fn arrow(&self, axis: usize) -> Option<[Pos2; 2]> {
        let tip = self.at(self.middle + ARROW * self.unit * AXES[axis])?;
        let foot = self.at(self.middle + 0.22 * ARROW * self.unit * AXES[axis])?;
        // One that points at the eye cannot be dragged.
        (tip.distance(foot) > 12.0).then_some([foot, tip])
    }

    /// The handle at a place.
    fn handle_at(&self, at: Pos2) -> Option<GizmoHandle> {
        let middle = self.at(self.middle)?;
        if at.distance(middle) < DISC + 2.0 {
            return Some(GizmoHandle::Slide);
        }
        let near = |[a, b]: [Pos2; 2]| from_segment(at, a, b) < REACH;
        if let Some(axis) = (0..3).find(|axis| self.arrow(*axis).is_some_and(near)) {
            return Some(GizmoHandle::Move(axis));
        }
        let on_ring = |axis: &usize| {
            let ring = self.ring(*axis);
            let mut edges = ring.windows(2).filter_map(|e| Some([e[0]?, e[1]?]));
            edges.any(near)
        };
        if let Some(axis) = (0..3).find(on_ring) {
            return Some(GizmoHandle::Turn(axis));
        }
        let is_on_circle = (at.distance(middle) - CIRCLE).abs() < REACH;
        is_on_circle.then_some(GizmoHandle::Scale)
    }

    /// The transform that a drag to a place makes; in steps where that is asked for.
    fn dragged(&self, drag: &GizmoDrag, at: Vec2, step: Option<f32>) -> Option<Transform> {
        let mut made = drag.from;
        let place = |p: Vec3| match step {
            Some(step) => (p / step).round() * step,
            None => p,
        };
        match drag.handle {
            GizmoHandle::Move(axis) => {
                let moved = self.along(at, AXES[axis])? - self.along(drag.pointer, AXES[axis])?;
                let mut there = drag.from.translation;
                there[axis] += moved;
                there[axis] = place(there)[axis];
                made.translation = there;
            }
            GizmoHandle::Slide => {
                let forward = self.screen.forward();
                // Over the ground, unless that is seen from its edge.
                let is_flat = forward.dot(self.up).abs() < 0.2;
                let normal = if is_flat { forward } else { self.up };
                let moved = self.on_plane(at, normal)? - self.on_plane(drag.pointer, normal)?;
                let there = drag.from.translation + moved;
                let height = self.up * there.dot(self.up);
                let snapped = place(there);
                made.translation = if is_flat {
                    snapped
                } else {
                    snapped - self.up * snapped.dot(self.up) + height
                };
            }
            GizmoHandle::Shift => {
                let forward = self.screen.forward();
                let moved = self.on_plane(at, forward)? - self.on_plane(drag.pointer, forward)?;
                made.translation = place(drag.from.translation + moved);
            }
            GizmoHandle::Turn(_) | GizmoHandle::Roll => {
                let axis = match drag.handle {
                    GizmoHandle::Turn(axis) => AXES[axis],
                    _ => self.screen.forward(),
                };
                let mut angle = self.angle(drag.pointer, at, axis)?;
                if step.is_some() {
                    let degrees = (angle.to_degrees() / TURN_STEP).round() * TURN_STEP;
                    angle = degrees.to_radians();
                }
                let turn = Quat::from_axis_angle(axis, angle);
                made.rotation = (turn * drag.from.rotation).normalize();
            }
            GizmoHandle::Scale => {
                let middle = self.screen.inside(self.at(self.middle)?);
                let from = |p: Vec2| p.distance(middle).max(1.0);
                made.scale = drag.from.scale * from(at) / from(drag.pointer);
                if step.is_some() {
                    made.scale = (made.scale / SCALE_STEP).round().max(1.0) * SCALE_STEP;
                }
            }
        }
        // It turns and grows about its middle.
        let turns = matches!(drag.handle, GizmoHandle::Turn(_) | GizmoHandle::Roll);
        if turns || drag.handle == GizmoHandle::Scale {
            let moved = made.scene_from_object().transform_vector3(self.own_middle);
            made.translation = self.middle - moved;
        }
        made.validate().ok().map(|()| made)
    }

    /// The turn about an axis through the middle that brings one place to another.
    fn angle(&self, from: Vec2, to: Vec2, axis: Vec3) -> Option<f32> {
        let arms = [from, to].map(|at| Some(self.on_plane(at, axis)? - self.middle));
        if let [Some(a), Some(b)] = arms {
            return Some(axis.dot(a.cross(b)).atan2(a.dot(b)));
        }
        // Seen from its edge, a ring is a rod that is rolled.
        let right = self.screen.camera.view_from_world * axis;
        let across = Vec2::new(-right.y, right.x).normalize_or_zero();
        Some((to - from).dot(across) / RING % (2.0 * PI))
    }
}

impl Gizmo {
    /// Takes hold of the handle at a place; whether there is one.
    pub fn hold(&mut self, session: &Session, at: Pos2, screen: Screen<'_>) -> bool {
        let from = session.object().transform;
        let view = view(session, from, screen);
        let handle = view.and_then(|view| view.handle_at(at));
        self.drag = handle.map(|handle| GizmoDrag {
            handle,
            object: session.state().id,
            from,
            pointer: screen.inside(at),
        });
        self.drag.is_some()
    }

    /// Takes hold of the selected object where the pointer is; whether it can be.
    pub fn hold_object(
        &mut self,
        session: &Session,
        by: KeyedTransform,
        at: Pos2,
        screen: Screen<'_>,
    ) -> bool {
        let from = session.object().transform;
        self.drag = view_of(session, from, screen).map(|_| GizmoDrag {
            handle: match by {
                KeyedTransform::Move => GizmoHandle::Shift,
                KeyedTransform::Rotate => GizmoHandle::Roll,
                KeyedTransform::Scale => GizmoHandle::Scale,
            },
            object: session.state().id,
            from,
            pointer: screen.inside(at),
        });
        self.drag.is_some()
    }

    /// Holds what is moved or rotated to an axis; the same axis again lets it free.
    pub fn constrain(&mut self, axis: usize) {
        let Some(drag) = &mut self.drag else {
            return;
        };
        drag.handle = match drag.handle {
            GizmoHandle::Move(same) if same == axis => GizmoHandle::Shift,
            GizmoHandle::Turn(same) if same == axis => GizmoHandle::Roll,
            GizmoHandle::Turn(_) | GizmoHandle::Roll => GizmoHandle::Turn(axis),
            GizmoHandle::Scale => GizmoHandle::Scale,
            _ => GizmoHandle::Move(axis),
        };
    }

    /// Puts what is held back to where it was taken.
    pub fn cancel(&mut self, session: &mut Session) {
        let drag = self.drag.take();
        let same = drag.filter(|drag| drag.object == session.state().id);
        if let Some(drag) = same {
            session.object_mut().transform = drag.from;
        }
    }

    /// Pulls what is held to a place, in steps where that is asked for.
    pub fn drag(&mut self, session: &mut Session, to: Pos2, in_steps: bool, screen: Screen<'_>) {
        let object = session.state().id;
        // Another one that is selected meanwhile is not held.
        let Some(drag) = self.drag.as_ref().filter(|drag| drag.object == object) else {
            return;
        };
        // What is held is where it was when it was taken.
        let Some(view) = view_of(session, drag.from, screen) else {
            return;
        };
        let radius = session.project.scene_bounds().map_or(1.0, |b| b.radius);
        let step = in_steps.then(|| grid_spacing(radius) / 10.0);
        if let Some(made) = view.dragged(drag, screen.inside(to), step) {
            session.object_mut().transform = made;
        }
    }

    /// Lets go.
    pub fn let_go(&mut self) {
        self.drag = None;
    }

    /// Draws the handles over the picture.
    pub fn draw(&self, ui: &Ui, session: &Session, response: &Response, screen: Screen<'_>) {
        let Some(view) = view(session, session.object().transform, screen) else {
            return;
        };
        let active = self.drag.as_ref().map(|drag| drag.handle);
        let hovered = response.hover_pos().and_then(|at| view.handle_at(at));
        if hovered.is_some() && active.is_none() {
            ui.set_cursor_icon(egui::CursorIcon::Grab);
        }
        draw(ui, &view, active.or(hovered));
    }
}

/// Handles of the selected object, placed like that, where they are shown.
fn view<'a>(session: &Session, place: Transform, screen: Screen<'a>) -> Option<GizmoView<'a>> {
    let shows = session.overlays.handles && session.project.is_composed();
    view_of(session, place, screen).filter(|_| shows)
}

/// Handles of the selected object on the screen, placed like that; none where it cannot be moved.
fn view_of<'a>(session: &Session, place: Transform, screen: Screen<'a>) -> Option<GizmoView<'a>> {
    let is_free = session.object().shown && !session.object().locked;
    let bounds = session.asset().map(|a| a.bounds).filter(|_| is_free)?;
    let middle = place.scene_from_object().transform_point3(bounds.center);
    let camera = screen.camera;
    let depth = (camera.view_from_world * (middle - camera.eye)).z;
    (depth > camera.near).then(|| GizmoView {
        screen,
        middle,
        own_middle: bounds.center,
        up: session.project.scene_up().direction(),
        unit: depth / camera.focal,
    })
}

fn draw(ui: &Ui, view: &GizmoView<'_>, active: Option<GizmoHandle>) {
    let painter = ui.painter_at(view.screen.part);
    let Some(middle) = view.at(view.middle) else {
        return;
    };
    let stroke = |handle: GizmoHandle, color: Color32| {
        if active == Some(handle) {
            Stroke::new(4.0, HELD)
        } else {
            Stroke::new(2.0, color.gamma_multiply(0.9))
        }
    };
    let white = stroke(GizmoHandle::Scale, Color32::from_gray(220));
    painter.circle_stroke(middle, CIRCLE, Stroke::new(0.6 * white.width, white.color));
    for (axis, color) in COLORS.into_iter().enumerate() {
        let line = stroke(GizmoHandle::Turn(axis), color);
        for edge in view.ring(axis).windows(2) {
            if let [Some(a), Some(b)] = edge {
                painter.line_segment([*a, *b], line);
            }
        }
    }
    for (axis, color) in COLORS.into_iter().enumerate() {
        if let Some([foot, tip]) = view.arrow(axis) {
            let line = stroke(GizmoHandle::Move(axis), color);
            painter.line_segment([foot, tip], line);
            let along = (tip - foot).normalized();
            let aside = 6.0 * along.rot90();
            let corners = vec![tip + 10.0 * along, tip + aside, tip - aside];
            let none = Stroke::NONE;
            painter.add(egui::Shape::convex_polygon(corners, line.color, none));
        }
    }
    let line = stroke(GizmoHandle::Slide, Color32::from_gray(230));
    painter.circle(middle, DISC, line.color.gamma_multiply(0.35), line);
}

#[cfg(test)]
mod tests {
    use transplat_core::camera::Camera;

    use super::*;
    use crate::viewer::projection::tests::{camera, screen};

    fn view(camera: &Camera, middle: Vec3) -> GizmoView<'_> {
        GizmoView {
            screen: screen(camera),
            middle,
            own_middle: Vec3::new(0.3, -0.2, 0.1),
            up: Vec3::Z,
            unit: (camera.view_from_world * (middle - camera.eye)).z / camera.focal,
        }
    }

    fn inside(view: &GizmoView<'_>, point: Vec3) -> Vec2 {
        view.screen.inside(view.at(point).expect("in front"))
    }

    fn start() -> Transform {
        Transform {
            scale: 0.7,
            rotation: Quat::from_rotation_x(0.4),
            translation: Vec3::new(1.0, 0.2, 0.3),
        }
    }

    fn drag(view: &GizmoView<'_>, handle: GizmoHandle, from: Vec3) -> GizmoDrag {
        GizmoDrag {
            handle,
            object: 0,
            from: start(),
            pointer: inside(view, from),
        }
    }

    /// What was under the pointer stays there.
    #[test]
    fn an_object_follows_the_pointer() {
        let camera = camera();
        let own = Vec3::new(0.3, -0.2, 0.1);
        let middle = start().scene_from_object().transform_point3(own);
        let view = view(&camera, middle);
        for (axis, direction) in AXES.into_iter().enumerate() {
            let drag = drag(&view, GizmoHandle::Move(axis), middle + 0.3 * direction);
            let to = inside(&view, middle + 1.1 * direction);
            let made = view.dragged(&drag, to, None).expect("a place");
            let moved = made.translation - start().translation;
            assert!(moved.distance(0.8 * direction) < 1e-3, "{moved}");
            let snapped = view.dragged(&drag, to, Some(0.25)).expect("a place");
            let steps = snapped.translation[axis] / 0.25;
            assert!((steps - steps.round()).abs() < 1e-4);
        }
        let drag_over = drag(&view, GizmoHandle::Slide, middle);
        let aside = Vec3::new(0.4, -0.7, 0.0);
        let to = inside(&view, middle + aside);
        let made = view.dragged(&drag_over, to, None).expect("a place");
        assert!((made.translation - start().translation).distance(aside) < 1e-3);
        for (axis, direction) in AXES.into_iter().enumerate() {
            let arm = AXES[(axis + 1) % 3];
            let turn = Quat::from_axis_angle(direction, 0.5);
            let drag = drag(&view, GizmoHandle::Turn(axis), middle + arm);
            let to = inside(&view, middle + turn * arm);
            let made = view.dragged(&drag, to, None).expect("a turn");
            assert!(made.rotation.angle_between(turn * start().rotation) < 1e-2);
            let stays = made.scene_from_object().transform_point3(own);
            assert!(stays.distance(middle) < 1e-4, "about its middle");
            let snapped = view.dragged(&drag, to, Some(1.0)).expect("a turn");
            let turned = snapped
                .rotation
                .angle_between(start().rotation)
                .to_degrees();
            assert!((turned - 30.0).abs() < 0.1, "{turned}");
        }
        // In the plane of the image it stays under the pointer, too.
        let held = drag(&view, GizmoHandle::Shift, middle);
        let to = inside(&view, middle) + Vec2::new(60.0, -25.0);
        let made = view.dragged(&held, to, None).expect("a place");
        let there = made.scene_from_object().transform_point3(own);
        assert!(inside(&view, there).distance(to) < 0.1);
        // A quarter about the line of sight takes what is right of the middle below it.
        let at = |by: Vec2| inside(&view, middle) + by;
        let held = GizmoDrag {
            pointer: at(Vec2::new(50.0, 0.0)),
            ..drag(&view, GizmoHandle::Roll, middle)
        };
        let made = view.dragged(&held, at(Vec2::new(0.0, 50.0)), None);
        let turned = made.expect("a turn").rotation * start().rotation.inverse();
        assert!((turned.to_axis_angle().1.to_degrees() - 90.0).abs() < 2.0);
        let drag = GizmoDrag {
            pointer: inside(&view, middle) + Vec2::new(0.0, 50.0),
            ..drag(&view, GizmoHandle::Scale, middle)
        };
        let to = inside(&view, middle) + Vec2::new(75.0, 0.0);
        let made = view.dragged(&drag, to, None).expect("a scale");
        assert!((made.scale / 0.7 - 1.5).abs() < 1e-3);
    }

    /// A ring that is seen from its edge rolls the way its near side is pulled.
    #[test]
    fn the_near_side_of_an_edge_on_ring_follows_the_pointer() {
        let middle = Vec3::new(1.0, 0.0, 0.5);
        let eye = middle - 6.0 * Vec3::Y;
        let camera = Camera::look_at(eye, middle, Vec3::Z, 0.7, [800, 600], 0.01);
        let view = view(&camera, middle);
        for axis in [0, 2] {
            let turn = Quat::from_axis_angle(AXES[axis], 0.2);
            let near = middle - 0.5 * Vec3::Y;
            let pulled = middle + turn * (near - middle);
            let [from, to] = [near, pulled].map(|p| inside(&view, p));
            let angle = view.angle(from, from + 100.0 * (to - from), AXES[axis]);
            assert!(angle.expect("a turn") > 0.1, "{axis}: {angle:?}");
        }
    }

    #[test]
    fn handles_are_where_they_are_drawn() {
        let camera = camera();
        let view = view(&camera, Vec3::new(1.0, 0.0, 0.5));
        let middle = view.at(view.middle).expect("in front");
        assert_eq!(view.handle_at(middle), Some(GizmoHandle::Slide));
        for axis in 0..3 {
            let [_, tip] = view.arrow(axis).expect("not end on");
            assert_eq!(view.handle_at(tip), Some(GizmoHandle::Move(axis)));
        }
        let circle = middle + CIRCLE * egui::vec2(0.6, 0.8);
        assert_eq!(view.handle_at(circle), Some(GizmoHandle::Scale));
        let rings = (0..3).filter_map(|axis| {
            let at = view.ring(axis).into_iter().flatten();
            let mut handles = at.map(|at| view.handle_at(at));
            handles.find(|h| *h == Some(GizmoHandle::Turn(axis)))
        });
        assert_eq!(rings.count(), 3);
        assert_eq!(view.handle_at(middle + egui::vec2(200.0, 0.0)), None);
    }
}
