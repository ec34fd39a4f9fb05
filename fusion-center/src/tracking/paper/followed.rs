//! One track of the published association: its newest plot, its life and its chain of states.

use super::config::PaperConfig;
use super::decide::Choice;
use super::filter;
use super::geometry::{Sight, Way, line};
use crate::tracking::smooth::{Belief, Pass, smooth};
use crate::tracking::{Area, Coverage, Look, Platform, Plot, ReportId, Settled, Status, Track};

/// Density of clutter below which a plot's odds do not rise further, per square metre.
const MIN_CLUTTER_PER_M2: f64 = 1e-12;
/// Chance that a target is missed, or found, which is left where a sensor claims it to be none.
const MIN_CHANCE: f64 = 1e-3;

/// The newest plot of a track: all that the association knows of it.
#[derive(Clone, Debug)]
pub(super) struct Seen {
    pub(super) time_s: f64,
    pub(super) platform: Platform,
    pub(super) plot: Plot,
}

/// What the newest plot leads one to expect of a look.
#[derive(Clone, Copy, Debug)]
pub(super) struct Expected {
    /// `T`: since the plot.
    pub(super) dt_s: f64,
    pub(super) way: Way,
    /// `r̂`, `θ̂`.
    pub(super) sight: Sight,
}

/// A step that may still be smoothed.
#[derive(Clone, Debug)]
struct Step {
    time_s: f64,
    status: Status,
    /// With what was known then.
    belief: Belief,
    report: Option<ReportId>,
    share: f64,
}

/// A track and its memory.
#[derive(Clone, Debug)]
pub(super) struct Followed {
    pub(super) id: u64,
    pub(super) seen: Seen,
    last_report: ReportId,
    last_share: f64,
    plot_count: u32,
    /// The newest looks that could have seen it, newest lowest: 1 where they did.
    window: u64,
    missed_count: u32,
    is_confirmed: bool,
    log_odds: f64,
    chain: Vec<Step>,
}

impl Seen {
    /// Where the target is expected in a look: \[wide-area, eqs. (4), (6)\] over the time since its
    /// newest plot; without radial velocity it is expected to keep its range.
    pub(super) fn expected(&self, time_s: f64, platform: &Platform) -> Expected {
        let way = Way::between(&self.platform, platform, self.plot.position_m);
        let dt_s = time_s - self.time_s;
        let speed = self.plot.radial.map_or(0.0, |radial| radial.velocity_m_per_s);
        let before = Sight::new(&line(&self.platform, self.plot.position_m), &way.along);
        Expected { dt_s, way, sight: before.predicted(speed * dt_s, way.length_m) }
    }
}

impl Followed {
    pub(super) fn new(
        id: u64,
        (look, platform): (&Look<'_>, &Platform),
        plot: &Plot,
        config: &PaperConfig,
    ) -> Self {
        let belief = filter::first(plot, config.max_speed_m_per_s);
        let mut track = Self {
            id,
            seen: Seen { time_s: look.time_s, platform: *platform, plot: plot.clone() },
            last_report: report_of(look, plot),
            last_share: 1.0,
            plot_count: 1,
            window: 1,
            missed_count: 0,
            is_confirmed: config.confirm_count <= 1,
            log_odds: 0.0,
            chain: Vec::new(),
        };
        track.note(look.time_s, belief, Some(report_of(look, plot)));
        track
    }

    /// Whether a look of this coverage could have seen the track where it is expected.
    pub(super) fn is_looked_at(
        &self,
        coverage: &Coverage,
        platform: &Platform,
        expected: &Expected,
    ) -> bool {
        let place = || expected.sight.place_m(&platform.position_m, &expected.way.along);
        let is_covered = match coverage.area {
            Area::Everywhere => true,
            Area::Sector { .. } => place().is_some_and(|place_m| coverage.area.contains(place_m)),
        };
        is_covered && 0.0 < coverage.detection_probability
    }

    /// Takes a plot.
    pub(super) fn take(
        &mut self,
        (look, platform): (&Look<'_>, &Platform),
        choice: Choice,
        config: &PaperConfig,
    ) {
        let plot = &look.plots[choice.column];
        let pass = self.coasted(look.time_s, config);
        let predicted = pass.predicted;
        // Where rounding has left nothing of what was known, the plot begins it again.
        let begun = || (filter::first(plot, config.max_speed_m_per_s), 0.0);
        let (belief, log_density) = filter::updated(&predicted, plot).unwrap_or_else(begun);
        let found = look.coverage.detection_probability.max(MIN_CHANCE);
        self.log_odds +=
            found.ln() + log_density - look.clutter_per_m2.max(MIN_CLUTTER_PER_M2).ln();
        self.seen = Seen { time_s: look.time_s, platform: *platform, plot: plot.clone() };
        self.last_report = report_of(look, plot);
        self.last_share = choice.share;
        self.plot_count = self.plot_count.saturating_add(1);
        self.window = self.window << 1 | 1;
        self.missed_count = 0;
        let recent = self.window & (u64::MAX >> (64 - config.window_count.clamp(1, 64)));
        self.is_confirmed |= config.confirm_count <= recent.count_ones();
        self.note(look.time_s, belief, Some(self.last_report));
    }

    /// Was looked at and not seen.
    pub(super) fn miss(&mut self, look: &Look<'_>, config: &PaperConfig) {
        self.window <<= 1;
        self.missed_count = self.missed_count.saturating_add(1);
        self.log_odds += (1.0 - look.coverage.detection_probability).max(MIN_CHANCE).ln();
        let pass = self.coasted(look.time_s, config);
        self.note(look.time_s, pass.predicted, None);
    }

    /// Whether it is over: unseen for too long, or never to be confirmed.
    pub(super) fn has_ended(&self, config: &PaperConfig) -> bool {
        let spare = config.window_count.saturating_sub(config.confirm_count);
        config.end_count <= self.missed_count || (!self.is_confirmed && spare < self.missed_count)
    }

    fn status(&self) -> Status {
        match (self.is_confirmed, self.missed_count) {
            (false, _) => Status::Tentative,
            (true, 0) => Status::Confirmed,
            (true, _) => Status::Coasting,
        }
    }

    /// Its newest state, and when that was.
    fn newest(&self) -> Option<(f64, Belief)> {
        self.chain.last().map(|step| (step.time_s, step.belief))
    }

    fn coasted(&self, time_s: f64, config: &PaperConfig) -> Pass {
        let (before_s, before) = self.newest().unwrap_or_else(|| {
            (self.seen.time_s, filter::first(&self.seen.plot, config.max_speed_m_per_s))
        });
        filter::coasted(&before, time_s - before_s, config.push_m2_per_s3)
    }

    fn note(&mut self, time_s: f64, belief: Belief, report: Option<ReportId>) {
        let (status, share) = (self.status(), if report.is_some() { self.last_share } else { 0.0 });
        self.chain.push(Step { time_s, status, belief, report, share });
    }

    /// What is said of it now.
    pub(super) fn track(&self) -> Option<Track> {
        let (time_s, belief) = self.newest()?;
        Some(Track {
            id: self.id,
            status: self.status(),
            time_s,
            state: belief.mean,
            covariance: belief.covariance,
            log_odds: self.log_odds,
            plot_count: self.plot_count,
            seen_s: self.seen.time_s,
            last_report: self.last_report,
            last_share: self.last_share,
        })
    }

    /// Settles the older half of the chain once it is twice as long as asked for, so that as much is
    /// known of the future of each of its steps.
    pub(super) fn settle_old(&mut self, config: &PaperConfig, into: &mut impl Extend<Settled>) {
        if 2 * config.lag_count <= self.chain.len() {
            self.settle(config.lag_count, config, into);
        }
    }

    /// Settles all of it.
    pub(super) fn settle_all(&mut self, config: &PaperConfig, into: &mut impl Extend<Settled>) {
        self.settle(self.chain.len(), config, into);
    }

    fn settle(&mut self, count: usize, config: &PaperConfig, into: &mut impl Extend<Settled>) {
        let passes = self.passes(config.push_m2_per_s3);
        let mut smoothed = Vec::new();
        if smooth(&passes, &mut smoothed).is_err() {
            // Rounding has spoiled a covariance: what was known then stands.
            smoothed.clear();
            smoothed.extend(self.chain.iter().map(|step| step.belief));
        }
        let track = self.id;
        into.extend(self.chain.drain(..count).zip(smoothed).map(|(step, later)| Settled {
            track,
            status: step.status,
            time_s: step.time_s,
            state: step.belief.mean,
            covariance: step.belief.covariance,
            smoothed_state: later.mean,
            smoothed_covariance: later.covariance,
            report: step.report,
            share: step.share,
        }));
    }

    /// The filter's way through the chain, made again: a chain of beliefs is less than half as long.
    fn passes(&self, push_m2_per_s3: f64) -> Vec<Pass> {
        let befores = self.chain.first().into_iter().chain(&self.chain);
        let pass = |(before, step): (&Step, &Step)| {
            let coasted =
                filter::coasted(&before.belief, step.time_s - before.time_s, push_m2_per_s3);
            Pass { filtered: step.belief, ..coasted }
        };
        befores.zip(&self.chain).map(pass).collect()
    }
}

fn report_of(look: &Look<'_>, plot: &Plot) -> ReportId {
    ReportId {
        sensor_index: look.sensor_index,
        look_index: look.look_index,
        report_index: plot.report_index,
    }
}
