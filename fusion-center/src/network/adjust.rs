//! Poses from edges: Gauss-Newton over the kept edges, marginal covariances, and each edge judged
//! by all others.
//!
//! Minimises `Σ_e f_e r_eᵀ C_e⁻¹ r_e`, `r_e = z_e − (X_i⁻¹ X_j)` with additive differences in
//! `(x_m, y_m, heading_rad)`, over all poses but that of node 0. `f_e = 2 / (m_e + 2)`, `m_e` the
//! nodes that close a triangle with the edge: in a clique of `n` nodes that see the same targets,
//! each node's measurements are in `n − 1` edges, which then hold `n (n − 1) / 2` times what one
//! edge knows of a difference, where the nodes themselves hold `n − 1` times. With `f_e = 2 / n`
//! the covariance is that of the joint solution; where the edges of a triangle rest on different
//! targets it is too wide, by at most `√(1 + m/2)` in σ, and never too narrow.

use nalgebra::{Cholesky, Matrix3, SMatrix, Vector3};
use proto::geom::squared_length;

use super::dense::{Normal, Symmetric};
use super::relative::{Pose, Relative};

/// Most Gauss-Newton steps; from a tree that agrees with the edges, three do.
const MAX_STEP_COUNT: usize = 12;

/// A step whose largest component is below this, metres and radians, ends the search.
const CONVERGED: f64 = 1e-7;

/// Of an edge's covariance, the share that must remain when the others' knowledge is taken away:
/// below it the others know nothing of the edge.
const CHECKED_SHARE: f64 = 1e-4;

/// A kept edge.
#[derive(Clone, Copy, Debug)]
pub(super) struct Link {
    pub(super) from: usize,
    pub(super) to: usize,
    pub(super) step: Relative,
}

/// The poses of all nodes in node 0's frame.
#[derive(Clone, Debug)]
pub(super) struct Adjusted {
    pub(super) poses: Vec<Pose>,
    covariance: Symmetric,
}

/// `2 / (m + 2)` of every link.
pub(super) fn shares(node_count: usize, links: &[Link]) -> Vec<f64> {
    let word_count = node_count.div_ceil(64);
    let mut neighbours = vec![0_u64; node_count * word_count];
    for link in links {
        for (node, other) in [(link.from, link.to), (link.to, link.from)] {
            neighbours[node * word_count + other / 64] |= 1 << (other % 64);
        }
    }
    let row = |node: usize| &neighbours[node * word_count..(node + 1) * word_count];
    let common = |link: &Link| -> u32 {
        row(link.from).iter().zip(row(link.to)).map(|(a, b)| (a & b).count_ones()).sum()
    };
    links.iter().map(|link| 2.0 / (f64::from(common(link)) + 2.0)).collect()
}

/// The poses that fit the links best, from poses near them. `None` where the links leave a node
/// undetermined, or the steps do not come to rest.
pub(super) fn adjust(start: &[Pose], links: &[Link]) -> Option<Adjusted> {
    let shares = shares(start.len(), links);
    let information: Option<Vec<Matrix3<f64>>> = links
        .iter()
        .zip(&shares)
        .map(|(link, share)| Some(Cholesky::new(link.step.covariance)?.inverse() * *share))
        .collect();
    let information = information?;
    let mut poses = start.to_vec();
    let mut has_settled = false;
    for _ in 0..MAX_STEP_COUNT {
        let (normal, mut step) = equations(&poses, links, &information);
        normal.factor()?.solve(&mut step);
        for (pose, change) in poses[1..].iter_mut().zip(step.chunks_exact(3)) {
            *pose = pose.plus(&Vector3::from_column_slice(change));
        }
        let largest = step.iter().fold(0.0_f64, |most, value| most.max(value.abs()));
        if !largest.is_finite() {
            return None;
        }
        has_settled = largest < CONVERGED;
        if has_settled {
            break;
        }
    }
    if !has_settled {
        return None;
    }
    let (normal, _) = equations(&poses, links, &information);
    let covariance = normal.factor()?.inverse();
    Some(Adjusted { poses, covariance })
}

fn equations(poses: &[Pose], links: &[Link], information: &[Matrix3<f64>]) -> (Normal, Vec<f64>) {
    let size = 3 * (poses.len() - 1);
    let (mut normal, mut right) = (Normal::new(size), vec![0.0; size]);
    for (link, weight) in links.iter().zip(information) {
        let (seen, by_both) = poses[link.from].between(&poses[link.to]);
        let (by_from, by_to) = (by_both.by_first, by_both.by_second);
        let residual = link.step.pose.minus(&seen);
        let ends =
            [(link.from, by_from.transpose() * weight), (link.to, by_to.transpose() * weight)];
        for (node, pull) in &ends {
            add_to(&mut right, *node, &(pull * residual));
        }
        add_block(&mut normal, (link.from, link.from), &(ends[0].1 * by_from));
        add_block(&mut normal, (link.to, link.to), &(ends[1].1 * by_to));
        add_block(&mut normal, (link.to, link.from), &(ends[1].1 * by_from));
    }
    (normal, right)
}

fn add_to(right: &mut [f64], node: usize, pull: &Vector3<f64>) {
    if let Some(start) = (3 * node).checked_sub(3) {
        right[start..start + 3].iter_mut().zip(pull.iter()).for_each(|(sum, value)| *sum += value);
    }
}

fn add_block(normal: &mut Normal, (a, b): (usize, usize), block: &Matrix3<f64>) {
    let (Some(row), Some(column)) = ((3 * a).checked_sub(3), (3 * b).checked_sub(3)) else {
        return;
    };
    for i in 0..3 {
        let until = if a == b { i + 1 } else { 3 };
        for j in 0..until {
            normal.add(row + i, column + j, block[(i, j)]);
        }
    }
}

impl Adjusted {
    fn block(&self, a: usize, b: usize) -> Matrix3<f64> {
        if a == 0 || b == 0 {
            return Matrix3::zeros();
        }
        Matrix3::from_fn(|i, j| self.covariance.get(3 * (a - 1) + i, 3 * (b - 1) + j))
    }

    /// A node's pose with its marginal covariance.
    pub(super) fn placed(&self, node: usize) -> Relative {
        Relative { pose: self.poses[node], covariance: self.block(node, node) }
    }

    /// `to` as seen from `from` with the covariance that the adjustment leaves.
    fn relative(&self, from: usize, to: usize) -> Relative {
        let (pose, by_both) = self.poses[from].between(&self.poses[to]);
        let mut both = SMatrix::<f64, 6, 6>::zeros();
        for (row, a) in [from, to].into_iter().enumerate() {
            for (column, b) in [from, to].into_iter().enumerate() {
                both.fixed_view_mut::<3, 3>(3 * row, 3 * column).copy_from(&self.block(a, b));
            }
        }
        let mut jacobian = SMatrix::<f64, 3, 6>::zeros();
        jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&by_both.by_first);
        jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&by_both.by_second);
        Relative { pose, covariance: jacobian * both * jacobian.transpose() }
    }

    /// Squared distance of a link that was left out from what the others say.
    pub(super) fn outside_chi_square(&self, link: &Link) -> f64 {
        link.step.chi_square_to(&self.relative(link.from, link.to))
    }

    /// Squared distance of a link that was used with this share from what all others say; `None`
    /// where they say nothing. With `A` the covariance with the link, `C_s = C / f`,
    /// `D = C_s − A`: without it the covariance is `C_s D⁻¹ A` and the residual `C_s D⁻¹ r`.
    pub(super) fn inside_chi_square(&self, link: &Link, share: f64) -> Option<f64> {
        let with = self.relative(link.from, link.to);
        let used = link.step.covariance / share;
        let left = used - with.covariance;
        let is_checked = (0..3).all(|i| left[(i, i)] > CHECKED_SHARE * used[(i, i)]);
        let factor = Cholesky::new(left).filter(|_| is_checked)?;
        let residual = link.step.pose.minus(&with.pose);
        let others_residual = used * factor.solve(&residual);
        let others = used * factor.solve(&with.covariance);
        let sum = (others + others.transpose()) * 0.5 + link.step.covariance;
        squared_length(&others_residual, &sum)
    }
}
