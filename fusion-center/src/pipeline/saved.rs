//! What outlives the centre: transforms, epochs and pins, as text that a state file holds.

use std::collections::BTreeMap;

use nalgebra::Matrix3;
use proto::ids::{NodeId, SiteId};
use proto::time::CentreTime;
use proto::wire::{PoseRecord, Transform};
use serde::{Deserialize, Serialize};
use thiserror::Error;

use super::belief::MAX_LOG_ODDS;
use super::poses::{Kept, Standing};
use crate::config::CentreConfig;

/// Layout of the file.
const SCHEMA: u32 = 1;
/// Epochs are below this in any file that a centre wrote.
const MAX_EPOCH: u64 = 1 << 53;
/// How far from symmetric a covariance may be, as a share of its norm.
const ASYMMETRY: f64 = 1e-9;

/// Why a state file is not used.
#[derive(Clone, Debug, Error, PartialEq)]
pub enum UnusableState {
    /// Not TOML of this layout.
    #[error("it cannot be read ({0}): repair it, or remove it to start without")]
    Unreadable(String),
    /// Another layout.
    #[error("it has schema {got}, this build reads {SCHEMA}: remove it to start without")]
    Schema {
        /// Schema found.
        got: u32,
    },
    /// Of another installation.
    #[error(
        "it is of site {site} with reference {reference}: name another file in state.path, or \
         remove it"
    )]
    Foreign {
        /// Site found.
        site: SiteId,
        /// Reference found.
        reference: NodeId,
    },
    /// A number that makes no sense.
    #[error("{field} of node {node} makes no sense ({value}): repair it, or remove the file")]
    Invalid {
        /// Which node.
        node: NodeId,
        /// Which field.
        field: &'static str,
        /// What it holds.
        value: String,
    },
}

/// The file.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    schema: u32,
    site: SiteId,
    reference: NodeId,
    #[serde(default)]
    nodes: BTreeMap<NodeId, Line>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Line {
    next_epoch: u64,
    is_pinned: bool,
    /// Of a pin from before the reference was registered anew.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    is_outdated: bool,
    /// The transform in force last, those before it in their order.
    #[serde(default)]
    transforms: Vec<TransformLine>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct TransformLine {
    epoch: u64,
    log_odds: f64,
    pose_ref_from_node: PoseRecord,
    covariance: [[f64; 3]; 3],
}

/// The text of a state file.
pub(super) fn written(
    config: &CentreConfig,
    standings: &BTreeMap<NodeId, Standing>,
) -> Result<String, toml::ser::Error> {
    let transform = |kept: &Kept| TransformLine {
        epoch: kept.transform.epoch,
        // Infinite ones have no number in the file.
        log_odds: kept.log_odds.clamp(-MAX_LOG_ODDS, MAX_LOG_ODDS),
        pose_ref_from_node: kept.transform.pose_ref_from_node,
        covariance: kept.transform.covariance,
    };
    let line = |(node, standing): (&NodeId, &Standing)| {
        let kept = standing.history.iter().chain(&standing.in_force).map(transform);
        let Standing { next_epoch, is_pinned, is_outdated, .. } = *standing;
        (node.clone(), Line { next_epoch, is_pinned, is_outdated, transforms: kept.collect() })
    };
    let file = File {
        schema: SCHEMA,
        site: config.site.clone(),
        reference: config.reference.clone(),
        nodes: standings.iter().map(line).collect(),
    };
    toml::to_string(&file)
}

/// What a state file of this installation holds.
///
/// # Errors
/// If it is damaged, or of another installation.
pub(super) fn read(
    config: &CentreConfig,
    text: &str,
) -> Result<BTreeMap<NodeId, Standing>, UnusableState> {
    let unreadable = |error: toml::de::Error| UnusableState::Unreadable(error.message().to_owned());
    let file: File = toml::from_str(text).map_err(unreadable)?;
    if file.schema != SCHEMA {
        return Err(UnusableState::Schema { got: file.schema });
    }
    if file.site != config.site || file.reference != config.reference {
        return Err(UnusableState::Foreign { site: file.site, reference: file.reference });
    }
    file.nodes.into_iter().map(|(node, line)| Ok((node.clone(), standing(&node, line)?))).collect()
}

fn standing(node: &NodeId, line: Line) -> Result<Standing, UnusableState> {
    let Line { next_epoch, is_pinned, is_outdated, transforms } = line;
    let mut kept = transforms
        .iter()
        .map(|transform| checked(node, transform, next_epoch))
        .collect::<Result<std::collections::VecDeque<Kept>, _>>()?;
    if MAX_EPOCH <= next_epoch {
        let (node, value) = (node.clone(), next_epoch.to_string());
        return Err(UnusableState::Invalid { node, field: "next_epoch", value });
    }
    let in_force = kept.pop_back();
    let mut standing = Standing::default();
    (standing.in_force, standing.history) = (in_force, kept);
    (standing.next_epoch, standing.is_pinned) = (next_epoch, is_pinned);
    standing.is_outdated = is_pinned && is_outdated;
    Ok(standing)
}

fn checked(node: &NodeId, line: &TransformLine, next_epoch: u64) -> Result<Kept, UnusableState> {
    let invalid =
        |field, value: String| UnusableState::Invalid { node: node.clone(), field, value };
    let TransformLine { epoch, log_odds, pose_ref_from_node, covariance } = *line;
    if next_epoch <= epoch {
        return Err(invalid("epoch", epoch.to_string()));
    }
    if !log_odds.is_finite() {
        return Err(invalid("log_odds", log_odds.to_string()));
    }
    let PoseRecord { x_m, y_m, heading_rad } = pose_ref_from_node;
    let is_place = x_m.is_finite() && y_m.is_finite() && x_m.abs().max(y_m.abs()) <= 1e5;
    if !is_place || !(-4.0..=4.0).contains(&heading_rad) {
        return Err(invalid("pose_ref_from_node", format!("{pose_ref_from_node:?}")));
    }
    let matrix = Matrix3::from_fn(|row, column| covariance[row][column]);
    let is_zero = matrix.amax() <= 0.0;
    let is_symmetric = (matrix - matrix.transpose()).norm() <= ASYMMETRY * matrix.norm();
    if !(is_symmetric && (is_zero || matrix.cholesky().is_some())) {
        return Err(invalid("covariance", format!("{covariance:?}")));
    }
    // Accepted before this centre's clock began.
    let transform = Transform { epoch, accepted: CentreTime(0), pose_ref_from_node, covariance };
    Ok(Kept { transform, log_odds })
}

#[cfg(test)]
mod tests;
