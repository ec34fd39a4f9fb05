//! The fusion centre's program.

fn main() -> std::process::ExitCode {
    fusion_center::cli::main(std::env::args_os())
}
