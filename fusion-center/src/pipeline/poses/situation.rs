//! How the newest combination places a node, and what is told of it.

use proto::ids::NodeId;
use proto::time::CentreTime;
use proto::wire::{Evidence, Outcome, Registration, Rival};

use super::Poses;
use crate::network::{Group, Placed, Standing};
use crate::pipeline::outcomes;
use crate::pipeline::pairs::Pairs;

/// How a node hangs together with the others.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) enum Situation {
    /// Nothing was combined since it was heard first, or doubted.
    #[default]
    Unknown,
    /// With the reference.
    Placed {
        /// The nodes through which its pose came, the reference first, this node last.
        via: Vec<NodeId>,
    },
    /// With the reference, but as many pairs speak for one pose as for another.
    Tied {
        /// The other poses.
        rivals: Vec<Rival>,
    },
    /// With others only.
    Detached {
        /// The others.
        with: Vec<NodeId>,
    },
    /// With nobody.
    Alone {
        /// Its pairs that have a pose.
        pair_count: usize,
        /// Those of them that contradict others.
        contradicted_count: usize,
    },
}

/// The situation of every node but the reference, with its likeliest place in its group.
pub(super) fn situations<'a>(
    reference: &'a NodeId,
    groups: &'a [Group],
) -> impl Iterator<Item = (&'a NodeId, &'a Placed, Situation)> {
    let of_reference = groups.iter().find(|group| group.gauge == *reference);
    let members = |group: &'a Group| group.nodes.iter().map(move |entry| (group, entry));
    let others = groups.iter().flat_map(members).filter(move |(_, (node, _))| *node != reference);
    others.map(move |(group, (node, placed))| {
        let doubtful = of_reference.and_then(|main| main.doubtful.get(node));
        let situation = match doubtful.map(|one| &one.standing) {
            _ if group.gauge == *reference => Situation::Placed { via: placed.via.clone() },
            Some(Standing::Undecided { rivals }) => {
                Situation::Tied { rivals: outcomes::tied(rivals) }
            }
            _ => Situation::apart(node, placed, group),
        };
        (node, placed, situation)
    })
}

impl Situation {
    /// That of a node that nothing joins to the reference.
    fn apart(node: &NodeId, placed: &Placed, group: &Group) -> Self {
        match placed.standing {
            Standing::Alone { unusable_count, contradicted_count } => {
                Self::Alone { pair_count: unusable_count + contradicted_count, contradicted_count }
            }
            _ => {
                let others = group.nodes.keys().filter(|other| *other != node);
                Self::Detached { with: others.cloned().collect() }
            }
        }
    }

    /// The way from the reference; empty where there is none.
    pub(super) fn via(&self) -> &[NodeId] {
        match self {
            Self::Placed { via } => via,
            _ => &[],
        }
    }

    /// Whether `other` is no news: poses of rivals and ways change with every combination.
    pub(super) fn is_like(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Detached { with }, Self::Detached { with: with_now }) => with == with_now,
            (Self::Alone { .. }, Self::Alone { .. }) => self == other,
            _ => std::mem::discriminant(self) == std::mem::discriminant(other),
        }
    }

    /// What is told where the node's newest solve says `newest`: no single pair determines a node
    /// that the combination does not place, and loops determine one whose pair is ambiguous.
    fn outcome(&self, pairs: &Pairs, ends: [&NodeId; 2], newest: Outcome) -> Outcome {
        let underdetermined = |missing: String| Outcome::Underdetermined { missing };
        let [node, reference] = ends;
        let is_ambiguous = matches!(newest, Outcome::Ambiguous { .. });
        match self {
            Self::Placed { via } => {
                let before = via.iter().rev().nth(1);
                let is_open = before.is_some_and(|before| pairs.is_open(before, node));
                if is_ambiguous && is_open { Outcome::Determined } else { newest }
            }
            // The pair with the reference knows the odds, too.
            Self::Tied { .. } if is_ambiguous && pairs.is_open(reference, node) => newest,
            Self::Tied { rivals } => Outcome::Ambiguous { rivals: rivals.clone() },
            Self::Detached { with } => Outcome::Detached { with: with.clone() },
            Self::Alone { pair_count, contradicted_count } if 0 < *contradicted_count => {
                underdetermined(format!(
                    "{contradicted_count} of {pair_count} pairs contradict each other"
                ))
            }
            Self::Unknown | Self::Alone { .. } if newest == Outcome::Determined => {
                underdetermined("no pair joins it to the reference since it was doubted".to_owned())
            }
            Self::Unknown | Self::Alone { .. } => newest,
        }
    }
}

impl Poses {
    /// What to tell of a node.
    pub(in crate::pipeline) fn registration(
        &self,
        now: CentreTime,
        node: &NodeId,
        pairs: &Pairs,
    ) -> Option<Registration> {
        let standing = self.standings.get(node)?;
        let situation = &standing.situation;
        let newest = match situation {
            Situation::Detached { with } => {
                let way: Vec<NodeId> = with.iter().take(1).chain([node]).cloned().collect();
                pairs.newest(node, &way)
            }
            _ => pairs.newest(node, situation.via()),
        };
        let (outcome, evidence, sets, solver) = match newest {
            _ if *node == self.reference => (Outcome::Reference, Evidence::default(), None, ""),
            Some((one, sets)) => {
                let ends = [node, &self.reference];
                let outcome = situation.outcome(pairs, ends, one.outcome.clone());
                (outcome, one.evidence, Some(sets), one.solver)
            }
            None => {
                standing.in_force?;
                let missing = "nothing was solved yet in this life of the centre".to_owned();
                (Outcome::Underdetermined { missing }, Evidence::default(), None, "")
            }
        };
        Some(Registration {
            node: node.clone(),
            reference: self.reference.clone(),
            published: now,
            transform: standing.in_force.map(|kept| kept.transform),
            outcome,
            evidence,
            sets,
            solver: solver.to_owned(),
            via: situation.via().to_vec(),
            suspicion: standing.suspicion.clone(),
            is_pinned: standing.is_pinned,
        })
    }
}
