//! The node agent's program.

fn main() -> std::process::ExitCode {
    node_agent::cli::main(std::env::args_os())
}
