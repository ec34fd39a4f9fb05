//! People followed on the measured images and said to the network: the newest period only.

use std::collections::BTreeMap;
use std::fmt::Display;

use proto::ids::NodeId;
use proto::time::NodeTime;
use proto::wire::{NodeTracks, TrackRecord, TrackStatus};
use tokio::sync::watch;
use tracing::warn;

use crate::config::AgentConfig;
use crate::imaging::InvalidSetting;
use crate::pipeline::Measured;
use crate::tracking::default::BodyModel;
use crate::tracking::{Tracker, follow};

/// Who was followed last and the number of that message, once there is one.
pub(super) type Newest = Option<(u64, NodeTracks)>;

/// Follows people, if that is configured.
pub(super) struct Follow {
    tracker: Option<Box<dyn Tracker>>,
    node: NodeId,
    half_depth_m: f64,
    half_depth_sigma_m: f64,
    newest: watch::Sender<Newest>,
    next_sequence: u64,
    refusals: BTreeMap<&'static str, u64>,
}

/// Which period a frame is of.
#[derive(Clone, Copy, Debug)]
pub(super) struct Period {
    pub(super) number: u64,
    /// Its middle on the node's clock.
    pub(super) time: NodeTime,
    /// The time of its sweep.
    pub(super) sweep_s: f64,
}

impl Follow {
    /// Knows nobody yet; `newest` is told of every period.
    ///
    /// # Errors
    /// If a setting of the tracker makes no sense.
    pub(super) fn new(
        config: &AgentConfig,
        newest: watch::Sender<Newest>,
    ) -> Result<Self, InvalidSetting> {
        let of_points_m = config.half_depth_m();
        let body = BodyModel::new(of_points_m.0, &config.chain.detection);
        let (half_depth_m, half_depth_sigma_m) = config.tracking.half_depth_m(of_points_m);
        Ok(Self {
            tracker: config.tracking.tracker(body)?,
            node: config.node.clone(),
            half_depth_m,
            half_depth_sigma_m,
            newest,
            next_sequence: 0,
            refusals: BTreeMap::new(),
        })
    }

    /// Follows people into the next period. What the tracker refuses is counted by its kind and
    /// named when that count reaches a power of two; the period then says nothing.
    pub(super) fn take(&mut self, period: Period, measured: &Measured<'_>) {
        let Some(tracker) = &mut self.tracker else { return };
        match follow(tracker.as_mut(), period.sweep_s, measured) {
            Ok(tracks) => self.tell(period, tracks),
            Err(error) => self.refuse(error.label(), &error),
        }
    }

    fn tell(&mut self, period: Period, tracks: Vec<TrackRecord>) {
        let tracks = self.fit_to_send(tracks);
        let Self { node, half_depth_m, half_depth_sigma_m, .. } = &*self;
        let told = NodeTracks {
            node: node.clone(),
            period: period.number,
            time: period.time,
            clock: None,
            half_depth_m: *half_depth_m,
            half_depth_sigma_m: *half_depth_sigma_m,
            refused_count: self.refusals.values().sum(),
            tracks,
        };
        self.newest.send_replace(Some((self.next_sequence, told)));
        self.next_sequence += 1;
    }

    /// The tracks that can be sent: one that makes no sense, or one too many, must not cost the
    /// others.
    fn fit_to_send(&mut self, mut tracks: Vec<TrackRecord>) -> Vec<TrackRecord> {
        tracks.retain(|track| {
            let checked = track.check();
            checked.inspect_err(|reason| self.refuse("senseless_track", reason)).is_ok()
        });
        let count = tracks.len();
        if NodeTracks::MAX_TRACK_COUNT < count {
            self.refuse("too_many_tracks", &format_args!("{count} tracks are too many to send"));
            tracks.sort_by_key(|track| (track.status == TrackStatus::Tentative, track.id));
            tracks.truncate(NodeTracks::MAX_TRACK_COUNT);
            tracks.sort_by_key(|track| track.id);
        }
        tracks
    }

    fn refuse(&mut self, label: &'static str, reason: &dyn Display) {
        let count = self.refusals.entry(label).or_default();
        *count += 1;
        if count.is_power_of_two() {
            warn!(label, count, %reason, "not followed");
        }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix4, Vector4};
    use proto::radar::Grid;

    use super::*;
    use crate::imaging::backproject::CoherentImage;
    use crate::imaging::pixels::Pixels;
    use crate::pipeline::{ChainState, ImageView};
    use crate::tracking::{self, Frame, FrameError, Track};

    /// Follows as many people as the frame's first pixel says; the fifth of them is nowhere.
    #[derive(Default)]
    struct Scripted {
        tracks: Vec<Track>,
        last_s: f64,
    }

    impl Tracker for Scripted {
        fn track(&mut self, frame: &Frame<'_>) -> Result<&[Track], FrameError> {
            let (time_s, previous_s) = (frame.time_s, self.last_s);
            if time_s <= previous_s {
                return Err(FrameError::TimeNotAscending { time_s, previous_s });
            }
            self.last_s = time_s;
            let count = (0..1000).take_while(|count| (*count as f32) < frame.amplitude[0]).count();
            let track = |index: usize| Track {
                id: index as u64,
                status: match index % 2 {
                    0 => tracking::TrackStatus::Tentative,
                    _ => tracking::TrackStatus::Coasting,
                },
                state: Vector4::new(if index == 5 { f64::NAN } else { 1.0 }, 2.0, 0.0, 0.0),
                covariance: Matrix4::identity(),
                extent_m2: [0.1, 0.0, 0.1],
                appearance: 1.0,
                seen_s: time_s - 0.5,
            };
            self.tracks = (0..count).map(track).collect();
            Ok(&self.tracks)
        }
    }

    fn follower() -> (Follow, watch::Receiver<Newest>) {
        let (newest, shown) = watch::channel(None);
        let mut follow = Follow::new(&AgentConfig::default(), newest).unwrap();
        assert!(follow.tracker.is_none(), "nobody is followed unless it is configured");
        follow.tracker = Some(Box::new(Scripted::default()));
        (follow, shown)
    }

    fn show(follow: &mut Follow, number: u64, person_count: f32, state: ChainState) {
        let grid = Grid { x_min_m: 0.0, y_min_m: 1.0, pixel_m: 1.0, column_count: 2, row_count: 1 };
        let coherent = CoherentImage {
            pixels: Pixels::Cartesian(grid),
            channel_count: 8,
            power: vec![0.0; 2],
            energy: vec![0.0; 2],
            phase_coherence: Vec::new(),
        };
        let amplitude = [person_count, 0.0];
        let image =
            ImageView { grid, coherent: &coherent, amplitude: &amplitude, noise_amplitude: 0.1 };
        let period = Period { number, time: NodeTime(number), sweep_s: number as f64 };
        follow.take(period, &Measured { points: Vec::new(), image, state });
    }

    /// Number, period, track count and refusals of what was told last.
    fn last(shown: &watch::Receiver<Newest>) -> (u64, u64, usize, u64) {
        let (sequence, told) = shown.borrow().clone().unwrap();
        (sequence, told.period, told.tracks.len(), told.refused_count)
    }

    #[test]
    fn the_newest_period_is_told_and_refused_frames_are_counted() {
        let (mut follow, shown) = follower();
        show(&mut follow, 1, 9.0, ChainState::WarmingUp);
        assert_eq!(last(&shown), (0, 1, 0, 0));
        show(&mut follow, 2, 3.0, ChainState::Ready);
        assert_eq!(last(&shown), (1, 2, 3, 0));
        let unseen_s = shown.borrow().as_ref().unwrap().1.tracks[0].unseen_s;
        assert!((unseen_s - 0.5).abs() < 1e-12);
        show(&mut follow, 2, 3.0, ChainState::Ready);
        assert_eq!(last(&shown), (1, 2, 3, 0), "a refused frame says nothing");
        show(&mut follow, 3, 0.0, ChainState::Ready);
        assert_eq!(last(&shown), (2, 3, 0, 1));
    }

    #[test]
    fn a_senseless_track_and_a_crowd_cost_no_others() {
        let (mut follow, shown) = follower();
        show(&mut follow, 1, 7.0, ChainState::Ready);
        let few = shown.borrow().clone().unwrap().1;
        let ids: Vec<u64> = few.tracks.iter().map(|track| track.id).collect();
        assert_eq!((ids, few.refused_count), (vec![0, 1, 2, 3, 4, 6], 1));
        show(&mut follow, 2, 400.0, ChainState::Ready);
        let many = shown.borrow().clone().unwrap().1;
        assert_eq!(many.tracks.len(), NodeTracks::MAX_TRACK_COUNT);
        let sure = many.tracks.iter().filter(|track| track.status == TrackStatus::Coasting);
        // Of 400, every second is sure; one of those is nowhere.
        assert_eq!(sure.count(), 199);
        assert!(many.tracks.windows(2).all(|pair| pair[0].id < pair[1].id));
    }
}
