//! When a new pose takes the place of an old one: a poorer result never replaces a better.
//!
//! Much vaguer poses never do, whatever they rest on. One that contradicts must rest on clearly
//! more: two modes that are nearly as likely would else take turns, under a new epoch each time.

use nalgebra::{Matrix3, Vector3};
use proto::geom::{Node, Ref, Se2, squared_length};

use crate::statistics::POSE_GATE;

/// A new pose within this many standard deviations (squared, three dimensions) of the old one
/// refines it; chance exceeds it once in ten thousand.
const REFINEMENT_GATE: f64 = POSE_GATE;
/// A pose whose covariance has this many times the determinant of another's is much vaguer: one and
/// a half times the standard deviation in each of three dimensions.
const VAGUER: f64 = 11.4;
/// A pose that differs by less than a tenth of a standard deviation, with a covariance of nearly
/// the same determinant, is no news.
const NEWS_GATE: f64 = 0.01;
const NEWS_FACTOR: f64 = 1.2;

/// By how much a pose that contradicts must exceed the log odds of the one in force: ln 1000.
const CONTRADICTION_MARGIN: f64 = 6.9;
/// Log odds are kept within this on both sides; a pose with the least is doubted.
pub(super) const MAX_LOG_ODDS: f64 = 1e9;

/// A pose that is believed.
#[derive(Clone, Copy, Debug)]
pub(super) struct Belief {
    pub(super) pose: Se2<Ref, Node>,
    pub(super) covariance: Matrix3<f64>,
    /// Natural logarithm of the odds that it rests on.
    pub(super) log_odds: f64,
}

/// What to do with a new pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Judgement {
    /// It takes the old one's place.
    Accept,
    /// It fits, but is much vaguer: the old one stays.
    Vaguer,
    /// It contradicts, and is much vaguer or does not rest on clearly more: the old one stays.
    Contradicts,
}

impl Belief {
    /// Whether `new` takes this one's place.
    pub(super) fn judge(&self, new: &Self) -> Judgement {
        if self.is_doubted() {
            return Judgement::Accept;
        }
        let is_lead = self.log_odds + CONTRADICTION_MARGIN < new.log_odds;
        match (self.is_refined_by(new), self.is_clearer_than(new)) {
            (true, true) => Judgement::Vaguer,
            (true, false) => Judgement::Accept,
            (false, false) if is_lead => Judgement::Accept,
            (false, _) => Judgement::Contradicts,
        }
    }

    /// Whether any determined pose may take this one's place.
    pub(super) fn is_doubted(&self) -> bool {
        self.log_odds <= -MAX_LOG_ODDS
    }

    /// Whether `new` lies within this one's and its own uncertainty.
    pub(super) fn is_refined_by(&self, new: &Self) -> bool {
        let square =
            squared_length(&self.difference(&new.pose), &(self.covariance + new.covariance));
        square.is_some_and(|square| square <= REFINEMENT_GATE)
    }

    /// Whether `new`'s uncertainty covers far more: poorer data must not take the place of better
    /// ones, while the fluctuation of a sliding window may.
    pub(super) fn is_clearer_than(&self, new: &Self) -> bool {
        VAGUER * self.covariance.determinant() < new.covariance.determinant()
    }

    /// Whether `new` says nothing that this one does not.
    pub(super) fn is_same_as(&self, new: &Self) -> bool {
        let square = squared_length(&self.difference(&new.pose), &self.covariance);
        let ratio = new.covariance.determinant() / self.covariance.determinant();
        square.is_some_and(|square| square < NEWS_GATE)
            && (NEWS_FACTOR.recip()..=NEWS_FACTOR).contains(&ratio)
    }

    /// Squared distance of `pose` from this one in units of this one's and `more`'s covariance.
    pub(super) fn distance(&self, pose: &Se2<Ref, Node>, more: &Matrix3<f64>) -> f64 {
        squared_length(&self.difference(pose), &(self.covariance + more)).unwrap_or(0.0)
    }

    /// `(x_m, y_m, heading_rad)` of `pose` less this one.
    fn difference(&self, pose: &Se2<Ref, Node>) -> Vector3<f64> {
        pose.minus(&self.pose)
    }
}
