//! Where a target stands that may have stopped, and where it is when it moves on.
//!
//! A sensor misses some of what moves: a target may have stopped later than at the first look that does
//! not show it, and may have moved on before the look that shows it again. With the chance `q` that a
//! look misses somebody who moves, those who moved on unseen are as many as move on in `u` seconds,
//! `u' = q (u + Δt)`; of the time that has passed since, mean and mean square are kept.

use nalgebra::Vector2;

use crate::tracking::{Look, Plot};

use super::branch::MAX_DETECTION;
use super::config::DefaultConfig;
use super::coverage::{FAR_SIGMAS, Seen, View};
use super::gauss::Gauss;

/// A target is never surer than this to stand.
const MAX_LOG_ODDS: f64 = 10.0;
/// What is rarer than this, beside the same thing a look earlier or later, is left out.
const RARE_SHARE: f64 = 0.02;

/// A target that may have stopped after it was last seen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Stand {
    /// Where it would stand, metres; with [`Stand::cov_m2`], all that [`Gauss::standing`] needs.
    place_m: [f64; 2],
    /// Covariance of that, xx, xy, yy.
    cov_m2: [f64; 3],
    /// Logarithm of the odds that it stands, against that it moves and was missed.
    pub(super) log_odds: f64,
    unseen: Unseen,
}

/// Those who moved on and were missed since.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
struct Unseen {
    /// As many as move on in so many seconds.
    mass_s: f64,
    /// How long ago on average, seconds, ...
    ago_s: f64,
    /// ... and the mean square of that.
    ago_s2: f64,
}

/// A target that moved on.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Start {
    pub(super) state: Gauss,
    /// How probable that is, over that it moved on since the last look.
    pub(super) share: f64,
}

impl Unseen {
    /// `dt_s` later, before it is known whether the look there shows somebody: those of before.
    fn aged(&self, dt_s: f64) -> Self {
        let ago_s2 = self.ago_s2 + dt_s * (2.0 * self.ago_s + dt_s);
        Self { mass_s: self.mass_s, ago_s: self.ago_s + dt_s, ago_s2 }
    }

    /// After a look that shows nobody and misses a share of all.
    fn missed(&self, dt_s: f64, share: f64) -> Self {
        let before = self.aged(dt_s);
        let mass_s = before.mass_s + dt_s;
        if mass_s <= 0.0 {
            return *self;
        }
        let (old, new) = (before.mass_s / mass_s, dt_s / mass_s);
        Self {
            mass_s: share * mass_s,
            ago_s: old * before.ago_s + new * dt_s / 2.0,
            ago_s2: old * before.ago_s2 + new * dt_s * dt_s / 3.0,
        }
    }
}

/// What a miss says for standing, nats.
fn evidence(seen: &Seen) -> f64 {
    -(1.0 - seen.detected.min(MAX_DETECTION)).ln()
}

impl Stand {
    /// A target that stopped at an unknown moment of the `dt_s` after it was last seen as `last`, and
    /// was not seen after that, as `seen` says how probably.
    pub(super) fn new(last: &Gauss, seen: &Seen, dt_s: f64, config: &DefaultConfig) -> Self {
        let (place_m, cov_m2) = last.stopped_within(dt_s);
        let log_odds = stops(dt_s, config).ln() + evidence(seen);
        Self { place_m, cov_m2, log_odds, unseen: Unseen::default() }
    }

    /// Another look, `dt_s` after the last, shows nobody; it is said how probably somebody who moves
    /// would have been seen, and where that one was before.
    pub(super) fn miss(
        &mut self,
        (seen, moving): (&Seen, impl Fn() -> Gauss),
        look: &Look<'_>,
        dt_s: f64,
        config: &DefaultConfig,
    ) {
        let late = stops(dt_s, config) * (-self.log_odds).exp();
        if RARE_SHARE < late {
            let (place_m, cov_m2) = moving().stopped_within(dt_s);
            let place = self.place().mixed(&Gauss::standing(place_m, cov_m2), 1.0 / (1.0 + late));
            (self.place_m, self.cov_m2) = place.place();
            self.log_odds += late.ln_1p();
        }
        self.log_odds = (self.log_odds + evidence(seen)).min(MAX_LOG_ODDS);
        let best = look.coverage.detection_probability.min(MAX_DETECTION);
        let missed = if self.is_inside(look) { 1.0 - best } else { 1.0 };
        self.unseen = self.unseen.missed(dt_s, missed);
    }

    /// Whether a look shows its place.
    pub(super) fn is_inside(&self, look: &Look<'_>) -> bool {
        look.coverage.area.contains(Vector2::from(self.place_m))
    }

    /// Whether a look `dt_s` after the last could show it where it stands or moves on; never too strict.
    pub(super) fn may_be_seen(&self, view: &View<'_>, dt_s: f64, config: &DefaultConfig) -> bool {
        let widest_m2 = |start: Start| start.state.widest_m2();
        let starts = self.starts(dt_s, config).into_iter().flatten().map(widest_m2);
        let margin_m = FAR_SIGMAS * starts.fold(0.0, f64::max).sqrt();
        view.may_cover(Vector2::from(self.place_m), margin_m)
    }

    /// Where it would stand.
    pub(super) fn place(&self) -> Gauss {
        Gauss::standing(self.place_m, self.cov_m2)
    }

    /// Probability that it stands.
    pub(super) fn share(&self) -> f64 {
        1.0 / (1.0 + (-self.log_odds).exp())
    }

    /// What is expected `dt_s` after the last look if it moved on since, and if it did before that.
    pub(super) fn starts(&self, dt_s: f64, config: &DefaultConfig) -> [Option<Start>; 2] {
        [Some(self.since(dt_s, config)), self.before(dt_s, config)]
    }

    /// The one of [`Stand::starts`] of which a plot is more probably.
    pub(super) fn start_at(&self, plot: &Plot, dt_s: f64, config: &DefaultConfig) -> Start {
        let since = self.since(dt_s, config);
        let Some(before) = self.before(dt_s, config) else { return since };
        let density = |start: &Start| start.state.fit(plot).log_density() + start.share.ln();
        if density(&before) < density(&since) { since } else { before }
    }

    fn since(&self, dt_s: f64, config: &DefaultConfig) -> Start {
        let ago = (dt_s / 2.0, dt_s * dt_s / 3.0);
        Start { state: self.place().started(ago, config.restart_speed_m_per_s), share: 1.0 }
    }

    fn before(&self, dt_s: f64, config: &DefaultConfig) -> Option<Start> {
        let Unseen { mass_s, ago_s, ago_s2 } = self.unseen.aged(dt_s);
        (RARE_SHARE * dt_s < mass_s).then(|| Start {
            state: self.place().started((ago_s, ago_s2), config.restart_speed_m_per_s),
            share: mass_s / dt_s.max(f64::MIN_POSITIVE),
        })
    }
}

/// Probability that a moving target stops within `dt_s`.
fn stops(dt_s: f64, config: &DefaultConfig) -> f64 {
    (config.stop_per_s * dt_s).min(0.5)
}
