//! Which plots may be of a track: those whose beam, range, angle and side it can have got to.
//!
//! ```text
//! |b − b_prev| ≤ B_max          |r − r̂| ≤ v_max T + k r_e          |θ − θ̂| ≤ v_max T / r + k θ_e
//! ```
//!
//! The first two are published \[wide-area\]; the third, which can be switched off, bounds
//! continuously what the first bounds in steps. Plots are kept in order of range, so that a track
//! looks at those of its range only.

use nalgebra::Vector3;

use super::config::{AcrossGate, PaperConfig};
use super::decide::Candidate;
use super::degree::{angle_error_rad, degrees, range_error_m};
use super::followed::{Expected, Seen};
use super::geometry::{Gradients, Sight, line};
use crate::tracking::{Look, Platform};

/// Rounding of an angle that is compared by its cosine, radians: far below any error of an angle.
const ROUNDING_RAD: f64 = 1e-7;

/// What lets a pair pass.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gate<'a, 'b> {
    pub(super) config: &'a PaperConfig,
    pub(super) look: &'a Look<'b>,
    pub(super) platform: &'a Platform,
}

/// The plots of a look in ascending order of range.
#[derive(Clone, Debug, Default)]
pub(super) struct Columns {
    list: Vec<Column>,
    /// The largest `r_e` among them.
    max_range_error_m: f64,
    /// No place among them has a larger error in any direction.
    max_sigma_m: f64,
}

/// A plot as the sensor sees it.
#[derive(Clone, Copy, Debug)]
struct Column {
    index: usize,
    line: Vector3<f64>,
    range_m: f64,
    /// `r_e`
    range_error_m: f64,
}

/// What bounds the plots of one track.
#[derive(Clone, Copy, Debug)]
struct Bounds {
    /// `v_max T`
    way_m: f64,
    ranges_m: [f64; 2],
    /// Cosines of the cone angle.
    cosines: [f64; 2],
}

impl Gate<'_, '_> {
    /// Puts the plots of the look into `into`.
    pub(super) fn columns(&self, into: &mut Columns) {
        let plots = self.look.plots;
        into.list.clear();
        into.list.extend(plots.iter().enumerate().map(|(index, plot)| {
            let line = line(self.platform, plot.position_m);
            // The range changes alike whatever the angle is counted from.
            let gradients = Gradients::new(&line, &Vector3::x());
            let range_error_m = range_error_m(self.config, plot, &gradients);
            Column { index, line, range_m: line.norm(), range_error_m }
        }));
        let order = |a: &Column, b: &Column| a.range_m.total_cmp(&b.range_m);
        into.list.sort_by(|a, b| order(a, b).then(a.index.cmp(&b.index)));
        let errors_m = into.list.iter().map(|column| column.range_error_m);
        into.max_range_error_m = errors_m.fold(0.0, f64::max);
        let traces_m2 = plots.iter().map(|plot| plot.covariance_m2.trace());
        into.max_sigma_m = traces_m2.fold(0.0, f64::max).sqrt();
    }

    /// Adds the pairs of the track of place `row`, last `seen` so, to `into`.
    pub(super) fn candidates(
        &self,
        (row, seen): (usize, &Seen),
        expected: &Expected,
        columns: &Columns,
        into: &mut Vec<Candidate>,
    ) {
        if !self.is_beam_near(&seen.platform) {
            return;
        }
        let bounds = self.bounds(expected, columns);
        let ([nearest_m, farthest_m], [least, most]) = (bounds.ranges_m, bounds.cosines);
        let first = columns.list.partition_point(|column| column.range_m < nearest_m);
        let in_range = columns.list[first..].iter().take_while(|c| c.range_m <= farthest_m);
        let is_in_angle = |column: &&Column| {
            let along_m = expected.way.along.dot(&column.line);
            least * column.range_m <= along_m && along_m <= most * column.range_m
        };
        let pair = |column| self.candidate((row, seen), expected, column, bounds.way_m);
        into.extend(in_range.filter(is_in_angle).filter_map(pair));
    }

    fn is_beam_near(&self, before: &Platform) -> bool {
        let beams = self.platform.beam_index.zip(before.beam_index);
        beams.is_none_or(|(new, old)| new.abs_diff(old) <= self.config.max_beam_step)
    }

    /// No narrower than the gates: their errors are those of the plots, here the largest stands for
    /// all. A place with the error `σ` has `θ_e ≤ σ / r`.
    fn bounds(&self, expected: &Expected, columns: &Columns) -> Bounds {
        let PaperConfig { gate_sigma_count, max_speed_m_per_s, .. } = self.config;
        let way_m = max_speed_m_per_s * expected.dt_s;
        let half_m = way_m + gate_sigma_count * columns.max_range_error_m;
        let Sight { range_m, cone_rad, .. } = expected.sight;
        let nearest_m = (range_m - half_m).max(f64::MIN_POSITIVE);
        let error_rad = (columns.max_sigma_m / nearest_m).max(self.config.angle_error_rad);
        let half_rad = way_m / nearest_m + gate_sigma_count * error_rad + ROUNDING_RAD;
        let angles_rad = [cone_rad + half_rad, cone_rad - half_rad];
        let cosines = match self.config.across {
            AcrossGate::Beams => [-f64::INFINITY, f64::INFINITY],
            AcrossGate::BeamsAndAngle => {
                angles_rad.map(|a| a.clamp(0.0, std::f64::consts::PI).cos())
            }
        };
        Bounds { way_m, ranges_m: [nearest_m, range_m + half_m], cosines }
    }

    fn candidate(
        &self,
        (row, before): (usize, &Seen),
        expected: &Expected,
        column: &Column,
        way_m: f64,
    ) -> Option<Candidate> {
        let config = self.config;
        let off_m = (column.range_m - expected.sight.range_m).abs();
        if way_m + config.gate_sigma_count * column.range_error_m < off_m {
            return None;
        }
        let seen = Sight::new(&column.line, &expected.way.along);
        if seen.side * expected.sight.side < 0.0 {
            return None;
        }
        let plot = &self.look.plots[column.index];
        let gradients = Gradients::new(&column.line, &expected.way.along);
        let error_rad = angle_error_rad(config, plot, &gradients);
        let is_near = config.across == AcrossGate::Beams
            || self.is_angle_near(&seen, expected, (way_m, error_rad));
        let degrees =
            || degrees(config, (&expected.sight, &before.plot), (&seen, plot), &gradients);
        is_near.then(|| Candidate { row, column: column.index, degrees: degrees() })
    }

    fn is_angle_near(
        &self,
        seen: &Sight,
        expected: &Expected,
        (way_m, error_rad): (f64, f64),
    ) -> bool {
        let off_rad = (seen.cone_rad - expected.sight.cone_rad).abs();
        let way_rad = way_m / seen.range_m.max(f64::MIN_POSITIVE);
        off_rad <= way_rad + self.config.gate_sigma_count * error_rad
    }
}
