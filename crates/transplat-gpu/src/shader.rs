//! WGSL modules: the files of `shaders/`, with constants and generated code written in front of them.

mod files;
mod generated;
mod source;

use transplat_core::color::{Encoding, ToneMap};
use transplat_core::present::View;
use transplat_core::sh::coefficient_count;
use transplat_core::transfer::directional::QuadratureNodes;

pub(crate) use files::{BAKE_DIRECTIONAL, BAKE_HARMONIC, BLIT, RASTERIZE_ORDER, RASTERIZE_PROJECT};
pub use files::{DIGIT_BITS, SORT_KEYS, SORT_WORKGROUP, STRATUM_BATCH, background_number};
use files::{PRESENT, PROJECT_ENVIRONMENT, RASTERIZE_DRAW, RASTERIZE_SHADE};
pub use generated::directional::{tables, transfer_directional};
pub use generated::harmonic::{TransferShape, transfer_harmonic};
pub use generated::sh::sh_basis;
use source::Source;

/// Source of `project_environment.wgsl` for a degree.
pub fn project_environment(degree: usize) -> String {
    PROJECT_ENVIRONMENT.after(
        Source::default()
            .count("DEGREE", degree)
            .count("K", coefficient_count(degree)),
    )
}

/// Source of `rasterize_draw.wgsl`.
pub fn rasterize_draw(half_float_target: bool) -> String {
    RASTERIZE_DRAW
        .after(Source::default().number("MAX_COLOR", if half_float_target { 6e4 } else { 1e30 }))
}

/// Source of `rasterize_shade.wgsl` for a degree of colour.
pub fn rasterize_shade(degree: usize) -> String {
    RASTERIZE_SHADE.after(
        Source::default()
            .code(sh_basis(degree))
            .count("K", coefficient_count(degree)),
    )
}

/// Shape of `present.wgsl` for an image.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub struct PresentShape {
    /// Arrangement of the sides.
    pub arrangement: View,
    /// By [`background_number`].
    pub background: u32,
    /// Tone curve of the environment behind.
    pub tone_map: ToneMap,
    /// True where a LUT is over any side.
    pub is_graded: bool,
    /// True where exposure is shown as false colours.
    pub false_colored: bool,
    /// True where a ground catches shadows.
    pub catches_shadows: bool,
    /// True where a grid is on the ground.
    pub has_grid: bool,
}

/// Source of `present.wgsl` for a picture.
pub fn present(shape: PresentShape) -> String {
    PRESENT.after(
        Source::default()
            .count("ARRANGEMENT", shape.arrangement as usize)
            .count("BACKGROUND", shape.background as usize)
            .count("TONE_MAP", shape.tone_map as usize)
            .flag("IS_GRADED", shape.is_graded)
            .flag("FALSE_COLORED", shape.false_colored)
            .flag("CATCHES_SHADOWS", shape.catches_shadows)
            .flag("HAS_GRID", shape.has_grid),
    )
}

/// Every shader with its file's name, as it is compiled for a splat of degree 3: to be read.
pub fn usual() -> Vec<(&'static str, String)> {
    let shape = TransferShape {
        light_degree: 3,
        asset_degree: 3,
        specular_degree: 3,
        shadow: true,
        reflection: true,
    };
    let directional = transfer_directional(&QuadratureNodes::new(3), Encoding::Stored);
    vec![
        ("project_environment", project_environment(3)),
        ("bake_harmonic", BAKE_HARMONIC.source()),
        ("bake_directional", BAKE_DIRECTIONAL.source()),
        ("transfer_harmonic", transfer_harmonic(shape)),
        ("transfer_directional", directional),
        ("rasterize_project", RASTERIZE_PROJECT.source()),
        ("rasterize_order", RASTERIZE_ORDER.source()),
        ("rasterize_draw", rasterize_draw(false)),
        ("rasterize_shade", rasterize_shade(3)),
        ("present", present(PresentShape::default())),
        ("blit", BLIT.source()),
    ]
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;
    use std::path::Path;
    use std::sync::LazyLock;

    use wgpu::naga;

    use super::*;

    /// Every shader that the program can ask for, with its file's name.
    static ALL: LazyLock<Vec<(&str, String)>> = LazyLock::new(|| {
        let mut all = usual();
        all.push(("rasterize_draw", rasterize_draw(true)));
        let views = [View::After, View::Before, View::Split, View::SideBySide];
        for arrangement in views.into_iter().chain([View::Difference, View::Depth]) {
            for (background, has_more) in (0..5).zip([false, true].into_iter().cycle()) {
                let shape = PresentShape {
                    arrangement,
                    background,
                    tone_map: ToneMap::Agx,
                    is_graded: has_more,
                    false_colored: has_more,
                    catches_shadows: has_more,
                    has_grid: !has_more,
                };
                all.push(("present", present(shape)));
            }
        }
        for degree in 0..=8 {
            all.push(("project_environment", project_environment(degree)));
            all.push(("rasterize_shade", rasterize_shade(degree)));
            for encoding in [Encoding::Stored, Encoding::StoredLinear, Encoding::Linear] {
                let source = transfer_directional(&QuadratureNodes::new(degree), encoding);
                all.push(("transfer_directional", source));
            }
            for asset_degree in 0..=8 {
                for specular_degree in 0..=asset_degree.min(degree) {
                    for (shadow, reflection) in
                        [(true, true), (false, true), (true, false), (false, false)]
                    {
                        let shape = TransferShape {
                            light_degree: degree,
                            asset_degree,
                            specular_degree,
                            shadow,
                            reflection,
                        };
                        all.push(("transfer_harmonic", transfer_harmonic(shape)));
                    }
                }
            }
        }
        all
    });

    #[test]
    fn every_shader_is_valid_in_every_variant() {
        for (name, source) in &*ALL {
            let module = naga::front::wgsl::parse_str(source)
                .unwrap_or_else(|e| panic!("{name}: {}", e.emit_to_string(source)));
            let info = naga::valid::Validator::new(
                naga::valid::ValidationFlags::all(),
                naga::valid::Capabilities::empty(),
            )
            .validate(&module)
            .unwrap_or_else(|e| panic!("{name}: {e:?}"));
            // OpenGL knows textures with their sampler only: one each.
            for entry in 0..module.entry_points.len() {
                let mut samplers = std::collections::HashMap::new();
                for key in &info.get_entry_point(entry).sampling_set {
                    let other = samplers.insert(key.image, key.sampler);
                    assert!(other.is_none_or(|o| o == key.sampler), "{name}: {key:?}");
                }
            }
        }
    }

    #[test]
    fn every_file_is_part_of_a_shader_that_is_validated() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shaders");
        let mut files = Vec::new();
        let mut folders = vec![folder.clone()];
        while let Some(inside) = folders.pop() {
            for entry in std::fs::read_dir(inside).expect("a folder").flatten() {
                let path = entry.path();
                if path.is_dir() {
                    folders.push(path);
                } else if path.extension().is_some_and(|e| e == "wgsl") {
                    files.push(path);
                }
            }
        }
        assert!(files.len() > 10, "{files:?}");
        for file in files {
            let text = std::fs::read_to_string(&file).expect("a file");
            // Its first line says what it is, and no other's does.
            let first = text.lines().next().expect("a line");
            let parts = ALL.iter().filter(|(_, source)| source.contains(first));
            let is_root = file.parent() == Some(&*folder);
            let stem = file.file_stem().unwrap_or_default().to_string_lossy();
            let of: BTreeSet<&str> = parts.map(|(name, _)| *name).collect();
            assert!(!of.is_empty(), "{} is in no shader", file.display());
            assert!(!is_root || of == BTreeSet::from([&*stem]), "{stem}: {of:?}");
        }
    }
}
