//! Relit colour in f64: diffuse light by tau, specular light anew, and the unexplained residual kept.

use glam::DVec3;

use super::{FrontAndBack, OracleDirectional, OracleLight, Rgb, rgb};
use crate::environment::LightSamples;
use crate::oracle::pooling::smoothstep;
use crate::sh::{MAX_COEFFICIENTS, evaluate_basis};
use crate::transfer::directional::{BACK_RANGE, HORIZON, RESIDUAL_FLOOR};

impl OracleDirectional<'_> {
    /// Relights: colour as the asset's own is stored. `[n][K][3]`
    pub fn relight(&self, target: &LightSamples) -> Vec<Rgb> {
        let light = self.light(target);
        let tau = self.tau(&light);
        let radiance = self.changed(&tau);
        (0..self.cloud.len())
            .flat_map(|i| self.relight_surfel(i, &light, tau[i], &radiance))
            .collect()
    }

    fn relight_surfel(
        &self,
        i: usize,
        light: &OracleLight,
        tau: FrontAndBack,
        radiance: &[FrontAndBack],
    ) -> Vec<Rgb> {
        let before = self.specular(i, &self.source, &self.means);
        let seen = self.at_nodes(i, &self.fit(i, &before));
        let colors = self.colors(i, 1.0);
        let diffuse: Vec<Rgb> = (0..colors.len())
            .map(|s| rgb(|c| (colors[s][c] - seen[s][c]).max(0.0)))
            .collect();
        let stored = |tau: Rgb, specular: &[Rgb]| -> Vec<Rgb> {
            (0..diffuse.len())
                .map(|s| rgb(|c| self.encode(diffuse[s][c] * tau[c] + specular[s][c])))
                .collect()
        };
        let brightness = |stored: &[Rgb]| {
            let offset = f64::from(self.cloud.encoding.offset());
            rgb(|c| stored.iter().map(|v| v[c]).sum::<f64>() / stored.len() as f64 + offset)
        };
        let then = stored([1.0; 3], &before);
        let now = stored(tau[0], &self.specular(i, light, radiance));
        let model = self.fit(i, &then);
        let (bright_then, bright_now) = (brightness(&then), brightness(&now));
        let scale = rgb(|c| {
            let (now, then) = (bright_now[c], bright_then[c]);
            let floor = f64::from(RESIDUAL_FLOOR);
            if now < then {
                now / then
            } else {
                (now + floor) / (then + floor)
            }
        });
        let mut out = self.fit(i, &now);
        for (o, (f, m)) in out.iter_mut().zip(self.sh(i).iter().zip(&model)) {
            *o = rgb(|c| o[c] + scale[c] * (f[c] - m[c]));
        }
        let two_sided = f64::from(self.bake.two_sided[i]);
        if two_sided > 0.0 {
            self.add_back(i, tau, two_sided, &mut out);
        }
        out
    }

    fn add_back(&self, i: usize, [front, back]: FrontAndBack, two_sided: f64, out: &mut [Rgb]) {
        let range = f64::from(BACK_RANGE);
        let back = rgb(|c| back[c].clamp(front[c] / range, front[c] * range));
        for side in [1.0, -1.0] {
            for ((v, area), color) in self.nodes.iter().zip(self.colors(i, side)) {
                let horizon = f64::from(HORIZON);
                let share = two_sided * smoothstep(-horizon, horizon, -side * v.z);
                let change = rgb(|c| {
                    let tau = front[c] + share * (back[c] - front[c]);
                    self.encode(color[c] * tau) - self.encode(color[c] * front[c])
                });
                let v = self.node(i, DVec3::new(v.x, v.y, side * v.z));
                let mut y = [0f64; MAX_COEFFICIENTS];
                evaluate_basis((-v).to_array(), self.cloud.sh_degree, &mut y);
                for (o, y) in out.iter_mut().zip(y) {
                    *o = rgb(|c| o[c] + area * y * change[c]);
                }
            }
        }
    }
}
