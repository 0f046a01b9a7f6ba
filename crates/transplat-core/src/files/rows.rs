//! Builder of surfels from the rows that trainers store.

use glam::{DVec3, Mat3, Quat, Vec2, Vec3};
use rayon::prelude::*;

use crate::color::Encoding;
use crate::memory::ensure_room;
use crate::morton::neighborhood_order;
use crate::sh::coefficient_count;
use crate::surfels::{Bounds, SurfelCloud, Thickness, UpAxis};

/// Kind of splat in a file.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SplatKind {
    /// 2D Gaussian surfels: two scales.
    Surfels2d,
    /// 3D Gaussians: three scales.
    Gaussians3d,
}

/// Report of loading.
#[derive(Clone, Debug)]
pub struct SplatReport {
    /// Name of the file's format and version.
    pub format: String,
    /// 2DGS or 3DGS.
    pub kind: SplatKind,
    /// Vertices in the file.
    pub vertices: usize,
    /// Names of all properties of a PLY, in the file's order.
    pub properties: Vec<String>,
    /// Comment lines of its header.
    pub comments: Vec<String>,
    /// Rows that hold something that is not a number or out of any range; they are kept in place and never drawn.
    pub skipped_work: Vec<usize>,
    /// 3DGS: median of shortest over second axis. 0 is flat; relighting needs well under 0.3.
    pub median_flatness: Option<f32>,
    /// Up axis, where the file has one.
    pub up: Option<UpAxis>,
    /// Assumptions of reading it, for the user.
    pub warnings: Vec<String>,
}

/// A file with a larger share of broken rows is refused: what is left shows nothing of the object.
const MAX_LEFT_OUT_SHARE: f64 = 0.9;

/// Rows that tell where a splat lies.
const SAMPLE: usize = 1024;

/// An origin is taken off positions that are farther away than this, and that 32 bits of float round by more than this share of the splats'
/// sizes.
const FAR: f64 = 1000.0;
const COARSE: f64 = 1.0 / 64.0;

/// Gaussians whose median size is more than this share of the object's radius are none that a trainer made.
const AS_LARGE_AS_IT: f32 = 0.25;

/// Positions beyond this overflow when squared; colour beyond [`MAX_SH`] is no colour.
const MAX_POSITION: f64 = 1e15;
const MAX_SH: f32 = 1e6;

/// So many Gaussians no file packs into fewer bytes than there are of them, unless they are few.
const MIN_PACKED: u64 = 1 << 20;

/// Checks the number of Gaussians that a packed file of so many bytes claims, before anything is allocated by it.
pub(super) fn check_count(count: u64, file_bytes: u64) -> Result<(), String> {
    if count == 0 {
        return Err("holds no splats".into());
    }
    if count > file_bytes.max(MIN_PACKED) {
        return Err(format!(
            "claims {count} splats in {file_bytes} bytes: it is truncated, or its count is wrong"
        ));
    }
    Ok(())
}

/// One Gaussian as trainers store it.
#[derive(Clone)]
pub(super) struct StoredRow {
    /// In the file's own coordinates.
    pub position: [f64; 3],
    /// Quaternion w, x, y, z of any length.
    pub rotation: [f32; 4],
    /// Natural logarithms; a surfel has no third.
    pub log_scales: [f32; 3],
    /// Opacity is its logistic function.
    pub logit: f32,
}

/// Row as a surfel.
struct Row {
    position: Vec3,
    tangents: [Vec3; 2],
    scale: Vec2,
    thickness: Thickness,
    opacity: f32,
}

impl StoredRow {
    /// Applies the 3D smoothing filter of that standard deviation that a Gaussian was trained under, which makes it wider and as much fainter
    /// (Yu et al., "Mip-Splatting", CVPR 2024, eq. 9).
    pub(super) fn widen(&mut self, filter: f32) {
        let mut share = 1f64;
        for log in &mut self.log_scales {
            let scale = f64::from(*log).exp();
            let wide = scale.hypot(f64::from(filter));
            share *= scale / wide;
            *log = wide.ln() as f32;
        }
        let opacity = share / (1.0 + (-f64::from(self.logit)).exp());
        self.logit = (opacity / (1.0 - opacity)).ln() as f32;
    }

    /// None where it holds what is no number or out of any range.
    fn surfel(
        &self,
        kind: SplatKind,
        is_antialiased: bool,
        origin: DVec3,
        sh: &[[f32; 3]],
    ) -> Option<Row> {
        let axes = if kind == SplatKind::Surfels2d { 2 } else { 3 };
        let logs = &self.log_scales[..axes];
        let [w, x, y, z] = self.rotation;
        let length = (w * w + x * x + y * y + z * z).sqrt();
        let in_range = |v: &f32, limit: f32| v.abs() <= limit;
        let valid = self.position.iter().all(|v| v.abs() <= MAX_POSITION)
            && length > 1e-12
            && length.is_finite()
            // Flattened to nothing (log 0) or opaque (logit infinity) is fine.
            && !self.logit.is_nan()
            && logs.iter().all(|v| *v < 80.0)
            && sh.iter().flatten().fold(true, |ok, v| ok & in_range(v, MAX_SH));
        if !valid {
            return None;
        }
        let axes = Mat3::from_quat(Quat::from_xyzw(x, y, z, w).normalize());
        let axes = [axes.x_axis, axes.y_axis, axes.z_axis];
        let scales: [f32; 3] =
            std::array::from_fn(|i| logs.get(i).map_or(0.0, |log| log.max(-60.0).exp()));
        // The third axis is kept as the normal where it is the shortest, so that a flat 3D Gaussian has the frame of a surfel.
        let shortest = if logs.len() < 3 || (scales[2] <= scales[0] && scales[2] <= scales[1]) {
            2
        } else if scales[0] <= scales[1] {
            0
        } else {
            1
        };
        let (u, v) = ((shortest + 1) % 3, (shortest + 2) % 3);
        Some(Row {
            position: (DVec3::from_array(self.position) - origin).as_vec3(),
            tangents: [axes[u], axes[v]],
            scale: Vec2::new(scales[u], scales[v]),
            thickness: match kind {
                SplatKind::Surfels2d => Thickness::FLAT,
                SplatKind::Gaussians3d => Thickness::of_gaussian(scales[shortest], is_antialiased),
            },
            opacity: 1.0 / (1.0 + (-self.logit).exp()),
        })
    }
}

/// In the place of a row that is left out.
const NOTHING: Row = Row {
    position: Vec3::ZERO,
    tangents: [Vec3::X, Vec3::Y],
    scale: Vec2::splat(1e-12),
    thickness: Thickness::FLAT,
    opacity: 0.0,
};

/// Fills a cloud block by block. All of it is allocated at once, zeroed by the system, so that its pages are first touched in parallel.
pub(super) struct Builder {
    kind: SplatKind,
    cloud: SurfelCloud,
    filled: usize,
    is_antialiased: bool,
    skipped_work: Vec<usize>,
    /// Quantum of positions; none where 32-bit floats determine it.
    position_step: Option<f64>,
    tally: Tally,
}

/// Counts of stored numbers, which tell their encoding.
#[derive(Clone, Copy)]
struct Tally {
    third_scale_is_zero: bool,
    least_log: f32,
    least_logit: f32,
    most_logit: f32,
}

impl Tally {
    const NONE: Self = Self {
        third_scale_is_zero: true,
        least_log: f32::INFINITY,
        least_logit: f32::INFINITY,
        most_logit: f32::NEG_INFINITY,
    };

    /// Counts a row; NaN counts for nothing.
    fn add(&mut self, row: &StoredRow, axes: usize) {
        let third = row.log_scales[2];
        self.third_scale_is_zero &= axes < 3 || third == 0.0 || third.is_nan();
        for log in &row.log_scales[..axes] {
            self.least_log = self.least_log.min(*log);
        }
        self.least_logit = self.least_logit.min(row.logit);
        self.most_logit = self.most_logit.max(row.logit);
    }

    fn with(self, other: &Self) -> Self {
        Self {
            third_scale_is_zero: self.third_scale_is_zero && other.third_scale_is_zero,
            least_log: self.least_log.min(other.least_log),
            least_logit: self.least_logit.min(other.least_logit),
            most_logit: self.most_logit.max(other.most_logit),
        }
    }
}

/// Encoding of the rows, by all of them.
pub(super) struct RowEncoding {
    pub third_scale_is_zero: bool,
    /// Scales are lengths, not logarithms.
    pub are_lengths: bool,
    /// Opacities are shares, not logits.
    pub are_shares: bool,
}

/// Bytes of a surfel while loading, beside its colour: its geometry, twice while it is rearranged, and where its row went.
const GEOMETRY_BYTES: usize = 150;

/// In the place of a surfel: the row is of none that is written.
pub(super) const NOT_WRITTEN: u32 = u32::MAX;

/// Surfels, so that neighbours follow each other; what was noticed; and which of them each row of the file is.
pub(super) type Finished = (SurfelCloud, SplatReport, Vec<u32>);

impl Builder {
    /// # Errors
    /// The memory does not hold them.
    pub(super) fn new(kind: SplatKind, sh_degree: usize, rows: usize) -> Result<Self, String> {
        let k = coefficient_count(sh_degree);
        ensure_room(rows, GEOMETRY_BYTES + size_of::<[f32; 3]>() * k)?;
        let cloud = SurfelCloud {
            positions: bytemuck::zeroed_vec(rows),
            tangents: bytemuck::zeroed_vec(rows),
            scales: bytemuck::zeroed_vec(rows),
            thicknesses: bytemuck::zeroed_vec(rows),
            opacities: bytemuck::zeroed_vec(rows),
            sh: bytemuck::zeroed_vec(rows * coefficient_count(sh_degree)).into(),
            sh_degree,
            encoding: Encoding::Stored,
            up: UpAxis::PlusZ,
            outside_from: Vec::new(),
            origin: DVec3::ZERO,
        };
        Ok(Self {
            kind,
            cloud,
            filled: 0,
            is_antialiased: false,
            skipped_work: Vec::new(),
            position_step: None,
            tally: Tally::NONE,
        })
    }

    /// Its 3D Gaussians were trained with their opacity compensated for the low-pass.
    pub(super) fn set_antialiased(&mut self) {
        self.is_antialiased = true;
    }

    /// Sets the quantum of positions in the file; the default is that of 32-bit floats.
    pub(super) fn set_position_step(&mut self, step: f64) {
        self.position_step = Some(step);
    }

    /// Encoding of the rows, by all of them.
    pub(super) fn found(&self) -> RowEncoding {
        let tally = &self.tally;
        // As logarithms they would be as large as the object, and as lengths they are not.
        let is_large = || {
            let radius = AS_LARGE_AS_IT * Bounds::of(&self.cloud.positions).radius;
            let size = self.cloud.median_size();
            size.is_some_and(|size| size > radius && size.ln() < radius)
        };
        let is_activated = tally.least_log > 0.0 && is_large();
        let has_shares = tally.least_logit >= 0.0 && tally.most_logit <= 1.0;
        RowEncoding {
            third_scale_is_zero: tally.third_scale_is_zero && tally.least_log < 0.0,
            are_lengths: is_activated,
            are_shares: is_activated && has_shares,
        }
    }

    /// Converts a block of rows in parallel; `decode` gives a row of it and writes its colour `[K]`, with a memory of its own to work in.
    pub(super) fn push_rows(
        &mut self,
        rows: usize,
        decode: impl Fn(usize, &mut Vec<f32>, &mut [[f32; 3]]) -> StoredRow + Sync,
    ) {
        const PIECE: usize = 512;
        let (kind, k) = (self.kind, coefficient_count(self.cloud.sh_degree));
        let axes = if kind == SplatKind::Surfels2d { 2 } else { 3 };
        let is_antialiased = self.is_antialiased;
        if self.filled == 0 {
            self.cloud.origin = self.origin_of(rows, &decode);
        }
        let block = self.filled..self.filled + rows;
        let cloud = &mut self.cloud;
        let origin = cloud.origin;
        let pieces: Vec<(Vec<usize>, Tally)> = cloud.positions[block.clone()]
            .par_chunks_mut(PIECE)
            .zip(cloud.tangents[block.clone()].par_chunks_mut(PIECE))
            .zip(cloud.scales[block.clone()].par_chunks_mut(PIECE))
            .zip(cloud.opacities[block.clone()].par_chunks_mut(PIECE))
            .zip(cloud.sh[block.start * k..block.end * k].par_chunks_mut(PIECE * k))
            .zip(cloud.thicknesses[block.clone()].par_chunks_mut(PIECE))
            .enumerate()
            .map(
                |(piece, (((((positions, tangents), scales), opacities), sh), thicknesses))| {
                    let (mut skipped_work, mut memory) = (Vec::new(), Vec::new());
                    let mut tally = Tally::NONE;
                    for i in 0..positions.len() {
                        let row = piece * PIECE + i;
                        let sh = &mut sh[i * k..][..k];
                        let stored = decode(row, &mut memory, sh);
                        tally.add(&stored, axes);
                        let converted = stored.surfel(kind, is_antialiased, origin, sh);
                        let converted = converted.unwrap_or_else(|| {
                            sh.fill([0.0; 3]);
                            skipped_work.push(block.start + row);
                            NOTHING
                        });
                        positions[i] = converted.position;
                        tangents[i] = converted.tangents;
                        scales[i] = converted.scale;
                        opacities[i] = converted.opacity;
                        thicknesses[i] = converted.thickness;
                    }
                    (skipped_work, tally)
                },
            )
            .collect();
        for (skipped_work, tally) in pieces {
            self.skipped_work.extend(skipped_work);
            self.tally = self.tally.with(&tally);
        }
        self.filled += rows;
    }

    /// The point that positions are taken relative to: none, but far from it the middle of some of the rows, where 32 bits of float would
    /// round them by more than the splats bear.
    fn origin_of(
        &self,
        rows: usize,
        decode: &impl Fn(usize, &mut Vec<f32>, &mut [[f32; 3]]) -> StoredRow,
    ) -> DVec3 {
        let mut memory = Vec::new();
        let mut sh = vec![[0f32; 3]; coefficient_count(self.cloud.sh_degree)];
        let step = rows.div_ceil(SAMPLE).max(1);
        let sample = (0..rows)
            .step_by(step)
            .map(|row| decode(row, &mut memory, &mut sh));
        let sample: Vec<StoredRow> = sample
            .filter(|r| r.position.iter().all(|v| v.abs() <= MAX_POSITION))
            .collect();
        let middle = |mut values: Vec<f64>| {
            let at = values.len() / 2;
            (!values.is_empty()).then(|| *values.select_nth_unstable_by(at, f64::total_cmp).1)
        };
        let axis = |a: usize| middle(sample.iter().map(|r| r.position[a]).collect());
        let [Some(x), Some(y), Some(z)] = [0, 1, 2].map(axis) else {
            return DVec3::ZERO;
        };
        let place = DVec3::new(x, y, z);
        let size = |r: &StoredRow| f64::from(r.log_scales[0].max(r.log_scales[1])).exp();
        let size = middle(sample.iter().map(size).collect()).unwrap_or(0.0);
        origin_near(place, size)
    }

    /// The splat, of a format that is called like that, which says which way is up or does not.
    pub(super) fn finish(self, format: String, up: Option<UpAxis>) -> Result<Finished, String> {
        let (kind, mut cloud, skipped_work) = (self.kind, self.cloud, self.skipped_work);
        if skipped_work.len() as f64 > MAX_LEFT_OUT_SHARE * cloud.len() as f64 {
            return Err(format!(
                "{} of {} vertices hold values that are no numbers or out of any range (the first is vertex {}): not a usable splat",
                skipped_work.len(),
                cloud.len(),
                skipped_work[0]
            ));
        }
        let median_flatness = median_flatness(&cloud);
        let warnings = coarse_warning(&cloud, self.position_step)
            .into_iter()
            .collect();
        let report = SplatReport {
            kind,
            vertices: cloud.len(),
            format,
            properties: Vec::new(),
            comments: Vec::new(),
            skipped_work,
            median_flatness,
            up,
            warnings,
        };
        let surfel_of_row = rearranged(&mut cloud);
        Ok((cloud, report, surfel_of_row))
    }
}

/// The origin of positions around a place, of splats of that size: none unless it is so far away that 32 bits of float would not do.
pub(super) fn origin_near(place: DVec3, size: f64) -> DVec3 {
    let far = place.abs().max_element();
    if far > FAR && far.is_finite() && float_step(far) > COARSE * size {
        place.round()
    } else {
        DVec3::ZERO
    }
}

/// Quantum of a coordinate in 32-bit floats.
pub(super) fn float_step(far: f64) -> f64 {
    far * f64::from(f32::EPSILON) / 2.0
}

/// Warning that a file's positions are rounded to more than its splats are large.
fn coarse_warning(cloud: &SurfelCloud, position_step: Option<f64>) -> Option<String> {
    let far = cloud.origin.abs().max_element();
    let step = position_step.unwrap_or_else(|| float_step(far));
    if step <= 0.0 {
        return None;
    }
    let size = f64::from(cloud.median_size()?);
    (step > size).then(|| {
        format!(
            "its positions are stored in steps of {step:.3}, and its splats are {size:.3} large: it is torn. Export it with x, y and z as double, or relative to a point near the object"
        )
    })
}

/// Brings surfels into an order in which neighbours follow each other; where each one went.
pub(super) fn rearranged(cloud: &mut SurfelCloud) -> Vec<u32> {
    let order = neighborhood_order(&cloud.positions);
    cloud.rearrange(&order);
    let mut places = vec![0; order.len()];
    for (place, before) in order.into_iter().enumerate() {
        places[before as usize] = place as u32;
    }
    places
}

/// Median over 3D Gaussians of shortest over second axis; nothing where there are none.
fn median_flatness(cloud: &SurfelCloud) -> Option<f32> {
    let gaussians = cloud.thicknesses.iter().zip(&cloud.scales);
    let gaussians = gaussians.filter(|(thickness, _)| !thickness.is_flat());
    let ratio = |(thickness, scale): (&Thickness, &Vec2)| thickness.sigma() / scale.min_element();
    let mut ratios: Vec<f32> = gaussians.map(ratio).collect();
    let middle = ratios.len() / 2;
    (!ratios.is_empty()).then(|| *ratios.select_nth_unstable_by(middle, f32::total_cmp).1)
}
