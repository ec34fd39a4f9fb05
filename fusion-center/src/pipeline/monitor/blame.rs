//! From the nodes' chi-squares to the node that moved.
//!
//! The move of one node shows in all of its pairs, and in one pair of each other node: so the
//! highest chi-square is that of the node that moved once it has led clearly for some periods.
//! Where the lead stays shared, the reference is meant last.

use proto::ids::NodeId;

/// Periods for which a node must lead clearly.
const LEAD_PERIODS: i64 = 2;
/// A lead of this much in twice the log likelihood is clear: odds of a hundred.
const CLEAR_LEAD: f64 = 9.2;
/// Periods after which a shared lead is decided too.
const PATIENCE_PERIODS: i64 = 8;

/// Who leads, and since when.
#[derive(Debug, Default)]
pub(super) struct Blame {
    alarmed_since: Option<i64>,
    leader: Option<(NodeId, i64)>,
}

impl Blame {
    /// Who moved, if that can be told by now, from every node's chi-square.
    pub(super) fn decide(
        &mut self,
        chi_squares: &[(&NodeId, f64)],
        (reference, limit): (&NodeId, f64),
        period: i64,
    ) -> Option<NodeId> {
        let best = chi_squares.iter().map(|(_, chi_square)| *chi_square).fold(0.0, f64::max);
        if best < limit {
            *self = Self::default();
            return None;
        }
        let since = *self.alarmed_since.get_or_insert(period);
        let is_near = |(_, chi_square): &&(&NodeId, f64)| best - CLEAR_LEAD < *chi_square;
        let mut near: Vec<&(&NodeId, f64)> = chi_squares.iter().filter(is_near).collect();
        near.sort_by(|one, other| {
            let rank = |(node, chi_square): &(&NodeId, f64)| (*node == reference, -chi_square);
            let ((one_last, one_rank), (other_last, other_rank)) = (rank(one), rank(other));
            one_last.cmp(&other_last).then(one_rank.total_cmp(&other_rank))
        });
        let first = near.first()?.0.clone();
        if 1 < near.len() && 2 < chi_squares.len() {
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

#[cfg(test)]
mod tests {
    use super::*;

    const LIMIT: f64 = 30.0;

    /// The periods until somebody is named, and who.
    fn named(chi_squares: &[(&str, f64)]) -> Option<(i64, String)> {
        let nodes: Vec<NodeId> =
            chi_squares.iter().map(|(node, _)| node.parse().unwrap()).collect();
        let values = chi_squares.iter().map(|(_, chi_square)| *chi_square);
        let all: Vec<(&NodeId, f64)> = nodes.iter().zip(values).collect();
        let (mut blame, reference) = (Blame::default(), "n1".parse().unwrap());
        let decided = |period| Some((period, blame.decide(&all, (&reference, LIMIT), period)?));
        (0..20).find_map(decided).map(|(period, node)| (period, node.to_string()))
    }

    #[test]
    fn who_leads_clearly_is_named_soon_and_who_does_not_later() {
        let of = |node: &str, period: i64| Some((period, node.to_owned()));
        assert_eq!(named(&[("n1", 12.0), ("n2", 60.0), ("n3", 15.0)]), of("n2", LEAD_PERIODS));
        assert_eq!(named(&[("n1", 60.0), ("n2", 20.0), ("n3", 15.0)]), of("n1", LEAD_PERIODS));
        assert_eq!(named(&[("n1", 60.0), ("n2", 58.0), ("n3", 9.0)]), of("n2", PATIENCE_PERIODS));
        assert_eq!(named(&[("n1", 60.0), ("n2", 60.0)]), of("n2", LEAD_PERIODS));
        assert_eq!(named(&[("n1", 10.0), ("n2", 29.0), ("n3", 9.0)]), None);
    }

    #[test]
    fn an_alarm_that_passes_is_forgotten() {
        let nodes: [NodeId; 2] = ["n1", "n2"].map(|name| name.parse().unwrap());
        let (mut blame, limit) = (Blame::default(), (&nodes[0], LIMIT));
        for period in 0..20 {
            let chi_square = if period % 3 == 2 { 5.0 } else { 50.0 };
            let all = [(&nodes[0], 3.0), (&nodes[1], chi_square)];
            assert_eq!(blame.decide(&all, limit, period), None, "period {period}");
        }
    }
}
