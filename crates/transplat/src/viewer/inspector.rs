//! Inspector of a surfel.

use transplat_core::color::{Encoding, decode_sh};
use transplat_core::sh::with_degree;
use transplat_core::transfer::PreparedTransfer;

use super::session::Session;
use transplat_engine::project::TARGET;

impl Session {
    /// Tau of surfel `i`, and its relit colour in linear light `[K]`.
    pub fn relit_surfel(&self, i: usize) -> Option<([f32; 3], Vec<[f32; 3]>)> {
        let degree = self.asset()?.cloud.sh_degree;
        let is_alone = !self.project.together.contains(&self.state().id);
        let harmonic = match self.prepared()? {
            PreparedTransfer::Harmonic(harmonic) if is_alone => harmonic,
            _ => {
                // None while a newer one is on its way.
                let state = self.state();
                let relit = state.readout.of(&state.relit.made_from()?.shown())?;
                if i >= relit.sh.len() {
                    return None;
                }
                let mut read = Vec::new();
                let sh = relit.sh.row(i, &mut read);
                let linear = match relit.encoding {
                    Encoding::Linear => sh.to_vec(),
                    encoding => decode_sh(sh, relit.degree, encoding),
                };
                let linear = with_degree(linear, relit.degree, degree);
                return Some((*relit.tau.get(i)?, linear));
            }
        };
        let dc = *harmonic.dc.get(i)?;
        let light = harmonic.light(&self.oriented_lights()[TARGET].light.radiance);
        let relit = harmonic.relight_one(&light, i);
        let ratio = |c: usize| {
            if dc[c] > 0.0 {
                relit[0][c] / dc[c]
            } else {
                0.0
            }
        };
        let tau = std::array::from_fn(ratio);
        Some((tau, with_degree(relit, harmonic.asset_degree, degree)))
    }
}
