//! The harness's program. Under the name of an agent or the centre it is that program: so one
//! build has everything that a run launches, and nothing it launches is ever out of date.

use std::path::Path;

fn main() -> std::process::ExitCode {
    let arguments: Vec<std::ffi::OsString> = std::env::args_os().collect();
    let name = arguments.first().and_then(|name| Path::new(name).file_name());
    match name.and_then(|name| name.to_str()) {
        Some("node-agent") => node_agent::cli::main(arguments),
        Some("fusion-center") => fusion_center::cli::main(arguments),
        _ => sim_harness::cli::main(arguments),
    }
}
