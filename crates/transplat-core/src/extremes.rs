//! Stiff and extreme cases: properties that the transfer must keep, f32 error against f64, and condition numbers.
//!
//! The same battery serves the tests and `transplat report`: another way to relight (the GPU's) is held against it too.

mod case;
mod cases;
#[cfg(test)]
pub(crate) mod properties;

use std::cell::RefCell;

use crate::bake::Bake;
use crate::color::decode_sh;
use crate::environment::Illumination;
use crate::error::{Error, Result};
use crate::oracle::{
    OracleDirectional, OracleHarmonic, difference, relight_asset, visibility_coefficients,
};
use crate::settings::{Method, TransferSettings};
use crate::sh::MAX_DEGREE;
use crate::surfels::SurfelCloud;
use crate::transfer::{Part, PreparedTransfer, Relit};

pub use case::{Case, CaseInput, Trial};
use case::{REFUSED, bake};
pub use cases::all;

/// A target as much stronger than the source is held, and so is nothing to be compared.
const HELD: f32 = 1e11;

/// Another way to relight than the CPU's.
pub type OtherWay<'a> =
    &'a dyn Fn(&PreparedTransfer, &Illumination) -> std::result::Result<Relit, String>;

/// What a case came to with a method.
#[derive(Clone, Debug)]
pub struct CaseOutcome {
    /// The case's name.
    pub case: &'static str,
    /// With which method.
    pub method: Method,
    /// What was asked.
    pub property: &'static str,
    /// Why it does not hold, if it does not.
    pub failure: Option<String>,
    /// Relative L2 distance of the f32 result from the f64 oracle's; none where there is nothing to compare.
    pub f32_error: Option<f64>,
    /// The same of another way to relight.
    pub other_error: Option<f64>,
    /// How many times a relative change of the source light is amplified in tau, at the worst surfel.
    pub condition: Option<f64>,
    /// What is to be known beside that.
    pub note: String,
}

/// Runs a case with a method, on the CPU and, if there is one, by another way.
pub fn run(case: &Case, method: Method, other: Option<OtherWay<'_>>) -> CaseOutcome {
    let mut outcome = CaseOutcome {
        case: case.name,
        method,
        property: case.property,
        failure: None,
        f32_error: None,
        other_error: None,
        condition: None,
        note: String::new(),
    };
    let result = (case.make)().and_then(|input| try_out(case, &input, method, other, &mut outcome));
    let is_to_be_refused = case.property == REFUSED;
    match result {
        Err(error @ Error::Mismatch(_)) if is_to_be_refused => {
            outcome.note = format!("refused: {error}");
        }
        Err(error) => outcome.failure = Some(error.to_string()),
        Ok(()) if is_to_be_refused => outcome.failure = Some("it was not refused".into()),
        Ok(()) => {}
    }
    outcome
}

/// What a battery came to, for people: how many hold and how far off they are, and a line for each that does not.
pub fn in_words(outcomes: &[CaseOutcome]) -> String {
    let failed: Vec<&CaseOutcome> = outcomes.iter().filter(|o| o.failure.is_some()).collect();
    let largest = |of: &dyn Fn(&CaseOutcome) -> Option<f64>| {
        outcomes.iter().filter_map(of).fold(0.0, f64::max)
    };
    let mut words = format!(
        "Extreme cases: {} of {} hold; f32 is off f64 by at most {:.1e}",
        outcomes.len() - failed.len(),
        outcomes.len(),
        largest(&|o| o.f32_error)
    );
    if outcomes.iter().any(|o| o.other_error.is_some()) {
        words += &format!(", the GPU by {:.1e}", largest(&|o| o.other_error));
    }
    words += &format!(
        " (relative L2); the worst condition number is {:.0e}.\n",
        largest(&|o| o.condition)
    );
    for outcome in &failed {
        words += &format!(
            "  {} ({}): {}\n",
            outcome.case,
            outcome.method.preset(),
            outcome.failure.as_deref().unwrap_or_default()
        );
    }
    words
}

fn try_out(
    case: &Case,
    input: &CaseInput,
    method: Method,
    other: Option<OtherWay<'_>>,
    outcome: &mut CaseOutcome,
) -> Result<()> {
    let settings = TransferSettings {
        epsilon: input.epsilon,
        sh_degree: input.degree,
        ..TransferSettings::of(method)
    };
    let cloud = &input.cloud;
    let bake = bake(cloud, method)?;
    let maps = [&input.source, &input.target];
    let lights =
        [0, 1].map(|side| Illumination::of(maps[side], MAX_DEGREE).scaled(input.gains[side]));
    let prepared = PreparedTransfer::new(cloud, &bake, &lights[0], &settings)?;
    let relit = prepared.relight(&lights[1], Part::Whole)?;
    let relit = relit.of_degree(cloud.sh_degree);
    let exact = if cloud.is_empty() {
        None
    } else {
        exact(cloud, &bake, &prepared, &lights, &settings)?
    };
    if let Some((exact, condition)) = &exact {
        outcome.f32_error = Some(difference(&relit.sh, exact).0);
        outcome.condition = Some(*condition);
    }
    if let Some(other) = other.filter(|_| !cloud.is_empty()) {
        let by_other = other(&prepared, &lights[1]).map(|r| r.of_degree(cloud.sh_degree));
        let why = by_other
            .as_ref()
            .map_or_else(|e| Some(e.clone()), not_finite);
        outcome.failure = why.map(|why| format!("on the other device: {why}"));
        if let (Some((exact, _)), Ok(by_other)) = (&exact, by_other) {
            outcome.other_error = Some(difference(&by_other.sh, exact).0);
        }
    }
    let source_was_black = prepared.source_was_black();
    let ratio = lights[1].mean_irradiance() * prepared.light_gain();
    if ratio > HELD && !source_was_black {
        outcome.note = "the target is held to 1e12 times the source".into();
        (outcome.f32_error, outcome.other_error) = (None, None);
    }
    if source_was_black {
        outcome.note = "the source is black: uniform white light is assumed".into();
    }
    let trial = Trial {
        settings,
        cloud,
        lights,
        relit,
        source_was_black,
        bake,
        note: RefCell::default(),
    };
    let held = match not_finite(&trial.relit) {
        Some(why) => Err(why),
        None => (case.check)(&trial),
    };
    let noted = trial.note.into_inner();
    if !noted.is_empty() {
        outcome.note = noted;
    }
    if let Err(why) = held {
        outcome.failure.get_or_insert(why);
    }
    Ok(())
}

fn not_finite(relit: &Relit) -> Option<String> {
    let count = |values: &[[f32; 3]]| values.iter().flatten().filter(|v| !v.is_finite()).count();
    let (sh, tau) = (count(&relit.sh), count(&relit.tau));
    (sh + tau > 0).then(|| format!("{sh} coefficients and {tau} ratios are no numbers"))
}

/// The oracle's colour and the worst condition number; none where the oracle has no such case.
fn exact(
    cloud: &SurfelCloud,
    bake: &Bake,
    prepared: &PreparedTransfer,
    lights: &[Illumination; 2],
    settings: &TransferSettings,
) -> Result<Option<(Vec<[f64; 3]>, f64)>> {
    let even = Illumination::even(MAX_DEGREE);
    let source = if prepared.source_was_black() {
        &even
    } else {
        &lights[0]
    };
    Ok(match (bake, prepared) {
        (Bake::Directional(directional), PreparedTransfer::Directional(_)) => {
            let (_, source) = source.for_directional()?;
            let (_, target) = lights[1].for_directional()?;
            // A channel that is missing is filled up, which the oracle leaves out.
            let mean = source.mean_irradiance();
            if source.mean_irradiances().iter().any(|e| *e < 0.05 * mean) {
                return Ok(None);
            }
            let oracle = OracleDirectional::new(cloud, directional, source, settings.epsilon())
                .trusting(lights[0].trust);
            let condition = (0..cloud.len()).map(|i| oracle.condition(i));
            let condition = condition.fold(0.0, f64::max);
            Some((oracle.relight(target), condition))
        }
        (Bake::Harmonic(visibility), PreparedTransfer::Harmonic(harmonic)) => {
            let degree = settings.sh_degree;
            let [source, target] = [source, &lights[1]].map(|l| l.radiance.truncated(degree));
            let oracle = OracleHarmonic::new(&source, &target, settings);
            let color = decode_sh(&cloud.sh, cloud.sh_degree, cloud.encoding);
            let relit = relight_asset(&oracle, &color, &harmonic.normals, visibility);
            let condition = (0..cloud.len().min(64)).map(|i| {
                let v = visibility_coefficients(visibility, i, degree);
                let v: Vec<f64> = v.into_iter().map(|(v, _)| v).collect();
                oracle.conditions(harmonic.normals[i].to_array().map(f64::from), &v)[0]
            });
            Some((relit, condition.fold(0.0, f64::max)))
        }
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn number(v: Option<f64>) -> String {
        v.map_or("-".into(), |v| format!("{v:.1e}"))
    }

    #[test]
    fn every_case_holds_with_both_methods() {
        let mut failures = Vec::new();
        for case in all() {
            for method in Method::ALL {
                let outcome = run(&case, method, None);
                println!(
                    "{} ({}): {:?} f32 {} condition {} {}",
                    case.name,
                    method.preset(),
                    outcome.failure,
                    number(outcome.f32_error),
                    number(outcome.condition),
                    outcome.note
                );
                // Some hundred roundings of 2^-24 each.
                if outcome.f32_error.is_some_and(|e| e > 1e-5) {
                    failures.push(format!("{} is off f64", case.name));
                }
                failures.extend(
                    outcome
                        .failure
                        .map(|why| format!("{} ({}): {why}", case.name, method.preset())),
                );
            }
        }
        assert!(failures.is_empty(), "{failures:#?}");
    }
}
