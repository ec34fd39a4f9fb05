//! Key expressions: built and parsed here, written nowhere else.
//!
//! ```text
//! transmural/1/{site}/up/{node}/points    agent to centre   gap-free
//! transmural/1/{site}/up/{node}/tracks    agent to centre   people followed, last one kept
//! transmural/1/{site}/up/{node}/dwells    agent to centre   plots of a wide-area radar, gap-free
//! transmural/1/{site}/up/{node}/status    agent to centre   once a second
//! transmural/1/{site}/up/{node}/clock     agent to centre   "what time is it there?"
//! transmural/1/{site}/down/clock/{node}   centre to agent   the answer
//! transmural/1/{site}/down/tf/{node}      centre to all     transform, last one kept for late joiners
//! transmural/1/{site}/down/picture        centre to all     picture, last one kept
//! transmural/1/{site}/down/map            centre to all     targets of wide-area radars, last one kept
//! transmural/1/{site}/ops/command         operator to centre
//! transmural/1/{site}/ops/answer/{boot}   centre to the operator whose command had this boot id
//! transmural/1/{site}/sweeps/{node}       a radar's driver to its agent, over a link of their own
//! transmural/1/{site}/live/{who}/{boot}   liveliness token of a node, or of `centre`
//! ```
//! The `1` is the major version: what cannot talk to each other never meets.

use std::fmt;

use thiserror::Error;

use crate::ids::{BootId, CENTRE, NodeId, SiteId};

const ROOT: &str = "transmural/1";

/// What a key speaks of, within a site.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Topic {
    /// A node's point sets.
    Points(NodeId),
    /// The people that a node follows.
    Tracks(NodeId),
    /// The plots of a wide-area radar, dwell by dwell.
    Dwells(NodeId),
    /// A node's status.
    Status(NodeId),
    /// A node's clock probes.
    ClockProbe(NodeId),
    /// The centre's answers to a node's clock probes.
    ClockAnswer(NodeId),
    /// A node's registration.
    Transform(NodeId),
    /// The fused picture.
    Picture,
    /// The targets of wide-area radars.
    MapTracks,
    /// Operators' commands.
    Command,
    /// The centre's answer to the operator with this boot id.
    Answer(BootId),
    /// Raw sweeps of a node's radar.
    Sweeps(NodeId),
    /// A node is alive.
    NodeLive(NodeId, BootId),
    /// The centre is alive.
    CentreLive(BootId),
}

/// A set of topics to listen to.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Pattern {
    /// Everybody's point sets.
    AllPoints,
    /// The people that everybody follows.
    AllTracks,
    /// The plots of all wide-area radars.
    AllDwells,
    /// Everybody's status.
    AllStatus,
    /// Everybody's clock probes.
    AllClockProbes,
    /// The answers to one node's clock probes.
    ClockAnswer(NodeId),
    /// One node's registration.
    Transform(NodeId),
    /// Everybody's registration.
    AllTransforms,
    /// The fused picture.
    Picture,
    /// The targets of wide-area radars.
    MapTracks,
    /// Operators' commands.
    Command,
    /// The centre's answer to one operator.
    Answer(BootId),
    /// Raw sweeps of one node's radar.
    Sweeps(NodeId),
    /// Everybody's liveliness.
    AllLive,
}

/// Why a key names no topic of a site.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[error("key {key:?} is not a topic of site {site}")]
pub struct UnknownKey {
    /// The key, cut to a readable length.
    pub key: String,
    /// The site whose keys are known.
    pub site: SiteId,
}

/// Builds and parses the keys of one site.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Keys {
    site: SiteId,
}

impl Keys {
    /// The keys of `site`.
    #[must_use]
    pub fn new(site: SiteId) -> Self {
        Self { site }
    }

    /// The key of a topic.
    #[must_use]
    pub fn key(&self, topic: &Topic) -> String {
        self.with_prefix(match topic {
            Topic::Points(node) => format!("up/{node}/points"),
            Topic::Tracks(node) => format!("up/{node}/tracks"),
            Topic::Dwells(node) => format!("up/{node}/dwells"),
            Topic::Status(node) => format!("up/{node}/status"),
            Topic::ClockProbe(node) => format!("up/{node}/clock"),
            Topic::ClockAnswer(node) => format!("down/clock/{node}"),
            Topic::Transform(node) => format!("down/tf/{node}"),
            Topic::Picture => "down/picture".to_owned(),
            Topic::MapTracks => "down/map".to_owned(),
            Topic::Command => "ops/command".to_owned(),
            Topic::Answer(boot) => format!("ops/answer/{boot}"),
            Topic::Sweeps(node) => format!("sweeps/{node}"),
            Topic::NodeLive(node, boot) => format!("live/{node}/{boot}"),
            Topic::CentreLive(boot) => format!("live/{CENTRE}/{boot}"),
        })
    }

    /// The key expression of a pattern.
    #[must_use]
    pub fn expression(&self, pattern: &Pattern) -> String {
        self.with_prefix(match pattern {
            Pattern::AllPoints => "up/*/points".to_owned(),
            Pattern::AllTracks => "up/*/tracks".to_owned(),
            Pattern::AllDwells => "up/*/dwells".to_owned(),
            Pattern::AllStatus => "up/*/status".to_owned(),
            Pattern::AllClockProbes => "up/*/clock".to_owned(),
            Pattern::ClockAnswer(node) => format!("down/clock/{node}"),
            Pattern::Transform(node) => format!("down/tf/{node}"),
            Pattern::AllTransforms => "down/tf/*".to_owned(),
            Pattern::Picture => "down/picture".to_owned(),
            Pattern::MapTracks => "down/map".to_owned(),
            Pattern::Command => "ops/command".to_owned(),
            Pattern::Answer(boot) => format!("ops/answer/{boot}"),
            Pattern::Sweeps(node) => format!("sweeps/{node}"),
            Pattern::AllLive => "live/*/*".to_owned(),
        })
    }

    /// The topic that a key names.
    ///
    /// # Errors
    /// If it is not a key of this site and version.
    pub fn parse(&self, key: &str) -> Result<Topic, UnknownKey> {
        self.topic(key).ok_or_else(|| UnknownKey {
            key: key.chars().take(120).collect(),
            site: self.site.clone(),
        })
    }

    fn topic(&self, key: &str) -> Option<Topic> {
        let rest = key.strip_prefix(ROOT)?.strip_prefix('/')?;
        let rest = rest.strip_prefix(self.site.as_str())?.strip_prefix('/')?;
        let chunks: Vec<&str> = rest.split('/').collect();
        Some(match chunks.as_slice() {
            ["up", node, "points"] => Topic::Points(node.parse().ok()?),
            ["up", node, "tracks"] => Topic::Tracks(node.parse().ok()?),
            ["up", node, "dwells"] => Topic::Dwells(node.parse().ok()?),
            ["up", node, "status"] => Topic::Status(node.parse().ok()?),
            ["up", node, "clock"] => Topic::ClockProbe(node.parse().ok()?),
            ["down", "clock", node] => Topic::ClockAnswer(node.parse().ok()?),
            ["down", "tf", node] => Topic::Transform(node.parse().ok()?),
            ["down", "picture"] => Topic::Picture,
            ["down", "map"] => Topic::MapTracks,
            ["ops", "command"] => Topic::Command,
            ["ops", "answer", boot] => Topic::Answer(boot.parse().ok()?),
            ["sweeps", node] => Topic::Sweeps(node.parse().ok()?),
            ["live", who, boot] if *who == CENTRE => Topic::CentreLive(boot.parse().ok()?),
            ["live", node, boot] => Topic::NodeLive(node.parse().ok()?, boot.parse().ok()?),
            _ => return None,
        })
    }

    fn with_prefix(&self, rest: impl fmt::Display) -> String {
        format!("{ROOT}/{}/{rest}", self.site)
    }
}

/// Whether `expression` (chunks, or `*` for one chunk) covers `key`: what the in-memory bus needs.
#[must_use]
pub fn covers(expression: &str, key: &str) -> bool {
    let (mut wanted, mut given) = (expression.split('/'), key.split('/'));
    loop {
        match (wanted.next(), given.next()) {
            (None, None) => return true,
            (Some(want), Some(got)) if want == "*" || want == got => {}
            _ => return false,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys() -> Keys {
        Keys::new("lab".parse().unwrap())
    }

    fn topics() -> Vec<(Topic, Pattern)> {
        let node: NodeId = "n1".parse().unwrap();
        vec![
            (Topic::Points(node.clone()), Pattern::AllPoints),
            (Topic::Tracks(node.clone()), Pattern::AllTracks),
            (Topic::Dwells(node.clone()), Pattern::AllDwells),
            (Topic::Status(node.clone()), Pattern::AllStatus),
            (Topic::ClockProbe(node.clone()), Pattern::AllClockProbes),
            (Topic::ClockAnswer(node.clone()), Pattern::ClockAnswer(node.clone())),
            (Topic::Transform(node.clone()), Pattern::AllTransforms),
            (Topic::Picture, Pattern::Picture),
            (Topic::MapTracks, Pattern::MapTracks),
            (Topic::Command, Pattern::Command),
            (Topic::Answer(BootId(7)), Pattern::Answer(BootId(7))),
            (Topic::Sweeps(node.clone()), Pattern::Sweeps(node.clone())),
            (Topic::NodeLive(node, BootId(7)), Pattern::AllLive),
            (Topic::CentreLive(BootId(7)), Pattern::AllLive),
        ]
    }

    #[test]
    fn every_topic_is_under_its_pattern_and_no_other_kind() {
        for (topic, pattern) in topics() {
            let key = keys().key(&topic);
            assert_eq!(keys().parse(&key), Ok(topic.clone()));
            for (_, other) in topics() {
                let expected = other == pattern;
                assert_eq!(
                    covers(&keys().expression(&other), &key),
                    expected,
                    "{topic:?} {other:?}"
                );
            }
        }
    }

    #[test]
    fn the_layout_is_the_documented_one() {
        let node: NodeId = "n1".parse().unwrap();
        assert_eq!(keys().key(&Topic::Points(node)), "transmural/1/lab/up/n1/points");
        assert_eq!(keys().expression(&Pattern::AllLive), "transmural/1/lab/live/*/*");
    }

    #[test]
    fn other_sites_versions_and_nonsense_are_refused() {
        for key in [
            "transmural/1/other/up/n1/points",
            "transmural/2/lab/up/n1/points",
            "transmural/1/lab/up/N1/points",
            "transmural/1/lab/up/n1/points/more",
            "transmural/1/laboratory/up/n1/points",
            "transmural/1/lab/live/n1/notahexnumber",
            "",
        ] {
            let error = keys().parse(key).unwrap_err();
            assert!(error.to_string().contains("site lab"), "{key}");
        }
    }
}
