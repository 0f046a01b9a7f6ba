//! The command line: a stable contract.

mod values;

use std::path::{Path, PathBuf};

use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::{Args, Parser, Subcommand, ValueEnum};
use transplat_core::color::ToneMap;
use transplat_core::environment::Layout;
use transplat_core::present::{Background, View};
use transplat_core::probe::DEFAULT_ROWS;
use transplat_core::response::ResponseCurve;
use transplat_core::scene::{Light, Scene};
use transplat_core::settings::{Method, Terms};
use transplat_core::surfels::UpAxis;

use transplat_engine::delight::DelitAs;
use transplat_engine::device::DeviceChoice;
use transplat_engine::output::ImageFormat;
use transplat_engine::video::FRAME_RATE;
use values::*;
pub use values::{Rotation, VIEWS};

/// Relight Gaussian splats: a trained splat, the light of its capture, and any other light.
#[derive(Debug, Parser)]
#[command(
    disable_version_flag = true,
    args_conflicts_with_subcommands = true,
    after_help = "Examples:\n  transplat                              the window, with the bundled scene\n  transplat knot.ply city.hdr            the window, with a splat and a light to relight it by\n  transplat knot.ply --source city.hdr   the same, with the light of its capture"
)]
pub struct Cli {
    /// Print version, commit, and the graphics adapter that --device gpu uses
    #[arg(long, short = 'V')]
    pub version: bool,
    #[command(subcommand)]
    pub command: Option<Command>,
    #[command(flatten)]
    pub view: ViewArgs,
}

/// Arguments without a command: the window.
#[derive(Debug, Args)]
pub struct ViewArgs {
    /// Splats, environments, folders of environments and looks, in any order [default: the bundled scene]
    pub files: Vec<PathBuf>,
    #[command(flatten)]
    pub options: AssetOptions,
    #[command(flatten)]
    pub light: LightArgs,
}

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Write a splat under another light.
    #[command(
        after_help = "Example:\n  transplat relight knot.ply --source city.hdr --target sunset.hdr -o relit.ply"
    )]
    Relight(RelightArgs),
    /// Draw images, videos or layers of a splat, as captured or relit.
    #[command(
        after_help = "Example:\n  transplat render knot.ply --source city.hdr --target sunset.hdr --turntable 8 -o images\n\nImages are named NNN.png by frame, from 000. Several targets have a folder each. PNG is display-encoded with straight alpha. EXR is linear and premultiplied, and blended in linear light.\n\nA batch:\n  transplat render --batch shots.json --part 1/8 -o images\nshots.json: {\"splats\": [\"knot.ply\", {\"asset\": \"vase.ply\", \"source\": \"estimate\"}], \"source\": \"city.hdr\", \"lights\": [\"sunset.hdr\", \"hdris/\"], \"turntable\": 24}. \"cameras\": FILE may replace the turntable, and \"look\": FILE adds settings. Paths are relative to the file."
    )]
    Render(Box<RenderArgs>),
    /// Write a splat in another format, which the output's name says: .ply, .compressed.ply, .spz, .sog, .splat, .glb.
    #[command(
        after_help = "Example:\n  transplat convert playbot.ply -o playbot.spz\n\nA warning says what the format cannot hold. SPZ and glTF have +y up: a splat that is converted to or from them is rotated to stand upright."
    )]
    Convert(ConvertArgs),
    /// Write a splat without its light: its albedo as colour, for programs that light splats themselves.
    #[command(
        after_help = "Examples:\n  transplat delight knot.ply --source city.hdr -o flat.ply\n  transplat delight knot.ply --source estimate --materials -o flat.glb\n\nThe albedo has SH degree 0 and the encoding of the capture. Other properties of a PLY are not written. With --materials a PLY has the properties nx ny nz, base_color_0 to _2, metallic, roughness, reflectance_0 to _2 and emission_0 to _2, and a GLB the attributes NORMAL, _BASE_COLOR, _METALLIC, _ROUGHNESS, _REFLECTANCE and _EMISSION. Their colours are linear, and emission is in the unit of the capture's images."
    )]
    Delight(DelightArgs),
    /// Save the visibility of a splat, to be used again with --bake.
    #[command(after_help = "Example:\n  transplat bake knot.ply -o knot.bake")]
    Bake(BakeArgs),
    /// Estimate the light of the capture from the splat alone.
    #[command(
        after_help = "Example:\n  transplat estimate knot.ply -o light.exr\n\nThe light is an equirectangular map for --source and other programs. --source estimate does the same without a file. Its mean is taken to be grey. Its strength follows from light that bounces between surfaces, and from the whitest of them."
    )]
    Estimate(EstimateArgs),
    /// Write the light at a place in a scene, as the scene's own splat shows it.
    #[command(
        after_help = "Examples:\n  transplat probe yard.ply --at 0.1,0.6,0.2 -o light.exr\n  transplat probe scene.json --at vase -o light.exr\n\nThe light is an equirectangular map for --source and --target. A scene that was trained on display-encoded images is clipped at white, and a warning says how much of the light that is. At an object that is cut out of a room, --clipped-like estimate completes what is clipped or was not photographed by the object's own shading."
    )]
    Probe(ProbeArgs),
    /// Write placed lights, and the environment around them, as one environment map.
    #[command(
        after_help = "Example:\n  transplat light rig.json -o rig.hdr\n\nThe environment is an equirectangular map for --target and other programs. Distant lights are exact. Near lights have the direction and strength that they have at one place."
    )]
    Light(PanoramaArgs),
    /// Describe a splat, environment, bake, look, rig or LUT, with warnings.
    #[command(after_help = "Example:\n  transplat info knot.ply")]
    Info(InfoArgs),
    /// Measure error against run time, extreme cases, and distance to path-traced truth: a page with plots.
    #[command(
        after_help = "Examples:\n  transplat report -o report\n  transplat report knot.ply --source city.hdr -o report\n  transplat report --only truth -o report\n  transplat report --only truth --ground-truth truth -o report\n  transplat report --only insertion --ground-truth truth/insert/yard -o report\n\nThe folder of the truth holds MANIFEST.json (sets.SET.objects.OBJECT: source_env, targets), envs/LIGHT.hdr, and for each object SET/OBJECT/source.ply, transforms_test.json and gt/LIGHT/*.exr, one linear, premultiplied image for each camera.\n\nThe part insertion takes the folder of a scene, or one with such folders in its folder insert: scene.ply, scene.json, gt/with_NAME and gt/without, masks/NAME, and, in a folder above, dev/ASSET and envs/LIGHT. It scores every view five ways: pasted, relit by the probe, by the arriving light, preset paper, preset best."
    )]
    Report(ReportArgs),
    /// Print completions of the command line for a shell.
    #[command(
        after_help = "Example:\n  transplat completions bash > ~/.local/share/bash-completion/completions/transplat"
    )]
    Completions {
        /// Shell
        shell: clap_complete::Shell,
    },
    /// Write manual pages into a folder.
    #[command(hide = true)]
    Man {
        /// Folder
        folder: PathBuf,
    },
}

#[derive(Clone, Debug, Args)]
pub struct OutputArgs {
    /// Show no progress, no summary and no warnings
    #[arg(long, short)]
    pub quiet: bool,
    /// Print one JSON object on stdout: timings, memory, skipped work, warnings
    #[arg(long)]
    pub json: bool,
}

#[derive(Clone, Debug, Args)]
pub struct AssetArgs {
    /// Splat (.ply, .spz, .sog or the folder of its meta.json, .splat, .ksplat, .glb, .gltf), or a look with its splat and settings
    #[arg(value_name = "SPLAT")]
    pub asset: Option<PathBuf>,
    #[command(flatten)]
    pub options: AssetOptions,
}

#[derive(Clone, Debug, Args)]
pub struct AssetOptions {
    /// Up axis of the splat [default: by a comment "Vertical axis: y" in the file, else +z]
    #[arg(long, value_name = "+x|-x|+y|-y|+z|-z", value_parser = parse_up, allow_hyphen_values = true)]
    pub up: Option<UpAxis>,
    /// Take the splat's colour as linear: --capture-curve linear
    #[arg(long, conflicts_with = "capture_curve")]
    pub linear: bool,
    /// Tone curve of the capture's camera or renderer, which is undone [default: srgb]
    #[arg(long, value_name = "srgb|linear|rec709|aces|agx|hable|log", value_parser = parse_named::<ResponseCurve>)]
    pub capture_curve: Option<ResponseCurve>,
    /// Contrast of the capture over that of the scene, a power of light, which is undone [default: 1]
    #[arg(long, value_name = "POWER", value_parser = parse_contrast)]
    pub capture_contrast: Option<f64>,
    /// Place that sees the outside of thin sheets, in the splat's coordinates; may be repeated
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true)]
    pub outside_from: Vec<[f64; 3]>,
    /// Number of visibility directions of preset paper [default: 128]
    #[arg(long, value_parser = parse_directions)]
    pub directions: Option<usize>,
    /// Device that computes
    #[arg(long, value_parser = device_choice(), default_value = "auto")]
    pub device: DeviceChoice,
}

/// Light of the capture, and the transfer from it.
#[derive(Clone, Debug, Default, Args)]
pub struct CaptureArgs {
    /// Light of the capture: .hdr, .exr, an image, "estimate" (from the splat), or "even" (uniform white)
    #[arg(long, value_name = "ENV|estimate|even")]
    pub source: Option<PathBuf>,
    /// Layout of that light's image: equirectangular, cube-cross, cube-column, angular-map or mirror-ball [default: by its shape and empty corners]
    #[arg(long, value_name = "LAYOUT", value_parser = parse_named::<Layout>)]
    pub source_layout: Option<Layout>,
    /// Layer or part of an OpenEXR file that is that light [default: the unnamed one, or Combined, beauty, rgba]
    #[arg(long, value_name = "NAME")]
    pub source_layer: Option<String>,
    /// Complete the clipped highlights of that light from the shading of the splat [default: of images of low dynamic range]
    #[arg(long, value_name = "true|false")]
    pub source_clipped: Option<bool>,
    /// Trust in the capture light, 0 to 1: the power of the change away from it [default: 1, of an estimate by its confidence]
    #[arg(long, value_name = "SHARE", value_parser = parse_share)]
    pub trust_source: Option<f64>,
    /// Rotate the capture light about the up axis; "fit": to where it explains the shading of the splat best (preset best)
    #[arg(long, value_name = "DEG|fit", value_parser = parse_rotation, allow_hyphen_values = true)]
    pub rotate_source: Option<Rotation>,
    /// Method: best (directional, accurate) or paper (harmonic, as in TranSplat) [default: best]
    #[arg(long, value_name = "best|paper", value_parser = parse_named::<Method>)]
    pub preset: Option<Method>,
    /// SH degree of the light, for preset paper [default: 3]
    #[arg(long, value_name = "0..8", value_parser = clap::value_parser!(u8).range(0..=8))]
    pub sh_degree: Option<u8>,
    /// Regularization: added to the capture light's irradiance, relative to its mean [default: 0.006; preset paper: 0.05]
    #[arg(long, value_name = "X", value_parser = parse_epsilon, allow_hyphen_values = true)]
    pub epsilon: Option<f64>,
    /// Emission threshold: how many times brighter than the whitest surface in the same light a lamp is (preset best) [default: 1.2]
    #[arg(long, value_name = "0.05..100", value_parser = parse_glow)]
    pub glow_above: Option<f64>,
    /// Terms to switch off: shadow; for preset best sums, suns, pixel-shadows, bounce, two-sided, lobe, residual, glow; for preset paper specular, reflection,
    /// attenuation
    #[arg(long, value_delimiter = ',', value_name = "TERM,...", hide_possible_values = true,
        value_parser = PossibleValuesParser::new(Terms::ALL.iter().map(|t| t.name)))]
    pub without: Vec<String>,
    /// Switch all optimizations off; a saved bake is used as it is
    #[arg(long)]
    pub compute_all: bool,
    /// Use a saved bake
    #[arg(long, value_name = "FILE")]
    pub bake: Option<PathBuf>,
    /// Settings of a saved look (JSON); other options win
    #[arg(long, value_name = "FILE")]
    pub look: Option<PathBuf>,
}

#[derive(Clone, Debug, Default, Args)]
pub struct LightArgs {
    #[command(flatten)]
    pub capture: CaptureArgs,
    /// Light to relight by: an environment, "even", "sky" (sun and sky), or "estimate"; several, or a folder, give one output each
    #[arg(long, value_name = "ENV|even|sky|estimate")]
    pub target: Vec<PathBuf>,
    /// Placed lights and their environment: point, spot, directional, rect and disc
    #[arg(long, value_name = "RIG.json")]
    pub rig: Option<PathBuf>,
    /// One more placed light, as a rig lists them: {"type": "point", "position": [0, 0, 2], "intensity": [5, 5, 5]}; may be repeated
    #[arg(long, value_name = "JSON", value_parser = parse_light)]
    pub light: Vec<Light>,
    /// Layout of these lights' images, as --source-layout
    #[arg(long, value_name = "LAYOUT", value_parser = parse_named::<Layout>)]
    pub target_layout: Option<Layout>,
    /// Layer or part of an OpenEXR file that is the light, as --source-layer
    #[arg(long, value_name = "NAME")]
    pub layer: Option<String>,
    /// Rotate the target light about the up axis
    #[arg(long, value_name = "DEG", value_parser = parse_finite, allow_hyphen_values = true)]
    pub rotate_target: Option<f64>,
    /// Strength of the target light
    #[arg(long, value_name = "STOPS", value_parser = parse_finite, allow_hyphen_values = true)]
    pub strength_target: Option<f64>,
    /// Match the target's mean irradiance to the capture light's first
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
    /// Relit splat, in the format of its name; for a scene one splat of all objects, or a folder with one each; a folder for several targets
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
    /// Folder of images, one image, or a video (.mp4, .webm, .webp; needs ffmpeg)
    #[arg(short, long, value_name = "DIR|FILE")]
    pub output: PathBuf,
    /// Frame rate of a video, or of --animation
    #[arg(long, value_name = "N", default_value_t = FRAME_RATE, value_parser = clap::value_parser!(u32).range(1..=240))]
    pub frame_rate: u32,
    /// Animate the light by the look's keys
    #[arg(long, conflicts_with_all = ["turntable", "cameras", "layers", "batch"])]
    pub animation: bool,
    /// Image size [default: the camera file's, else 800x800]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[usize; 2]>,
    /// File format [default: by the output's name, else png]
    #[arg(long, value_parser = image_format_parser())]
    pub format: Option<ImageFormat>,
    /// Background: transparent, black, white, #rrggbb, checker or environment [default: transparent]
    #[arg(long, value_parser = parse_background)]
    pub background: Option<Background>,
    /// Photograph behind the objects, framed by its shorter edge; or a folder with the photographs of the cameras
    #[arg(long, value_name = "PHOTO|DIR", conflicts_with = "background")]
    pub plate: Option<PathBuf>,
    /// View or channel [default: after]
    #[arg(long, value_parser = parse_named::<View>, value_name = "after|before|split|side-by-side|difference|diffuse|specular|normals|depth|visibility|albedo|emission|tau|confidence")]
    pub view: Option<View>,
    /// Tone curve [default: srgb]
    #[arg(long, value_parser = parse_named::<ToneMap>, value_name = "srgb|neutral|agx|aces|none")]
    pub tone_map: Option<ToneMap>,
    /// LUT that is applied after the tone curve
    #[arg(long, value_name = "FILE.cube")]
    pub lut: Option<PathBuf>,
    /// Exposure of the image
    #[arg(long, value_name = "STOPS", value_parser = parse_finite, allow_hyphen_values = true)]
    pub exposure: Option<f64>,
    /// Samples of a pixel along each edge
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=8))]
    pub supersample: u8,
    /// Write EXR layers (plate, each object with its alpha, shadow, depth, normal, id), with a look beside them
    #[arg(long)]
    pub layers: bool,
    /// Range of frames to draw; their numbers stay
    #[arg(long, value_name = "A-B", value_parser = parse_frames)]
    pub frames: Option<[usize; 2]>,
    /// Draw all splats of a file under all its lights, into DIR/SPLAT/LIGHT/NNN.png; images that are there stay
    #[arg(long, value_name = "BATCH.json", conflicts_with_all = ["asset", "target", "bake", "frames", "layers", "plate"])]
    pub batch: Option<PathBuf>,
    /// Part of a batch, from 1, for several machines
    #[arg(long, value_name = "K/N", requires = "batch", value_parser = parse_part)]
    pub part: Option<[usize; 2]>,
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Clone, Debug, Args)]
pub struct CameraArgs {
    /// Cameras: transforms.json, cameras.json, or the folder of a COLMAP model
    #[arg(long, value_name = "CAMERAS|DIR", conflicts_with_all = ["turntable", "eye"])]
    pub cameras: Option<PathBuf>,
    /// Number of views around the object
    #[arg(long, value_name = "N", conflicts_with = "eye", value_parser = parse_views)]
    pub turntable: Option<u32>,
    /// Position of one camera, in the splat's coordinates
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true)]
    pub eye: Option<[f64; 3]>,
    /// Target of that camera [default: the object's centre]
    #[arg(long, value_name = "X,Y,Z", requires = "eye", value_parser = parse_point, allow_hyphen_values = true)]
    pub look_at: Option<[f64; 3]>,
    /// Lens radius as a share of the focus distance, for depth of field
    #[arg(long, value_name = "0..0.2", value_parser = parse_aperture)]
    pub aperture: Option<f64>,
    /// Horizontal field of view [default: 40, or the look's]
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
    /// Splat
    #[arg(value_name = "SPLAT")]
    pub asset: PathBuf,
    /// Splat in another format
    #[arg(short, long, value_name = "OUT.ply|spz|sog|...")]
    pub output: PathBuf,
    /// Up axis of the splat, where the file has none
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
    /// Colour that is written: the albedo, or the colour under a uniform white environment
    #[arg(long = "as", value_parser = delit_as(), default_value = "albedo")]
    pub delit_as: DelitAs,
    /// Albedo of the whitest surface [default: from light and images, or 0.65 where that is not plausible]
    #[arg(long, value_name = "0.02..1", value_parser = parse_albedo)]
    pub whitest: Option<f64>,
    /// Write the material of each Gaussian: normal, base_color, metallic, roughness, reflectance, emission (.ply, .glb)
    #[arg(long)]
    pub materials: bool,
    /// Splat without its light, in the format of its name
    #[arg(short, long, value_name = "FLAT.ply|spz|sog|...")]
    pub output: PathBuf,
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Debug, Args)]
pub struct BakeArgs {
    #[command(flatten)]
    pub asset: AssetArgs,
    /// Preset that the bake is for [default: best]
    #[arg(long, value_name = "best|paper", value_parser = parse_named::<Method>)]
    pub preset: Option<Method>,
    /// Bake file
    #[arg(short, long, value_name = "OUT.bake")]
    pub output: PathBuf,
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Debug, Args)]
pub struct EstimateArgs {
    #[command(flatten)]
    pub asset: AssetArgs,
    /// Use a saved bake of preset best
    #[arg(long, value_name = "FILE")]
    pub bake: Option<PathBuf>,
    /// Light map
    #[arg(short, long, value_name = "LIGHT.exr")]
    pub output: PathBuf,
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Debug, Args)]
pub struct ProbeArgs {
    #[command(flatten)]
    pub asset: AssetArgs,
    /// Place in the scene's coordinates, or the name of an object, which is left out; several give a file each
    #[arg(
        long,
        required = true,
        value_name = "X,Y,Z|NAME",
        allow_hyphen_values = true
    )]
    pub at: Vec<String>,
    /// Object of the scene that is left out
    #[arg(long, value_name = "NAME")]
    pub without: Vec<String>,
    /// Light where the scene is open [default: the light of its capture]
    #[arg(long, value_name = "ENV|estimate|even")]
    pub environment: Option<PathBuf>,
    /// Stops that clipped white was brighter
    #[arg(long, value_name = "STOPS", default_value_t = 0.0, value_parser = parse_gain)]
    pub clipped_gain: f64,
    /// Environment for what is clipped at white, matched in strength to the rest
    #[arg(long, value_name = "ENV|estimate")]
    pub clipped_like: Option<PathBuf>,
    /// Rows of the map; it has twice as many columns
    #[arg(long, value_name = "N", default_value_t = DEFAULT_ROWS, value_parser = parse_rows)]
    pub rows: usize,
    /// Light map, or a folder for several places
    #[arg(short, long, value_name = "LIGHT.exr|DIR")]
    pub output: PathBuf,
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Debug, Args)]
pub struct PanoramaArgs {
    /// Rig, or look with lights and environment
    #[arg(value_name = "RIG|LOOK")]
    pub rig: PathBuf,
    /// Environment around the lights [default: that of the rig or look]
    #[arg(long, value_name = "ENV|even|sky")]
    pub target: Option<PathBuf>,
    /// Place that they are seen from, in world coordinates, z up [default: the middle of a look's splats, or 0,0,0]
    #[arg(long, value_name = "X,Y,Z", value_parser = parse_point, allow_hyphen_values = true)]
    pub at: Option<[f32; 3]>,
    /// Columns of the map; it has half as many rows
    #[arg(long, value_name = "N", default_value_t = 2048, value_parser = parse_columns)]
    pub columns: usize,
    #[command(flatten)]
    pub options: AssetOptions,
    /// Environment map
    #[arg(short, long, value_name = "LIGHT.hdr|exr")]
    pub output: PathBuf,
    #[command(flatten)]
    pub out: OutputArgs,
}

#[derive(Debug, Args)]
pub struct ReportArgs {
    /// Splat to measure, with --source [default: the bundled scene, with its path-traced truth]
    #[arg(value_name = "SPLAT")]
    pub asset: Option<PathBuf>,
    #[command(flatten)]
    pub options: AssetOptions,
    /// Light of the capture
    #[arg(long, value_name = "ENV|estimate|even", requires = "asset")]
    pub source: Option<PathBuf>,
    /// Light to relight by [default: the bundled sunset]
    #[arg(long, value_name = "ENV", requires = "asset")]
    pub target: Option<PathBuf>,
    /// Folder of path-traced truth to compare presets and terms with [with --only truth: the two bundled splats]
    #[arg(long, value_name = "DIR")]
    pub ground_truth: Option<PathBuf>,
    /// Objects to compare
    #[arg(long, value_delimiter = ',', value_name = "NAME,...")]
    pub objects: Vec<String>,
    /// Measure the extreme cases alone
    #[arg(long, conflicts_with = "only")]
    pub extremes: bool,
    /// Parts to measure
    #[arg(long, value_enum, value_delimiter = ',', value_name = "PART,...")]
    pub only: Vec<ReportPart>,
    /// Measure fewer settings, bakes and repeats, and no single terms
    #[arg(long)]
    pub quick: bool,
    /// Compare also with the capture light unknown: estimated, and uniform white
    #[arg(long)]
    pub unknown_light: bool,
    /// Folder for page, tables and images
    #[arg(short, long, value_name = "DIR")]
    pub output: PathBuf,
    #[command(flatten)]
    pub out: OutputArgs,
}

/// Part of a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ReportPart {
    /// Error against run time of all settings
    Time,
    /// Stiff and extreme cases, and the effect of epsilon
    Extremes,
    /// Skipped work, and what it saves
    Skipped,
    /// Presets and terms against path-traced truth
    Truth,
    /// Objects put into captured scenes, against path-traced truth (--ground-truth)
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
    /// Splat, environment, bake, look, rig, file of cameras or LUT
    pub file: PathBuf,
    /// Estimate the light of the capture (takes as long as a bake)
    #[arg(long)]
    pub estimate_light: bool,
    /// Layer or part of an OpenEXR image to read
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

/// Error of a command line that is wrong.
pub fn usage<T>(message: &str) -> anyhow::Result<T> {
    Err(Usage(message.to_owned()).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

    #[test]
    fn the_command_line_is_consistent() {
        Cli::command().debug_assert();
    }
}
