//! From pairs that disagree to the node that moved.
//!
//! A node's score is the number of its pairs in alarm less that of its pairs known to be quiet. The
//! node with the highest score is meant once it has led alone for some periods, because a pair with
//! few common points shows a move later than others. Where the lead stays shared, the reference is
//! meant last.

use std::collections::BTreeMap;

use proto::ids::NodeId;

use super::Verdict;
use crate::pipeline::pairs::Pair;

/// Periods for which a node must lead alone.
const LEAD_PERIODS: i64 = 3;
/// Periods after which a shared lead is decided too.
const PATIENCE_PERIODS: i64 = 8;

/// Who leads, and since when.
#[derive(Debug, Default)]
pub(super) struct Blame {
    alarmed_since: Option<i64>,
    leader: Option<(NodeId, i64)>,
}

impl Blame {
    /// Who moved, if that can be told by now.
    pub(super) fn decide<'a>(
        &mut self,
        verdicts: impl Iterator<Item = (&'a Pair, &'a Verdict)>,
        reference: &NodeId,
        period: i64,
    ) -> Option<NodeId> {
        let (mut scores, mut pair_count) = (BTreeMap::<&NodeId, (i64, i64)>::new(), 0);
        for (pair, verdict) in verdicts {
            pair_count += 1;
            for node in [&pair.first, &pair.second] {
                let (alarms, quiet) = scores.entry(node).or_default();
                *alarms += i64::from(matches!(verdict, Verdict::Alarm(_) | Verdict::Lost(_)));
                *quiet += i64::from(matches!(verdict, Verdict::Quiet));
            }
        }
        scores.retain(|_, (alarms, _)| 0 < *alarms);
        let Some(best) = scores.values().map(|(alarms, quiet)| alarms - quiet).max() else {
            *self = Self::default();
            return None;
        };
        let since = *self.alarmed_since.get_or_insert(period);
        let leads = |(_, (alarms, quiet)): &(&&NodeId, &(i64, i64))| alarms - quiet == best;
        let mut leaders: Vec<&NodeId> =
            scores.iter().filter(leads).map(|(node, _)| *node).collect();
        leaders.sort_by_key(|node| *node == reference);
        let first = (*leaders.first()?).clone();
        if 1 < pair_count && 1 < leaders.len() {
            self.leader = None;
            return (PATIENCE_PERIODS <= period - since).then(|| self.named(first));
        }
        let led_since = match &self.leader {
            Some((leader, led_since)) if *leader == first => *led_since,
            _ => period,
        };
        self.leader = Some((first.clone(), led_since));
        (LEAD_PERIODS <= period - led_since).then(|| self.named(first))
    }

    fn named(&mut self, node: NodeId) -> NodeId {
        *self = Self::default();
        node
    }
}
