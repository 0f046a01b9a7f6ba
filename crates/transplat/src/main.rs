//! `transplat`: relight a captured object.

use std::process::ExitCode;

fn main() -> ExitCode {
    quiet_graphics_libraries();
    transplat::main()
}

/// Vulkan's and GL's libraries write complaints to stderr, before each result, where a session's folder for sockets is not set: over SSH, in
/// containers, on render farms. Any name quiets them; one of a folder that is not there cannot have sockets of others in it.
#[allow(unsafe_code)]
fn quiet_graphics_libraries() {
    if cfg!(target_os = "linux") && std::env::var_os("XDG_RUNTIME_DIR").is_none() {
        // SAFETY: nothing else runs yet that could read the environment.
        unsafe { std::env::set_var("XDG_RUNTIME_DIR", "/nonexistent") };
    }
}
