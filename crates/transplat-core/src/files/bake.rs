//! Saved bakes, tied to the geometry that they were baked from.
//!
//! After the head: of the harmonic method the openness `[n][N]`; of the directional method the fronts `[n]`, the row of each surfel `[n]`, the surfel that
//! each row was traced from `[rows]`, the open bits `[rows][WORDS]`, where the hits of each row begin `[rows + 1]`, and the hits. All little-endian.

use std::io::{Read, Write};
use std::path::Path;
use std::sync::Arc;

use bytemuck::Pod;

use super::write::write_atomically;
use crate::bake::directional::DirectionalBake;
use crate::bake::harmonic::{DIRECTIONS, HarmonicBake};
use crate::bake::outward_side::{OutwardSide, OutwardSides};
use crate::bake::strata;
use crate::bake::strata::{Hit, MOST_SURFELS, STRATA, SurfelHits, WORDS};
use crate::bake::trace::Tracer;
use crate::bake::visibility_clusters::VisibilityClusters;
use crate::bake::{Bake, check_method};
use crate::error::{Error, Result};
use crate::settings::Method;
use crate::surfels::SurfelCloud;

/// First bytes of bake files of all versions.
pub(crate) const ANY_MAGIC: &[u8] = b"transplat-bake ";

/// First bytes of a bake file.
const MAGIC: &[u8; 16] = b"transplat-bake 4";

/// Magic, geometry key, surfels, kind, directions and rows.
const HEADER_BYTES: u64 = 16 + 5 * 8;

/// Head of a bake file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BakeHeader {
    /// FNV-1a of the geometry.
    pub geometry_key: u64,
    /// Number of surfels.
    pub surfels: u64,
    /// The method that it is for.
    pub method: Method,
    /// Directions that were asked.
    pub directions: u64,
    /// Number of different visibility rows; of the harmonic method, one a surfel.
    pub rows: u64,
}

impl BakeHeader {
    /// Checks that the bake is for a method.
    ///
    /// # Errors
    /// It is for the other one.
    pub fn of_method(&self, method: Method) -> Result<()> {
        check_method(self.method, method)
    }
}

/// The number that stands for a method.
fn kind_of(method: Method) -> u64 {
    match method {
        Method::Harmonic => 0,
        Method::Directional => 1,
    }
}

/// A key of everything that a bake is told apart by: positions, frames, scales, opacities, and what is known to be outside (FNV-1a, 64 bits).
/// Colours are not among them: a relit splat keeps its bake.
pub fn geometry_key(cloud: &SurfelCloud) -> u64 {
    let mut key = Fnv::default();
    key.add(bytemuck::cast_slice(&cloud.positions));
    for [u, v] in &cloud.tangents {
        key.add(bytemuck::bytes_of(u));
        key.add(bytemuck::bytes_of(v));
    }
    key.add(bytemuck::cast_slice(&cloud.scales));
    // So that bakes of surfels keep the key they had.
    if !cloud.thicknesses.iter().all(|t| t.is_flat()) {
        key.add(bytemuck::cast_slice(&cloud.thicknesses));
    }
    key.add(bytemuck::cast_slice(&cloud.opacities));
    key.add(bytemuck::cast_slice(&cloud.outside_from));
    key.0
}

/// FNV-1a, 64 bits, over words of 32.
pub(super) struct Fnv(pub u64);

impl Default for Fnv {
    fn default() -> Self {
        Self(0xcbf2_9ce4_8422_2325)
    }
}

impl Fnv {
    pub fn add(&mut self, bytes: &[u8]) {
        for chunk in bytes.chunks(4) {
            let mut word = [0u8; 4];
            word[..chunk.len()].copy_from_slice(chunk);
            self.0 = (self.0 ^ u64::from(u32::from_le_bytes(word))).wrapping_mul(0x0100_0000_01b3);
        }
    }
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
    let words: [u64; 5] = bytemuck::pod_read_unaligned(&head[16..]);
    let [geometry_key, surfels, kind, directions, rows] = words.map(u64::from_le);
    let method = Method::ALL.into_iter().find(|p| kind_of(*p) == kind);
    let Some(method) = method else {
        return Err(Error::invalid(path, "a bake of a kind that is not known"));
    };
    // Bytes a surfel; and a row, at least and at most, and beside them: of the directional method, the hits come on top.
    let (known, each, [least, most], beside) = match method {
        Method::Harmonic => {
            let known = DIRECTIONS.contains(&(directions as usize)) && rows == surfels;
            (known, 0, [directions; 2], HEADER_BYTES)
        }
        Method::Directional => {
            let known = directions == strata::DIRECTIONS as u64
                && surfels <= MOST_SURFELS as u64
                && rows <= surfels;
            let least = (size_of::<[u64; WORDS]>() + 2 * 4) as u64;
            let each = (size_of::<OutwardSide>() + 4) as u64;
            let most = least + 4 * STRATA as u64;
            (known, each, [least, most], HEADER_BYTES + 4)
        }
    };
    let bytes = |a_row: u64| {
        let of_rows = rows.checked_mul(a_row)?.checked_add(beside)?;
        surfels.checked_mul(each)?.checked_add(of_rows)
    };
    let fits = bytes(least).zip(bytes(most));
    if !known || !fits.is_some_and(|(a, b)| (a..=b).contains(&length)) {
        return Err(Error::invalid(
            path,
            format!(
                "a bake for preset {} of {surfels} Gaussians and {directions} directions cannot have {length} bytes: it is truncated or broken",
                method.preset()
            ),
        ));
    }
    Ok(BakeHeader {
        geometry_key,
        surfels,
        method,
        directions,
        rows,
    })
}

/// Writes a bake.
///
/// # Errors
/// The file cannot be written; nothing is left of it then.
pub fn save_bake(path: &Path, cloud: &SurfelCloud, baked: &Bake) -> Result<()> {
    if let Bake::Scene(_) = baked {
        let why = "a bake is kept of each object, not of a scene";
        return Err(Error::invalid(path, why));
    }
    write_atomically(path, |out| {
        out.write_all(MAGIC)?;
        let rows = match baked {
            Bake::Directional(directional) => directional.directional_visibility.open.len(),
            _ => cloud.len(),
        };
        for value in [
            geometry_key(cloud),
            cloud.len() as u64,
            kind_of(baked.method()),
            baked.directions() as u64,
            rows as u64,
        ] {
            out.write_all(&value.to_le_bytes())?;
        }
        match baked {
            Bake::Harmonic(visibility) => out.write_all(&visibility.open),
            Bake::Directional(directional) => {
                let directional_visibility = &directional.directional_visibility;
                out.write_all(bytemuck::cast_slice(&directional.tracer.outward_sides.of))?;
                out.write_all(bytemuck::cast_slice(
                    &directional_visibility.visibility_clusters.row_of,
                ))?;
                out.write_all(bytemuck::cast_slice(
                    &directional_visibility.visibility_clusters.leaders,
                ))?;
                out.write_all(bytemuck::cast_slice(&directional_visibility.open))?;
                out.write_all(bytemuck::cast_slice(&directional_visibility.starts))?;
                out.write_all(bytemuck::cast_slice(&directional_visibility.hits))
            }
            Bake::Scene(_) => Ok(()),
        }
    })
}

/// Reads only the head of a bake.
///
/// # Errors
/// The file cannot be read or is no whole bake.
pub fn inspect_bake(path: &Path) -> Result<BakeHeader> {
    let mut file = super::read::open(path)?;
    let length = file.len();
    read_header(path, &mut file, length)
}

/// Reads a bake for an asset, which must have the geometry that it was made from.
///
/// # Errors
/// The file cannot be read, is no whole bake, or belongs to another asset.
pub fn load_bake(path: &Path, cloud: &SurfelCloud) -> Result<Bake> {
    let mut file = super::read::open(path)?;
    let length = file.len();
    let header = read_header(path, &mut file, length)?;
    if header.surfels != cloud.len() as u64 || header.geometry_key != geometry_key(cloud) {
        return Err(Error::invalid(
            path,
            format!(
                "this bake ({} Gaussians) was made from another geometry than the asset's ({} Gaussians), or with another outside",
                header.surfels,
                cloud.len()
            ),
        ));
    }
    let mut bytes = Vec::with_capacity((length - HEADER_BYTES) as usize);
    file.read_to_end(&mut bytes).map_err(Error::io(path))?;
    if bytes.len() as u64 != length - HEADER_BYTES {
        return Err(Error::invalid(path, "changed while it was read"));
    }
    match header.method {
        Method::Harmonic => {
            let directions = header.directions as usize;
            let visibility = HarmonicBake::from_open(cloud, directions, bytes);
            Ok(Bake::Harmonic(visibility.into()))
        }
        Method::Directional => {
            let found = found_in(&bytes, cloud.len(), header.rows as usize);
            let (outward_sides, visibility_clusters, found) =
                found.ok_or_else(|| Error::invalid(path, "the bake is broken"))?;
            let tracer = Arc::new(Tracer::new(cloud, outward_sides));
            let directional =
                DirectionalBake::of(cloud, &tracer, &Arc::new(visibility_clusters), &found);
            Ok(Bake::Directional(Arc::new(directional)))
        }
    }
}

/// The fronts of `n` surfels, which of them share, and what the rays of each row found; none if the numbers do not belong together.
fn found_in(
    bytes: &[u8],
    n: usize,
    rows: usize,
) -> Option<(OutwardSides, VisibilityClusters, Vec<SurfelHits>)> {
    let (outward_sides, rest) = bytes.split_at_checked(size_of::<OutwardSide>() * n)?;
    let outward_sides = OutwardSides {
        of: read_all(outward_sides)?,
    };
    let (row_of, rest) = rest.split_at_checked(4 * n)?;
    let (leaders, rest) = rest.split_at_checked(4 * rows)?;
    let visibility_clusters = VisibilityClusters::of_rows(read_all(row_of)?, read_all(leaders)?)?;
    let (open, rest) = rest.split_at_checked(8 * WORDS * rows)?;
    let (starts, hits) = rest.split_at_checked(4 * (rows + 1))?;
    let (open, starts): (Vec<[u64; WORDS]>, Vec<u32>) = (read_all(open)?, read_all(starts)?);
    let hits: Vec<Hit> = read_all(hits)?;
    let whole =
        starts.first() == Some(&0) && starts.last() == Some(&u32::try_from(hits.len()).ok()?);
    if !whole || hits.iter().any(|h| h.surfel() >= n) {
        return None;
    }
    let found: Option<Vec<SurfelHits>> = (visibility_clusters.leaders.iter().zip(open))
        .zip(starts.windows(2))
        .map(|((surfel, open), range)| {
            let hits = hits.get(range[0] as usize..range[1] as usize)?.to_vec();
            (hits.len() <= STRATA).then_some(SurfelHits {
                open,
                hits,
                ..SurfelHits::of(*surfel)
            })
        })
        .collect();
    Some((outward_sides, visibility_clusters, found?))
}

fn read_all<T: Pod>(bytes: &[u8]) -> Option<Vec<T>> {
    let exact = bytes.len().is_multiple_of(size_of::<T>());
    exact.then(|| bytemuck::pod_collect_to_vec(bytes))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::bake::harmonic::bake;
    use crate::progress::no_progress;
    use crate::synthetic;

    #[test]
    fn a_bake_comes_back_and_knows_its_asset() {
        let cloud = synthetic::sphere_over_plate(500);
        let visibility = bake(&cloud, 32, &no_progress);
        let directional = DirectionalBake::bake(&cloud, &no_progress);
        let shared = DirectionalBake::shared(&cloud, 8);
        assert!(shared.directional_visibility.open.len() < cloud.len());
        let bakes = [
            Bake::Directional(Arc::new(shared)),
            Bake::Harmonic(visibility.expect("a bake").into()),
            Bake::Directional(Arc::new(directional.expect("a bake"))),
        ];
        for baked in bakes {
            let folder = tempfile::tempdir().expect("a folder");
            let path = folder.path().join("sphere.bake");
            save_bake(&path, &cloud, &baked).expect("room for it");
            let back = load_bake(&path, &cloud).expect("the same asset");
            assert_eq!(back.normals(), baked.normals());
            match (&baked, &back) {
                (Bake::Harmonic(a), Bake::Harmonic(b)) => assert_eq!(a.open, b.open),
                (Bake::Directional(a), Bake::Directional(b)) => {
                    assert_eq!(
                        (
                            &a.directional_visibility.visibility_clusters,
                            &a.directional_visibility.open,
                            &a.directional_visibility.starts
                        ),
                        (
                            &b.directional_visibility.visibility_clusters,
                            &b.directional_visibility.open,
                            &b.directional_visibility.starts
                        )
                    );
                    assert_eq!(
                        (&a.directional_visibility.hits, &a.two_sided),
                        (&b.directional_visibility.hits, &b.two_sided)
                    );
                    assert_eq!(a.tracer.outward_sides, b.tracer.outward_sides);
                    assert_eq!(a.visible_weight, b.visible_weight);
                }
                _ => panic!("of another kind"),
            }
            let mut other = cloud.clone();
            other.opacities[7] = 0.5;
            assert!(load_bake(&path, &other).is_err());
            let mut turned = cloud.clone();
            turned.outside_from = vec![glam::Vec3::Z];
            assert!(load_bake(&path, &turned).is_err(), "another outside");
            let bytes = std::fs::read(&path).expect("it is there");
            for length in [0, 10, 39, 47, 48, 60, bytes.len() - 1] {
                std::fs::write(&path, &bytes[..length]).expect("room for it");
                assert!(load_bake(&path, &cloud).is_err(), "{length} bytes");
            }
            // Any byte may be wrong: an error or a bake, never a panic.
            for place in (16..bytes.len()).step_by(bytes.len() / 97) {
                let mut broken = bytes.clone();
                broken[place] ^= 0xff;
                std::fs::write(&path, &broken).expect("room for it");
                let _ = load_bake(&path, &cloud);
            }
        }
    }
}
