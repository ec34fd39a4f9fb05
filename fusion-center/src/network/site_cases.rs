//! Drawn sites that the tests of this module share.

use nalgebra::Vector2;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use crate::simulate::{Conditions, Paths};
use crate::simulate_site::{SiteConditions, SiteSampler, SiteTrial};

/// People scattered anew in each period over a rectangle from the origin, about one per `area_m2`.
pub(super) fn scattered(
    seed: u64,
    (width_m, depth_m): (f64, f64),
    count: usize,
    periods: usize,
) -> Paths {
    let mut rng = ChaCha8Rng::seed_from_u64(seed);
    rng.set_stream(7);
    let mut place = || Vector2::new(rng.random_range(0.0..width_m), rng.random_range(0.0..depth_m));
    (0..periods).map(|_| (0..count).map(|_| place()).collect()).collect()
}

/// Nodes on a grid of ten columns with a spacing of 4 m, reach 5 m.
pub(super) fn grid(seed: u64, count: usize, periods: usize) -> SiteTrial {
    let positions: Vec<[f64; 2]> =
        (0..count).map(|i| [4.0 * (i % 10) as f64, 4.0 * (i / 10) as f64]).collect();
    let depth = 4 * (count.div_ceil(10) - 1).max(1);
    let conditions = SiteConditions {
        measuring: Conditions { noise_scale: 1.0, ..Conditions::WITH_FALSE_POINTS },
        reach_m: 5.0,
        half_depth_sigma_m: 0.0,
    };
    let (width_m, depth_m) = (36.0, depth as f64);
    let people = 36 * depth / 20;
    let paths = scattered(seed, (width_m, depth_m), people, periods);
    SiteSampler::new(seed, &positions, conditions).observe(&paths).unwrap()
}

/// Up to eight nodes around a room of 10 by 10 m that all see its people.
pub(super) fn room(seed: u64, count: usize, conditions: SiteConditions) -> SiteTrial {
    let all = [
        [5.0, 0.0],
        [0.0, 5.0],
        [10.0, 5.0],
        [5.0, 10.0],
        [0.0, 0.0],
        [10.0, 10.0],
        [10.0, 0.0],
        [0.0, 10.0],
    ];
    let paths = scattered(seed, (10.0, 10.0), 3, 20);
    SiteSampler::new(seed, &all[..count], conditions).observe(&paths).unwrap()
}
