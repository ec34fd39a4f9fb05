//! Messages that were refused: counted by key and reason, and named in the log.

use std::collections::BTreeMap;

use tracing::warn;

/// Keys for which refusals are counted apart; beyond them, all count as one.
const MAX_COUNTED_KEYS: usize = 256;

/// Messages refused so far.
#[derive(Clone, Debug, Default)]
pub struct Refusals {
    counts: BTreeMap<(String, &'static str), u64>,
}

impl Refusals {
    /// Counts a refusal, and names it in the log when its count reaches a power of two: a flood
    /// of garbage must not become a flood of log lines.
    pub fn count(&mut self, key: &str, label: &'static str, reason: &str) {
        let crowded = MAX_COUNTED_KEYS <= self.counts.len();
        let known = self.counts.contains_key(&(key.to_owned(), label));
        let place = if crowded && !known { "(other keys)" } else { key };
        let count = self.counts.entry((place.to_owned(), label)).or_default();
        *count += 1;
        if count.is_power_of_two() {
            warn!(%key, label, count, %reason, "message refused");
        }
    }

    /// How many messages were refused, by key and label.
    #[must_use]
    pub fn counts(&self) -> &BTreeMap<(String, &'static str), u64> {
        &self.counts
    }

    /// How many messages were refused for one reason.
    #[must_use]
    pub fn total(&self, label: &str) -> u64 {
        self.counts.iter().filter(|((_, l), _)| *l == label).map(|(_, count)| count).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_flood_of_keys_is_counted_in_bounded_memory() {
        let mut refusals = Refusals::default();
        for number in 0..2000 {
            refusals.count(&format!("key/{number}"), "key", "unknown");
        }
        assert_eq!(refusals.total("key"), 2000);
        assert!(refusals.counts().len() <= MAX_COUNTED_KEYS + 1);
    }
}
