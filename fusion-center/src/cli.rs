//! The command line of the fusion centre.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::{Parser, Subcommand, ValueEnum};
use proto::config::{load, with_settings};
use proto::ids::{NodeId, SiteId};
use proto::process;

use crate::config::CentreConfig;
use crate::registration::{SolverKind, build};
use crate::{offline, service};
use operate::{Operation, operate};

mod operate;

/// Gathers the point sets of all nodes, works out where the nodes stand, and publishes the
/// transforms and one fused picture.
#[derive(Debug, Parser)]
#[command(name = "fusion-center", version)]
pub struct Arguments {
    #[command(subcommand)]
    action: Option<Action>,
    /// Configuration file (TOML); every key has a default, see deploy/fusion.toml.
    #[arg(long, env = "TRANSMURAL_FUSION_CONFIG", value_name = "FILE", global = true)]
    config: Option<PathBuf>,
    #[command(flatten)]
    flags: Flags,
}

/// What can be set by flag; a flag wins over the configuration file.
#[derive(Debug, clap::Args)]
struct Flags {
    /// Name of the installation.
    #[arg(long, global = true)]
    site: Option<SiteId>,
    /// Node whose frame is the common frame.
    #[arg(long, global = true)]
    reference: Option<NodeId>,
    /// Endpoint to listen on, such as tcp/0.0.0.0:7447; may be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    listen: Vec<String>,
    /// Endpoint of a router to dial instead of listening; may be repeated.
    #[arg(long, value_name = "ENDPOINT", global = true)]
    connect: Vec<String>,
    /// Length of one detection period in seconds.
    #[arg(long)]
    period_s: Option<f64>,
    /// Solver to register with.
    #[arg(long, value_enum, global = true)]
    solver: Option<SolverFlag>,
    /// Set any key: KEY=VALUE with the key's path in the file, such as
    /// gather.window_count=60; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE", global = true)]
    settings: Vec<String>,
    /// Print the effective configuration and exit.
    #[arg(long)]
    print_config: bool,
    #[command(flatten)]
    process: process::Flags,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum SolverFlag {
    Default,
    Swarm,
    Graph,
    L2,
}

#[derive(Debug, Subcommand)]
enum Action {
    #[command(flatten)]
    Operate(Operation),
    /// Register recorded points: poses of all nodes, their covariances, and whether the data
    /// decide them.
    Register {
        /// JSON Lines, one problem each (- for standard input), or a folder of points as
        /// `node-agent process --out DIR` and `sim-harness run` write it, which is one problem.
        #[arg(value_name = "INPUT")]
        input: PathBuf,
        /// Draw every problem before and after registration, as SVG, into this folder.
        #[arg(long, value_name = "DIR")]
        figures: Option<PathBuf>,
        /// Answer in JSON Lines.
        #[arg(long)]
        json: bool,
    },
}

/// Runs the program with these arguments, the first of which is its name.
pub fn main(words: impl IntoIterator<Item = OsString>) -> ExitCode {
    process::main(words, async |arguments: Arguments, stop| {
        let config = arguments.configuration()?;
        if arguments.flags.print_config {
            return process::print(&toml::to_string(&config)?);
        }
        match arguments.action {
            None => service::run(config, stop).await,
            Some(Action::Operate(operation)) => operate(config, operation.command()).await,
            Some(Action::Register { input, figures, json }) => {
                let reference = arguments.flags.reference;
                let options = offline::Options { input, reference, json, figures };
                offline::register(&options, build(&config.solver).as_ref(), &stop)
            }
        }
    })
}

impl process::HasFlags for Arguments {
    fn process_flags(&self) -> &process::Flags {
        &self.flags.process
    }
}

impl Arguments {
    /// Defaults, then the file, then the flags; checked as a whole.
    fn configuration(&self) -> anyhow::Result<CentreConfig> {
        let file: CentreConfig = self.config.as_deref().map(load).transpose()?.unwrap_or_default();
        let mut config = with_settings(file, &self.flags.settings)?;
        let Flags { site, reference, listen, connect, period_s, solver, .. } = &self.flags;
        config.site = site.clone().unwrap_or(config.site);
        config.reference = reference.clone().unwrap_or(config.reference);
        config.gather.period_s = period_s.unwrap_or(config.gather.period_s);
        if !connect.is_empty() {
            (config.bus.connect, config.bus.listen) = (connect.clone(), Vec::new());
        }
        if !listen.is_empty() {
            config.bus.listen.clone_from(listen);
        }
        config.solver.kind = match solver {
            None => config.solver.kind,
            Some(SolverFlag::Default) => SolverKind::Default,
            Some(SolverFlag::Swarm) => SolverKind::Swarm,
            Some(SolverFlag::Graph) => SolverKind::Graph,
            Some(SolverFlag::L2) => SolverKind::L2,
        };
        let origin =
            self.config.as_deref().map_or("command line".into(), |path| path.display().to_string());
        config.check().with_context(|| format!("configuration ({origin})"))?;
        Ok(config)
    }
}
