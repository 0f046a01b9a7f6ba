//! Light on a surfel as rays.

use crate::environment::LightSample;

/// Light on a surfel, a ray from each patch and sun: in planes, since many are written at once, with a list of those that are lit.
#[derive(Clone, Debug)]
pub struct Rays {
    /// Unit vectors towards the sources, an axis after the other.
    pub direction: [[f32; Self::MOST]; 3],
    /// Radiance times solid angle, a channel after the other.
    pub energy: [[f32; Self::MOST]; 3],
    lit: [u8; Self::MOST],
    count: usize,
}

impl Rays {
    /// As many as a byte can number.
    pub const MOST: usize = 256;

    /// Leaves no ray lit.
    pub fn clear(&mut self) {
        self.count = 0;
    }

    /// Lists a ray as lit, if it holds anything; without a branch, since that cannot be foretold. Each ray once at most.
    #[inline(always)]
    pub fn list_if(&mut self, holds: bool, ray: usize) {
        self.lit[self.count % Self::MOST] = ray as u8;
        self.count += usize::from(holds);
    }

    /// Sets a ray and lists it.
    pub fn set(&mut self, ray: usize, light_sample: &LightSample) {
        for c in 0..3 {
            self.direction[c][ray] = light_sample.direction[c];
            self.energy[c][ray] = light_sample.energy[c];
        }
        self.list_if(true, ray);
    }

    /// The rays that are.
    pub fn lit(&self) -> &[u8] {
        &self.lit[..self.count.min(Self::MOST)]
    }
}

impl Default for Rays {
    fn default() -> Self {
        Self {
            direction: [[0.0; Self::MOST]; 3],
            energy: [[0.0; Self::MOST]; 3],
            lit: [0; Self::MOST],
            count: 0,
        }
    }
}
