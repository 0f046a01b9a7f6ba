//! GPU context: adapter, limits, pipelines, buffers, submission, readback, errors.

mod kept;
mod pass;

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};
use std::panic::Location;
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::thread::ThreadId;

use wgpu::naga;

use kept::KeptPipelines;
use pass::{Bindings, Shader, bindings_of};
pub(crate) use pass::{ComputePass, Draws, Pass, RenderPass};

use crate::WORKGROUP;
use crate::shader::SORT_WORKGROUP;

/// Error of the GPU.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum GpuError {
    /// There is no usable adapter.
    #[error("no usable graphics adapter: {0}")]
    NoAdapter(String),
    /// The asset or picture does not fit what the adapter can bind.
    #[error(
        "{what} needs {needed} bytes in one buffer and {adapter} offers {available}; the commands can do it on the CPU (--device cpu)"
    )]
    TooLarge {
        /// Resource that is too large.
        what: &'static str,
        /// Bytes needed.
        needed: u64,
        /// Bytes that the adapter binds.
        available: u64,
        /// Its name.
        adapter: String,
    },
    /// The driver reported an error or was lost.
    #[error("the graphics driver failed: {0}")]
    Driver(String),
    /// It is done on the CPU alone.
    #[error("{0} on the CPU alone")]
    OnCpu(&'static str),
    /// The caller's progress callback asked to stop.
    #[error("cancelled")]
    Cancelled,
}

/// `Result` with [`GpuError`].
pub type Result<T, E = GpuError> = std::result::Result<T, E>;

/// Something that was submitted.
#[derive(Clone, Debug)]
pub struct Submission(wgpu::SubmissionIndex);

/// A device with its queue and limits.
#[derive(Debug)]
pub struct Context {
    pub(crate) device: wgpu::Device,
    pub(crate) queue: wgpu::Queue,
    /// Format of colour targets: f32 where it can be blended.
    pub(crate) color_format: wgpu::TextureFormat,
    /// Format of the depth channel's target.
    pub(crate) depth_format: wgpu::TextureFormat,
    adapter: wgpu::Adapter,
    /// The first error of each thread since it last asked: validation tells them on the thread that made them.
    errors: Arc<Mutex<HashMap<ThreadId, String>>>,
    lost: Arc<AtomicBool>,
    /// Compiled pipelines by source and entry point.
    passes: Mutex<HashMap<(String, String), Arc<ComputePass>>>,
    /// By source.
    shaders: Mutex<HashMap<String, Arc<Shader>>>,
    /// Compiled ones of earlier starts, where they are kept.
    kept: Option<KeptPipelines>,
}

impl Drop for Context {
    fn drop(&mut self) {
        if let Some(kept) = &self.kept {
            kept.write();
        }
    }
}

/// Limits and features that this program requests of an adapter: all that it offers, since a splat may be large.
pub fn device_descriptor(adapter: &wgpu::Adapter) -> wgpu::DeviceDescriptor<'static> {
    wgpu::DeviceDescriptor {
        label: Some("transplat"),
        required_features: adapter.features()
            & (wgpu::Features::FLOAT32_BLENDABLE | wgpu::Features::PIPELINE_CACHE),
        required_limits: adapter.limits(),
        ..Default::default()
    }
}

/// The best of some adapters, software drivers last, as [`Context::new`] chooses it.
///
/// # Errors
/// There is none that can do what this program needs; says what each lacks.
pub fn choose_adapter(adapters: &[wgpu::Adapter]) -> Result<wgpu::Adapter> {
    let capable = adapters.iter().filter(|a| is_capable(a));
    let best = capable.max_by_key(|a| rank(&a.get_info()));
    best.cloned().ok_or_else(|| {
        let names: Vec<String> = adapters.iter().map(|a| a.get_info().name).collect();
        GpuError::NoAdapter(if names.is_empty() {
            "no graphics driver was found; install one (on Debian: apt-get install libvulkan1 mesa-vulkan-drivers)".into()
        } else {
            format!(
                "{} cannot run compute shaders with six storage buffers of 128 MiB and blend float images; a newer driver may",
                names.join(", ")
            )
        })
    })
}

/// Rank of an adapter: GL only where nothing better is there.
fn rank(info: &wgpu::AdapterInfo) -> (bool, u8) {
    let rank = match info.device_type {
        wgpu::DeviceType::DiscreteGpu => 4,
        wgpu::DeviceType::IntegratedGpu => 3,
        wgpu::DeviceType::VirtualGpu => 2,
        wgpu::DeviceType::Other => 1,
        wgpu::DeviceType::Cpu => 0,
    };
    (info.backend != wgpu::Backend::Gl, rank)
}

impl Context {
    /// Opens the best adapter: a discrete GPU before an integrated one, and a software driver last, if it may count at all.
    ///
    /// # Errors
    /// There is none, or it cannot blend floats or run compute shaders.
    pub fn new(allow_software: bool) -> Result<Self> {
        let best = |backends| {
            let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
            descriptor.flags = wgpu::InstanceFlags::empty();
            descriptor.backends = backends;
            let instance = wgpu::Instance::new(descriptor);
            let mut adapters = pollster::block_on(instance.enumerate_adapters(backends));
            let software = wgpu::DeviceType::Cpu;
            adapters.retain(|a| allow_software || a.get_info().device_type != software);
            choose_adapter(&adapters).ok()
        };
        // GL only where nothing better is there: its libraries write to stderr when they are asked without a display.
        let adapter = best(wgpu::Backends::PRIMARY)
            .or_else(|| best(wgpu::Backends::GL))
            .ok_or_else(|| {
                GpuError::NoAdapter(if allow_software {
                    "install a Vulkan driver (on Debian: apt-get install libvulkan1 mesa-vulkan-drivers), or use --device cpu".into()
                } else {
                    "there is no GPU".into()
                })
            })?;
        Self::open(&adapter)
    }

    fn open(adapter: &wgpu::Adapter) -> Result<Self> {
        let (device, queue) =
            pollster::block_on(adapter.request_device(&device_descriptor(adapter)))
                .map_err(|e| GpuError::NoAdapter(e.to_string()))?;
        Ok(Self::from_device(adapter, device, queue))
    }

    /// Shares a device that was made from [`device_descriptor`], and takes over what is done with its errors.
    pub fn from_device(adapter: &wgpu::Adapter, device: wgpu::Device, queue: wgpu::Queue) -> Self {
        let errors = Arc::new(Mutex::new(HashMap::new()));
        let note = {
            let errors = errors.clone();
            move |text: String| {
                if let Ok(mut errors) = errors.lock() {
                    errors.entry(std::thread::current().id()).or_insert(text);
                }
            }
        };
        let note_lost = note.clone();
        let lost = Arc::new(AtomicBool::new(false));
        device.on_uncaptured_error(Arc::new(move |e| note(e.to_string())));
        device.set_device_lost_callback({
            let lost = lost.clone();
            move |_, text| {
                lost.store(true, Ordering::Relaxed);
                note_lost(format!("the graphics device was lost: {text}"));
            }
        });
        let wide = device
            .features()
            .contains(wgpu::Features::FLOAT32_BLENDABLE);
        Self {
            device,
            queue,
            adapter: adapter.clone(),
            lost,
            passes: Mutex::default(),
            shaders: Mutex::default(),
            kept: None,
            color_format: if wide {
                wgpu::TextureFormat::Rgba32Float
            } else {
                wgpu::TextureFormat::Rgba16Float
            },
            depth_format: if wide {
                wgpu::TextureFormat::R32Float
            } else {
                wgpu::TextureFormat::R16Float
            },
            errors,
        }
    }

    /// Keeps compiled pipelines in a folder, if there is one, as far as the driver hands them out, and takes those that were kept there.
    #[must_use]
    pub fn with_pipelines_in(mut self, folder: Option<&Path>) -> Self {
        let read = |folder| KeptPipelines::read(&self.adapter, &self.device, folder);
        self.kept = folder.and_then(read);
        self
    }

    /// True once the device is lost: nothing works on it any more.
    pub fn is_lost(&self) -> bool {
        // The driver's word is passed on only when somebody asks.
        let _ = self.device.poll(wgpu::PollType::Poll);
        self.lost.load(Ordering::Relaxed)
    }

    /// Gives the device up: as if the driver had lost it.
    pub fn destroy(&self) {
        self.device.destroy();
    }

    /// Last submission, to be waited for.
    pub fn last_submission(&self) -> Submission {
        Submission(self.queue.submit([]))
    }

    /// Waits for one submission, however much was submitted after it.
    pub fn finish(&self, submission: &Submission) {
        // That the device is lost meanwhile is told elsewhere.
        let _ = self.device.poll(wgpu::PollType::Wait {
            submission_index: Some(submission.0.clone()),
            timeout: None,
        });
    }

    /// Another device on the same adapter: work on it disturbs none on this one.
    ///
    /// # Errors
    /// The driver refuses it.
    pub fn sibling(&self) -> Result<Self> {
        let kept_in = self.kept.as_ref().map(KeptPipelines::folder);
        Ok(Self::open(&self.adapter)?.with_pipelines_in(kept_in))
    }

    /// The first error of this thread since it last asked, without waiting.
    pub fn take_error(&self) -> Option<GpuError> {
        self.take_error_text().map(GpuError::Driver)
    }

    fn take_error_text(&self) -> Option<String> {
        let mut errors = self.errors.lock().ok()?;
        errors.remove(&std::thread::current().id())
    }

    /// The device and its queue, for work that is nobody's stage.
    pub fn device(&self) -> (&wgpu::Device, &wgpu::Queue) {
        (&self.device, &self.queue)
    }

    /// Name of the adapter with its backend.
    pub fn name(&self) -> String {
        let info = self.adapter.get_info();
        format!("{} ({})", info.name, info.backend)
    }

    /// True for a driver that computes on the CPU.
    pub fn is_software(&self) -> bool {
        self.adapter.get_info().device_type == wgpu::DeviceType::Cpu
    }

    /// The longest edge of a texture.
    pub(crate) fn max_texture(&self) -> usize {
        self.device.limits().max_texture_dimension_2d as usize
    }

    /// Checks that a pass may bind so many storage buffers.
    pub(crate) fn check_bindings(&self, what: &'static str, needed: u32) -> Result<()> {
        let available = self.device.limits().max_storage_buffers_per_shader_stage;
        if needed > available {
            return Err(GpuError::Driver(format!(
                "{what} needs {needed} storage buffers and {} offers {available}",
                self.name()
            )));
        }
        Ok(())
    }

    /// Checks that a storage buffer fits into one binding.
    pub(crate) fn check_fits(&self, what: &'static str, bytes: usize) -> Result<()> {
        let limits = self.device.limits();
        let available = (limits.max_storage_buffer_binding_size).min(limits.max_buffer_size);
        if bytes as u64 > available {
            return Err(GpuError::TooLarge {
                what,
                needed: bytes as u64,
                available,
                adapter: self.name(),
            });
        }
        Ok(())
    }

    /// A pipeline, compiled when it is first asked for.
    pub(crate) fn compute_pass(&self, source: &str, entry: &str) -> Arc<ComputePass> {
        let key = (source.to_owned(), entry.to_owned());
        let kept = self.passes.lock().ok().and_then(|p| p.get(&key).cloned());
        kept.unwrap_or_else(|| {
            let pass = Arc::new(self.compile(source, entry));
            if let Ok(mut passes) = self.passes.lock() {
                passes.insert(key, pass.clone());
            }
            pass
        })
    }

    /// Compiles entry points of a source at the same time, which [`Context::compute_pass`] then has: a driver may take half a second for one.
    pub(crate) fn compile_together(&self, source: &str, entries: &[&str]) {
        let is_known = |entry: &&str| {
            let key = (source.to_owned(), (*entry).to_owned());
            self.passes.lock().is_ok_and(|p| p.contains_key(&key))
        };
        if entries.iter().all(is_known) {
            return;
        }
        // Parsed once for all of them.
        self.shader(source, entries);
        let error = std::thread::scope(|scope| {
            let compile = |entry| {
                scope.spawn(move || {
                    self.compute_pass(source, entry);
                    self.take_error_text()
                })
            };
            let running: Vec<_> = entries.iter().copied().map(compile).collect();
            // One that panicked is compiled again by whoever asks for it, and panics there.
            let ended = running.into_iter().map(|one| one.join());
            ended.filter_map(|error| error.ok().flatten()).next()
        });
        // It is told where they were asked for.
        if let (Some(error), Ok(mut noted)) = (error, self.errors.lock()) {
            noted.entry(std::thread::current().id()).or_insert(error);
        }
    }

    fn compile(&self, source: &str, entry: &str) -> ComputePass {
        let (module, bindings) = self.shader(source, &[entry]);
        let pipeline = self
            .device
            .create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some(entry),
                layout: None,
                module: &module,
                entry_point: Some(entry),
                compilation_options: Default::default(),
                cache: self.kept.as_ref().map(KeptPipelines::cache),
            });
        ComputePass {
            layout: pipeline.get_bind_group_layout(0),
            pipeline,
            bindings,
            label: entry.to_owned(),
        }
    }

    /// A pipeline that draws into targets: quads, or one triangle over all of them.
    pub(crate) fn render_pass(
        &self,
        source: &str,
        entry: &str,
        topology: wgpu::PrimitiveTopology,
        targets: &[wgpu::ColorTargetState],
    ) -> RenderPass {
        let (module, bindings) = self.shader(source, &["corner", entry]);
        let targets: Vec<_> = targets.iter().cloned().map(Some).collect();
        let descriptor = wgpu::RenderPipelineDescriptor {
            label: Some(entry),
            layout: None,
            vertex: wgpu::VertexState {
                module: &module,
                entry_point: Some("corner"),
                compilation_options: Default::default(),
                buffers: &[],
            },
            primitive: wgpu::PrimitiveState {
                topology,
                ..Default::default()
            },
            depth_stencil: None,
            multisample: Default::default(),
            fragment: Some(wgpu::FragmentState {
                module: &module,
                entry_point: Some(entry),
                compilation_options: Default::default(),
                targets: &targets,
            }),
            multiview_mask: None,
            cache: self.kept.as_ref().map(KeptPipelines::cache),
        };
        let pipeline = self.device.create_render_pipeline(&descriptor);
        RenderPass {
            layout: pipeline.get_bind_group_layout(0),
            pipeline,
            bindings,
            label: entry.to_owned(),
        }
    }

    /// A picture of one level that passes read.
    pub(crate) fn texture(
        &self,
        label: &str,
        size: [usize; 2],
        format: wgpu::TextureFormat,
        usage: wgpu::TextureUsages,
    ) -> wgpu::Texture {
        self.device.create_texture(&wgpu::TextureDescriptor {
            label: Some(label),
            size: extent(size),
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format,
            usage: usage | wgpu::TextureUsages::TEXTURE_BINDING,
            view_formats: &[],
        })
    }

    /// A shader, compiled when it is first asked for, and what some of its entry points are bound to.
    fn shader(&self, source: &str, entries: &[&str]) -> (wgpu::ShaderModule, Bindings) {
        let kept = (self.shaders.lock().ok()).and_then(|s| s.get(source).cloned());
        let shader = kept.unwrap_or_else(|| {
            let shader = Arc::new(self.compiled(source, entries));
            if let Ok(mut shaders) = self.shaders.lock() {
                shaders.insert(source.to_owned(), shader.clone());
            }
            shader
        });
        let uses = |used: &[String]| used.iter().any(|e| entries.contains(&&**e));
        let each = shader.bindings.iter();
        let bindings =
            each.map(|(name, (number, used))| (name.clone(), uses(used).then_some(*number)));
        (shader.module.clone(), bindings.collect())
    }

    fn compiled(&self, source: &str, entries: &[&str]) -> Shader {
        // Parsed once, for the driver and for the names. What does not parse is told by wgpu, in its own words.
        let (bindings, wgsl) = match naga::front::wgsl::parse_str(source) {
            Ok(module) => (
                bindings_of(&module).unwrap_or_default(),
                wgpu::ShaderSource::Naga(Cow::Owned(module)),
            ),
            Err(_) => (BTreeMap::default(), wgpu::ShaderSource::Wgsl(source.into())),
        };
        let descriptor = wgpu::ShaderModuleDescriptor {
            label: entries.last().copied(),
            source: wgsl,
        };
        Shader {
            module: self.device.create_shader_module(descriptor),
            bindings,
        }
    }

    /// A buffer with data, called by where it is made; an empty slice makes room for one element, as an array has at least.
    #[track_caller]
    pub(crate) fn upload<T: bytemuck::NoUninit>(
        &self,
        data: &[T],
        usage: wgpu::BufferUsages,
    ) -> wgpu::Buffer {
        let bytes = bytemuck::cast_slice(data);
        let room = bytes.len().max(size_of::<T>());
        let buffer = self.buffer(room, usage | wgpu::BufferUsages::COPY_DST);
        self.queue.write_buffer(&buffer, 0, bytes);
        buffer
    }

    /// A storage buffer to be written by a pass and read back.
    #[track_caller]
    pub(crate) fn storage(&self, bytes: usize) -> wgpu::Buffer {
        let copied = wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
        self.buffer(bytes, wgpu::BufferUsages::STORAGE | copied)
    }

    #[track_caller]
    fn buffer(&self, bytes: usize, usage: wgpu::BufferUsages) -> wgpu::Buffer {
        self.device.create_buffer(&wgpu::BufferDescriptor {
            label: Some(&label(Location::caller())),
            // None may be empty, and a binding holds an element of its array; none that a pass writes is larger.
            size: bytes.max(64).next_multiple_of(4) as u64,
            usage,
            // That would panic where there is no memory, instead of telling it at the next wait.
            mapped_at_creation: false,
        })
    }

    /// Anything bound to a pass by the names in WGSL, what it does not use left out.
    #[track_caller]
    pub(crate) fn bind_resources<P>(
        &self,
        pass: &Pass<P>,
        resources: &[(&str, wgpu::BindingResource<'_>)],
    ) -> wgpu::BindGroup {
        let entries: Vec<wgpu::BindGroupEntry<'_>> = resources
            .iter()
            .filter_map(|(name, resource)| {
                let known = pass.bindings.get(*name);
                debug_assert!(known.is_some(), "the shader has no {name}");
                Some(wgpu::BindGroupEntry {
                    binding: (*known?)?,
                    resource: resource.clone(),
                })
            })
            .collect();
        self.device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some(&label(Location::caller())),
            layout: &pass.layout,
            entries: &entries,
        })
    }

    /// Binds buffers alone.
    #[track_caller]
    pub(crate) fn bind<P>(
        &self,
        pass: &Pass<P>,
        buffers: &[(&str, &wgpu::Buffer)],
    ) -> wgpu::BindGroup {
        let resources: Vec<(&str, wgpu::BindingResource<'_>)> = buffers
            .iter()
            .map(|(name, buffer)| (*name, buffer.as_entire_binding()))
            .collect();
        self.bind_resources(pass, &resources)
    }

    pub(crate) fn encoder(&self) -> wgpu::CommandEncoder {
        self.device.create_command_encoder(&Default::default())
    }

    /// Runs `groups` workgroups of a pass alone.
    pub(crate) fn run(&self, pass: &ComputePass, group: &wgpu::BindGroup, groups: [usize; 3]) {
        let mut encoder = self.encoder();
        pass.dispatch(&mut encoder, group, groups);
        self.submit(encoder);
    }

    /// Runs a pass alone, a thread for each of so many.
    pub(crate) fn run_each(&self, pass: &ComputePass, group: &wgpu::BindGroup, count: usize) {
        self.run(pass, group, [count.div_ceil(WORKGROUP), 1, 1]);
    }

    pub(crate) fn submit(&self, encoder: wgpu::CommandEncoder) {
        self.queue.submit([encoder.finish()]);
    }

    /// Waits until everything submitted is done, and tells what went wrong with it.
    pub(crate) fn wait(&self) -> Result<()> {
        self.device
            .poll(wgpu::PollType::wait_indefinitely())
            .map_err(|e| GpuError::Driver(e.to_string()))?;
        if self.is_lost() {
            return Err(GpuError::Driver("the graphics device was lost".into()));
        }
        self.take_error().map_or(Ok(()), Err)
    }

    /// Copies the start of a buffer back.
    pub(crate) fn read<T: bytemuck::Pod>(
        &self,
        buffer: &wgpu::Buffer,
        count: usize,
    ) -> Result<Vec<T>> {
        let bytes = count * size_of::<T>();
        let size = bytes.next_multiple_of(4);
        let copy = |encoder: &mut wgpu::CommandEncoder, staging: &wgpu::Buffer| {
            encoder.copy_buffer_to_buffer(buffer, 0, staging, 0, size as u64);
        };
        self.read_back(size, copy, |read| {
            bytemuck::pod_collect_to_vec(&read[..bytes])
        })
    }

    /// Reads what is copied into a buffer of so many bytes, once everything submitted is done.
    pub(crate) fn read_back<R>(
        &self,
        bytes: usize,
        copy: impl FnOnce(&mut wgpu::CommandEncoder, &wgpu::Buffer),
        take: impl FnOnce(&[u8]) -> R,
    ) -> Result<R> {
        let usage = wgpu::BufferUsages::COPY_DST | wgpu::BufferUsages::MAP_READ;
        let staging = self.buffer(bytes, usage);
        let mut encoder = self.encoder();
        copy(&mut encoder, &staging);
        self.submit(encoder);
        staging.map_async(wgpu::MapMode::Read, .., |_| {});
        self.wait()?;
        let view = staging
            .get_mapped_range(..)
            .map_err(|e| GpuError::Driver(e.to_string()))?;
        Ok(take(&view))
    }
}

pub(crate) fn extent([width, height]: [usize; 2]) -> wgpu::Extent3d {
    wgpu::Extent3d {
        width: width as u32,
        height: height as u32,
        depth_or_array_layers: 1,
    }
}

/// The name of a resource in a debugger: file and line that made it.
fn label(made: &Location<'_>) -> String {
    let file = made.file().rsplit(['/', '\\']).next().unwrap_or_default();
    format!("{file}:{}", made.line())
}

/// Compute shaders, enough bindings, and float targets that blend.
fn is_capable(adapter: &wgpu::Adapter) -> bool {
    let limits = adapter.limits();
    let blends = |format: wgpu::TextureFormat| {
        adapter
            .get_texture_format_features(format)
            .flags
            .contains(wgpu::TextureFormatFeatureFlags::BLENDABLE)
    };
    let reads_storage_in_vertices = adapter
        .get_downlevel_capabilities()
        .flags
        .contains(wgpu::DownlevelFlags::VERTEX_STORAGE);
    reads_storage_in_vertices
        && limits.max_storage_buffers_per_shader_stage >= 6
        && limits.max_uniform_buffer_binding_size >= 64 << 10
        && limits.max_compute_invocations_per_workgroup as usize >= SORT_WORKGROUP
        && limits.max_compute_workgroup_size_x as usize >= SORT_WORKGROUP
        && limits.max_storage_buffer_binding_size >= 128 << 20
        && blends(wgpu::TextureFormat::Rgba16Float)
        && blends(wgpu::TextureFormat::R16Float)
}
