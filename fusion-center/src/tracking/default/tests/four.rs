//! Four targets of which two are parallel and two cross.

use super::super::DefaultConfig;
use super::scenes::four_targets;
use super::score::{Score, run, score};

fn runs(variance_m2: f64, turn_rad: f64, seeds: std::ops::Range<u64>) -> Score {
    let config = DefaultConfig::wide_area();
    let mut sum = Score::default();
    for seed in seeds {
        let scene = four_targets(variance_m2, turn_rad, seed);
        sum.add(&score(&scene, &run(&scene, &config)));
    }
    sum
}

#[test]
#[ignore = "minutes: 500 paired trials of each case"]
fn study_four_targets() {
    for (variance, turn) in
        [(100.0, 0.0_f64), (400.0, 0.0), (900.0, 0.0), (3300.0, 0.0), (400.0, 90.0), (900.0, 90.0)]
    {
        let sum = runs(variance, turn.to_radians(), 1000..1500);
        println!(
            "variance {variance} turned {turn}: links {:.2} identity {:.2} rmse {:.2} filtered {:.2} nees {:.2} {:.2} tracks {}",
            100.0 * sum.link_rate(),
            100.0 * sum.identity_rate(),
            sum.rmse_m(),
            sum.filtered_rmse_m(),
            sum.nees(),
            sum.smoothed_nees(),
            sum.tracks,
        );
    }
}
