//! Smoothed states of people in a recording: rows of a table, and ways for the figure.

use std::collections::BTreeMap;
use std::io::{self, Write};

use proto::ids::NodeId;
use proto::wire::{TrackRecord, TrackStatus, packed_covariance};

use crate::tracking::Smoothed;

/// The names of the columns.
const COLUMNS: &str = "node,time_s,id,x_m,y_m,x_m_per_s,y_m_per_s,\
    cov_xx,cov_xy,cov_xu,cov_xv,cov_yy,cov_yu,cov_yv,cov_uu,cov_uv,cov_vv\n";

/// One person's smoothed states so far.
#[derive(Clone, Debug)]
struct Person {
    /// The newest state; it may become better as long as its time stays.
    newest: Smoothed,
    is_confirmed: bool,
    places_m: Vec<[f64; 2]>,
}

/// Everybody's smoothed states, each once, as late and therefore as good as it gets.
#[derive(Clone, Debug, Default)]
pub(super) struct Smoothing {
    people: BTreeMap<u64, Person>,
}

impl Smoothing {
    /// Takes what the tracker says now, and writes rows of what will not change any more. Who was
    /// never confirmed is not written.
    pub(super) fn take(
        &mut self,
        node: &NodeId,
        (smoothed, tracks): (&[Smoothed], &[TrackRecord]),
        mut table: Option<impl Write>,
    ) -> io::Result<()> {
        for newest in smoothed {
            let person = self.people.entry(newest.id).or_insert_with(|| Person {
                newest: *newest,
                is_confirmed: false,
                places_m: Vec::new(),
            });
            if person.newest.time_s < newest.time_s {
                person.keep(node, table.as_mut())?;
            }
            // One who was lost and found again begins later; an earlier state is no newer one.
            if person.newest.time_s <= newest.time_s {
                person.newest = *newest;
            }
            let is_person = |track: &&TrackRecord| track.status != TrackStatus::Tentative;
            let own = tracks.iter().find(|track| track.id == newest.id);
            person.is_confirmed |= own.as_ref().is_some_and(is_person);
        }
        let is_there = |id: &u64| smoothed.iter().any(|one| one.id == *id);
        self.people.retain(|id, person| person.is_confirmed || is_there(id));
        Ok(())
    }

    /// Writes the last states, of whom nothing more will be known.
    pub(super) fn finish(
        &mut self,
        node: &NodeId,
        mut table: Option<impl Write>,
    ) -> io::Result<()> {
        self.people.values_mut().try_for_each(|person| person.keep(node, table.as_mut()))
    }

    /// The smoothed way of a person, `[x, y]` in metres; `None` if there is none.
    pub(super) fn places_m(&self, id: u64) -> Option<&[[f64; 2]]> {
        let person = self.people.get(&id).filter(|person| person.is_confirmed)?;
        (!person.places_m.is_empty()).then_some(person.places_m.as_slice())
    }

    /// The head of the table.
    pub(super) fn begin(mut table: impl Write) -> io::Result<()> {
        table.write_all(COLUMNS.as_bytes())
    }
}

impl Person {
    fn keep(&mut self, node: &NodeId, table: Option<impl Write>) -> io::Result<()> {
        let Smoothed { id, time_s, state, covariance } = &self.newest;
        self.places_m.push([state[0], state[1]]);
        let Some(mut table) = table.filter(|_| self.is_confirmed) else { return Ok(()) };
        write!(table, "{node},{time_s},{id}")?;
        for number in state.iter().chain(&packed_covariance(covariance)) {
            write!(table, ",{number}")?;
        }
        table.write_all(b"\n")
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix4, Vector4};

    use super::*;

    fn state(id: u64, time_s: f64, x_m: f64) -> Smoothed {
        let state = Vector4::new(x_m, 2.0, 0.5, 0.0);
        Smoothed { id, time_s, state, covariance: Matrix4::identity() }
    }

    fn track(id: u64, status: TrackStatus) -> TrackRecord {
        TrackRecord {
            id,
            status,
            state: [0.0; 4],
            covariance: [0.0; 10],
            extent_m2: [0.0; 3],
            appearance: 1.0,
            unseen_s: 0.0,
        }
    }

    #[test]
    fn every_state_is_written_once_when_it_is_as_good_as_it_gets() {
        let node: NodeId = "n1".parse().unwrap();
        let (confirmed, tentative) = (TrackStatus::Confirmed, TrackStatus::Tentative);
        let mut smoothing = Smoothing::default();
        let mut table = Vec::new();
        Smoothing::begin(&mut table).unwrap();
        let shown = [
            (vec![state(1, 0.0, 1.0), state(2, 0.0, 9.0)], tentative),
            (vec![state(1, 0.0, 1.5)], confirmed),
            (vec![state(1, 0.1, 2.0)], confirmed),
            (vec![state(1, 0.2, 3.0)], confirmed),
            (vec![], confirmed),
        ];
        for (smoothed, status) in shown {
            let tracks = [track(1, status)];
            smoothing.take(&node, (&smoothed, &tracks), Some(&mut table)).unwrap();
        }
        smoothing.finish(&node, Some(&mut table)).unwrap();
        let text = String::from_utf8(table).unwrap();
        let starts: Vec<String> =
            text.lines().map(|row| row.split(',').take(4).collect::<Vec<_>>().join(",")).collect();
        assert_eq!(starts, ["node,time_s,id,x_m", "n1,0,1,1.5", "n1,0.1,1,2", "n1,0.2,1,3"]);
        let column_counts = text.lines().map(|row| row.split(',').count());
        assert!(column_counts.into_iter().all(|count| count == 17));
        assert_eq!(smoothing.places_m(1).unwrap(), [[1.5, 2.0], [2.0, 2.0], [3.0, 2.0]]);
        assert_eq!(smoothing.places_m(2), None);
    }
}
