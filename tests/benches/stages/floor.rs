//! How quick a stage could be at best: what it has to move and to compute, by what this machine moves and computes.

use std::time::Instant;

use eframe::wgpu::{BufferDescriptor, BufferUsages};
use multiversion::multiversion;
use rayon::prelude::*;
use transplat_core::bake::strata::{DIRECTIONS, STRATA};
use transplat_core::sh::coefficient_count;
use transplat_core::transfer::directional::QuadratureNodes;
use transplat_gpu::Context;

/// What a stage cannot do without: each value read or written once, operations on 32-bit floats.
#[derive(Clone, Copy, Debug)]
pub struct Work {
    /// Read and written.
    pub bytes: f64,
    /// A multiplication and an addition are two.
    pub operations: f64,
}

/// What a machine can do in a second.
#[derive(Clone, Copy, Debug)]
pub struct Rates {
    bytes: f64,
    operations: f64,
}

impl Rates {
    /// The quickest that the work can be done at these rates, in ms.
    pub fn floor_ms(&self, work: Work) -> f64 {
        1e3 * (work.bytes / self.bytes).max(work.operations / self.operations)
    }

    /// Gigabytes and giga-operations a second.
    pub fn told(&self) -> String {
        let operations = match self.operations.is_finite() {
            true => format!(", {:.0} G operations/s", self.operations * 1e-9),
            false => String::new(),
        };
        format!("{:.1} GB/s{operations}", self.bytes * 1e-9)
    }

    /// Of all cores: a long copy, and sums of products in registers.
    pub fn of_cpu() -> Self {
        const COPIED: usize = 1 << 26;
        const TURNS: usize = 1 << 22;
        let source = vec![1u32; COPIED];
        let mut target = vec![0u32; COPIED];
        let copy = best(|| {
            let parts = target.par_chunks_mut(1 << 18);
            (parts.zip(source.par_chunks(1 << 18))).for_each(|(to, from)| to.copy_from_slice(from));
        });
        let threads = rayon::current_num_threads();
        let compute = best(|| {
            let all = (0..threads)
                .into_par_iter()
                .map(|i| products(TURNS, i as f32));
            std::hint::black_box(all.sum::<f32>());
        });
        Self {
            bytes: 2.0 * size_of_val(&source[..]) as f64 / copy,
            operations: (2 * LANES * TURNS * threads) as f64 / compute,
        }
    }

    /// Of an adapter: a long copy. How much it computes is not asked.
    pub fn of_gpu(context: &Context) -> Self {
        const COPIED: u64 = 1 << 26;
        let (device, queue) = context.device();
        let buffer = |usage| {
            device.create_buffer(&BufferDescriptor {
                label: Some("copied"),
                size: COPIED,
                usage,
                mapped_at_creation: false,
            })
        };
        let [source, target] = [BufferUsages::COPY_SRC, BufferUsages::COPY_DST].map(buffer);
        let copies = 16;
        let copy = best(|| {
            let mut encoder = device.create_command_encoder(&Default::default());
            for _ in 0..copies {
                encoder.copy_buffer_to_buffer(&source, 0, &target, 0, COPIED);
            }
            queue.submit([encoder.finish()]);
            context.finish(&context.last_submission());
        });
        Self {
            bytes: (2 * copies * COPIED) as f64 / copy,
            operations: f64::INFINITY,
        }
    }
}

/// The least of some times, in seconds.
fn best(mut work: impl FnMut()) -> f64 {
    let times = (0..7).map(|_| {
        let start = Instant::now();
        work();
        start.elapsed().as_secs_f64()
    });
    times.fold(f64::INFINITY, f64::min)
}

/// So many sums at once that none waits for the last.
const LANES: usize = 128;

#[multiversion(targets("x86_64+avx512f+avx512vl+avx512dq", "x86_64+avx2+fma", "aarch64+neon"))]
fn products(turns: usize, seed: f32) -> f32 {
    let mut sums = [seed; LANES];
    let (a, b) = std::hint::black_box((0.999f32, 0.001f32));
    for _ in 0..turns {
        for sum in &mut sums {
            *sum = sum.mul_add(a, b);
        }
    }
    sums.iter().sum()
}

/// What a colour takes.
const COLOR: usize = 12;

/// Place, tangents, normal, scales, opacity and thickness of a surfel.
const GEOMETRY: usize = 60;

/// A stage's work of some surfels whose colour has that many coefficients.
#[derive(Clone, Copy)]
pub struct WorkOf {
    pub surfels: usize,
    pub degree: usize,
}

impl WorkOf {
    fn each(self, bytes: usize, operations: usize) -> Work {
        let n = self.surfels as f64;
        Work {
            bytes: n * bytes as f64,
            operations: n * operations as f64,
        }
    }

    fn color(self) -> usize {
        COLOR * coefficient_count(self.degree)
    }

    /// A file's rows, and what is kept of them.
    pub fn file(self) -> Work {
        self.each(2 * (GEOMETRY + self.color()), 0)
    }

    /// A ray for each surfel and direction, which tests two boxes a level of a binary tree with 14 operations each.
    pub fn bake(self) -> Work {
        let levels = self.surfels.max(2).ilog2() as usize;
        self.each(DIRECTIONS / 8 + 4 * STRATA, DIRECTIONS * levels * 28)
    }

    /// The source's light, and a fit of the colour to the nodes and back.
    pub fn prepare(self) -> Work {
        let nodes = QuadratureNodes::count_of(self.degree);
        let fit = 2 * 2 * 3 * nodes * coefficient_count(self.degree);
        let read = self.color() + DIRECTIONS / 8;
        self.each(read + 2 * self.color(), IRRADIANCE + fit)
    }

    /// The light on each surfel, and its colour anew.
    pub fn transfer(self) -> Work {
        let read = 2 * self.color() + DIRECTIONS / 8;
        self.each(read + self.color(), IRRADIANCE)
    }

    /// Depths and their order.
    pub fn sort(self) -> Work {
        self.each(COLOR + 4, 5)
    }

    /// A series of SH each.
    pub fn shade(self) -> Work {
        self.each(
            COLOR + self.color() + COLOR,
            6 * coefficient_count(self.degree),
        )
    }

    /// What is drawn of each, put where it is drawn from.
    pub fn project(self) -> Work {
        self.each(GEOMETRY + 64, 150)
    }

    /// A picture: each surfel read and coloured, each pixel written.
    pub fn draw(self, pixels: usize) -> Work {
        let mut work = self.each(
            GEOMETRY + self.color(),
            150 + 6 * coefficient_count(self.degree),
        );
        work.bytes += 16.0 * pixels as f64;
        work
    }
}

/// Of the sky on a surfel, in operations: a cosine and three sums for each direction.
const IRRADIANCE: usize = DIRECTIONS * (5 + 6);
