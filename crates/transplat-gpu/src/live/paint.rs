//! Colours that the CPU rasterizer takes.

use glam::Vec3;
use transplat_core::camera::Camera;
use transplat_core::pixel_shadows::PixelShadows;
use transplat_core::present::normal_color;
use transplat_core::rasterize::{ColorSpace, Raster, Rasterizer, Shading};
use transplat_core::surfels::SurfelCloud;
use transplat_core::transfer::cast_shadows::PlacedShadows;

/// Colours of an object's surfels.
pub(super) struct ObjectPaint<'a> {
    pub color: Color<'a>,
    /// Shadows that are cast on it at the pixel, among the surfels of the image.
    pub shadows: Vec<PlacedShadows>,
    /// Over the colours, as much of them as their fourth number says, `[n]`.
    pub marks: Option<&'a [[f32; 4]]>,
}

pub(super) enum Color<'a> {
    Sh(Shading<'a>),
    /// `[n]`
    Own(&'a [[f32; 3]]),
    /// Turned to an eye.
    Normals(&'a SurfelCloud, Vec3),
    White,
}

impl ObjectPaint<'_> {
    /// Linear colour of a surfel where shadows are cast on it.
    fn linear(&self, surfel: usize) -> [f32; 3] {
        let mut color = [[0.0; 3]];
        match &self.color {
            Color::Sh(shading) => {
                let space = ColorSpace::Linear;
                let linear = Shading {
                    space,
                    ..shading.clone()
                };
                linear.colors(&[surfel], &mut color);
            }
            _ => self.colors(&[surfel], &mut color),
        }
        color[0]
    }

    /// The colours of some of them.
    pub fn colors(&self, surfels: &[usize], out: &mut [[f32; 3]]) {
        let each = surfels.iter().zip(&mut *out);
        match &self.color {
            Color::Sh(shading) => shading.colors(surfels, out),
            Color::Own(colors) => each.for_each(|(i, out)| *out = colors[*i]),
            Color::Normals(cloud, eye) => {
                each.for_each(|(i, out)| *out = normal_color(cloud, *eye, *i));
            }
            Color::White => out.fill([1.0; 3]),
        }
        for (i, out) in surfels.iter().zip(out) {
            if let Some([r, g, b, share]) = self.marks.map(|marks| marks[*i]) {
                let mark = Vec3::new(r, g, b);
                *out = Vec3::from_array(*out).lerp(mark, share).to_array();
            }
        }
    }
}

/// Casts the shadows at the pixel on an image of objects, each of so many surfels.
pub(super) fn cast_shadows(
    objects: &[(usize, ObjectPaint<'_>)],
    rasterizer: &Rasterizer,
    camera: &Camera,
    space: ColorSpace,
    raster: &mut Raster,
) {
    // Marks lie over what is lit.
    let lit = objects.iter().filter(|(_, paint)| paint.marks.is_none());
    let shadows: Vec<PlacedShadows> = lit.flat_map(|(_, p)| p.shadows.clone()).collect();
    if shadows.is_empty() {
        return;
    }
    let linear = |surfel: usize| {
        let mut own = surfel;
        for (count, paint) in objects {
            if own < *count {
                return paint.linear(own);
            }
            own -= count;
        }
        [0.0; 3]
    };
    let pixel_shadows = PixelShadows {
        shadows: &shadows,
        camera,
        space,
    };
    pixel_shadows.cast_on(rasterizer, linear, raster);
}
