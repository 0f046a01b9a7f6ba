//! Coarse relight, for what is shown while the light changes.

use glam::Vec3A;
use rayon::prelude::*;

use super::asset::{FrontAndBack, Radiance};
use super::shadow_rays::Tracing;
use super::{DirectionalTransfer, added};
use crate::environment::Illumination;
use crate::error::Result;

impl DirectionalTransfer {
    /// By how much each surfel's front changes in matte light, nearly: asked of one of those that share what they see, suns as a part of the
    /// sky, new lights of one's own without their shadows, light bounced once. `[n]`
    ///
    /// # Errors
    /// The light was not read for the method.
    pub fn coarse_ratio(&self, target: &Illumination) -> Result<Vec<[f32; 3]>> {
        let asset = &*self.asset;
        let mut settings = self.settings.clone();
        settings.terms.suns = false;
        let ((radiance, light_samples), told) = (target.for_directional()?, target.user_gain);
        let light = (radiance, light_samples, &target.emitters[..]);
        let light = asset.light(light, (self.light_gain, told), &settings, self.fill);
        let light = asset.met(light, &settings, None, Tracing::Known);
        let start = Vec3A::from(self.mean_ratio(light.mean));
        let radiance: Vec<Radiance> = (asset.means.par_iter())
            .map(|sides| sides.map(|m| Vec3A::from(m) * start))
            .collect();
        let visibility_clusters = &asset.bake.directional_visibility.visibility_clusters;
        let of_leader = |i: &u32| {
            let i = *i as usize;
            let bounced = asset.bounced(i, &light, &radiance);
            self.change(i, added(asset.irradiance(i, &light), bounced))
        };
        let of_rows: Vec<FrontAndBack> = visibility_clusters
            .leaders
            .par_iter()
            .map(of_leader)
            .collect();
        let mut tau = visibility_clusters.spread(&of_rows);
        self.trusted(light.user_gain, &mut tau);
        Ok(tau.into_iter().map(|[front, _]| front).collect())
    }
}
