//! Source of `transfer_directional.wgsl` for an asset's degree and encoding.

use std::fmt::Write;

use transplat_core::color::Encoding;
use transplat_core::sh::coefficient_count;
use transplat_core::transfer::directional::{QuadratureNodes, WIDTHS};

use super::sh::{MAX_STRAIGHT_COEFFICIENTS, mirror};
use crate::shader::files::TRANSFER_DIRECTIONAL;
use crate::shader::source::{Source, line, literal};

/// The nodes' matrices one after the other, and where each begins: `evaluate` and `project` of both sides, the heights, the fit.
pub fn tables(nodes: &QuadratureNodes) -> (Vec<f32>, [(&'static str, usize); 4]) {
    let mut all = Vec::new();
    let parts: [(&'static str, Vec<f32>); 4] = [
        (
            "EVALUATE",
            [&nodes.evaluate[..], &nodes.evaluate_back].concat(),
        ),
        ("PROJECT", nodes.project.concat()),
        ("HEIGHT", nodes.to_camera.iter().map(|d| d.z).collect()),
        ("FIT", nodes.fit.clone()),
    ];
    let offsets = parts.map(|(name, part)| {
        let offset = all.len();
        all.extend(part);
        (name, offset)
    });
    (all, offsets)
}

/// Source of `transfer_directional.wgsl`.
pub fn transfer_directional(nodes: &QuadratureNodes, encoding: Encoding) -> String {
    let (k, q) = (coefficient_count(nodes.degree), nodes.count());
    let begin = |source: Source, (name, offset)| source.count(&format!("TABLE_{name}"), offset);
    let offsets = tables(nodes).1.into_iter();
    TRANSFER_DIRECTIONAL.after(
        offsets
            .fold(Source::default(), begin)
            .count("K", k)
            .count("Q", q)
            .count("ENCODING", encoding as u32)
            .number("OFFSET", encoding.offset())
            .code(format!(
                "var<private> s: array<vec3f, {k}>;\nvar<private> f: array<vec3f, {k}>;\n"
            ))
            .code(mirror_all(nodes.degree))
            .code(lobes(nodes))
            .code(fit_nodes(nodes, k, q))
            .code(write_result(k)),
    )
}

fn mirror_all(degree: usize) -> String {
    let mut out = String::new();
    if degree > 0 {
        out += &mirror(degree);
    }
    line!(out, "fn mirror_all(frame: vec3f) {{");
    if degree > 0 {
        line!(out, "    prepare_mirror(frame);");
    }
    for l in 1..=degree {
        line!(out, "    mirror_band_{l}();");
    }
    line!(out, "}}");
    out
}

/// Nodes in a vector.
const LANES: usize = 4;

const CHANNELS: [&str; 3] = ["x", "y", "z"];

/// Mirrored light at the nodes, four in a vector, in private variables: `clear_lobes`, and `add_ray`. Twin of `lobe::mirrored`.
fn lobes(nodes: &QuadratureNodes) -> String {
    let groups = nodes.count().div_ceil(LANES);
    let mut out = String::new();
    for g in 0..groups {
        for c in CHANNELS {
            line!(out, "var<private> lobe_{c}_{g}: vec4f;");
        }
    }
    line!(out, "fn clear_lobes() {{");
    for g in 0..groups {
        for c in CHANNELS {
            line!(out, "    lobe_{c}_{g} = vec4f(0.0);");
        }
    }
    line!(out, "}}");
    // The narrow powers of the wide ones: without a branch, since neighbours differ.
    line!(
        out,
        "fn lobe_of(near: vec4f, width: u32) -> vec4f {{\n    var v = max(near, vec4f(0.0));"
    );
    for _ in 0..WIDTHS[0] {
        line!(out, "    v *= v;");
    }
    for width in &WIDTHS[1..] {
        line!(out, "    v = select(v, v * v, width >= {width}u);");
    }
    line!(out, "    return v;\n}}");
    line!(out, "fn add_ray(d: vec3f, energy: vec3f, width: u32) {{");
    for g in 0..groups {
        let [x, y, z] = nodes.half_mirrored.each_ref().map(|axis| {
            let at = |i| axis.get(LANES * g + i).copied().unwrap_or_default();
            let lanes: Vec<String> = (0..LANES).map(|i| literal(f64::from(at(i)))).collect();
            format!("vec4f({})", lanes.join(", "))
        });
        line!(
            out,
            "    let v_{g} = lobe_of(0.5 + {x} * d.x + {y} * d.y + {z} * d.z, width);"
        );
        for c in CHANNELS {
            line!(out, "    lobe_{c}_{g} += energy.{c} * v_{g};");
        }
    }
    line!(out, "}}");
    out
}

/// Stored colour at the nodes and its fit into `s`; returns the sum over the nodes.
fn fit_nodes(nodes: &QuadratureNodes, k: usize, q: usize) -> String {
    // Of more coefficients the fit is a loop over the tables, since its compiler would take minutes written out.
    let straight = k <= MAX_STRAIGHT_COEFFICIENTS;
    let mut out = String::new();
    if !straight {
        line!(out, "var<private> at_nodes: array<vec3f, {q}>;");
    }
    line!(
        out,
        "fn fit_nodes(i: u32, tau: vec3f, reflectance: vec3f, has_fresnel: bool) -> vec3f {{"
    );
    line!(
        out,
        "    var sum = vec3f(0.0);\n    let first = i * {}u;",
        3 * q
    );
    for j in 0..k {
        line!(out, "    s[{j}] = vec3f(0.0);");
    }
    for node in 0..q {
        let (group, lane) = (node / LANES, node % LANES);
        let at = |c: usize| format!("diffuse[first + {}u]", 3 * node + c);
        let lobe = CHANNELS.map(|c| format!("lobe_{c}_{group}[{lane}]"));
        line!(
            out,
            "    let rise_{node} = select(1.0, {}, has_fresnel);",
            literal(f64::from(nodes.rise[node]))
        );
        line!(
            out,
            "    let c_{node} = encode(tau * vec3f({}, {}, {}) + rise_{node} * reflectance * vec3f({}));",
            at(0),
            at(1),
            at(2),
            lobe.join(", ")
        );
        line!(out, "    sum += c_{node};");
        if !straight {
            line!(out, "    at_nodes[{node}] = c_{node};");
            continue;
        }
        for j in 0..k {
            let weight = literal(f64::from(nodes.fit[node * k + j]));
            line!(out, "    s[{j}] += {weight} * c_{node};");
        }
    }
    if !straight {
        line!(
            out,
            "    for (var j = 0u; j < K; j++) {{\n        var sum_of_fit = vec3f(0.0);\n        for (var node = 0u; node < Q; node++) {{"
        );
        line!(
            out,
            "            sum_of_fit += tables[TABLE_FIT + node * K + j] * at_nodes[node];\n        }}\n        s[j] = sum_of_fit;\n    }}"
        );
    }
    line!(out, "    return sum;\n}}");
    out
}

fn write_result(k: usize) -> String {
    let mut out = String::from("fn write(i: u32, scale: vec3f) {\n");
    for j in 0..k {
        for (c, axis) in CHANNELS.iter().enumerate() {
            let at = format!("i * {}u + {}u", 3 * k, 3 * j + c);
            line!(
                out,
                "    relit[{at}] = s[{j}].{axis} + scale.{axis} * residual[{at}];"
            );
        }
    }
    line!(out, "}}");
    out
}
