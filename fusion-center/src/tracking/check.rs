//! Whether a look makes sense, and what lies in the area that it covers.

use nalgebra::Vector2;

use super::{Area, Coverage, Look, LookError, Plot};

/// A covariance whose determinant is below this share of the product of its variances has lost its
/// digits: correlations beyond 0.9999995 are not measured.
const MIN_DETERMINANT_SHARE: f64 = 1e-6;

impl Area {
    /// Whether it holds `place_m`.
    #[must_use]
    pub fn contains(&self, place_m: Vector2<f64>) -> bool {
        let Self::Sector { origin_m, direction_rad, half_width_rad, min_range_m, max_range_m } =
            self
        else {
            return true;
        };
        let off_m = place_m - origin_m;
        let (sin, cos) = direction_rad.sin_cos();
        let along = off_m.x * cos + off_m.y * sin;
        let across = off_m.y * cos - off_m.x * sin;
        let is_within = across.atan2(along).abs() <= *half_width_rad;
        is_within && (*min_range_m..=*max_range_m).contains(&off_m.norm())
    }
}

impl Look<'_> {
    /// Checks every number, and that the look is not older than one of `newest_s`.
    ///
    /// # Errors
    /// [`LookError::Unusable`] names the first number that is not finite or out of its range,
    /// [`LookError::TooLate`] says what was heard before.
    pub fn check(&self, newest_s: Option<f64>) -> Result<(), LookError> {
        self.finite("time", self.time_s)?;
        self.require(0.0 <= self.clutter_per_m2, "clutter density", self.clutter_per_m2)?;
        self.finite("clutter density", self.clutter_per_m2)?;
        if let Some(platform) = &self.platform {
            platform.position_m.iter().try_for_each(|v| self.finite("platform position", *v))?;
            platform.velocity_m_per_s.iter().try_for_each(|v| self.finite("its velocity", *v))?;
        }
        self.check_coverage(&self.coverage)?;
        self.plots.iter().try_for_each(|plot| self.check_plot(plot))?;
        let (sensor_index, look_index, time_s) = (self.sensor_index, self.look_index, self.time_s);
        match newest_s {
            Some(previous_s) if time_s < previous_s => {
                Err(LookError::TooLate { sensor_index, look_index, time_s, previous_s })
            }
            _ => Ok(()),
        }
    }

    fn check_coverage(&self, coverage: &Coverage) -> Result<(), LookError> {
        let chance = coverage.detection_probability;
        self.require((0.0..=1.0).contains(&chance), "detection probability", chance)?;
        if let Some(least) = coverage.minimum_detectable_m_per_s {
            self.require(0.0 <= least, "minimum detectable velocity", least)?;
        }
        let Area::Sector { origin_m, direction_rad, half_width_rad, min_range_m, max_range_m } =
            coverage.area
        else {
            return Ok(());
        };
        origin_m.iter().try_for_each(|value| self.finite("origin of the sector", *value))?;
        self.finite("direction of the sector", direction_rad)?;
        self.require(0.0 <= half_width_rad, "half width of the sector", half_width_rad)?;
        self.require(0.0 <= min_range_m, "nearest range of the sector", min_range_m)?;
        self.require(min_range_m <= max_range_m, "farthest range of the sector", max_range_m)
    }

    fn check_plot(&self, plot: &Plot) -> Result<(), LookError> {
        plot.position_m.iter().try_for_each(|value| self.finite("place of a plot", *value))?;
        let covariance = &plot.covariance_m2;
        covariance.iter().try_for_each(|value| self.finite("covariance of a plot", *value))?;
        let variances = covariance[(0, 0)] * covariance[(1, 1)];
        let is_spread = 0.0 < covariance[(0, 0)] && 0.0 < covariance[(1, 1)];
        let determinant = covariance.determinant();
        let is_usable = is_spread && MIN_DETERMINANT_SHARE * variances < determinant;
        self.require(is_usable, "determinant of a plot's covariance", determinant)?;
        if let Some(radial) = &plot.radial {
            self.finite("radial velocity", radial.velocity_m_per_s)?;
            self.finite("error of a radial velocity", radial.sigma_m_per_s)?;
            let sigma = radial.sigma_m_per_s;
            self.require(0.0 < sigma, "error of a radial velocity", sigma)?;
            radial.direction.iter().try_for_each(|v| self.finite("direction of a plot", *v))?;
            let wrap = radial.wrap_m_per_s.unwrap_or(1.0);
            self.finite("wrap of a radial velocity", wrap)?;
            self.require(0.0 < wrap, "wrap of a radial velocity", wrap)?;
        }
        plot.strength_db.map_or(Ok(()), |value| self.finite("strength of a plot", value))
    }

    fn finite(&self, what: &'static str, value: f64) -> Result<(), LookError> {
        self.require(value.is_finite(), what, value)
    }

    fn require(&self, is_so: bool, what: &'static str, value: f64) -> Result<(), LookError> {
        if is_so { Ok(()) } else { Err(self.unusable(what, value)) }
    }

    /// The error that refuses this look.
    pub(super) fn unusable(&self, what: &'static str, value: impl ToString) -> LookError {
        let (sensor_index, look_index) = (self.sensor_index, self.look_index);
        LookError::Unusable { sensor_index, look_index, what, value: value.to_string() }
    }
}
