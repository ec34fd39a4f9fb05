//! Bodies: their power, how they fade, sway, breathe and step.

use super::*;

fn points(list: &[[f64; 3]]) -> Vec<WayPoint> {
    list.iter()
        .map(|[time_s, x_m, y_m]| WayPoint { time_s: *time_s, x_m: *x_m, y_m: *y_m })
        .collect()
}

/// Walks at 1.2 m/s along x.
fn straight() -> Vec<WayPoint> {
    points(&[[0.0, 0.0, 5.0], [100.0, 120.0, 5.0]])
}

fn seen(walker: &Walker, streams: &Streams, time_s: f64) -> Vec<(Vector2<f64>, Complex<f64>)> {
    walker.scatterers(Moment { period_index: 4, time_s }, &-Vector2::y(), streams)
}

#[test]
fn a_body_has_the_power_of_a_point_with_a_bright_near_side() {
    for fluctuation in [Fluctuation::PerPeriod, Body::default().fluctuation] {
        let body = Body { fluctuation, ..Body::default() };
        let (mut power, mut coherent, mut nearer) = (0.0, 0.0, 0.0);
        let count = 3000_u32;
        for seed in 0..u64::from(count) {
            let streams = Streams::new(seed);
            let walker = Walker::new(&body, 0, &straight(), &streams);
            let all = seen(&walker, &streams, 7.3);
            assert_eq!(all.len(), 14);
            power += all.iter().map(|(_, g)| g.norm_sqr()).sum::<f64>();
            coherent += all.iter().map(|(_, g)| g).sum::<Complex<f64>>().norm_sqr();
            nearer += all.iter().map(|(p, g)| (5.0 - p.y) * g.norm_sqr()).sum::<f64>();
            let middle = Vector2::new(1.2 * 7.3, 5.0);
            assert!(all.iter().all(|(p, _)| (p - middle).norm() < 0.5));
        }
        // Exponential powers at most: 5 σ of 3000 are 9 %.
        let share = |sum: f64| sum / f64::from(count);
        assert!((share(power) - 1.0).abs() < 0.09, "{fluctuation:?}: {}", share(power));
        assert!((share(coherent) - 1.0).abs() < 0.09, "{fluctuation:?}: {}", share(coherent));
        assert!((0.03..0.2).contains(&(nearer / power)), "{} m nearer", nearer / power);
    }
}

#[test]
fn gains_decorrelate_over_time_and_way_and_per_period_anew() {
    let body = Body::default();
    let correlation = |list: &[WayPoint], lag_s: f64| {
        let (mut product, mut power) = (Complex::new(0.0, 0.0), 0.0);
        for seed in 0..400 {
            let streams = Streams::new(seed);
            let walker = Walker::new(&body, 1, list, &streams);
            let (a, b) = (seen(&walker, &streams, 9.0), seen(&walker, &streams, 9.0 + lag_s));
            product += a.iter().zip(&b).map(|(a, b)| b.1 * a.1.conj()).sum::<Complex<f64>>();
            power += a.iter().map(|(_, g)| g.norm_sqr()).sum::<f64>();
        }
        product.norm() / power
    };
    // 10 s and 0.25 m; the first is how coherent frames at 10 Hz are.
    for (lag_s, way_m) in [(0.1, 0.12), (0.25, 0.3)] {
        let want = (-(way_m / 0.25_f64).powi(2) - (lag_s / 10.0_f64).powi(2)).exp();
        let got = correlation(&straight(), lag_s);
        assert!((got - want).abs() < 0.12, "{lag_s} s: {got} for {want}");
    }
    assert!(0.99 < correlation(&points(&[[0.0, 0.0, 5.0]]), 0.5));
    let fresh = Body { fluctuation: Fluctuation::PerPeriod, ..body };
    let streams = Streams::new(1);
    let walker = Walker::new(&fresh, 1, &straight(), &streams);
    let at = |period_index| {
        walker.scatterers(Moment { period_index, time_s: 1.0 }, &-Vector2::y(), &streams)[0].1
    };
    assert!(0.0 < (at(1) - at(2)).norm() && (at(1) - at(1)).norm() <= 0.0);
}

#[test]
fn a_standing_body_sways_and_its_chest_breathes() {
    let streams = Streams::new(8);
    let still = points(&[[0.0, 0.0, 5.0]]);
    let spread = |body: &Body, index: usize| {
        let walker = Walker::new(body, 0, &still, &streams);
        let path: Vec<Vector2<f64>> =
            (0..4000).map(|k| seen(&walker, &streams, 0.05 * f64::from(k))[index].0).collect();
        let mean = path.iter().sum::<Vector2<f64>>() / path.len() as f64;
        let square = path.iter().map(|p| (p - mean).component_mul(&(p - mean)));
        let rms = (square.sum::<Vector2<f64>>() / path.len() as f64).map(f64::sqrt);
        let turns = path.windows(2).filter(|p| p[0].y < mean.y && mean.y <= p[1].y).count();
        (rms, turns as f64 / 200.0)
    };
    // Facing along y: the sway is 5 mm forth and back, half of it aside.
    let (sway_m, _) = spread(&Body { breathing_m: 0.0, ..Body::default() }, 0);
    assert!((sway_m.y / 0.005 - 1.0).abs() < 0.1, "{sway_m}");
    assert!((sway_m.x / 0.0025 - 1.0).abs() < 0.1, "{sway_m}");
    let breathing = Body { sway_m: 0.0, torso_count: 30, ..Body::default() };
    let chest = (0..30)
        .map(|index| spread(&breathing, index))
        .fold((0.0, 0.0), |best, (rms, hz)| if best.0 < rms.y { (rms.y, hz) } else { best });
    // A sine of 2.5 mm has an rms of 1.77 mm; the foremost scatterer of 30 takes most of it.
    assert!((0.0012..=0.00178).contains(&chest.0), "{} m", chest.0);
    assert!((0.21..0.29).contains(&chest.1), "{} Hz", chest.1);
}

#[test]
fn feet_swing_with_the_step_and_stand_when_the_body_does() {
    let body = Body { limb_count: 40, sway_m: 0.0, breathing_m: 0.0, ..Body::default() };
    let streams = Streams::new(8);
    let walker = Walker::new(&body, 0, &straight(), &streams);
    // The last limb's last scatterer: a foot. Its way against the body's over 20 s.
    let off = |time_s: f64| {
        let all = seen(&walker, &streams, time_s);
        all[all.len() - 1].0.x - 1.2 * time_s
    };
    let offs: Vec<f64> = (0..4000).map(|k| off(20.0 + 0.005 * f64::from(k))).collect();
    let largest = offs.iter().fold(0.0_f64, |a, b| a.max(b.abs()));
    // cycle 1.367 m at 1.2 m/s.
    assert!((0.94..=1.0).contains(&(largest / (0.25 * 1.367))), "{largest}");
    let cycles = offs.windows(2).filter(|p| p[0] < 0.0 && 0.0 <= p[1]).count();
    assert!((17..=18).contains(&cycles), "0.878 Hz in 20 s: {cycles}");
    let (arm, foot) = (
        seen(&walker, &streams, 20.3)[40 - 1 + 6].0.x,
        seen(&walker, &streams, 20.3)[120 - 1 + 6].0.x,
    );
    let middle = 1.2 * 20.3;
    assert!((arm - middle) * (foot - middle) < 0.0, "arm and leg of a side swing together");
    let halted = points(&[[0.0, 0.0, 5.0], [10.0, 12.0, 5.0], [20.0, 12.0, 5.0]]);
    let stopper = Walker::new(&body, 0, &halted, &streams);
    let moved = seen(&stopper, &streams, 15.0)
        .iter()
        .zip(seen(&stopper, &streams, 16.0))
        .map(|(a, b)| (a.0 - b.0).norm())
        .fold(0.0, f64::max);
    assert!(moved < 1e-9, "{moved}");
    // Nothing jumps: within a millisecond nothing moves faster than a foot can.
    for step in 0..3000 {
        let time_s = 8.5 + 0.001 * f64::from(step);
        let (a, b) = (seen(&stopper, &streams, time_s), seen(&stopper, &streams, time_s + 1e-4));
        let fastest = a.iter().zip(&b).map(|(a, b)| (a.0 - b.0).norm()).fold(0.0, f64::max);
        assert!(fastest < 4.0 * 1e-4, "{time_s}: {fastest}");
    }
}

#[test]
fn nonsense_is_named() {
    let body = Body::default();
    assert_eq!(body.check("scene.targets[0]"), Ok(()));
    let field = |bad: Body| {
        let field = bad.check("t").unwrap_err().field;
        field.strip_prefix("t.kind.body.").unwrap().to_owned()
    };
    let at = |time_s, way_m| Fluctuation::Correlated { time_s, way_m };
    assert_eq!(field(Body { fluctuation: at(0.0, 1.0), ..body }), "fluctuation.time_s");
    assert_eq!(field(Body { fluctuation: at(1.0, f64::NAN), ..body }), "fluctuation.way_m");
    assert_eq!(field(Body { torso_count: 0, ..body }), "torso_count");
    assert_eq!(field(Body { limb_count: 1001, ..body }), "limb_count");
    assert_eq!(field(Body { limb_share: 1.1, ..body }), "limb_share");
    assert_eq!(field(Body { breathing_m: -0.1, ..body }), "breathing_m");
    assert_eq!(field(Body { sway_m: 1.0, ..body }), "sway_m");
    assert_eq!(field(Body { turn_s: f64::INFINITY, ..body }), "turn_s");
}
