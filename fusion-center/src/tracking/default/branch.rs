//! What is believed of a target if it took certain plots: its motion, its strength, its life.
//!
//! A target has one branch as long as nothing is open, and several while a decision waits. All
//! branches of a target have looked at the same looks.

use crate::tracking::{Look, Plot, ReportId, Status};

use super::config::DefaultConfig;
use super::gauss::Gauss;
use super::imm::Imm;
use super::row::{Edge, Row};
use super::stand::Stand;

/// A miss counts in the life of a track if a plot was at least so probable as this share of what the
/// sensor detects at best.
const COUNTS: f64 = 0.5;

/// Mean and spread of the strength of a target's plots.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Strength {
    count: f64,
    mean_db: f64,
    squares_db2: f64,
}

/// One look at a target, remembered.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Moment {
    pub(super) time_s: f64,
    pub(super) imm: Imm,
    pub(super) status: Status,
    pub(super) report: Option<ReportId>,
    pub(super) share: f64,
    /// The state does not follow from that of the moment before.
    pub(super) fresh: bool,
}

/// Where a state comes from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Origin {
    /// The state of the moment before.
    Before,
    /// A new beginning.
    Anew,
}

/// What is believed of a target if it took certain plots.
#[derive(Clone, Copy, Debug)]
pub(super) struct Branch {
    pub(super) imm: Imm,
    pub(super) time_s: f64,
    pub(super) seen_s: f64,
    pub(super) strength: Strength,
    pub(super) log_odds: f64,
    pub(super) peak_log_odds: f64,
    /// The newest 32 looks that counted, the newest in the lowest bit: whether it was seen.
    pub(super) hits: u32,
    pub(super) look_count: u32,
    pub(super) plot_count: u32,
    pub(super) last_report: ReportId,
    pub(super) last_share: f64,
    pub(super) status: Status,
    pub(super) stand: Option<Stand>,
    /// Its newest open moment among those of the newest open look of the target.
    pub(super) tip: u16,
    /// Its oldest among those of the oldest.
    pub(super) root: u16,
}

impl Strength {
    /// Variance of the next plot's strength about the mean, dB².
    #[inline]
    fn variance_db2(&self, config: &DefaultConfig) -> f64 {
        let prior = config.strength_prior_count;
        let known = prior * config.strength_sigma_db.powi(2) + self.squares_db2;
        known / (prior + (self.count - 1.0).max(0.0)) * (1.0 + 1.0 / self.count)
    }

    /// The density of a plot's strength over that of false plots as `(d, w)`, of which it is
    /// `w exp(−d/2)`: `d²/(s²(1 + 1/n))` and `strength span / √(2π s²(1 + 1/n))`.
    #[inline]
    pub(super) fn ratio(&self, strength_db: Option<f64>, config: &DefaultConfig) -> (f64, f64) {
        let Some(value) = strength_db.filter(|_| 0.0 < self.count) else { return (0.0, 1.0) };
        let variance = self.variance_db2(config);
        let off = value - self.mean_db;
        let weight = config.clutter_strength_span_db / (std::f64::consts::TAU * variance).sqrt();
        (off * off / variance, weight)
    }

    #[inline]
    fn take(&mut self, strength_db: Option<f64>, config: &DefaultConfig) {
        let Some(value) = strength_db else { return };
        let keep = (config.strength_memory_count / (self.count + 1.0)).min(1.0);
        let off = value - self.mean_db;
        self.squares_db2 = keep * (self.squares_db2 + off * off * self.count / (self.count + 1.0));
        self.count = keep * (self.count + 1.0);
        self.mean_db += off / self.count;
    }
}

/// Which report a plot of a look is.
pub(super) fn report_of(look: &Look<'_>, plot: &Plot) -> ReportId {
    ReportId {
        sensor_index: look.sensor_index,
        look_index: look.look_index,
        report_index: plot.report_index,
    }
}

impl Branch {
    /// A new target at a plot.
    pub(super) fn new(look: &Look<'_>, plot: &Plot, config: &DefaultConfig) -> Self {
        let mut start = Gauss::at(plot, config.new_speed_m_per_s);
        if let Some(radial) = &plot.radial {
            start.update_radial(radial);
        }
        let mut strength = Strength::default();
        strength.take(plot.strength_db, config);
        let mut new = Self {
            imm: Imm::new(start, config.steady_share()),
            time_s: look.time_s,
            seen_s: look.time_s,
            strength,
            log_odds: config.new_log_odds,
            peak_log_odds: config.new_log_odds,
            hits: 1,
            look_count: 1,
            plot_count: 1,
            last_report: report_of(look, plot),
            last_share: 1.0,
            status: Status::Tentative,
            stand: None,
            tip: 0,
            root: 0,
        };
        new.confirm(config);
        new
    }

    /// What is shown: where it stands if it is more likely to stand.
    pub(super) fn shown(&self) -> Gauss {
        match (self.status, &self.stand) {
            (Status::Stopped, Some(stand)) => stand.place(),
            _ => self.imm.merged(),
        }
    }

    /// The newest look, to be remembered.
    #[inline]
    pub(super) fn moment(&self, report: Option<ReportId>, origin: Origin) -> Moment {
        let stopped = self.stand.filter(|_| self.status == Status::Stopped);
        let imm = stopped.map_or(self.imm, |stand| Imm::new(stand.place(), 1.0));
        Moment {
            time_s: self.time_s,
            imm,
            status: self.status,
            report,
            share: self.last_share,
            fresh: origin == Origin::Anew || stopped.is_some(),
        }
    }

    /// Takes a plot that `row` expected.
    pub(super) fn take(
        &mut self,
        row: &Row,
        edge: &Edge,
        look: &Look<'_>,
        config: &DefaultConfig,
    ) -> Origin {
        let plot = &look.plots[edge.plot as usize];
        let moved_on = self.stand.as_ref().filter(|_| edge.moved_on);
        let fresh = moved_on.is_some() || self.status == Status::Stopped;
        let mut first_share = edge.first_share;
        if let Some(stand) = moved_on {
            first_share = config.steady_share();
            let start = stand.start_at(plot, look.time_s - self.time_s, config);
            self.imm = Imm::new(start.state, first_share);
        } else {
            self.imm = row.expected;
        }
        self.imm.update(plot, first_share);
        self.time_s = look.time_s;
        self.seen_s = look.time_s;
        self.strength.take(plot.strength_db, config);
        self.log_odds += row.bias - edge.cost;
        self.peak_log_odds = self.peak_log_odds.max(self.log_odds);
        self.hits = self.hits << 1 | 1;
        self.look_count = self.look_count.saturating_add(1);
        self.plot_count = self.plot_count.saturating_add(1);
        self.last_report = report_of(look, plot);
        self.last_share = 1.0;
        self.stand = None;
        self.confirm(config);
        if fresh { Origin::Anew } else { Origin::Before }
    }

    /// Goes on without a plot.
    #[inline]
    pub(super) fn miss(&mut self, row: &Row, look: &Look<'_>, config: &DefaultConfig) -> Origin {
        let was_stopped = self.status == Status::Stopped;
        self.may_stop(row, look, config);
        self.imm = row.expected;
        self.time_s = look.time_s;
        self.log_odds -= row.miss_cost;
        if COUNTS * look.coverage.detection_probability <= row.seen.detected {
            self.hits <<= 1;
            self.look_count = self.look_count.saturating_add(1);
        }
        if COUNTS <= row.seen.inside && self.status == Status::Confirmed {
            self.status = Status::Coasting;
        }
        let stands = self.stand.is_some_and(|stand| 0.0 < stand.log_odds);
        if self.status != Status::Tentative && stands {
            self.status = Status::Stopped;
        } else if was_stopped {
            self.status = Status::Coasting;
        }
        if was_stopped { Origin::Anew } else { Origin::Before }
    }

    fn may_stop(&mut self, row: &Row, look: &Look<'_>, config: &DefaultConfig) {
        let dt_s = look.time_s - self.time_s;
        if let Some(stand) = &mut self.stand {
            stand.miss((&row.seen, || self.imm.merged()), look, dt_s, config);
            return;
        }
        let can = look.coverage.minimum_detectable_m_per_s.is_some() && 0.0 < config.stop_per_s;
        if can && self.status != Status::Tentative && COUNTS <= row.seen.inside {
            self.stand = Some(Stand::new(&self.imm.merged(), &row.seen, dt_s, config));
        }
    }

    fn confirm(&mut self, config: &DefaultConfig) {
        let recent = self.hits & window(config.confirm_look_count);
        let often = config.confirm_hit_count <= recent.count_ones();
        if self.status != Status::Tentative || often && config.confirm_log_odds <= self.log_odds {
            self.status = Status::Confirmed;
        }
    }

    /// Whether it is not believed any more at `now_s`.
    pub(super) fn is_over(&self, now_s: f64, config: &DefaultConfig) -> bool {
        let lost = self.peak_log_odds - self.log_odds;
        let unseen_s = now_s - self.seen_s;
        match self.status {
            Status::Tentative => {
                let looks = self.look_count.min(config.confirm_look_count);
                let missed = looks - (self.hits & window(looks)).count_ones();
                config.confirm_look_count - config.confirm_hit_count < missed
                    || config.tentative_drop_nats < lost
                    || 0.25 * config.unseen_s < unseen_s
            }
            Status::Stopped => config.stopped_s < unseen_s,
            Status::Confirmed | Status::Coasting => {
                config.confirmed_drop_nats < lost || config.unseen_s < unseen_s
            }
        }
    }
}

/// No sensor is so good that a miss is impossible.
pub(super) const MAX_DETECTION: f64 = 0.999;

/// The lowest `count` bits.
fn window(count: u32) -> u32 {
    u32::MAX >> (32 - count.clamp(1, 32))
}
