//! The program under test: the harness, which is also the agent and the centre by name.

fn main() -> std::process::ExitCode {
    sim_harness::cli::main_by_name()
}
