//! What an operator may ask of a running centre, and how it is asked.

use std::time::Duration;

use anyhow::Context;
use clap::Subcommand;
use proto::bus::{Bus, BusEvent, Delivery, ZenohBus};
use proto::config::BusConfig;
use proto::geom::wrap_angle;
use proto::ids::{BootId, NodeId};
use proto::keys::{Keys, Pattern, Topic};
use proto::process;
use proto::wire::{Answer, Command, PoseRecord, Stamp, StatedPose, decode, encode};
use tokio::sync::mpsc;

use crate::config::CentreConfig;

/// A wish.
#[derive(Debug, Subcommand)]
pub(super) enum Operation {
    /// Ask a running centre to register anew: one node, or all.
    Recalibrate {
        /// Which node; all if left out.
        #[arg(long)]
        node: Option<NodeId>,
    },
    /// Keep a node's transform: no result replaces it until unpin.
    Pin(PinFlags),
    /// Let results replace a node's transform again.
    Unpin {
        /// Which node.
        #[arg(long)]
        node: NodeId,
    },
    /// Go back to the transform that a node had before, and pin it.
    Rollback {
        /// Which node.
        #[arg(long)]
        node: NodeId,
    },
}

impl Operation {
    /// What to ask the centre.
    pub(super) fn command(self) -> Command {
        match self {
            Self::Recalibrate { node } => Command::Recalibrate { node },
            Self::Pin(flags) => flags.command(),
            Self::Unpin { node } => Command::Unpin { node },
            Self::Rollback { node } => Command::Rollback { node },
        }
    }
}

/// Which node to pin, and where, if not where it is held to be. The coordinates are those of the
/// node's array in the common frame.
#[derive(Debug, clap::Args)]
pub(super) struct PinFlags {
    /// Which node.
    #[arg(long)]
    node: NodeId,
    /// Where the node is, metres; with the other two.
    #[arg(long, allow_negative_numbers = true, requires_all = ["y_m", "heading_deg"])]
    x_m: Option<f64>,
    /// Where the node is, metres.
    #[arg(long, allow_negative_numbers = true, requires_all = ["x_m", "heading_deg"])]
    y_m: Option<f64>,
    /// How far the node is turned, degrees counter-clockwise.
    #[arg(long, allow_negative_numbers = true, requires_all = ["x_m", "y_m"])]
    heading_deg: Option<f64>,
    /// Standard deviation of each stated coordinate, metres.
    #[arg(long, default_value_t = 0.02)]
    sigma_m: f64,
    /// Standard deviation of the stated heading, degrees.
    #[arg(long, default_value_t = 0.5)]
    sigma_deg: f64,
}

impl PinFlags {
    fn command(self) -> Command {
        let stated = self.x_m.zip(self.y_m).zip(self.heading_deg);
        let pose = stated.map(|((x_m, y_m), heading_deg)| StatedPose {
            pose_ref_from_node: PoseRecord {
                x_m,
                y_m,
                heading_rad: wrap_angle(heading_deg.to_radians()),
            },
            sigma_m: self.sigma_m,
            sigma_rad: self.sigma_deg.to_radians(),
        });
        Command::Pin { node: self.node, pose }
    }
}

/// A centre that is there shows itself, and answers, within this time.
const ANSWER_LIMIT: Duration = Duration::from_secs(3);

/// Sends one command to the centre that listens where `config` says it would, and prints what the
/// centre did.
pub(super) async fn operate(config: CentreConfig, command: Command) -> anyhow::Result<()> {
    let BusConfig { connect, listen, .. } = config.bus.clone();
    let endpoints = if connect.is_empty() { listen } else { connect };
    let bus_config = BusConfig { connect: endpoints, listen: Vec::new(), ..config.bus };
    let (keys, boot) = (Keys::new(config.site.clone()), BootId::random());
    let patterns = [Pattern::AllLive, Pattern::Answer(boot)];
    let (bus, mut deliveries) = ZenohBus::open(&bus_config, keys.clone(), &patterns).await?;
    let centre_lives = async {
        while let Some(delivery) = deliveries.recv().await {
            if matches!(keys.parse(&delivery.key), Ok(Topic::CentreLive(_))) {
                return;
            }
        }
    };
    tokio::time::timeout(ANSWER_LIMIT, centre_lives).await.with_context(|| {
        format!("no centre of site {} is on this network: check --site", config.site)
    })?;
    let stamp = Stamp { boot, sequence: 0, sent_ns: 0 };
    bus.publish(&Topic::Command, encode(stamp, &command)?).await?;
    let answered = tokio::time::timeout(ANSWER_LIMIT, answer(&keys, &mut deliveries)).await;
    bus.close().await;
    let Answer { is_done, text, .. } = answered
        .context("the centre lives but does not answer: is it of another version? see its log")??;
    anyhow::ensure!(is_done, "{text}");
    process::print(&format!("{text}\n"))
}

/// The centre's answer to the command that was sent.
async fn answer(keys: &Keys, deliveries: &mut mpsc::Receiver<Delivery>) -> anyhow::Result<Answer> {
    while let Some(delivery) = deliveries.recv().await {
        if let (Ok(Topic::Answer(_)), BusEvent::Message(bytes)) =
            (keys.parse(&delivery.key), &delivery.event)
        {
            return Ok(decode::<Answer>(bytes)?.body);
        }
    }
    anyhow::bail!("the connection to the centre was lost")
}
