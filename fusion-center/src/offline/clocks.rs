//! What recorded points tell about the clocks of two nodes: what their times say, and what fits.

use proto::ids::NodeId;
use serde::Serialize;

use super::lag::{Lag, lag_of};
use crate::network::{Edge, SiteProblem};
use crate::registration::{Outcome, Problem};

/// Part of the time between periods by which the times of two nodes lie apart and that is worth a
/// word: half a centimetre of a walk at ten periods a second.
const NOTABLE_SHARE: f64 = 0.05;

/// A node's clock beside that of another node.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClockJson {
    /// The other node.
    pub against: NodeId,
    /// How much later the node measured than the other in the same period by their times, median,
    /// seconds. The times are taken as right.
    pub stated_offset_s: f64,
    /// How much later than its times say the node seems to have measured, seconds: so its points
    /// fit best. `None` where that does not differ from 0.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lag_s: Option<f64>,
    /// Standard deviation of `lag_s`, seconds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lag_sigma_s: Option<f64>,
}

impl ClockJson {
    /// What a solved pair of `against` and a node tells; `None` if nothing is worth a word.
    pub(super) fn of(problem: &SiteProblem, against: &NodeId, edge: &Edge) -> Option<Self> {
        let pair = problem.pair(&edge.first, &edge.second);
        let sign = if edge.first == *against { 1.0 } else { -1.0 };
        let determined = matches!(edge.solution.outcome, Outcome::Determined);
        let estimate = edge.solution.estimate.filter(|_| determined);
        let lag = estimate.and_then(|one| lag_of(&pair, &one.pose_ref_from_node));
        let lag = lag.filter(Lag::is_significant);
        let stated_s = stated_offset_s(&pair);
        if stated_s.is_none() && lag.is_none() {
            return None;
        }
        Some(Self {
            against: against.clone(),
            stated_offset_s: sign * stated_s.unwrap_or(0.0),
            lag_s: lag.map(|lag| sign * lag.lag_s),
            lag_sigma_s: lag.map(|lag| lag.sigma_s),
        })
    }

    /// The same for people.
    pub(super) fn warnings(&self, node: &NodeId) -> Vec<String> {
        let Self { against, stated_offset_s, lag_s, lag_sigma_s } = self;
        let stated = (stated_offset_s.abs() > 0.0).then(|| {
            format!(
                "{node}: its times lie {stated_offset_s:+.3} s from those of {against} in the same \
                 periods: taken as right"
            )
        });
        let lag = lag_s.zip(*lag_sigma_s).map(|(lag_s, sigma_s)| {
            format!(
                "{node}: its points fit those of {against} best if they were measured \
                 {lag_s:+.3} s (σ {sigma_s:.3} s) from what its times say: compare the clocks; the \
                 pose is off by what people walk in that time"
            )
        });
        stated.into_iter().chain(lag).collect()
    }
}

/// Median of the node's times less the reference side's, seconds, if that is the same in most periods
/// and not small against the time between them.
fn stated_offset_s(pair: &Problem) -> Option<f64> {
    let mut apart: Vec<f64> =
        pair.periods.iter().map(|period| period.node_time_s - period.ref_time_s).collect();
    let offset_s = median(&mut apart)?;
    let mut steps: Vec<f64> =
        pair.periods.windows(2).map(|two| two[1].ref_time_s - two[0].ref_time_s).collect();
    let step_s = median(&mut steps)?;
    let mut rest: Vec<f64> = apart.iter().map(|one| (one - offset_s).abs()).collect();
    let spread_s = median(&mut rest)?;
    (NOTABLE_SHARE * step_s < offset_s.abs() && 2.0 * spread_s < offset_s.abs()).then_some(offset_s)
}

fn median(values: &mut [f64]) -> Option<f64> {
    values.sort_by(f64::total_cmp);
    values.get(values.len() / 2).copied()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::network::solve_site;
    use crate::network::{NodeView, SeenSet};
    use crate::registration::Pairwise;
    use crate::simulate::large_room;
    use proto::geom::{Gaussian, Node, Point};

    /// Targets scattered anew in each period: no lag can show.
    fn site(offset_of: impl Fn(usize) -> f64) -> SiteProblem {
        let case = large_room(1, 12);
        let (mut first, mut second) = (NodeView::default(), NodeView::default());
        for (index, period) in case.problem.periods.iter().enumerate() {
            let (key, time_s) = (index as i64, index as f64 * 0.1);
            let points = period.in_ref.iter().map(|point| Gaussian::<Node> {
                mean: Point::from_coords(point.mean.coords_m),
                cov_m2: point.cov_m2,
            });
            first.sets.insert(key, SeenSet { time_s, points: points.collect() });
            let time_s = time_s + offset_of(index);
            second.sets.insert(key, SeenSet { time_s, points: period.in_node.clone() });
        }
        let name = |text: &str| text.parse::<NodeId>().unwrap();
        let views = [(name("n1"), first), (name("n2"), second)].into();
        SiteProblem { reference: name("n1"), views }
    }

    fn clock(problem: &SiteProblem, against: &str) -> Option<ClockJson> {
        let solution = solve_site(problem, &Pairwise::default());
        ClockJson::of(problem, &against.parse().unwrap(), &solution.edges[0])
    }

    #[test]
    fn times_that_lie_apart_are_told_from_either_side() {
        let late = site(|_| 0.04);
        let seen = clock(&late, "n1").unwrap();
        assert!((seen.stated_offset_s - 0.04).abs() < 1e-9 && seen.lag_s.is_none(), "{seen:?}");
        let said = seen.warnings(&"n2".parse().unwrap());
        assert!(said[0].starts_with("n2: its times lie +0.040 s from those of n1"), "{said:?}");
        let back = clock(&late, "n2").unwrap();
        assert!((back.stated_offset_s + 0.04).abs() < 1e-9, "{back:?}");
    }

    #[test]
    fn times_that_agree_or_jitter_are_not_spoken_of() {
        assert_eq!(clock(&site(|_| 0.0), "n1"), None);
        assert_eq!(clock(&site(|_| 0.003), "n1"), None, "less than a twentieth");
        let jitter = |index: usize| if index.is_multiple_of(2) { 0.02 } else { -0.015 };
        assert_eq!(clock(&site(jitter), "n1"), None);
    }
}
