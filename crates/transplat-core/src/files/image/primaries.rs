//! Conversion of other primaries to linear Rec. 709, which all light is here.

use glam::{DMat3, DVec2, DVec3};

/// CIE xy chromaticities of primaries and white.
#[derive(Clone, Copy, Debug)]
pub struct Chromaticities {
    pub red: DVec2,
    pub green: DVec2,
    pub blue: DVec2,
    pub white: DVec2,
}

/// Primaries of Rec. 709 and sRGB, with the white of daylight at 6504 K.
pub const REC_709: Chromaticities = Chromaticities {
    red: DVec2::new(0.64, 0.33),
    green: DVec2::new(0.30, 0.60),
    blue: DVec2::new(0.15, 0.06),
    white: DVec2::new(0.3127, 0.3290),
};

/// Coordinates that differ by less are the same, however a file rounds them.
const SAME: f64 = 2e-3;

/// The matrix that makes linear Rec. 709 of colours, what is neutral in them becoming white (Bradford's transform, Lam 1985): that is their
/// white, unless another is named. Nothing where they are Rec. 709, or where the coordinates are of no colours.
pub fn rec_709_from(own: &Chromaticities, neutral: Option<DVec2>) -> Option<[[f32; 3]; 3]> {
    let each = |c: &Chromaticities| [c.red, c.green, c.blue, c.white];
    let neutral = neutral.filter(|n| n.is_finite() && n.y > 0.0);
    // CIE XYZ itself is of no white: (1/3, 1/3) is just where its three numbers are equal.
    let is_near = |a: DVec2, b: DVec2| (a - b).abs().max_element() < SAME;
    let is_xyz = [
        (own.red, DVec2::X),
        (own.green, DVec2::Y),
        (own.blue, DVec2::ZERO),
    ];
    let is_xyz = is_xyz.into_iter().all(|(a, b)| is_near(a, b));
    let of_file = match is_xyz && is_near(own.white, DVec2::splat(1.0 / 3.0)) {
        true => REC_709.white,
        false => own.white,
    };
    let neutral = neutral.unwrap_or(of_file);
    let mut pairs = each(own).into_iter().zip(each(&REC_709));
    if pairs.all(|(a, b)| is_near(a, b)) && is_near(neutral, REC_709.white) {
        return None;
    }
    // In columns.
    let cones = DMat3::from_cols_array(&[
        0.8951, -0.7502, 0.0389, 0.2664, 1.7135, -0.0685, -0.1614, 0.0367, 1.0296,
    ]);
    let adapted = DMat3::from_diagonal((cones * xyz(REC_709.white)) / (cones * xyz(neutral)));
    let there = xyz_from(&REC_709).inverse() * cones.inverse() * adapted * cones;
    let matrix = there * xyz_from(own);
    let rows = matrix.transpose().to_cols_array_2d();
    let rows = rows.map(|row| row.map(|v| v as f32));
    // Of no real primaries: any that are used, ACES's and cameras' among them, are within this.
    let is_good = rows.iter().flatten().all(|v| v.abs() < 100.0);
    is_good.then_some(rows)
}

/// Multiplies colours by a matrix of [`rec_709_from`]. What would be below 0 in Rec. 709 is 0: no light of ours has such a colour.
pub fn apply(matrix: &[[f32; 3]; 3], pixels: &mut [[f32; 3]]) {
    for pixel in pixels {
        let [r, g, b] = *pixel;
        // What is no number is told of where the map is made.
        if [r, g, b].iter().all(|v| v.is_finite()) {
            *pixel = matrix.map(|[x, y, z]| (x * r + y * g + z * b).max(0.0));
        }
    }
}

fn xyz(at: DVec2) -> DVec3 {
    DVec3::new(at.x, at.y, 1.0 - at.x - at.y) / at.y
}

/// CIE XYZ of colours, as bright as makes their white's Y 1.
fn xyz_from(c: &Chromaticities) -> DMat3 {
    let of = |at: DVec2| DVec3::new(at.x, at.y, 1.0 - at.x - at.y);
    let primaries = DMat3::from_cols(of(c.red), of(c.green), of(c.blue));
    primaries * DMat3::from_diagonal(primaries.inverse() * xyz(c.white))
}

#[cfg(test)]
mod tests {
    use super::*;

    const ACES: Chromaticities = Chromaticities {
        red: DVec2::new(0.7347, 0.2653),
        green: DVec2::new(0.0, 1.0),
        blue: DVec2::new(0.0001, -0.077),
        white: DVec2::new(0.32168, 0.33767),
    };

    #[test]
    fn aces_becomes_rec_709_as_its_documents_say() {
        // ACES2065-1 to linear Rec. 709 with Bradford, as OpenColorIO's configuration of ACES has it.
        let known = [
            [2.521_686, -1.134_131, -0.387_555],
            [-0.276_480, 1.372_719, -0.096_239],
            [-0.015_378, -0.152_975, 1.168_353],
        ];
        let found = rec_709_from(&ACES, None).expect("others");
        for (row, known) in found.iter().zip(known) {
            for (v, known) in row.iter().zip(known) {
                assert!((v - known).abs() < 2e-3, "{found:?}");
            }
            // White stays white.
            assert!((row.iter().sum::<f32>() - 1.0).abs() < 1e-4);
        }
    }

    #[test]
    fn cie_xyz_is_read_as_the_colour_that_it_is_of() {
        let xyz = Chromaticities {
            red: DVec2::X,
            green: DVec2::Y,
            blue: DVec2::ZERO,
            white: DVec2::splat(1.0 / 3.0),
        };
        let found = rec_709_from(&xyz, None).expect("others");
        // Daylight at 6504 K is white; where it says that what is equal is neutral, that is.
        let white = [0.950_46, 1.0, 1.089_06];
        for row in found {
            let sum: f32 = row.iter().zip(white).map(|(m, v)| m * v).sum();
            assert!((sum - 1.0).abs() < 2e-3, "{found:?}");
        }
        let equal = rec_709_from(&xyz, Some(DVec2::splat(1.0 / 3.0))).expect("others");
        assert!(
            equal
                .iter()
                .all(|row| (row.iter().sum::<f32>() - 1.0).abs() < 1e-3)
        );
    }

    #[test]
    fn our_own_and_nonsense_change_nothing() {
        assert!(rec_709_from(&REC_709, None).is_none());
        let nothing = Chromaticities {
            red: DVec2::new(0.0, 0.0),
            green: DVec2::new(0.0, 0.0),
            ..ACES
        };
        assert!(rec_709_from(&nothing, None).is_none());
        let odd = Chromaticities {
            white: DVec2::NAN,
            ..ACES
        };
        assert!(rec_709_from(&odd, None).is_none());
    }
}
