//! The plane that Gaussians lie in together: the normal of one that is as thick as it is wide, whose shortest axis means nothing.

use glam::Vec3;
use nalgebra::{Matrix3, SymmetricEigen, Vector3};

use crate::numeric::smoothstep;
use crate::surfels::SurfelCloud;

/// Thickness over the smaller standard deviation across it at which a shortest axis begins to mean less, and from which on it means nothing.
const ROUND: [f32; 2] = [0.3, 0.8];

/// How much of surfel `i`'s shortest axis is a normal: 1 of a flat one.
pub(super) fn flatness(cloud: &SurfelCloud, i: usize) -> f32 {
    let thickness = cloud.thicknesses[i].sigma();
    let across = cloud.scales[i].min_element().max(f32::MIN_POSITIVE);
    1.0 - smoothstep(ROUND[0], ROUND[1], thickness / across)
}

/// The normal of the plane through weighted places, and how much of a plane it is, 0 to 1; nothing of fewer than three.
pub(super) fn plane(places: impl Iterator<Item = (Vec3, f32)> + Clone) -> Option<(Vec3, f32)> {
    let (mut mean, mut total, mut count) = (Vec3::ZERO, 0.0, 0);
    for (p, weight) in places.clone().filter(|(_, w)| *w > 0.0) {
        mean += p * weight;
        total += weight;
        count += 1;
    }
    if count < 3 || !f32::is_normal(total) {
        return None;
    }
    mean /= total;
    let mut spread = Matrix3::<f32>::zeros();
    for (p, weight) in places {
        let off = Vector3::from((p - mean).to_array());
        spread += off * off.transpose() * (weight / total);
    }
    let found = SymmetricEigen::try_new(spread, 1e-9, 64)?;
    let mut order = [0, 1, 2];
    order.sort_by(|a, b| found.eigenvalues[*a].total_cmp(&found.eigenvalues[*b]));
    let [least, middle, _] = order.map(|i| found.eigenvalues[i].max(0.0));
    if middle <= 0.0 {
        return None;
    }
    let normal: [f32; 3] = found.eigenvectors.column(order[0]).into_owned().into();
    let planar = 1.0 - least / middle;
    let normal = Vec3::from_array(normal).try_normalize()?;
    planar
        .is_finite()
        .then_some((normal, planar.clamp(0.0, 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_on_a_plane_tell_its_normal_and_a_ball_of_them_none() {
        let tilted = Vec3::new(1.0, 2.0, -0.5).normalize();
        let u = tilted.any_orthonormal_vector();
        let v = tilted.cross(u);
        let at = |i: usize| (i as f32 * 2.4).sin_cos();
        let on = (0..40).map(|i| {
            let (s, c) = at(i);
            let r = (i as f32 / 40.0).sqrt();
            (Vec3::splat(3.0) + (u * s + v * c) * r, 1.0)
        });
        let (normal, planar) = plane(on).expect("a plane");
        assert!(normal.dot(tilted).abs() > 0.9999 && planar > 0.999);
        let ball = crate::synthetic::sphere(200).positions;
        let (_, planar) = plane(ball.iter().map(|p| (*p, 1.0))).expect("places");
        assert!(planar < 0.2, "{planar}");
        assert!(plane([(Vec3::ZERO, 1.0); 2].into_iter()).is_none());
        assert!(plane([(Vec3::ONE, 1.0); 5].into_iter()).is_none());
        assert!(plane([(Vec3::NAN, 1.0); 5].into_iter()).is_none());
    }
}
