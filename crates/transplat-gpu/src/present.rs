//! Stage *present* on the GPU: pictures of surfels, background, ground and comparison to the picture on the screen.
//! CPU twins: [`transplat_core::present`] and [`transplat_core::ground`].

use glam::{DMat3, Vec3};
use transplat_core::camera::Camera;
use transplat_core::color::Display;
use transplat_core::environment::EnvironmentMap;
use transplat_core::ground::GROUND_CELLS;
use transplat_core::present::{Background, View, depth_range, wipe_column};
use transplat_core::surfels::Bounds;
use wgpu::BufferUsages;

use crate::context::{Bindings, Context, Shader};
use crate::layout::gpu_struct;
use crate::rasterize::{Target, extent};
use crate::shader;

/// The screen's format: display-encoded values.
pub const SCREEN_FORMAT: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

/// Maps behind the object are reduced to this width: a pixel of it is wider than one of the screen only above 33 megapixels.
const MAX_BACKDROP_WIDTH: usize = 8192;

gpu_struct! {
    /// Uniforms of the pass.
    #[derive(PartialEq)]
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
        arrangement: u32,
        background: u32,
        tone_map: u32,
        wipe_column: u32,
        false_color: u32,
    }
}

/// A light as a background.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BackdropLight {
    /// From directions of the asset to those of the map.
    pub map_from_asset: DMat3,
    /// What its radiance is multiplied by.
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
    /// Whether it catches shadows.
    pub catches: bool,
    /// Spacing of the grid in scene units; none without one.
    pub grid: Option<f32>,
}

/// What is presented besides the pictures themselves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Presentation {
    /// The camera of one picture; side by side there are two of them.
    pub camera: Camera,
    /// Of the whole screen.
    pub size: [usize; 2],
    /// What is shown.
    pub view: View,
    /// Where a split is, 0 to 1.
    pub wipe: f32,
    /// What differences are multiplied by.
    pub difference_scale: f32,
    /// Exposure and tone curve, for the background.
    pub display: Display,
    /// Whether exposure is shown as colours.
    pub false_color: bool,
    /// What is behind.
    pub background: Background,
    /// Source and target light.
    pub lights: [BackdropLight; 2],
    /// The ground.
    pub ground: GroundPlane,
    /// The object.
    pub bounds: Bounds,
    /// What the rasterizer divided depth by.
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
                wide(ground.axes[0], if ground.catches { 1.0 } else { 0.0 }),
                wide(ground.axes[1], ground.grid.unwrap_or(0.0)),
            ],
            colors: colors.map(|c| [c[0], c[1], c[2], 1.0]),
            size: self.size.map(|v| v as f32),
            principal: camera.principal_point(),
            depth_range: depth_range(camera, &self.bounds),
            difference_scale: self.difference_scale,
            arrangement: shader::layout_number(self.view),
            background: shader::background_number(self.background),
            tone_map: shader::tone_number(self.display.tone_map),
            wipe_column: wipe_column(self.wipe, self.size[0]) as u32,
            false_color: u32::from(self.false_color),
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
        let texels: Vec<[half::f16; 4]> = reduced
            .pixels()
            .iter()
            .map(|&[r, g, b]| [r, g, b, 1.0].map(|v| half::f16::from_f32(v.min(65504.0))))
            .collect();
        let bytes: Vec<u8> = texels
            .iter()
            .flatten()
            .flat_map(|v| v.to_le_bytes())
            .collect();
        let size = [reduced.width(), reduced.height()];
        Self(texture(
            context,
            size,
            wgpu::TextureFormat::Rgba16Float,
            &bytes,
            8,
        ))
    }
}

/// The caught shadow on the GPU.
#[derive(Clone, Debug)]
pub struct GroundLit(wgpu::TextureView);

impl GroundLit {
    /// Uploads the lit share of each cell.
    pub fn new(context: &Context, lit: &[f32]) -> Self {
        let bytes: Vec<u8> = lit
            .iter()
            .flat_map(|v| half::f16::from_f32(*v).to_le_bytes())
            .collect();
        let size = [GROUND_CELLS, GROUND_CELLS];
        Self(texture(
            context,
            size,
            wgpu::TextureFormat::R16Float,
            &bytes,
            2,
        ))
    }
}

fn texture(
    context: &Context,
    size: [usize; 2],
    format: wgpu::TextureFormat,
    bytes: &[u8],
    texel_bytes: usize,
) -> wgpu::TextureView {
    let texture = context.device.create_texture(&wgpu::TextureDescriptor {
        label: Some("map"),
        size: extent(size),
        mip_level_count: 1,
        sample_count: 1,
        dimension: wgpu::TextureDimension::D2,
        format,
        usage: wgpu::TextureUsages::TEXTURE_BINDING | wgpu::TextureUsages::COPY_DST,
        view_formats: &[],
    });
    context.queue.write_texture(
        texture.as_image_copy(),
        bytes,
        wgpu::TexelCopyBufferLayout {
            offset: 0,
            bytes_per_row: Some((size[0] * texel_bytes) as u32),
            rows_per_image: None,
        },
        extent(size),
    );
    texture.create_view(&Default::default())
}

/// The pass and what it samples with.
pub struct PresentPass {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    bindings: Bindings,
    map_sampler: wgpu::Sampler,
    ground_sampler: wgpu::Sampler,
    /// Stands for a map or ground that is not there.
    nothing: wgpu::TextureView,
}

impl PresentPass {
    /// Compiles the pass.
    pub fn new(context: &Context) -> Self {
        let fragment = wgpu::ShaderStages::FRAGMENT;
        let shader = context.shader(&shader::present(), "present");
        let texture_entry = |name, filterable| wgpu::BindGroupLayoutEntry {
            binding: shader.bindings.number(name),
            visibility: fragment,
            ty: wgpu::BindingType::Texture {
                sample_type: wgpu::TextureSampleType::Float { filterable },
                view_dimension: wgpu::TextureViewDimension::D2,
                multisampled: false,
            },
            count: None,
        };
        let sampler_entry = |name| wgpu::BindGroupLayoutEntry {
            binding: shader.bindings.number(name),
            visibility: fragment,
            ty: wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
            count: None,
        };
        let layout = context
            .device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("present"),
                entries: &[
                    wgpu::BindGroupLayoutEntry {
                        binding: shader.bindings.number("parameters"),
                        visibility: fragment,
                        ty: wgpu::BindingType::Buffer {
                            ty: wgpu::BufferBindingType::Storage { read_only: true },
                            has_dynamic_offset: false,
                            min_binding_size: None,
                        },
                        count: None,
                    },
                    texture_entry("before_color", false),
                    texture_entry("after_color", false),
                    texture_entry("after_depth", false),
                    texture_entry("before_map", true),
                    texture_entry("after_map", true),
                    texture_entry("ground_before", true),
                    sampler_entry("map_sampler"),
                    sampler_entry("ground_sampler"),
                    texture_entry("ground_after", true),
                ],
            });
        let sampler = |across| {
            context.device.create_sampler(&wgpu::SamplerDescriptor {
                address_mode_u: across,
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            })
        };
        Self {
            pipeline: fullscreen_pipeline(context, &shader, "present", &layout, SCREEN_FORMAT),
            layout,
            bindings: shader.bindings,
            map_sampler: sampler(wgpu::AddressMode::Repeat),
            ground_sampler: sampler(wgpu::AddressMode::ClampToEdge),
            nothing: Backdrop::new(context, &EnvironmentMap::even()).0,
        }
    }

    /// Makes the picture of the screen from those of the surfels; sides that a view does not show may be any.
    pub fn present(
        &self,
        context: &Context,
        presentation: &Presentation,
        sides: [&Target; 2],
        backdrops: [Option<&Backdrop>; 2],
        ground: [Option<&GroundLit>; 2],
        screen: &wgpu::TextureView,
    ) {
        let parameters = context.upload(&[presentation.parameters()], BufferUsages::STORAGE);
        let view = |texture: &wgpu::Texture| texture.create_view(&Default::default());
        let views = [
            view(&sides[0].color),
            view(&sides[1].color),
            view(&sides[1].depth),
        ];
        let backdrop = |side: usize| backdrops[side].map_or(&self.nothing, |b| &b.0);
        let texture = wgpu::BindingResource::TextureView;
        let group = context.bind_resources(
            &self.layout,
            &self.bindings,
            &[
                ("parameters", parameters.as_entire_binding()),
                ("before_color", texture(&views[0])),
                ("after_color", texture(&views[1])),
                ("after_depth", texture(&views[2])),
                ("before_map", texture(backdrop(0))),
                ("after_map", texture(backdrop(1))),
                (
                    "ground_before",
                    texture(ground[0].map_or(&self.nothing, |g| &g.0)),
                ),
                (
                    "ground_after",
                    texture(ground[1].map_or(&self.nothing, |g| &g.0)),
                ),
                (
                    "map_sampler",
                    wgpu::BindingResource::Sampler(&self.map_sampler),
                ),
                (
                    "ground_sampler",
                    wgpu::BindingResource::Sampler(&self.ground_sampler),
                ),
            ],
        );
        let mut encoder = context.encoder();
        {
            let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                label: Some("present"),
                color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                    view: screen,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations {
                        load: wgpu::LoadOp::Clear(wgpu::Color::BLACK),
                        store: wgpu::StoreOp::Store,
                    },
                })],
                ..Default::default()
            });
            pass.set_pipeline(&self.pipeline);
            pass.set_bind_group(0, &group, &[]);
            pass.draw(0..3, 0..1);
        }
        context.submit(encoder);
    }
}

/// Brings the screen's picture to its place in the window.
pub struct Blit {
    pipeline: wgpu::RenderPipeline,
    layout: wgpu::BindGroupLayout,
    bindings: Bindings,
    sampler: wgpu::Sampler,
}

impl Blit {
    /// Compiles the pass for a window of a format.
    pub fn new(context: &Context, window: wgpu::TextureFormat) -> Self {
        let fragment = wgpu::ShaderStages::FRAGMENT;
        let shader = context.shader(&shader::blit(), "blit");
        let layout = context
            .device
            .create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
                label: Some("blit"),
                entries: &[
                    wgpu::BindGroupLayoutEntry {
                        binding: shader.bindings.number("picture"),
                        visibility: fragment,
                        ty: wgpu::BindingType::Texture {
                            sample_type: wgpu::TextureSampleType::Float { filterable: true },
                            view_dimension: wgpu::TextureViewDimension::D2,
                            multisampled: false,
                        },
                        count: None,
                    },
                    wgpu::BindGroupLayoutEntry {
                        binding: shader.bindings.number("picture_sampler"),
                        visibility: fragment,
                        ty: wgpu::BindingType::Sampler(wgpu::SamplerBindingType::Filtering),
                        count: None,
                    },
                ],
            });
        Self {
            pipeline: fullscreen_pipeline(context, &shader, "blit", &layout, window),
            layout,
            bindings: shader.bindings,
            sampler: context.device.create_sampler(&wgpu::SamplerDescriptor {
                mag_filter: wgpu::FilterMode::Linear,
                min_filter: wgpu::FilterMode::Linear,
                ..Default::default()
            }),
        }
    }

    pub(crate) fn bind(&self, context: &Context, screen: &wgpu::TextureView) -> wgpu::BindGroup {
        context.bind_resources(
            &self.layout,
            &self.bindings,
            &[
                ("picture", wgpu::BindingResource::TextureView(screen)),
                (
                    "picture_sampler",
                    wgpu::BindingResource::Sampler(&self.sampler),
                ),
            ],
        )
    }

    pub(crate) fn draw(&self, pass: &mut wgpu::RenderPass<'_>, group: &wgpu::BindGroup) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        pass.draw(0..3, 0..1);
    }
}

fn fullscreen_pipeline(
    context: &Context,
    shader: &Shader,
    entry: &str,
    layout: &wgpu::BindGroupLayout,
    format: wgpu::TextureFormat,
) -> wgpu::RenderPipeline {
    let layout = context
        .device
        .create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some(entry),
            bind_group_layouts: &[Some(layout)],
            immediate_size: 0,
        });
    context
        .device
        .create_render_pipeline(&wgpu::RenderPipelineDescriptor {
            label: Some(entry),
            layout: Some(&layout),
            vertex: wgpu::VertexState {
                module: &shader.module,
                entry_point: Some("corner"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: Default::default(),
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &shader.module,
                entry_point: Some(entry),
                compilation_options: Default::default(),
                targets: &[Some(format.into())],
            }),
            multiview_mask: None,
            cache: None,
        })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn structs_match_the_shader() {
        crate::layout::check(
            &shader::present(),
            "PresentParameters",
            PresentParameters::FIELDS,
            size_of::<PresentParameters>(),
        );
    }
}
