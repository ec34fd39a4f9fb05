//! The trackers that take part.

use clap::ValueEnum;
use fusion_center::tracking::Tracker;
use fusion_center::tracking::default::{DefaultConfig, DefaultTracker};
use fusion_center::tracking::paper::{Mode, PaperConfig, PaperTracker};
use serde::Serialize;

/// A tracker by its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, ValueEnum)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum Entrant {
    /// The one that the centre uses.
    Default,
    /// Association by global optimum, as published.
    Paper,
    /// The nearest neighbour by the same cost.
    Nn,
    /// The belief function method.
    Belief,
}

/// Under which rules tracks begin and end.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Rules {
    /// All targets are there from the first look on, nothing else is; the three published methods
    /// follow those plots, as published.
    Published,
    /// Tracks begin and end by the trackers' own logic.
    Own,
}

impl Entrant {
    /// As on the command line.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Default => "default",
            Self::Paper => "paper",
            Self::Nn => "nn",
            Self::Belief => "belief",
        }
    }

    /// A tracker that has seen nothing.
    ///
    /// # Errors
    /// If its settings make no sense, which the usual ones do not.
    pub(super) fn tracker(self, rules: Rules) -> anyhow::Result<Box<dyn Tracker>> {
        let config = match rules {
            Rules::Published => PaperConfig::published_tracks(),
            Rules::Own => PaperConfig::default(),
        };
        match self.published() {
            None => Ok(Box::new(DefaultTracker::new(DefaultConfig::wide_area())?)),
            Some(mode) => Ok(Box::new(PaperTracker::new(mode, &config)?)),
        }
    }

    /// One that joins the plots of each look to those of the look before, whatever tracks they belong
    /// to, as the published rates of right links have it; `None` where its tracks do that.
    ///
    /// # Errors
    /// If its settings make no sense, which the usual ones do not.
    pub(super) fn linker(self, rules: Rules) -> anyhow::Result<Option<Box<dyn Tracker>>> {
        let Some(mode) = self.published().filter(|_| rules == Rules::Published) else {
            return Ok(None);
        };
        Ok(Some(Box::new(PaperTracker::new(mode, &PaperConfig::published_links())?)))
    }

    fn published(self) -> Option<Mode> {
        match self {
            Self::Default => None,
            Self::Paper => Some(Mode::Paper),
            Self::Nn => Some(Mode::Nearest),
            Self::Belief => Some(Mode::Belief),
        }
    }
}
