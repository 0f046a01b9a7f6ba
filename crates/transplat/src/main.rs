//! `transplat`: relight a captured object.

fn main() -> std::process::ExitCode {
    transplat::main()
}
