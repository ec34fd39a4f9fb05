//! Random problems and slow, plain answers to them.

use rand::RngExt;
use rand::rngs::ChaCha8Rng;

use super::*;

#[derive(Clone, Copy)]
pub(super) struct Shape {
    pub(super) row_count: usize,
    pub(super) column_count: usize,
    /// Of the pairs, that are edges.
    pub(super) share: f64,
}

pub(super) fn random_edges(rng: &mut ChaCha8Rng, shape: Shape, edges: &mut Edges) {
    edges.begin(shape.column_count).unwrap();
    for _ in 0..shape.row_count {
        for column in 0..shape.column_count {
            if rng.random::<f64>() < shape.share {
                edges.push(column, rng.random_range(-8.0..2.0)).unwrap();
            }
        }
        edges.end_row().unwrap();
    }
}
