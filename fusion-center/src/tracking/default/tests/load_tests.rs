//! Many targets at once: how long a look takes, and how many links are right.

use rand::RngExt;

use super::super::{DefaultConfig, DefaultTracker};
use super::scenes::{EVERYWHERE, Scene, Sensor, Taken, normal, rng, shuffled};
use super::score::score;
use crate::tracking::{Coverage, Settled, Tracker};

const SCANS: usize = 30;
const PERIOD_S: f64 = 5.0;
const DETECTION: f64 = 0.9;
/// Area per target, m²: 1,000 in 800 km².
const AREA_PER_TARGET_M2: f64 = 8e5;
/// Targets for each false plot of a scan.
const PLOTS_PER_FALSE_ONE: usize = 5;

fn sensor() -> Sensor {
    Sensor {
        position_m: nalgebra::Vector3::new(0.0, -40_000.0, 6000.0),
        variances_m2: [400.0; 2],
        sigma_radial_m_per_s: 1.0,
        sigma_strength_db: 3.0,
    }
}

/// Looks at targets that start so and go straight on.
fn observed(starts: &[[f64; 4]], side_m: f64, seed: u64) -> Scene {
    let mut rng = rng(seed, 1);
    let mut scene = Scene { looks: Vec::new(), truth: Vec::new() };
    let clutter = starts.len() / PLOTS_PER_FALSE_ONE;
    for scan in 0..SCANS {
        let time_s = PERIOD_S * scan as f64;
        let states: Vec<[f64; 4]> =
            starts.iter().map(|[x, y, u, v]| [x + u * time_s, y + v * time_s, *u, *v]).collect();
        let mut plots = Vec::new();
        for (index, state) in states.iter().enumerate() {
            if rng.random_range(0.0..1.0) < DETECTION {
                plots.push((sensor().plot(*state, None, &mut rng), Some(index)));
            }
        }
        for _ in 0..clutter {
            let [x, y] = [0, 1].map(|_| rng.random_range(0.0..side_m));
            let [u, v] = [0, 1].map(|_| 12.0 * normal(&mut rng));
            plots.push((sensor().plot([x, y, u, v], None, &mut rng), None));
        }
        let (plots, truths) = shuffled(plots, &mut rng);
        scene.looks.push(Taken {
            time_s,
            sensor_index: 0,
            platform: Some(sensor().platform()),
            coverage: Coverage { detection_probability: DETECTION, ..EVERYWHERE },
            clutter_per_m2: 1.0 / (PLOTS_PER_FALSE_ONE as f64 * AREA_PER_TARGET_M2),
            plots,
            truths,
        });
        scene.truth.push(states);
    }
    scene
}

/// Targets anywhere, in any direction.
pub(super) fn uniform(count: usize, seed: u64) -> Scene {
    let mut rng = rng(seed, 0);
    let side_m = (AREA_PER_TARGET_M2 * count as f64).sqrt();
    let starts: Vec<[f64; 4]> = (0..count)
        .map(|_| {
            let [x, y] = [0, 1].map(|_| rng.random_range(0.0..side_m));
            let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
            let speed = rng.random_range(5.0..20.0);
            [x, y, speed * angle.cos(), speed * angle.sin()]
        })
        .collect();
    observed(&starts, side_m, seed)
}

/// Convoys on straight roads of 4 km: two lanes 4 m apart, one for each direction, headways exponential
/// of mean 150 m over both, speeds that differ, so that they overtake.
pub(super) fn roads(count: usize, seed: u64) -> Scene {
    let mut rng = rng(seed, 0);
    let side_m = (AREA_PER_TARGET_M2 * count as f64).sqrt();
    let mut starts = Vec::new();
    while starts.len() < count {
        let [x0, y0] = [0, 1].map(|_| rng.random_range(0.0..side_m));
        let angle: f64 = rng.random_range(0.0..std::f64::consts::TAU);
        let (sin, cos) = angle.sin_cos();
        let mut along = -2000.0;
        while along < 2000.0 && starts.len() < count {
            along -= 150.0 * (1.0 - rng.random_range(0.0..1.0_f64)).ln();
            let side = if rng.random_range(0.0..1.0) < 0.5 { -1.0 } else { 1.0 };
            let speed = side * (15.0 + 2.5 * normal(&mut rng)).max(5.0);
            let place = [x0 + cos * along + sin * 2.0 * side, y0 + sin * along - cos * 2.0 * side];
            starts.push([place[0], place[1], speed * cos, speed * sin]);
        }
    }
    observed(&starts, side_m, seed)
}

/// Milliseconds that this thread has had a processor: others on the machine cost it nothing.
fn processor_ms() -> f64 {
    // Giving way makes the kernel count what the thread has used.
    std::thread::yield_now();
    let text = std::fs::read_to_string("/proc/thread-self/schedstat").unwrap_or_default();
    text.split_whitespace().next().map_or(0.0, |word| word.parse::<f64>().unwrap_or(0.0) * 1e-6)
}

/// What following a scene costs and gives.
struct Followed {
    links_percent: f64,
    track_count: usize,
    /// Of a look whose settled steps nobody wants: in the middle, and the least.
    look_ms: [f64; 2],
    /// Of smoothing, on average for a look.
    settling_ms: f64,
}

impl Followed {
    fn of(scene: &Scene, config: &DefaultConfig) -> Self {
        let mut tracker = DefaultTracker::new(config.clone()).unwrap();
        let mut looks_ms = Vec::new();
        for (index, taken) in scene.looks.iter().enumerate() {
            let start_ms = processor_ms();
            tracker.look(&taken.look(index)).unwrap();
            tracker.forget_settled();
            looks_ms.push(processor_ms() - start_ms);
        }
        looks_ms.drain(..5);
        looks_ms.sort_by(f64::total_cmp);
        let (settled, settling_ms) = settle(scene, config);
        let sum = score(scene, &settled);
        Self {
            links_percent: 100.0 * sum.link_rate(),
            track_count: sum.tracks,
            look_ms: [looks_ms[looks_ms.len() / 2], looks_ms[0]],
            settling_ms,
        }
    }
}

/// All steps of a scene, and milliseconds that taking them costs for a look.
fn settle(scene: &Scene, config: &DefaultConfig) -> (Vec<Settled>, f64) {
    let mut tracker = DefaultTracker::new(config.clone()).unwrap();
    let (mut settled, mut settling_ms) = (Vec::new(), 0.0);
    for (index, taken) in scene.looks.iter().enumerate() {
        tracker.look(&taken.look(index)).unwrap();
        let start_ms = processor_ms();
        tracker.take_settled(&mut settled);
        settling_ms += processor_ms() - start_ms;
    }
    tracker.finish();
    tracker.take_settled(&mut settled);
    (settled, settling_ms / scene.looks.len() as f64)
}

/// The same scene over and over, for a profiler and for comparisons on a machine with other work.
fn repeat(scene: &Scene, count: usize) {
    let config = DefaultConfig::wide_area();
    let runs: Vec<_> = (0..count).map(|_| Followed::of(scene, &config)).collect();
    let links = runs[0].links_percent;
    let least = |of: fn(&Followed) -> f64| runs.iter().map(of).fold(f64::INFINITY, f64::min);
    println!(
        "links {links:.2} look ms median {:.3} least {:.3} settling {:.3}",
        least(|run| run.look_ms[0]),
        least(|run| run.look_ms[1]),
        least(|run| run.settling_ms),
    );
}

#[test]
#[ignore = "seconds: for a profiler"]
fn study_one_load() {
    repeat(&uniform(1000, 7), 10);
}

#[test]
#[ignore = "seconds: for a profiler"]
fn study_one_larger_load() {
    repeat(&uniform(5000, 7), 3);
}

#[test]
#[ignore = "seconds: for a profiler"]
fn study_one_road_load() {
    repeat(&roads(1000, 7), 3);
}

#[test]
#[ignore = "minutes: settings on roads"]
fn study_roads() {
    type Change = fn(&mut DefaultConfig);
    let changes: [(&str, Change); 9] = [
        ("base", |_| ()),
        ("gnn", |c| (c.lag_scans, c.max_hypothesis_count) = (0, 1)),
        ("hypotheses 30", |c| c.max_hypothesis_count = 30),
        ("hypotheses 20", |c| c.max_hypothesis_count = 20),
        ("hypotheses 10", |c| c.max_hypothesis_count = 10),
        ("keep 7, 30", |c| (c.keep_nats, c.max_hypothesis_count) = (7.0, 30)),
        ("ambiguous 4, 30", |c| (c.ambiguous_nats, c.max_hypothesis_count) = (4.0, 30)),
        ("lag 4, 30", |c| (c.lag_scans, c.max_hypothesis_count) = (4, 30)),
        ("cluster 6, 30", |c| (c.max_cluster_count, c.max_hypothesis_count) = (6, 30)),
    ];
    let scene = roads(1000, 11);
    for (name, change) in changes {
        let mut config = DefaultConfig::wide_area();
        change(&mut config);
        let run = Followed::of(&scene, &config);
        let [median, least] = run.look_ms;
        let (links, tracks) = (run.links_percent, run.track_count);
        println!("{name}: roads {links:.2} {tracks} median {median:.2} least {least:.2}");
        for turn in [0.0, 90.0_f64] {
            let sum = super::four::runs(&config, (400.0, turn.to_radians()), 1000..1200);
            let [right, own] = [sum.link_rate(), sum.identity_rate()].map(|share| 100.0 * share);
            println!("    four, turned {turn}: {right:.2} {own:.2} {:.2} m", sum.rmse_m());
        }
    }
}

#[test]
#[ignore = "minutes: up to 20,000 targets"]
fn study_load() {
    let config = DefaultConfig::wide_area();
    for (name, scene) in [
        ("uniform 1000", uniform(1000, 7)),
        ("uniform 5000", uniform(5000, 7)),
        ("roads 1000", roads(1000, 7)),
        ("uniform 20000", uniform(20_000, 7)),
    ] {
        let run = Followed::of(&scene, &config);
        let ([median, least], settling) = (run.look_ms, run.settling_ms);
        let (links, tracks) = (run.links_percent, run.track_count);
        println!(
            "{name}: links {links:.2} tracks {tracks} look ms median {median:.3} least {least:.3} settling ms {settling:.3}"
        );
    }
}

/// The bars of the issue are 99.9 and 93 %; these counts hold a false plot for two wrong links, and are
/// those of a smaller scene.
#[test]
fn most_links_are_right_among_many() {
    let config = DefaultConfig::wide_area();
    let scene = uniform(300, 100);
    let sum = score(&scene, &super::score::run(&scene, &config));
    assert!(0.998 <= sum.link_rate(), "{}", sum.link_rate());
    let swapped = sum.links - sum.right_links - sum.clutter_links;
    assert!(swapped <= sum.links / 1000, "{swapped} of {}", sum.links);
    assert!((300..=303).contains(&sum.tracks), "{}", sum.tracks);
}
