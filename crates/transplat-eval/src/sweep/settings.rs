//! Settings of the sweep.

use std::borrow::Cow;
use std::cell::RefCell;
use std::time::Instant;

use anyhow::Result;
use transplat_core::bake::Bake;
use transplat_core::bake::directional::DirectionalBake;
use transplat_core::bake::harmonic::{BakeInput, DEFAULT_DIRECTIONS, Softness};
use transplat_core::progress::no_progress;
use transplat_core::settings::optimizations::Optimizations;
use transplat_core::settings::{Method, Terms, TransferSettings};
use transplat_core::sh::MAX_DEGREE;
use transplat_core::surfels::SurfelCloud;

use super::subject::{Effort, Subject};

/// Samples that the paper projects a reflection by.
const SAMPLES: usize = 1200;

/// One of the settings that are compared.
#[derive(Clone, Debug)]
pub struct Setting {
    /// Name of the setting.
    pub name: String,
    /// Method and terms.
    pub settings: TransferSettings,
    /// True for a default.
    pub is_default: bool,
    /// True where the user may choose it.
    pub is_offered: bool,
    /// Samples that reflections are projected by, where that is not exact.
    pub samples: Option<usize>,
    /// SH degree of the visibility, where that is below the light's.
    pub visibility_degree: Option<usize>,
    /// Method that it is of; none where both are served.
    pub of: Option<Method>,
}

impl Setting {
    /// A setting without a bake of its own.
    pub fn plain(settings: TransferSettings) -> Self {
        Self {
            name: format!("preset {}", settings.method.preset()),
            of: Some(settings.method),
            settings,
            is_default: false,
            is_offered: false,
            samples: None,
            visibility_degree: None,
        }
    }

    /// Name of the method's preset.
    pub fn method(&self) -> &'static str {
        self.of.map_or("", Method::preset)
    }

    /// A bake as this setting sees it.
    pub fn blurred<'a>(&self, bake: &'a Bake) -> Cow<'a, Bake> {
        match (bake, self.visibility_degree) {
            (Bake::Harmonic(v), Some(degree)) => {
                Cow::Owned(Bake::Harmonic(v.of_degree(degree).into()))
            }
            _ => Cow::Borrowed(bake),
        }
    }
}

/// Bake of the harmonic method's visibility maps.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MapBake {
    /// Directions of the harmonic bake.
    pub directions: usize,
    /// Texels along the edge of a map.
    pub resolution: usize,
    /// Softness of the maps.
    pub softness: Softness,
}

/// Projections of an environment: so many samples, or all pixels.
pub fn projections() -> Vec<(Setting, Option<usize>)> {
    let of = |name: String, is_default| Setting {
        name,
        is_default,
        of: None,
        ..Setting::plain(TransferSettings::default())
    };
    let samples = [1_000, 10_000, 100_000];
    let mut all: Vec<_> = samples
        .map(|n| (of(format!("{n} point samples"), false), Some(n)))
        .into();
    all.push((of("every pixel".into(), true), None));
    all
}

/// Bakes of the harmonic method: each knob alone, the others as they are by default.
pub fn map_bakes(cloud: &SurfelCloud, effort: Effort) -> Vec<(Setting, MapBake)> {
    let plain = MapBake {
        directions: DEFAULT_DIRECTIONS,
        resolution: BakeInput::new(cloud, DEFAULT_DIRECTIONS).resolution,
        softness: Softness::default(),
    };
    let of = |name: String, how: MapBake| {
        let setting = Setting {
            name,
            is_default: how == plain,
            ..Setting::plain(TransferSettings::of(Method::Harmonic))
        };
        (setting, how)
    };
    let directions: &[usize] = match effort {
        Effort::Full => &[16, 32, 64, 128, 256, 512, 1024, 2048],
        Effort::Quick | Effort::Offered => &[32, DEFAULT_DIRECTIONS, 256],
    };
    let directions = directions.iter().map(|n| {
        let how = MapBake {
            directions: *n,
            ..plain
        };
        of(format!("{n} directions"), how)
    });
    let mut all: Vec<_> = directions.collect();
    if effort != Effort::Full {
        return all;
    }
    let resolutions = [32, 64, 128, 256, 512, 1024].map(|resolution| MapBake {
        resolution,
        ..plain
    });
    let taps = [1, 2, 4].map(|taps| MapBake {
        softness: Softness {
            taps,
            ..plain.softness
        },
        ..plain
    });
    let sharpness = [25.0, 50.0, 100.0, 400.0, 1000.0].map(|sharpness| MapBake {
        softness: Softness {
            sharpness,
            ..plain.softness
        },
        ..plain
    });
    let named = resolutions
        .map(|how| (format!("maps of {} texels", how.resolution), how))
        .into_iter()
        .chain(taps.map(|how| (format!("{} taps", how.softness.taps), how)))
        .chain(sharpness.map(|how| (format!("shadow sharpness {}", how.softness.sharpness), how)));
    // The default is among the directions.
    let others = named.filter(|(_, how)| *how != plain);
    all.extend(others.map(|(name, how)| of(name, how)));
    all
}

/// A share of the directional method's bake.
pub fn staged(share: f32) -> Setting {
    let name = if share == 1.0 {
        "all rays".to_owned()
    } else {
        format!("{:.0} % of the rays", 100.0 * share)
    };
    Setting {
        name,
        is_default: share == 1.0,
        ..Setting::plain(TransferSettings::of(Method::Directional))
    }
}

/// Stages of the directional method's bake: shares of its rays, and how many milliseconds in they were there.
pub fn staged_bakes(cloud: &SurfelCloud) -> Result<Vec<(f32, f64, Bake)>> {
    let start = Instant::now();
    let found = RefCell::new(Vec::new());
    let keep = |directional, share| {
        let ms = start.elapsed().as_secs_f64() * 1e3;
        let bake = Bake::Directional(std::sync::Arc::new(directional));
        found.borrow_mut().push((share, ms, bake));
    };
    let stages = (&[8, 4, 2, 1][..], &Optimizations::default());
    let whole = DirectionalBake::bake_in_stages(cloud, stages, &no_progress, keep)?;
    keep(whole, 1.0);
    Ok(found.into_inner())
}

/// Settings of the transfer.
pub fn transfers(effort: Effort) -> Vec<Setting> {
    let default = |method: Method| Setting {
        is_default: true,
        is_offered: true,
        ..Setting::plain(TransferSettings::of(method))
    };
    let harmonic = TransferSettings::of(Method::Harmonic);
    let mut all = vec![default(Method::Directional)];
    for method in Method::ALL {
        for term in Terms::of_method(method) {
            let Ok(settings) = TransferSettings::of(method).without(term.name) else {
                continue;
            };
            all.push(Setting {
                name: format!("{} without {}", method.preset(), term.name),
                is_offered: true,
                ..Setting::plain(settings)
            });
        }
    }
    let degrees = |settings: &TransferSettings, what: &str| -> Vec<Setting> {
        let all = (0..=MAX_DEGREE).filter(|l| effort != Effort::Quick || [1, 3, 5].contains(l));
        all.map(|degree| Setting {
            name: format!("{what} of degree {degree}"),
            is_default: what == "paper" && degree == harmonic.sh_degree,
            is_offered: what == "paper",
            ..Setting::plain(TransferSettings {
                sh_degree: degree,
                ..settings.clone()
            })
        })
        .collect()
    };
    all.extend(degrees(&harmonic, "paper"));
    if effort == Effort::Offered {
        return all;
    }
    if effort == Effort::Full
        && let Ok(series) = TransferSettings::of(Method::Directional).without("sums")
    {
        all.extend(degrees(&series, "cosine transfer (best without sums)"));
    }
    if effort == Effort::Full {
        let sharp = TransferSettings {
            sh_degree: MAX_DEGREE,
            ..harmonic.clone()
        };
        all.extend([0, 1, 2, 3, 5].map(|degree| Setting {
            name: format!("paper of degree {MAX_DEGREE}, visibility of {degree}"),
            visibility_degree: Some(degree),
            ..Setting::plain(sharp.clone())
        }));
    }
    all.push(Setting {
        name: format!("paper, reflections by {SAMPLES} samples"),
        samples: Some(SAMPLES),
        ..Setting::plain(harmonic)
    });
    all
}

/// About how many points there will be, to tell how far it is.
pub fn count(subject: &Subject, devices: usize, effort: Effort) -> usize {
    let before = if effort == Effort::Offered {
        0
    } else {
        projections().len() + map_bakes(&subject.cloud, effort).len() + 4
    };
    before + devices * transfers(effort).len()
}
