//! The ways of those who were taken for people, as far as a recording shows them.

use std::collections::BTreeMap;

use nalgebra::Vector2;
use proto::measured::line_of_sight;
use proto::wire::{TrackRecord, TrackStatus};
use serde::Serialize;

/// What became of one track that was confirmed.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct WayOfTrack {
    /// The track's id.
    pub id: u64,
    /// When it was first followed, tentatively, seconds.
    pub first_s: f64,
    /// When it was last followed, seconds.
    pub last_s: f64,
    /// Periods in which it was confirmed.
    pub confirmed_count: u64,
    /// Periods in which it was believed without being seen.
    pub coasting_count: u64,
    /// Where the person's middle was first, `[x, y]` in metres in the node's frame.
    pub first_m: [f64; 2],
    /// Where it was last.
    pub last_m: [f64; 2],
    /// The mean of the appearance scores of the periods in which it was confirmed.
    pub mean_appearance: f64,
}

/// One track so far.
#[derive(Clone, Debug)]
struct Way {
    times_s: (f64, f64),
    confirmed_count: u64,
    coasting_count: u64,
    appearance_sum: f64,
    places_m: Vec<[f64; 2]>,
}

/// All tracks of a recording.
#[derive(Clone, Debug)]
pub(super) struct Ways {
    half_depth_m: f64,
    ways: BTreeMap<u64, Way>,
}

impl Ways {
    /// Nobody yet; people's middles lie `half_depth_m` behind what is seen of them.
    pub(super) fn new(half_depth_m: f64) -> Self {
        Self { half_depth_m, ways: BTreeMap::new() }
    }

    /// Takes the tracks of the next period. Tentative ones that are gone are forgotten.
    pub(super) fn take(&mut self, time_s: f64, tracks: &[TrackRecord]) {
        let is_there = |id: &u64| tracks.iter().any(|track| track.id == *id);
        self.ways.retain(|id, way| 0 < way.confirmed_count || is_there(id));
        for track in tracks {
            let place_m = self.middle_m(track);
            let way = self.ways.entry(track.id).or_insert_with(|| Way {
                times_s: (time_s, time_s),
                confirmed_count: 0,
                coasting_count: 0,
                appearance_sum: 0.0,
                places_m: Vec::new(),
            });
            way.times_s.1 = time_s;
            way.places_m.push(place_m);
            match track.status {
                TrackStatus::Tentative => {}
                TrackStatus::Confirmed => {
                    way.confirmed_count += 1;
                    way.appearance_sum += track.appearance;
                }
                TrackStatus::Coasting => way.coasting_count += 1,
            }
        }
    }

    /// Everybody who was confirmed once, by id.
    pub(super) fn people(&self) -> Vec<WayOfTrack> {
        let way = |(id, way): (&u64, &Way)| {
            let (first_m, last_m) = (*way.places_m.first()?, *way.places_m.last()?);
            (0 < way.confirmed_count).then_some(WayOfTrack {
                id: *id,
                first_s: way.times_s.0,
                last_s: way.times_s.1,
                confirmed_count: way.confirmed_count,
                coasting_count: way.coasting_count,
                first_m,
                last_m,
                mean_appearance: way.appearance_sum / way.confirmed_count as f64,
            })
        };
        self.ways.iter().filter_map(way).collect()
    }

    /// The places of everybody who was confirmed once, by id.
    pub(super) fn places_m(&self) -> impl Iterator<Item = (u64, &[[f64; 2]])> {
        let people = self.ways.iter().filter(|(_, way)| 0 < way.confirmed_count);
        people.map(|(id, way)| (*id, way.places_m.as_slice()))
    }

    fn middle_m(&self, track: &TrackRecord) -> [f64; 2] {
        let seen_m = Vector2::new(track.state[0], track.state[1]);
        (seen_m + line_of_sight(&seen_m) * self.half_depth_m).into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn track(id: u64, status: TrackStatus, x_m: f64) -> TrackRecord {
        TrackRecord {
            id,
            status,
            state: [x_m, 0.0, 0.0, 0.0],
            covariance: [0.0; 10],
            extent_m2: [0.0; 3],
            appearance: 0.25 * x_m,
            unseen_s: 0.0,
        }
    }

    #[test]
    fn people_are_those_who_were_confirmed_and_others_are_forgotten() {
        let (tentative, confirmed) = (TrackStatus::Tentative, TrackStatus::Confirmed);
        let mut ways = Ways::new(0.5);
        ways.take(0.0, &[track(1, tentative, 1.0), track(2, tentative, 5.0)]);
        ways.take(0.1, &[track(1, confirmed, 2.0)]);
        assert_eq!(ways.ways.len(), 1);
        ways.take(0.2, &[track(1, confirmed, 3.0), track(3, tentative, 9.0)]);
        ways.take(0.3, &[track(1, TrackStatus::Coasting, 4.0)]);
        ways.take(0.4, &[]);
        let expected = WayOfTrack {
            id: 1,
            first_s: 0.0,
            last_s: 0.3,
            confirmed_count: 2,
            coasting_count: 1,
            first_m: [1.5, 0.0],
            last_m: [4.5, 0.0],
            mean_appearance: 0.625,
        };
        assert_eq!(ways.people(), [expected]);
        let places: Vec<(u64, &[[f64; 2]])> = ways.places_m().collect();
        assert_eq!(places[0].1.len(), 4);
    }
}
