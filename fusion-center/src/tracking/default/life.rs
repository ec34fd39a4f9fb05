//! Beginnings and ends of tracks, and what a look must be to be taken.

use crate::tracking::{Area, Look, LookError, Plot, Radial};

use super::DefaultTracker;
use super::branch::Branch;
use super::target::Target;
use super::work::NONE;

impl DefaultTracker {
    /// Plots that nobody takes start tracks.
    pub(super) fn begin(&mut self, look: &Look<'_>) {
        for (plot, used) in look.plots.iter().zip(&self.work.used) {
            if *used || self.config.max_track_count <= self.targets.len() {
                continue;
            }
            let branch = Branch::new(look, plot, &self.config);
            let target = Target::new(self.next_id, branch);
            self.next_id += 1;
            self.shown.push(target.track());
            self.targets.push(target);
        }
    }

    /// Ends the tracks that are not believed any more.
    pub(super) fn end(&mut self, now_s: f64) {
        let config = &self.config;
        if !self.targets.iter().any(|target| target.leaf().is_over(now_s, config)) {
            return;
        }
        let mut names: Vec<u32> = Vec::with_capacity(self.targets.len());
        let mut kept = 0;
        for target in &self.targets {
            let is_over = target.leaf().is_over(now_s, config);
            names.push(if is_over { NONE } else { kept });
            kept += u32::from(!is_over);
        }
        self.leave_clusters(&names);
        let mut at = 0;
        self.shown.retain(|_| {
            at += 1;
            names[at - 1] != NONE
        });
        let (ended, limit) = (&mut self.ended, self.config.max_step_count);
        let mut index = 0;
        for target in self.targets.extract_if(.., |_| {
            index += 1;
            names[index - 1] == NONE
        }) {
            ended.push(target, limit);
        }
        self.renumber_clusters();
    }

    /// Takes targets without a new name out of their clusters, and renames the others.
    fn leave_clusters(&mut self, names: &[u32]) {
        for index in 0..self.clusters.len() {
            let mut rest = std::mem::take(&mut self.clusters[index]);
            let places: Vec<usize> = (0..rest.members.len())
                .filter(|place| names[rest.members[*place] as usize] != NONE)
                .collect();
            if places.len() < rest.members.len() {
                rest = rest.about(&places);
            }
            for member in &mut rest.members {
                *member = names[*member as usize];
            }
            self.clusters[index] = rest;
        }
    }

    /// Shows what the look has changed.
    pub(super) fn show(&mut self) {
        for (index, target) in self.targets.iter().enumerate() {
            if self.work.place_of.get(index).is_none_or(|place| *place != NONE) {
                self.shown[index] = target.track();
            }
        }
    }

    /// Forgets what nobody has taken, oldest first, beyond what is remembered.
    pub(super) fn forget(&mut self) {
        let fair = self.config.max_step_count / self.targets.len().max(1);
        let limit = fair.max(self.config.smoothing_looks + 1);
        for target in &mut self.targets {
            target.forget(target.trunk.len().saturating_sub(limit));
        }
    }
}

/// Whether a look makes sense, and does not come too late.
pub(super) fn check(look: &Look<'_>, now_s: Option<f64>) -> Result<(), LookError> {
    let refuse = |what, value: String| {
        let (sensor_index, look_index) = (look.sensor_index, look.look_index);
        Err(LookError::Unusable { sensor_index, look_index, what, value })
    };
    if !look.time_s.is_finite() {
        return refuse("time_s", look.time_s.to_string());
    }
    if let Some((what, value)) = unusable_numbers(look) {
        return refuse(what, value.to_string());
    }
    for plot in look.plots {
        if let Some(what) = unusable(plot) {
            return refuse(what, format!("{plot:?}"));
        }
    }
    match now_s.filter(|now_s| look.time_s < *now_s) {
        None => Ok(()),
        Some(previous_s) => Err(LookError::TooLate {
            sensor_index: look.sensor_index,
            look_index: look.look_index,
            time_s: look.time_s,
            previous_s,
        }),
    }
}

/// The first number of a look's own that is of no use.
fn unusable_numbers(look: &Look<'_>) -> Option<(&'static str, f64)> {
    let coverage = &look.coverage;
    let detection = coverage.detection_probability;
    let slowest = coverage.minimum_detectable_m_per_s.unwrap_or(0.0);
    let positive = |value: f64| value.is_finite() && 0.0 <= value;
    if !(0.0..=1.0).contains(&detection) {
        return Some(("detection_probability", detection));
    }
    if !positive(slowest) {
        return Some(("minimum_detectable_m_per_s", slowest));
    }
    if !positive(look.clutter_per_m2) {
        return Some(("clutter_per_m2", look.clutter_per_m2));
    }
    if let Some(platform) = &look.platform {
        let numbers = platform.position_m.iter().chain(&platform.velocity_m_per_s);
        if let Some(value) = numbers.copied().find(|value| !value.is_finite()) {
            return Some(("platform", value));
        }
    }
    let Area::Sector { origin_m, direction_rad, half_width_rad, min_range_m, max_range_m } =
        coverage.area
    else {
        return None;
    };
    let numbers = [origin_m.x, origin_m.y, direction_rad];
    let lengths = [half_width_rad, min_range_m, max_range_m - min_range_m];
    let wild = numbers.into_iter().find(|value| !value.is_finite());
    wild.or_else(|| lengths.into_iter().find(|value| !positive(*value)))
        .map(|value| ("coverage.area", value))
}

/// What of a plot is of no use.
fn unusable(plot: &Plot) -> Option<&'static str> {
    let r = &plot.covariance_m2;
    let determinant = r[(0, 0)] * r[(1, 1)] - r[(0, 1)] * r[(0, 1)];
    let is_covariance = r.iter().all(|value| value.is_finite())
        && (r[(0, 1)] - r[(1, 0)]).abs() <= 1e-6 * (r[(0, 0)] + r[(1, 1)])
        && 0.0 < r[(0, 0)]
        && 0.0 < determinant;
    let usable_radial = |radial: &Radial| {
        radial.velocity_m_per_s.is_finite()
            && radial.direction.iter().all(|value| value.is_finite())
            && radial.sigma_m_per_s.is_finite()
            && 0.0 < radial.sigma_m_per_s
            && radial.wrap_m_per_s.is_none_or(|period| period.is_finite() && 0.0 < period)
    };
    if !plot.position_m.iter().all(|value| value.is_finite()) {
        return Some("position_m of a plot");
    }
    if !is_covariance {
        return Some("covariance_m2 of a plot");
    }
    if plot.radial.as_ref().is_some_and(|radial| !usable_radial(radial)) {
        return Some("radial of a plot");
    }
    plot.strength_db.is_some_and(|value| !value.is_finite()).then_some("strength_db of a plot")
}
