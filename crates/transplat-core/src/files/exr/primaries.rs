//! Colours of other primaries as linear Rec. 709, which all light is here.

use exr::meta::attribute::Chromaticities;
use exr::prelude::Vec2;
use glam::{DMat3, DVec3};

/// Those of Rec. 709 and sRGB, with the white of daylight at 6504 K.
const REC_709: Chromaticities = Chromaticities {
    red: Vec2(0.64, 0.33),
    green: Vec2(0.30, 0.60),
    blue: Vec2(0.15, 0.06),
    white: Vec2(0.3127, 0.3290),
};

/// Coordinates that differ by less are the same, however a file rounds them.
const SAME: f32 = 2e-3;

/// The matrix that makes linear Rec. 709 of colours, white staying white (Bradford's transform, Lam 1985); nothing where they are that, or where
/// the coordinates are of no colours.
pub fn rec_709_from(own: &Chromaticities) -> Option<[[f32; 3]; 3]> {
    let each = |c: &Chromaticities| [c.red, c.green, c.blue, c.white];
    let mut pairs = each(own).into_iter().zip(each(&REC_709));
    if pairs.all(|(a, b)| (a.x() - b.x()).abs().max((a.y() - b.y()).abs()) < SAME) {
        return None;
    }
    // In columns.
    let cones = DMat3::from_cols_array(&[
        0.8951, -0.7502, 0.0389, 0.2664, 1.7135, -0.0685, -0.1614, 0.0367, 1.0296,
    ]);
    let white = |c: &Chromaticities| cones * xyz(c.white);
    let adapted = DMat3::from_diagonal(white(&REC_709) / white(own));
    let there = xyz_from(&REC_709).inverse() * cones.inverse() * adapted * cones;
    let matrix = there * xyz_from(own);
    let rows = matrix.transpose().to_cols_array_2d();
    let rows = rows.map(|row| row.map(|v| v as f32));
    // Of no real primaries: any that are used, ACES's and cameras' among them, are within this.
    let is_good = rows.iter().flatten().all(|v| v.abs() < 100.0);
    is_good.then_some(rows)
}

fn xyz(at: Vec2<f32>) -> DVec3 {
    let (x, y) = (f64::from(at.x()), f64::from(at.y()));
    DVec3::new(x, y, 1.0 - x - y) / y
}

/// CIE XYZ of colours, as bright as makes their white's Y 1.
fn xyz_from(c: &Chromaticities) -> DMat3 {
    let of = |at: Vec2<f32>| {
        let (x, y) = (f64::from(at.x()), f64::from(at.y()));
        DVec3::new(x, y, 1.0 - x - y)
    };
    let primaries = DMat3::from_cols(of(c.red), of(c.green), of(c.blue));
    primaries * DMat3::from_diagonal(primaries.inverse() * xyz(c.white))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ACES: Chromaticities = Chromaticities {
        red: Vec2(0.7347, 0.2653),
        green: Vec2(0.0, 1.0),
        blue: Vec2(0.0001, -0.077),
        white: Vec2(0.32168, 0.33767),
    };

    #[test]
    fn aces_becomes_rec_709_as_its_documents_say() {
        // ACES2065-1 to linear Rec. 709 with Bradford, as OpenColorIO's configuration of ACES has it.
        let known = [
            [2.521_686, -1.134_131, -0.387_555],
            [-0.276_480, 1.372_719, -0.096_239],
            [-0.015_378, -0.152_975, 1.168_353],
        ];
        let found = rec_709_from(&ACES).expect("others");
        for (row, known) in found.iter().zip(known) {
            for (v, known) in row.iter().zip(known) {
                assert!((v - known).abs() < 2e-3, "{found:?}");
            }
            // White stays white.
            assert!((row.iter().sum::<f32>() - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn our_own_and_nonsense_change_nothing() {
        assert!(rec_709_from(&REC_709).is_none());
        let nothing = Chromaticities {
            red: Vec2(0.0, 0.0),
            green: Vec2(0.0, 0.0),
            ..ACES
        };
        assert!(rec_709_from(&nothing).is_none());
        let odd = Chromaticities {
            white: Vec2(f32::NAN, 0.0),
            ..ACES
        };
        assert!(rec_709_from(&odd).is_none());
    }
}
