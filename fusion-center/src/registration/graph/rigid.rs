//! The rigid motion that lays pairs of points together with least squares, and its covariance.
//!
//! `θ̂ = argmin Σ |z_l − (Φ z_j + t)|²`: about both means, `tan φ = Σ z_j × z_l / Σ z_j · z_l`
//! \[umeyama\], no pair weighted. Its covariance is `A⁻¹ B A⁻¹`, `A = Σ Jᵀ J`, `B = Σ Jᵀ S J`,
//! times the residuals' `χ² / (2 n − 3)` where that is significantly above 1: forced pairs of
//! different targets are no noise that the covariances know of.

use nalgebra::{Matrix2, Matrix3, Vector2};

use super::super::judged::{jacobian, sandwich};
use super::super::prepared::{Blob, Motion, Prepared};
use crate::statistics::{Ratio, SIGNIFICANT_SIGMAS};

/// Points must spread at least this far, root sum of squares in metres, to fix a heading.
const MIN_SPREAD_M: f64 = 1e-3;

/// The motion; `None` where the pairs fix no heading.
pub(super) fn fit(data: &Prepared, pairs: &[(usize, usize)]) -> Option<Motion> {
    let position = |blob: &Blob| Vector2::new(blob.x, blob.y);
    let refs = || pairs.iter().map(|(l, _)| position(&data.refs[*l]));
    let nodes = || pairs.iter().map(|(_, j)| position(&data.nodes[*j]));
    if pairs.len() < 2 {
        return None;
    }
    let count = pairs.len() as f64;
    let (ref_mean, node_mean) =
        (refs().sum::<Vector2<f64>>() / count, nodes().sum::<Vector2<f64>>() / count);
    let (mut dot, mut cross) = (0.0, 0.0);
    for (l, j) in refs().zip(nodes()) {
        let (to, from) = (l - ref_mean, j - node_mean);
        dot += from.dot(&to);
        cross += from.perp(&to);
    }
    let turn = Motion::new(0.0, 0.0, cross.atan2(dot));
    let (x, y) = turn.turned(node_mean.x, node_mean.y);
    let motion = Motion { x: ref_mean.x - x, y: ref_mean.y - y, ..turn };
    (dot.hypot(cross) > MIN_SPREAD_M.powi(2)).then_some(motion)
}

/// The covariance of [`fit`]'s `(x_m, y_m, heading_rad)` from those of the points.
pub(super) fn covariance(
    data: &Prepared,
    pairs: &[(usize, usize)],
    motion: &Motion,
) -> Option<Matrix3<f64>> {
    let (mut bread, mut filling) = (Matrix3::zeros(), Matrix3::zeros());
    let mut chi_square = 0.0;
    for (l, j) in pairs {
        let (point, mapped) = (&data.refs[*l], motion.apply(&data.nodes[*j]));
        let (xy, yy) = (point.xy + mapped.xy, point.yy + mapped.yy);
        let cov_m2 = Matrix2::new(point.xx + mapped.xx, xy, xy, yy);
        let by_pose = jacobian(motion, &data.nodes[*j]);
        bread += by_pose.transpose() * by_pose;
        filling += by_pose.transpose() * cov_m2 * by_pose;
        let offset = Vector2::new(point.x - mapped.x, point.y - mapped.y);
        chi_square += offset.dot(&(cov_m2.try_inverse()? * offset));
    }
    let free = 2.0 * pairs.len() as f64 - 3.0;
    let doubt = Ratio::of_chi_square(chi_square, free).if_significant(SIGNIFICANT_SIGMAS);
    Some(sandwich(&bread, &filling)? * doubt)
}
