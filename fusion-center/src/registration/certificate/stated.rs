//! What is stated of a proof: the share that is proven, or why there is none.

use std::fmt;

/// Whether it is proven that no other pose comes near the one found.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Certificate {
    /// No pose apart from the best one has more than this share of its log likelihood ratio.
    Proven {
        /// The share, below 1.
        rival_share: f64,
    },
    /// Nothing is proven. The search among hypotheses found no rival all the same.
    Lacking {
        /// Why.
        reason: Uncertified,
    },
}

/// Why nothing is proven of a pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Uncertified {
    /// The solver proves nothing, or is told to prove nothing.
    Unasked,
    /// The pose is not determined, so that there is nothing to prove.
    NotDetermined,
    /// The solution goes on from what the last one knew; only a full search is followed by a proof.
    Resumed,
    /// The proof would need more visits of pairs of points than it may take.
    TooManyPairs {
        /// Pairs of points that could meet.
        pair_count: usize,
        /// The most with which a proof is begun.
        most: usize,
    },
    /// The proof ended with its visits of pairs of points used up.
    Unfinished {
        /// How many there were.
        visit_count: usize,
    },
    /// Another pose that was found has the share that none should have; the decision weighed it.
    Contested,
    /// The likelihood has no peak of its own at the pose.
    Shapeless,
}

impl Default for Certificate {
    fn default() -> Self {
        Self::lacking(Uncertified::Unasked)
    }
}

impl Certificate {
    pub(in crate::registration) const fn lacking(reason: Uncertified) -> Self {
        Self::Lacking { reason }
    }

    /// The share that is proven; `None` where nothing is.
    #[must_use]
    pub fn rival_share(&self) -> Option<f64> {
        match self {
            Self::Proven { rival_share } => Some(*rival_share),
            Self::Lacking { .. } => None,
        }
    }

    /// Why nothing is proven; `None` where something is.
    #[must_use]
    pub fn reason(&self) -> Option<Uncertified> {
        match self {
            Self::Proven { .. } => None,
            Self::Lacking { reason } => Some(*reason),
        }
    }
}

impl fmt::Display for Uncertified {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Unasked => write!(f, "no proof was asked for"),
            Self::NotDetermined => write!(f, "the pose is not determined"),
            Self::Resumed => write!(f, "resumed from the last solution: no full search"),
            Self::TooManyPairs { pair_count, most } => write!(
                f,
                "{pair_count} pairs of points, at most {most} with the visits allowed: raise \
                 certificate_visit_count"
            ),
            Self::Unfinished { visit_count } => write!(
                f,
                "{visit_count} visits of pairs did not suffice: raise certificate_visit_count"
            ),
            Self::Contested => write!(f, "another pose has too large a share of the likelihood"),
            Self::Shapeless => write!(f, "the likelihood has no peak at the pose"),
        }
    }
}
