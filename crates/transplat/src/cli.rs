//! The command line: a stable contract.

mod values;

use std::path::{Path, PathBuf};

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};
use transplat_core::color::ToneMap;
use transplat_core::environment::Layout;
use transplat_core::present::{Background, View};
use transplat_core::probe::DEFAULT_ROWS;
use transplat_core::scene::{Light, Scene};
use transplat_core::settings::{Method, Terms};
use transplat_core::surfels::UpAxis;

use transplat_engine::delight::DelitAs;
use transplat_engine::device::DeviceChoice;
use transplat_engine::output::ImageFormat;
use transplat_engine::video::FRAME_RATE;
pub use values::VIEWS;
use values::*;

/// Relight a captured object: a trained 2D Gaussian splat, the light it was captured in, any other light.
#[derive(Debug, Parser)]
#[command(
    disable_version_flag = true,
    args_conflicts_with_subcommands = true,
    after_help = "Examples:\n  transplat                              the viewer, with the bundled scene\n  transplat knot.ply city.hdr            the viewer, with a splat and a light to relight it by\n  transplat knot.ply --source city.hdr   the same, with the light it was captured under"
)]
pub struct Cli {
    /// Print the version, the commit that it was built from, and the graphics adapter that --device gpu takes
    #[arg(long, short = 'V')]
    pub version: bool,
    #[command(subcommand)]
    pub command: Option<Command>,
    #[command(flatten)]
    pub view: ViewArgs,
}

/// Without a command: the viewer.
#[derive(Debug, Args)]
pub struct ViewArgs {
    /// Splats, environments, folders of environments and looks, in any order; the bundled scene with none
    pub files: Vec<PathBuf>,
    #[command(flatten)]
    pub options: AssetOptions,
    #[command(flatten)]
    pub light: LightArgs,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write the asset as it looks under another light.
    #[command(
        after_help = "Example:\n  transplat relight knot.ply --source city.hdr --target sunset.hdr -o relit.ply"
    )]
    Relight(RelightArgs),
    /// Draw pictures of an asset, as captured or relit.
    #[command(
        after_help = "Example:\n  transplat render knot.ply --source city.hdr --target sunset.hdr --turntable 8 -o pictures\n\nPictures are named NNN.png by frame, from 000; with several targets in a folder for each. PNG is display-encoded with straight alpha; EXR is linear and premultiplied (and blended in linear light).\n\nA batch:\n  transplat render --batch shots.json --part 1/8 -o pictures\nshots.json: {\"splats\": [\"knot.ply\", {\"asset\": \"vase.ply\", \"source\": \"estimate\"}], \"source\": \"city.hdr\", \"lights\": [\"sunset.hdr\", \"hdris/\"], \"turntable\": 24}, with \"cameras\": FILE instead of a turntable and, where settings are wanted, \"look\": FILE. Paths are relative to it."
    )]
    Render(Box<RenderArgs>),
    /// Write a splat in another format, which the output's name says: .ply, .compressed.ply, .spz, .sog, .splat, .glb.
    #[command(
        after_help = "Example:\n  transplat convert playbot.ply -o playbot.spz\n\nWhat the format cannot hold is said. SPZ and glTF have +y up: what goes there from another format, or from there to another, is turned to stand upright there."
    )]
    Convert(ConvertArgs),
    /// Write the asset without its light: its albedo as its colour, for programs that light a splat themselves.
    #[command(
        after_help = "Examples:\n  transplat delight knot.ply --source city.hdr -o flat.ply\n  transplat delight knot.ply --source estimate --materials -o flat.glb\n\nAn albedo is of SH degree 0, encoded as the capture's colour; other properties of a PLY are not written. With --materials a PLY has the properties nx ny nz, base_color_0 to _2, metallic, roughness, reflectance_0 to _2 and emission_0 to _2, and a GLB the attributes NORMAL, _BASE_COLOR, _METALLIC, _ROUGHNESS, _REFLECTANCE and _EMISSION; colours are linear there, emission in the unit of the capture's pictures."
    )]
    Delight(DelightArgs),
    /// Bake an asset's visibility into a file, to be given to the other commands with --bake.
    #[command(after_help = "Example:\n  transplat bake knot.ply -o knot.bake")]
    Bake(BakeArgs),
    /// Estimate the light that an asset was captured under, from the asset alone.
    #[command(
        after_help = "Example:\n  transplat estimate knot.ply -o light.exr\n\nThe light is an equirectangular map, as --source and other programs take it; --source estimate does the same without a file. How strong the light was and its tint, no object tells: the mean is grey, and the whitest surface has an albedo of 0.65."
    )]
    Estimate(EstimateArgs),
    /// Take the light at a place in a scene, as the scene's own splat shows it: to relight by, or as the light of what was cut out there.
    #[command(
        after_help = "Examples:\n  transplat probe yard.ply --at 0.1,0.6,0.2 -o light.exr\n  transplat probe scene.json --at vase -o light.exr\n\nThe light is an equirectangular map, as --source and --target take it. A scene that was trained on display-encoded pictures ends at white: what was brighter is clipped, and the command says how much of the light that is."
    )]
    Probe(ProbeArgs),
    /// Write lights of one's own, and what is around them, as one environment.
    #[command(
        after_help = "Example:\n  transplat light rig.json -o rig.hdr\n\nThe environment is an equirectangular map, as --target and other programs take it. Distant lights are in it as they are; what is near has there the direction and the strength that it has at one place."
    )]
    Light(PanoramaArgs),
    /// Tell what a splat, environment, bake, look, rig or table of colours holds, and what is odd about it.
    #[command(after_help = "Example:\n  transplat info knot.ply")]
    Info(InfoArgs),
    /// Measure error against run time of all settings, extreme cases, and presets and terms against path-traced truth: a page with plots.
    #[command(
        after_help = "Examples:\n  transplat report -o report\n  transplat report knot.ply --source city.hdr -o report\n  transplat report --only truth -o report\n  transplat report --only truth --ground-truth truth -o report\n  transplat report --only insertion --ground-truth truth/insert/yard -o report\n\nThe folder of the truth holds MANIFEST.json (sets.SET.objects.OBJECT: source_env, targets), envs/LIGHT.hdr, and for each object SET/OBJECT/source.ply, transforms_test.json and gt/LIGHT/*.exr, a linear, premultiplied picture a camera.\n\nThe part insertion takes the folder of a scene, or one with such folders in its folder insert: scene.ply, scene.json, gt/with_NAME and gt/without, masks/NAME, and, in a folder above, dev/ASSET and envs/LIGHT. It draws every view five ways (pasted, relit by the probe, by the light that arrives, preset paper, preset best) and scores it."
    )]
    Report(ReportArgs),
}

#[derive(Clone, Debug, Args)]
pub struct OutputArgs {
    /// Show no progress, no summary and no warnings
    #[arg(long, short)]
    pub quiet: bool,
    /// Print one JSON object on stdout: timings, memory, what was left out, warnings
    #[arg(long)]
    pub json: bool,
}

#[derive(Clone, Debug, Args)]
pub struct AssetArgs {
    /// The splat, of 2D surfels or 3D Gaussians: .ply, .spz, .sog (or the folder of its meta.json), .splat, .ksplat, .glb, .gltf; or a look, whose splat and settings are meant
    pub asset: Option<PathBuf>,
    #[command(flatten)]
    pub options: AssetOptions,
}

#[derive(Clone, Debug, Args)]
pub struct AssetOptions {
    /// The asset's up axis; default: what a comment "Vertical axis: y" in the file says, else +z
    #[arg(long, value_name = "+x|-x|+y|-y|+z|-z", value_parser = parse_up, allow_hyphen_values = true)]
    pub up: Option<UpAxis>,
    /// The asset's colour is linear already
    #[arg(long)]
    pub linear: bool,
    /// A place that sees the outside of the asset, in its coordinates; several of them add up. For thin sheets whose front is a guess
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true)]
    pub outside_from: Vec<[f64; 3]>,
    /// Visibility directions of preset paper [default: 128]
    #[arg(long, value_parser = parse_directions)]
    pub directions: Option<usize>,
    /// Where to compute
    #[arg(long, value_parser = device_choice(), default_value = "auto")]
    pub device: DeviceChoice,
}

/// The light that an asset was captured under, and how that is told from its colour.
#[derive(Clone, Debug, Default, Args)]
pub struct CaptureArgs {
    /// The light the asset was captured under: .hdr, .exr, a picture; where nobody knows it "estimate" (from the asset) or "even"
    #[arg(long, value_name = "ENV|estimate|even")]
    pub source: Option<PathBuf>,
    /// How the picture of that light is laid out: equirectangular, cube-cross, cube-column, angular-map or mirror-ball [default: as its shape and its empty
    /// corners tell]
    #[arg(long, value_name = "LAYOUT", value_parser = parse_named::<Layout>)]
    pub source_layout: Option<Layout>,
    /// Which layer or part of an OpenEXR file that light is [default: the unnamed one, or the one that is called as the whole image usually is]
    #[arg(long, value_name = "NAME")]
    pub source_layer: Option<String>,
    /// Turn the source light about the up axis
    #[arg(long, value_name = "DEG", value_parser = parse_finite, allow_hyphen_values = true)]
    pub rotate_source: Option<f64>,
    /// Which mathematics: best sums over directions (the directional method), paper takes products of spherical harmonics (the harmonic
    /// method) [default: best]
    #[arg(long, value_name = "best|paper", value_parser = parse_named::<Method>)]
    pub preset: Option<Method>,
    /// Degree of the light used, 0 to 8, where that is an SH series (preset paper) [default: 3]
    #[arg(long, value_name = "0..8", value_parser = clap::value_parser!(u8).range(0..=8))]
    pub sh_degree: Option<u8>,
    /// Added to the source's irradiance, relative to its mean [default: 0.006; preset paper: 0.05]
    #[arg(long, value_name = "X", value_parser = parse_epsilon, allow_hyphen_values = true)]
    pub epsilon: Option<f64>,
    /// From how many times brighter than the asset's whitest surface in the same light on it shines by itself; less finds more lamps, much more
    /// none (preset best) [default: 1.2]
    #[arg(long, value_name = "0.05..100", value_parser = parse_glow)]
    pub glow_above: Option<f64>,
    /// Switch terms off: shadow; of preset best sums, suns, bounce, two-sided, lobe, residual, glow; of preset paper specular, reflection,
    /// attenuation
    #[arg(long, value_delimiter = ',', value_name = "TERM,...", hide_possible_values = true,
        value_parser = PossibleValuesParser::new(Terms::ALL.iter().map(|t| t.name)))]
    pub without: Vec<String>,
    /// Compute also what this scene does not need, which is slower and hardly shows; a bake that is there already is taken as it is
    #[arg(long)]
    pub compute_all: bool,
    /// Use a saved bake
    #[arg(long, value_name = "FILE")]
    pub bake: Option<PathBuf>,
    /// All settings from a saved look (JSON); options given beside it win
    #[arg(long, value_name = "FILE")]
    pub look: Option<PathBuf>,
}

#[derive(Clone, Debug, Default, Args)]
pub struct LightArgs {
    #[command(flatten)]
    pub capture: CaptureArgs,
    /// The light to relight by: an environment, "even", "sky" (sun and sky), or the asset's own "estimate"; several, or a folder of them, give one output each
    #[arg(long, value_name = "ENV|even|sky|estimate")]
    pub target: Vec<PathBuf>,
    /// Lights of one's own beside the environment, and the one that the file names: point, spot, directional, rect and disc (README)
    #[arg(long, value_name = "RIG.json")]
    pub rig: Option<PathBuf>,
    /// Another light of one's own, as a rig lists them: {"type": "point", "position": [0, 0, 2], "intensity": [5, 5, 5]}; several add up
    #[arg(long, value_name = "JSON", value_parser = parse_light)]
    pub light: Vec<Light>,
    /// How the pictures of these lights are laid out, as --source-layout
    #[arg(long, value_name = "LAYOUT", value_parser = parse_named::<Layout>)]
    pub target_layout: Option<Layout>,
    /// Which layer or part of an OpenEXR file these lights are, as --source-layer
    #[arg(long, value_name = "NAME")]
    pub layer: Option<String>,
    /// Turn the target light about the up axis
    #[arg(long, value_name = "DEG", value_parser = parse_finite, allow_hyphen_values = true)]
    pub rotate_target: Option<f64>,
    /// Strength of the target light
    #[arg(long, value_name = "STOPS", value_parser = parse_finite, allow_hyphen_values = true)]
    pub strength_target: Option<f64>,
    /// Bring the target's mean irradiance to the source's first
    #[arg(long)]
    pub match_strength: bool,
}

impl LightArgs {
    /// Every file that is read for it, `targets` being the environments behind `--target`.
    pub fn inputs<'a>(
        &'a self,
        scene: &'a Scene,
        targets: &'a [(String, PathBuf)],
    ) -> impl Iterator<Item = &'a Path> {
        let of_objects = scene.objects.iter();
        of_objects
            .flat_map(|o| [&o.source.file, &o.asset])
            .chain([&self.capture.bake, &self.capture.look, &self.rig])
            .flatten()
            .chain(targets.iter().map(|(_, path)| path))
            .map(PathBuf::as_path)
    }
}

#[derive(Debug, Args)]
pub struct RelightArgs {
    #[command(flatten)]
    pub asset: AssetArgs,
    #[command(flatten)]
    pub light: LightArgs,
    /// The relit splat, in the format that its name says; of a scene of several objects one of all where they stand, or a folder of a splat for each, as it was captured; with
    /// several targets the folder for them
    #[arg(short, long, value_name = "OUT.ply|spz|sog|...|DIR")]
    pub output: PathBuf,
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Clone, Debug, Args)]
pub struct RenderArgs {
    #[command(flatten)]
    pub asset: AssetArgs,
    #[command(flatten)]
    pub light: LightArgs,
    #[command(flatten)]
    pub camera: CameraArgs,
    /// Folder for the pictures, or the one picture's name; a name that ends in .mp4, .webm or .webp makes a film of them (with ffmpeg)
    #[arg(short, long, value_name = "DIR|FILE")]
    pub output: PathBuf,
    /// Frames a second of a film, or of --animation
    #[arg(long, value_name = "N", default_value_t = FRAME_RATE, value_parser = clap::value_parser!(u32).range(1..=240))]
    pub frame_rate: u32,
    /// Draw the light as it changes over time by the look's keys, a frame for each moment
    #[arg(long, conflicts_with_all = ["turntable", "cameras", "layers", "batch"])]
    pub animation: bool,
    /// Picture size; default: the camera file's, else 800x800
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[usize; 2]>,
    /// File format; default: by the output's name, else png
    #[arg(long, value_parser = image_format_parser())]
    pub format: Option<ImageFormat>,
    /// transparent, black, white, #rrggbb, checker or environment [default: transparent]
    #[arg(long, value_parser = parse_background)]
    pub background: Option<Background>,
    /// A photograph behind the objects, framed by its shorter edge; a folder of them: that of each camera's picture
    #[arg(long, value_name = "PHOTO|DIR", conflicts_with = "background")]
    pub plate: Option<PathBuf>,
    /// What to show [default: after]
    #[arg(long, value_parser = parse_named::<View>, value_name = "after|before|split|side-by-side|difference|diffuse|specular|normals|depth|visibility|albedo|glow|tau|doubts")]
    pub view: Option<View>,
    /// Tone curve [default: srgb]
    #[arg(long, value_parser = parse_named::<ToneMap>, value_name = "srgb|neutral|agx|aces|none")]
    pub tone_map: Option<ToneMap>,
    /// A table of colours (.cube) to grade the picture by, after the tone curve
    #[arg(long, value_name = "FILE.cube")]
    pub lut: Option<PathBuf>,
    /// Exposure of the picture
    #[arg(long, value_name = "STOPS", value_parser = parse_finite, allow_hyphen_values = true)]
    pub exposure: Option<f64>,
    /// Average N x N samples a pixel
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=8))]
    pub supersample: u8,
    /// Write each picture as an EXR in layers (plate, each object with its alpha, shadow, depth, normal, id), and the look of it beside it
    #[arg(long)]
    pub layers: bool,
    /// Only these frames, with their own numbers
    #[arg(long, value_name = "A-B", value_parser = parse_frames)]
    pub frames: Option<[usize; 2]>,
    /// Draw a file of splats, lights and cameras, each with each, into DIR/SPLAT/LIGHT/NNN.png; pictures that are there are left
    #[arg(long, value_name = "BATCH.json", conflicts_with_all = ["asset", "target", "bake", "frames", "layers", "plate"])]
    pub batch: Option<PathBuf>,
    /// Only this part of a batch, from 1: how several machines share one
    #[arg(long, value_name = "K/N", requires = "batch", value_parser = parse_part)]
    pub part: Option<[usize; 2]>,
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Clone, Debug, Args)]
pub struct CameraArgs {
    /// Cameras of a transforms.json, or of a COLMAP model by its folder
    #[arg(long, value_name = "CAMERAS|DIR", conflicts_with_all = ["turntable", "eye"])]
    pub cameras: Option<PathBuf>,
    /// N views around the object
    #[arg(long, value_name = "N", conflicts_with = "eye", value_parser = parse_views)]
    pub turntable: Option<u32>,
    /// One camera here, in the asset's coordinates
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true)]
    pub eye: Option<[f64; 3]>,
    /// What that camera looks at; default: the object's centre
    #[arg(long, value_name = "X,Y,Z", requires = "eye", value_parser = parse_point, allow_hyphen_values = true)]
    pub look_at: Option<[f64; 3]>,
    /// Radius of the lens as a share of the distance to what is looked at, which stays sharp: what is nearer or farther is blurred
    #[arg(long, value_name = "0..0.2", value_parser = parse_aperture)]
    pub aperture: Option<f64>,
    /// Horizontal field of view, where no --cameras have one [default: 40, or the look's]
    #[arg(long, value_name = "DEG", conflicts_with = "cameras", value_parser = parse_fov)]
    pub fov: Option<f64>,
}

/// Formats of images by their endings.
const IMAGE_FORMATS: [ImageFormat; 2] = [ImageFormat::Png8, ImageFormat::ExrFloat];

/// Format of an image by its ending.
pub fn image_format(extension: &str) -> Option<ImageFormat> {
    let mut all = IMAGE_FORMATS.into_iter();
    all.find(|f| f.extension().eq_ignore_ascii_case(extension))
}

fn image_format_parser() -> impl TypedValueParser<Value = ImageFormat> {
    let endings = IMAGE_FORMATS.map(ImageFormat::extension);
    PossibleValuesParser::new(endings)
        .try_map(|ending| image_format(&ending).ok_or("no format of images"))
}

#[derive(Debug, Args)]
pub struct ConvertArgs {
    /// The splat
    pub asset: PathBuf,
    /// The splat in another format
    #[arg(short, long, value_name = "OUT.ply|spz|sog|...")]
    pub output: PathBuf,
    /// Its up axis, where the file does not say it
    #[arg(long, value_name = "+x|-x|+y|-y|+z|-z", value_parser = parse_up, allow_hyphen_values = true)]
    pub up: Option<UpAxis>,
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Debug, Args)]
pub struct DelightArgs {
    #[command(flatten)]
    pub asset: AssetArgs,
    #[command(flatten)]
    pub capture: CaptureArgs,
    /// What the splat's colour becomes: its albedo, or what it looks like under light from everywhere, hollows darker
    #[arg(long = "as", value_parser = delit_as(), default_value = "albedo")]
    pub delit_as: DelitAs,
    /// Albedo of the whitest surface [default: as light and pictures tell it, or 0.65 where that is not plausible]
    #[arg(long, value_name = "0.02..1", value_parser = parse_albedo)]
    pub whitest: Option<f64>,
    /// Write with each splat what it is made of: normal, base_color, metallic, roughness, reflectance, emission (.ply, .glb)
    #[arg(long)]
    pub materials: bool,
    /// The splat without its light, in the format that its name says
    #[arg(short, long, value_name = "FLAT.ply|spz|sog|...")]
    pub output: PathBuf,
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Debug, Args)]
pub struct BakeArgs {
    #[command(flatten)]
    pub asset: AssetArgs,
    /// The preset that it is for: each bakes in its own way [default: best]
    #[arg(long, value_name = "best|paper", value_parser = parse_named::<Method>)]
    pub preset: Option<Method>,
    /// The bake
    #[arg(short, long, value_name = "OUT.bake")]
    pub output: PathBuf,
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Debug, Args)]
pub struct EstimateArgs {
    #[command(flatten)]
    pub asset: AssetArgs,
    /// Use a saved bake (of preset best)
    #[arg(long, value_name = "FILE")]
    pub bake: Option<PathBuf>,
    /// The light
    #[arg(short, long, value_name = "LIGHT.exr")]
    pub output: PathBuf,
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Debug, Args)]
pub struct ProbeArgs {
    #[command(flatten)]
    pub asset: AssetArgs,
    /// Where: a place in the scene's coordinates, or the name of an object, which is left out then; several give a file each
    #[arg(
        long,
        required = true,
        value_name = "X,Y,Z|NAME",
        allow_hyphen_values = true
    )]
    pub at: Vec<String>,
    /// Leave out this object of the scene
    #[arg(long, value_name = "NAME")]
    pub without: Vec<String>,
    /// What shines where the scene is open [default: the light of its capture, where the scene names it]
    #[arg(long, value_name = "ENV|estimate|even")]
    pub environment: Option<PathBuf>,
    /// How much brighter it was where the scene is clipped at white
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, value_parser = parse_gain)]
    pub clipped_gain: f64,
    /// Where the scene is clipped at white, take a light like this one, brought to the strength of what is not clipped
    #[arg(long, value_name = "ENV|estimate")]
    pub clipped_like: Option<PathBuf>,
    /// Rows of the map, half of its columns
    #[arg(long, value_name = "N", default_value_t = DEFAULT_ROWS, value_parser = parse_rows)]
    pub rows: usize,
    /// The light; of several places the folder for them
    #[arg(short, long, value_name = "LIGHT.exr|DIR")]
    pub output: PathBuf,
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Debug, Args)]
pub struct PanoramaArgs {
    /// The lights: a rig, or a look, whose lights and environment are meant
    #[arg(value_name = "RIG|LOOK")]
    pub rig: PathBuf,
    /// What is around them [default: what the rig or the look names]
    #[arg(long, value_name = "ENV|even|sky")]
    pub target: Option<PathBuf>,
    /// Where they are seen from, in the world's coordinates, z up [default: the middle of a look's splats, or 0,0,0]
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true)]
    pub at: Option<[f32; 3]>,
    /// Columns of the map, twice its rows
    #[arg(long, value_name = "N", default_value_t = 2048, value_parser = parse_columns)]
    pub columns: usize,
    #[command(flatten)]
    pub options: AssetOptions,
    /// The environment
    #[arg(short, long, value_name = "LIGHT.hdr|exr")]
    pub output: PathBuf,
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Debug, Args)]
pub struct ReportArgs {
    /// The splat to report on, with --source; default: the bundled scene, with its path-traced truth
    pub asset: Option<PathBuf>,
    #[command(flatten)]
    pub options: AssetOptions,
    /// The light it was captured under
    #[arg(long, value_name = "ENV|estimate|even", requires = "asset")]
    pub source: Option<PathBuf>,
    /// The light to relight it by [default: the bundled sunset]
    #[arg(long, value_name = "ENV", requires = "asset")]
    pub target: Option<PathBuf>,
    /// Also compare presets and terms with these objects' true pictures [of --only truth the default: the two bundled splats]
    #[arg(long, value_name = "DIR")]
    pub ground_truth: Option<PathBuf>,
    /// Only these objects
    #[arg(long, value_delimiter = ',', value_name = "NAME,...")]
    pub objects: Vec<String>,
    /// Only the extreme cases
    #[arg(long, conflicts_with = "only")]
    pub extremes: bool,
    /// Only these parts
    #[arg(long, value_enum, value_delimiter = ',', value_name = "PART,...")]
    pub only: Vec<ReportPart>,
    /// Fewer settings, bakes and repeats; of the part truth only the presets as they are, without switching terms off
    #[arg(long)]
    pub quick: bool,
    /// Also without being told the light of the capture: estimated, and even, as it comes and with its strength fitted
    #[arg(long)]
    pub unknown_light: bool,
    /// The folder for the page, the tables and pictures
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    #[command(flatten)]
    pub out: OutputArgs,
}

/// What a report consists of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ReportPart {
    /// Error against run time of all settings
    Time,
    /// Stiff and extreme cases, and what epsilon does
    Extremes,
    /// What the scene does not need, and what leaving it out saves
    Skipped,
    /// Presets and terms against true pictures
    Truth,
    /// Objects put into captured scenes, against true pictures (--ground-truth)
    Insertion,
}

impl ReportPart {
    /// Files that it writes, beside the page.
    pub fn files(self) -> &'static [&'static str] {
        match self {
            Self::Time => &["error_vs_time.csv"],
            Self::Extremes => &["extremes.csv", "epsilon.csv"],
            Self::Skipped => &["skipped.csv"],
            Self::Truth => &["truth.csv", "truth.md"],
            Self::Insertion => &["insertion.csv"],
        }
    }
}

impl ReportArgs {
    /// Parts that are asked for.
    pub fn parts(&self) -> Vec<ReportPart> {
        if self.extremes {
            return vec![ReportPart::Extremes];
        }
        if !self.only.is_empty() {
            return self.only.clone();
        }
        let all = ReportPart::value_variants().iter().copied();
        all.filter(|p| match p {
            ReportPart::Truth => self.ground_truth.is_some(),
            ReportPart::Insertion => false,
            _ => true,
        })
        .collect()
    }
}

#[derive(Debug, Args)]
pub struct InfoArgs {
    /// A splat, environment, bake, look, rig, file of cameras or table of colours
    pub file: PathBuf,
    /// Of a splat, what it tells of the light it was captured under (takes as long as a bake)
    #[arg(long)]
    pub estimate_light: bool,
    /// Of an OpenEXR image with several layers or parts, the one that is read
    #[arg(long, value_name = "NAME")]
    pub layer: Option<String>,
    #[command(flatten)]
    pub out: OutputArgs,
}

/// A command line that does not say enough, or that says too much.
#[derive(Debug)]
pub struct Usage(String);

impl std::fmt::Display for Usage {
    fn fmt(&self, out: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        out.write_str(&self.0)
    }
}

impl std::error::Error for Usage {}

impl Usage {
    /// Ends the program as the parser does.
    pub fn exit(&self) -> ! {
        let kind = clap::error::ErrorKind::MissingRequiredArgument;
        clap::Error::raw(kind, format!("{self}\n")).exit()
    }
}

/// What is wrong with the command line, as an error.
pub fn usage<T>(message: &str) -> anyhow::Result<T> {
    Err(Usage(message.to_owned()).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn there_is_one_command_a_module() {
        let names: Vec<String> = Cli::command()
            .get_subcommands()
            .map(|c| c.get_name().to_owned())
            .collect();
        assert_eq!(
            names,
            [
                "relight", "render", "convert", "delight", "bake", "estimate", "probe", "light",
                "info", "report"
            ]
        );
    }

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
