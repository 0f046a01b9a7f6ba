//! Binning of surfels into tiles of the image.

use std::ops::Range;
use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use super::blend::TILE;
use super::project::{ProjectedSurfel, grain, project_surfel};
use crate::camera::Camera;
use crate::surfels::SurfelCloud;

/// Pieces that a cloud is projected in: as many for each thread, so that none waits long for the last.
const PIECES_PER_THREAD: usize = 8;

/// At most so many in all: each counts for all tiles.
const MOST_PIECES: usize = 64;

/// An object as a camera sees it.
#[derive(Clone, Copy, Debug)]
pub struct PlacedSplat<'a> {
    /// Its surfels.
    pub cloud: &'a SurfelCloud,
    /// The view in its coordinates and unit, [`Camera::seen_from`].
    pub camera: Camera,
    /// Length of its unit in the scene's.
    pub scale: f32,
    /// Its surfels that are not drawn, `[n]` or empty.
    pub hidden: &'a [bool],
    /// True where it is drawn.
    pub shown: bool,
    /// One of so many of its surfels is drawn, as much larger, where a picture has few pixels; 1 draws all.
    pub one_of: usize,
}

impl<'a> PlacedSplat<'a> {
    /// The only object, in the scene's own coordinates.
    pub fn alone(cloud: &'a SurfelCloud, camera: &Camera, hidden: &'a [bool]) -> Self {
        Self {
            cloud,
            camera: *camera,
            scale: 1.0,
            hidden,
            shown: true,
            one_of: 1,
        }
    }

    /// Surfel `i` on the screen, with what is counted before it, in the scene's unit.
    fn project(&self, i: usize, before: usize) -> Option<ProjectedSurfel> {
        if !self.shown || self.hidden.get(i).is_some_and(|hidden| *hidden) {
            return None;
        }
        let larger = (self.one_of as f32).sqrt();
        let projected = project_surfel(self.cloud, &self.camera, i, larger)?;
        Some(projected.counted(before).scaled(self.scale))
    }
}

/// Surfels that are projected and listed at once: those that follow each other in one object.
struct SurfelRange<'a, 'b> {
    object: &'b PlacedSplat<'a>,
    surfels: Range<usize>,
    /// Surfels of the objects before.
    before: usize,
    /// Where its projected ones start.
    start: usize,
}

impl SurfelRange<'_, '_> {
    /// Its surfels that are drawn: neighbours in space follow each other, so that these are everywhere.
    fn drawn(&self) -> impl Iterator<Item = usize> {
        let one_of = self.object.one_of.max(1);
        let first = self.surfels.start.next_multiple_of(one_of);
        (first..self.surfels.end).step_by(one_of)
    }
}

fn pieces<'a, 'b>(objects: &'b [PlacedSplat<'a>]) -> Vec<SurfelRange<'a, 'b>> {
    let all: usize = objects.iter().map(|o| o.cloud.len()).sum();
    let count = (PIECES_PER_THREAD * rayon::current_num_threads()).min(MOST_PIECES);
    let length = all.div_ceil(count).max(1);
    let mut before = 0;
    let mut pieces = Vec::new();
    for object in objects {
        let n = object.cloud.len();
        pieces.extend((0..n).step_by(length).map(|first| SurfelRange {
            object,
            surfels: first..(first + length).min(n),
            before,
            start: before + first,
        }));
        before += n;
    }
    pieces
}

/// For each tile the projected surfels that touch it, in no order.
#[derive(Debug, Default)]
pub(super) struct Tiles {
    /// Visible surfels of each piece, at the piece's place; what is between is left from before.
    pub projected: Vec<ProjectedSurfel>,
    /// Number of visible surfels.
    pub seen: usize,
    pub columns: usize,
    pub rows: usize,
    /// Pixels that places are told by.
    pub grain: usize,
    starts: Vec<usize>,
    /// Sort key, its place in `projected` included.
    entries: Vec<AtomicU64>,
}

impl Tiles {
    /// Lists what a camera sees of objects, in the memory that is there.
    pub fn list(&mut self, objects: &[PlacedSplat<'_>], size: [usize; 2]) {
        let [columns, rows] = size.map(|edge| edge.div_ceil(TILE));
        (self.columns, self.rows) = (columns, rows);
        self.grain = grain(size);
        let per_tile = TILE / self.grain;
        let pieces = pieces(objects);
        let all = objects.iter().map(|o| o.cloud.len()).sum();
        self.projected.resize(all, ProjectedSurfel::default());
        let mut room = &mut self.projected[..];
        let rooms: Vec<&mut [ProjectedSurfel]> = pieces
            .iter()
            .map(|piece| {
                room.split_off_mut(..piece.surfels.len())
                    .unwrap_or_default()
            })
            .collect();
        // How many are seen of each piece, and how many of them touch each tile.
        let mut counted: Vec<(usize, Vec<u32>)> = pieces
            .par_iter()
            .zip(rooms)
            .map(|(piece, room)| {
                let mut touching = vec![0; columns * rows];
                let mut seen = 0;
                for i in piece.drawn() {
                    if let Some(projected) = piece.object.project(i, piece.before) {
                        touched(&projected, columns, per_tile).for_each(|tile| touching[tile] += 1);
                        room[seen] = projected;
                        seen += 1;
                    }
                }
                (seen, touching)
            })
            .collect();
        self.seen = counted.iter().map(|(seen, _)| seen).sum();
        self.starts.clear();
        let mut next = 0;
        for tile in 0..columns * rows {
            self.starts.push(next);
            let mut before = 0;
            for (_, touching) in &mut counted {
                before += std::mem::replace(&mut touching[tile], before);
            }
            next += before as usize;
        }
        self.starts.push(next);
        self.entries.resize_with(next, AtomicU64::default);
        let (projected, entries, starts) = (&self.projected, &self.entries, &self.starts);
        pieces
            .par_iter()
            .zip(counted)
            .for_each(|(piece, (seen, mut before))| {
                for at in piece.start..piece.start + seen {
                    let order = projected[at].order(at);
                    for tile in touched(&projected[at], columns, per_tile) {
                        let entry = starts[tile] + before[tile] as usize;
                        entries[entry].store(order, Ordering::Relaxed);
                        before[tile] += 1;
                    }
                }
            });
    }

    /// Surfels that touch a tile, as keys that hold their place in `projected` in the lower half.
    pub fn of(&self, tile: usize) -> impl ExactSizeIterator<Item = u64> {
        let entries = &self.entries[self.starts[tile]..self.starts[tile + 1]];
        entries.iter().map(|entry| entry.load(Ordering::Relaxed))
    }
}

/// The tiles that a surfel touches, each of so many grains.
fn touched(s: &ProjectedSurfel, columns: usize, per_tile: usize) -> impl Iterator<Item = usize> {
    let [x0, y0, x1, y1] = s.touches.map(|edge| usize::from(edge) / per_tile);
    (y0..=y1).flat_map(move |row| (x0..=x1).map(move |column| row * columns + column))
}
