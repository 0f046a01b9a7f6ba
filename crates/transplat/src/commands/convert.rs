//! `transplat convert`: a splat in another format, its colour as it is.

use anyhow::Result;
use transplat_core::files::{check_output, load_splat, losses, write_relit};

use crate::cli::ConvertArgs;
use crate::commands::{called_as_a_splat, refuse_overwriting};
use crate::summary::Summary;
use transplat_engine::warnings::asset_warnings;

pub fn run(args: &ConvertArgs) -> Result<()> {
    let mut summary = Summary::new("convert", &args.out);
    refuse_overwriting([args.asset.as_path()], &[&args.output])?;
    let format = called_as_a_splat(&args.output)?;
    check_output(&args.output)?;
    let (mut cloud, file) = summary.time("load", || load_splat(&args.asset))?;
    for warning in asset_warnings(&args.asset, &file) {
        summary.warn(warning);
    }
    cloud.up = args.up.unwrap_or(cloud.up);
    if let Some(lost) = losses(&file, &cloud, &args.output) {
        summary.warn(format!("{}: {lost}", args.output.display()));
    }
    summary.time("export", || {
        write_relit(&file, &cloud, &cloud.sh, &args.output)
    })?;
    let bytes = |path| std::fs::metadata(path).map_or(0, |m| m.len());
    let [before, after] = [&file.path, &args.output].map(bytes);
    summary.set("format", format.name());
    summary.set("splats", cloud.len());
    summary.set("bytes", after);
    summary.set("output", args.output.display().to_string());
    summary.finish(&format!(
        "wrote {}: {} splats, {} of {:.1} MB from {} of {:.1} MB",
        args.output.display(),
        cloud.len(),
        format.name(),
        after as f64 / 1e6,
        file.report.format,
        before as f64 / 1e6
    ))
}
