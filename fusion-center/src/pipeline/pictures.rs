//! What the centre shows: targets of one period, people, nodes; and which places were seen in common.

use std::time::Duration;

use proto::ids::NodeId;
use proto::keys::Topic;
use proto::time::CentreTime;
use proto::wire::Picture;

use super::{Centre, outcomes};
use crate::fuse::{Sighting, fuse, place};
use crate::gather::{KeptPoint, KeptSet, Place};

/// The picture is published at least this often, so that silence shows.
const PICTURE_INTERVAL: Duration = Duration::from_secs(1);

/// Most points that one picture is made of; joining them costs the square of this.
pub(super) const MAX_SIGHTING_COUNT: usize = 512;

impl Centre {
    /// Sets that came after their period was closed belong into its picture all the same.
    pub(super) fn complete_pictures(&mut self, now: CentreTime, periods: &[i64]) {
        for period in periods {
            if self.gather.is_closed(*period) {
                let picture = self.picture(*period);
                self.send_picture(now, picture);
            }
        }
    }

    pub(super) fn picture(&self, period: i64) -> Picture {
        let mut targets = fuse(&self.sightings(period), self.config.fuse.gate());
        // One node's wild point must not cost everybody the picture.
        targets.retain(|target| target.check().is_ok());
        Picture {
            reference: self.config.reference.clone(),
            period,
            time: self.gather.middle(period),
            nodes: Vec::new(),
            targets,
            tracks: Vec::new(),
            people: Vec::new(),
        }
    }

    pub(super) fn refresh_picture(&mut self, now: CentreTime) {
        let due = self.last_picture_sent.is_none_or(|sent| PICTURE_INTERVAL <= now.since(sent));
        if due && let Some(picture) = self.last_picture.clone() {
            self.send_picture(now, picture);
        }
    }

    pub(super) fn send_picture(&mut self, now: CentreTime, mut picture: Picture) {
        picture.nodes = outcomes::node_lines(now, &self.gather, &self.poses);
        let silence = Duration::from_secs_f64(self.config.gather.silent_after_s);
        self.followed.forget_old(now, silence);
        picture.tracks = self.followed.shown(&self.gather, &self.poses);
        self.people.forget_old(now, silence);
        picture.people = self.people.shown();
        self.outbox.publish(now, Topic::Picture, &picture);
        if self.last_picture.as_ref().is_none_or(|last| last.period <= picture.period) {
            self.last_picture_sent = Some(now);
            self.last_picture = Some(picture);
        }
    }

    /// The points of all registered nodes in one period, in `Ref`: the strongest, if they are more
    /// than a picture holds.
    fn sightings(&self, period: i64) -> Vec<Sighting> {
        let mut sightings = Vec::new();
        for (node, history) in self.gather.nodes() {
            let Some(set) = history.sets().get(&period) else { continue };
            let Some((pose_ref_from_node, covariance)) = self.poses.pose(node) else { continue };
            sightings.extend(set.points.iter().map(|point| Sighting {
                node: node.clone(),
                position: place(
                    pose_ref_from_node,
                    &covariance,
                    point.with_half_depth_error(set.half_depth_sigma_m),
                ),
                snr_db: point.snr_db,
            }));
        }
        sightings.sort_by(|one, other| other.snr_db.total_cmp(&one.snr_db));
        sightings.truncate(MAX_SIGHTING_COUNT);
        sightings
    }
    /// Notes where the points of a closed period lie, those of registered nodes only where another
    /// node saw the same.
    pub(super) fn note_places(&mut self, period: i64) {
        let sighted = |node: &NodeId| self.poses.pose(node).is_some();
        let cell = |point: &KeptPoint| {
            #[expect(clippy::cast_possible_truncation, reason = "messages bound coordinates")]
            let index = |value_m: f64| (value_m / self.config.gather.place_m).floor() as i64;
            (index(point.position.mean.x_m()), index(point.position.mean.y_m()))
        };
        let sets: Vec<(&NodeId, &KeptSet)> = self.gather.sets_in(period).collect();
        let mut places = Vec::new();
        for (node, set) in sets.iter().filter(|(_, set)| 1 < sets.len() && !set.points.is_empty()) {
            let is_registered = sighted(node);
            for point in &set.points {
                let is_common = is_registered && self.is_common((node, point), &sets);
                let place = Place { node: (*node).clone(), cell: cell(point), is_common };
                places.push(place);
            }
        }
        self.gather.note_places(period, places);
    }

    /// Whether another node's point of the same period lies where this one does.
    fn is_common(
        &self,
        (node, point): (&NodeId, &KeptPoint),
        sets: &[(&NodeId, &KeptSet)],
    ) -> bool {
        let placed = |of: &NodeId, seen: &KeptPoint, sigma_m: f64| {
            let (pose, covariance) = self.poses.pose(of)?;
            Some(place(pose, &covariance, seen.with_half_depth_error(sigma_m)))
        };
        let Some(own) = placed(node, point, 0.0) else { return false };
        let gate = self.config.fuse.gate();
        let mut others = sets.iter().filter(|(other, _)| *other != node);
        others.any(|(other, set)| {
            let meets = |partner: &KeptPoint| {
                let at = placed(other, partner, set.half_depth_sigma_m)?;
                Some(crate::fuse::distance(&own, &at)? <= gate)
            };
            set.points.iter().any(|partner| meets(partner).unwrap_or(false))
        })
    }
}
