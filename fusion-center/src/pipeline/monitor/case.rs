//! What all pairs of a node say together of a change of its pose.
//!
//! With `S_j`, `s_j` the information and the score of a pair about a change of its second node, a
//! change `c` of a node is one of `T_j c`, where `T_j` is the identity if the node is the second,
//! and else the opposite change carried over to the second's origin. The pairs of a node say
//! `S = Σ T_jᵀ S_j T_j`, `s = Σ T_jᵀ s_j`, and `sᵀ S⁻¹ s` would be chi-square with three degrees of
//! freedom if the pairs were independent. They share the node's own points: of `m` differences with
//! errors as large on either side, `2 m / (m + 1)` are independent, so this counts `2 / (m + 1)`.
//! A pair whose points lost their partners speaks by the chi-square of the loss instead.

use nalgebra::{Matrix3, Vector3};

use super::fit::Correction;

/// Information, score and losses of one node's pairs.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Case {
    information: Matrix3<f64>,
    score: Vector3<f64>,
    /// Sums of what each pair knows of the position, and of its square.
    known: (f64, f64),
    loss: f64,
    loss_count: f64,
}

impl Case {
    /// Adds what a pair says, whose second node changes by `carried` times the node's change: by
    /// its loss if it has one.
    pub(super) fn add(
        &mut self,
        loss: Option<f64>,
        said: Option<&Correction>,
        carried: &Matrix3<f64>,
    ) {
        if let Some(chi_square) = loss {
            self.loss += chi_square;
            self.loss_count += 1.0;
        } else if let Some(said) = said {
            self.information += carried.transpose() * said.information * carried;
            self.score += carried.transpose() * said.score;
            let known = said.information[(0, 0)] + said.information[(1, 1)];
            self.known = (self.known.0 + known, self.known.1 + known.powi(2));
        }
    }

    /// How many pairs speak, each counted by what it knows.
    fn pair_count(&self) -> f64 {
        let (sum, of_squares) = self.known;
        if of_squares > 0.0 { sum.powi(2) / of_squares } else { 0.0 }
    }

    /// The change that the pairs want, `(x_m, y_m, heading_rad)` in `Ref`.
    pub(super) fn change(&self) -> Option<Vector3<f64>> {
        Some(self.information.cholesky()?.solve(&self.score))
    }

    /// How significant it is, without the losses.
    fn change_square(&self) -> f64 {
        let squared = self.change().map_or(0.0, |change| change.dot(&self.score));
        squared * share(self.pair_count())
    }

    /// How significant it is in units of how loud quiet times are, with the losses.
    pub(super) fn chi_square(&self, loudness: f64) -> f64 {
        self.change_square() / loudness + self.lost()
    }

    fn lost(&self) -> f64 {
        self.loss * share(self.loss_count)
    }

    /// Whether the losses say most of it: where to the node went is not known then.
    pub(super) fn is_lost(&self) -> bool {
        self.change_square() < self.lost()
    }
}

/// The part of the sum over `count` pairs that counts.
fn share(count: f64) -> f64 {
    2.0 / (count.max(1.0) + 1.0)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(score: Vector3<f64>, information: f64) -> Correction {
        let information = Matrix3::identity() * information;
        Correction { change: 0.0, information, score }
    }

    #[test]
    fn equal_pairs_say_what_their_independent_differences_would() {
        // Points of one node with errors as large as those of the three others': the mean of the
        // differences has a variance of (1 + 1/3) of one point's, a single difference twice.
        let (change, variance, count) = (0.3, 0.04, 3.0);
        let mut case = Case::default();
        for _ in 0..3 {
            let information = 1.0 / (2.0 * variance);
            let score = Vector3::new(change * information, 0.0, 0.0);
            case.add(None, Some(&said(score, information)), &Matrix3::identity());
        }
        let expected = change * change / (variance * (1.0 + 1.0 / count));
        assert!((case.change_square() - expected).abs() < 1e-9);
        assert!((case.change().unwrap() - Vector3::new(change, 0.0, 0.0)).norm() < 1e-9);
    }

    #[test]
    fn a_pair_that_disagrees_with_the_others_says_less_than_pairs_that_agree() {
        let chi_square = |scores: [f64; 3]| {
            let mut case = Case::default();
            for score in scores {
                let said = said(Vector3::new(score, 0.0, 0.0), 10.0);
                case.add(None, Some(&said), &Matrix3::identity());
            }
            case.chi_square(1.0)
        };
        assert!(8.9 * chi_square([9.0, 0.0, 0.0]) < chi_square([9.0, 9.0, 9.0]));
    }

    #[test]
    fn what_was_lost_counts_instead_of_what_is_fitted() {
        let mut case = Case::default();
        let fitted = said(Vector3::new(1.0, 0.0, 0.0), 1.0);
        for _ in 0..3 {
            case.add(Some(40.0), Some(&fitted), &Matrix3::identity());
        }
        assert!(case.is_lost() && case.change().is_none());
        assert!((case.chi_square(1.0) - 60.0).abs() < 1e-9, "half of three times 40");
    }
}
