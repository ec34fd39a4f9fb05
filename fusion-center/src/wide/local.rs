//! Scans on a plane of the data's own as looks.

use nalgebra::{Vector2, Vector3};
use proto::plots::{LocalPlot, LocalScan};

use super::config::WideConfig;
use super::look::{LookName, OwnedLook};
use super::sighting::{M2_PER_KM2, Sighting, usable};
use crate::tracking::{Area, Coverage, Platform, Plot};

/// A line of sight over less than this has no direction, metres.
const LEAST_GROUND_M: f64 = 1.0;

/// The look that a scan is, with `assumed` where it does not say enough.
#[must_use]
pub fn local_look(scan: &LocalScan, assumed: &WideConfig, name: LookName) -> OwnedLook {
    let sensor_m = scan.sensor_m.map(Vector3::from);
    let platform = sensor_m.map(|position_m| Platform {
        position_m,
        velocity_m_per_s: Vector3::zeros(),
        beam_index: None,
    });
    let stated = scan.detection_probability.unwrap_or(assumed.detection_probability);
    let least = scan.minimum_detectable_m_per_s.or(assumed.minimum_detectable_m_per_s);
    OwnedLook {
        time_s: scan.time_s,
        name,
        platform,
        coverage: Coverage {
            area: Area::Everywhere,
            detection_probability: usable(stated),
            minimum_detectable_m_per_s: least,
        },
        clutter_per_m2: assumed.clutter_per_km2 / M2_PER_KM2,
        plots: scan.plots.iter().map(|plot| local_plot(plot, sensor_m, assumed)).collect(),
    }
}

fn local_plot(plot: &LocalPlot, sensor_m: Option<Vector3<f64>>, assumed: &WideConfig) -> Plot {
    let position_m = Vector2::from(plot.at_m);
    let line_m = sensor_m.map(|sensor_m| position_m.push(0.0) - sensor_m);
    let sighting = sighting(plot);
    match line_m.filter(|line_m| LEAST_GROUND_M < line_m.xy().norm()) {
        Some(line_m) => sighting.plot(position_m, &line_m, assumed),
        None => sighting.plot_from_nowhere(position_m, assumed),
    }
}

fn sighting(plot: &LocalPlot) -> Sighting {
    Sighting {
        index: plot.index,
        slant_sigma_m: plot.slant_sigma_m,
        cross_sigma_m: plot.cross_sigma_m,
        radial_m_per_s: plot.radial_m_per_s,
        radial_sigma_m_per_s: plot.radial_sigma_m_per_s,
        wrap_m_per_s: plot.wrap_m_per_s,
        snr_db: plot.snr_db,
    }
}
