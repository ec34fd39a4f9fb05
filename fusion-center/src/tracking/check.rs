//! Whether a look makes sense, and what lies in the area that it covers.

use std::ops::RangeBounds;

use nalgebra::Vector2;

use super::{Area, Coverage, Look, LookError, Plot};

/// A covariance whose determinant is below this share of the product of its variances has lost its
/// digits: correlations beyond 0.9999995 are not measured.
const MIN_DETERMINANT_SHARE: f64 = 1e-6;

/// A covariance is symmetric up to rounding: to this share of its trace.
const MAX_SKEW_SHARE: f64 = 1e-6;

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
        self.within("clutter density", self.clutter_per_m2, 0.0..)?;
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
        self.within("detection probability", coverage.detection_probability, 0.0..=1.0)?;
        let least_m_per_s = coverage.minimum_detectable_m_per_s.unwrap_or(0.0);
        self.within("minimum detectable velocity", least_m_per_s, 0.0..)?;
        let Area::Sector { origin_m, direction_rad, half_width_rad, min_range_m, max_range_m } =
            coverage.area
        else {
            return Ok(());
        };
        origin_m.iter().try_for_each(|value| self.finite("origin of the sector", *value))?;
        self.finite("direction of the sector", direction_rad)?;
        self.within("half width of the sector", half_width_rad, 0.0..)?;
        self.within("nearest range of the sector", min_range_m, 0.0..)?;
        self.within("farthest range of the sector", max_range_m, min_range_m..)
    }

    fn check_plot(&self, plot: &Plot) -> Result<(), LookError> {
        plot.position_m.iter().try_for_each(|value| self.finite("place of a plot", *value))?;
        let covariance = &plot.covariance_m2;
        covariance.iter().try_for_each(|value| self.finite("covariance of a plot", *value))?;
        let (x_m2, y_m2) = (covariance[(0, 0)], covariance[(1, 1)]);
        self.within("variance of a plot", x_m2, f64::MIN_POSITIVE..)?;
        self.within("variance of a plot", y_m2, f64::MIN_POSITIVE..)?;
        let skew_m2 = (covariance[(0, 1)] - covariance[(1, 0)]).abs();
        let most_m2 = MAX_SKEW_SHARE * (x_m2 + y_m2);
        self.within("skew of a plot's covariance", skew_m2, ..=most_m2)?;
        let least_m4 = MIN_DETERMINANT_SHARE * x_m2 * y_m2;
        let determinant_m4 = covariance.determinant();
        self.within("determinant of a plot's covariance", determinant_m4, least_m4..)?;
        if let Some(radial) = &plot.radial {
            let wrap_m_per_s = radial.wrap_m_per_s.unwrap_or(f64::MAX);
            self.finite("radial velocity", radial.velocity_m_per_s)?;
            self.within("error of a radial velocity", radial.sigma_m_per_s, f64::MIN_POSITIVE..)?;
            self.within("wrap of a radial velocity", wrap_m_per_s, f64::MIN_POSITIVE..)?;
            radial.direction.iter().try_for_each(|v| self.finite("direction of a plot", *v))?;
        }
        plot.strength_db.map_or(Ok(()), |value| self.finite("strength of a plot", value))
    }

    #[inline]
    fn finite(&self, what: &'static str, value: f64) -> Result<(), LookError> {
        self.within(what, value, ..)
    }

    /// Refuses what is not allowed, or not finite.
    #[inline]
    fn within(
        &self,
        what: &'static str,
        value: f64,
        allowed: impl RangeBounds<f64>,
    ) -> Result<(), LookError> {
        if value.is_finite() && allowed.contains(&value) {
            return Ok(());
        }
        Err(self.unusable(what, value))
    }

    /// The error that refuses this look.
    #[cold]
    pub(super) fn unusable(&self, what: &'static str, value: impl ToString) -> LookError {
        let (sensor_index, look_index) = (self.sensor_index, self.look_index);
        LookError::Unusable { sensor_index, look_index, what, value: value.to_string() }
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Matrix2, Vector3};

    use super::*;
    use crate::tracking::{Platform, Radial};

    fn plot() -> Plot {
        Plot {
            position_m: Vector2::new(10.0, 20.0),
            covariance_m2: Matrix2::new(4.0, 1.0, 1.0, 9.0),
            radial: Some(Radial {
                velocity_m_per_s: -3.0,
                sigma_m_per_s: 1.0,
                direction: Vector2::x(),
                wrap_m_per_s: None,
            }),
            strength_db: Some(12.0),
            report_index: 0,
        }
    }

    fn sector() -> Area {
        Area::Sector {
            origin_m: Vector2::new(100.0, 0.0),
            direction_rad: 3.0,
            half_width_rad: 0.5,
            min_range_m: 10.0,
            max_range_m: 50.0,
        }
    }

    fn look(plots: &[Plot]) -> Look<'_> {
        Look {
            time_s: 5.0,
            sensor_index: 1,
            look_index: 2,
            platform: Some(Platform {
                position_m: Vector3::new(0.0, 0.0, 100.0),
                velocity_m_per_s: Vector3::x(),
                beam_index: None,
            }),
            coverage: Coverage {
                area: sector(),
                detection_probability: 0.9,
                minimum_detectable_m_per_s: Some(1.0),
            },
            clutter_per_m2: 0.0,
            plots,
        }
    }

    fn complaint(look: &Look<'_>) -> String {
        look.check(None).unwrap_err().to_string()
    }

    #[test]
    fn a_sector_holds_what_is_in_range_and_angle_also_across_the_cut_of_angles() {
        // Its middle is 3 rad, so that its upper edge lies beyond π.
        let at = |range_m: f64, angle_rad: f64| {
            sector().contains(
                Vector2::new(100.0, 0.0) + range_m * Vector2::new(angle_rad.cos(), angle_rad.sin()),
            )
        };
        assert!(at(30.0, 3.0) && at(30.0, 3.4) && at(30.0, 2.6));
        assert!(!at(30.0, 3.6) && !at(30.0, 2.4) && !at(30.0, 0.0));
        assert!(!at(9.0, 3.0) && !at(51.0, 3.0));
        assert!(Area::Everywhere.contains(Vector2::new(1e6, -1e6)));
    }

    #[test]
    fn every_number_of_a_look_is_checked() {
        assert_eq!(look(&[plot()]).check(Some(5.0)), Ok(()));
        let spoilt: [fn(&mut Look<'_>); 12] = [
            |look| look.time_s = f64::NAN,
            |look| look.clutter_per_m2 = -1.0,
            |look| look.clutter_per_m2 = f64::INFINITY,
            |look| look.platform.as_mut().unwrap().position_m.z = f64::NAN,
            |look| look.platform.as_mut().unwrap().velocity_m_per_s.y = f64::INFINITY,
            |look| look.coverage.detection_probability = 1.1,
            |look| look.coverage.minimum_detectable_m_per_s = Some(-1.0),
            |look| look.coverage.area = with_sector([f64::NAN, 0.5, 10.0, 50.0]),
            |look| look.coverage.area = with_sector([3.0, -0.5, 10.0, 50.0]),
            |look| look.coverage.area = with_sector([3.0, 0.5, -1.0, 50.0]),
            |look| look.coverage.area = with_sector([3.0, 0.5, 10.0, 5.0]),
            |look| look.coverage.detection_probability = f64::NAN,
        ];
        for spoil in spoilt {
            let plots = [plot()];
            let mut look = look(&plots);
            spoil(&mut look);
            assert!(matches!(look.check(None), Err(LookError::Unusable { .. })), "{look:?}");
        }
    }

    fn with_sector([direction_rad, half_width_rad, min_range_m, max_range_m]: [f64; 4]) -> Area {
        let origin_m = Vector2::zeros();
        Area::Sector { origin_m, direction_rad, half_width_rad, min_range_m, max_range_m }
    }

    #[test]
    fn every_number_of_a_plot_is_checked() {
        let spoilt: [fn(&mut Plot); 9] = [
            |plot| plot.position_m.x = f64::NAN,
            |plot| plot.covariance_m2 = Matrix2::zeros(),
            |plot| plot.covariance_m2 = Matrix2::new(4.0, 6.0, 6.0, 9.0),
            |plot| plot.covariance_m2 = -Matrix2::identity(),
            |plot| plot.covariance_m2[(0, 1)] = f64::NAN,
            |plot| plot.radial.as_mut().unwrap().velocity_m_per_s = f64::NAN,
            |plot| plot.radial.as_mut().unwrap().sigma_m_per_s = 0.0,
            |plot| plot.radial.as_mut().unwrap().wrap_m_per_s = Some(0.0),
            |plot| plot.strength_db = Some(f64::NEG_INFINITY),
        ];
        for spoil in spoilt {
            let mut plots = [plot(), plot()];
            spoil(&mut plots[1]);
            let refused = look(&plots).check(None);
            assert!(matches!(refused, Err(LookError::Unusable { .. })), "{plots:?}");
        }
    }

    #[test]
    fn complaints_hold_the_look_and_the_number() {
        let mut sure = look(&[]);
        sure.coverage.detection_probability = 1.5;
        assert_eq!(complaint(&sure), "tracking look 2 of sensor 1: detection probability is 1.5");
        let late = look(&[]).check(Some(5.5)).unwrap_err();
        assert_eq!(
            late.to_string(),
            "tracking look 2 of sensor 1: taken at 5 s, after one of 5.5 s was heard"
        );
    }
}
