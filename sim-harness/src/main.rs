//! The harness's program.

fn main() -> std::process::ExitCode {
    sim_harness::cli::main_by_name()
}
