//! Scans in the plane to looks of the tracker: errors along and across the line of sight.

use nalgebra::{Matrix2, Vector2, Vector3};
use proto::plots::LocalPlot;

use super::ground::{Flat, Sector};
use super::settings::{AssumedConfig, RadialSign};
use crate::tracking::{Area, Coverage, Look, Platform, Plot, Radial};

/// Nothing is believed to be seen steeper from above than this: the cosine of the grazing angle.
const LEAST_GROUND_SHARE: f64 = 0.05;
/// A probability of detection that a tracker can reckon with.
const PROBABILITIES: [f64; 2] = [0.01, 0.9999];

/// A look that owns its plots.
#[derive(Clone, Debug)]
pub(super) struct OwnedLook {
    time_s: f64,
    platform: Option<Platform>,
    coverage: Coverage,
    clutter_per_m2: f64,
    plots: Vec<Plot>,
}

impl OwnedLook {
    /// Which look of which sensor it is.
    pub(super) fn look(&self, sensor_index: u32, look_index: u64) -> Look<'_> {
        Look {
            time_s: self.time_s,
            sensor_index,
            look_index,
            platform: self.platform,
            coverage: self.coverage,
            clutter_per_m2: self.clutter_per_m2,
            plots: &self.plots,
        }
    }
}

/// The look that a scan is, with `assumed` where it does not say enough.
pub(super) fn look_of(flat: &Flat, assumed: &AssumedConfig) -> OwnedLook {
    let scan = &flat.scan;
    let sensor_m = scan.sensor_m.map(Vector3::from);
    let platform = sensor_m.map(|position_m| Platform {
        position_m,
        velocity_m_per_s: flat.sensor_velocity_m_per_s.unwrap_or_default(),
        beam_index: None,
    });
    let stated = scan.detection_probability.unwrap_or(assumed.detection_probability);
    let [least, most] = PROBABILITIES;
    let sector = flat.sector.zip(sensor_m);
    let plots = scan.plots.iter().enumerate();
    OwnedLook {
        time_s: scan.time_s,
        platform,
        coverage: Coverage {
            area: sector.map_or(Area::Everywhere, |(sector, sensor_m)| area(&sector, &sensor_m)),
            detection_probability: stated.clamp(least, most),
            minimum_detectable_m_per_s: scan.minimum_detectable_m_per_s,
        },
        clutter_per_m2: assumed.clutter_per_m2,
        plots: plots.map(|(index, plot)| plot_of(index, plot, sensor_m, assumed)).collect(),
    }
}

fn area(sector: &Sector, sensor_m: &Vector3<f64>) -> Area {
    let to_center_m = sector.center_m - sensor_m.xy();
    let range_m = to_center_m.norm();
    Area::Sector {
        origin_m: sensor_m.xy(),
        direction_rad: to_center_m.y.atan2(to_center_m.x),
        half_width_rad: sector.angle_half_extent_rad,
        min_range_m: (range_m - sector.range_half_extent_m).max(0.0),
        max_range_m: range_m + sector.range_half_extent_m,
    }
}

/// A plot with its covariance `σ_g² u uᵀ + σ_c² v vᵀ`: `u` along the line of sight over ground, `v`
/// across it, and `σ_g = σ_slant / cos(grazing)`, since a slant range pins a place on the ground less
/// the steeper it is seen \[wide-area, Geometry and prediction\].
fn plot_of(
    index: usize,
    plot: &LocalPlot,
    sensor_m: Option<Vector3<f64>>,
    assumed: &AssumedConfig,
) -> Plot {
    let position_m = Vector2::from(plot.at_m);
    let slant_sigma_m = plot.slant_sigma_m.unwrap_or(assumed.slant_sigma_m);
    let cross_sigma_m = plot.cross_sigma_m.unwrap_or(assumed.cross_sigma_m);
    let sight_m = sensor_m.map(|sensor_m| position_m.push(0.0) - sensor_m);
    let sight = sight_m.and_then(|sight_m| sight_m.try_normalize(f64::EPSILON));
    let over_ground = sight.and_then(|sight| sight.xy().try_normalize(f64::EPSILON));
    let covariance_m2 = match (sight, over_ground) {
        (Some(sight), Some(along)) => {
            let ground_share = sight.xy().norm().max(LEAST_GROUND_SHARE);
            let across = Vector2::new(-along.y, along.x);
            along * along.transpose() * (slant_sigma_m / ground_share).powi(2)
                + across * across.transpose() * cross_sigma_m.powi(2)
        }
        // Without a line of sight the worse of the two holds in every direction.
        _ => Matrix2::identity() * slant_sigma_m.max(cross_sigma_m).powi(2),
    };
    let sign = match assumed.radial {
        RadialSign::Receding => Some(1.0),
        RadialSign::Approaching => Some(-1.0),
        RadialSign::Unused => None,
    };
    let measured = sign.zip(plot.radial_m_per_s).zip(sight);
    let radial = measured.map(|((sign, radial_m_per_s), sight)| Radial {
        velocity_m_per_s: sign * radial_m_per_s,
        sigma_m_per_s: plot.radial_sigma_m_per_s.unwrap_or(assumed.radial_sigma_m_per_s),
        direction: sight.xy(),
        wrap_m_per_s: plot.wrap_m_per_s,
    });
    Plot {
        position_m,
        covariance_m2,
        radial,
        strength_db: plot.snr_db,
        report_index: u32::try_from(index).unwrap_or(u32::MAX),
    }
}
