//! Stage *present* on the GPU: pictures of surfels, background, ground and comparison to the picture on the screen.
//! CPU twins: [`transplat_core::present`] and [`transplat_core::ground`].

use std::collections::HashMap;

use glam::{DMat3, Vec3};
use transplat_core::backplate::Backplate;
use transplat_core::camera::Camera;
use transplat_core::color::{Display, ToneMap};
use transplat_core::environment::EnvironmentMap;
use transplat_core::ground::GROUND_CELLS;
use transplat_core::lut::Lut;
use transplat_core::present::{Background, View, depth_range, wipe_column};
use transplat_core::surfels::Bounds;
use wgpu::BufferUsages;

use crate::context::{Context, Draws, RenderPass};
use crate::layout::gpu_struct;
use crate::rasterize::{Target, write_texture};
use crate::shader::{self, PresentShape};

/// The screen's format: display-encoded values.
pub const SCREEN_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// Maps behind the object are reduced to this width: a pixel of it is wider than one of the screen only above 33 megapixels.
const MAX_BACKDROP_WIDTH: usize = 8192;

/// Pixels along the shorter edge that plates are reduced to.
const PLATE_EDGE: usize = 1440;

gpu_struct! {
    in "present";
    /// Uniforms of the pass.
    struct PresentParameters {
        view: [[f32; 4]; 3],
        eye: [f32; 4],
        maps: [[[f32; 4]; 3]; 2],
        ground: [f32; 4],
        ground_axes: [[f32; 4]; 2],
        colors: [[f32; 4]; 2],
        size: [f32; 2],
        principal: [f32; 2],
        depth_range: [f32; 2],
        difference_scale: f32,
        wipe_column: u32,
    }
}

/// A light as a background.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BackdropLight {
    /// From directions of the asset to those of the map.
    pub map_from_asset: DMat3,
    /// Factor of its radiance.
    pub gain: [f32; 3],
}

/// Where the ground is and what is shown on it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GroundPlane {
    /// Middle, in the asset's coordinates.
    pub center: Vec3,
    /// Unit axes; their cross product points up.
    pub axes: [Vec3; 2],
    /// Half the edge of what catches shadows.
    pub half: f32,
    /// True where it catches shadows.
    pub catches: bool,
    /// Spacing of the grid in scene units; none without one.
    pub grid: Option<f32>,
}

/// Settings of the presentation, besides the images themselves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Presentation {
    /// The camera of one picture; side by side there are two of them.
    pub camera: Camera,
    /// Size of the whole screen, in pixels.
    pub size: [usize; 2],
    /// View that is shown.
    pub view: View,
    /// Where a split is, 0 to 1.
    pub wipe: f32,
    /// Factor of differences.
    pub difference_scale: f32,
    /// Exposure and tone curve, for the background.
    pub display: Display,
    /// LUT of each side: 0 the pinned look's, 1 the scene's.
    pub graded: [Option<usize>; 2],
    /// True where exposure is shown as false colours.
    pub false_color: bool,
    /// Background behind the surfels.
    pub background: Background,
    /// Pixels of the plate, where that is behind.
    pub plate: [usize; 2],
    /// Source and target light.
    pub lights: [BackdropLight; 2],
    /// The ground.
    pub ground: GroundPlane,
    /// The object.
    pub bounds: Bounds,
    /// Unit of depth that the rasterizer divided by.
    pub depth_unit: f32,
}

impl Presentation {
    fn parameters(&self) -> PresentParameters {
        let wide = |v: Vec3, w: f32| v.extend(w).to_array();
        let camera = &self.camera;
        let rows = camera.view_from_world.transpose();
        let colors = match self.background {
            Background::Color(color) => [color, color],
            Background::Gradient(top, bottom) => [top, bottom],
            Background::Backplate => {
                let scale = Backplate::scale(self.plate, [camera.width, camera.height]);
                let [u, v] = self.plate.map(|edge| scale / edge.max(1) as f32);
                [[u, v, 0.0]; 2]
            }
            _ => [[0.0; 3]; 2],
        };
        let map = |light: BackdropLight| {
            let row = |i: usize| wide(light.map_from_asset.row(i).as_vec3(), light.gain[i]);
            [0, 1, 2].map(row)
        };
        let ground = &self.ground;
        PresentParameters {
            view: [
                wide(rows.x_axis, camera.focal),
                wide(rows.y_axis, camera.backdrop_focal),
                wide(rows.z_axis, self.depth_unit),
            ],
            eye: wide(camera.eye, self.display.exposure.exp2()),
            maps: self.lights.map(map),
            ground: wide(ground.center, ground.half),
            ground_axes: [
                wide(ground.axes[0], 0.0),
                wide(ground.axes[1], ground.grid.unwrap_or(0.0)),
            ],
            colors: colors.map(|c| [c[0], c[1], c[2], 1.0]),
            size: self.size.map(|v| v as f32),
            principal: camera.principal_point(),
            depth_range: depth_range(camera, &self.bounds),
            difference_scale: self.difference_scale,
            wipe_column: wipe_column(self.wipe, self.size[0]) as u32,
        }
    }

    /// Shape of the pass that makes its image.
    fn shape(&self) -> PresentShape {
        let is_arranged = self.view.has_two_sides() || self.view == View::Depth;
        PresentShape {
            arrangement: match self.view {
                View::Before => View::Before,
                view if is_arranged => view,
                _ => View::After,
            },
            background: shader::background_number(self.background),
            // Nothing else has one: the rest is display-encoded already.
            tone_map: match self.background {
                Background::Environment => self.display.tone_map,
                _ => ToneMap::default(),
            },
            is_graded: self.graded != [None; 2],
            false_colored: self.false_color,
            catches_shadows: self.ground.catches,
            has_grid: self.ground.grid.is_some(),
        }
    }
}

/// A light's map on the GPU.
#[derive(Clone, Debug)]
pub struct Backdrop(wgpu::TextureView);

impl Backdrop {
    /// Uploads a map as half floats; a larger one than can be seen or held is reduced first.
    pub fn new(context: &Context, map: &EnvironmentMap) -> Self {
        let reduced = map.reduced(MAX_BACKDROP_WIDTH.min(context.max_texture()));
        Self::of(
            context,
            [reduced.width(), reduced.height()],
            reduced.pixels(),
        )
    }

    /// Uploads a plate as a backdrop.
    pub fn of_backplate(context: &Context, plate: &Backplate) -> Self {
        let longer = plate.width.max(plate.height);
        let shorter = plate.width.min(plate.height);
        let most = shorter * context.max_texture() / longer.max(1);
        let reduced = plate.reduced(PLATE_EDGE.min(most).max(1));
        Self::of(context, [reduced.width, reduced.height], &reduced.pixels)
    }

    fn of(context: &Context, size: [usize; 2], pixels: &[[f32; 3]]) -> Self {
        let texels: Vec<[f32; 4]> = pixels.iter().map(|&[r, g, b]| [r, g, b, 1.0]).collect();
        let format = wgpu::TextureFormat::Rgba16Float;
        Self(half_floats(context, size, format, texels.as_flattened()))
    }
}

/// The caught shadow on the GPU.
#[derive(Clone, Debug)]
pub struct GroundLit(wgpu::TextureView);

impl GroundLit {
    /// Uploads the lit share of each cell.
    pub fn new(context: &Context, lit: &[f32]) -> Self {
        let size = [GROUND_CELLS, GROUND_CELLS];
        let format = wgpu::TextureFormat::R16Float;
        Self(half_floats(context, size, format, lit))
    }
}

fn half_floats(
    context: &Context,
    size: [usize; 2],
    format: wgpu::TextureFormat,
    values: &[f32],
) -> wgpu::TextureView {
    let texture = context.texture("map", size, format, wgpu::TextureUsages::COPY_DST);
    write_texture(context, &texture, values);
    texture.create_view(&Default::default())
}

/// A table of colours on the GPU.
#[derive(Clone, Debug)]
pub struct ResidentLut(wgpu::Buffer);

impl ResidentLut {
    /// Uploads a table.
    pub fn new(context: &Context, lut: &Lut) -> Self {
        let tables = [&lut.curves, &lut.cube].map(Option::as_ref);
        let header = tables.into_iter().flat_map(|table| {
            let wide = |[r, g, b]: [f32; 3], w: usize| [r, g, b, w as f32];
            table.map_or([[0.0; 4]; 2], |t| [wide(t.from, t.size), wide(t.to, 0)])
        });
        let entries = tables.into_iter().flatten().flat_map(|t| &t.entries);
        let entries = entries.map(|[r, g, b]| [*r, *g, *b, 0.0]);
        let values: Vec<[f32; 4]> = header.chain(entries).collect();
        Self(context.upload(&values, BufferUsages::STORAGE))
    }
}

/// Surroundings of the surfels' images, one a side.
pub struct Around<'a> {
    /// Behind them.
    pub backdrops: [Option<&'a Backdrop>; 2],
    /// Under them.
    pub ground: [Option<&'a GroundLit>; 2],
    /// Over the whole.
    pub luts: [Option<&'a ResidentLut>; 2],
}

/// The passes and what they sample with.
pub struct PresentPass {
    /// Each compiled when a picture first needs it.
    passes: HashMap<PresentShape, RenderPass>,
    map_sampler: wgpu::Sampler,
    ground_sampler: wgpu::Sampler,
    /// Stands for a map or ground that is not there.
    nothing: wgpu::TextureView,
    /// For a side that is not graded.
    as_it_is: ResidentLut,
}

impl PresentPass {
    /// With what all pictures need.
    pub fn new(context: &Context) -> Self {
        Self {
            passes: HashMap::new(),
            map_sampler: sampler(context, wgpu::AddressMode::Repeat),
            ground_sampler: sampler(context, wgpu::AddressMode::ClampToEdge),
            nothing: Backdrop::new(context, &EnvironmentMap::even()).0,
            as_it_is: ResidentLut::new(context, &Lut::default()),
        }
    }

    /// Makes the picture of the screen from those of the surfels; sides that a view does not show may be any.
    pub fn present(
        &mut self,
        context: &Context,
        presentation: &Presentation,
        sides: [&Target; 2],
        around: &Around<'_>,
        screen: &wgpu::TextureView,
    ) {
        let shape = presentation.shape();
        let compile =
            || fullscreen_pass(context, &shader::present(shape), "present", SCREEN_FORMAT);
        let pass = &*self.passes.entry(shape).or_insert_with(compile);
        let parameters = context.upload(&[presentation.parameters()], BufferUsages::STORAGE);
        let view = |t: &wgpu::Texture| t.create_view(&Default::default());
        let pictures = sides.map(|side| view(&side.color));
        let depth = sides[1].depth.as_ref().map(view);
        let backdrops = around.backdrops.map(|b| b.map_or(&self.nothing, |b| &b.0));
        let ground = around.ground.map(|g| g.map_or(&self.nothing, |g| &g.0));
        let luts = around.luts.map(|lut| &lut.unwrap_or(&self.as_it_is).0);
        let texture = wgpu::BindingResource::TextureView;
        let sampler = wgpu::BindingResource::Sampler;
        let group = context.bind_resources(
            pass,
            &[
                ("parameters", parameters.as_entire_binding()),
                ("before_color", texture(&pictures[0])),
                ("after_color", texture(&pictures[1])),
                (
                    "after_depth",
                    texture(depth.as_ref().unwrap_or(&self.nothing)),
                ),
                ("before_map", texture(backdrops[0])),
                ("after_map", texture(backdrops[1])),
                ("ground_before", texture(ground[0])),
                ("ground_after", texture(ground[1])),
                ("lut_before", luts[0].as_entire_binding()),
                ("lut_after", luts[1].as_entire_binding()),
                ("map_sampler", sampler(&self.map_sampler)),
                ("ground_sampler", sampler(&self.ground_sampler)),
            ],
        );
        let mut encoder = context.encoder();
        let black = wgpu::LoadOp::Clear(wgpu::Color::BLACK);
        pass.draw(
            &mut encoder,
            &[screen],
            black,
            &group,
            Draws::Direct(0..3, 0..1),
        );
        context.submit(encoder);
    }
}

fn sampler(context: &Context, across: wgpu::AddressMode) -> wgpu::Sampler {
    context.device.create_sampler(&wgpu::SamplerDescriptor {
        address_mode_u: across,
        mag_filter: wgpu::FilterMode::Linear,
        min_filter: wgpu::FilterMode::Linear,
        ..Default::default()
    })
}

/// Brings the screen's picture to its place in the window.
pub struct Blit {
    pass: RenderPass,
    sampler: wgpu::Sampler,
}

impl Blit {
    /// Compiles the pass for a window of a format.
    pub fn new(context: &Context, window: wgpu::TextureFormat) -> Self {
        Self {
            pass: fullscreen_pass(context, &shader::BLIT.source(), "blit", window),
            sampler: sampler(context, wgpu::AddressMode::ClampToEdge),
        }
    }

    pub(crate) fn bind(&self, context: &Context, screen: &wgpu::TextureView) -> wgpu::BindGroup {
        let sampler = wgpu::BindingResource::Sampler(&self.sampler);
        let picture = wgpu::BindingResource::TextureView(screen);
        context.bind_resources(
            &self.pass,
            &[("picture", picture), ("picture_sampler", sampler)],
        )
    }

    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, group: &wgpu::BindGroup) {
        self.pass.draw_in(pass, group, &Draws::Direct(0..3, 0..1));
    }
}

fn fullscreen_pass(
    context: &Context,
    source: &str,
    entry: &str,
    format: wgpu::TextureFormat,
) -> RenderPass {
    let topology = wgpu::PrimitiveTopology::TriangleList;
    context.render_pass(source, entry, topology, &[format.into()])
}
