//! Whoever does not see the window, or has no mouse: every control has a name and comes under the keyboard.

use eframe::egui::{Key, Modifiers, accesskit::Role};
use egui_kittest::kittest::{NodeT, Queryable};
use transplat_core::environment::{Sky, Sun};
use transplat_core::scene::{LightKind, SKY};
use transplat_tests::driver::Driver;
use transplat_tests::small_lut;

/// What can be worked with.
const CONTROLS: [Role; 9] = [
    Role::Button,
    Role::CheckBox,
    Role::RadioButton,
    Role::Slider,
    Role::SpinButton,
    Role::TextInput,
    Role::MultilineTextInput,
    Role::ComboBox,
    Role::ColorWell,
];

/// Role and name of all controls that are there.
fn controls(d: &Driver) -> Vec<(Role, String)> {
    let nodes = d.harness.root().children_recursive();
    let controls = nodes.filter_map(|node| {
        let node = node.accesskit_node();
        let role = CONTROLS.into_iter().find(|role| *role == node.role())?;
        let name = node.label().unwrap_or_default();
        Some((role, name.trim().to_owned()))
    });
    controls.collect()
}

fn check(d: &Driver, place: &str) {
    let all = controls(d);
    assert!(all.len() > 20, "{place}: {all:?}");
    for (role, name) in &all {
        let says_something = name.chars().any(char::is_alphanumeric);
        assert!(
            says_something,
            "{place}: a {role:?} is called {name:?}: {all:?}"
        );
    }
}

/// Has the panel Light be about a side; the slot below is called so, too.
pub fn choose_side(d: &mut Driver, name: &str) {
    let button = d.harness.get_by_role_and_label(Role::Button, name);
    button.scroll_to_me();
    d.settle();
    let button = d.harness.get_by_role_and_label(Role::Button, name);
    button.click();
    d.settle();
}

#[test]
fn every_control_has_a_name() {
    let mut d = Driver::bundled();
    let lut = d.folder.write("small.cube", small_lut());
    d.after(|v| v.open(lut.as_ref()));
    for tab in ["Light", "Look", "Camera", "Objects", "Export", "Report"] {
        d.click(tab);
        check(&d, tab);
        if d.harness.query_by_label("Advanced").is_some() {
            d.click("Advanced");
            check(&d, &format!("{tab}, advanced"));
        }
    }
    d.after(|v| {
        v.session.project.keep_look();
        v.session.keep_view();
    });
    for page in ["Looks 1", "Views 1"] {
        d.click(page);
        check(&d, page);
    }
    d.click("Lights");
    d.click("Light");
    choose_side(&mut d, "Capture light");
    check(&d, "Capture light");
    d.click("Placed lights");
    for kind in LightKind::ALL {
        d.after(|v| v.session.add_light(kind));
        check(&d, &format!("lights, {kind:?}"));
    }
    d.after(|v| v.session.set_light(1, SKY.into()));
    choose_side(&mut d, "New light");
    for sun in [Sky::default().sun, Sun::SOMEWHERE] {
        let sky = Sky {
            sun,
            ..Sky::default()
        };
        d.after(|v| v.session.project.scene.environment.sky = Some(sky));
        check(&d, "sun and sky");
    }
    d.harness.key_press(Key::J);
    d.settle();
    check(&d, "timeline");
}

/// Tab goes through all of a panel, and the space bar does what a click does.
#[test]
fn all_of_a_panel_comes_under_the_keyboard() {
    let mut d = Driver::bundled();
    d.click("Camera");
    let wanted: Vec<String> = controls(&d)
        .into_iter()
        .map(|(_, name)| name)
        .filter(|name| {
            ["Front", "Frame", "orthographic", "Grid", "Reference balls"].contains(&&**name)
        })
        .collect();
    assert_eq!(wanted.len(), 5, "{:?}", controls(&d));
    let mut reached = Vec::new();
    let before = d.viewer().session.overlays.grid;
    for _ in 0..120 {
        d.harness.key_press_modifiers(Modifiers::NONE, Key::Tab);
        d.harness.step();
        let nodes = d.harness.root().children_recursive();
        let focused = nodes.map(|n| n.accesskit_node()).find(|n| n.is_focused());
        let name = focused.and_then(|n| n.label()).unwrap_or_default();
        if name == "Grid" && !reached.contains(&name) {
            d.harness.key_press(Key::Space);
            d.harness.step();
        }
        reached.push(name);
    }
    for name in wanted {
        assert!(reached.contains(&name), "{name} is not among {reached:?}");
    }
    assert_ne!(d.viewer().session.overlays.grid, before);
}
