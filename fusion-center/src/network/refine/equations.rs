//! Normal equations of all poses and offsets with the targets' places eliminated.
//!
//! A target's points `y_i = Φ_i (z_i + b_i u_i) + t_i` with information `A_i = p_i (Φ_i R_i Φ_iᵀ)⁻¹`
//! meet at `ȳ = Λ⁻¹ Σ A_i y_i`, `Λ = Σ A_i`. With `J_i = ∂y_i/∂(x, y, heading, b)_i` the
//! information is `Σ_i J_iᵀ A_i J_i − Σ_ij J_iᵀ A_i Λ⁻¹ A_j J_j` and the score
//! `−Σ_i J_iᵀ A_i (y_i − ȳ)`; the prior of an offset adds `1/σ²` and `−b/σ²`.

use nalgebra::{
    Cholesky, Matrix2, Matrix2x4, Matrix3, Matrix4, Matrix4x2, Vector2, Vector3, Vector4,
};

use super::super::dense::{Normal, Symmetric};
use super::association::{Association, Target};
use super::site::{Layout, Site, State};
use crate::statistics::{BLOCK_COUNT, BlockRatio, MIN_PERIODS_FOR_BLOCKS, SIGNIFICANT_SIGMAS};

/// Standard deviations by which the ratio of one node must exceed 1 to count.
const SIGNIFICANT_SIGMAS_OF_ONE: f64 = 5.0;

/// The normal equations at a state.
pub(super) struct Equations {
    normal: Normal,
    score: Vec<f64>,
    /// By node: scores of blocks of periods by the pose.
    block_scores: Vec<[Vector3<f64>; BLOCK_COUNT]>,
    /// By node: information about the pose with all else known.
    own_information: Vec<Matrix3<f64>>,
    pub(super) chi_square: f64,
    pub(super) degrees_of_freedom: f64,
}

/// A Gauss-Newton step.
pub(super) struct Step {
    pub(super) values: Vec<f64>,
    /// Its square in units of the covariance, per unknown.
    pub(super) mean_square: f64,
}

/// One point's part: node, place, `A`, `J`.
struct Term {
    node: usize,
    place: Vector2<f64>,
    weight: f64,
    information: Matrix2<f64>,
    jacobian: Matrix2x4<f64>,
}

impl Equations {
    pub(super) fn new(
        (site, layout): (&Site, &Layout),
        state: &State,
        association: &Association,
    ) -> Self {
        let count = site.node_count();
        let mut equations = Self {
            normal: Normal::new(layout.size),
            score: vec![0.0; layout.size],
            block_scores: vec![[Vector3::zeros(); BLOCK_COUNT]; count],
            own_information: vec![Matrix3::zeros(); count],
            chi_square: 0.0,
            degrees_of_freedom: -3.0 * (count as f64 - 1.0),
        };
        for target in &association.targets {
            let block = target.period * BLOCK_COUNT / site.periods.len();
            equations.add(layout, &terms(site, state, target), block);
        }
        for (node, sigma_m) in site.depth_sigmas_m.iter().enumerate() {
            if let (Some(index), Some(sigma_m)) = (layout.depth_index(node), sigma_m) {
                let precision = sigma_m.powi(-2);
                equations.normal.add(index, index, precision);
                equations.score[index] -= precision * state.depths_m[node];
            }
        }
        equations
    }

    fn add(&mut self, layout: &Layout, terms: &[Term], block: usize) {
        let total: Matrix2<f64> = terms.iter().map(|term| term.information).sum();
        let Some(cov) = total.try_inverse() else { return };
        let middle = cov * terms.iter().map(|t| t.information * t.place).sum::<Vector2<f64>>();
        let weight: f64 = terms.iter().map(|term| term.weight).sum();
        self.degrees_of_freedom += 2.0 * (weight - 1.0).max(0.0);
        for (index, term) in terms.iter().enumerate() {
            let residual = term.place - middle;
            let pulled = term.information * residual;
            self.chi_square += residual.dot(&pulled);
            let score = -(term.jacobian.transpose() * pulled);
            self.add_score(layout, term.node, &score);
            self.block_scores[term.node][block] += score.xyz();
            let left: Matrix4x2<f64> = term.jacobian.transpose() * term.information;
            for other in &terms[..index] {
                let right = cov * other.information * other.jacobian;
                self.add_block(layout, (term.node, other.node), &-(left * right));
            }
            let own = left * (term.jacobian - cov * term.information * term.jacobian);
            self.own_information[term.node] += own.fixed_view::<3, 3>(0, 0);
            self.add_block(layout, (term.node, term.node), &own);
        }
    }

    fn add_score(&mut self, layout: &Layout, node: usize, score: &Vector4<f64>) {
        for local in 0..4 {
            if let Some(index) = layout.index(node, local) {
                self.score[index] += score[local];
            }
        }
    }

    fn add_block(&mut self, layout: &Layout, (a, b): (usize, usize), block: &Matrix4<f64>) {
        let entries = (0..4).flat_map(|i| (0..if a == b { i + 1 } else { 4 }).map(move |j| (i, j)));
        for (i, j) in entries {
            if let (Some(row), Some(column)) = (layout.index(a, i), layout.index(b, j)) {
                self.normal.add(row, column, block[(i, j)]);
            }
        }
    }

    /// `None` where the information is singular.
    pub(super) fn step(self) -> Option<Step> {
        let mut values = self.score.clone();
        self.normal.factor()?.solve(&mut values);
        let square: f64 = values.iter().zip(&self.score).map(|(step, score)| step * score).sum();
        let mean_square = square / self.score.len().max(1) as f64;
        mean_square.is_finite().then_some(Step { values, mean_square })
    }

    /// The covariance of all unknowns; `None` where the information is singular.
    pub(super) fn inverse(self) -> Option<Symmetric> {
        Some(self.normal.factor()?.inverse())
    }
}

fn terms(site: &Site, state: &State, target: &Target) -> Vec<Term> {
    let term = |(index, weight): &(usize, f64)| {
        let point = &site.points[*index];
        let pose = &state.poses[point.node];
        let turn = pose.rotation();
        let turned = turn * state.middle(point.node, point);
        let outward = turn * point.outward;
        let cov: Matrix2<f64> = turn * point.cov * turn.transpose();
        Some(Term {
            node: point.node,
            place: turned + pose.translation_m(),
            weight: *weight,
            information: cov.try_inverse()? * *weight,
            jacobian: Matrix2x4::new(
                1.0, 0.0, -turned.y, outward.x, //
                0.0, 1.0, turned.x, outward.y,
            ),
        })
    };
    target.members.iter().filter_map(term).collect()
}

/// By node: mean eigenvalue of `H⁻¹ Σ_b g_b g_bᵀ`, `g_b` the score of block `b` of periods and `H`
/// the node's own information: 1 for independent errors, and 1 where it is not significantly above.
pub(super) fn node_ratios(site: &Site, equations: &Equations) -> Vec<f64> {
    let count = site.node_count();
    if site.periods.len() < MIN_PERIODS_FOR_BLOCKS {
        return vec![1.0; count];
    }
    let ratio = |node: usize| {
        let factor = Cholesky::new(equations.own_information[node])?;
        let sum: f64 = equations.block_scores[node].iter().map(|g| g.dot(&factor.solve(g))).sum();
        Some(BlockRatio::new(sum))
    };
    let ratios: Vec<BlockRatio> =
        (0..count).map(|node| ratio(node).unwrap_or(BlockRatio::ONE)).collect();
    let mean = ratios.iter().map(|one| one.value).sum::<f64>() / count as f64;
    // The mean of as many ratios varies less.
    let sigmas = SIGNIFICANT_SIGMAS / (count as f64).sqrt();
    let common = BlockRatio { value: mean }.if_significant(sigmas);
    let of_one = |own: BlockRatio| own.if_significant(SIGNIFICANT_SIGMAS_OF_ONE);
    ratios.into_iter().map(|own| common.max(of_one(own))).collect()
}
