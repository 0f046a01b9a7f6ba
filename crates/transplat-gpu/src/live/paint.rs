//! Colours that the CPU rasterizer takes.

use glam::Vec3;
use transplat_core::present::normal_color;
use transplat_core::rasterize::Shading;
use transplat_core::surfels::SurfelCloud;

/// Colours of an object's surfels.
pub(super) struct ObjectPaint<'a> {
    pub color: Color<'a>,
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
