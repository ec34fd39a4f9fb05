//! Where a radar that images by itself has seen people: the sum of its points' Gaussians.

use std::collections::VecDeque;

use nalgebra::Vector2;
use proto::measured::MeasuredPoint;
use proto::radar::Grid;

/// Points kept; the oldest give way.
const MAX_POINT_COUNT: usize = 4096;
/// Pixels of the larger side.
const PIXEL_COUNT: f64 = 200.0;
/// Room around the points, metres.
const BORDER_M: f64 = 0.5;
/// Beyond this many standard deviations a Gaussian adds nothing that would show.
const REACH_SIGMA: f64 = 4.0;

/// The points of a recording so far.
#[derive(Clone, Debug, Default)]
pub struct Density {
    points: VecDeque<MeasuredPoint>,
}

impl Density {
    /// Adds the points of one period.
    pub fn add(&mut self, points: &[MeasuredPoint]) {
        self.points.extend(points.iter().cloned());
        let surplus = self.points.len().saturating_sub(MAX_POINT_COUNT);
        self.points.drain(..surplus);
    }

    /// The grid that holds all points and the density's square root on it, so that decibels of
    /// amplitude are decibels of density. `None` without points.
    #[must_use]
    pub fn image(&self) -> Option<(Grid, Vec<f32>)> {
        let grid = self.grid()?;
        let mut density = vec![0.0_f32; grid.pixel_count()];
        for point in &self.points {
            add_gaussian(&mut density, &grid, point);
        }
        density.iter_mut().for_each(|value| *value = value.sqrt());
        Some((grid, density))
    }

    fn grid(&self) -> Option<Grid> {
        let bounds = |of: fn(&MeasuredPoint) -> f64| {
            let values = self.points.iter().map(of);
            values.fold(None, |range: Option<(f64, f64)>, value| {
                let (least, most) = range.unwrap_or((value, value));
                Some((least.min(value), most.max(value)))
            })
        };
        let (left_m, right_m) = bounds(|point| point.x_m)?;
        let (bottom_m, top_m) = bounds(|point| point.y_m)?;
        let side_m = (right_m - left_m).max(top_m - bottom_m) + 2.0 * BORDER_M;
        let pixel_m = side_m / PIXEL_COUNT;
        let count = |from_m: f64, to_m: f64| {
            let pixels = ((to_m - from_m + 2.0 * BORDER_M) / pixel_m).ceil();
            super::to_u32(pixels.clamp(2.0, PIXEL_COUNT)) as usize
        };
        Some(Grid {
            x_min_m: left_m - BORDER_M,
            y_min_m: bottom_m - BORDER_M,
            pixel_m,
            column_count: count(left_m, right_m),
            row_count: count(bottom_m, top_m),
        })
    }
}

fn add_gaussian(density: &mut [f32], grid: &Grid, point: &MeasuredPoint) {
    let position = point.position();
    let Some(information) = position.cov_m2.try_inverse() else { return };
    let peak = information.determinant().max(0.0).sqrt();
    let reach = |variance: f64, middle_m: f64, from_m: f64, count: usize| {
        let half_m = REACH_SIGMA * variance.sqrt();
        let index = |at_m: f64| super::to_u32(((at_m - from_m) / grid.pixel_m).floor()) as usize;
        index(middle_m - half_m)..(index(middle_m + half_m) + 2).min(count)
    };
    let rows = reach(position.cov_m2[(1, 1)], point.y_m, grid.y_min_m, grid.row_count);
    let columns = reach(position.cov_m2[(0, 0)], point.x_m, grid.x_min_m, grid.column_count);
    for row in rows {
        for column in columns.clone() {
            let away = Vector2::new(grid.x_m(column), grid.y_m(row)) - position.mean.coords_m;
            let value = peak * (-0.5 * away.dot(&(information * away))).exp();
            #[expect(clippy::cast_possible_truncation, reason = "a shade needs no more")]
            let single = value as f32;
            density[row * grid.column_count + column] += single;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn point(x_m: f64, y_m: f64) -> MeasuredPoint {
        MeasuredPoint {
            x_m,
            y_m,
            cov_m2: [0.04, 0.0, 0.04],
            snr_db: 0.0,
            extent_m2: [0.0; 3],
            radial_velocity_m_per_s: None,
        }
    }

    #[test]
    fn the_density_is_highest_where_most_points_are() {
        let mut density = Density::default();
        assert!(density.image().is_none());
        density.add(&[point(1.0, 2.0), point(1.0, 2.0), point(-3.0, 5.0)]);
        let (grid, values) = density.image().unwrap();
        let strongest = (0..values.len()).max_by(|a, b| values[*a].total_cmp(&values[*b])).unwrap();
        let (row, column) = (strongest / grid.column_count, strongest % grid.column_count);
        assert!((grid.x_m(column) - 1.0).abs() <= grid.pixel_m);
        assert!((grid.y_m(row) - 2.0).abs() <= grid.pixel_m);
    }

    #[test]
    fn memory_is_bounded() {
        let mut density = Density::default();
        for _ in 0..100 {
            density.add(&vec![point(0.0, 1.0); 100]);
        }
        assert_eq!(density.points.len(), MAX_POINT_COUNT);
    }
}
