//! Objects that are relit together: each blocks the others' light, and shines on them.

use rayon::prelude::*;

use super::directional::{DirectionalLight, DirectionalTransfer, FrontAndBack, Incident, TURNS};
use super::relit::{Part, Relit};
use crate::bake::surroundings::Surroundings;

/// An object of a scene, ready to be relit with the others.
pub struct Member<'a> {
    /// The object under the light of its own capture.
    pub transfer: &'a DirectionalTransfer,
    /// What it sees of the others.
    pub surroundings: &'a Surroundings,
    /// What the scene is relit by, as the object sees it: [`DirectionalTransfer::light`].
    pub light: DirectionalLight,
    /// What its colour is multiplied by to be radiance in the unit of the lights: the exposure of its capture.
    pub radiance_of_color: f32,
}

/// Relights the objects of a scene. What one of them radiates shines on the others; how strong that is in the light of each is known from
/// `radiance_of_color`, since its own colour alone does not tell.
pub fn relight_together(members: &[Member<'_>], part: Part) -> Vec<Relit> {
    let lights: Vec<Incident<'_>> = (members.par_iter())
        .map(|m| {
            let transfer = m.transfer;
            let light = m.light.clone();
            (transfer.asset).incident(light, &transfer.settings, Some(m.surroundings))
        })
        .collect();
    let mut taus: Vec<Vec<FrontAndBack>> = (members.iter())
        .map(|m| vec![[m.transfer.mean_ratio(&m.light); 2]; m.transfer.asset.bake.len()])
        .collect();
    for _ in 0..TURNS {
        let radiance = own_radiance(members, &taus);
        taus = (0..members.len())
            .map(|i| {
                members[i]
                    .transfer
                    .turn(&lights[i], &seen_by(members, i, &radiance))
            })
            .collect();
    }
    for (member, tau) in members.iter().zip(&mut taus) {
        member.transfer.trusted(tau);
    }
    let radiance = own_radiance(members, &taus);
    (taus.into_iter().enumerate())
        .map(|(i, tau)| {
            let seen = seen_by(members, i, &radiance);
            members[i]
                .transfer
                .shown((&lights[i], part), tau, &seen, &[])
        })
        .collect()
}

/// What the surfels of each object radiate, in the unit of its colour. `[objects][n]`
fn own_radiance(members: &[Member<'_>], taus: &[Vec<FrontAndBack>]) -> Vec<Vec<FrontAndBack>> {
    let each = members.iter().zip(taus);
    each.map(|(m, tau)| m.transfer.asset.radiance(tau))
        .collect()
}

/// What all surfels of the scene radiate as one of the objects takes it: itself as its capture has it, the others in units of its source.
fn seen_by(
    members: &[Member<'_>],
    which: usize,
    radiance: &[Vec<FrontAndBack>],
) -> Vec<FrontAndBack> {
    let light_gain = members[which].transfer.light_gain;
    let scaled = |(i, radiance): (usize, &Vec<FrontAndBack>)| {
        let gain = if i == which {
            1.0
        } else {
            light_gain * members[i].radiance_of_color
        };
        let scaled = |b: &FrontAndBack| b.map(|side| side.map(|v| gain * v));
        radiance.iter().map(scaled).collect::<Vec<_>>()
    };
    radiance.iter().enumerate().flat_map(scaled).collect()
}

#[cfg(test)]
mod tests;
