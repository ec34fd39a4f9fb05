//! Track numbers of 16 bits for ids of 64 bits.

use std::collections::{BTreeMap, BTreeSet};

use crate::export::ExportError;

/// Numbers that a track may have; 0 is left to those who mean "no track" by it.
const NUMBERS: std::ops::RangeInclusive<u16> = 1..=u16::MAX;

/// Which number each living track has.
///
/// Numbers go up by one from track to track and begin again after 65,535, leaving out those that
/// are in use: a number is never held by two tracks at once, and a released one rests as long as
/// possible. With ten new tracks a second that is about two hours.
#[derive(Clone, Debug, Default)]
pub struct TrackNumbers {
    by_id: BTreeMap<u64, u16>,
    in_use: BTreeSet<u16>,
    last: u16,
}

impl TrackNumbers {
    /// The number of a track; a new one if it has none yet.
    ///
    /// # Errors
    /// If all numbers are in use.
    pub fn of(&mut self, id: u64) -> Result<u16, ExportError> {
        if let Some(number) = self.by_id.get(&id) {
            return Ok(*number);
        }
        let after = self.last.saturating_add(1)..=u16::MAX;
        let again = NUMBERS;
        let mut free =
            after.chain(again).filter(|number| *number > 0 && !self.in_use.contains(number));
        let number = free.next().ok_or(ExportError::TrackNumbers { in_use: self.in_use.len() })?;
        self.last = number;
        self.in_use.insert(number);
        self.by_id.insert(id, number);
        Ok(number)
    }

    /// Whether the track has a number already: whether others have heard of it.
    #[must_use]
    pub fn knows(&self, id: u64) -> bool {
        self.by_id.contains_key(&id)
    }

    /// Frees the number of a track that ended, after its last message. Unknown ids are passed over.
    pub fn release(&mut self, id: u64) {
        if let Some(number) = self.by_id.remove(&id) {
            self.in_use.remove(&number);
        }
    }

    /// Frees the numbers of all tracks that are not alive; returns their ids and numbers, for
    /// their last messages.
    pub fn retain(&mut self, alive: impl Fn(u64) -> bool) -> Vec<(u64, u16)> {
        let ended: Vec<(u64, u16)> = self
            .by_id
            .iter()
            .map(|(id, number)| (*id, *number))
            .filter(|(id, _)| !alive(*id))
            .collect();
        ended.iter().for_each(|(id, _)| self.release(*id));
        ended
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_track_keeps_its_number_and_a_released_one_rests() {
        let mut numbers = TrackNumbers::default();
        assert_eq!(numbers.of(1 << 40).unwrap(), 1);
        assert_eq!(numbers.of(5).unwrap(), 2);
        assert_eq!(numbers.of(1 << 40).unwrap(), 1);
        assert!(numbers.knows(5) && !numbers.knows(6));
        numbers.release(1 << 40);
        assert_eq!(numbers.of(6).unwrap(), 3);
        // The same id again would be another life: it gets another number.
        assert_eq!(numbers.of(1 << 40).unwrap(), 4);
        assert_eq!(numbers.retain(|id| id == 6), [(5, 2), (1 << 40, 4)]);
        assert_eq!(numbers.of(7).unwrap(), 5);
    }

    /// A million tracks, at most a hundred alive at a time, one of them from beginning to end.
    #[test]
    fn no_number_is_held_twice_at_once_over_a_million_tracks() {
        let mut numbers = TrackNumbers::default();
        let lasting = numbers.of(u64::MAX).unwrap();
        let mut released_at = vec![None; 65_536];
        for id in 0..1_000_000_u64 {
            let number = numbers.of(id).unwrap();
            assert_ne!(number, lasting);
            assert_ne!(number, 0);
            let rested = released_at[usize::from(number)].map_or(u64::MAX, |then| id - then);
            assert!(rested > 65_000, "{number} rested for {rested} tracks");
            if let Some(old) = id.checked_sub(100) {
                released_at[usize::from(numbers.of(old).unwrap())] = Some(id);
                numbers.release(old);
            }
            assert!(numbers.in_use.len() <= 102);
        }
    }

    #[test]
    fn more_tracks_than_numbers_are_refused_until_one_ends() {
        let mut numbers = TrackNumbers::default();
        for id in 0..65_535 {
            assert!(numbers.of(id).is_ok());
        }
        let error = numbers.of(65_535).unwrap_err();
        assert!(matches!(error, ExportError::TrackNumbers { in_use: 65_535 }), "{error}");
        numbers.release(300);
        assert_eq!(numbers.of(65_535).unwrap(), 301);
    }
}
