//! Writes each shader as the GPU gets it, put together and generated, into a folder: to be read, or taken to a debugger.

use std::path::PathBuf;

fn main() -> std::io::Result<()> {
    let Some(folder) = std::env::args_os().nth(1).map(PathBuf::from) else {
        return Err(std::io::Error::other("the folder to write to is needed"));
    };
    std::fs::create_dir_all(&folder)?;
    for (name, source) in transplat_gpu::shader::usual() {
        std::fs::write(folder.join(name).with_extension("wgsl"), source)?;
    }
    Ok(())
}
