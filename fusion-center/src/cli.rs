//! The command line of the fusion centre.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::{Context, bail, ensure};
use clap::{Parser, Subcommand, ValueEnum};
use proto::config::{load, with_settings};
use proto::ids::{NodeId, SiteId};
use proto::process;

use crate::config::CentreConfig;
use crate::registration::{SolverKind, build};
use crate::{offline, service};
use operate::{Operation, operate};
use track::TrackFlags;

mod operate;
mod track;

/// What the configuration takes as a period.
const PERIODS_S: [f64; 2] = [1e-3, 60.0];

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
    #[arg(long, allow_negative_numbers = true)]
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
    /// Follow the moving targets in recorded plots of wide-area radars.
    Track(Box<TrackFlags>),
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
            Some(Action::Operate(operation)) => operate(config, operation.command()?, &stop).await,
            Some(Action::Track(flags)) => flags.run(config.wide, &stop).await,
            Some(Action::Register { input, figures, json }) => {
                let reference = arguments.flags.reference;
                let options = offline::Options { input, reference, json, figures };
                offline::register(options, build(&config.solver).into(), &stop).await
            }
        }
    })
}

impl process::HasFlags for Arguments {
    fn process_flags(&self) -> &process::Flags {
        &self.flags.process
    }
}

impl Flags {
    /// Refuses flags with values that make no sense, and those without effect on `action`: whoever
    /// gives one expects something of it.
    fn check(&self, action: Option<&Action>) -> anyhow::Result<()> {
        let endpoints = [("--listen", &self.listen), ("--connect", &self.connect)];
        for (flag, endpoint) in
            endpoints.iter().flat_map(|(f, all)| all.iter().map(move |e| (f, e)))
        {
            ensure!(
                endpoint.starts_with("tcp/"),
                "{flag} {endpoint:?} is not of the form tcp/HOST:PORT"
            );
        }
        if let Some(period_s) = self.period_s {
            let [least, most] = PERIODS_S;
            ensure!(
                (least..=most).contains(&period_s),
                "--period-s is {period_s}: use {least} to {most} seconds"
            );
        }
        let what = match action {
            None => return Ok(()),
            Some(Action::Operate(_)) => "a command to a running centre",
            Some(Action::Register { .. }) => "register, which works on files",
            Some(Action::Track(_)) => "track, which works on files",
        };
        let is_register = matches!(action, Some(Action::Register { .. }));
        let is_offline = is_register || matches!(action, Some(Action::Track(_)));
        let useless = [
            ("--site", is_offline && self.site.is_some()),
            ("--connect", is_offline && !self.connect.is_empty()),
            ("--listen", is_offline && !self.listen.is_empty()),
            ("--reference", !is_register && self.reference.is_some()),
            ("--solver", !is_register && self.solver.is_some()),
            ("--period-s", self.period_s.is_some()),
        ];
        let given = useless.iter().find(|(_, is_given)| *is_given);
        given.map_or(Ok(()), |(flag, _)| bail!("{flag} has no effect on {what}: leave it out"))
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
        self.flags.check(self.action.as_ref())?;
        let origin =
            self.config.as_deref().map_or("command line".into(), |path| path.display().to_string());
        config.check().with_context(|| format!("configuration ({origin})"))?;
        Ok(config)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn complaint(words: &str) -> String {
        let words = std::iter::once("fusion-center").chain(words.split_whitespace());
        let arguments = Arguments::try_parse_from(words).unwrap();
        arguments.configuration().err().map_or_else(String::new, |error| format!("{error:#}"))
    }

    #[test]
    fn flags_that_make_no_sense_are_named_with_their_remedy() {
        for (words, said) in [
            ("--period-s -1", "--period-s is -1: use 0.001 to 60"),
            ("--period-s nan", "--period-s is NaN"),
            ("--listen 7447", "--listen \"7447\" is not of the form tcp/HOST:PORT"),
            ("--connect udp/x:1", "--connect \"udp/x:1\" is not"),
            ("--set gather.place_m=0", "gather.place_m is 0: use 0.05 to 100"),
            ("--set gather.place_m", "write KEY=VALUE"),
            ("track x --connect tcp/a:1", "--connect has no effect on track"),
            ("track x --solver l2", "--solver has no effect on track"),
            ("--set wide.max_wait_s=-1", "wide.max_wait_s is -1: use 0 to 600"),
            ("register x --site here", "--site has no effect on register"),
            ("register x --connect tcp/a:1", "--connect has no effect on register"),
            ("--listen tcp/a:1 register x", "--listen has no effect on register"),
            ("--period-s 1 register x", "--period-s has no effect on register"),
            ("recalibrate --solver l2", "--solver has no effect on a command"),
            ("unpin --node n2 --reference n2", "--reference has no effect on a command"),
        ] {
            assert!(complaint(words).contains(said), "{words}: {}", complaint(words));
        }
        for words in ["", "register x --solver l2", "pin --node n2 --site s --connect tcp/a:1"] {
            assert_eq!(complaint(words), "", "{words}");
        }
    }
}
