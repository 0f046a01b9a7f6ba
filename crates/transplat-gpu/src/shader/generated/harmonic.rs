//! Source of `transfer_harmonic.wgsl` for the degrees of a transfer.

use std::fmt::Write;

use transplat_core::sh::{SQRT_4PI, band, band_of, coefficient_count, cosine_kernel};
use transplat_core::transfer::harmonic::HarmonicTransfer;

use super::sh::{MAX_STRAIGHT_COEFFICIENTS, mirror, sh_basis};
use crate::shader::files::TRANSFER_HARMONIC;
use crate::shader::source::{Source, line, literal};

/// Inputs of the transfer's source.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TransferShape {
    /// Degree of lights and visibility.
    pub light_degree: usize,
    /// Degree of the result.
    pub asset_degree: usize,
    /// Highest band of the specular term.
    pub specular_degree: usize,
    /// True where visibility is used.
    pub shadow: bool,
    /// True where the specular term is mirrored.
    pub reflection: bool,
}

impl TransferShape {
    /// Shape of a prepared transfer.
    pub fn of(p: &HarmonicTransfer) -> Self {
        Self {
            light_degree: p.light_degree,
            asset_degree: p.asset_degree,
            specular_degree: p.specular_degree,
            shadow: !p.visibility.is_empty(),
            reflection: p.settings.terms.reflection,
        }
    }

    /// `vec4`s of the operator's uniform binding: all three matrices, row by row.
    pub fn operator_vectors(&self) -> usize {
        (3 * coefficient_count(self.light_degree).pow(2)).div_ceil(4)
    }

    /// True where the operator fits the 64 KiB of a uniform binding, which software drivers read far faster than a storage binding.
    pub fn operator_is_uniform(&self) -> bool {
        self.operator_vectors() * 16 <= 64 << 10
    }
}

/// Source of `transfer_harmonic.wgsl` for a shape.
pub fn transfer_harmonic(shape: TransferShape) -> String {
    let k = coefficient_count(shape.light_degree);
    let space = if shape.operator_is_uniform() {
        "uniform"
    } else {
        "storage, read"
    };
    let vectors = shape.operator_vectors();
    let mirror = if shape.reflection && shape.specular_degree > 0 {
        mirror(shape.specular_degree)
    } else {
        String::new()
    };
    TRANSFER_HARMONIC.after(
        Source::default()
            .code(sh_basis(shape.light_degree))
            .count("LIGHT_K", k)
            .count("ASSET_K", coefficient_count(shape.asset_degree))
            .code(format!(
                "@group(0) @binding(5) var<{space}> operator_of_light: array<vec4f, {vectors}>;\n"
            ))
            .code(format!(
                "var<private> v: array<f32, {k}>;\nvar<private> s: array<f32, {k}>;\n"
            ))
            .code(shadow_light(shape, k))
            .code(irradiance(k))
            .code(mirror)
            .code(prepare(shape, k))
            .code(write_specular(shape)),
    )
}

fn shadow_light(shape: TransferShape, k: usize) -> String {
    let at = |i: usize| format!("operator_of_light[{}][{}]", i / 4, i % 4);
    let mut out = String::new();
    for channel in 0..3 {
        line!(out, "fn shadow_light_{channel}() {{");
        if shape.shadow && k > MAX_STRAIGHT_COEFFICIENTS {
            line!(
                out,
                "    for (var k = 0u; k < {k}u; k++) {{
        var sum = 0.0;
        for (var q = 0u; q < {k}u; q++) {{
            let at = ({channel}u * {k}u + k) * {k}u + q;
            sum += operator_of_light[at / 4u][at % 4u] * v[q];
        }}
        s[k] = sum;
    }}"
            );
        } else {
            for i in 0..k {
                let row = (channel * k + i) * k;
                let sum = if shape.shadow {
                    let terms: Vec<String> = (0..k)
                        .map(|q| format!("{} * v[{q}]", at(row + q)))
                        .collect();
                    terms.join(" + ")
                } else {
                    format!("{} * {}", at(row), literal(SQRT_4PI))
                };
                line!(out, "    s[{i}] = {sum};");
            }
        }
        line!(out, "}}");
    }
    out
}

fn irradiance(k: usize) -> String {
    let terms: Vec<String> = (0..k)
        .filter(|i| cosine_kernel(band_of(*i)) != 0.0)
        .map(|i| {
            format!(
                "{} * basis[{i}] * s[{i}]",
                literal(cosine_kernel(band_of(i)))
            )
        })
        .collect();
    format!(
        "fn irradiance(basis: array<f32, {k}>) -> f32 {{\n    return {};\n}}\n",
        terms.join("\n        + ")
    )
}

fn prepare(shape: TransferShape, k: usize) -> String {
    let mut out = String::from("fn prepare(i: u32, n: vec3f) {\n");
    if shape.shadow {
        for q in 0..k {
            line!(out, "    v[{q}] = visibility[{q}u * count + i];");
        }
    }
    if shape.reflection && shape.specular_degree > 0 {
        line!(out, "    prepare_mirror(n);");
    }
    line!(out, "}}");
    out
}

fn write_specular(shape: TransferShape) -> String {
    let mut out = String::from("fn write_specular(i: u32, channel: u32) {\n");
    for l in 1..=shape.asset_degree {
        if l > shape.specular_degree {
            for j in band(l) {
                line!(out, "    store(i, {j}u, channel, 0.0);");
            }
            continue;
        }
        line!(
            out,
            "    let a_{l} = attenuation[({}u + channel) * count + i];",
            3 * (l - 1)
        );
        if shape.reflection {
            line!(out, "    mirror_band_{l}();");
        }
        for j in band(l) {
            line!(out, "    store(i, {j}u, channel, a_{l} * s[{j}]);");
        }
    }
    line!(out, "}}");
    out
}
