//! Groups from edges: the largest consistent set, its adjustment, and what stays undecided.
//!
//! ```text
//! edges ── candidates ── connected parts ── consensus ── adjust ⇄ judge ── cuts that tie ── groups
//!                              ▲                                                │
//!                              └───────────── the part falls into two ──────────┘
//! ```
//! A cut ties where the edges that agree across it are no more than the largest set of others that
//! agree on another pose. An ambiguous edge votes for each of its poses, so that a node behind it
//! alone is undecided, and is decided where other edges side with one of its poses. One wrong edge
//! against a node's only good one is a tie too: with no third witness nothing tells which is wrong.

use std::collections::BTreeMap;

use nalgebra::{Matrix3, Vector3};
use proto::ids::NodeId;

use super::adjust::{Adjusted, Link, adjust, shares};
use super::graph::{Candidate, Consensus, Cut, Graph, Tree};
use super::relative::{Pose, Relative};
use super::{Combined, Edge, Group, Placed, Refinement, Standing, Verdict};
use crate::registration::{Outcome, PoseEstimate, Rival};
use crate::statistics::POSE_GATE;

/// Most rounds of adjusting and judging; each drops the worst edge of a part.
const MAX_ROUND_COUNT: usize = 8;

/// By how much the covariance of a rival is taken wider than that of the estimate, whose shape it
/// does not share: twice the diagonal blocks bound a covariance whatever its correlations.
const RIVAL_WIDENING: f64 = 2.0;

/// The groups that the edges join, each node in exactly one, and what became of every edge.
/// `nodes` that no edge reaches are groups of their own; edges to other nodes are unusable.
#[must_use]
pub(super) fn combine_as_given(reference: &NodeId, nodes: &[NodeId], edges: &[Edge]) -> Combined {
    let mut names: Vec<NodeId> = nodes.to_vec();
    names.sort_by(|a, b| (a != reference, a).cmp(&(b != reference, b)));
    names.dedup();
    let graph = graph_of(&names, edges);
    let mut state = State {
        graph: &graph,
        names: &names,
        verdicts: vec![Verdict::Unusable; edges.len()],
        groups: Vec::new(),
    };
    let mut todo: Vec<Part> = graph
        .components(|_| true)
        .into_iter()
        .map(|set| Part { nodes: set, doubtful: BTreeMap::new() })
        .collect();
    while let Some(part) = todo.pop() {
        todo.extend(state.place(part));
    }
    let State { verdicts, mut groups, .. } = state;
    let order = |group: &Group| (group.gauge != *reference, group.gauge.clone());
    groups.sort_by_key(order);
    describe_lonely(&mut groups, edges, &verdicts);
    Combined { groups, verdicts }
}

/// Nodes still to be placed, ascending, and those whose place in the first one's frame is open.
struct Part {
    nodes: Vec<usize>,
    doubtful: BTreeMap<NodeId, Placed>,
}

struct State<'a> {
    graph: &'a Graph,
    names: &'a [NodeId],
    verdicts: Vec<Verdict>,
    groups: Vec<Group>,
}

/// A part with its consensus and poses.
struct Settled {
    graph: Graph,
    consensus: Consensus,
    adjusted: Option<Adjusted>,
    /// By position in `Graph::edges`, for kept edges: squared distance from what others say.
    chi_squares: Vec<Option<f64>>,
    /// By node: kept edges across the cut above it.
    kept_above: Vec<usize>,
}

/// A cut that ties, with the other pose of its far anchor.
struct Tie {
    cut: Cut,
    rival: Pose,
}

impl State<'_> {
    /// Places one part, or returns what it falls into.
    fn place(&mut self, part: Part) -> Vec<Part> {
        let Part { nodes, mut doubtful } = part;
        let settled = Settled::new(self.graph.part(&nodes));
        let ties = settled.ties();
        self.judge(&settled, &ties);
        if ties.is_empty() {
            self.groups.push(self.group(&settled, &nodes, doubtful));
            return Vec::new();
        }
        let is_inside = |index: usize| {
            let candidate = &settled.graph.candidates[index];
            let crosses =
                |tie: &Tie| tie.cut.is_far[candidate.from] != tie.cut.is_far[candidate.to];
            settled.is_kept(index) && !ties.iter().any(crosses)
        };
        let sets = settled.graph.components(is_inside);
        let local_names: Vec<&NodeId> = nodes.iter().map(|node| &self.names[*node]).collect();
        for &node in sets.iter().skip(1).flatten() {
            doubtful.insert(local_names[node].clone(), settled.doubtful(node, &ties, &local_names));
        }
        let to_part = |(index, set): (usize, Vec<usize>)| Part {
            nodes: set.into_iter().map(|node| nodes[node]).collect(),
            doubtful: if index == 0 { std::mem::take(&mut doubtful) } else { BTreeMap::new() },
        };
        sets.into_iter().enumerate().map(to_part).collect()
    }

    fn judge(&mut self, settled: &Settled, ties: &[Tie]) {
        for (position, range) in settled.graph.edges.iter().enumerate() {
            let candidate = &settled.graph.candidates[range.start];
            let crosses =
                |tie: &Tie| tie.cut.is_far[candidate.from] != tie.cut.is_far[candidate.to];
            self.verdicts[candidate.edge] = if ties.iter().any(crosses) {
                Verdict::Undecided
            } else if let Some(chosen) = settled.consensus.chosen[position] {
                let rival_index = settled.graph.candidates[chosen].rival_index;
                Verdict::Kept { rival_index, loop_chi_square: settled.chi_squares[position] }
            } else {
                settled.rejection(range)
            };
        }
    }

    fn group(
        &self,
        settled: &Settled,
        nodes: &[usize],
        doubtful: BTreeMap<NodeId, Placed>,
    ) -> Group {
        let names: Vec<&NodeId> = nodes.iter().map(|node| &self.names[*node]).collect();
        let placed = (0..names.len()).map(|node| {
            let placed = Placed {
                estimate: settled.placed(node).estimate(),
                via: settled.route(node, &names),
                standing: settled.standing(node),
            };
            (names[node].clone(), placed)
        });
        Group {
            gauge: names[0].clone(),
            nodes: placed.collect(),
            doubtful,
            refinement: Refinement::Untried,
        }
    }
}

impl Settled {
    fn new(graph: Graph) -> Self {
        let consensus = Consensus::find(&graph);
        let mut settled = Self {
            adjusted: None,
            chi_squares: vec![None; graph.edges.len()],
            kept_above: Vec::new(),
            consensus,
            graph,
        };
        settled.adjust();
        for round in 0..MAX_ROUND_COUNT {
            let is_revised = settled.drop_worst() || (round == 0 && settled.readmit());
            if !is_revised {
                break;
            }
            settled.adjust();
        }
        settled.kept_above = settled.count_kept();
        settled
    }

    fn is_kept(&self, index: usize) -> bool {
        self.consensus.chosen.contains(&Some(index))
    }

    fn link(&self, index: usize) -> Link {
        let candidate = &self.graph.candidates[index];
        Link { from: candidate.from, to: candidate.to, step: candidate.step }
    }

    /// Poses of the kept edges, and how far each lies from what the others say.
    fn adjust(&mut self) {
        let kept: Vec<usize> = self.consensus.chosen.iter().flatten().copied().collect();
        let poses = std::mem::take(&mut self.consensus.tree.poses);
        self.consensus.tree = Tree::hang(&self.graph, &kept);
        let links: Vec<Link> = kept.iter().map(|index| self.link(*index)).collect();
        self.adjusted = adjust(&poses, &links);
        self.chi_squares.fill(None);
        let Some(adjusted) = &self.adjusted else { return };
        self.consensus.tree.poses.clone_from(&adjusted.poses);
        let mut distances = links
            .iter()
            .zip(shares(poses.len(), &links))
            .map(|(link, share)| adjusted.inside_chi_square(link, share));
        for (chosen, chi_square) in self.consensus.chosen.iter().zip(&mut self.chi_squares) {
            *chi_square = chosen.and_then(|_| distances.next().flatten());
        }
    }

    /// Drops the kept edge that contradicts the others most, if one does.
    fn drop_worst(&mut self) -> bool {
        let distance = |position: &usize| self.chi_squares[*position].unwrap_or(0.0);
        let worst = (0..self.chi_squares.len())
            .max_by(|a, b| distance(a).total_cmp(&distance(b)).then(b.cmp(a)))
            .filter(|position| distance(position) > POSE_GATE);
        if let Some(worst) = worst {
            self.consensus.chosen[worst] = None;
        }
        worst.is_some()
    }

    /// Takes in the edges that agree after all, if there are any.
    fn readmit(&mut self) -> bool {
        let Some(adjusted) = &self.adjusted else { return false };
        let agreeing = |range: &std::ops::Range<usize>| {
            let mut agrees = range.clone();
            agrees.find(|index| adjusted.outside_chi_square(&self.link(*index)) < POSE_GATE)
        };
        let is_out = |position: &usize| self.consensus.chosen[*position].is_none();
        let found = (0..self.graph.edges.len())
            .filter(is_out)
            .filter_map(|position| Some((position, agreeing(&self.graph.edges[position])?)));
        let found: Vec<(usize, usize)> = found.collect();
        for (position, index) in &found {
            self.consensus.chosen[*position] = Some(*index);
        }
        !found.is_empty()
    }

    fn count_kept(&self) -> Vec<usize> {
        let crosses = |node: usize, index: usize| {
            let (candidate, tree) = (&self.graph.candidates[index], &self.consensus.tree);
            tree.is_below(candidate.from, node) != tree.is_below(candidate.to, node)
        };
        let kept = || self.consensus.chosen.iter().flatten();
        (0..self.graph.node_count)
            .map(|node| kept().filter(|index| crosses(node, **index)).count())
            .collect()
    }

    /// Cuts across which others agree that are no fewer: those of the tree and around each node.
    fn ties(&self) -> Vec<Tie> {
        let count = self.graph.node_count;
        let around = |node: usize| {
            let parent = self.consensus.tree.parent[node];
            let child = (0..count).find(|other| {
                self.consensus.tree.parent[*other].is_some_and(|(top, _)| top == node)
            });
            // Around node 0 the far side is all the rest.
            let is_far = (0..count).map(|other| (other == node) == (node != 0)).collect();
            let anchors = if node == 0 { (0, child?) } else { (parent?.0, node) };
            Some(Cut { is_far, anchors })
        };
        let above = (1..count).filter_map(|node| self.consensus.cut_above(node));
        above
            .chain((0..count).filter_map(around))
            .filter_map(|cut| {
                let votes = self.consensus.votes(&self.graph, &cut)?;
                let ties = votes.other_count > 0 && votes.other_count >= votes.kept_count;
                ties.then_some(Tie { cut, rival: votes.rival })
            })
            .collect()
    }

    fn placed(&self, node: usize) -> Relative {
        match &self.adjusted {
            Some(adjusted) => adjusted.placed(node),
            None => self.consensus.tree.path(&self.graph, 0, node),
        }
    }

    fn route(&self, node: usize, names: &[&NodeId]) -> Vec<NodeId> {
        self.consensus.tree.route(node).into_iter().map(|step| names[step].clone()).collect()
    }

    fn standing(&self, node: usize) -> Standing {
        if node == 0 {
            return Standing::Gauge;
        }
        let route = self.consensus.tree.route(node);
        let fewest = route[1..].iter().map(|step| self.kept_above[*step]).min();
        match fewest {
            Some(count) if count > 1 => Standing::Confirmed { way_count: count },
            _ => Standing::Unconfirmed,
        }
    }

    /// A node behind a tie as it most likely lies, with the poses that it could have instead.
    fn doubtful(&self, node: usize, ties: &[Tie], names: &[&NodeId]) -> Placed {
        let poses = &self.consensus.tree.poses;
        let moved = |tie: &Tie| tie.rival * (poses[tie.cut.anchors.1].inverse() * poses[node]);
        let rivals = ties.iter().filter(|tie| tie.cut.is_far[node]).map(|tie| moved(tie).renamed());
        Placed {
            estimate: self.placed(node).estimate(),
            via: self.route(node, names),
            standing: Standing::Undecided { rivals: rivals.collect() },
        }
    }

    fn rejection(&self, range: &std::ops::Range<usize>) -> Verdict {
        let candidate = &self.graph.candidates[range.start];
        let tree = &self.consensus.tree;
        let is_between = |node: &usize| {
            tree.is_below(candidate.from, *node) != tree.is_below(candidate.to, *node)
        };
        let against =
            (1..self.graph.node_count).filter(is_between).map(|node| self.kept_above[node]);
        let distance = |index: usize| match &self.adjusted {
            Some(adjusted) => adjusted.outside_chi_square(&self.link(index)),
            None => f64::INFINITY,
        };
        let loop_chi_square = range.clone().map(distance).fold(f64::INFINITY, f64::min);
        Verdict::Rejected { loop_chi_square, against_count: against.min().unwrap_or(0) }
    }
}

/// Says of nodes that are alone what became of their edges.
fn describe_lonely(groups: &mut [Group], edges: &[Edge], verdicts: &[Verdict]) {
    for group in groups.iter_mut().filter(|group| group.nodes.len() == 1) {
        let touches = |edge: &Edge| edge.first == group.gauge || edge.second == group.gauge;
        let mine = || edges.iter().zip(verdicts).filter(|(edge, _)| touches(edge));
        let unusable_count = mine().filter(|(_, v)| **v == Verdict::Unusable).count();
        let contradicted_count = mine().count() - unusable_count;
        for placed in group.nodes.values_mut() {
            placed.standing = Standing::Alone { unusable_count, contradicted_count };
        }
    }
}

fn graph_of(names: &[NodeId], edges: &[Edge]) -> Graph {
    let index_by_name: BTreeMap<&NodeId, usize> =
        names.iter().enumerate().map(|(index, name)| (name, index)).collect();
    let mut candidates = Vec::new();
    for (index, edge) in edges.iter().enumerate() {
        let ends = (index_by_name.get(&edge.first), index_by_name.get(&edge.second));
        let (Some(&first), Some(&second)) = ends else { continue };
        let steps = if first == second { Vec::new() } else { steps_of(edge) };
        for (hypothesis, step) in steps.into_iter().enumerate() {
            candidates.push(Candidate {
                edge: index,
                rival_index: hypothesis.checked_sub(1),
                is_determined: edge.solution.outcome == Outcome::Determined,
                from: first.min(second),
                to: first.max(second),
                step: if first < second { step } else { step.inverse() },
            });
        }
    }
    Graph::new(names.len(), candidates)
}

/// The poses that an edge allows, the estimate first; none where it has no usable one.
fn steps_of(edge: &Edge) -> Vec<Relative> {
    let rivals: &[Rival] = match &edge.solution.outcome {
        Outcome::Determined => &[],
        Outcome::Ambiguous { rivals } => rivals,
        Outcome::Underdetermined { .. } => return Vec::new(),
    };
    let Some(best) = edge.solution.estimate.as_ref().and_then(Relative::usable) else {
        return Vec::new();
    };
    let covariance = rival_covariance(&best.covariance);
    let rival = |rival: &Rival| {
        let pose_ref_from_node = rival.pose_ref_from_node;
        Relative::usable(&PoseEstimate { pose_ref_from_node, covariance })
    };
    std::iter::once(best).chain(rivals.iter().filter_map(rival)).collect()
}

fn rival_covariance(best: &Matrix3<f64>) -> Matrix3<f64> {
    let position = best.fixed_view::<2, 2>(0, 0).into_owned();
    let (sigma_m, _, _) = proto::geom::principal_axes(&position);
    let variance_m2 = RIVAL_WIDENING * sigma_m * sigma_m;
    Matrix3::from_diagonal(&Vector3::new(variance_m2, variance_m2, RIVAL_WIDENING * best[(2, 2)]))
}

#[cfg(test)]
mod tests;
