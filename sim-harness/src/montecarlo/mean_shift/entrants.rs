//! The trackers that take part, and the images that each is given.

use clap::ValueEnum;
use nalgebra::{Matrix2, Vector2};
use node_agent::pipeline::ChainConfig;
use node_agent::tracking::default::{BodyModel, DefaultConfig, DefaultTracker};
use node_agent::tracking::experiments::{HALF_DEPTH_M, in_the_room, middle_m, paper_chain};
use node_agent::tracking::paper::{PaperConfig, PaperTracker};
use node_agent::tracking::shift::Weighting;
use node_agent::tracking::{Track, TrackStatus, Tracker};
use proto::measured::line_of_sight;
use serde::Serialize;

use super::centroid::CentroidTracker;
use crate::metrics::Estimate;

/// A tracker by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Entrant {
    /// The one that a node uses.
    Default,
    /// As published.
    Paper,
    /// As published, but every bin of the histogram has the same weight.
    PaperWithoutWeights,
    /// Centroids of bright regions, nearest neighbours, Kalman filters.
    Centroid,
}

/// Which chain makes the images.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ChainKind {
    /// A node's own.
    Default,
    /// Phase coherence factor, as published.
    Paper,
}

impl ChainKind {
    pub(super) const ALL: [Self; 2] = [Self::Default, Self::Paper];

    pub(super) fn config(self) -> ChainConfig {
        match self {
            Self::Default => in_the_room(ChainConfig::default()),
            Self::Paper => paper_chain(),
        }
    }
}

impl Entrant {
    /// As on the command line.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Default => "default",
            Self::Paper => "paper",
            Self::PaperWithoutWeights => "paper-without-weights",
            Self::Centroid => "centroid",
        }
    }

    pub(super) fn chain(self) -> ChainKind {
        match self {
            Self::Default => ChainKind::Default,
            Self::Paper | Self::PaperWithoutWeights | Self::Centroid => ChainKind::Paper,
        }
    }

    /// A tracker that has seen nothing.
    ///
    /// # Errors
    /// If its settings make no sense, which the usual ones do not.
    pub(super) fn tracker(self) -> anyhow::Result<Box<dyn Tracker>> {
        Ok(match self {
            Self::Default => {
                Box::new(DefaultTracker::new(&DefaultConfig::default(), BodyModel::default())?)
            }
            Self::Paper => Box::new(PaperTracker::new(&PaperConfig::default())?),
            Self::PaperWithoutWeights => {
                let weighting = Weighting::Even;
                Box::new(PaperTracker::new(&PaperConfig { weighting, ..PaperConfig::default() })?)
            }
            Self::Centroid => Box::new(CentroidTracker::default()),
        })
    }

    /// The people whom it reports: everybody confirmed, seen or not. The radar sees the near side of
    /// a body; the default tracker says where the middle is, for the others it is added.
    pub(super) fn reports(self, tracks: &[Track]) -> Vec<Estimate<u64>> {
        let confirmed = tracks.iter().filter(|track| track.status != TrackStatus::Tentative);
        confirmed.map(|track| self.report(track)).collect()
    }

    /// Where the near sides of those people are.
    pub(super) fn near_sides(self, tracks: &[Track]) -> Vec<Estimate<u64>> {
        let mut estimates = self.reports(tracks);
        for estimate in &mut estimates {
            let middle_m = Vector2::from(estimate.at_m);
            estimate.at_m = (middle_m - line_of_sight(&middle_m) * HALF_DEPTH_M).into();
        }
        estimates
    }

    fn report(self, track: &Track) -> Estimate<u64> {
        let stated_m = Vector2::new(track.state[0], track.state[1]);
        let at_m = match self {
            Self::Default => stated_m,
            Self::Paper | Self::PaperWithoutWeights | Self::Centroid => middle_m(&stated_m),
        };
        let covariance_m2: Matrix2<f64> = track.covariance.fixed_view::<2, 2>(0, 0).into_owned();
        Estimate { id: track.id, at_m: at_m.into(), covariance_m2: Some(covariance_m2) }
    }
}
