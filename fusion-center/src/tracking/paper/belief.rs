//! The belief function method: which plot is a track's, from masses on "this one" and "not this one".
//!
//! For a track and one of its `n` candidate plots `y_j`, an attribute of degree `d` that is believed
//! by `α` gives the masses `m(match) = α e^(−d²/2)`, `m(no) = α (1 − e^(−d²/2))`, `m(Θ) = 1 − α`.
//! Dempster's rule combines attributes on the frame {match, no}: with `q_y = Π (m_y + m_Θ)`,
//! `q_n = Π (m_n + m_Θ)`, `q_Θ = Π m_Θ` the masses are `a = q_y − q_Θ`, `b = q_n − q_Θ`, `c = q_Θ`
//! over their sum. It then combines candidates on the row's frame `Ω = {y_1, ..., y_n, *}`, `*` for
//! none of them, where `match` means `{y_j}` and `no` means `Ω` without `y_j`: what remains without
//! conflict is
//!
//! ```text
//! m({y_j})       ∝ a_j Π_{i≠j} (b_i + c_i)
//! m(Ω \ S)       ∝ Π_{i∈S} b_i Π_{i∉S} c_i      for every set S of candidates
//! ```
//!
//! The pignistic probability shares each mass among its `1 + n − |S|` members. As
//! `1/(1 + u) = ∫₀¹ t^u dt`, sums over all sets are integrals of one polynomial:
//!
//! ```text
//! BetP(y_j) ∝ a_j Π_{i≠j} (b_i + c_i) + ∫₀¹ c_j t Π_{i≠j} (b_i + c_i t) dt
//! BetP(*)   ∝ ∫₀¹ Π_i (b_i + c_i t) dt
//! ```
//!
//! so that the closed form takes `O(n²)` instead of `2ⁿ` steps.

use super::config::PerAttribute;
use super::degree::Degrees;

/// Masses of a track and one plot: `[match, no, either]`, of sum 1.
pub(super) type Masses = [f64; 3];

/// Memory for [`pignistic`].
#[derive(Clone, Debug, Default)]
pub(super) struct Workspace {
    /// Coefficients of `Π (b_i + c_i t)`, constant term first.
    all: Vec<f64>,
    /// The same without one factor.
    others: Vec<f64>,
}

/// Combines what the attributes say of one pair.
pub(super) fn pair(degrees: &Degrees, trust: &PerAttribute) -> Masses {
    let mut sums = [1.0; 3];
    for (degree, alpha) in degrees.iter().zip(trust.array()) {
        let Some(degree) = degree else { continue };
        let likeness = (-0.5 * degree * degree).exp();
        let either = 1.0 - alpha;
        sums[0] *= alpha * likeness + either;
        sums[1] *= alpha * (1.0 - likeness) + either;
        sums[2] *= either;
    }
    let [matching, no, either] = sums;
    let masses = [matching - either, no - either, either];
    let total: f64 = masses.iter().sum();
    masses.map(|mass| mass / total)
}

/// Puts the pignistic probability of every candidate into `into`, in their order, and gives that of
/// none of them. They sum to 1.
pub(super) fn pignistic(row: &[Masses], space: &mut Workspace, into: &mut Vec<f64>) -> f64 {
    into.clear();
    space.all.clear();
    space.all.push(1.0);
    row.iter().for_each(|masses| multiply(&mut space.all, masses));
    let none = integral(&space.all, 0);
    for masses in row {
        without(&space.all, masses, &mut space.others);
        let [matching, _, either] = masses;
        // The product at t = 1.
        let alone: f64 = space.others.iter().sum();
        into.push(matching * alone + either * integral(&space.others, 1));
    }
    let total: f64 = none + into.iter().sum::<f64>();
    into.iter_mut().for_each(|value| *value /= total);
    none / total
}

/// Multiplies a polynomial by `(b + c t) / (b + c)`, so that it does not vanish with the number of
/// factors; all that is made of it is in proportion.
fn multiply(polynomial: &mut Vec<f64>, [_, constant, slope]: &Masses) {
    let (constant, slope) = (constant / (constant + slope), slope / (constant + slope));
    polynomial.push(0.0);
    for power in (0..polynomial.len()).rev() {
        let lower = if power == 0 { 0.0 } else { polynomial[power - 1] };
        polynomial[power] = polynomial[power] * constant + lower * slope;
    }
}

/// Divides a polynomial by its factor `b + c t`, from the end at which errors do not grow.
fn without(polynomial: &[f64], [_, constant, slope]: &Masses, into: &mut Vec<f64>) {
    let degree = polynomial.len() - 1;
    into.clear();
    into.resize(degree, 0.0);
    let mut carried = 0.0;
    if slope <= constant {
        for power in 0..degree {
            carried = (polynomial[power] - slope * carried) / constant;
            into[power] = carried;
        }
    } else {
        for power in (0..degree).rev() {
            carried = (polynomial[power + 1] - constant * carried) / slope;
            into[power] = carried;
        }
    }
}

/// `∫₀¹ t^shift p(t) dt`.
fn integral(polynomial: &[f64], shift: u32) -> f64 {
    let powers = (1 + shift..).map(f64::from);
    polynomial.iter().zip(powers).map(|(coefficient, power)| coefficient / power).sum()
}
