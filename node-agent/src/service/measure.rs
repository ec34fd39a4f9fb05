//! The measuring loop: waits for each period, runs the chain, hands the set over.

use std::time::Duration;

use proto::measured::MeasuredPoint;
use proto::time::NodeTime;
use proto::wire::{Counters, PointSet, SourceState};
use tokio::sync::{broadcast, watch};
use tokio_util::sync::CancellationToken;
use tracing::{info, warn};

use super::clock::Clock;
use super::follow::{Follow, Period};
use super::live::{Live, LiveSweep};
use super::output::Output;
use crate::config::AgentConfig;
use crate::group::group_period;
use crate::pipeline::{Chain, ChainError, Measured};
use crate::source::{Frame, SweepSource};

/// A period is measured late rather than not at all, up to this much: a slow moment must not cost
/// data, while an agent that starts in mid-scenario goes straight to the present.
const LATE_LIMIT: Duration = Duration::from_secs(5);

/// What the measuring loop shows of itself.
#[derive(Clone, Debug)]
pub(super) struct Progress {
    pub(super) source: SourceState,
    pub(super) next_sequence: u64,
    pub(super) queue_length: u32,
    pub(super) counters: Counters,
}

impl Default for Progress {
    fn default() -> Self {
        let counters = Counters::default();
        Self { source: SourceState::Waiting, next_sequence: 0, queue_length: 0, counters }
    }
}

pub(super) struct Measure {
    pub(super) config: AgentConfig,
    pub(super) clock: Clock,
    pub(super) chain: Chain,
    pub(super) output: Output,
    pub(super) follow: Follow,
    pub(super) sets: broadcast::Sender<(u64, PointSet)>,
    pub(super) progress: watch::Sender<Progress>,
    pub(super) dropped: watch::Receiver<u64>,
}

/// One period's place in time.
#[derive(Clone, Copy)]
struct Moment {
    period: u64,
    /// Its middle on the node's clock.
    time: NodeTime,
    /// Its middle in the source's own time.
    source_s: f64,
}

/// Where sweeps come from, and who says when.
pub(super) enum Source {
    /// Played: the agent says when a period is due.
    Played(Box<dyn SweepSource>),
    /// Live: a sweep is due when it comes.
    Live(Box<Live>),
}

impl Measure {
    /// Measures period after period until the source ends or `stop`.
    pub(super) async fn run(mut self, source: Source, stop: CancellationToken) {
        match source {
            Source::Played(source) => self.play(source, &stop).await,
            Source::Live(live) => self.follow(*live, &stop).await,
        }
        if !stop.is_cancelled() {
            info!(node = %self.config.node, "the source has ended");
            self.show_state(SourceState::Finished);
        }
        tokio::task::block_in_place(|| self.output.finish());
    }

    /// Plays a source against the clock.
    async fn play(&mut self, mut source: Box<dyn SweepSource>, stop: &CancellationToken) {
        let start_ns = match self.config.play.start_unix_s {
            Some(unix_s) => self.clock.at_unix_s(unix_s),
            None => i64::try_from(self.clock.now().0).unwrap_or(i64::MAX),
        };
        let end = source.period_count().unwrap_or(u64::MAX);
        for period in 0..end {
            let middle_s = source.middle_s(period);
            let due = self.due(start_ns, middle_s).filter(|due| self.is_worth_measuring(*due));
            let Some(due) = due else {
                self.progress.send_modify(|p| p.counters.skipped_period_count += 1);
                continue;
            };
            tokio::select! {
                () = stop.cancelled() => break,
                () = tokio::time::sleep_until(self.clock.instant(due)) => {}
            }
            self.show_state(SourceState::Running);
            let moment = Moment { period, time: due, source_s: middle_s };
            let frame = tokio::task::block_in_place(|| source.frame(period));
            match frame {
                Ok(frame) => tokio::task::block_in_place(|| self.measure(moment, frame)),
                Err(error) => {
                    warn!(period, %error, "the source ends early");
                    break;
                }
            }
        }
    }

    /// Measures sweeps as they come.
    async fn follow(&mut self, mut live: Live, stop: &CancellationToken) {
        let mut period = 0;
        loop {
            let taken = tokio::select! {
                () = stop.cancelled() => break,
                taken = live.next() => taken,
            };
            let Some(LiveSweep { sweep, taken, lost_count }) = taken else {
                self.progress.send_modify(|p| p.counters.refused_frame_count += 1);
                continue;
            };
            self.show_state(SourceState::Running);
            self.progress.send_modify(|p| p.counters.skipped_period_count += lost_count);
            let moment = Moment { period, time: taken, source_s: sweep.time_s };
            tokio::task::block_in_place(|| self.measure(moment, Frame::Sweep(sweep)));
            period += 1;
        }
        live.close().await;
    }

    /// When a period's middle is on this clock; `None` before the clock's origin.
    fn due(&self, start_ns: i64, middle_s: f64) -> Option<NodeTime> {
        let from_start_s = middle_s / self.config.play.speed;
        let from_start_ns = Duration::try_from_secs_f64(from_start_s).ok()?.as_nanos();
        let due_ns = start_ns.checked_add(i64::try_from(from_start_ns).ok()?)?;
        u64::try_from(due_ns).ok().map(NodeTime)
    }

    fn is_worth_measuring(&self, due: NodeTime) -> bool {
        self.clock.now().0.saturating_sub(due.0)
            <= u64::try_from(LATE_LIMIT.as_nanos()).unwrap_or(u64::MAX)
    }

    fn show_state(&self, state: SourceState) {
        self.progress.send_if_modified(|progress| {
            let changed = progress.source != state;
            progress.source = state;
            changed
        });
    }

    fn measure(&mut self, moment: Moment, frame: Frame) {
        let Moment { period, time, source_s } = moment;
        let points = match self.points(moment, frame) {
            Ok(points) => points,
            Err(error) => {
                warn!(period, %error, "frame refused");
                self.progress.send_modify(|p| p.counters.refused_frame_count += 1);
                return;
            }
        };
        let dropped_set_count = *self.dropped.borrow();
        let queue_length = u32::try_from(self.sets.len()).unwrap_or(u32::MAX);
        self.progress.send_modify(|progress| {
            progress.counters.frame_count += 1;
            progress.counters.point_count += points.len() as u64;
            progress.counters.dropped_set_count = dropped_set_count;
            progress.queue_length = queue_length;
        });
        let Progress { next_sequence, counters, .. } = self.progress.borrow().clone();
        let (half_depth_m, half_depth_sigma_m) = self.config.half_depth_m();
        let node = self.config.node.clone();
        let set = PointSet {
            node,
            period,
            time,
            clock: None,
            half_depth_m,
            half_depth_sigma_m,
            points,
            counters,
        };
        self.output.write_set(&set, source_s);
        // The ring is held open by `self.progress`'s owner; no receiver means no network yet.
        drop(self.sets.send((next_sequence, set)));
        self.progress.send_modify(|progress| progress.next_sequence += 1);
    }

    /// The points of a frame; its picture goes to the output, and people are followed on it.
    fn points(&mut self, moment: Moment, frame: Frame) -> Result<Vec<MeasuredPoint>, ChainError> {
        let Moment { period, time, .. } = moment;
        let now = self.clock.now();
        let node = &self.config.node;
        match frame {
            Frame::Sweep(sweep) => {
                let measured = self.chain.process_sweep(&sweep)?;
                self.follow.take(Period { number: period, time, sweep_s: sweep.time_s }, &measured);
                let Measured { points, image, .. } = measured;
                let title = || format!("{node}, period {period}");
                self.output.show_image(now, title, &image, &points);
                Ok(points)
            }
            Frame::Detections(detections) => {
                let points = group_period(&detections, &self.config.group);
                let title = format!("{node}, where people were seen up to period {period}");
                self.output.show_points(now, title, &points);
                Ok(points)
            }
        }
    }
}
