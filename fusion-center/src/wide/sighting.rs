//! What a plot states of itself as a plot with its covariance: along and across the line of sight.

use nalgebra::{Matrix2, Vector2, Vector3};

use super::config::{RadialConvention, WideConfig};
use crate::tracking::{Plot, Radial};

/// Square metres of a square kilometre.
pub(super) const M2_PER_KM2: f64 = 1e6;
/// Probabilities of detection that a tracker can reckon with.
const PROBABILITIES: [f64; 2] = [0.01, 0.9999];

/// The nearest probability of detection that a tracker can reckon with.
pub(super) fn usable(detection_probability: f64) -> f64 {
    let [least, most] = PROBABILITIES;
    detection_probability.clamp(least, most)
}

/// What a plot states, wherever it is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Sighting {
    pub(super) index: u32,
    pub(super) slant_sigma_m: Option<f64>,
    pub(super) cross_sigma_m: Option<f64>,
    pub(super) radial_m_per_s: Option<f64>,
    pub(super) radial_sigma_m_per_s: Option<f64>,
    pub(super) wrap_m_per_s: Option<f64>,
    pub(super) snr_db: Option<f64>,
}

impl Sighting {
    /// The plot at `position_m`, where the line of sight `line_m` from the sensor ends. Its error has
    /// the standard deviations `σ_r / cos(grazing)` along the line of sight over ground, since a slant
    /// range pins a place the less the steeper it is seen, and `σ_c` across it; a target with velocity
    /// `v` has the radial velocity `direction · v` \[wide-area, formats\].
    pub(super) fn plot(
        &self,
        position_m: Vector2<f64>,
        line_m: &Vector3<f64>,
        assumed: &WideConfig,
    ) -> Plot {
        let (ground_m, slant_m) = (line_m.xy().norm(), line_m.norm());
        let along = line_m.xy() / ground_m;
        let slant_sigma_m = self.slant_sigma_m.unwrap_or(assumed.slant_sigma_m);
        let along_sigma_m = slant_sigma_m * slant_m / ground_m;
        let cross_sigma_m = self.cross_sigma_m.unwrap_or(assumed.cross_sigma_rad * ground_m);
        let axes = Matrix2::new(along.x, -along.y, along.y, along.x);
        let variances_m2 = Vector2::new(along_sigma_m.powi(2), cross_sigma_m.powi(2));
        let sign = match assumed.radial_convention {
            RadialConvention::Away => 1.0,
            RadialConvention::Towards => -1.0,
        };
        Plot {
            position_m,
            covariance_m2: axes * Matrix2::from_diagonal(&variances_m2) * axes.transpose(),
            radial: self.radial_m_per_s.map(|radial_m_per_s| Radial {
                velocity_m_per_s: sign * radial_m_per_s,
                sigma_m_per_s: self.radial_sigma_m_per_s.unwrap_or(assumed.radial_sigma_m_per_s),
                direction: line_m.xy() / slant_m,
                wrap_m_per_s: self.wrap_m_per_s,
            }),
            strength_db: self.snr_db,
            report_index: self.index,
        }
    }

    /// The plot where nobody knows from where it was seen: the worse of both errors holds in every
    /// direction, and a radial velocity means nothing.
    pub(super) fn plot_from_nowhere(&self, position_m: Vector2<f64>, assumed: &WideConfig) -> Plot {
        let slant_sigma_m = self.slant_sigma_m.unwrap_or(assumed.slant_sigma_m);
        let sigma_m = slant_sigma_m.max(self.cross_sigma_m.unwrap_or(slant_sigma_m));
        Plot {
            position_m,
            covariance_m2: Matrix2::identity() * sigma_m.powi(2),
            radial: None,
            strength_db: self.snr_db,
            report_index: self.index,
        }
    }
}
