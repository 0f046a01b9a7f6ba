//! What the mouse does in the viewport, however slow frames are.

use eframe::egui::{self, Event, Modifiers, PointerButton, Pos2, pos2};
use egui_kittest::kittest::Queryable;
use glam::DVec2;
use transplat::viewer::Startup;
use transplat_core::present::{Background, View};
use transplat_core::surfels::UpAxis;
use transplat_tests::driver::Driver;
use transplat_tests::{Folder, small_splat};

/// Numbers in no order, the same each time.
struct Random(u64);

impl Random {
    fn next(&mut self, range: std::ops::RangeInclusive<i32>) -> i32 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1);
        let span = (range.end() - range.start() + 1) as u64;
        range.start() + ((self.0 >> 33) % span) as i32
    }
}

fn small() -> Driver {
    let folder = Folder::empty();
    folder.write("small.ply", small_splat(100));
    let startup = Startup {
        files: vec![folder.path("small.ply")],
        ..Startup::default()
    };
    let mut d = Driver::open(startup, folder);
    // Its notes lie over the picture.
    d.after(|v| v.session.messages.clear());
    d
}

fn press(button: PointerButton, pos: Pos2, pressed: bool, modifiers: Modifiers) -> Event {
    Event::PointerButton {
        pos,
        button,
        pressed,
        modifiers,
    }
}

/// Drags of 1 to 30 events with 5 to 800 ms between frames, each frame with as many of them as come: the view ends where the arithmetic says.
#[test]
fn drags_end_where_the_arithmetic_says_whatever_the_frame_rate() {
    let mut d = small();
    let mut random = Random(7);
    let mut time = 1000.0;
    for drag in 0..200 {
        let turns_light = random.next(0..=3) == 0;
        let (button, held) = if turns_light {
            (PointerButton::Secondary, Modifiers::SHIFT)
        } else {
            (PointerButton::Primary, Modifiers::NONE)
        };
        let from = pos2(random.next(250..=400) as f32, random.next(200..=320) as f32);
        let mut events = vec![
            Event::PointerMoved(from),
            Event::ModifiersChanged(held),
            press(button, from, true, held),
        ];
        // The first one makes it a drag.
        let mut at = from + egui::vec2(12.0, random.next(-9..=9) as f32);
        events.push(Event::PointerMoved(at));
        let mut path = vec![from, at];
        for _ in 0..random.next(0..=28) {
            at += egui::vec2(random.next(-9..=9) as f32, random.next(-5..=5) as f32);
            events.push(Event::PointerMoved(at));
            path.push(at);
        }
        at += egui::vec2(random.next(-3..=3) as f32, 1.0);
        path.push(at);
        // Other keys count from the next press on, and where the pointer goes after the release is nobody's.
        events.push(press(button, at, false, held));
        events.push(Event::ModifiersChanged(Modifiers::NONE));
        events.push(Event::PointerMoved(pos2(120.0, 420.0)));

        let session = &d.viewer().session;
        let mut pose = session.project.pose;
        let mut light = session.project.scene.environment.clone();
        let wrap = |degrees: f64| (degrees + 180.0).rem_euclid(360.0) - 180.0;
        for step in path.windows(2) {
            let by = step[1] - step[0];
            let [x, y] = [by.x, by.y].map(f64::from);
            if turns_light {
                light.rotation = wrap(light.rotation + 0.5 * x);
                light.tilt = wrap(light.tilt + 0.5 * y);
            } else {
                pose.azimuth = wrap(pose.azimuth - 0.4 * x);
                pose.elevation = (pose.elevation + 0.4 * y).clamp(-90.0, 90.0);
            }
        }
        while !events.is_empty() {
            let count = (random.next(1..=12) as usize).min(events.len());
            time += f64::from(random.next(5..=800)) / 1e3;
            let input = d.harness.input_mut();
            input.time = Some(time);
            input.events.extend(events.drain(..count));
            d.harness.step();
        }
        let session = &d.viewer().session;
        let near = |a: f64, b: f64| wrap(a - b).abs() < 1e-3;
        let (now, lit) = (session.project.pose, &session.project.scene.environment);
        assert!(
            near(now.azimuth, pose.azimuth) && near(now.elevation, pose.elevation),
            "drag {drag}: {now:?} for {pose:?}"
        );
        assert!(
            near(lit.rotation, light.rotation) && near(lit.tilt, light.tilt),
            "drag {drag}: {lit:?} for {light:?}"
        );
        assert_eq!(now.pivot, pose.pivot);
    }
}

/// All of it between two frames: as a window sees it that takes a second for one.
#[test]
fn a_quick_drag_between_two_frames_is_not_lost() {
    let mut d = small();
    let before = d.viewer().session.project.pose;
    let (a, none) = (PointerButton::Primary, Modifiers::NONE);
    let from = pos2(300.0, 250.0);
    d.harness.input_mut().events.extend([
        Event::PointerMoved(from),
        press(a, from, true, none),
        Event::PointerMoved(from + egui::vec2(60.0, 0.0)),
        press(a, from + egui::vec2(60.0, 0.0), false, none),
    ]);
    d.harness.step();
    let after = d.viewer().session.project.pose;
    assert!((before.azimuth - after.azimuth - 24.0).abs() < 1e-3);
    // Pressed in a panel, a drag is the panel's.
    let panel = pos2(900.0, 300.0);
    d.harness.input_mut().events.extend([
        Event::PointerMoved(panel),
        press(a, panel, true, none),
        Event::PointerMoved(from),
        press(a, from, false, none),
    ]);
    d.harness.step();
    assert_eq!(d.viewer().session.project.pose, after);
}

/// What lies between press and release turns the light, by its map or by a ball, though frames are few.
#[test]
fn a_light_is_turned_by_its_map_and_by_a_ball() {
    let mut d = Driver::bundled();
    let (a, none) = (PointerButton::Primary, Modifiers::NONE);
    let map = d.harness.get_by_label("Map of the light").rect();
    let ball = d.harness.get_by_label("Mirror ball New light").rect();
    let turned = |d: &mut Driver, from: Pos2, by: egui::Vec2| {
        let (middle, to) = (from + 0.3 * by, from + by);
        for events in [
            vec![Event::PointerMoved(from), press(a, from, true, none)],
            vec![Event::PointerMoved(middle)],
            vec![Event::PointerMoved(to), press(a, to, false, none)],
        ] {
            d.harness.input_mut().events.extend(events);
            d.harness.step();
        }
        d.settle();
        let light = &d.viewer().session.project.scene.environment;
        (light.rotation, light.tilt)
    };
    let pose = d.viewer().session.project.pose;
    // All across is once around, and to the right azimuths fall.
    let by = egui::vec2(0.25 * map.width(), 7.0);
    let (rotation, tilt) = turned(&mut d, map.center(), by);
    assert!((rotation + 90.0).abs() < 1e-3 && tilt == 0.0, "{rotation}");
    let (rotation, tilt) = turned(&mut d, ball.center(), egui::vec2(40.0, -20.0));
    assert!((rotation + 70.0).abs() < 1e-3 && (tilt + 10.0).abs() < 1e-3);
    assert_eq!(d.viewer().session.project.pose, pose, "the camera stays");
    // A double click brings the brightest light there, as high too.
    let at = map.min + egui::vec2(0.7, 0.4) * map.size();
    d.harness.input_mut().events.push(Event::PointerMoved(at));
    d.harness.step();
    for pressed in [true, false, true, false] {
        d.harness
            .input_mut()
            .events
            .push(press(a, at, pressed, none));
    }
    d.harness.step();
    d.settle();
    let session = &d.viewer().session;
    let brightest = session.light(1).brightest.expect("a sun").as_dvec3();
    let map_from_world = session
        .project
        .scene
        .environment
        .map_from_asset(UpAxis::PlusZ);
    let came = map_from_world.transpose() * brightest;
    let azimuth = (pose.azimuth + 180.0 - 360.0 * 0.2).to_radians();
    let height = (std::f64::consts::PI * 0.4).cos();
    let off = came
        .truncate()
        .normalize()
        .angle_to(DVec2::from_angle(azimuth));
    assert!(
        off.abs() < 0.02 && (came.z - height).abs() < 0.01,
        "{came} {off}"
    );
}

/// The highlight comes to where the pointer was: what is mirrored there gets brighter.
#[test]
fn a_double_click_with_shift_puts_the_highlight_there() {
    let mut d = Driver::bundled();
    // From behind.
    d.viewer().session.project.scene.environment.rotation = 150.0;
    d.viewer().session.project.scene.view = View::Specular;
    d.viewer().session.project.scene.background = Background::Color([0.0; 3]);
    let (a, shift) = (PointerButton::Primary, Modifiers::SHIFT);
    let seen = d.picture();
    let [width, height] = d.viewer().session.project.viewport;
    let room = d.harness.get_by_label("Viewport").rect();
    // On the teapot's belly.
    let (x, y) = (width * 48 / 100, height * 53 / 100);
    let around = |picture: &[[f32; 3]]| {
        let rows = (y - 4..y + 5).map(|y| &picture[y * width + x - 4..][..9]);
        rows.flatten().flatten().sum::<f32>()
    };
    let share = egui::vec2(x as f32 / width as f32, y as f32 / height as f32);
    let at = room.min + share * room.size();
    d.harness
        .input_mut()
        .events
        .extend([Event::ModifiersChanged(shift), Event::PointerMoved(at)]);
    d.harness.step();
    for pressed in [true, false, true, false] {
        let event = press(a, at, pressed, shift);
        d.harness.input_mut().events.push(event);
    }
    d.harness.step();
    let (before, after) = (around(&seen), around(&d.picture()));
    assert!(after > 1.5 * before, "{before} {after}");
}
