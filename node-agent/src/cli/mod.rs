//! The command line of the node agent.

mod offline;

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use anyhow::Context;
use clap::{Parser, Subcommand, ValueEnum};
use proto::config::load;
use proto::ids::{NodeId, SiteId};
use proto::process;

use crate::config::{AgentConfig, SourceKind};
use crate::service;

/// One radar node: turns sweeps into images and images into measured points, and sends them to
/// the fusion centre.
///
/// Without a command it runs as an agent.
#[derive(Debug, Parser)]
#[command(name = "node-agent", version, args_conflicts_with_subcommands = true)]
pub struct Arguments {
    #[command(subcommand)]
    command: Option<Command>,
    #[command(flatten)]
    flags: Flags,
    /// Print the effective configuration and exit.
    #[arg(long)]
    print_config: bool,
    #[command(flatten)]
    process: process::Flags,
}

#[derive(Debug, Subcommand)]
enum Command {
    /// Turn recorded echoes into points and pictures.
    Process(offline::ProcessFlags),
    /// Follow people through recorded echoes.
    Track(offline::TrackFlags),
    /// Write the sweeps of the configured source to a recording.
    Record(offline::RecordFlags),
    /// Send the sweeps of the configured source to an agent's live intake, as a radar's driver does.
    Feed(FeedFlags),
}

#[derive(Debug, clap::Args)]
struct FeedFlags {
    /// Endpoint at which the agent listens for its driver (its live.listen).
    #[arg(long, value_name = "ENDPOINT", default_value = "tcp/127.0.0.1:7448")]
    to: String,
    #[command(flatten)]
    flags: Flags,
}

/// What can be set by flag; a flag wins over the configuration file.
#[derive(Debug, clap::Args)]
struct Flags {
    /// Configuration file (TOML); every key has a default, see deploy/node.toml.
    #[arg(long, env = "TRANSMURAL_NODE_CONFIG", value_name = "FILE")]
    config: Option<PathBuf>,
    /// Name of the installation.
    #[arg(long)]
    site: Option<SiteId>,
    /// Name of this node.
    #[arg(long)]
    node: Option<NodeId>,
    /// Endpoint of the centre, such as tcp/192.0.2.7:7447; may be repeated.
    #[arg(long, value_name = "ENDPOINT")]
    connect: Vec<String>,
    /// Where sweeps come from.
    #[arg(long, value_enum)]
    source: Option<SourceFlag>,
    /// Recorded detections to play (CSV or JSON Lines); implies --source recorded.
    #[arg(long, value_name = "FILE")]
    recording: Option<PathBuf>,
    /// Recorded echoes to play (NPZ or SigMF); implies --source echoes.
    #[arg(long, value_name = "FILE", conflicts_with = "recording")]
    echoes: Option<PathBuf>,
    /// Height of the recording radar above the floor, metres: examines body heights.
    #[arg(long)]
    sensor_height_m: Option<f64>,
    /// Seconds of the source per second.
    #[arg(long)]
    speed: Option<f64>,
    /// Calendar time (Unix, seconds) at which the source starts.
    #[arg(long)]
    start_unix_s: Option<f64>,
    /// Seed of the simulated source.
    #[arg(long)]
    seed: Option<u64>,
    /// Write point sets as JSON Lines.
    #[arg(long, value_name = "FILE")]
    points: Option<PathBuf>,
    /// Write the newest image as PNG.
    #[arg(long, value_name = "FILE")]
    image: Option<PathBuf>,
    /// Set any key: KEY=VALUE with the key's path in the file, such as chain.grid.pixel_m=0.05, or
    /// 'chain.canceller={exponential={time_constant_s=2.0}}' to choose another table; may be
    /// repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    settings: Vec<String>,
}

#[derive(Clone, Copy, Debug, ValueEnum)]
enum SourceFlag {
    Simulated,
    Recorded,
    Echoes,
    Live,
}

/// Runs the program with these arguments, the first of which is its name.
pub fn main(words: impl IntoIterator<Item = OsString>) -> ExitCode {
    process::main(words, async |arguments: Arguments, stop| match arguments.command {
        Some(Command::Process(flags)) => {
            tokio::task::block_in_place(|| offline::process(&flags, &stop))
        }
        Some(Command::Track(flags)) => {
            tokio::task::block_in_place(|| offline::track(&flags, &stop))
        }
        Some(Command::Record(flags)) => {
            tokio::task::block_in_place(|| offline::record(&flags, &stop))
        }
        Some(Command::Feed(FeedFlags { to, flags })) => {
            service::feed(flags.configuration()?, &to, stop).await
        }
        None if arguments.print_config => {
            process::print(&toml::to_string(&arguments.flags.configuration()?)?)
        }
        None => service::run(arguments.flags.configuration()?, stop).await,
    })
}

impl process::HasFlags for Arguments {
    fn process_flags(&self) -> &process::Flags {
        &self.process
    }
}

impl Flags {
    /// Defaults, then the file, then the flags; checked as a whole.
    fn configuration(&self) -> anyhow::Result<AgentConfig> {
        let file: AgentConfig = self.config.as_deref().map(load).transpose()?.unwrap_or_default();
        let mut config = proto::config::with_settings(file, &self.settings)?;
        self.apply(&mut config);
        let origin = self.config.as_deref().map(|path| path.display().to_string());
        let origin = origin.unwrap_or_else(|| "command line".to_owned());
        config.check().with_context(|| format!("configuration ({origin})"))?;
        Ok(config)
    }

    fn apply(&self, config: &mut AgentConfig) {
        fn set<T: Clone>(target: &mut T, flag: Option<&T>) {
            if let Some(value) = flag {
                target.clone_from(value);
            }
        }
        set(&mut config.site, self.site.as_ref());
        set(&mut config.node, self.node.as_ref());
        set(&mut config.play.speed, self.speed.as_ref());
        set(&mut config.simulated.seed, self.seed.as_ref());
        set(&mut config.recorded.path, self.recording.as_ref());
        set(&mut config.echoes.path, self.echoes.as_ref());
        for (target, flag) in [
            (&mut config.output.points_jsonl, &self.points),
            (&mut config.output.image_png, &self.image),
        ] {
            if flag.is_some() {
                target.clone_from(flag);
            }
        }
        config.play.start_unix_s = self.start_unix_s.or(config.play.start_unix_s);
        config.group.sensor_height_m = self.sensor_height_m.or(config.group.sensor_height_m);
        if !self.connect.is_empty() {
            config.bus.connect.clone_from(&self.connect);
        }
        config.source = match (self.source, &self.recording, &self.echoes) {
            (Some(SourceFlag::Simulated), ..) => SourceKind::Simulated,
            (Some(SourceFlag::Live), ..) => SourceKind::Live,
            (Some(SourceFlag::Echoes), ..) | (None, _, Some(_)) => SourceKind::Echoes,
            (Some(SourceFlag::Recorded), ..) | (None, Some(_), _) => SourceKind::Recorded,
            (None, None, None) => config.source,
        };
    }
}
