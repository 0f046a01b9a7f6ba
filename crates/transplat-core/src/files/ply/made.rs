//! A splat that comes of no file, in the layout that trainers of 2DGS write, or of 3DGS where any of it is a 3D Gaussian.

use std::io::Write;

use glam::{Mat3, Quat};

use crate::sh::coefficient_count;
use crate::surfels::SurfelCloud;

/// Logit of an opacity that rounds to 1: what a logistic function of f32 can still tell from it.
const MOST_LOGIT: f32 = 16.0;

/// Logarithm of the thickness of a surfel among 3D Gaussians: nothing that is drawn is as thin.
const FLAT_LOG: f32 = -30.0;

/// Writes surfels with a colour `[n][K][3]` as [`crate::color::Encoding::Stored`] has it.
pub(in crate::files) fn write(
    cloud: &SurfelCloud,
    stored: &[[f32; 3]],
    out: &mut impl Write,
) -> std::io::Result<()> {
    let k = coefficient_count(cloud.sh_degree);
    write!(
        out,
        "ply\nformat binary_little_endian 1.0\ncomment Vertical axis: {}\nelement vertex {}\n",
        cloud.up.name(),
        cloud.len()
    )?;
    let rest = (0..3 * (k - 1)).map(|i| format!("f_rest_{i}"));
    let names = [
        "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2",
    ];
    let has_gaussians = !cloud.thicknesses.iter().all(|t| t.is_flat());
    let third = has_gaussians.then_some("scale_2");
    let scales = ["opacity", "scale_0", "scale_1"].into_iter().chain(third);
    let shape = scales.chain(["rot_0", "rot_1", "rot_2", "rot_3"]);
    let names = names.map(String::from).into_iter().chain(rest);
    for name in names.chain(shape.map(String::from)) {
        writeln!(out, "property float {name}")?;
    }
    writeln!(out, "end_header")?;
    let mut row = Vec::new();
    for (i, sh) in stored.chunks_exact(k).enumerate() {
        let ([u, v], normal) = (cloud.tangents[i], cloud.stored_normal(i));
        let turn = Quat::from_mat3(&Mat3::from_cols(u, v, normal)).normalize();
        let opacity = cloud.opacities[i];
        let logit = (opacity / (1.0 - opacity)).ln();
        row.clear();
        row.extend(cloud.positions[i].to_array());
        row.extend(normal.to_array());
        row.extend(sh[0]);
        row.extend((0..3).flat_map(|c| sh[1..].iter().map(move |f| f[c])));
        row.push(logit.clamp(-30.0, MOST_LOGIT));
        row.extend(cloud.scales[i].to_array().map(f32::ln));
        if has_gaussians {
            row.push(cloud.thicknesses[i].sigma().ln().max(FLAT_LOG));
        }
        row.extend([turn.w, turn.x, turn.y, turn.z]);
        let bytes = row.iter().flat_map(|v| v.to_le_bytes());
        out.write_all(&bytes.collect::<Vec<u8>>())?;
    }
    Ok(())
}
