//! Layers of an image for a compositor: what was put into a scene alone, what that does to the scene, and where everything is.
//!
//! A photograph times `shadow`, with the objects' layers over it, is the photograph with the objects in it. The layers of the objects are held
//! out by what stands before them: where several meet in a pixel they are added, and their sum is what goes over.

use std::ops::Range;

use anyhow::Result;
use transplat_core::camera::{Camera, Lens};
use transplat_core::files::Channel;
use transplat_core::present::{PLAIN, normal_colors};
use transplat_core::progress::no_progress;
use transplat_core::rasterize::{ColorSpace, Raster, shade};
use transplat_core::transfer::Relit;

use crate::device::Paint;
use crate::names::distinct_names;
use crate::render::{Lit, Studio};

/// Layers that every picture has; objects are not called so.
const OWN: [&str; 5] = ["plate", "shadow", "depth", "normal", "id"];

/// Characters of a layer's name: OpenEXR has 255 bytes for that of a channel, and a number may follow.
const LONGEST_NAME: usize = 200;

/// Depth where nothing is: beyond everything.
const FAR: f32 = 1e10;

/// Radiance below this share of a picture's mean shows no shadow: what changes there is noise.
const DARK: f32 = 1e-3;

/// Source of an image in layers, under one light.
pub struct Layers {
    /// The surfels of each object.
    objects: Vec<Range<usize>>,
    /// Their layers' names, the scene's own left out.
    names: Vec<String>,
    /// All objects. `[n]`
    relit: Relit,
    /// The first one as it is without the others, where it is the scene that they were put into.
    scene_alone: Option<Relit>,
}

impl Layers {
    /// Takes what the objects are called and how many surfels each has, all of them relit, and the first one relit without the others where
    /// that is the scene that those were put into.
    pub fn new(objects: &[(String, usize)], relit: Relit, scene_alone: Option<Relit>) -> Self {
        let ends = objects.iter().scan(0, |end, (_, surfels)| {
            *end += surfels;
            Some(*end)
        });
        let ranges = ends.zip(objects).map(|(end, (_, n))| end - n..end);
        let inserted = &objects[usize::from(scene_alone.is_some())..];
        let called = inserted.iter().map(|(name, _)| layer_name(name));
        let taken = OWN.iter().map(|name| (*name).to_owned());
        let names = distinct_names(taken.chain(called)).split_off(OWN.len());
        Self {
            objects: ranges.collect(),
            names,
            relit,
            scene_alone,
        }
    }

    /// Takes a picture with `factor` times `factor` samples a pixel: linear light, premultiplied.
    ///
    /// # Errors
    /// The device failed.
    pub fn take(
        &self,
        studio: &Studio,
        camera: &Camera,
        factor: usize,
        lit: &Lit,
    ) -> Result<Vec<Channel>> {
        // What a lens blurs is the compositor's, by the depth.
        let camera = &Camera {
            lens: Lens::default(),
            ..*camera
        };
        let beauty = studio.take(camera, factor, lit, &no_progress)?;
        let mut channels = Vec::new();
        add(&mut channels, "", "RGBA", &beauty.pixels);
        let draw = |colors: &[[f32; 3]], hidden: &[bool]| {
            let camera = camera.supersampled(factor);
            let paint = Paint::Colors(colors);
            let drawn = studio.painter.draw(&camera, paint, PLAIN, hidden)?;
            anyhow::Ok(drawn.downsampled(factor))
        };
        let n = studio.cloud.len();
        let only = |which: &[Range<usize>], colors: &[[f32; 3]]| {
            let mut some = vec![[0.0; 3]; n];
            for range in which {
                some[range.clone()].copy_from_slice(&colors[range.clone()]);
            }
            some
        };
        let colors = linear(studio, camera, &self.relit, n);
        let hidden = &studio.hidden;
        let coverage = self.coverage(&draw, studio, &beauty)?;
        let inserted = usize::from(self.scene_alone.is_some());
        for (i, name) in (inserted..).zip(&self.names) {
            let alone = draw(&only(&self.objects[i..=i], &colors), hidden)?;
            let each = alone.pixels.iter().zip(&coverage[i]);
            let pixels: Vec<[f32; 4]> = each.map(|([r, g, b, _], a)| [*r, *g, *b, *a]).collect();
            add(&mut channels, name, "RGBA", &pixels);
        }
        let mut shadow = vec![[1.0f32; 3]; beauty.pixels.len()];
        if let Some(scene) = &self.scene_alone {
            // Under the objects, too: a shadow that is moved or softened has no holes.
            let mut others = hidden.clone();
            others.resize(n, false);
            for range in &self.objects[1..] {
                others[range.clone()].fill(true);
            }
            let plate = draw(&linear(studio, camera, scene, n), &others)?;
            shadow = ratio(&draw(&colors, &others)?, &plate);
            add(&mut channels, "plate", "RGBA", &plate.pixels);
        }
        let shorter = camera.width.min(camera.height);
        let photograph = studio.plate.as_ref().map(|p| p.reduced(shorter));
        if let (Some(photograph), None) = (photograph, &self.scene_alone) {
            let pixel = |i: usize| {
                let (x, y) = (i % camera.width, i / camera.width);
                let color = photograph.at(camera, x, y, ColorSpace::Linear);
                color.map_or([0.0; 4], |[r, g, b]| [r, g, b, 1.0])
            };
            let pixels: Vec<_> = (0..beauty.pixels.len()).map(pixel).collect();
            add(&mut channels, "plate", "RGBA", &pixels);
        }
        let share = &lit.ground[1];
        if let (Some(ground), false) = (&studio.ground, share.is_empty()) {
            for (i, value) in shadow.iter_mut().enumerate() {
                let (x, y) = (i % camera.width, i / camera.width);
                let caught = ground.shadow(share, camera, x, y, ColorSpace::Linear);
                *value = value.map(|v| v * (1.0 - caught));
            }
        }
        add(&mut channels, "shadow", "RGB", &shadow);
        let normals = normal_colors(&studio.cloud, camera.eye, ColorSpace::Linear);
        let normals = draw(&normals, hidden)?;
        let unit = |[x, y, z, _]: &[f32; 4]| {
            let n = glam::Vec3::new(*x, *y, *z);
            n.normalize_or_zero().to_array()
        };
        let units: Vec<[f32; 3]> = normals.pixels.iter().map(unit).collect();
        add(&mut channels, "normal", "XYZ", &units);
        let is_there = |a: f32| a > 0.0;
        let each = normals.depth.iter().zip(&normals.pixels);
        let depth = each.map(|(d, p)| [if is_there(p[3]) { *d } else { FAR }]);
        add(&mut channels, "depth", "Z", &depth.collect::<Vec<_>>());
        let id = |pixel: usize| {
            let each = coverage.iter().map(|c| c[pixel]).enumerate();
            let most = each.max_by(|a, b| a.1.total_cmp(&b.1));
            most.filter(|(_, a)| is_there(*a))
                .map_or(0.0, |(i, _)| (i + 1) as f32)
        };
        let ids: Vec<[f32; 1]> = (0..beauty.pixels.len()).map(|p| [id(p)]).collect();
        add(&mut channels, "id", "X", &ids);
        Ok(channels)
    }

    /// Coverage of each pixel by each object, 0 to 1, the others held out.
    fn coverage(
        &self,
        draw: &impl Fn(&[[f32; 3]], &[bool]) -> Result<Raster>,
        studio: &Studio,
        beauty: &Raster,
    ) -> Result<Vec<Vec<f32>>> {
        let pixels = beauty.pixels.len();
        let mut coverage = vec![vec![0.0; pixels]; self.objects.len()];
        // Three at a time, one a channel.
        for (group, three) in coverage.chunks_mut(3).zip(self.objects.chunks(3)) {
            let mut colors = vec![[0.0; 3]; studio.cloud.len()];
            for (channel, range) in three.iter().enumerate() {
                colors[range.clone()]
                    .iter_mut()
                    .for_each(|c| c[channel] = 1.0);
            }
            let drawn = draw(&colors, &studio.hidden)?;
            for (channel, covered) in group.iter_mut().enumerate() {
                *covered = drawn.pixels.iter().map(|p| p[channel]).collect();
            }
        }
        Ok(coverage)
    }
}

/// An object's name as compositors take a layer's: letters, digits, dashes and underscores, and not longer than formats have room for.
fn layer_name(name: &str) -> String {
    let as_layer = |c: char| {
        if c.is_ascii_alphanumeric() || c == '-' {
            c
        } else {
            '_'
        }
    };
    let name: String = name.chars().take(LONGEST_NAME).map(as_layer).collect();
    if name.chars().all(|c| c == '_') {
        return "object".into();
    }
    name
}

/// Linear radiance of each surfel towards a camera; none of those that a result does not hold. `[n]`
fn linear(studio: &Studio, camera: &Camera, relit: &Relit, n: usize) -> Vec<[f32; 3]> {
    let held = relit.sh.len() / transplat_core::sh::coefficient_count(relit.degree);
    let positions = &studio.cloud.positions[..held.min(n)];
    let (sh, space) = (&relit.sh, ColorSpace::Linear);
    let mut colors = shade(
        positions,
        sh,
        relit.degree,
        relit.encoding,
        camera.eye,
        space,
    );
    colors.resize(n, [0.0; 3]);
    colors
}

/// Factor that gives an image of a scene the shadows and the bounced light of another.
fn ratio(with: &Raster, without: &Raster) -> Vec<[f32; 3]> {
    let values = without.pixels.iter().flat_map(|p| &p[..3]);
    let mean = values.sum::<f32>() / (3 * without.pixels.len()).max(1) as f32;
    let least = (DARK * mean).max(f32::MIN_POSITIVE);
    let each = with.pixels.iter().zip(&without.pixels);
    each.map(|(with, without)| {
        std::array::from_fn(|c| ((with[c] + least) / (without[c] + least)).max(0.0))
    })
    .collect()
}

/// Adds a layer's channels, a letter each.
fn add<const N: usize>(to: &mut Vec<Channel>, layer: &str, letters: &str, pixels: &[[f32; N]]) {
    for (i, letter) in letters.chars().enumerate() {
        let name = match layer {
            "" => letter.to_string(),
            named => format!("{named}.{letter}"),
        };
        let values = pixels.iter().map(|p| p[i]).collect();
        to.push(Channel { name, values });
    }
}
