//! Detections of a radar that images by itself, grouped into people: one measured point per
//! cluster of one period.
//!
//! Such a radar lists many detections per body and frame, and far more of furniture. A period's
//! moving detections at body height are clustered by density, and each cluster gives one point:
//! a robust centre, the covariance of that centre, and the second moment as its extent. Positions
//! are projected along `z` onto the plane of the sensor's levelled frame, for which a radar that
//! looks down must be level: [`corrected`] takes its constant errors out first.

#[cfg(test)]
mod bristol;
mod calibrate;
mod centre;
mod cluster;
mod config;
mod floor;
mod period;

use proto::measured::MeasuredPoint;

pub use calibrate::Calibration;
pub use config::{Area, GroupConfig, InvalidGroup};
pub use floor::FloorEcho;
pub use period::{by_window, window_index};

use crate::source::recorded::Detection;

/// A recording without the radar's constant errors.
#[derive(Clone, Debug, PartialEq)]
pub struct Corrected {
    /// The detections that have a place after correction, in their order.
    pub detections: Vec<Detection>,
    /// The floor's echo by which the radar was levelled, where it looks down and one was found.
    pub floor: Option<FloorEcho>,
}

/// `detections` of a whole recording without the errors that [`GroupConfig::calibration`] states
/// and, for a radar that looks down, without those that the floor's echo gives away.
#[must_use]
pub fn corrected(detections: Vec<Detection>, config: &GroupConfig) -> Corrected {
    let stated = apply(&config.calibration, detections, config);
    let floor = config.looks_down().then(|| floor::floor_echo(&stated, config)).flatten();
    let found = floor.map_or_else(Calibration::default, |echo| echo.calibration);
    Corrected { detections: apply(&found, stated, config), floor }
}

fn apply(errors: &Calibration, detections: Vec<Detection>, config: &GroupConfig) -> Vec<Detection> {
    if errors.is_nothing() {
        return detections;
    }
    let tilt_rad = config.tilt_rad();
    detections.iter().filter_map(|detection| errors.corrected(detection, tilt_rad)).collect()
}

/// The people among one period's `detections`: one point per cluster, in the order of their
/// first detection. Detections that [`GroupConfig`] does not let through, and those in no
/// cluster, are dropped.
///
/// Cost: of the order of `n²` for `n` detections let through.
#[must_use]
pub fn group_period(detections: &[Detection], config: &GroupConfig) -> Vec<MeasuredPoint> {
    let kept: Vec<&Detection> = detections.iter().filter(|d| config.lets_through(d)).collect();
    let positions_m: Vec<[f64; 2]> = kept.iter().map(|d| [d.x_m, d.y_m]).collect();
    cluster::clusters(&positions_m, config.cluster_radius_m, config.min_detection_count)
        .into_iter()
        .map(|members| {
            let body: Vec<&Detection> = members.into_iter().map(|index| kept[index]).collect();
            centre::measured_point(&body, config)
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};
    use rand_distr::StandardNormal;

    use super::*;

    /// Spread of a simulated body's detections along each axis.
    const BODY_SIGMA_M: f64 = 0.15;
    /// Detections of a body in one period.
    const BODY_COUNT: usize = 12;

    fn walker(x_m: f64, y_m: f64, random: &mut ChaCha8Rng) -> Vec<Detection> {
        let mut normal = || random.sample::<f64, _>(StandardNormal);
        let mut one = |_| Detection {
            time_s: 0.1,
            x_m: x_m + BODY_SIGMA_M * normal(),
            y_m: y_m + BODY_SIGMA_M * normal(),
            z_m: Some(0.2 * normal()),
            v_m_per_s: Some(-0.8),
            snr_db: Some(15.0 + normal()),
        };
        (0..BODY_COUNT).map(&mut one).collect()
    }

    fn upright() -> GroupConfig {
        GroupConfig { sensor_height_m: Some(1.1), ..GroupConfig::default() }
    }

    #[test]
    fn two_people_among_furniture_and_noise_give_two_points() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        let mut detections = walker(-1.0, 2.0, &mut random);
        detections.extend(walker(1.5, 3.0, &mut random));
        let furniture = walker(0.2, 2.5, &mut random);
        detections.extend(furniture.iter().map(|d| Detection { v_m_per_s: Some(0.0), ..*d }));
        let ceiling = walker(0.2, 4.0, &mut random);
        detections.extend(ceiling.iter().map(|d| Detection { z_m: Some(1.5), ..*d }));
        detections.extend([(4.0, 1.0), (-3.0, 5.0), (0.0, 6.0)].map(|(x_m, y_m)| Detection {
            x_m,
            y_m,
            ..detections[0]
        }));
        let points = group_period(&detections, &upright());
        assert_eq!(points.len(), 2, "{points:?}");
        for (point, (x_m, y_m)) in points.iter().zip([(-1.0, 2.0), (1.5, 3.0)]) {
            // Four standard deviations of a mean of twelve.
            assert!((point.x_m - x_m).hypot(point.y_m - y_m) < 0.18, "{point:?}");
            assert_eq!(point.radial_velocity_m_per_s, Some(-0.8));
        }
    }

    #[test]
    fn a_period_of_nothing_gives_nothing() {
        assert_eq!(group_period(&[], &upright()), []);
        let mut random = ChaCha8Rng::seed_from_u64(4);
        let few = &walker(0.0, 2.0, &mut random)[..4];
        assert_eq!(group_period(few, &upright()), [], "four are fewer than five");
    }

    #[test]
    fn the_order_of_detections_changes_nothing_but_the_order_of_points() {
        let mut random = ChaCha8Rng::seed_from_u64(6);
        let mut detections = walker(-1.0, 2.0, &mut random);
        detections.extend(walker(1.5, 3.0, &mut random));
        let forward = group_period(&detections, &upright());
        detections.reverse();
        let backward = group_period(&detections, &upright());
        for (a, b) in forward.iter().zip(backward.iter().rev()) {
            assert!((a.x_m - b.x_m).hypot(a.y_m - b.y_m) < 1e-9, "{a:?} {b:?}");
        }
    }
}
