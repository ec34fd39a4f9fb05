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

impl NodeMove {
    /// Checks that the move happens within a scene that lasts until `end_s`, or without end.
    ///
    /// # Errors
    /// If it is before the start, or when all is over.
    pub fn check_time(&self, end_s: Option<f64>) -> anyhow::Result<()> {
        let end_s = end_s.unwrap_or(f64::INFINITY);
        ensure!(
            0.0 <= self.at_s && self.at_s < end_s,
            "move {}: the scene has no second {}; it lasts from 0 to {end_s} s of scene time",
            String::from(self.clone()),
            self.at_s
        );
        Ok(())
    }
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

#[cfg(test)]
mod rehearsal;

#[cfg(test)]
mod tests {
    use crate::scenario::find;

    #[test]
    fn a_move_outside_of_the_scene_is_refused_with_the_times_that_are_possible() {
        // The paper's scene lasts for 8 periods of 1 s.
        let refused = |text: &str| {
            let mut scenario = find("paper").unwrap();
            let end_s = scenario.period_s * scenario.period_count.unwrap() as f64;
            scenario.moves = vec![text.parse().unwrap()];
            scenario.resolve().err().map(|error| (format!("{error:#}"), end_s))
        };
        for text in ["n2@-1:0.1,0,3", "n2@1000:0.1,0,3"] {
            let (error, end_s) = refused(text).unwrap();
            assert!(error.contains(text), "{error}");
            assert!(error.contains(&format!("from 0 to {end_s} s")), "{error}");
        }
        assert_eq!(refused("n2@0:0.1,0,3"), None);
    }
}
