//! WGSL that no shader language can express in few lines: straight code for each SH degree.

use std::fmt::Write;

use transplat_core::sh::{band, basis_constants, coefficient_count, exchange_yz};

use crate::shader::source::{line, literal};

/// `fn sh_basis(d: vec3f) -> array<f32, K>`: all basis functions up to `degree`, straight out. Twin of `sh::evaluate_basis`.
pub fn sh_basis(degree: usize) -> String {
    let c = basis_constants();
    let k = coefficient_count(degree);
    let mut out = String::new();
    line!(out, "fn sh_basis(d: vec3f) -> array<f32, {k}> {{");
    line!(out, "    var y: array<f32, {k}>;");
    for m in 0..=degree {
        match m {
            0 => line!(out, "    let re_0 = 1.0;\n    let im_0 = 0.0;"),
            _ => {
                let p = m - 1;
                line!(out, "    let re_{m} = re_{p} * d.x - im_{p} * d.y;");
                line!(out, "    let im_{m} = re_{p} * d.y + im_{p} * d.x;");
            }
        }
        for l in m..=degree {
            let value = if l == m {
                literal(c.start[m])
            } else {
                let first = format!("{} * d.z * q_{}_{m}", literal(c.a[l][m]), l - 1);
                if l == m + 1 {
                    first
                } else {
                    format!("{first} - {} * q_{}_{m}", literal(c.b[l][m]), l - 2)
                }
            };
            line!(out, "    let q_{l}_{m} = {value};");
            line!(out, "    y[{}] = q_{l}_{m} * re_{m};", l * l + l + m);
            if m > 0 {
                line!(out, "    y[{}] = q_{l}_{m} * im_{m};", l * l + l - m);
            }
        }
    }
    line!(out, "    return y;\n}}");
    out
}

/// Cosines and sines for the mirror, and the mirror of each band in place. Twin of `sh::Mirror`.
pub(super) fn mirror(degree: usize) -> String {
    let mut out = String::new();
    for name in ["cos_1", "sin_1", "cos_2", "sin_2"] {
        line!(out, "var<private> {name}: array<f32, {}>;", degree + 1);
    }
    out += "fn prepare_mirror(n: vec3f) {
    let r = length(n.xy);
    let azimuth = select(vec2f(1.0, 0.0), n.xy / r, r > 1e-12);
    let double = vec2f(n.z * n.z - r * r, 2.0 * n.z * r);
";
    for (name, base) in [("1", "azimuth"), ("2", "double")] {
        line!(out, "    cos_{name}[0] = 1.0;\n    sin_{name}[0] = 0.0;");
        for m in 1..=degree {
            let p = m - 1;
            line!(
                out,
                "    cos_{name}[{m}] = cos_{name}[{p}] * {base}.x - sin_{name}[{p}] * {base}.y;"
            );
            line!(
                out,
                "    sin_{name}[{m}] = cos_{name}[{p}] * {base}.y + sin_{name}[{p}] * {base}.x;"
            );
        }
    }
    line!(out, "}}");
    for l in 1..=degree {
        out += &mirror_band(l);
    }
    out
}

fn mirror_band(l: usize) -> String {
    let n = 2 * l + 1;
    let first = band(l).start;
    let mut out = String::new();
    line!(out, "fn mirror_band_{l}() {{");
    for i in 0..n {
        line!(out, "    let a_{i} = s[{}];", first + i);
    }
    let turn = |out: &mut String, from: &str, to: &str, name: &str, sign: &str| {
        line!(out, "    let {to}_{l} = {from}_{l};");
        for m in 1..=l {
            let (p, q) = (l + m, l - m);
            let minus = if sign == "-" { "+" } else { "-" };
            line!(
                out,
                "    let {to}_{p} = {from}_{p} * cos_{name}[{m}] {minus} {from}_{q} * sin_{name}[{m}];"
            );
            line!(
                out,
                "    let {to}_{q} = {from}_{q} * cos_{name}[{m}] {sign} {from}_{p} * sin_{name}[{m}];"
            );
        }
    };
    let exchange = |out: &mut String, from: &str, to: &str, sign: bool| {
        for row in 0..n {
            let terms: Vec<String> = exchange_yz(l)
                .iter()
                .filter(|e| e.row == row)
                .map(|e| {
                    let value = if sign && row % 2 == 1 {
                        -e.value
                    } else {
                        e.value
                    };
                    format!("{} * {from}_{}", literal(value), e.column)
                })
                .collect();
            line!(out, "    let {to}_{row} = {};", terms.join(" + "));
        }
    };
    turn(&mut out, "a", "b", "1", "-");
    exchange(&mut out, "b", "c", false);
    turn(&mut out, "c", "d", "2", "+");
    exchange(&mut out, "d", "e", true);
    turn(&mut out, "e", "f", "1", "+");
    for i in 0..n {
        line!(out, "    s[{}] = f_{i};", first + i);
    }
    line!(out, "}}");
    out
}

/// Up to this many coefficients the operator's product is written out, once a channel: constant indices are many times
/// faster on a software driver. Of a higher degree, its compiler would take minutes.
pub(super) const MAX_STRAIGHT_COEFFICIENTS: usize = 25;
