//! How long each stage takes by the number of surfels and pixels, on the CPU and on the GPU: `cargo xtask bench`.
//!
//! The assets are made up, so that every machine has the same ones: a rough ball over a slab, in two layers and with colour of degree 3, about
//! as many surfels behind a pixel as trained splats have.

mod floor;
mod measure;
mod subject;

use std::path::PathBuf;
use std::sync::Arc;

use clap::{Parser, ValueEnum};
use eframe::wgpu::TextureFormat;
use glam::{Affine3A, DMat3, Vec3};
use transplat_core::bake::Bake;
use transplat_core::bake::directional::DirectionalBake;
use transplat_core::camera::{Camera, first_pose};
use transplat_core::color::Display;
use transplat_core::environment::{EnvironmentMap, Illumination};
use transplat_core::files::{load_environment, load_splat, write_relit, write_splat};
use transplat_core::present::{Background, View, tau_colors};
use transplat_core::progress::no_progress;
use transplat_core::rasterize::{ColorSpace, depth_order, rasterize, shade};
use transplat_core::settings::{Method, TransferSettings};
use transplat_core::sh::MAX_DEGREE;
use transplat_core::surfels::{Bounds, SurfelCloud};
use transplat_core::transfer::{Part, PreparedTransfer};
use transplat_gpu::Context;
use transplat_gpu::bake::directional::GpuTracer;
use transplat_gpu::live::{Drawing, Frame, Live, LiveSh, LiveSplat, Placement};
use transplat_gpu::present::{BackdropLight, GroundPlane, Presentation};
use transplat_gpu::rasterize::{GpuRasterizer, Layer, ResidentPaint, ResidentSh, Target};
use transplat_gpu::transfer::GpuTransfer;
use transplat_tests::root;

use floor::{Rates, WorkOf};
use measure::{Bench, read_rows};
use subject::rough_ball_over_slab;

/// What is measured.
#[derive(Parser)]
#[command(name = "cargo xtask bench")]
struct Args {
    /// Surfels, such as 30k or 1M
    #[arg(long, value_delimiter = ',', value_parser = count, default_value = "10k,30k,100k,300k")]
    surfels: Vec<usize>,
    /// Splats of one's own in place of made-up ones
    #[arg(long, value_delimiter = ',')]
    assets: Vec<PathBuf>,
    /// Degrees of colour
    #[arg(long, value_delimiter = ',', value_parser = clap::value_parser!(u8).range(0..=3), default_value = "3")]
    degrees: Vec<u8>,
    /// Sizes of the picture
    #[arg(long, value_delimiter = ',', value_parser = size, default_value = "1280x720,1920x1080,3840x2160")]
    sizes: Vec<[usize; 2]>,
    #[arg(long, value_enum, default_value = "both")]
    device: Devices,
    /// Keep the figures
    #[arg(long)]
    json: Option<PathBuf>,
    /// Say how many times as long each took as in figures kept before
    #[arg(long)]
    compare: Option<PathBuf>,
    /// What cargo tells every benchmark
    #[arg(long, hide = true)]
    bench: bool,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Devices {
    Cpu,
    Gpu,
    Both,
}

/// A number that may end in k or M.
fn count(text: &str) -> Result<usize, String> {
    let (digits, unit) = match text.strip_suffix(['k', 'K']) {
        Some(digits) => (digits, 1e3),
        None => match text.strip_suffix('M') {
            Some(digits) => (digits, 1e6),
            None => (text, 1.0),
        },
    };
    let number: f64 = digits.parse().map_err(|_| "such as 30k or 1M".to_owned())?;
    let all = number * unit;
    (1e3..=2e7)
        .contains(&all)
        .then_some(all as usize)
        .ok_or("from 1k to 20M".into())
}

fn size(text: &str) -> Result<[usize; 2], String> {
    let edges: Option<Vec<usize>> = text.split('x').map(|e| e.parse().ok()).collect();
    match edges.as_deref() {
        Some(&[w @ 1..=8192, h @ 1..=8192]) => Ok([w, h]),
        _ => Err("such as 1280x720".into()),
    }
}

fn main() {
    let args = Args::parse();
    // Cargo runs benchmarks elsewhere; paths are those of the repository.
    std::env::set_current_dir(root()).expect("the repository is there");
    let before = args.compare.as_deref().map(read_rows).unwrap_or_default();
    let mut bench = Bench::new(before);
    let gpu = (args.device != Devices::Cpu).then(|| {
        Arc::new(Context::new(true).expect("a Vulkan driver; --device cpu measures without"))
    });
    if let Some(context) = &gpu {
        println!("{}", context.name());
    }
    println!(
        "{} threads",
        std::thread::available_parallelism().map_or(1, usize::from)
    );
    bench.device("cpu", Rates::of_cpu());
    if let Some(context) = &gpu {
        bench.device("gpu", Rates::of_gpu(context));
    }
    let maps = ["city", "sunset"].map(|name| {
        let path = root().join(format!("assets/{name}.hdr"));
        load_environment(&path).expect("it is bundled")
    });
    let lights = maps.each_ref().map(light);
    bench.at("environment", [0, 1024 * 512]);
    if args.device != Devices::Gpu {
        bench.time("cpu", "project environment", || light(&maps[1]));
    }
    if let Some(context) = &gpu {
        bench.time("gpu", "project environment", || {
            transplat_gpu::environment::project_environment(context, &maps[1], MAX_DEGREE)
                .expect("the driver works")
        });
    }
    let made_up = args.degrees.iter().flat_map(|degree| {
        let degree = usize::from(*degree);
        let each = args.surfels.iter();
        each.map(move |n| (format!("degree {degree}"), rough_ball_over_slab(*n, degree)))
    });
    let own = args.assets.iter().map(|path| {
        let (cloud, _) = load_splat(path).expect("a splat");
        (path.display().to_string(), cloud)
    });
    let subjects: Box<dyn Iterator<Item = (String, SurfelCloud)>> = match args.assets.is_empty() {
        true => Box::new(made_up),
        false => Box::new(own),
    };
    for (name, cloud) in subjects {
        let cloud = Arc::new(cloud);
        let subject = Subject {
            cloud: &cloud,
            bounds: cloud.bounds(),
            work: WorkOf {
                surfels: cloud.len(),
                degree: cloud.sh_degree,
            },
            lights: &lights,
            sizes: &args.sizes,
        };
        bench.at(&name, [cloud.len(), 0]);
        if args.device != Devices::Gpu {
            subject.files(&mut bench);
        }
        let bake = match &gpu {
            Some(context) => subject.bake_on(context, &mut bench),
            None => subject.bake(&mut bench),
        };
        if args.device == Devices::Both {
            subject.bake(&mut bench);
        }
        let settings = TransferSettings::of(Method::Directional);
        let prepared = bench
            .given(subject.work.prepare())
            .time("cpu", "prepare", || {
                PreparedTransfer::new(&cloud, &bake, &lights[0], &settings).expect("it fits")
            });
        if args.device != Devices::Gpu {
            subject.on_cpu(&prepared, &mut bench);
        }
        if let Some(context) = &gpu {
            subject.on_gpu(context, &prepared, &mut bench);
            subject.drawn_by_cpu(context, &prepared, &mut bench);
        }
    }
    bench.report_growth();
    if let Some(path) = &args.json {
        bench.write(path);
    }
}

/// A map's light, as the directional method needs it.
fn light(map: &EnvironmentMap) -> Illumination {
    Illumination::of(map, MAX_DEGREE)
}

struct Subject<'a> {
    cloud: &'a Arc<SurfelCloud>,
    bounds: Bounds,
    work: WorkOf,
    lights: &'a [Illumination; 2],
    sizes: &'a [[usize; 2]],
}

impl Subject<'_> {
    /// One camera after the other around the asset.
    fn orbit(&self, size: [usize; 2]) -> impl FnMut() -> Camera {
        let (up, bounds) = (self.cloud.up, self.bounds);
        let mut pose = first_pose(&self.cloud.positions, up, &bounds, size);
        move || {
            pose.azimuth += 7.0;
            Camera::from_pose(&pose, up, size, bounds.radius)
        }
    }

    fn files(&self, bench: &mut Bench) {
        let folder = tempfile::tempdir().expect("a folder for files that go away");
        let [path, out] = ["asset.ply", "relit.ply"].map(|name| folder.path().join(name));
        write_splat(self.cloud, &self.cloud.sh, &path).expect("there is room");
        let (loaded, file) = bench
            .given(self.work.file())
            .time("cpu", "load PLY", || load_splat(&path).expect("a splat"));
        bench.given(self.work.file()).time("cpu", "export PLY", || {
            write_relit(&file, &loaded, &loaded.sh, &out).expect("it can be written");
        });
    }

    fn bake(&self, bench: &mut Bench) -> Bake {
        bench.given(self.work.bake()).time("cpu", "bake", || {
            Bake::new(self.cloud, Method::Directional, 0, &no_progress).expect("nobody cancels")
        })
    }

    fn bake_on(&self, context: &Arc<Context>, bench: &mut Bench) -> Bake {
        let tracer = bench.time("cpu", "bake: boxes and fronts", || {
            DirectionalBake::tracer(self.cloud, &no_progress).expect("nobody cancels")
        });
        let baked = bench.given(self.work.bake()).time("gpu", "bake", || {
            let rays = GpuTracer::new(context, &tracer).expect("it fits");
            DirectionalBake::bake_by(
                self.cloud,
                &tracer,
                (&[1], &Default::default()),
                |strata, found, progress| {
                    rays.trace(strata, found, progress)
                        .map_err(|e| transplat_core::Error::Mismatch(e.to_string()))
                },
                &no_progress,
                |_, _| (),
            )
            .expect("nobody cancels")
        });
        Bake::Directional(Arc::new(baked))
    }

    fn on_cpu(&self, prepared: &PreparedTransfer, bench: &mut Bench) {
        let cloud = self.cloud;
        let mut last = None;
        let mut lights = self.lights.iter().cycle();
        bench
            .given(self.work.transfer())
            .time("cpu", "transfer", || {
                let light = lights.next().expect("it goes round");
                let relit = prepared.relight_after(last.take(), light, Part::Whole, &[]);
                last = Some(relit.expect("read for it"));
            });
        let surfels = cloud.len();
        for &size in self.sizes {
            bench.size([surfels, size[0] * size[1]]);
            let mut next = self.orbit(size);
            if size == self.sizes[0] {
                bench
                    .given(self.work.sort())
                    .time_of("cpu", "sort", &mut next, |camera| {
                        depth_order(&cloud.positions, &camera, &[])
                    });
                bench
                    .given(self.work.shade())
                    .time_of("cpu", "shade", &mut next, |camera| {
                        let (degree, encoding) = (cloud.sh_degree, cloud.encoding);
                        shade(
                            &cloud.positions,
                            &cloud.sh,
                            degree,
                            encoding,
                            camera.eye,
                            ColorSpace::Linear,
                        )
                    });
            }
            let colors = vec![[0.5; 3]; surfels];
            bench.given(self.work.draw(size[0] * size[1])).time_of(
                "cpu",
                "sort and draw",
                &mut next,
                |camera| rasterize(cloud, &camera, &colors, &[]),
            );
        }
    }

    fn on_gpu(&self, context: &Arc<Context>, prepared: &PreparedTransfer, bench: &mut Bench) {
        let cloud = self.cloud;
        let surfels = cloud.len();
        bench.size([surfels, 0]);
        let done = |context: &Context| context.finish(&context.last_submission());
        let asset = bench.time("gpu", "upload asset", || {
            LiveSplat::new(context, cloud, Drawing::Gpu).expect("it fits")
        });
        let transfer = bench.time("gpu", "upload transfer", || {
            GpuTransfer::new(context, prepared).expect("it fits")
        });
        let mut live = Live::new(context, TextureFormat::Rgba8Unorm, Drawing::Gpu);
        live.set_asset(0, asset).expect("it fits");
        live.set_transfer(0, transfer);
        bench
            .given(self.work.transfer())
            .time("gpu", "transfer", || {
                let relit = live.relight(0, &self.lights[1], Part::Whole, &[]);
                relit.expect("read for it");
                done(context);
            });
        let rasterizer = GpuRasterizer::new(context, cloud).expect("it fits");
        let sh = ResidentSh::upload(context, &cloud.sh, cloud.sh_degree, cloud.encoding);
        for &size in self.sizes {
            bench.size([surfels, size[0] * size[1]]);
            let mut next = self.orbit(size);
            if size == self.sizes[0] {
                bench
                    .given(self.work.sort())
                    .time_of("gpu", "sort", &mut next, |camera| {
                        rasterizer.sort(&camera, &[]);
                        done(context);
                    });
                bench
                    .given(self.work.project())
                    .time_of("gpu", "project", &mut next, |camera| {
                        rasterizer.project(&camera);
                        done(context);
                    });
                bench
                    .given(self.work.shade())
                    .time_of("gpu", "shade", &mut next, |camera| {
                        rasterizer.shade(
                            &camera,
                            ResidentPaint::Sh(&sh, Part::Whole),
                            ColorSpace::Linear,
                        );
                        done(context);
                    });
            }
            let camera = next();
            let order = rasterizer.sort(&camera, &[]);
            rasterizer.project(&camera);
            for (stage, has_depth) in [("draw", false), ("draw with depth", true)] {
                let target = Target::of_screen(context, size, has_depth);
                bench
                    .given(self.work.draw(size[0] * size[1]))
                    .time("gpu", stage, || {
                        rasterizer.draw_tile(&camera, Layer::default(), &order, &target);
                        done(context);
                    });
            }
            bench.given(self.work.draw(size[0] * size[1])).time_of(
                "gpu",
                "frame, camera moves",
                &mut next,
                |camera| {
                    live.frame(&self.frame(camera, size));
                    done(context);
                },
            );
            let camera = next();
            live.frame(&self.frame(camera, size));
            let mut lights = self.lights.iter().cycle();
            bench.time("gpu", "frame, light changes", || {
                let light = lights.next().expect("it goes round");
                live.relight(0, light, Part::Whole, &[])
                    .expect("read for it");
                live.frame(&self.frame(camera, size));
                done(context);
            });
        }
    }

    /// What the window does where the adapter is slower than the CPU.
    fn drawn_by_cpu(&self, context: &Arc<Context>, prepared: &PreparedTransfer, bench: &mut Bench) {
        let (cloud, drawing) = (self.cloud, Drawing::Cpu);
        let mut live = Live::new(context, TextureFormat::Rgba8Unorm, drawing);
        let asset = LiveSplat::new(context, cloud, drawing).expect("it fits");
        live.set_asset(0, asset).expect("it fits");
        let relit = prepared.relight(&self.lights[1], Part::Whole);
        let relit = Arc::new(drawing.kept(relit.expect("read for it")));
        let tau = tau_colors(&relit.tau);
        live.set_relit(0, LiveSh::new(context, &relit, drawing), tau);
        for &size in self.sizes {
            bench.size([cloud.len(), size[0] * size[1]]);
            let mut next = self.orbit(size);
            bench.given(self.work.draw(size[0] * size[1])).time_of(
                "cpu",
                "frame, camera moves",
                &mut next,
                |camera| {
                    live.frame(&self.frame(camera, size));
                    context.finish(&context.last_submission());
                },
            );
        }
    }

    fn frame(&self, camera: Camera, size: [usize; 2]) -> Frame {
        let light = BackdropLight {
            map_from_asset: DMat3::IDENTITY,
            gain: [1.0; 3],
        };
        Frame {
            presentation: Presentation {
                camera,
                size,
                view: View::After,
                wipe: 0.5,
                difference_scale: 1.0,
                display: Display::default(),
                graded: [None; 2],
                false_color: false,
                background: Background::Color([0.2; 3]),
                plate: [1; 2],
                lights: [light; 2],
                ground: GroundPlane {
                    center: Vec3::ZERO,
                    axes: [Vec3::X, Vec3::Y],
                    half: 1.0,
                    catches: false,
                    grid: None,
                },
                bounds: self.bounds,
                depth_unit: 1.0,
            },
            against_pinned: false,
            marks: false,
            pixel_step: 1,
            objects: vec![Placement {
                scene_from_object: Affine3A::IDENTITY,
                shown: true,
                ..Placement::default()
            }],
        }
    }
}
