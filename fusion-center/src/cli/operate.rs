//! What an operator may ask of a running centre, and how it is asked.

use std::time::Duration;

use anyhow::{Context, bail, ensure};
use clap::Subcommand;
use proto::bus::{Bus, BusEvent, Delivery, ZenohBus};
use proto::config::BusConfig;
use proto::geom::wrap_angle;
use proto::ids::{BootId, NodeId};
use proto::keys::{Keys, Pattern, Topic};
use proto::process;
use proto::wire::{Answer, Command, PoseRecord, Stamp, StatedPose, decode, encode};
use thiserror::Error;
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

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
    ///
    /// # Errors
    /// If a flag makes no sense.
    pub(super) fn command(self) -> Result<Command, InvalidFlag> {
        Ok(match self {
            Self::Recalibrate { node } => Command::Recalibrate { node },
            Self::Pin(flags) => flags.command()?,
            Self::Unpin { node } => Command::Unpin { node },
            Self::Rollback { node } => Command::Rollback { node },
        })
    }
}

/// A flag with a number that no pose has.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("{flag} is {value}: use {least} to {most}")]
pub(super) struct InvalidFlag {
    flag: &'static str,
    value: f64,
    least: f64,
    most: f64,
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
    /// Standard deviation of each stated coordinate, metres: 0.02 if left out.
    #[arg(long, allow_negative_numbers = true, requires_all = ["x_m", "y_m", "heading_deg"])]
    sigma_m: Option<f64>,
    /// Standard deviation of the stated heading, degrees: 0.5 if left out.
    #[arg(long, allow_negative_numbers = true, requires_all = ["x_m", "y_m", "heading_deg"])]
    sigma_deg: Option<f64>,
}

/// Of a pose from a tape measure and a compass.
const USUAL_SIGMA_M: f64 = 0.02;
const USUAL_SIGMA_DEG: f64 = 0.5;
/// What a centre takes: coordinates in metres, headings in degrees, standard deviations of both.
const REACH_M: f64 = 1e5;
const TURN_DEG: f64 = 360.0;
const SIGMAS_M: [f64; 2] = [1e-4, 10.0];
const SIGMAS_DEG: [f64; 2] = [1e-3, 57.0];

impl PinFlags {
    fn command(self) -> Result<Command, InvalidFlag> {
        let stated = self.x_m.zip(self.y_m).zip(self.heading_deg);
        let stated = stated.map(|((x_m, y_m), heading_deg)| [x_m, y_m, heading_deg]);
        let pose = stated.map(|pose| self.stated(pose)).transpose()?;
        Ok(Command::Pin { node: self.node, pose })
    }

    fn stated(&self, [x_m, y_m, heading_deg]: [f64; 3]) -> Result<StatedPose, InvalidFlag> {
        let sigma_m = self.sigma_m.unwrap_or(USUAL_SIGMA_M);
        let sigma_deg = self.sigma_deg.unwrap_or(USUAL_SIGMA_DEG);
        for (flag, value, [least, most]) in [
            ("--x-m", x_m, [-REACH_M, REACH_M]),
            ("--y-m", y_m, [-REACH_M, REACH_M]),
            ("--heading-deg", heading_deg, [-TURN_DEG, TURN_DEG]),
            ("--sigma-m", sigma_m, SIGMAS_M),
            ("--sigma-deg", sigma_deg, SIGMAS_DEG),
        ] {
            if !(least..=most).contains(&value) {
                return Err(InvalidFlag { flag, value, least, most });
            }
        }
        let heading_rad = wrap_angle(heading_deg.to_radians());
        let pose_ref_from_node = PoseRecord { x_m, y_m, heading_rad };
        Ok(StatedPose { pose_ref_from_node, sigma_m, sigma_rad: sigma_deg.to_radians() })
    }
}

/// A centre that is there shows itself, and answers, within this time.
const ANSWER_LIMIT: Duration = Duration::from_secs(3);

/// Sends one command to the centre that listens where `config` says it would, and prints what the
/// centre did.
///
/// # Errors
/// If no centre answers, if it does not do what is asked, or if `stop` was called before.
pub(super) async fn operate(
    config: CentreConfig,
    command: Command,
    stop: &CancellationToken,
) -> anyhow::Result<()> {
    tokio::select! {
        () = stop.cancelled() => bail!("stopped before the centre answered: it may have done it"),
        answered = ask(config, command) => {
            let Answer { is_done, text, .. } = answered?;
            ensure!(is_done, "{text}");
            process::print(&format!("{text}\n"))
        }
    }
}

async fn ask(config: CentreConfig, command: Command) -> anyhow::Result<Answer> {
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
    answered
        .context("the centre lives but does not answer: is it of another version? see its log")?
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
    bail!("the connection to the centre was lost")
}

#[cfg(test)]
mod tests {
    use clap::Parser;

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(subcommand)]
        operation: Operation,
    }

    fn parsed(words: &str) -> Result<Operation, clap::Error> {
        let words = std::iter::once("fusion-center").chain(words.split_whitespace());
        Line::try_parse_from(words).map(|line| line.operation)
    }

    #[test]
    fn a_stated_pose_is_sent_in_metres_and_radians() {
        let pin = "pin --node n2 --x-m -1.5 --y-m 2 --heading-deg 270 --sigma-deg 1";
        let Command::Pin { node, pose: Some(pose) } = parsed(pin).unwrap().command().unwrap()
        else {
            panic!("no pose")
        };
        assert_eq!(node.as_str(), "n2");
        let quarter_rad = std::f64::consts::FRAC_PI_2;
        assert!((pose.pose_ref_from_node.heading_rad + quarter_rad).abs() < 1e-12);
        assert!((pose.pose_ref_from_node.x_m + 1.5).abs() < 1e-12);
        assert!((pose.sigma_m - 0.02).abs() < 1e-12);
        assert!((pose.sigma_rad - 1_f64.to_radians()).abs() < 1e-12);
        let kept = parsed("pin --node n2").unwrap().command().unwrap();
        assert!(matches!(kept, Command::Pin { pose: None, .. }));
    }

    #[test]
    fn numbers_that_no_pose_has_are_named_with_what_would_do() {
        let place = "pin --node n2 --x-m 1 --y-m 2 --heading-deg 3";
        for (words, named) in [
            ("--sigma-m -1", "--sigma-m is -1: use 0.0001 to 10"),
            ("--sigma-m nan", "--sigma-m is NaN"),
            ("--sigma-deg 0", "--sigma-deg is 0: use 0.001 to 57"),
            ("--sigma-deg 90", "--sigma-deg is 90"),
        ] {
            let refused = parsed(&format!("{place} {words}")).unwrap().command().unwrap_err();
            assert!(refused.to_string().starts_with(named), "{refused}");
        }
        for (words, named) in [
            ("--x-m 1e6 --y-m 2 --heading-deg 3", "--x-m is 1000000"),
            ("--x-m 1 --y-m inf --heading-deg 3", "--y-m is inf"),
            ("--x-m 1 --y-m 2 --heading-deg -361", "--heading-deg is -361: use -360 to 360"),
        ] {
            let refused = parsed(&format!("pin --node n2 {words}")).unwrap().command().unwrap_err();
            assert!(refused.to_string().starts_with(named), "{refused}");
        }
    }

    #[test]
    fn parts_of_a_pose_are_refused_with_what_is_missing() {
        for (words, missing) in [
            ("--sigma-m 0.1", "--x-m"),
            ("--sigma-deg 0.1", "--heading-deg"),
            ("--x-m 1 --y-m 2", "--heading-deg"),
        ] {
            let refused = parsed(&format!("pin --node n2 {words}")).unwrap_err().to_string();
            assert!(refused.contains(missing), "{refused}");
        }
        assert!(parsed("unpin").unwrap_err().to_string().contains("--node"));
    }
}
