//! Trackers between the chain and the wire: frames of what was measured, records of who is followed.

use proto::wire::{self, TrackRecord, packed_covariance};

use super::{Frame, FrameError, Track, TrackStatus, Tracker};
use crate::pipeline::{ChainState, Measured};

/// Shows `tracker` what was measured at `time_s` and gives the records of everybody who is followed.
/// While the background is learned there is no image, and nobody is followed yet.
///
/// # Errors
/// If the tracker refuses the frame.
pub fn follow(
    tracker: &mut dyn Tracker,
    time_s: f64,
    measured: &Measured<'_>,
) -> Result<Vec<TrackRecord>, FrameError> {
    if measured.state == ChainState::WarmingUp {
        return Ok(Vec::new());
    }
    let frame = Frame {
        time_s,
        grid: measured.image.grid,
        amplitude: &measured.image.on_grid(),
        noise_amplitude: measured.image.noise_amplitude,
        points: &measured.points,
    };
    let tracks = tracker.track(&frame)?;
    Ok(tracks.iter().map(|track| track.record(time_s)).collect())
}

impl Track {
    /// The track as it is sent and written, at the frame's time.
    #[must_use]
    pub fn record(&self, time_s: f64) -> TrackRecord {
        TrackRecord {
            id: self.id,
            status: self.status.into(),
            state: self.state.into(),
            covariance: packed_covariance(&self.covariance),
            extent_m2: self.extent_m2,
            appearance: self.appearance,
            unseen_s: (time_s - self.seen_s).max(0.0),
        }
    }
}

impl From<TrackStatus> for wire::TrackStatus {
    fn from(status: TrackStatus) -> Self {
        match status {
            TrackStatus::Tentative => Self::Tentative,
            TrackStatus::Confirmed => Self::Confirmed,
            TrackStatus::Coasting => Self::Coasting,
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix4, Vector4};

    use super::*;

    #[test]
    fn a_record_says_the_same_in_the_words_of_the_wire() {
        let covariance =
            Matrix4::from_fn(|row, column| (10 * row.min(column) + row.max(column)) as f64);
        let track = Track {
            id: 7,
            status: TrackStatus::Coasting,
            state: Vector4::new(1.0, 2.0, 3.0, 4.0),
            covariance,
            extent_m2: [0.5, 0.25, 0.75],
            appearance: 0.5,
            seen_s: 9.5,
        };
        let record = track.record(10.0);
        assert_eq!((record.id, record.status), (7, wire::TrackStatus::Coasting));
        let numbers = record.state.iter().chain(&record.extent_m2).chain([&record.appearance]);
        let expected = [1.0, 2.0, 3.0, 4.0, 0.5, 0.25, 0.75, 0.5];
        assert!(numbers.zip(expected).all(|(got, want)| (got - want).abs() < 1e-12), "{record:?}");
        assert!((record.covariance_matrix() - covariance).norm() < 1e-12);
        assert!((record.unseen_s - 0.5).abs() < 1e-12);
        // Rounding must not make a time of seeing lie ahead.
        assert!(track.record(9.4).unseen_s.abs() < 1e-12);
        for (own, sent) in [
            (TrackStatus::Tentative, wire::TrackStatus::Tentative),
            (TrackStatus::Confirmed, wire::TrackStatus::Confirmed),
        ] {
            assert_eq!(wire::TrackStatus::from(own), sent);
        }
    }
}
