//! Nodes that are moved while a scenario runs.

use anyhow::{Context, ensure};
use proto::ids::NodeId;
use serde::{Deserialize, Serialize};

/// A node is shoved and turned.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct NodeMove {
    /// Which node.
    pub node: NodeId,
    /// When, seconds of the scene.
    pub at_s: f64,
    /// By how much, in the world's frame, metres.
    pub dx_m: f64,
    /// By how much, in the world's frame, metres.
    pub dy_m: f64,
    /// By how much it is turned on the spot, degrees counter-clockwise.
    pub turn_deg: f64,
}

impl TryFrom<String> for NodeMove {
    type Error = anyhow::Error;

    fn try_from(text: String) -> anyhow::Result<Self> {
        text.parse()
    }
}

impl From<NodeMove> for String {
    fn from(one: NodeMove) -> Self {
        let NodeMove { node, at_s, dx_m, dy_m, turn_deg } = one;
        format!("{node}@{at_s}:{dx_m},{dy_m},{turn_deg}")
    }
}

impl std::str::FromStr for NodeMove {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> anyhow::Result<Self> {
        let form = "write NODE@SECOND:DX,DY,TURN_DEG, such as n2@20:0.15,0,3";
        let (node, rest) = text.split_once('@').context(form)?;
        let (at, by) = rest.split_once(':').context(form)?;
        let numbers = std::iter::once(at).chain(by.split(','));
        let numbers: Vec<f64> = numbers.map(str::parse).collect::<Result<_, _>>().context(form)?;
        ensure!(numbers.iter().all(|number| number.is_finite()), form);
        let [at_s, dx_m, dy_m, turn_deg] = numbers[..] else { anyhow::bail!(form) };
        Ok(Self { node: node.parse()?, at_s, dx_m, dy_m, turn_deg })
    }
}
