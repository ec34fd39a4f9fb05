//! Scans on a plane of the data's own as looks: errors along and across the line of sight.

use nalgebra::{Matrix2, Vector2, Vector3};
use proto::plots::{LocalPlot, LocalScan};

use crate::tracking::{Area, Coverage, Look, Platform, Plot, Radial};
use crate::wide::{LookName, OwnedLook, RadialConvention, WideConfig};

/// A line of sight over less than this has no direction, metres.
const LEAST_GROUND_M: f64 = 1.0;
/// Square metres of a square kilometre.
const M2_PER_KM2: f64 = 1e6;
/// A probability of detection that a tracker can reckon with.
const PROBABILITIES: [f64; 2] = [0.01, 0.9999];

/// A look that owns its plots, of a sensor whose place may be unknown.
#[derive(Clone, Debug)]
pub(super) struct AnyLook {
    time_s: f64,
    name: LookName,
    platform: Option<Platform>,
    coverage: Coverage,
    clutter_per_m2: f64,
    plots: Vec<Plot>,
}

impl AnyLook {
    /// How many plots it has.
    pub(super) fn plot_count(&self) -> usize {
        self.plots.len()
    }

    /// As trackers take it.
    pub(super) fn look(&self) -> Look<'_> {
        Look {
            time_s: self.time_s,
            sensor_index: self.name.sensor_index,
            look_index: self.name.look_index,
            platform: self.platform,
            coverage: self.coverage,
            clutter_per_m2: self.clutter_per_m2,
            plots: &self.plots,
        }
    }
}

impl From<OwnedLook> for AnyLook {
    fn from(look: OwnedLook) -> Self {
        let OwnedLook { time_s, name, platform, mut coverage, clutter_per_m2, plots } = look;
        let [least, most] = PROBABILITIES;
        coverage.detection_probability = coverage.detection_probability.clamp(least, most);
        Self { time_s, name, platform: Some(platform), coverage, clutter_per_m2, plots }
    }
}

/// The look that a scan is, with `assumed` where it does not say enough.
pub(super) fn local_look(scan: &LocalScan, assumed: &WideConfig, name: LookName) -> AnyLook {
    let sensor_m = scan.sensor_m.map(Vector3::from);
    let platform = sensor_m.map(|position_m| Platform {
        position_m,
        velocity_m_per_s: Vector3::zeros(),
        beam_index: None,
    });
    let stated = scan.detection_probability.unwrap_or(assumed.detection_probability);
    let least = scan.minimum_detectable_m_per_s.or(assumed.minimum_detectable_m_per_s);
    let [lowest, highest] = PROBABILITIES;
    AnyLook {
        time_s: scan.time_s,
        name,
        platform,
        coverage: Coverage {
            area: Area::Everywhere,
            detection_probability: stated.clamp(lowest, highest),
            minimum_detectable_m_per_s: least,
        },
        clutter_per_m2: assumed.clutter_per_km2 / M2_PER_KM2,
        plots: scan.plots.iter().map(|plot| local_plot(plot, sensor_m, assumed)).collect(),
    }
}

/// A plot with its covariance `σ_g² u uᵀ + σ_c² v vᵀ`: `u` along the line of sight over ground, `v`
/// across it, and `σ_g = σ_slant / cos(grazing)`, since a slant range pins a place on the ground less
/// the steeper it is seen \[wide-area, Geometry and prediction\]. Without a sensor the worse of the two
/// holds in every direction, and a radial velocity means nothing.
fn local_plot(plot: &LocalPlot, sensor_m: Option<Vector3<f64>>, assumed: &WideConfig) -> Plot {
    let position_m = Vector2::from(plot.at_m);
    let line_m = sensor_m.map(|sensor_m| position_m.push(0.0) - sensor_m);
    let line_m = line_m.filter(|line_m| LEAST_GROUND_M < line_m.xy().norm());
    let slant_sigma_m = plot.slant_sigma_m.unwrap_or(assumed.slant_sigma_m);
    let unseen = Plot {
        position_m,
        covariance_m2: Matrix2::identity()
            * slant_sigma_m.max(plot.cross_sigma_m.unwrap_or(slant_sigma_m)).powi(2),
        radial: None,
        strength_db: plot.snr_db,
        report_index: plot.index,
    };
    let Some(line_m) = line_m else { return unseen };
    let (ground_m, slant_m) = (line_m.xy().norm(), line_m.norm());
    let along = line_m.xy() / ground_m;
    let across = Vector2::new(-along.y, along.x);
    let cross_sigma_m = plot.cross_sigma_m.unwrap_or(assumed.cross_sigma_rad * ground_m);
    let sign = match assumed.radial_convention {
        RadialConvention::Away => 1.0,
        RadialConvention::Towards => -1.0,
    };
    Plot {
        covariance_m2: along * along.transpose() * (slant_sigma_m * slant_m / ground_m).powi(2)
            + across * across.transpose() * cross_sigma_m.powi(2),
        radial: plot.radial_m_per_s.map(|radial_m_per_s| Radial {
            velocity_m_per_s: sign * radial_m_per_s,
            sigma_m_per_s: plot.radial_sigma_m_per_s.unwrap_or(assumed.radial_sigma_m_per_s),
            direction: line_m.xy() / slant_m,
            wrap_m_per_s: plot.wrap_m_per_s,
        }),
        ..unseen
    }
}
