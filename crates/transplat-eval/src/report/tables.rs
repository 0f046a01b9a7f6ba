//! Tables of the comparison with truth.

use super::variants::{Approach, TruthVariant};
use transplat_engine::words::milliseconds;

/// One pair of source and target, relit by one variant.
#[derive(Clone, Debug)]
pub struct TruthRow {
    pub object: String,
    pub source: String,
    pub target: String,
    pub variant: TruthVariant,
    pub psnr: f64,
    /// Over the pixels that the object covers.
    pub psnr_mask: f64,
    pub ssim: f64,
    pub perceptual: f64,
    pub transfer_ms: Option<f64>,
}

/// Error of a method that relights an object by its own capture light.
pub struct RoundTrip {
    pub object: String,
    pub method: &'static str,
    /// Against the capture.
    pub psnr: f64,
}

/// Estimated capture light of an object, beside the true one.
pub struct LightEstimate {
    pub object: String,
    /// Name of the true light.
    pub source: String,
    pub confidence: f32,
    /// Correlation of the irradiance over the surfels with the true one, by channel.
    pub correlation: [f64; 3],
    /// Between the directions that most of the light comes from, in degrees.
    pub angle: Option<f32>,
    /// Factor of the true light over the estimate, by channel.
    pub gain: [f64; 3],
}

/// All rows, for programs.
pub fn csv(rows: &[TruthRow]) -> String {
    let mut out = String::from(
        "object,source,target,preset,terms_off,psnr,psnr_mask,ssim,perceptual,transfer_ms,source_light\n",
    );
    for r in rows {
        let ms = r.transfer_ms.map_or(String::new(), |ms| format!("{ms:.2}"));
        out += &format!(
            "{},{},{},{},{},{:.3},{:.3},{:.5},{:.2},{ms},{}\n",
            quoted(&r.object),
            quoted(&r.source),
            quoted(&r.target),
            r.variant.method(),
            r.variant.off.unwrap_or_default(),
            r.psnr,
            r.psnr_mask,
            r.ssim,
            r.perceptual,
            quoted(r.variant.source_light()),
        );
    }
    out
}

/// A name as a field of a CSV (RFC 4180).
pub fn quoted(name: &str) -> String {
    if name.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", name.replace('"', "\"\""))
    } else {
        name.to_owned()
    }
}

/// A name as a cell of a table.
fn cell(name: &str) -> String {
    name.replace('|', "\\|").replace(['\n', '\r'], " ")
}

/// Tables for people: what each term carries, each pair by method, and the round trips.
pub fn markdown(
    rows: &[TruthRow],
    round_trips: &[RoundTrip],
    estimates: &[LightEstimate],
    variants: &[TruthVariant],
) -> String {
    let wholes: Vec<&TruthVariant> = variants.iter().filter(|v| v.off.is_none()).collect();
    [
        terms(rows, variants),
        pairs(rows, &wholes),
        returned(round_trips),
        unknown_light(rows, estimates),
    ]
    .join("\n")
}

fn mean(values: impl Iterator<Item = f64>) -> f64 {
    let (sum, count) = values.fold((0.0, 0), |(sum, count), v| (sum + v, count + 1));
    sum / f64::from(count.max(1))
}

fn terms(rows: &[TruthRow], variants: &[TruthVariant]) -> String {
    let of = |variant: &TruthVariant| -> Vec<&TruthRow> {
        rows.iter().filter(|r| r.variant == *variant).collect()
    };
    let mut out = String::from(
        "| transfer | PSNR | to its preset | worst pair | PSNR in the mask | SSIM | SSIMULACRA2 | new light |\n|---|---|---|---|---|---|---|---|\n",
    );
    for variant in variants {
        let these = of(variant);
        let whole = variants
            .iter()
            .find(|v| v.is_whole_preset() && v.method() == variant.method())
            .filter(|_| !variant.is_whole_preset());
        let (gain, worst) = match whole.map(of) {
            None => (String::new(), String::new()),
            Some(whole) => {
                let gains = || these.iter().zip(&whole).map(|(a, b)| a.psnr - b.psnr);
                let worst = gains().fold(f64::INFINITY, f64::min);
                (format!("{:+.2}", mean(gains())), format!("{worst:+.2}"))
            }
        };
        let times = || these.iter().filter_map(|r| r.transfer_ms);
        let time = if times().count() == 0 {
            String::new()
        } else {
            milliseconds(mean(times()))
        };
        out += &format!(
            "| {} | {:.2} | {gain} | {worst} | {:.2} | {:.4} | {:.1} | {time} |\n",
            variant.name(),
            mean(these.iter().map(|r| r.psnr)),
            mean(these.iter().map(|r| r.psnr_mask)),
            mean(these.iter().map(|r| r.ssim)),
            mean(these.iter().map(|r| r.perceptual)),
        );
    }
    out
}

fn pairs(rows: &[TruthRow], wholes: &[&TruthVariant]) -> String {
    let names: Vec<String> = wholes.iter().map(|v| v.name()).collect();
    let mut out = format!(
        "| object | target | {} |\n|---|---|{}\n",
        names.join(" | "),
        "---|".repeat(names.len())
    );
    for first in rows.iter().filter(|r| r.variant == *wholes[0]) {
        let same = |r: &&TruthRow| r.object == first.object && r.target == first.target;
        let scores: Vec<String> = wholes
            .iter()
            .filter_map(|v| rows.iter().filter(same).find(|r| r.variant == **v))
            .map(|r| format!("{:.2}", r.psnr))
            .collect();
        out += &format!(
            "| {} | {} | {} |\n",
            cell(&first.object),
            cell(&first.target),
            scores.join(" | ")
        );
    }
    out
}

fn returned(round_trips: &[RoundTrip]) -> String {
    let mut out = String::from(
        "Relit by the light of the capture, against the capture:\n\n| object | preset | PSNR |\n|---|---|---|\n",
    );
    for r in round_trips {
        out += &format!("| {} | {} | {:.1} |\n", cell(&r.object), r.method, r.psnr);
    }
    out
}

/// Factor between two strengths of light that count as the same.
const SAME_STRENGTH: f64 = 1.15;

/// Table of the cost of an unknown capture light, and of the error of its estimate.
fn unknown_light(rows: &[TruthRow], estimates: &[LightEstimate]) -> String {
    if estimates.is_empty() {
        return String::new();
    }
    let psnr = |object: &str, is_asked: &dyn Fn(&TruthVariant) -> bool| {
        let of = rows
            .iter()
            .filter(|r| r.object == object && is_asked(&r.variant));
        mean(of.map(|r| r.psnr))
    };
    let mut out = String::from(
        "| object | capture light | light known | light estimated | captured colour as albedo | not relit | confidence | correlation of the irradiance | dominant direction | true strength |\n|---|---|---|---|---|---|---|---|---|---|\n",
    );
    let (mut losses, mut confidences, mut same) = (Vec::new(), Vec::new(), 0);
    for e in estimates {
        let known = psnr(&e.object, &|v| v.is_default());
        let estimated = psnr(&e.object, &|v| matches!(v.approach, Approach::Estimated(_)));
        let each = |v: [f64; 3], digits: usize| v.map(|v| format!("{v:.digits$}")).join(" ");
        out += &format!(
            "| {} | {} | {known:.1} | {estimated:.1} | {:.1} | {:.1} | {:.2} | {} | {} | {} |\n",
            cell(&e.object),
            cell(&e.source),
            psnr(&e.object, &|v| v.approach == Approach::Albedo),
            psnr(&e.object, &|v| v.approach == Approach::Nothing),
            e.confidence,
            each(e.correlation, 3),
            e.angle
                .map_or("-".into(), |a| format!("{a:.1} degrees off")),
            each(e.gain, 2),
        );
        losses.push(known - estimated);
        confidences.push(f64::from(e.confidence));
        let strength = e.gain.iter().sum::<f64>() / 3.0;
        same += usize::from((1.0 / SAME_STRENGTH..=SAME_STRENGTH).contains(&strength));
    }
    out += &format!(
        "\nLost to the known light: {:.2} dB on average. Rank correlation of confidence and loss: {:.2}. Strength within 15 %: {same} of {}.\n",
        mean(losses.iter().copied()),
        rank_correlation(&confidences, &losses),
        estimates.len(),
    );
    out
}

/// Correlation of the ranks (Spearman, 1904), -1 to 1; 0 where all are equal.
fn rank_correlation(a: &[f64], b: &[f64]) -> f64 {
    let ranks = |values: &[f64]| -> Vec<f64> {
        // Equal values share the mean of their ranks.
        let below = |v: f64| values.iter().filter(|o| **o < v).count() as f64;
        let equal = |v: f64| values.iter().filter(|o| **o == v).count() as f64;
        values
            .iter()
            .map(|v| below(*v) + 0.5 * (equal(*v) - 1.0))
            .collect()
    };
    let centre = 0.5 * (a.len() as f64 - 1.0);
    let (a, b) = (ranks(a), ranks(b));
    let product = |a: &[f64], b: &[f64]| -> f64 {
        let both = a.iter().zip(b);
        both.map(|(a, b)| (a - centre) * (b - centre)).sum()
    };
    let spread = (product(&a, &a) * product(&b, &b)).sqrt();
    if spread > 0.0 {
        product(&a, &b) / spread
    } else {
        0.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_with_commas_and_quotes_stay_one_field() {
        assert_eq!(quoted("plain"), "plain");
        assert_eq!(quoted("a, \"b\""), "\"a, \"\"b\"\"\"");
    }

    #[test]
    fn a_rank_correlation_asks_for_order_alone() {
        let rising = [1.0, 2.0, 30.0, 31.0];
        assert!((rank_correlation(&rising, &[0.0, 5.0, 6.0, 1e9]) - 1.0).abs() < 1e-12);
        assert!((rank_correlation(&rising, &[3.0, 2.0, 1.0, 0.0]) + 1.0).abs() < 1e-12);
        // Ranks 0, 1.5, 1.5, 3 against 0, 1, 2, 3: covariance 4.5 over the root of 4.5 times 5.
        let tied = rank_correlation(&rising, &[0.0, 1.0, 1.0, 2.0]);
        assert!((tied - (4.5_f64 / 5.0).sqrt()).abs() < 1e-12);
        assert_eq!(rank_correlation(&rising, &[1.0; 4]), 0.0);
    }
}
