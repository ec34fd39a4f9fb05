//! The wall before a recording's array: told by its own echoes in the recording, or assumed.

use std::path::Path;

use rustfft::num_complex::Complex;
use serde::Serialize;

use super::process::ProcessError;
use crate::imaging::wall::WallModel;
use crate::imaging::wall_estimate::{
    AssumedWall, EstimatedWall, WallEstimator, WallOutcome, WallSearch, WhyNot,
};
use crate::pipeline::ChainError;
use crate::recording::{Recording, SweepMean};

/// Sweeps of which the mean is taken, at most: people who walk leave little in it.
const MEAN_SWEEP_COUNT: u64 = 256;

/// Where the wall's numbers come from.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum WallSource {
    /// The settings of the chain.
    #[default]
    Configured,
    /// Its own echoes.
    Estimated,
}

/// What was found of the wall.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WallFound {
    /// Whether its echoes told it; if not, the numbers are assumed.
    pub estimated: bool,
    /// Thickness, metres.
    pub thickness_m: f64,
    /// Relative permittivity.
    pub permittivity: f64,
    /// Air before it, metres, if its echoes told that.
    pub standoff_m: Option<f64>,
    /// What it adds to a path straight through it, metres.
    pub excess_path_m: f64,
    /// Standard deviation of that: about the error in range that the wall still causes.
    pub excess_path_sigma_m: f64,
    /// Why the numbers are assumed.
    pub why: Option<String>,
}

impl WallFound {
    /// What to image with.
    #[must_use]
    pub fn model(&self) -> WallModel {
        let (thickness_m, permittivity) = (self.thickness_m, self.permittivity);
        WallModel::Refraction(proto::radar::Wall { thickness_m, permittivity })
    }

    fn of(outcome: WallOutcome) -> Option<Self> {
        match outcome {
            WallOutcome::Estimated(EstimatedWall {
                standoff_m,
                wall,
                excess_path_m,
                excess_path_sigma_m,
                ..
            }) => Some(Self {
                estimated: true,
                thickness_m: wall.thickness_m,
                permittivity: wall.permittivity,
                standoff_m: Some(standoff_m),
                excess_path_m,
                excess_path_sigma_m,
                why: None,
            }),
            WallOutcome::NotObservable { why: WhyNot::NoFaces { .. }, .. } => None,
            WallOutcome::NotObservable {
                why: WhyNot::OffsetsTooSmall { standoff_m, .. },
                assumed,
            } => {
                let AssumedWall { wall, excess_path_m, excess_path_sigma_m } = assumed;
                Some(Self {
                    estimated: false,
                    thickness_m: wall.thickness_m,
                    permittivity: wall.permittivity,
                    standoff_m: Some(standoff_m),
                    excess_path_m,
                    excess_path_sigma_m,
                    why: Some(format!("the array is too small for a wall {standoff_m:.2} m away")),
                })
            }
        }
    }
}

/// What the static echoes of `recording` tell of the wall, `None` if there is none; goes back to
/// the first sweep.
///
/// # Errors
/// If the recording is damaged.
pub(super) fn find_wall(
    recording: &mut Recording,
    path: &Path,
) -> Result<Option<WallFound>, ProcessError> {
    let background = match &recording.header().background {
        Some(background) => background.clone(),
        None => mean_sweep(recording)?,
    };
    let header = recording.header();
    let refused = |reason| ProcessError::Chain { path: path.to_owned(), reason };
    let estimator = WallEstimator::new(&header.band, &header.array, &WallSearch::default())
        .map_err(|error| refused(ChainError::Setting(error)))?;
    // A recording's samples are finite and as many as its header says.
    Ok(estimator.estimate(&background).ok().and_then(WallFound::of))
}

/// The mean of sweeps spread over the recording.
fn mean_sweep(recording: &mut Recording) -> Result<Vec<Complex<f32>>, ProcessError> {
    let stride = recording.period_count().div_ceil(MEAN_SWEEP_COUNT).max(1);
    let mut mean = SweepMean::default();
    while let Some(sweep) = recording.next_sweep()? {
        mean.add(&sweep.samples);
        recording.skip_sweeps(stride - 1)?;
    }
    recording.rewind()?;
    Ok(mean.mean())
}
