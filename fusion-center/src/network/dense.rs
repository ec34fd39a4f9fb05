//! Normal equations of a few hundred unknowns: envelope Cholesky, solution and full inverse.
//!
//! `N = L Lᵀ`; row `i` of `L` is zero before the first stored entry of row `i` of `N`, so that
//! unknowns in the order in which a graph is walked through cost little more than their
//! neighbours. Rows are contiguous. Cost: `Σ w_i²` for the factor with row widths `w_i`, `2 n³ / 3`
//! for the inverse.

/// A symmetric positive definite matrix under construction: lower triangle by rows.
#[derive(Clone, Debug)]
pub(super) struct Normal {
    size: usize,
    values: Vec<f64>,
    first: Vec<usize>,
}

/// `L`.
#[derive(Clone, Debug)]
pub(super) struct Factor {
    size: usize,
    values: Vec<f64>,
    first: Vec<usize>,
}

/// A full symmetric matrix.
#[derive(Clone, Debug)]
pub(super) struct Symmetric {
    size: usize,
    values: Vec<f64>,
}

impl Normal {
    pub(super) fn new(size: usize) -> Self {
        Self { size, values: vec![0.0; size * size], first: (0..size).collect() }
    }

    /// Adds to the entry and its mirror image. To be called once per unordered pair of indices.
    pub(super) fn add(&mut self, a: usize, b: usize, value: f64) {
        let (row, column) = if a < b { (b, a) } else { (a, b) };
        self.first[row] = self.first[row].min(column);
        self.values[row * self.size + column] += value;
    }

    /// `None` where the matrix is not positive definite to rounding.
    pub(super) fn factor(mut self) -> Option<Factor> {
        let size = self.size;
        for row in 0..size {
            let (done, rest) = self.values.split_at_mut(row * size);
            let current = &mut rest[..size];
            let start = self.first[row];
            for column in start..row {
                let from = start.max(self.first[column]);
                let other = &done[column * size..column * size + column + 1];
                let known = dot(&current[from..column], &other[from..column]);
                current[column] = (current[column] - known) / other[column];
            }
            let given = current[row];
            let left = given - dot(&current[start..row], &current[start..row]);
            // A pivot that cancelled to rounding means a direction without information.
            if left.is_nan() || left <= given * 1e-13 {
                return None;
            }
            current[row] = left.sqrt();
        }
        Some(Factor { size, values: self.values, first: self.first })
    }
}

impl Factor {
    fn row(&self, row: usize) -> &[f64] {
        &self.values[row * self.size..(row + 1) * self.size]
    }

    /// Replaces `right` by the solution.
    pub(super) fn solve(&self, right: &mut [f64]) {
        for row in 0..self.size {
            let (entries, start) = (self.row(row), self.first[row]);
            let known = dot(&entries[start..row], &right[start..row]);
            right[row] = (right[row] - known) / entries[row];
        }
        for row in (0..self.size).rev() {
            let (entries, start) = (self.row(row), self.first[row]);
            right[row] /= entries[row];
            let value = right[row];
            for (target, entry) in right[start..row].iter_mut().zip(&entries[start..row]) {
                *target -= entry * value;
            }
        }
    }

    /// `N⁻¹ = L⁻ᵀ L⁻¹`.
    pub(super) fn inverse(&self) -> Symmetric {
        let size = self.size;
        let mut lower = vec![0.0; size * size];
        for row in 0..size {
            let (done, rest) = lower.split_at_mut(row * size);
            let current = &mut rest[..=row];
            let entries = self.row(row);
            for column in self.first[row]..row {
                let above = &done[column * size..=column * size + column];
                add_scaled(&mut current[..=column], above, -entries[column]);
            }
            current[row] += 1.0;
            current.iter_mut().for_each(|value| *value /= entries[row]);
        }
        let mut values = vec![0.0; size * size];
        for row in 0..size {
            let source = &lower[row * size..=row * size + row];
            for (target_row, scale) in source.iter().enumerate() {
                let target = &mut values[target_row * size..=target_row * size + target_row];
                add_scaled(target, &source[..=target_row], *scale);
            }
        }
        Symmetric { size, values }
    }
}

impl Symmetric {
    /// The entry, by either order of the indices.
    pub(super) fn get(&self, a: usize, b: usize) -> f64 {
        let (row, column) = if a < b { (b, a) } else { (a, b) };
        self.values[row * self.size + column]
    }
}

/// Four sums at a time, so that the additions need not wait for one another.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut sums = [0.0; 4];
    let (a_blocks, b_blocks) = (a.chunks_exact(4), b.chunks_exact(4));
    let (a_rest, b_rest) = (a_blocks.remainder(), b_blocks.remainder());
    for (left, right) in a_blocks.zip(b_blocks) {
        for lane in 0..4 {
            sums[lane] += left[lane] * right[lane];
        }
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(left, right)| left * right).sum();
    sums.iter().sum::<f64>() + rest
}

fn add_scaled(target: &mut [f64], source: &[f64], scale: f64) {
    for (value, add) in target.iter_mut().zip(source) {
        *value += scale * add;
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{DMatrix, DVector};
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    use super::*;

    /// Rounding of some hundred operations on numbers of order one.
    const TOLERANCE: f64 = 1e-10;

    /// A chain with a few long links, as a graph gives, and the same as a full matrix.
    fn case(size: usize) -> (Normal, DMatrix<f64>) {
        let mut rng = ChaCha8Rng::seed_from_u64(3);
        let (mut normal, mut full) = (Normal::new(size), DMatrix::zeros(size, size));
        let entries = (0..size).flat_map(|row| (0..=row).map(move |column| (row, column)));
        let is_linked = |(row, column): &(usize, usize)| {
            row - column < 3 || (row * 7 + column).is_multiple_of(19)
        };
        for (row, column) in entries.filter(is_linked) {
            let drawn = rng.random_range(-1.0..1.0);
            let value = if row == column { 12.0 } else { drawn };
            normal.add(column, row, value);
            full[(row, column)] = value;
            full[(column, row)] = value;
        }
        (normal, full)
    }

    #[test]
    fn solution_and_inverse_are_those_of_the_full_matrix() {
        let (normal, full) = case(41);
        let factor = normal.factor().unwrap();
        let right = DVector::from_fn(41, |i, _| (i as f64).sin());
        let mut found: Vec<f64> = right.iter().copied().collect();
        factor.solve(&mut found);
        assert!((&full * DVector::from_vec(found) - right).norm() < TOLERANCE);
        let inverse = factor.inverse();
        let product = full * DMatrix::from_fn(41, 41, |a, b| inverse.get(a, b));
        assert!((product - DMatrix::identity(41, 41)).norm() < TOLERANCE);
    }

    #[test]
    fn a_matrix_without_information_in_one_direction_is_told() {
        let mut normal = Normal::new(2);
        for (a, b, value) in [(0, 0, 1.0), (0, 1, 2.0), (1, 1, 4.0)] {
            normal.add(a, b, value);
        }
        assert!(normal.factor().is_none());
    }
}
