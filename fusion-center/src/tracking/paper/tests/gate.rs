//! The gates against a look at every pair, with errors from neighbouring places.

use nalgebra::{Matrix2, Vector2, Vector3};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};

use crate::tracking::paper::followed::Seen;
use crate::tracking::paper::gate::{Columns, Gate};
use crate::tracking::paper::{AcrossGate, PaperConfig};
use crate::tracking::{Area, Coverage, Look, Platform, Plot};

const DT_S: f64 = 5.0;

fn plots(rng: &mut ChaCha8Rng, count: u32) -> Vec<Plot> {
    let plot = |report_index| {
        let mut some = |half: f64| rng.random_range(-half..half);
        let (x, y) = (20.0 + some(15.0), 30.0 + some(25.0));
        Plot {
            position_m: Vector2::new(some(500.0), some(500.0) + 12_000.0),
            covariance_m2: Matrix2::new(x * x, 0.5 * x * y, 0.5 * x * y, y * y),
            radial: None,
            strength_db: None,
            report_index,
        }
    };
    (0..count).map(plot).collect()
}

/// Range and angle to the flight, from nalgebra.
fn seen_from(platform: &Platform, place_m: Vector2<f64>) -> [f64; 2] {
    let line = Vector3::new(place_m.x, place_m.y, 0.0) - platform.position_m;
    [line.norm(), line.angle(&platform.velocity_m_per_s)]
}

/// Whether the gates let the plot pass, by differences of neighbours.
fn passes(config: &PaperConfig, [from, to]: [&Platform; 2], [before, plot]: [&Plot; 2]) -> bool {
    let way_m = config.max_speed_m_per_s * DT_S;
    // Without radial velocity the target stays in the line of sight, that is in its place.
    let [range_m, cone_rad] = seen_from(to, before.position_m);
    let expected = [range_m, cone_rad];
    let seen = seen_from(to, plot.position_m);
    let gates = [way_m, way_m / seen[0]];
    let count = if config.across == AcrossGate::Beams { 1 } else { 2 };
    assert!((from.velocity_m_per_s - to.velocity_m_per_s).norm() < 1e-12);
    (0..count).all(|index| {
        let change = |x_m: f64, y_m: f64| {
            let step_m = Vector2::new(x_m, y_m);
            let more = seen_from(to, plot.position_m + step_m)[index];
            0.5 * (more - seen_from(to, plot.position_m - step_m)[index])
        };
        let gradient = Vector2::new(change(1.0, 0.0), change(0.0, 1.0));
        let error = gradient.dot(&(plot.covariance_m2 * gradient)).sqrt();
        (seen[index] - expected[index]).abs() <= gates[index] + config.gate_sigma_count * error
    })
}

#[test]
fn no_pair_is_lost_and_none_too_many() {
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let from = Platform {
        position_m: Vector3::new(-3000.0, 500.0, 4000.0),
        velocity_m_per_s: Vector3::new(100.0, 20.0, 0.0),
        beam_index: None,
    };
    let to = Platform { position_m: from.position_m + DT_S * from.velocity_m_per_s, ..from };
    let mut counts = [0; 2];
    for across in [AcrossGate::Beams, AcrossGate::BeamsAndAngle] {
        let config = PaperConfig { across, ..PaperConfig::default() };
        let (befores, plots) = (plots(&mut rng, 40), plots(&mut rng, 60));
        let coverage = Coverage {
            area: Area::Everywhere,
            detection_probability: 0.9,
            minimum_detectable_m_per_s: None,
        };
        let look = Look {
            time_s: DT_S,
            sensor_index: 0,
            look_index: 1,
            platform: Some(to),
            coverage,
            clutter_per_m2: 0.0,
            plots: &plots,
        };
        let gate = Gate { config: &config, look: &look, platform: &to };
        let mut columns = Columns::default();
        gate.columns(&mut columns);
        for (row, before) in befores.iter().enumerate() {
            let seen = Seen { time_s: 0.0, platform: from, plot: before.clone() };
            let expected = seen.expected(DT_S, &to);
            let mut pairs = Vec::new();
            gate.candidates((row, &seen), &expected, &columns, &mut pairs);
            assert!(pairs.iter().all(|pair| pair.row == row));
            let mut found: Vec<usize> = pairs.iter().map(|pair| pair.column).collect();
            found.sort_unstable();
            let pass = |plot: &Plot| passes(&config, [&from, &to], [before, plot]);
            let wanted: Vec<usize> = (0..plots.len()).filter(|i| pass(&plots[*i])).collect();
            assert_eq!(found, wanted, "{across:?} track {row}");
            counts[0] += found.len();
            counts[1] += plots.len();
        }
    }
    assert!(counts[1] / 4 < counts[0] && counts[0] < counts[1] / 4 * 3, "{counts:?}: both happen");
}
