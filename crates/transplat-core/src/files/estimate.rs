//! Estimated capture light, saved beside the bake as JSON.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::bake::{Fnv, geometry_key};
use super::write::write_atomically;
use crate::color::Encoding;
use crate::error::{Error, Result};
use crate::estimate::Estimate;
use crate::surfels::SurfelCloud;

/// Another one for each change of the estimate's mathematics, or of what it shares with the directional method (its epsilon, what is white).
const VERSION: u32 = 6;

#[derive(Serialize, Deserialize)]
struct EstimateFile {
    version: u32,
    asset_key: String,
    estimate: Estimate,
}

/// Writes what an asset told of its light.
///
/// # Errors
/// The file cannot be written; nothing is left of it then.
pub fn save_estimate(path: &Path, cloud: &SurfelCloud, estimate: &Estimate) -> Result<()> {
    write_atomically(path, |out| {
        let file = EstimateFile {
            version: VERSION,
            asset_key: asset_key(cloud),
            estimate: estimate.clone(),
        };
        Ok(serde_json::to_writer_pretty(out, &file)?)
    })
}

/// A key of everything that an estimate depends on: geometry and colour.
fn asset_key(cloud: &SurfelCloud) -> String {
    let mut key = Fnv::default();
    key.add(&geometry_key(cloud).to_le_bytes());
    key.add(bytemuck::cast_slice(&cloud.sh));
    key.add(&[
        u8::from(cloud.encoding == Encoding::Stored),
        cloud.sh_degree as u8,
    ]);
    format!("{:016x}", key.0)
}

/// Reads an estimate that was kept.
///
/// # Errors
/// The file cannot be read, is no estimate of this version, or belongs to another asset.
pub fn load_estimate(path: &Path, cloud: &SurfelCloud) -> Result<Estimate> {
    let text = super::read::read_all(path, 1 << 24)?;
    let file: EstimateFile = super::decode::json(&text)
        .map_err(|e| Error::invalid(path, format!("no estimate of a light: {e}")))?;
    if file.version != VERSION || file.asset_key != asset_key(cloud) {
        let message = "the estimate of a light is of another asset or version";
        return Err(Error::invalid(path, message));
    }
    if !file.estimate.light.is_sound() {
        let message = "the estimate of a light is broken";
        return Err(Error::invalid(path, message));
    }
    Ok(file.estimate)
}
