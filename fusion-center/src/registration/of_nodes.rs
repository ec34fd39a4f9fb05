//! The problem of two nodes from what each of them saw.

use proto::geom::{Gaussian, Node};

use super::{Period, Problem};

/// What one node saw in one period, as it goes into the problem of a pair.
#[derive(Clone, Copy, Debug)]
pub struct Seen<Points> {
    /// When, seconds from any origin that both nodes' periods share.
    pub time_s: f64,
    /// See [`Problem::node_half_depth_sigma_m`].
    pub half_depth_sigma_m: f64,
    /// The points in the node's own frame.
    pub points: Points,
}

impl Problem {
    /// The problem of the second node in the frame of the first, from the periods in which both
    /// were heard, oldest first. The half depth of each side is as unsure as its least sure period.
    #[must_use]
    pub fn of_nodes<First, Second>(
        common: impl Iterator<Item = (Seen<First>, Seen<Second>)>,
    ) -> Self
    where
        First: Iterator<Item = Gaussian<Node>>,
        Second: Iterator<Item = Gaussian<Node>>,
    {
        let mut problem = Self::default();
        for (first, second) in common {
            let (of_ref, of_node) =
                (&mut problem.ref_half_depth_sigma_m, &mut problem.node_half_depth_sigma_m);
            *of_ref = of_ref.max(first.half_depth_sigma_m);
            *of_node = of_node.max(second.half_depth_sigma_m);
            problem.periods.push(Period {
                ref_time_s: first.time_s,
                node_time_s: second.time_s,
                // The first node's own frame is `Ref`: only the name of the frame changes.
                in_ref: first.points.map(|point| point.renamed()).collect(),
                in_node: second.points.collect(),
            });
        }
        problem
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::Matrix2;
    use proto::geom::Point;

    use super::*;

    #[test]
    fn each_side_keeps_its_points_times_and_widest_half_depth() {
        let point = |x_m: f64| Gaussian::<Node> {
            mean: Point::new(x_m, 1.0),
            cov_m2: Matrix2::new(0.01, 0.002, 0.002, 0.03),
        };
        let seen = |time_s: f64, half_depth_sigma_m: f64, xs_m: Vec<f64>| Seen {
            time_s,
            half_depth_sigma_m,
            points: xs_m.into_iter().map(point),
        };
        let common = [
            (seen(1.0, 0.1, vec![5.0]), seen(1.1, 0.0, vec![6.0, 7.0])),
            (seen(2.0, 0.0, vec![]), seen(2.1, 0.2, vec![8.0])),
        ];
        let problem = Problem::of_nodes(common.into_iter());
        let expected = Problem {
            periods: vec![
                Period {
                    ref_time_s: 1.0,
                    node_time_s: 1.1,
                    in_ref: vec![Gaussian {
                        mean: Point::new(5.0, 1.0),
                        cov_m2: point(0.0).cov_m2,
                    }],
                    in_node: vec![point(6.0), point(7.0)],
                },
                Period {
                    ref_time_s: 2.0,
                    node_time_s: 2.1,
                    in_ref: Vec::new(),
                    in_node: vec![point(8.0)],
                },
            ],
            ref_half_depth_sigma_m: 0.1,
            node_half_depth_sigma_m: 0.2,
        };
        assert_eq!(problem, expected);
    }
}
