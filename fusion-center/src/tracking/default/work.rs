//! What every branch expects of a look, its candidates among the plots, and who contests what.
//!
//! All memory is kept from look to look.

use nalgebra::Vector2;

use crate::tracking::assign::{AssignError, Edges, Solver};
use crate::tracking::gate::{Grid, cell_size_m};
use crate::tracking::{Look, Plot};

use super::branch::Branch;
use super::config::{DefaultConfig, Way};
use super::coverage::{FAR_SIGMAS, View};
use super::imm::Steps;
use super::prices::Prices;
use super::row::{Chance, Edge, Row};
use super::target::Target;

/// No target, no plot.
pub(super) const NONE: u32 = u32::MAX;
/// A target is left alone by a look that covers it with less probability, and has no plot for it.
const MIN_INSIDE: f64 = 0.01;

/// The cells of the grid have the middle of the radii of one in so many rows.
const ROWS_PER_RADIUS: usize = 8;

/// Whether a target takes a plot that nobody else wants is left open only within so many nats beyond
/// what the plot is biased by: no identity depends on it, and the filter forgives one plot.
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

/// What a target takes.
enum Wish {
    /// That plot or none, and whether the other choice is nearly as good.
    Alone(u32, bool),
    /// It depends on others, or on a choice.
    Shared,
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
    /// How many rows want each plot.
    wanted: Vec<u32>,
    /// What was last worked out for a row.
    chance: Option<Chance>,
    /// Some of the radii of the newest look.
    radii_m: Vec<f64>,
    points_m: Vec<[f64; 2]>,
    grid: Grid,
    matrix: Edges,
    solver: Solver,
    pairs: Vec<(u32, f64)>,
    /// Where in `touched` those are that share a plot, or may choose.
    shared: Vec<u32>,
    /// The plot of each of these in the best assignment.
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
    mean + (half * half + r[(0, 1)] * r[(0, 1)]).sqrt()
}

fn may_be_seen(target: &Target, view: &View<'_>, config: &DefaultConfig) -> bool {
    view.is_everywhere()
        || target.leaves.iter().any(|leaf| {
            let [x, y, u, v] = leaf.imm.mean();
            let dt_s = view.look.time_s - leaf.time_s;
            let moved = Vector2::new(x + u * dt_s, y + v * dt_s);
            // Coasting goes on while one that may have stopped stands where it is.
            view.may_cover(moved, 0.0)
                || view.may_cover(moved, FAR_SIGMAS * spread_m(leaf, dt_s, config))
                || leaf.stand.is_some_and(|stand| stand.may_be_seen(view, dt_s, config))
        })
}

/// More than the standard deviation of the place after `dt_s` in any direction.
fn spread_m(leaf: &Branch, dt_s: f64, config: &DefaultConfig) -> f64 {
    let state = leaf.imm.merged();
    let push_m2 = config.lively.push_m2_per_s3 * dt_s.powi(3) / 3.0;
    let speed_m2_per_s2 = state.velocity_variance(1.0, 0.0) + state.velocity_variance(0.0, 1.0);
    (state.widest_m2() + push_m2).sqrt() + dt_s * speed_m2_per_s2.sqrt()
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
        self.wanted.clear();
        self.wanted.resize(look.plots.len(), 0);
        self.chance = None;
        let view = View::new(look);
        let variance_m2 = look.plots.iter().map(widest_m2).fold(0.0, f64::max);
        self.lay_grid(look, (config.gate_distance2 * variance_m2).sqrt());
        let ways = config.ways();
        for (index, target) in targets.iter().enumerate() {
            if may_be_seen(target, &view, config) {
                self.expect_of((short(index), target), (&view, variance_m2), config, &ways);
            }
        }
    }

    /// Lays the grid of the plots, with cells of the radius that was last asked with, or of `first_m`.
    fn lay_grid(&mut self, look: &Look<'_>, first_m: f64) {
        self.points_m.clear();
        self.points_m.extend(look.plots.iter().map(|plot| [plot.position_m.x, plot.position_m.y]));
        let cell_m = cell_size_m(&mut self.radii_m).unwrap_or(first_m);
        self.radii_m.clear();
        // Places were checked, so that neither filling nor asking can fail.
        let filled = self.grid.fill(&self.points_m, cell_m.max(f64::MIN_POSITIVE));
        debug_assert!(filled.is_ok());
    }

    /// Adds the rows and edges of a target, if the look concerns it.
    fn expect_of(
        &mut self,
        (index, target): (u32, &Target),
        (view, variance_m2): (&View<'_>, f64),
        config: &DefaultConfig,
        ways: &[Way; 2],
    ) {
        let (first_row, first_edge) = (self.rows.len(), self.edges.len());
        let mut is_inside = false;
        for branch in &target.leaves {
            let steps = Steps::of(view.look.time_s - branch.time_s, ways, &mut self.steps);
            let mut row = Row::new(branch, steps, view, config, &mut self.chance);
            is_inside |= MIN_INSIDE <= row.seen.inside || row.stands_inside;
            let reach = row.reach(branch, variance_m2, config);
            if self.rows.len().is_multiple_of(ROWS_PER_RADIUS) {
                self.radii_m.push(reach.radius_m);
            }
            row.first_edge = short(self.edges.len());
            let edges = &mut self.edges;
            let asked = self.grid.for_each_within(reach.middle_m, reach.radius_m, |plot, _| {
                edges.extend(row.edge(branch, (short(plot), &view.look.plots[plot]), config));
            });
            row.end_edge = if asked.is_ok() { short(self.edges.len()) } else { row.first_edge };
            self.rows.push(row);
        }
        if !is_inside && first_edge == self.edges.len() {
            self.rows.truncate(first_row);
            return;
        }
        self.place_of[index as usize] = short(self.touched.len());
        let [first_row, end_row] = [first_row, self.rows.len()].map(short);
        self.touched.push(Touched { target: index, first_row, end_row, own: NONE, unclear: false });
        for edge in &self.edges[first_edge..] {
            self.wanted[edge.plot as usize] += 1;
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
        self.above.clear();
        self.above.extend(0..short(self.place_of.len()));
        self.first.clear();
        self.first.resize(self.used.len(), NONE);
        self.shared.clear();
        for place in places {
            let touched = self.touched[place];
            match self.first_wish(&touched, most) {
                Wish::Shared => self.shared.push(short(place)),
                Wish::Alone(own, unclear) => {
                    self.touched[place] = Touched { own, unclear, ..touched };
                }
            }
        }
        self.contest_shared(most);
    }

    /// What a target takes if nobody else wants its plot, and if it has no other.
    fn first_wish(&self, touched: &Touched, most: f64) -> Wish {
        let row = &self.rows[touched.first_row as usize];
        match self.edges_of(row) {
            _ if 1 < touched.end_row - touched.first_row => Wish::Shared,
            [] => Wish::Alone(NONE, false),
            [only] if self.wanted[only.plot as usize] == 1 => {
                let ([few, margin], gain) = (margins(row, most), row.miss_cost - only.cost);
                let takes = 0.0 < gain;
                Wish::Alone(
                    if takes { only.plot } else { NONE },
                    if takes { gain <= few } else { -gain <= margin },
                )
            }
            _ => Wish::Shared,
        }
    }

    /// As [`Self::contest`], for targets in `shared`.
    fn contest_shared(&mut self, most: f64) {
        // Costs are numbers and plots are named once, so that nothing is refused.
        if self.fill_matrix().is_err() {
            return;
        }
        let solved = self.solver.solve(&self.matrix);
        self.own.clear();
        let owns = (0..self.shared.len()).map(|row| solved.column_of(row).map_or(NONE, short));
        self.own.extend(owns);
        self.prices.raise(&self.matrix, &self.own);
        for (row, place) in self.shared.iter().enumerate() {
            let touched = &mut self.touched[*place as usize];
            let [few, margin] = margins(&self.rows[touched.first_row as usize], most);
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

    /// Fills in what each target in `shared` pays for each plot.
    fn fill_matrix(&mut self) -> Result<(), AssignError> {
        self.matrix.begin(self.used.len())?;
        for index in 0..self.shared.len() {
            let touched = self.touched[self.shared[index] as usize];
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

/// Within how many nats it is open whether a row has its plot, and which: `most`, or less.
fn margins(row: &Row, most: f64) -> [f64; 2] {
    if row.is_tentative {
        return [most.min(ALONE_NATS); 2];
    }
    [most.min(ALONE_NATS + row.bias), most]
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
