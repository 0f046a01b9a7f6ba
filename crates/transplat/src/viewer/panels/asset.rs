//! Panel *Asset*: the splat, its up axis, hidden surfels, and the surfel that was clicked.

use eframe::egui::{self, Ui};
use glam::{Quat, Vec3};
use transplat_core::camera::first_pose;
use transplat_core::color::decode_sh;
use transplat_core::files::SplatKind;
use transplat_core::scene::MOST_PLACES;
use transplat_core::settings::Method;
use transplat_core::surfels::{SurfelFilter, UpAxis};

use crate::viewer::annotations::low_confidence_name;
use crate::viewer::app::Viewer;
use crate::viewer::navigation;
use crate::viewer::session::Session;
use crate::viewer::widgets::{Control, button, fact, file, named, number, thousands};
use transplat_engine::language::{tr, tr_format};
use transplat_engine::warnings::{AMBIGUOUS_SHARE, DOUBTFUL_NORMAL_NOISE};

pub fn show(ui: &mut Ui, viewer: &mut Viewer) {
    let session = &mut viewer.session;
    let Some(asset) = session.asset() else {
        ui.label(tr("No splat is open."));
        return;
    };
    file(ui, &asset.path);
    let kind = match asset.file.report.kind {
        SplatKind::Surfels2d => tr("2D Gaussians"),
        SplatKind::Gaussians3d => tr("3D Gaussians"),
    };
    let (n, degree) = (asset.cloud.len(), asset.cloud.sh_degree);
    fact(
        ui,
        tr("holds"),
        tr_format!(
            "{n} {kind}, SH degree {degree}",
            n = thousands(n),
            kind = kind,
            degree = degree
        ),
    );
    for warning in &asset.warnings {
        ui.colored_label(ui.visuals().warn_fg_color, warning);
    }
    let up = session.up();
    ui.horizontal(|ui| {
        ui.label(tr("Up axis"));
        for (name, axis) in UpAxis::ALL {
            let chosen = ui
                .selectable_label(up == axis, name)
                .on_hover_text(tr("Up axis of the splat."));
            if chosen.clicked() && up != axis {
                session.object_mut().up = Some(axis);
                if session.selected > 0 && !session.object().locked {
                    session.project.stand_upright(session.selected);
                }
                let size = session.project.viewport;
                let alone = !session.project.is_composed();
                if let Some(asset) = session.asset().filter(|_| alone) {
                    session.project.pose =
                        first_pose(&asset.cloud.positions, axis, &asset.bounds, size);
                }
            }
        }
    });
    front(ui, viewer);
    noise(ui, &viewer.session);
    let mut turned = 0.0;
    let turn = number(&mut turned, -360.0..=360.0).suffix("°").speed(0.5);
    let drag = ui
        .horizontal(|ui| {
            ui.label(tr("Turn the object"));
            ui.add(turn)
        })
        .inner
        .on_hover_text(tr(
            "Rotates the object about its up axis. The new light stays.",
        ));
    named(&drag, egui::Role::SpinButton, tr("Turn the object"));
    if drag.changed() && viewer.session.project.is_composed() {
        let session = &mut viewer.session;
        let turn = Quat::from_axis_angle(
            session.project.scene_up().direction(),
            (turned as f32).to_radians(),
        );
        if !session.object().locked {
            let transform = &mut session.object_mut().transform;
            transform.rotation = (turn * transform.rotation).normalize();
        }
    } else if drag.changed() {
        // The object's turn is the camera's and the light's together the other way.
        let session = &mut viewer.session;
        session.project.pose.azimuth = navigation::wrap(session.project.pose.azimuth - turned);
        session.project.scene.environment.rotation =
            navigation::wrap(session.project.scene.environment.rotation - turned);
    }
    ui.separator();
    let proposed = viewer.session.asset().and_then(|a| a.proposed_crop);
    if hide(ui, &mut viewer.session.object_mut().hide, proposed) {
        let at = viewer.session.selected;
        viewer.session.project.crop_to_object(at);
    }
    cut(ui, &mut viewer.session);
    ui.separator();
    inspected(ui, viewer);
}

/// Shows which side of the surfels is out, where that is a guess.
fn front(ui: &mut Ui, viewer: &mut Viewer) {
    let session = &mut viewer.session;
    if session.project.scene.transfer.method != Method::Directional {
        return;
    }
    let guessed = session.bake_so_far().and_then(|b| b.ambiguous_share());
    ui.horizontal(|ui| {
        let tip = tr("Treats everything visible from here as the outside. Bakes again.");
        if button(ui, tr("Use this side as outside"), tip) {
            let eye = navigation::eye(&session.project.pose, session.project.scene_up());
            let object_from_scene = session.object().transform.scene_from_object().inverse();
            let eye = object_from_scene.transform_point3(eye);
            let places = &mut session.object_mut().outside_from;
            if places.len() < MOST_PLACES && !places.contains(&eye) {
                places.push(eye);
            }
        }
        let count = session.object().outside_from.len();
        let views = if count == 1 { tr("view") } else { tr("views") };
        if count > 0
            && ui
                .button(tr_format!(
                    "Forget {count} {views}",
                    count = count,
                    views = views
                ))
                .clicked()
        {
            session.object_mut().outside_from.clear();
        }
        if let Some(share) = guessed {
            ui.weak(tr_format!("uncertain {:.1} %", 100.0 * share))
                .on_hover_text(tr(
                    "Share of the visible surface whose normals may be flipped.",
                ));
        }
    });
    if guessed.is_some_and(|share| share > AMBIGUOUS_SHARE) {
        ui.colored_label(
            ui.visuals().warn_fg_color,
            tr("Many normals may be flipped (channel Confidence). View the outside, then click this."),
        );
    }
}

/// Warns that the light is only roughly visible, where it is.
fn noise(ui: &mut Ui, session: &Session) {
    let noise = session.bake_so_far().and_then(|b| b.normal_noise());
    if let Some(degrees) = noise.filter(|degrees| *degrees >= DOUBTFUL_NORMAL_NOISE) {
        ui.colored_label(
            ui.visuals().warn_fg_color,
            tr_format!(
                "Normals are noisy (median {degrees:.0}°): shading and highlights are approximate.",
                degrees = degrees
            ),
        );
    }
}

/// Filters of what is drawn; whether it is to be cropped to the object.
fn hide(ui: &mut Ui, hide: &mut SurfelFilter, proposed: Option<[Vec3; 2]>) -> bool {
    let mut crops = false;
    ui.label(tr("Hide (nothing is edited)"));
    Control {
        label: tr("Min. opacity"),
        tip: tr("Hides Gaussians of lower opacity, such as haze."),
        decimals: 3,
        ..Control::of(0.0..=1.0, 0.0)
    }
    .show(ui, &mut hide.min_opacity);
    Control {
        label: tr("Max. size"),
        unit: tr(" radii"),
        tip: tr(
            "Hides Gaussians larger than this share of the object, such as floaters. 1 hides none.",
        ),
        decimals: 3,
        logarithmic: true,
        ..Control::of(0.001..=1.0, 1.0)
    }
    .show(ui, &mut hide.max_size);
    ui.checkbox(&mut hide.crop, tr("Crop box"))
        .on_hover_text(tr("Hides what lies outside of a box."));
    if let Some([low, high]) = proposed {
        let is_it = hide.crop && (hide.crop_min, hide.crop_max) == (low, high);
        let tip = tr("Crops to what was photographed from all sides.");
        crops = !is_it && button(ui, tr("Crop to the object"), tip);
    }
    if hide.crop {
        for (axis, name) in ["X", "Y", "Z"].into_iter().enumerate() {
            ui.horizontal(|ui| {
                ui.label(name);
                let (mut low, mut high) = (hide.crop_min[axis], hide.crop_max[axis]);
                for (value, side) in [(&mut low, tr("from")), (&mut high, tr("to"))] {
                    let drag = number(value, -3.0..=3.0)
                        .speed(0.01)
                        .prefix(format!("{side} "))
                        .suffix(tr(" radii"));
                    let response = ui
                        .add(drag)
                        .on_hover_text(tr("Box side, in object radii from the centre."));
                    named(
                        &response,
                        egui::Role::SpinButton,
                        tr_format!("Crop {name} {side}", name = name, side = side),
                    );
                }
                hide.crop_min[axis] = low.min(high);
                hide.crop_max[axis] = high.max(low);
            });
        }
    }
    if !hide.is_off() && ui.button(tr("Show everything")).clicked() {
        *hide = SurfelFilter::default();
    }
    crops
}

/// Objects that are cut out of a capture.
fn cut(ui: &mut Ui, session: &mut Session) {
    let tip = tr("Splits the object in two: what lies in the crop box, and the rest.");
    if session.object().hide.crop && button(ui, tr("Cut out"), tip) {
        session.project.cut_out(session.selected);
    }
    if let Some(part) = session.asset().and_then(|a| a.part.as_ref()) {
        let (taken, all) = (part.surfels.len(), part.capture.cloud.len());
        ui.weak(tr_format!(
            "Cut out of a capture: {} of {} Gaussians",
            thousands(taken),
            thousands(all)
        ));
    }
    if let Some(was_removed) = session.project.is_residue_removed(session.selected) {
        let mut removes = was_removed;
        ui.checkbox(&mut removes, tr("Remove residue"))
            .on_hover_text(tr(
                "Moves what is left of the desk or the ground under the object to the rest of the capture.",
            ));
        if removes != was_removed {
            session.project.remove_residue(session.selected, removes);
        }
    }
}

fn inspected(ui: &mut Ui, viewer: &mut Viewer) {
    let mut close = false;
    let dragging = ui.input(|i| i.pointer.any_down());
    let inspected = viewer.viewport.inspected(&viewer.session);
    viewer.session.project.requested.readout = inspected.is_some() && !dragging;
    let session = &viewer.session;
    let (Some(i), Some(asset)) = (inspected, session.asset()) else {
        ui.weak(tr("Click the object to inspect a Gaussian."));
        return;
    };
    if i >= asset.cloud.len() {
        return;
    }
    let cloud = &asset.cloud;
    let vector = |v: Vec3| format!("{:.4}, {:.4}, {:.4}", v.x, v.y, v.z);
    ui.horizontal(|ui| {
        let row = asset.file.row_of(i).unwrap_or(i);
        ui.label(tr_format!("Gaussian {}", thousands(row)))
            .on_hover_text(tr("Index in its file."));
        close = ui.small_button(tr("close")).clicked();
    });
    fact(ui, tr("position"), vector(cloud.positions[i]));
    fact(
        ui,
        tr("size"),
        format!("{:.2e} x {:.2e}", cloud.scales[i].x, cloud.scales[i].y),
    );
    fact(ui, tr("opacity"), format!("{:.3}", cloud.opacities[i]));
    if let Some(bake) = session.bake_so_far() {
        let mut normal = vector(bake.normals()[i]);
        for (holds, word) in [
            (bake.is_two_sided(i), tr(", two-sided")),
            (bake.is_ambiguous(i), tr(", may be flipped")),
        ] {
            normal += if holds { word } else { "" };
        }
        fact(ui, tr("normal"), normal);
        let seen = bake.seen_by(i);
        let open = seen.iter().map(|(_, open)| open).sum::<f32>() / seen.len() as f32;
        fact(
            ui,
            tr("sees"),
            tr_format!("{:.0} % of the sphere", 100.0 * open),
        );
        lobe(ui, &seen);
    }
    if let (Some(prepared), Some((tau, relit))) = (session.prepared(), session.relit_surfel(i)) {
        let linear = decode_sh(cloud.sh_of(i), cloud.sh_degree, cloud.encoding);
        fact(
            ui,
            tr("Ratio"),
            format!("{:.3}, {:.3}, {:.3}", tau[0], tau[1], tau[2]),
        );
        fact(
            ui,
            tr("Regularized"),
            tr_format!("{:.0} % of the divisor", 100.0 * prepared.epsilon_share(i)),
        );
        let bands: Vec<String> = (0..=cloud.sh_degree)
            .map(|l| {
                let norm = |f: &[[f32; 3]]| {
                    let band = &f[transplat_core::sh::band(l)];
                    band.iter().flatten().map(|v| v * v).sum::<f32>().sqrt()
                };
                format!("{l}: {:.3} > {:.3}", norm(&linear), norm(&relit))
            })
            .collect();
        fact(ui, tr("SH bands, before > after"), bands.join("  "));
    }
    if let Some(Some(low_confidence)) = session.state().confidence.get().and_then(|d| d.of.get(i)) {
        ui.colored_label(
            ui.visuals().warn_fg_color,
            low_confidence_name(*low_confidence),
        );
    }
    if close {
        viewer.viewport.clicked = None;
    }
}

/// Draws the directions that a surfel sees, as a map of the sphere.
fn lobe(ui: &mut Ui, seen: &[(Vec3, f32)]) {
    let (rect, response) = ui.allocate_exact_size(egui::vec2(160.0, 80.0), egui::Sense::hover());
    response.on_hover_text(tr("Visibility of the Gaussian as an environment map: white is open, black is the object itself."));
    let painter = ui.painter_at(rect);
    painter.rect_filled(rect, 2.0, egui::Color32::from_gray(40));
    for (d, open) in seen {
        let u = 0.5 - d.y.atan2(d.x) / std::f32::consts::TAU;
        let v = d.z.clamp(-1.0, 1.0).acos() / std::f32::consts::PI;
        let at = rect.min + egui::vec2(u * rect.width(), v * rect.height());
        let size = (rect.area() / seen.len() as f32).sqrt() * 0.55;
        painter.circle_filled(
            at,
            size.max(1.0),
            egui::Color32::from_gray((255.0 * open) as u8),
        );
    }
}
