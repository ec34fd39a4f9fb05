//! What every branch expects of a look, its candidates among the plots, and who contests what.
//!
//! All memory is kept from look to look.

use crate::tracking::assign::{AssignError, Edges, Solver};
use crate::tracking::gate::{Grid, cell_size_m};
use crate::tracking::{Area, Look, Plot};

use super::config::DefaultConfig;
use super::coverage::may_be_inside;
use super::imm::Steps;
use super::prices::Prices;
use super::row::{Edge, Reach, Row};
use super::target::Target;

/// No target, no plot.
pub(super) const NONE: u32 = u32::MAX;
/// A target is left alone by a look that covers it with less probability, and has no plot for it.
const MIN_INSIDE: f64 = 0.01;
/// A target farther outside the area than so many standard deviations is not looked at.
const FAR_SIGMAS: f64 = 6.0;

/// Whether a target takes a plot that nobody else wants is left open only within so many nats: no
/// identity depends on it, and the filter forgives one plot.
const ALONE_NATS: f64 = 2.0;

/// A target that a look concerns, and the rows of its branches.
#[derive(Clone, Copy, Debug)]
pub(super) struct Touched {
    pub(super) target: u32,
    pub(super) first_row: u32,
    pub(super) end_row: u32,
    /// The plot that it gets in the best assignment.
    pub(super) own: u32,
    /// The best assignment is not clear for it.
    pub(super) unclear: bool,
}

/// Memory for a look.
#[derive(Debug, Default)]
pub(super) struct Work {
    pub(super) rows: Vec<Row>,
    pub(super) edges: Vec<Edge>,
    pub(super) touched: Vec<Touched>,
    /// Where each target is in `touched`.
    pub(super) place_of: Vec<u32>,
    /// Plots that somebody takes.
    pub(super) used: Vec<bool>,
    steps: Option<Steps>,
    reaches: Vec<Reach>,
    radii_m: Vec<f64>,
    points_m: Vec<[f64; 2]>,
    grid: Grid,
    matrix: Edges,
    solver: Solver,
    pairs: Vec<(u32, f64)>,
    /// The plot of each row in the best assignment.
    own: Vec<u32>,
    prices: Prices,
    /// A member of the same group, or itself.
    above: Vec<u32>,
    /// The first target that contests each plot.
    first: Vec<u32>,
}

/// `index` as it is kept.
pub(super) fn short(index: usize) -> u32 {
    u32::try_from(index).unwrap_or(NONE)
}

/// Variance of a plot's place in the direction in which it is largest, m².
fn widest_m2(plot: &Plot) -> f64 {
    let r = &plot.covariance_m2;
    let [half, mean] = [0.5 * (r[(0, 0)] - r[(1, 1)]), 0.5 * (r[(0, 0)] + r[(1, 1)])];
    mean + half.hypot(r[(0, 1)])
}

fn may_be_seen(target: &Target, look: &Look<'_>, config: &DefaultConfig) -> bool {
    if look.coverage.area == Area::Everywhere {
        return true;
    }
    target.leaves.iter().any(|leaf| {
        let state = leaf.imm.merged();
        let dt_s = look.time_s - leaf.time_s;
        let push_m2 = config.lively.push_m2_per_s3 * dt_s.powi(3) / 3.0;
        let speed_m_per_s = state.velocity_variance(1.0, 0.0) + state.velocity_variance(0.0, 1.0);
        let sigma_m = (state.widest_m2() + push_m2).sqrt() + dt_s * speed_m_per_s.sqrt();
        let standing = [state.mean[0], state.mean[1]].into();
        let moved = standing + nalgebra::Vector2::new(state.mean[2], state.mean[3]) * dt_s;
        let near = |place| may_be_inside(&look.coverage.area, place, FAR_SIGMAS * sigma_m);
        near(moved) || leaf.stand.is_some() && near(standing)
    })
}

impl Work {
    /// Fills in rows, edges and touched targets for a look.
    pub(super) fn expect(&mut self, targets: &[Target], look: &Look<'_>, config: &DefaultConfig) {
        self.rows.clear();
        self.edges.clear();
        self.touched.clear();
        self.place_of.clear();
        self.place_of.resize(targets.len(), NONE);
        self.used.clear();
        self.used.resize(look.plots.len(), false);
        self.reaches.clear();
        let variance_m2 = look.plots.iter().map(widest_m2).fold(0.0, f64::max);
        let ways = config.ways();
        for (index, target) in targets.iter().enumerate() {
            if !may_be_seen(target, look, config) {
                continue;
            }
            let first_row = short(self.rows.len());
            for (leaf, branch) in target.leaves.iter().enumerate() {
                let dt_s = look.time_s - branch.time_s;
                let steps = Steps::of(dt_s, &ways, &mut self.steps);
                let mut row = Row::new(branch, &steps, look, config);
                (row.target, row.leaf) = (short(index), short(leaf));
                self.reaches.push(row.reach(branch, variance_m2, config));
                self.rows.push(row);
            }
            let end_row = short(self.rows.len());
            self.touched.push(Touched {
                target: short(index),
                first_row,
                end_row,
                own: NONE,
                unclear: false,
            });
        }
        self.find_edges(targets, look, config);
        self.drop_unseen();
    }

    fn find_edges(&mut self, targets: &[Target], look: &Look<'_>, config: &DefaultConfig) {
        if look.plots.is_empty() {
            return;
        }
        self.points_m.clear();
        self.points_m.extend(look.plots.iter().map(|plot| [plot.position_m.x, plot.position_m.y]));
        self.radii_m.clear();
        self.radii_m.extend(self.reaches.iter().map(|reach| reach.radius_m));
        let cell_m = cell_size_m(&mut self.radii_m).unwrap_or(1.0);
        // Places were checked, so that neither filling nor asking can fail.
        if self.grid.fill(&self.points_m, cell_m).is_err() {
            return;
        }
        for (row, reach) in self.rows.iter_mut().zip(&self.reaches) {
            row.first_edge = short(self.edges.len());
            let branch = &targets[row.target as usize].leaves[row.leaf as usize];
            let edges = &mut self.edges;
            let asked = self.grid.for_each_within(reach.middle_m, reach.radius_m, |index, _| {
                edges.extend(row.edge(branch, (short(index), &look.plots[index]), config));
            });
            row.end_edge = if asked.is_ok() { short(self.edges.len()) } else { row.first_edge };
        }
    }

    /// Forgets targets that the look does not concern.
    fn drop_unseen(&mut self) {
        let rows = &self.rows;
        self.touched.retain(|touched| {
            let of = &rows[touched.first_row as usize..touched.end_row as usize];
            of.iter().any(|row| MIN_INSIDE <= row.seen.inside || row.first_edge < row.end_edge)
        });
        for (place, touched) in self.touched.iter().enumerate() {
            self.place_of[touched.target as usize] = short(place);
        }
    }

    /// The rows of a touched target.
    pub(super) fn rows_of(&self, touched: &Touched) -> &[Row] {
        &self.rows[touched.first_row as usize..touched.end_row as usize]
    }

    /// The edges of a row.
    pub(super) fn edges_of(&self, row: &Row) -> &[Edge] {
        &self.edges[row.first_edge as usize..row.end_edge as usize]
    }

    /// What is cheapest for any branch of a target, against going without, into `pairs`.
    fn cheapest_pairs(&mut self, touched: &Touched) {
        self.pairs.clear();
        for row in &self.rows[touched.first_row as usize..touched.end_row as usize] {
            let edges = &self.edges[row.first_edge as usize..row.end_edge as usize];
            let free = edges.iter().filter(|edge| !self.used[edge.plot as usize]);
            self.pairs.extend(free.map(|edge| (edge.plot, edge.cost - row.miss_cost)));
        }
        if 1 < touched.end_row - touched.first_row {
            self.pairs.sort_unstable_by(|a, b| a.0.cmp(&b.0).then(a.1.total_cmp(&b.1)));
            self.pairs.dedup_by_key(|pair| pair.0);
        }
    }

    /// Finds the best assignment of the touched targets at `places`, and which of them contest a
    /// plot within `most` nats, or less for tentative tracks; joins those to groups.
    pub(super) fn contest(&mut self, places: std::ops::Range<usize>, most: f64) {
        // Costs are numbers and plots are named once, so that nothing is refused.
        if self.fill_matrix(places.clone()).is_err() {
            return;
        }
        let count = self.place_of.len();
        self.above.clear();
        self.above.extend(0..short(count));
        self.first.clear();
        self.first.resize(self.used.len(), NONE);
        let solved = self.solver.solve(&self.matrix);
        self.own.clear();
        self.own.extend((0..places.len()).map(|row| solved.column_of(row).map_or(NONE, short)));
        self.prices.raise(&self.matrix, &self.own);
        let few = most.min(ALONE_NATS);
        for (row, place) in places.enumerate() {
            let is_tentative = 0.0 < self.rows[self.touched[place].first_row as usize].bias;
            let margin = if is_tentative { few } else { most };
            let touched = &mut self.touched[place];
            touched.own = self.own[row];
            let price = self.prices.of_rows[row];
            touched.unclear = touched.own != NONE && -price <= few;
            let columns = &self.prices.of_columns;
            let near = |(plot, cost): &(usize, f64)| cost - price - columns[*plot] <= margin;
            for (plot, _) in self.matrix.row(row).filter(near) {
                touched.unclear |= short(plot) != touched.own;
                contend(&mut self.above, &mut self.first[plot], touched.target);
            }
        }
    }

    /// Fills in what each touched target at `places` pays for each plot.
    fn fill_matrix(&mut self, places: std::ops::Range<usize>) -> Result<(), AssignError> {
        self.matrix.begin(self.used.len())?;
        for place in places {
            let touched = self.touched[place];
            self.cheapest_pairs(&touched);
            for (plot, cost) in &self.pairs {
                self.matrix.push(*plot as usize, *cost)?;
            }
            self.matrix.end_row()?;
        }
        Ok(())
    }

    /// Joins two targets to a group.
    pub(super) fn join(&mut self, one: u32, other: u32) {
        join(&mut self.above, one, other);
    }

    /// The target that stands for a target's group.
    pub(super) fn group_of(&mut self, target: u32) -> u32 {
        top(&mut self.above, target)
    }
}

fn top(above: &mut [u32], mut of: u32) -> u32 {
    while above[of as usize] != of {
        let next = above[above[of as usize] as usize];
        above[of as usize] = next;
        of = next;
    }
    of
}

/// Joins a target to the first that contests the same plot.
fn contend(above: &mut [u32], first: &mut u32, target: u32) {
    if *first == NONE {
        *first = target;
    }
    join(above, *first, target);
}

fn join(above: &mut [u32], one: u32, other: u32) {
    let (a, b) = (top(above, one), top(above, other));
    // The smaller stands for both, whatever the order.
    above[a.max(b) as usize] = a.min(b);
}
