//! `transplat` without a command: the viewer.

use anyhow::{Context, Result};
use transplat_core::scene::Scene;
use transplat_core::settings::TransferSettings;

use crate::cli::{ViewArgs, usage};
use crate::commands::settings::{look_of, look_over};
use crate::viewer::{self, Startup};
use transplat_engine::device::DeviceChoice;
use transplat_engine::device::pipelines_folder;

pub fn run(args: &ViewArgs) -> Result<()> {
    // What is wrong with the command line is told before a window opens.
    for file in &args.files {
        let found = std::fs::metadata(file);
        let is_word = file.extension().is_none() && file.components().count() == 1;
        if found.is_err() && is_word {
            return usage(&format!(
                "{}: neither a command nor a file; see transplat --help",
                file.display()
            ));
        }
        found.with_context(|| file.display().to_string())?;
    }
    let (options, light) = (args.options.clone(), args.light.clone());
    let are_set =
        look_of(&options, Some(&light))? != Scene::default() || light.capture.preset.is_some();
    if light.target.len() > 1 {
        return usage("the viewer takes one --target; give more lights as files, for the library");
    }
    let bake = light.capture.bake.clone();
    let settings = move |mut kept: Scene| {
        // Terms that are switched off are the default method's, unless another is named.
        if light.capture.preset.is_none() && !light.capture.without.is_empty() {
            kept.transfer = TransferSettings::default();
        }
        // It was right a moment ago; a look that has gone meanwhile leaves the kept settings.
        look_over(kept.clone(), &options, Some(&light)).unwrap_or(kept)
    };
    let startup = Startup {
        files: args.files.clone(),
        settings: are_set.then(|| Box::new(settings) as _),
        bake,
        work: directories::ProjectDirs::from("", "", "transplat")
            .map(|folders| folders.data_local_dir().join("work.json")),
        pipelines: pipelines_folder(),
        ..Startup::default()
    };
    viewer::open(startup, args.options.device == DeviceChoice::Cpu)
}
