//! Stage *rasterize* on the GPU. CPU twin: [`transplat_core::rasterize::rasterize`].
//!
//! Surfels are projected and shaded by compute passes and blended back to front as quads, in f32 where the adapter can. The order of a single
//! picture comes from the CPU's sort, which on a software driver is far faster than one in a compute shader; a window's from the adapter.

pub(crate) mod order;
mod target;

use std::collections::HashMap;
use std::ops::Range;
use std::sync::{Arc, Mutex, OnceLock};

use transplat_core::camera::Camera;
use transplat_core::color::Encoding;
use transplat_core::rasterize::{ColorSpace, Raster};
use transplat_core::sh::coefficient_count;
use transplat_core::surfels::{Bounds, SurfelCloud};
use transplat_core::transfer::cast_shadows::PlacedShadows;
use transplat_core::transfer::{Part, Relit};
use wgpu::BufferUsages;

use crate::context::{ComputePass, Context, Draws, RenderPass, Result};
use crate::layout::gpu_struct;
use crate::{CHUNK, shader};
pub use order::Order;
use order::{DrawnCount, Sorter};
pub use target::Target;
pub(crate) use target::{read_texture, write_texture};

/// Longest edge of one draw; larger pictures are drawn in tiles.
const MAX_TILE: usize = 4096;

/// Quads in one submission.
const DRAW_AT_ONCE: usize = 1 << 18;

gpu_struct! {
    in "rasterize_project";
    /// Camera and tile, and which surfels a dispatch projects.
    struct View {
        right: [f32; 4],
        down: [f32; 4],
        forward: [f32; 4],
        focal: f32,
        near: f32,
        principal: [f32; 2],
        depth_unit: f32,
        scale: f32,
        origin: [f32; 2],
        tile: [f32; 2],
        first: u32,
        count: u32,
    }

    /// Geometry of a surfel.
    struct Surfel {
        position: [f32; 4],
        axis_a: [f32; 4],
        axis_b: [f32; 4],
    }

    /// A surfel on the screen.
    struct ProjectedSurfel {
        t_u: [f32; 4],
        t_v: [f32; 4],
        t_w: [f32; 4],
        bounds: [f32; 4],
    }
}

gpu_struct! {
    in "rasterize_shade";
    /// Uniforms of the shading pass.
    struct ShadeParameters {
        eye: [f32; 4],
        first: u32,
        count: u32,
        encoding: u32,
        linear: u32,
        tone_map: u32,
        identity: u32,
        first_coefficient: u32,
        end_coefficient: u32,
    }
}

/// Colours of surfels on the CPU.
#[derive(Clone, Copy, Debug)]
pub enum Paint<'a> {
    /// SH `[n][K][3]` of the asset's degree, in some encoding.
    Sh {
        /// Coefficients.
        sh: &'a [[f32; 3]],
        /// SH degree.
        degree: usize,
        /// Encoding of the coefficients.
        encoding: Encoding,
        /// Shadows that are cast at the pixel.
        shadows: &'a [PlacedShadows],
    },
    /// One colour a surfel, `[n][3]`.
    Colors(&'a [[f32; 3]]),
}

impl<'a> Paint<'a> {
    /// Colours as captured.
    pub fn captured(cloud: &'a SurfelCloud) -> Self {
        Self::Sh {
            sh: &cloud.sh,
            degree: cloud.sh_degree,
            encoding: cloud.encoding,
            shadows: &[],
        }
    }

    /// Relit colours.
    pub fn relit(relit: &'a Relit) -> Self {
        Self::Sh {
            sh: &relit.sh,
            degree: relit.degree,
            encoding: relit.encoding,
            shadows: &relit.shadows,
        }
    }
}

/// SH colour on the GPU, `[n][K][3]` by chunk.
#[derive(Clone, Debug)]
pub struct ResidentSh {
    pub(crate) chunks: Vec<wgpu::Buffer>,
    /// SH degree.
    pub degree: usize,
    /// Encoding of the coefficients.
    pub encoding: Encoding,
}

impl ResidentSh {
    /// Uploads SH `[n][K][3]`.
    pub fn upload(context: &Context, sh: &[[f32; 3]], degree: usize, encoding: Encoding) -> Self {
        Self {
            degree,
            chunks: sh
                .chunks(CHUNK * coefficient_count(degree))
                .map(|chunk| context.upload(chunk, BufferUsages::STORAGE | BufferUsages::COPY_SRC))
                .collect(),
            encoding,
        }
    }

    /// A copy that later transfers do not change.
    pub fn snapshot(&self, context: &Context) -> Self {
        let mut encoder = context.encoder();
        let chunks = self
            .chunks
            .iter()
            .map(|from| {
                let to = context.storage(from.size() as usize);
                encoder.copy_buffer_to_buffer(from, 0, &to, 0, from.size());
                to
            })
            .collect();
        context.submit(encoder);
        Self { chunks, ..*self }
    }
}

/// One vector a surfel on the GPU, `[n]` by chunk.
#[derive(Clone, Debug)]
pub struct ResidentVectors(pub(crate) Vec<wgpu::Buffer>);

impl ResidentVectors {
    /// Uploads vectors `[n]`.
    pub fn upload(context: &Context, vectors: &[[f32; 4]]) -> Self {
        let chunks = vectors.chunks(CHUNK);
        Self(
            chunks
                .map(|c| context.upload(c, BufferUsages::STORAGE))
                .collect(),
        )
    }
}

/// Colours of surfels that are on the GPU already.
#[derive(Clone, Copy, Debug)]
pub enum ResidentPaint<'a> {
    /// SH colour, or those of its bands that the harmonic method has a part in.
    Sh(&'a ResidentSh, Part),
    /// Normals `[n]`, turned to the eye.
    Normals(&'a ResidentVectors),
    /// Heat map of the ratio: relit SH over the asset's linear DC `[n]`.
    Tau(&'a ResidentSh, &'a ResidentVectors),
    /// Heat map of a ratio that is there already: that of the front, and that of the back `[n][2]`.
    Ratio(&'a ResidentVectors),
    /// Marks `[n]` over the colours that are there, as much of them as their fourth number says.
    Marks(&'a ResidentVectors),
}

/// One drawing over what is in the target.
#[derive(Clone, Copy, Debug)]
pub struct Layer {
    /// The picture's pixel at which the target begins.
    pub origin: [usize; 2],
    /// True where the target is cleared before.
    pub is_first: bool,
    /// Unit that depths are divided by, so that those of the whole image are around 1.
    pub depth_unit: f32,
}

impl Default for Layer {
    fn default() -> Self {
        Self {
            origin: [0, 0],
            is_first: true,
            depth_unit: 1.0,
        }
    }
}

struct SurfelChunk {
    surfels: wgpu::Buffer,
    positions: wgpu::Buffer,
    count: usize,
}

/// Where an asset stands among others that it is drawn with: as one, with them in one order.
#[derive(Clone, Copy, Debug)]
struct Place {
    /// Its first surfel among theirs.
    first: usize,
    /// Length of its own unit in that of the scene.
    scale: f32,
}

/// Surfels on the screen, of one asset or of several.
#[derive(Clone)]
pub(crate) struct Canvas {
    pub projected: wgpu::Buffer,
    colors: wgpu::Buffer,
}

impl Canvas {
    /// Room for so many.
    ///
    /// # Errors
    /// They are too many for the adapter.
    pub fn new(context: &Context, surfels: usize) -> Result<Self> {
        Self::check(context, surfels)?;
        Ok(Self {
            projected: context.storage(surfels * size_of::<ProjectedSurfel>()),
            colors: context.storage(surfels * 16),
        })
    }

    /// Checks that there is room for so many surfels.
    pub fn check(context: &Context, surfels: usize) -> Result<()> {
        let bytes = surfels * size_of::<ProjectedSurfel>();
        context.check_fits("the projected scene", bytes)
    }
}

/// An asset on the GPU, ready to be drawn.
pub struct GpuRasterizer {
    context: Arc<Context>,
    cloud: Arc<SurfelCloud>,
    project: Arc<ComputePass>,
    /// By degree of colour and entry point.
    shade_passes: Mutex<HashMap<(usize, &'static str), Arc<ComputePass>>>,
    /// By half floats and depth, each compiled when it is first drawn with.
    draw: [[OnceLock<RenderPass>; 2]; 2],
    chunks: Vec<SurfelChunk>,
    canvas: Canvas,
    place: Place,
}

impl GpuRasterizer {
    /// Uploads an asset.
    ///
    /// # Errors
    /// It is too large for the adapter, or the driver failed.
    pub fn new(context: &Arc<Context>, cloud: &Arc<SurfelCloud>) -> Result<Self> {
        let n = cloud.len();
        let canvas = Canvas::new(context, n)?;
        let surfels: Vec<Surfel> = (0..n)
            .map(|i| {
                let [u, v] = cloud.tangents[i];
                Surfel {
                    position: cloud.positions[i].extend(cloud.opacities[i]).to_array(),
                    axis_a: (u * cloud.scales[i].x)
                        .extend(cloud.thicknesses[i].signed())
                        .to_array(),
                    axis_b: (v * cloud.scales[i].y).extend(0.0).to_array(),
                }
            })
            .collect();
        let chunks = surfels
            .chunks(CHUNK)
            .map(|chunk| {
                let positions: Vec<[f32; 4]> = chunk.iter().map(|s| s.position).collect();
                SurfelChunk {
                    surfels: context.upload(chunk, BufferUsages::STORAGE),
                    positions: context.upload(&positions, BufferUsages::STORAGE),
                    count: chunk.len(),
                }
            })
            .collect();
        let rasterizer = Self {
            context: context.clone(),
            cloud: cloud.clone(),
            project: context.compute_pass(&shader::RASTERIZE_PROJECT.source(), "project_surfels"),
            shade_passes: Mutex::default(),
            draw: Default::default(),
            chunks,
            canvas,
            place: Place {
                first: 0,
                scale: 1.0,
            },
        };
        context.wait()?;
        Ok(rasterizer)
    }

    /// Draws a view; `hidden` `[n]` or empty says which surfels are left out.
    ///
    /// # Errors
    /// The driver failed.
    ///
    /// # Panics
    /// If `paint` is not of the asset's size.
    pub fn draw(
        &self,
        camera: &Camera,
        paint: Paint<'_>,
        space: ColorSpace,
        hidden: &[bool],
    ) -> Result<Raster> {
        match paint {
            Paint::Colors(colors) => self.set_colors(colors),
            Paint::Sh {
                sh,
                degree,
                encoding,
                ..
            } => {
                assert_eq!(sh.len(), coefficient_count(degree) * self.cloud.len());
                let resident = ResidentSh::upload(&self.context, sh, degree, encoding);
                self.shade(camera, ResidentPaint::Sh(&resident, Part::Whole), space);
            }
        }
        let order = self.sort(camera, hidden);
        let mut raster = Raster {
            width: camera.width,
            height: camera.height,
            pixels: vec![[0.0; 4]; camera.width * camera.height],
            depth: vec![0.0; camera.width * camera.height],
        };
        self.project(camera);
        let edge = MAX_TILE.min(self.context.max_texture());
        for y in (0..camera.height).step_by(edge) {
            for x in (0..camera.width).step_by(edge) {
                let size = [edge.min(camera.width - x), edge.min(camera.height - y)];
                let target = Target::new(&self.context, size, true);
                let layer = Layer {
                    origin: [x, y],
                    is_first: true,
                    depth_unit: depth_unit(&self.cloud.bounds(), camera),
                };
                self.draw_tile(camera, layer, &order, &target);
                self.read_tile(layer, &target, &mut raster)?;
            }
        }
        Ok(raster)
    }

    /// Sorts what is in front of the camera and not hidden.
    pub fn sort(&self, camera: &Camera, hidden: &[bool]) -> Order {
        Order::of(&self.context, &self.cloud.positions, camera, hidden)
    }

    /// Order that the adapter draws surfels in, farthest first, to be held against the CPU's sort.
    ///
    /// # Errors
    /// The driver failed.
    pub fn order_on_adapter(&self, camera: &Camera, hidden: &[bool]) -> Result<Vec<u32>> {
        self.project(camera);
        let sorter = Sorter::new(&self.context, self.cloud.len());
        sorter.hide(&self.context, hidden);
        let size = [camera.width, camera.height];
        sorter.sort(&self.context, &self.canvas.projected, size);
        sorter.read(&self.context)
    }

    /// Sets the colour of each surfel.
    ///
    /// # Panics
    /// If there is not one a surfel.
    pub fn set_colors(&self, colors: &[[f32; 3]]) {
        assert_eq!(colors.len(), self.cloud.len());
        let wide: Vec<[f32; 4]> = colors.iter().map(|&[r, g, b]| [r, g, b, 0.0]).collect();
        let start = 16 * self.place.first as u64;
        let colors = bytemuck::cast_slice(&wide);
        self.context
            .queue
            .write_buffer(&self.canvas.colors, start, colors);
    }

    fn view(
        &self,
        camera: &Camera,
        layer: Layer,
        tile: [usize; 2],
        surfels: Range<usize>,
    ) -> wgpu::Buffer {
        let rows = camera.view_from_world.transpose();
        let pair = |v: [usize; 2]| v.map(|v| v as f32);
        let view = View {
            right: rows.x_axis.extend(camera.eye.x).to_array(),
            down: rows.y_axis.extend(camera.eye.y).to_array(),
            forward: rows.z_axis.extend(camera.eye.z).to_array(),
            focal: camera.focal,
            near: camera.near,
            principal: camera.principal_point(),
            depth_unit: layer.depth_unit,
            scale: self.place.scale,
            origin: pair(layer.origin),
            tile: pair(tile),
            first: surfels.start as u32,
            count: surfels.len() as u32,
        };
        self.context.upload(&[view], BufferUsages::UNIFORM)
    }

    /// Surfels that it draws.
    pub fn cloud(&self) -> &Arc<SurfelCloud> {
        &self.cloud
    }

    /// Takes the same surfels, held elsewhere.
    pub(crate) fn set_cloud(&mut self, cloud: &Arc<SurfelCloud>) {
        self.cloud = cloud.clone();
    }

    /// Is drawn with others from now on, its surfels counted from `first`; 1 in its own unit is `scale` in theirs.
    pub(crate) fn join(&mut self, canvas: &Canvas, first: usize, scale: f32) {
        self.canvas = canvas.clone();
        self.place = Place { first, scale };
    }

    /// Gives all surfels one colour.
    pub fn fill_colors(&self, color: [f32; 3]) {
        self.set_colors(&vec![color; self.cloud.len()]);
    }

    /// Projects all surfels.
    pub fn project(&self, camera: &Camera) {
        for (i, chunk) in self.chunks.iter().enumerate() {
            let tile = [camera.width, camera.height];
            let first = self.place.first + i * CHUNK;
            let surfels = first..first + chunk.count;
            let view = self.view(camera, Layer::default(), tile, surfels);
            let bindings = [
                ("view", &view),
                ("surfels", &chunk.surfels),
                ("projected", &self.canvas.projected),
            ];
            let group = self.context.bind(&self.project, &bindings);
            self.context.run_each(&self.project, &group, chunk.count);
        }
    }

    /// A pass of `rasterize_shade.wgsl`: its source is put together when it is first asked for, and not at each frame.
    fn shade_pass(&self, degree: usize, entry: &'static str) -> Arc<ComputePass> {
        let mut passes = self.shade_passes.lock().unwrap_or_else(|p| p.into_inner());
        let compile = || {
            let source = shader::rasterize_shade(degree);
            self.context.compute_pass(&source, entry)
        };
        passes
            .entry((degree, entry))
            .or_insert_with(compile)
            .clone()
    }

    /// Colours surfels with what is on the GPU, as seen by the camera.
    pub fn shade(&self, camera: &Camera, paint: ResidentPaint<'_>, space: ColorSpace) {
        let whole = Part::Whole;
        let (entry, part, sh, vectors) = match paint {
            ResidentPaint::Sh(sh, part) => ("shade", part, Some(sh), None),
            ResidentPaint::Normals(v) => ("shade_normals", whole, None, Some(("normals", v))),
            ResidentPaint::Tau(sh, v) => ("shade_tau", whole, Some(sh), Some(("source_dc", v))),
            ResidentPaint::Ratio(v) => ("shade_ratio", whole, None, Some(("ratio", v))),
            ResidentPaint::Marks(v) => ("overlay", whole, None, Some(("marks", v))),
        };
        let (degree, encoding) = sh.map_or((0, Encoding::Linear), |sh| (sh.degree, sh.encoding));
        let coefficients = part.coefficients(coefficient_count(degree));
        let display = match space {
            ColorSpace::Display(display) => Some(display),
            ColorSpace::Linear => None,
        };
        let is_identity = encoding == Encoding::Stored && display.is_some_and(|d| d.is_identity());
        let exposure = display.map_or(1.0, |d| d.exposure.exp2());
        let pass = self.shade_pass(degree, entry);
        for (i, chunk) in self.chunks.iter().enumerate() {
            let parameters = ShadeParameters {
                eye: camera.eye.extend(exposure).to_array(),
                first: (self.place.first + i * CHUNK) as u32,
                count: chunk.count as u32,
                encoding: encoding as u32,
                linear: u32::from(display.is_none()),
                tone_map: display.map_or(0, |d| d.tone_map as u32),
                identity: u32::from(is_identity),
                first_coefficient: coefficients.start as u32,
                end_coefficient: coefficients.end as u32,
            };
            let parameters = self.context.upload(&[parameters], BufferUsages::STORAGE);
            let mut bindings = vec![
                ("parameters", &parameters),
                ("positions", &chunk.positions),
                ("colors", &self.canvas.colors),
            ];
            bindings.extend(sh.map(|sh| ("sh", &sh.chunks[i])));
            bindings.extend(vectors.map(|(name, v)| (name, &v.0[i])));
            let group = self.context.bind(&pass, &bindings);
            self.context.run_each(&pass, &group, chunk.count);
        }
    }

    /// Blends the surfels into a part of the picture that is of the target's size.
    pub fn draw_tile(&self, camera: &Camera, layer: Layer, order: &Order, target: &Target) {
        let view = self.view(camera, layer, target.size, 0..0);
        let bindings = [
            ("view", &view),
            ("projected", &self.canvas.projected),
            ("colors", &self.canvas.colors),
            ("order", &order.surfels),
        ];
        let draw = self.draw_pass(target.color.format(), target.depth.is_some());
        let group = self.context.bind(draw, &bindings);
        let textures = std::iter::once(&target.color).chain(&target.depth);
        let views: Vec<_> = textures
            .map(|t| t.create_view(&Default::default()))
            .collect();
        let targets: Vec<_> = views.iter().collect();
        let clear = match layer.is_first {
            true => wgpu::LoadOp::Clear(wgpu::Color::TRANSPARENT),
            false => wgpu::LoadOp::Load,
        };
        let count = match &order.drawn {
            DrawnCount::Count(count) => *count,
            DrawnCount::Indirect(drawn) => {
                let mut encoder = self.context.encoder();
                draw.draw(
                    &mut encoder,
                    &targets,
                    clear,
                    &group,
                    Draws::Indirect(drawn),
                );
                self.context.submit(encoder);
                return;
            }
        };
        for first in (0..count.max(1)).step_by(DRAW_AT_ONCE) {
            let load = if first == 0 {
                clear
            } else {
                wgpu::LoadOp::Load
            };
            let last = count.min(first + DRAW_AT_ONCE);
            let quads = Draws::Direct(0..4, first as u32..last as u32);
            let mut encoder = self.context.encoder();
            draw.draw(&mut encoder, &targets, load, &group, quads);
            self.context.submit(encoder);
        }
    }

    /// Render pass into targets of a format, with depth or without.
    fn draw_pass(&self, color_format: wgpu::TextureFormat, has_depth: bool) -> &RenderPass {
        let is_half = color_format == wgpu::TextureFormat::Rgba16Float;
        let pass = &self.draw[usize::from(is_half)][usize::from(has_depth)];
        pass.get_or_init(|| draw_pass(&self.context, color_format, has_depth))
    }

    /// Compiles what every frame of a window draws with; no frame waits for it.
    pub(crate) fn warm_up(&self) {
        self.draw_pass(wgpu::TextureFormat::Rgba16Float, false);
        Sorter::warm_up(&self.context);
    }

    fn read_tile(&self, layer: Layer, target: &Target, raster: &mut Raster) -> Result<()> {
        let pixels = read_texture(&self.context, &target.color)?;
        let depths = target.depth.as_ref();
        let depths = depths.map(|depth| read_texture(&self.context, depth));
        let depths = depths.transpose()?.unwrap_or_default();
        for y in 0..target.size[1] {
            for x in 0..target.size[0] {
                let from = y * target.size[0] + x;
                let to = (layer.origin[1] + y) * raster.width + layer.origin[0] + x;
                raster.pixels[to].copy_from_slice(&pixels[4 * from..][..4]);
                let alpha = pixels[4 * from + 3];
                raster.depth[to] = match depths.get(from) {
                    Some(depth) if alpha > 0.0 => depth * layer.depth_unit / alpha,
                    _ => 0.0,
                };
            }
        }
        Ok(())
    }
}

/// An object's distance and size together: depths are around 1 in it, whatever the scene's unit.
pub(crate) fn depth_unit(bounds: &Bounds, camera: &Camera) -> f32 {
    (camera.eye.distance(bounds.center) + bounds.radius).max(camera.near)
}

fn draw_pass(context: &Context, color_format: wgpu::TextureFormat, has_depth: bool) -> RenderPass {
    let half_float = color_format == wgpu::TextureFormat::Rgba16Float;
    let formats = [color_format, context.depth_format];
    let targets = formats.map(|format| {
        let blend = Some(wgpu::BlendState::PREMULTIPLIED_ALPHA_BLENDING);
        wgpu::ColorTargetState {
            blend,
            ..format.into()
        }
    });
    let topology = wgpu::PrimitiveTopology::TriangleStrip;
    let source = shader::rasterize_draw(half_float);
    match has_depth {
        true => context.render_pass(&source, "shade_pixel", topology, &targets),
        false => context.render_pass(&source, "shade_color", topology, &targets[..1]),
    }
}
