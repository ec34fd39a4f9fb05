//! The experiments are what they say.

use super::*;

/// A tenth of a pixel, metres.
const NEAR: f64 = 0.005;

#[test]
fn there_are_four_and_no_more() {
    assert_eq!(Experiment::numbered(3).unwrap(), Experiment::all()[2]);
    assert_eq!(Experiment::all()[3].number(), 4);
    for number in [0, 5] {
        let error = ExperimentError::from(Experiment::numbered(number).unwrap_err());
        assert!(error.to_string().contains("use 1 to 4"), "{error}");
    }
}

#[test]
fn everybody_is_back_at_the_end_and_at_the_far_end_in_the_middle() {
    for experiment in Experiment::all() {
        let scene = experiment.scene();
        assert_eq!(scene.check(), Ok(()));
        let walks_m = &WALKS_M[experiment.index];
        for (person, walk_m) in walks_m.iter().enumerate() {
            let sharp = crate::simulate::Target {
                kind: TargetKind::Point,
                ..scene.targets[person].clone()
            };
            let at_m = |time_s| sharp.position(time_s).coords_m;
            assert!((at_m(0.0) - Vector2::from(walk_m[0])).norm() < NEAR);
            assert!((at_m(DURATION_S) - Vector2::from(walk_m[0])).norm() < NEAR);
            let is_short = experiment.number() == 2 && person == 0;
            let far_s = if is_short { 3.5 } else { 7.0 };
            assert!((at_m(far_s) - Vector2::from(walk_m[1])).norm() < NEAR);
            let speed = (at_m(1.1) - at_m(1.0)).norm() / 0.1;
            assert!((0.5..=1.0).contains(&speed), "{speed} m/s");
        }
    }
}

/// Peak power near a place over the noise, in the image without weighting.
fn peak_over_noise(measured: &crate::pipeline::Measured<'_>, middle_m: &Vector2<f64>) -> f64 {
    let (grid, coherent) = (measured.image.grid, measured.image.coherent);
    let channel_count = f64::from(u32::try_from(coherent.channel_count).unwrap());
    let near = |index: &usize| {
        let (column, row) = (index % grid.column_count, index / grid.column_count);
        let place_m = Vector2::new(grid.x_m(column), grid.y_m(row));
        // A body with its arms, and an array's beam.
        (place_m - middle_m).norm() < 0.8
    };
    let powers = (0..grid.pixel_count()).filter(near).map(|index| coherent.power[index]);
    let amplitude = f64::from(powers.fold(0.0, f32::max)).sqrt() / channel_count;
    (amplitude / f64::from(measured.image.noise_amplitude)).powi(2)
}

#[test]
fn people_peak_at_15_db_on_average() {
    let mut snrs = Vec::new();
    for (experiment, seed) in Experiment::all().into_iter().zip(301..) {
        let scene = experiment.scene();
        let simulator =
            EchoSimulator::new(&scene, Se2::identity(), &radar(), &disturbance(IMAGE_SNR_DB), seed)
                .unwrap();
        let mut chain = Chain::new(&paper_chain()).unwrap();
        for index in (0..FRAME_COUNT).step_by(4) {
            let time_s = FRAME_S * f64::from(index);
            let sweep = simulator.sweep(u64::from(index), time_s);
            let measured = chain.process_sweep(&sweep).unwrap();
            for middle_m in experiment.middles_m(time_s) {
                snrs.push(peak_over_noise(&measured, &middle_m));
            }
        }
    }
    let mean_db = 10.0 * (snrs.iter().sum::<f64>() / snrs.len() as f64).log10();
    snrs.sort_by(f64::total_cmp);
    let at_db = |part: usize| 10.0 * snrs[snrs.len() / part].log10();
    println!("mean {mean_db:.2} dB; 5 % {:.1}, 50 % {:.1}", at_db(20), at_db(2));
    // 280 looks at eight bodies that fade over 0.25 m: some 100 that are independent.
    assert!((mean_db - IMAGE_SNR_DB).abs() < 1.5, "{mean_db} dB");
}

#[test]
fn a_refused_frame_and_a_wrong_chain_are_told() {
    let stage = Stage::new(Experiment::all()[2], &paper_chain()).unwrap();
    let refused = FrameError::TimeNotAscending { time_s: 0.0, previous_s: 1.0 };
    assert_eq!(stage.play(1, |_| Err(refused)), Err(ExperimentError::Frame(refused)));
    let other_radar = Stage::new(Experiment::all()[2], &ChainConfig::default()).unwrap();
    let told = other_radar.play(1, |_| Ok(())).unwrap_err();
    assert!(matches!(told, ExperimentError::Chain(ChainError::SampleCount { .. })), "{told}");
}
