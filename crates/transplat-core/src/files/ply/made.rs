//! Writer of a PLY for a splat of another format, in the layout of 2DGS trainers, or of 3DGS where any of it is a 3D Gaussian.

use std::io::Write;

use glam::DVec3;

use super::comments::write_comments;
use crate::files::packed::logit;
use crate::files::written::{MATERIAL, WritableSplat};
use crate::sh::coefficient_count;

/// Logit of an opacity that rounds to 1: what a logistic function of f32 can still tell from it.
const MOST_LOGIT: f32 = 16.0;

/// Writes a splat.
pub(in crate::files) fn write(
    splat: &WritableSplat<'_>,
    out: &mut impl Write,
) -> std::io::Result<()> {
    let k = coefficient_count(splat.degree);
    writeln!(out, "ply\nformat binary_little_endian 1.0")?;
    write_comments(splat, out)?;
    writeln!(out, "element vertex {}", splat.len())?;
    let rest = (0..3 * (k - 1)).map(|i| format!("f_rest_{i}"));
    let names = [
        "x", "y", "z", "nx", "ny", "nz", "f_dc_0", "f_dc_1", "f_dc_2",
    ];
    let has_gaussians = splat.has_gaussians();
    let third = has_gaussians.then_some("scale_2");
    let scales = ["opacity", "scale_0", "scale_1"].into_iter().chain(third);
    let shape = scales.chain(["rot_0", "rot_1", "rot_2", "rot_3"]);
    let names = names.map(String::from).into_iter().chain(rest);
    let of_material = MATERIAL.iter().filter(|_| splat.materials.is_some());
    let of_material = of_material.flat_map(|property| match property.width {
        1 => vec![property.name.to_owned()],
        width => (0..width)
            .map(|i| format!("{}_{i}", property.name))
            .collect(),
    });
    let names = names.chain(shape.map(String::from));
    // What 32 bits of float would round, is written in 64.
    let is_wide = splat.cloud.origin != DVec3::ZERO;
    for name in names.chain(of_material) {
        let is_position = ["x", "y", "z"].contains(&&*name);
        let scalar = if is_position && is_wide {
            "double"
        } else {
            "float"
        };
        writeln!(out, "property {scalar} {name}")?;
    }
    writeln!(out, "end_header")?;
    splat.write_each(out, |g, bytes| {
        if is_wide {
            bytes.extend(g.position.iter().flat_map(|v| v.to_le_bytes()));
        } else {
            bytes.extend(g.position.iter().flat_map(|v| (*v as f32).to_le_bytes()));
        }
        let mut put = |v: f32| bytes.extend(v.to_le_bytes());
        g.normal.into_iter().for_each(&mut put);
        g.sh[0].into_iter().for_each(&mut put);
        for c in 0..3 {
            g.sh[1..].iter().for_each(|f| put(f[c]));
        }
        put(logit(g.opacity).clamp(-30.0, MOST_LOGIT));
        let scales = if has_gaussians { 3 } else { 2 };
        g.log_scales[..scales].iter().for_each(|v| put(*v));
        g.rotation.into_iter().for_each(&mut put);
        if let Some(material) = g.material {
            for property in &MATERIAL {
                (property.of)(material)[..property.width]
                    .iter()
                    .for_each(|v| put(*v));
            }
        }
    })
}
