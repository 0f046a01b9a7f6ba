//! Saved bakes: the openness of every surfel, tied to the geometry it was baked from. [`crate::export::save_bake`] writes them.

use std::io::Read;
use std::path::Path;

use crate::error::{Error, Result};
use crate::surfels::SurfelCloud;
use crate::visibility::{DIRECTIONS, Visibility};

/// What a bake file begins with.
pub(crate) const MAGIC: &[u8; 16] = b"transplat-bake 1";

/// Magic, geometry key, surfels and directions.
const HEADER_BYTES: u64 = 16 + 8 + 8 + 8;

/// What the head of a bake file says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BakeHeader {
    /// FNV-1a of the geometry.
    pub geometry_key: u64,
    /// Number of surfels.
    pub surfels: u64,
    /// Directions of the lattice.
    pub directions: u64,
}

/// A key of everything that a bake depends on: positions, frames, scales and opacities (FNV-1a, 64 bits).
pub fn geometry_key(cloud: &SurfelCloud) -> u64 {
    let mut key = 0xcbf2_9ce4_8422_2325u64;
    let mut add = |bytes: &[u8]| {
        for chunk in bytes.chunks(4) {
            let mut word = [0u8; 4];
            word[..chunk.len()].copy_from_slice(chunk);
            key = (key ^ u64::from(u32::from_le_bytes(word))).wrapping_mul(0x0100_0000_01b3);
        }
    };
    add(bytemuck::cast_slice(&cloud.positions));
    for [u, v] in &cloud.tangents {
        add(bytemuck::bytes_of(u));
        add(bytemuck::bytes_of(v));
    }
    add(bytemuck::cast_slice(&cloud.scales));
    add(bytemuck::cast_slice(&cloud.opacities));
    key
}

fn read_header(path: &Path, reader: &mut impl Read, length: u64) -> Result<BakeHeader> {
    let mut head = [0u8; HEADER_BYTES as usize];
    if length < HEADER_BYTES {
        return Err(Error::invalid(path, "the bake is truncated"));
    }
    reader.read_exact(&mut head).map_err(Error::io(path))?;
    if &head[..16] != MAGIC {
        return Err(Error::invalid(
            path,
            "not a bake of this version; make one with `transplat bake`",
        ));
    }
    let value = |i: usize| {
        let mut bytes = [0u8; 8];
        bytes.copy_from_slice(&head[16 + 8 * i..][..8]);
        u64::from_le_bytes(bytes)
    };
    let header = BakeHeader {
        geometry_key: value(0),
        surfels: value(1),
        directions: value(2),
    };
    let expected = header
        .surfels
        .checked_mul(header.directions)
        .and_then(|n| n.checked_add(HEADER_BYTES));
    if expected != Some(length) || !DIRECTIONS.contains(&(header.directions as usize)) {
        return Err(Error::invalid(
            path,
            format!(
                "a bake of {} surfels and {} directions does not have {length} bytes: it is truncated or broken",
                header.surfels, header.directions
            ),
        ));
    }
    Ok(header)
}

/// Reads only the head of a bake.
///
/// # Errors
/// The file cannot be read or is no whole bake.
pub fn inspect_bake(path: &Path) -> Result<BakeHeader> {
    let mut file = super::open(path)?;
    let length = file.metadata().map_err(Error::io(path))?.len();
    read_header(path, &mut file, length)
}

/// Reads a bake for an asset, which must have the geometry that it was made from.
///
/// # Errors
/// The file cannot be read, is no whole bake, or belongs to another asset.
pub fn load_bake(path: &Path, cloud: &SurfelCloud) -> Result<Visibility> {
    let mut file = super::open(path)?;
    let length = file.metadata().map_err(Error::io(path))?.len();
    let header = read_header(path, &mut file, length)?;
    if header.surfels != cloud.len() as u64 || header.geometry_key != geometry_key(cloud) {
        return Err(Error::invalid(
            path,
            format!(
                "this bake ({} surfels) was made from another geometry than the asset's ({} surfels)",
                header.surfels,
                cloud.len()
            ),
        ));
    }
    let mut open = Vec::with_capacity((length - HEADER_BYTES) as usize);
    file.read_to_end(&mut open).map_err(Error::io(path))?;
    if open.len() as u64 != length - HEADER_BYTES {
        return Err(Error::invalid(path, "changed while it was read"));
    }
    Ok(Visibility::from_open(
        cloud,
        header.directions as usize,
        open,
    ))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::export::save_bake;
    use crate::scenes;
    use crate::visibility::{BakeSettings, bake, no_progress};

    #[test]
    fn a_bake_comes_back_and_knows_its_asset() {
        let cloud = scenes::sphere(50);
        let baked = bake(&cloud, &BakeSettings { directions: 32 }, &no_progress).expect("a bake");
        let folder = tempfile::tempdir().expect("a folder");
        let path = folder.path().join("sphere.bake");
        save_bake(&path, &cloud, &baked).expect("room for it");
        let back = load_bake(&path, &cloud).expect("the same asset");
        assert_eq!((back.open, back.normals), (baked.open, baked.normals));
        let mut other = cloud.clone();
        other.opacities[7] = 0.5;
        assert!(load_bake(&path, &other).is_err());
        let bytes = std::fs::read(&path).expect("it is there");
        for length in [0, 10, 39, 40, bytes.len() - 1] {
            std::fs::write(&path, &bytes[..length]).expect("room for it");
            assert!(load_bake(&path, &cloud).is_err(), "{length} bytes");
        }
    }
}
