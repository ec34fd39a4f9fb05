//! Candidate poses between nodes, a spanning tree of them, and the votes across its cuts.
//!
//! Every hypothesis of every edge (its estimate, and the rivals of an ambiguous one) is a
//! candidate; of one edge at most one can be right. A tree of the candidates that close most
//! triangles gives first poses; an edge agrees if one of its candidates and the tree's path close
//! a loop within their covariances. Across each cut of the tree the edges vote: those that agree
//! with the tree against the largest set of others that agree with one another. Where the others
//! are more, the far side is hung on one of theirs, until no cut is outvoted. This climbs in the
//! number of agreeing edges; it needs no start near the answer and no triangles.

use super::relative::{Pose, Relative};
use crate::statistics::POSE_GATE;

/// Candidates of one cut that are tried as the centre of a set: more need not be tried, because a
/// set that could win has most of them.
const MAX_CENTRES: usize = 48;

/// One hypothesis of an edge.
#[derive(Clone, Debug)]
pub(super) struct Candidate {
    /// Index of the edge as given.
    pub(super) edge: usize,
    /// `None` for the estimate, else which rival.
    pub(super) rival_index: Option<usize>,
    pub(super) is_determined: bool,
    /// Node that the pose is given in, the smaller index.
    pub(super) from: usize,
    pub(super) to: usize,
    pub(super) step: Relative,
}

/// Candidates between nodes `0..node_count`.
#[derive(Clone, Debug, Default)]
pub(super) struct Graph {
    pub(super) node_count: usize,
    pub(super) candidates: Vec<Candidate>,
    /// Candidates by edge: those of one edge stand together.
    pub(super) edges: Vec<std::ops::Range<usize>>,
    of_node: Vec<Vec<usize>>,
}

impl Graph {
    /// The graph of candidates that stand edge by edge.
    pub(super) fn new(node_count: usize, candidates: Vec<Candidate>) -> Self {
        let mut graph = Self { node_count, candidates, ..Self::default() };
        graph.of_node = vec![Vec::new(); node_count];
        for (index, candidate) in graph.candidates.iter().enumerate() {
            graph.of_node[candidate.from].push(index);
            graph.of_node[candidate.to].push(index);
            match graph.edges.last_mut() {
                Some(last) if graph.candidates[last.start].edge == candidate.edge => {
                    last.end = index + 1;
                }
                _ => graph.edges.push(index..index + 1),
            }
        }
        graph
    }

    /// The part between the given nodes, which are in ascending order, with new indices.
    pub(super) fn part(&self, nodes: &[usize]) -> Self {
        let index_of = |node: usize| nodes.binary_search(&node).ok();
        let inside = self.candidates.iter().filter_map(|candidate| {
            let (from, to) = (index_of(candidate.from)?, index_of(candidate.to)?);
            Some(Candidate { from, to, ..candidate.clone() })
        });
        Self::new(nodes.len(), inside.collect())
    }

    /// Sets of nodes that the given candidates join, each ascending, by first node.
    pub(super) fn components(&self, joins: impl Fn(usize) -> bool) -> Vec<Vec<usize>> {
        let mut set_of: Vec<Option<usize>> = vec![None; self.node_count];
        let mut sets = Vec::new();
        for root in 0..self.node_count {
            if set_of[root].is_some() {
                continue;
            }
            set_of[root] = Some(sets.len());
            let mut set = vec![root];
            let mut next = 0;
            while next < set.len() {
                let joined = self.of_node[set[next]].iter().filter(|index| joins(**index));
                let others = joined.map(|index| self.candidates[*index].other(set[next]));
                let mut new: Vec<usize> = others.filter(|other| set_of[*other].is_none()).collect();
                new.sort_unstable();
                new.dedup();
                new.iter().for_each(|other| set_of[*other] = Some(sets.len()));
                set.append(&mut new);
                next += 1;
            }
            set.sort_unstable();
            sets.push(set);
        }
        sets
    }

    /// How many triangles of candidates each one closes.
    fn supports(&self) -> Vec<usize> {
        let mut between = vec![Vec::new(); self.node_count * self.node_count];
        for (index, candidate) in self.candidates.iter().enumerate() {
            between[candidate.from * self.node_count + candidate.to].push(index);
        }
        let mut supports = vec![0; self.candidates.len()];
        for (first, one) in self.candidates.iter().enumerate() {
            let follows = |index: &&usize| self.candidates[**index].from == one.to;
            for &second in self.of_node[one.to].iter().filter(follows) {
                let other = &self.candidates[second];
                let direct = &between[one.from * self.node_count + other.to];
                let closes = |third: &&usize| one.closes(other, &self.candidates[**third]);
                let closing = direct.iter().filter(closes);
                closing
                    .flat_map(|third| [first, second, *third])
                    .for_each(|index| supports[index] += 1);
            }
        }
        supports
    }

    /// A spanning tree of candidates, the best supported first; the graph must be connected.
    fn best_tree(&self) -> Vec<usize> {
        let supports = self.supports();
        let key = |index: usize| {
            let candidate = &self.candidates[index];
            let votes = supports[index] + usize::from(candidate.is_determined);
            (votes as f64, -candidate.step.covariance.trace())
        };
        self.spanning(|a, b| key(a).0.total_cmp(&key(b).0).then(key(a).1.total_cmp(&key(b).1)))
    }

    /// Prim's tree from node 0, greatest candidate first.
    fn spanning(&self, order: impl Fn(usize, usize) -> std::cmp::Ordering) -> Vec<usize> {
        let mut is_in = vec![false; self.node_count];
        let mut tree = Vec::new();
        let mut open: Vec<usize> = Vec::new();
        let mut node = 0;
        loop {
            is_in[node] = true;
            open.extend(&self.of_node[node]);
            let is_open = |index: &usize| {
                let candidate = &self.candidates[*index];
                is_in[candidate.from] != is_in[candidate.to]
            };
            open.retain(is_open);
            let best = open.iter().max_by(|a, b| order(**a, **b).then(b.cmp(a)));
            let Some(&best) = best else { return tree };
            tree.push(best);
            let candidate = &self.candidates[best];
            node = if is_in[candidate.from] { candidate.to } else { candidate.from };
        }
    }
}

impl Candidate {
    pub(super) fn other(&self, node: usize) -> usize {
        if self.from == node { self.to } else { self.from }
    }

    /// The pose of the other end as seen from `node`.
    pub(super) fn step_from(&self, node: usize) -> Relative {
        if self.from == node { self.step } else { self.step.inverse() }
    }

    /// Whether this step and the next agree with the direct one.
    fn closes(&self, next: &Self, direct: &Self) -> bool {
        let heading_rad = |candidate: &Self| candidate.step.pose.heading_rad();
        let turn = heading_rad(self) + heading_rad(next) - heading_rad(direct);
        let heading = proto::geom::wrap_angle(turn);
        let variance = |candidate: &Self| candidate.step.covariance[(2, 2)];
        // The heading alone tells most wrong ones, and costs little.
        let allowed = POSE_GATE * (variance(self) + variance(next) + variance(direct));
        heading * heading < allowed
            && self.step.then(&next.step).chi_square_to(&direct.step) < POSE_GATE
    }
}

/// A rooted spanning tree with the poses of all nodes in node 0's frame.
#[derive(Clone, Debug)]
pub(super) struct Tree {
    /// `(parent, candidate)`; `None` for node 0.
    pub(super) parent: Vec<Option<(usize, usize)>>,
    pub(super) poses: Vec<Pose>,
    depth: Vec<usize>,
    /// Node, then its descendants, are numbered `entry[node]..exit[node]`.
    entry: Vec<usize>,
    exit: Vec<usize>,
}

impl Tree {
    /// Hangs all nodes on the candidates of `links` from node 0, nearest first.
    pub(super) fn hang(graph: &Graph, links: &[usize]) -> Self {
        let count = graph.node_count;
        let mut tree = Self {
            parent: vec![None; count],
            poses: vec![Pose::identity(); count],
            depth: vec![0; count],
            entry: vec![0; count],
            exit: vec![1; count],
        };
        let mut touching: Vec<Vec<usize>> = vec![Vec::new(); count];
        for &index in links {
            touching[graph.candidates[index].from].push(index);
            touching[graph.candidates[index].to].push(index);
        }
        let mut order = vec![0];
        let mut next = 0;
        while next < order.len() {
            let node = order[next];
            next += 1;
            let is_new = |(other, _): &(usize, usize)| *other != 0 && tree.parent[*other].is_none();
            let ends = touching[node].iter().map(|i| (graph.candidates[*i].other(node), *i));
            let mut new: Vec<(usize, usize)> = ends.filter(is_new).collect();
            new.sort_unstable();
            new.dedup_by_key(|(other, _)| *other);
            for (other, index) in new {
                tree.parent[other] = Some((node, index));
                tree.depth[other] = tree.depth[node] + 1;
                let step = graph.candidates[index].step_from(node);
                tree.poses[other] = tree.poses[node] * step.pose;
                order.push(other);
            }
        }
        tree.number(&order);
        tree
    }

    fn number(&mut self, order: &[usize]) {
        let mut sizes = vec![1; order.len()];
        for &node in order.iter().rev() {
            if let Some((parent, _)) = self.parent[node] {
                sizes[parent] += sizes[node];
            }
        }
        let mut next_free: Vec<usize> = vec![1; order.len()];
        for &node in order {
            if let Some((parent, _)) = self.parent[node] {
                self.entry[node] = next_free[parent];
                next_free[parent] += sizes[node];
                next_free[node] = self.entry[node] + 1;
            }
            self.exit[node] = self.entry[node] + sizes[node];
        }
    }

    /// Whether `node` is `top` or hangs below it.
    pub(super) fn is_below(&self, node: usize, top: usize) -> bool {
        (self.entry[top]..self.exit[top]).contains(&self.entry[node])
    }

    /// The nodes from 0 to `node`.
    pub(super) fn route(&self, node: usize) -> Vec<usize> {
        let above = |at: &usize| self.parent[*at].map(|(parent, _)| parent);
        let mut nodes: Vec<usize> = std::iter::successors(Some(node), above).collect();
        nodes.reverse();
        nodes
    }

    /// `to` as seen from `from`: the pose by the tree's poses, the covariance along its links.
    pub(super) fn path(&self, graph: &Graph, from: usize, to: usize) -> Relative {
        let (mut left, mut right) = (from, to);
        let (mut to_left, mut to_right) = (Relative::identity(), Relative::identity());
        while left != right {
            let (side, so_far) = if self.depth[left] < self.depth[right] {
                (&mut right, &mut to_right)
            } else {
                (&mut left, &mut to_left)
            };
            let Some((parent, link)) = self.parent[*side] else { break };
            *so_far = graph.candidates[link].step_from(parent).then(so_far);
            *side = parent;
        }
        let pose = self.poses[from].inverse() * self.poses[to];
        let covariance = to_left.inverse().then(&to_right).covariance;
        Relative { pose, covariance }
    }
}

/// A tree and which candidate of each edge agrees with it.
#[derive(Clone, Debug)]
pub(super) struct Consensus {
    pub(super) tree: Tree,
    /// By position in `Graph::edges`: the agreeing candidate.
    pub(super) chosen: Vec<Option<usize>>,
}

/// A side of a cut that could lie elsewhere.
#[derive(Clone, Debug)]
pub(super) struct Cut {
    /// By node: whether it is on the side without node 0.
    pub(super) is_far: Vec<bool>,
    /// The node of the near side and that of the far side whose pose is voted on.
    pub(super) anchors: (usize, usize),
}

/// What the disagreeing candidates across a cut say.
#[derive(Clone, Debug)]
pub(super) struct Votes {
    /// Edges across the cut that agree with the poses as they are.
    pub(super) kept_count: usize,
    /// Edges of the largest set that agree on another pose.
    pub(super) other_count: usize,
    /// The candidate at the centre of that set.
    pub(super) centre: Option<usize>,
    /// The far anchor's pose in node 0's frame by that candidate.
    pub(super) rival: Pose,
}

impl Consensus {
    /// The consensus that no cut of the tree outvotes. The graph must be connected.
    pub(super) fn find(graph: &Graph) -> Self {
        let mut links = graph.best_tree();
        let mut current = Self::of(graph, &links);
        // Each round moves one subtree; a graph that needs more rounds than nodes goes in circles.
        for _ in 0..graph.node_count {
            let Some((from, to)) = current.outvoted(graph) else { break };
            links.iter_mut().filter(|link| **link == from).for_each(|link| *link = to);
            current = Self::of(graph, &links);
        }
        current
    }

    fn of(graph: &Graph, links: &[usize]) -> Self {
        let tree = Tree::hang(graph, links);
        let is_link = |index: usize| {
            let candidate = &graph.candidates[index];
            let hangs = |child: usize| tree.parent[child].is_some_and(|(_, link)| link == index);
            hangs(candidate.from) || hangs(candidate.to)
        };
        let best = |range: &std::ops::Range<usize>| {
            let linked = range.clone().find(|index| is_link(*index));
            linked.or_else(|| {
                let candidate = &graph.candidates[range.start];
                let path = tree.path(graph, candidate.from, candidate.to);
                let distance = |index: usize| graph.candidates[index].step.chi_square_to(&path);
                let nearest = range.clone().map(|index| (distance(index), index));
                let nearest = nearest.min_by(|a, b| a.0.total_cmp(&b.0));
                nearest.filter(|(chi_square, _)| *chi_square < POSE_GATE).map(|(_, index)| index)
            })
        };
        let chosen = graph.edges.iter().map(best).collect();
        Self { tree, chosen }
    }

    /// The cut below `node`'s link to its parent.
    pub(super) fn cut_above(&self, node: usize) -> Option<Cut> {
        let (parent, _) = self.tree.parent[node]?;
        let count = self.tree.parent.len();
        let is_far = (0..count).map(|other| self.tree.is_below(other, node)).collect();
        Some(Cut { is_far, anchors: (parent, node) })
    }

    /// The link to replace and the candidate that replaces it, where a cut gains most.
    fn outvoted(&self, graph: &Graph) -> Option<(usize, usize)> {
        let gain = |node: usize| {
            let (_, link) = self.tree.parent[node]?;
            let votes = self.votes(graph, &self.cut_above(node)?)?;
            let gain = votes.other_count.checked_sub(votes.kept_count + 1)?;
            Some((gain, link, votes.centre?))
        };
        let best = (1..graph.node_count)
            .filter_map(gain)
            .max_by_key(|(gain, link, _)| (*gain, std::cmp::Reverse(*link)));
        best.map(|(_, link, centre)| (link, centre))
    }

    /// The votes across the cut; `None` where the others are too few to win or tie even together.
    pub(super) fn votes(&self, graph: &Graph, cut: &Cut) -> Option<Votes> {
        let crosses = |range: &std::ops::Range<usize>| {
            let candidate = &graph.candidates[range.start];
            cut.is_far[candidate.from] != cut.is_far[candidate.to]
        };
        let across: Vec<usize> =
            (0..graph.edges.len()).filter(|edge| crosses(&graph.edges[*edge])).collect();
        let kept_count = across.iter().filter(|edge| self.chosen[**edge].is_some()).count();
        let has_others =
            |edge: usize| graph.edges[edge].len() > usize::from(self.chosen[edge].is_some());
        let other_edge_count = across.iter().filter(|edge| has_others(**edge)).count();
        if other_edge_count < kept_count {
            return None;
        }
        let others = across.iter().flat_map(|edge| {
            let is_other = |index: &usize| self.chosen[*edge] != Some(*index);
            graph.edges[*edge].clone().filter(is_other)
        });
        let implied: Vec<(usize, Relative)> =
            others.map(|index| (index, self.implied(graph, cut, index))).collect();
        Some(self.largest_set(graph, cut, (kept_count, &implied)))
    }

    fn largest_set(
        &self,
        graph: &Graph,
        cut: &Cut,
        (kept_count, implied): (usize, &[(usize, Relative)]),
    ) -> Votes {
        // Candidates of one edge stand together; each edge has one vote.
        let agreeing = |centre: &Relative| {
            implied
                .chunk_by(|a, b| graph.candidates[a.0].edge == graph.candidates[b.0].edge)
                .filter(|of_edge| {
                    of_edge.iter().any(|(_, other)| centre.chi_square_to(other) < POSE_GATE)
                })
                .count()
        };
        let stride = implied.len().div_ceil(MAX_CENTRES).max(1);
        let centres = implied.iter().step_by(stride);
        let best = centres.map(|(index, centre)| (agreeing(centre), *index, centre));
        let best = best.max_by_key(|(count, index, _)| (*count, std::cmp::Reverse(*index)));
        let near = self.tree.poses[cut.anchors.0];
        Votes {
            kept_count,
            other_count: best.map_or(0, |(count, ..)| count),
            centre: best.map(|(_, index, _)| index),
            rival: best.map_or(near, |(.., pose)| near * pose.pose),
        }
    }

    /// The far anchor as seen from the near one by way of a candidate across the cut.
    fn implied(&self, graph: &Graph, cut: &Cut, index: usize) -> Relative {
        let candidate = &graph.candidates[index];
        let near = if cut.is_far[candidate.from] { candidate.to } else { candidate.from };
        let far = candidate.other(near);
        let to_near = self.tree.path(graph, cut.anchors.0, near);
        let to_anchor = self.tree.path(graph, far, cut.anchors.1);
        to_near.then(&candidate.step_from(near)).then(&to_anchor)
    }
}
