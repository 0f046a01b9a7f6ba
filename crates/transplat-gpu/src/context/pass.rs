//! A compiled pass, and how it runs.

use std::collections::BTreeMap;
use std::ops::Range;

use wgpu::naga;

/// Binding numbers by the names that WGSL gives them; none of what a pass does not use.
pub(super) type Bindings = BTreeMap<String, Option<u32>>;

/// A compiled file, and its bindings: their numbers, and the entry points that use them.
#[derive(Debug)]
pub(super) struct Shader {
    pub module: wgpu::ShaderModule,
    pub bindings: BTreeMap<String, (u32, Vec<String>)>,
}

/// A pipeline of one entry point, and what it is bound to by the names in WGSL.
#[derive(Debug)]
pub(crate) struct Pass<P> {
    pub(super) pipeline: P,
    pub(super) layout: wgpu::BindGroupLayout,
    pub(super) bindings: Bindings,
    pub(super) label: String,
}

pub(crate) type ComputePass = Pass<wgpu::ComputePipeline>;

/// Its vertices are made by `corner`.
pub(crate) type RenderPass = Pass<wgpu::RenderPipeline>;

/// Vertices that a pass draws.
pub(crate) enum Draws<'a> {
    /// Vertices of instances.
    Direct(Range<u32>, Range<u32>),
    /// Count from a buffer.
    Indirect(&'a wgpu::Buffer),
}

impl RenderPass {
    /// Draws into targets, over what is in them or cleared before.
    pub(crate) fn draw(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        targets: &[&wgpu::TextureView],
        load: wgpu::LoadOp<wgpu::Color>,
        group: &wgpu::BindGroup,
        draws: Draws<'_>,
    ) {
        let store = wgpu::StoreOp::Store;
        let attachments: Vec<_> = targets
            .iter()
            .map(|view| {
                Some(wgpu::RenderPassColorAttachment {
                    view,
                    depth_slice: None,
                    resolve_target: None,
                    ops: wgpu::Operations { load, store },
                })
            })
            .collect();
        let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
            label: Some(&self.label),
            color_attachments: &attachments,
            ..Default::default()
        });
        self.draw_in(&mut pass, group, &draws);
    }

    /// Draws in a pass that has begun.
    pub(crate) fn draw_in(
        &self,
        pass: &mut wgpu::RenderPass<'_>,
        group: &wgpu::BindGroup,
        draws: &Draws<'_>,
    ) {
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, group, &[]);
        match draws {
            Draws::Direct(vertices, instances) => pass.draw(vertices.clone(), instances.clone()),
            Draws::Indirect(count) => pass.draw_indirect(count, 0),
        }
    }
}

impl ComputePass {
    /// Runs `groups` workgroups.
    pub(crate) fn dispatch(
        &self,
        encoder: &mut wgpu::CommandEncoder,
        bind_group: &wgpu::BindGroup,
        groups: [usize; 3],
    ) {
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
            label: Some(&self.label),
            timestamp_writes: None,
        });
        pass.set_pipeline(&self.pipeline);
        pass.set_bind_group(0, bind_group, &[]);
        pass.dispatch_workgroups(groups[0] as u32, groups[1] as u32, groups[2] as u32);
    }
}

/// All bindings by name: their numbers, and which entry points use them, as wgpu finds it for a pipeline's layout.
pub(super) fn bindings_of(module: &naga::Module) -> Option<BTreeMap<String, (u32, Vec<String>)>> {
    let all = naga::valid::Capabilities::all();
    let mut validator = naga::valid::Validator::new(naga::valid::ValidationFlags::empty(), all);
    let info = validator.validate(module).ok()?;
    let each = (module.global_variables.iter()).filter_map(|(handle, global)| {
        let entries = module.entry_points.iter().enumerate();
        let using = entries.filter(|(i, _)| !info.get_entry_point(*i)[handle].is_empty());
        let using = using.map(|(_, entry)| entry.name.clone()).collect();
        Some((
            global.name.clone()?,
            (global.binding.as_ref()?.binding, using),
        ))
    });
    Some(each.collect())
}
