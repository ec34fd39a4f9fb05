//! Everybody's points of one period, joined into targets in the common frame.
//!
//! Sightings of different nodes are joined, nearest first, while they lie within the gate of their
//! summed covariances; a target takes at most one point of each node. The joined position is the
//! information-weighted mean. A point's covariance in `Ref` holds its node's pose error too:
//! `Φ R Φᵀ + J P Jᵀ`, `J = [I, dΦ/dφ z]`.

use nalgebra::{Matrix2, Matrix3, Vector2};
use proto::geom::{Gaussian, Node, Point, Ref, Se2, point_by_pose};
use proto::ids::NodeId;
use proto::measured::packed;
use proto::wire::FusedTarget;

/// One node's point with what is needed to place it.
#[derive(Clone, Debug, PartialEq)]
pub struct Sighting {
    /// Who saw it.
    pub node: NodeId,
    /// Where, in `Ref`.
    pub position: Gaussian<Ref>,
    /// Power over noise, decibels of power.
    pub snr_db: f64,
}

/// A node's point in `Ref`, less sure by as much as the node's pose is unsure.
#[must_use]
pub fn place(
    pose_ref_from_node: Se2<Ref, Node>,
    pose_covariance: &Matrix3<f64>,
    point_in_node: Gaussian<Node>,
) -> Gaussian<Ref> {
    let placed = pose_ref_from_node * point_in_node;
    let arm = pose_ref_from_node.rotation() * point_in_node.mean.coords_m;
    // Turning the node by dφ moves the point by dφ across the arm that joins them.
    let jacobian = point_by_pose(&arm);
    let cov_m2 = placed.cov_m2 + jacobian * pose_covariance * jacobian.transpose();
    Gaussian { mean: placed.mean, cov_m2 }
}

/// Joins the sightings of one period. `gate` is the largest squared normalised distance of two
/// sightings of one target.
///
/// Cost: pairs of sightings, sorted.
#[must_use]
pub fn fuse(sightings: &[Sighting], gate: f64) -> Vec<FusedTarget> {
    let mut pairs: Vec<(f64, usize, usize)> = (0..sightings.len())
        .flat_map(|first| (0..first).map(move |second| (first, second)))
        .filter(|(first, second)| sightings[*first].node != sightings[*second].node)
        .filter_map(|(first, second)| {
            let distance = distance(&sightings[first].position, &sightings[second].position)?;
            (distance <= gate).then_some((distance, first, second))
        })
        .collect();
    pairs.sort_by(|left, right| left.0.total_cmp(&right.0));
    let mut groups = Groups::new(sightings);
    for (_, first, second) in pairs {
        groups.join(first, second);
    }
    groups.members.iter().filter_map(|members| joined(sightings, members)).collect()
}

/// Squared normalised distance; `None` where the covariances are singular.
pub(crate) fn distance(first: &Gaussian<Ref>, second: &Gaussian<Ref>) -> Option<f64> {
    let between: Vector2<f64> = first.mean.coords_m - second.mean.coords_m;
    let information = (first.cov_m2 + second.cov_m2).try_inverse()?;
    Some(between.dot(&(information * between)))
}

struct Groups<'a> {
    sightings: &'a [Sighting],
    group_of: Vec<usize>,
    members: Vec<Vec<usize>>,
}

impl<'a> Groups<'a> {
    fn new(sightings: &'a [Sighting]) -> Self {
        let group_of: Vec<usize> = (0..sightings.len()).collect();
        let members = group_of.iter().map(|index| vec![*index]).collect();
        Self { sightings, group_of, members }
    }

    fn join(&mut self, first: usize, second: usize) {
        let (into, from) = (self.group_of[first], self.group_of[second]);
        let node = |index: &usize| &self.sightings[*index].node;
        let shares_node = self.members[from]
            .iter()
            .any(|one| self.members[into].iter().any(|other| node(one) == node(other)));
        if into == from || shares_node {
            return;
        }
        for index in std::mem::take(&mut self.members[from]) {
            self.group_of[index] = into;
            self.members[into].push(index);
        }
    }
}

fn joined(sightings: &[Sighting], members: &[usize]) -> Option<FusedTarget> {
    let mut information = Matrix2::zeros();
    let mut weighted = Vector2::zeros();
    for index in members {
        let position = &sightings[*index].position;
        let inverse = position.cov_m2.try_inverse()?;
        information += inverse;
        weighted += inverse * position.mean.coords_m;
    }
    let cov_m2 = information.try_inverse()?;
    let mean = Point::<Ref>::from_coords(cov_m2 * weighted);
    let mut nodes: Vec<NodeId> =
        members.iter().map(|index| sightings[*index].node.clone()).collect();
    nodes.sort();
    let snr_db = members.iter().map(|index| sightings[*index].snr_db).reduce(f64::max)?;
    Some(FusedTarget { x_m: mean.x_m(), y_m: mean.y_m(), cov_m2: packed(&cov_m2), snr_db, nodes })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sighting(node: &str, x_m: f64, y_m: f64, cov_m2: Matrix2<f64>) -> Sighting {
        let position = Gaussian { mean: Point::new(x_m, y_m), cov_m2 };
        Sighting { node: node.parse().unwrap(), position, snr_db: 10.0 }
    }

    #[test]
    fn two_crossed_ellipses_meet_where_both_are_sure() {
        let sure_in_y = Matrix2::new(1.0, 0.0, 0.0, 0.01);
        let sure_in_x = Matrix2::new(0.01, 0.0, 0.0, 1.0);
        let seen = [sighting("a", 1.5, 2.0, sure_in_y), sighting("b", 1.0, 2.5, sure_in_x)];
        let fused = fuse(&seen, 9.21);
        assert_eq!(fused.len(), 1);
        // By hand: x = (1.5/1 + 1.0/0.01)/(1 + 100), y = (2.0/0.01 + 2.5/1)/(100 + 1).
        assert!((fused[0].x_m - 101.5 / 101.0).abs() < 1e-12);
        assert!((fused[0].y_m - 202.5 / 101.0).abs() < 1e-12);
        assert!((fused[0].cov_m2[0] - 1.0 / 101.0).abs() < 1e-12);
        assert_eq!(fused[0].nodes.len(), 2);
    }

    #[test]
    fn a_node_gives_each_target_one_point_at_most() {
        let cov = Matrix2::identity() * 0.04;
        let seen = [
            sighting("a", 0.0, 0.0, cov),
            sighting("a", 0.3, 0.0, cov),
            sighting("b", 0.1, 0.0, cov),
            sighting("c", 9.0, 0.0, cov),
        ];
        let mut sizes: Vec<usize> = fuse(&seen, 9.21).iter().map(|t| t.nodes.len()).collect();
        sizes.sort_unstable();
        assert_eq!(sizes, [1, 1, 2]);
        let pair = fuse(&seen, 9.21).into_iter().find(|target| target.nodes.len() == 2).unwrap();
        assert!((pair.x_m - 0.05).abs() < 1e-12, "b joins the nearer point of a");
    }

    /// The oracle: points moved by many drawn pose errors.
    #[test]
    fn the_pose_error_widens_the_point_as_drawn_poses_do() {
        use rand::SeedableRng;
        use rand_distr::{Distribution, StandardNormal};
        let mut random = rand::rngs::ChaCha8Rng::seed_from_u64(5);
        let sigma = [0.1, 0.2, 0.02];
        let point = Gaussian { mean: Point::new(1.0, 6.0), cov_m2: Matrix2::identity() * 1e-9 };
        let covariance = Matrix3::from_diagonal(&nalgebra::Vector3::from(sigma.map(|s| s * s)));
        let placed = place(Se2::new(3.0, 1.0, 2.0), &covariance, point);
        let mut sum = Matrix2::zeros();
        let draw_count = 20_000;
        for _ in 0..draw_count {
            let [x, y, turn] = sigma.map(|s| -> f64 {
                let normal: f64 = StandardNormal.sample(&mut random);
                s * normal
            });
            let drawn = Se2::<Ref, Node>::new(3.0 + x, 1.0 + y, 2.0 + turn) * point.mean;
            let error = drawn.coords_m - placed.mean.coords_m;
            sum += error * error.transpose();
        }
        // Relative error of a variance from 20 000 draws: sqrt(2/20000) = 1 %; five of these.
        let relative = (sum / f64::from(draw_count) - placed.cov_m2).norm() / placed.cov_m2.norm();
        assert!(relative < 0.05, "{relative}");
    }
}
