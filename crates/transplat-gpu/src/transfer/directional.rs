//! The directional method. CPU twin: [`DirectionalTransfer::relight`].

use std::sync::{Arc, OnceLock};

use rayon::prelude::*;
use transplat_core::bake::strata::{DIRECTIONS, WORDS, directions};
use transplat_core::environment::MAX_SUNS;
use transplat_core::settings::optimizations::Optimization;
use transplat_core::sh::coefficient_count;
use transplat_core::transfer::directional::{DirectionalLight, DirectionalTransfer, TURNS, WIDTHS};
use transplat_core::transfer::{Part, Relit};
use wgpu::BufferUsages;

use crate::context::{ComputePass, Context, Result};
use crate::layout::gpu_struct;
use crate::trace::ResidentTracer;
use crate::{CHUNK, shader};

gpu_struct! {
    in "transfer_directional";
    /// Range of surfels of a chunk.
    struct DirectionalChunk {
        count: u32,
        first: u32,
    }

    /// Settings that change with the light.
    struct DirectionalSettings {
        least: [f32; 3],
        suns: u32,
        start: [f32; 3],
        box_count: u32,
        diffuse: f32,
        mirrored: f32,
        residual: f32,
        near: f32,
        shadow: u32,
        two_sided: u32,
        trust: f32,
        unused: u32,
        undamped: [f32; 3],
        unused_b: u32,
    }

    /// Light from one direction.
    struct DirectionalLightSample {
        direction: [f32; 3],
        unused_a: u32,
        energy: [f32; 3],
        unused_b: u32,
    }

    /// Inputs of a surfel besides its colours.
    struct DirectionalSurfel {
        normal: [f32; 3],
        two_sided: f32,
        position: [f32; 3],
        minor: f32,
        own_normal: [f32; 3],
        major: f32,
        front_divisor: [f32; 3],
        first_hit: u32,
        back_divisor: [f32; 3],
        end_hit: u32,
        front_mean: [f32; 3],
        width: u32,
        back_mean: [f32; 3],
        has_fresnel: u32,
        reflectance: [f32; 3],
        emission_share: f32,
        encoded_mean: [f32; 3],
        unused_b: u32,
        open: [u32; 2 * WORDS],
    }
}

/// A pass with its bindings to each chunk that it has work in.
struct Step {
    pass: Arc<ComputePass>,
    groups: Vec<Option<wgpu::BindGroup>>,
}

/// Bytes that every adapter binds.
const EVERY_BINDING: usize = 128 << 20;

/// Storage buffers of the pass that has the most of them.
const MOST_BUFFERS: u32 = 8;

/// Buffers that all chunks share.
struct Shared {
    settings: wgpu::Buffer,
    light_samples: wgpu::Buffer,
    directions: wgpu::Buffer,
    tables: wgpu::Buffer,
    /// Radiance of each surfel's two sides, before a bounce and after it.
    radiance: [wgpu::Buffer; 2],
}

/// A prepared transfer on the GPU: a new light is one small upload and a few dispatches a chunk.
pub struct GpuDirectional {
    context: Arc<Context>,
    pub(crate) prepared: Arc<DirectionalTransfer>,
    shared: Shared,
    chunks: Vec<ChunkBuffers>,
    gather: Step,
    /// From the first radiance to the second, and back.
    bounce: [Step; 2],
    finish: Step,
    /// Where any surfel has two sides.
    add_back: Option<Step>,
    /// With how many boxes there are; compiled and uploaded with the first sun.
    see_suns: OnceLock<(Step, usize)>,
}

impl GpuDirectional {
    /// Uploads what does not change with the light.
    ///
    /// # Errors
    /// It is too large for the adapter, or the driver failed.
    pub fn new(context: &Arc<Context>, prepared: &Arc<DirectionalTransfer>) -> Result<Self> {
        Self::in_chunks(context, prepared, CHUNK)
    }

    /// Uploads in chunks of that many surfels at most.
    ///
    /// # Errors
    /// As [`GpuDirectional::new`].
    pub fn in_chunks(
        context: &Arc<Context>,
        prepared: &Arc<DirectionalTransfer>,
        chunk: usize,
    ) -> Result<Self> {
        let asset = &prepared.asset;
        let n = asset.bake.len();
        context.check_bindings("preset best", MOST_BUFFERS)?;
        // Of high degrees, the colours at the nodes would outgrow what every adapter binds.
        let chunk = chunk
            .min(CHUNK)
            .min(EVERY_BINDING / (12 * asset.nodes.count()));
        context.check_fits("what the Gaussians radiate", 32 * n)?;
        ResidentTracer::check_fits(context, &asset.bake.tracer)?;
        let directions: Vec<[f32; 4]> = directions()
            .iter()
            .map(|d| d.extend(0.0).to_array())
            .collect();
        let tables = shader::tables(&asset.nodes).0;
        let no_beams = [DirectionalLightSample::default(); MAX_SUNS + DIRECTIONS];
        let shared = Shared {
            settings: context.upload(&[DirectionalSettings::default()], BufferUsages::UNIFORM),
            light_samples: context.upload(&no_beams, BufferUsages::UNIFORM),
            directions: context.upload(&directions, BufferUsages::UNIFORM),
            tables: context.upload(&tables, BufferUsages::STORAGE),
            radiance: [0, 1].map(|_| context.storage(32 * n)),
        };
        let upload = |first| ChunkBuffers::upload(context, prepared, first, chunk.min(n - first));
        let chunks: Vec<ChunkBuffers> = (0..n).step_by(chunk).map(upload).collect();
        let source = shader::transfer_directional(&asset.nodes, asset.encoding);
        let adds_back = prepared.settings.terms.two_sided && chunks.iter().any(|c| c.has_two_sides);
        let entries = ["gather", "bounce", "finish", "add_back"];
        context.compile_together(&source, &entries[..3 + usize::from(adds_back)]);
        let step = |entry, from| {
            let pass = context.compute_pass(&source, entry);
            let bind = |chunk: &ChunkBuffers| {
                let has_work = entry != "add_back" || chunk.has_two_sides;
                has_work.then(|| chunk.bind(context, &pass, &shared, from, &[]))
            };
            let groups = chunks.iter().map(bind).collect();
            Step { pass, groups }
        };
        let (gather, finish) = (step("gather", 1), step("finish", TURNS % 2));
        let bounce = [0, 1].map(|from| step("bounce", from));
        let add_back = adds_back.then(|| step("add_back", 0));
        context.wait()?;
        Ok(Self {
            context: context.clone(),
            prepared: prepared.clone(),
            shared,
            chunks,
            gather,
            bounce,
            finish,
            add_back,
            see_suns: OnceLock::new(),
        })
    }

    /// Says which surfels nobody sees, `[n]` or empty: their colour is not worked out from then on.
    pub fn set_unseen(&self, unseen: &[bool]) {
        let mut first = 0;
        for chunk in &self.chunks {
            let mut bits = vec![0u32; CHUNK / 32];
            for i in 0..chunk.count {
                let is_unseen = unseen.get(first + i).is_some_and(|u| *u);
                bits[i / 32] |= u32::from(is_unseen) << (i % 32);
            }
            let queue = &self.context.queue;
            queue.write_buffer(&chunk.unseen, 0, bytemuck::cast_slice(&bits));
            first += chunk.count;
        }
    }

    /// Makes what suns need, before there is one.
    pub fn prepare_suns(&self) {
        self.see_suns();
    }

    fn see_suns(&self) -> &(Step, usize) {
        self.see_suns.get_or_init(|| {
            let (context, asset) = (&self.context, &self.prepared.asset);
            let tracer = ResidentTracer::upload(context, &asset.bake.tracer);
            let source = shader::transfer_directional(&asset.nodes, asset.encoding);
            let pass = context.compute_pass(&source, "see_suns");
            let traced = [("boxes", &tracer.boxes), ("discs", &tracer.discs)];
            let bind = |c: &ChunkBuffers| Some(c.bind(context, &pass, &self.shared, 0, &traced));
            let groups = self.chunks.iter().map(bind).collect();
            (Step { pass, groups }, tracer.box_count)
        })
    }

    /// Relights without waiting: what is submitted afterwards sees the result.
    pub fn submit(&self, light: &DirectionalLight, part: Part) {
        let terms = self.prepared.settings.terms;
        let see_suns = (!light.suns.is_empty()).then(|| self.see_suns());
        let settings = DirectionalSettings {
            least: light.least,
            suns: light.suns.len() as u32,
            start: self.prepared.mean_ratio(light.mean),
            box_count: see_suns.map_or(0, |(_, boxes)| *boxes as u32),
            diffuse: f32::from(part != Part::Specular),
            mirrored: f32::from(part != Part::Diffuse),
            residual: f32::from(part == Part::Whole && terms.residual),
            near: f32::from(terms.bounce),
            shadow: u32::from(terms.shadow),
            two_sided: u32::from(terms.two_sided),
            trust: self.prepared.trust,
            undamped: self.prepared.undamped(light.user_gain),
            ..Default::default()
        };
        let mut light_samples = [DirectionalLightSample::default(); MAX_SUNS + DIRECTIONS];
        let (suns, sky) = light_samples.split_at_mut(MAX_SUNS);
        let suns = suns.iter_mut().zip(&light.suns);
        for (to, from) in suns.chain(sky.iter_mut().zip(&light.sky)) {
            to.direction = from.direction.to_array();
            to.energy = from.energy;
        }
        let queue = &self.context.queue;
        queue.write_buffer(&self.shared.settings, 0, bytemuck::bytes_of(&settings));
        queue.write_buffer(
            &self.shared.light_samples,
            0,
            bytemuck::cast_slice(&light_samples),
        );
        if let Some((see_suns, _)) = see_suns {
            self.run(see_suns);
        }
        self.run(&self.gather);
        // One turn or TURNS: both are odd, and end in the same buffer.
        for turn in 0..self.prepared.turns() {
            self.run(&self.bounce[turn % 2]);
        }
        self.run(&self.finish);
        if let (Some(add_back), true) = (&self.add_back, part != Part::Specular) {
            self.run(add_back);
        }
    }

    /// Takes a result that was made elsewhere: colour `[n][K]` and tau `[n]`.
    pub fn write(&self, colors: &[[f32; 3]], taus: &[[f32; 3]]) {
        let k = coefficient_count(self.prepared.asset.nodes.degree);
        let (queue, mut first) = (&self.context.queue, 0);
        for chunk in &self.chunks {
            let own = first..first + chunk.count;
            let sh = &colors[own.start * k..own.end * k];
            queue.write_buffer(&chunk.relit, 0, bytemuck::cast_slice(sh));
            // What shows the ratio asks the front.
            let sides = |tau: &[f32; 3]| [[tau[0], tau[1], tau[2], 0.0]; 2];
            let tau: Vec<[[f32; 4]; 2]> = taus[own.clone()].iter().map(sides).collect();
            queue.write_buffer(&chunk.tau, 0, bytemuck::cast_slice(&tau));
            first = own.end;
        }
    }

    /// A submission a chunk: drivers stop work that takes seconds.
    fn run(&self, step: &Step) {
        for (chunk, group) in self.chunks.iter().zip(&step.groups) {
            if let Some(group) = group {
                self.context.run_each(&step.pass, group, chunk.count);
            }
        }
    }

    /// The last result where it is: SH `[count][K][3]` of each chunk.
    pub(crate) fn relit(&self) -> Vec<wgpu::Buffer> {
        self.chunks.iter().map(|c| c.relit.clone()).collect()
    }

    /// Change of the matte light of each surfel's two sides: a vector a side, `[count][2]` of each chunk.
    pub(crate) fn tau(&self) -> Vec<wgpu::Buffer> {
        self.chunks.iter().map(|c| c.tau.clone()).collect()
    }

    /// The last result; of surfels that nobody sees it holds nothing in particular.
    ///
    /// # Errors
    /// The driver failed.
    pub fn read(&self) -> Result<Relit> {
        let k = coefficient_count(self.prepared.asset.nodes.degree);
        let (mut sh, mut tau) = (Vec::new(), Vec::new());
        for chunk in &self.chunks {
            let read: Vec<[f32; 3]> = self.context.read(&chunk.relit, chunk.count * k)?;
            sh.extend(read);
            let read: Vec<[[f32; 4]; 2]> = self.context.read(&chunk.tau, chunk.count)?;
            tau.extend(read.iter().map(|[[r, g, b, _], _]| [*r, *g, *b]));
        }
        Ok(Relit {
            sh,
            degree: self.prepared.asset.nodes.degree,
            encoding: self.prepared.asset.encoding,
            tau,
            shadows: Vec::new(),
        })
    }
}

/// Surfels of a chunk, and what they meet.
fn surfels_of(
    p: &DirectionalTransfer,
    first: usize,
    count: usize,
) -> (Vec<DirectionalSurfel>, Vec<u32>) {
    let bake = &p.asset.bake;
    let terms = p.settings.terms;
    let mut hits = Vec::new();
    let surfels = (first..first + count)
        .map(|i| {
            let first_hit = hits.len() as u32;
            if terms.shadow && terms.bounce {
                hits.extend(bake.directional_visibility.hits_of(i).iter().map(|h| h.0));
            }
            let surfel = &bake.tracer.surfels[i];
            let ([front_divisor, back_divisor], [front_mean, back_mean]) =
                (p.divisor[i], p.asset.means[i]);
            let specular_lobe = &p.specular_lobe[i];
            DirectionalSurfel {
                emission_share: p.emission_share_of(i),
                normal: bake.normals[i].to_array(),
                two_sided: bake.two_sided[i],
                position: surfel.position.to_array(),
                minor: surfel.minor,
                own_normal: surfel.normal.to_array(),
                major: surfel.major,
                front_divisor,
                first_hit,
                back_divisor,
                end_hit: hits.len() as u32,
                front_mean,
                width: match specular_lobe.is_diffuse() {
                    true if p.settings.optimizations.has(Optimization::DiffuseSurfels) => 0,
                    true => WIDTHS[0],
                    false => specular_lobe.width,
                },
                back_mean,
                has_fresnel: u32::from(specular_lobe.has_fresnel),
                reflectance: specular_lobe.reflectance,
                encoded_mean: p.encoded_mean[i],
                open: if terms.shadow {
                    bytemuck::cast(*bake.directional_visibility.open_of(i))
                } else {
                    [u32::MAX; 2 * WORDS]
                },
                ..Default::default()
            }
        })
        .collect();
    (surfels, hits)
}

/// Some of the surfels.
struct ChunkBuffers {
    count: usize,
    has_two_sides: bool,
    parameters: wgpu::Buffer,
    surfels: wgpu::Buffer,
    hits: wgpu::Buffer,
    diffuse: wgpu::Buffer,
    residual: wgpu::Buffer,
    /// Stored colour, where a surfel has two sides.
    stored: wgpu::Buffer,
    irradiance: wgpu::Buffer,
    tau: wgpu::Buffer,
    unseen: wgpu::Buffer,
    relit: wgpu::Buffer,
}

impl ChunkBuffers {
    fn upload(context: &Context, p: &DirectionalTransfer, first: usize, count: usize) -> Self {
        let k = coefficient_count(p.asset.nodes.degree);
        let q = p.asset.nodes.count();
        let (mut diffuse, mut residual) = (vec![[0f32; 3]; count * q], vec![[0f32; 3]; count * k]);
        let rows = diffuse.par_chunks_exact_mut(q);
        let rows = rows.zip(residual.par_chunks_exact_mut(k)).enumerate();
        rows.for_each_init(Vec::new, |read, (at, (diffuse, residual))| {
            diffuse.copy_from_slice(&p.diffuse_of(first + at, read));
            residual.copy_from_slice(p.residual_of(first + at, read));
        });
        let (surfels, hits) = surfels_of(p, first, count);
        let has_two_sides = surfels.iter().any(|s| s.two_sided > 0.0);
        let parameters = DirectionalChunk {
            count: count as u32,
            first: first as u32,
        };
        let of_two_sides = if has_two_sides { count * k } else { 0 };
        let storage = BufferUsages::STORAGE;
        Self {
            count,
            has_two_sides,
            parameters: context.upload(&[parameters], BufferUsages::UNIFORM),
            surfels: context.upload(&surfels, storage),
            hits: context.upload(&hits, storage),
            diffuse: context.upload(&diffuse, storage),
            residual: context.upload(&residual, storage),
            stored: context.upload(&p.asset.sh[first * k..][..of_two_sides], storage),
            irradiance: context.storage(32 * count),
            tau: context.storage(32 * count),
            unseen: context.upload(&[0u32; CHUNK / 32], BufferUsages::UNIFORM),
            relit: context.storage(12 * count * k),
        }
    }

    /// Binds a pass, which reads what surfels radiate from one of the two buffers and writes it to the other.
    fn bind(
        &self,
        context: &Context,
        pass: &ComputePass,
        shared: &Shared,
        from: usize,
        more: &[(&str, &wgpu::Buffer)],
    ) -> wgpu::BindGroup {
        let all = [
            ("chunk", &self.parameters),
            ("settings", &shared.settings),
            ("light_samples", &shared.light_samples),
            ("directions", &shared.directions),
            ("tables", &shared.tables),
            ("radiance", &shared.radiance[from]),
            ("next_radiance", &shared.radiance[1 - from]),
            ("surfels", &self.surfels),
            ("hits", &self.hits),
            ("diffuse", &self.diffuse),
            ("residual", &self.residual),
            ("stored", &self.stored),
            ("irradiance", &self.irradiance),
            ("tau", &self.tau),
            ("unseen", &self.unseen),
            ("relit", &self.relit),
        ];
        context.bind(pass, &[&all[..], more].concat())
    }
}
