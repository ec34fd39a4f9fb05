//! How far the scene itself looks the same under the motion from one pose to another.
//!
//! With the best pose `T_b` and another `T_o`, `G = T_o T_b⁻¹` moves the reference frame. If the
//! points of both sides, laid together by `T_b`, are carried by `G` onto other points of the same
//! period, then the two poses explain the targets alike, and which of them matches more points is
//! an accident of misses. The share of points so carried is corrected for chance,
//! `share = (f − f₀) / (1 − f₀)`, `f₀ = 1 − exp(−Σ gate areas / A)`. A partner that lies where the
//! point itself lies does not count: small motions are not symmetries.

use std::f64::consts::PI;

use super::prepared::{Blob, Motion, Prepared};

/// Squared Mahalanobis distance up to which a point is a partner: six standard deviations, because
/// the motion carries the errors of two poses.
const PARTNER_CHI_SQUARE: f64 = 36.0;

/// Share of points, 0 to 1, that the motion from `best` to `other` carries onto other points.
pub(super) fn symmetric_share(data: &Prepared, best: &Motion, other: &Motion) -> f64 {
    let motion = between(best, other);
    let (mut carried, mut by_chance, mut count) = (0.0, 0.0, 0.0);
    let mut together: Vec<Blob> = Vec::new();
    for span in &data.spans {
        together.clear();
        together.extend(&data.refs[span.refs.clone()]);
        together.extend(data.nodes[span.nodes.clone()].iter().map(|node| best.apply(node)));
        for point in &together {
            let moved = motion.apply(point);
            let is_partner = |blob: &Blob| is_near(&moved, blob) && !is_near(point, blob);
            carried += f64::from(u8::from(together.iter().any(is_partner)));
            let area: f64 = together.iter().map(|blob| gate_area_m2(&moved, blob)).sum();
            by_chance += -(-area / data.area_m2).exp_m1();
            count += 1.0;
        }
    }
    let (found, expected) = (carried / count, by_chance / count);
    ((found - expected) / (1.0 - expected).max(f64::EPSILON)).clamp(0.0, 1.0)
}

/// `T_o T_b⁻¹`.
fn between(best: &Motion, other: &Motion) -> Motion {
    let cos = other.cos * best.cos + other.sin * best.sin;
    let sin = other.sin * best.cos - other.cos * best.sin;
    let mut motion = Motion { x: 0.0, y: 0.0, cos, sin };
    let (x, y) = motion.turned(best.x, best.y);
    (motion.x, motion.y) = (other.x - x, other.y - y);
    motion
}

fn sum_of_covariances(a: &Blob, b: &Blob) -> (f64, f64, f64) {
    (a.xx + b.xx, a.xy + b.xy, a.yy + b.yy)
}

fn is_near(a: &Blob, b: &Blob) -> bool {
    let (xx, xy, yy) = sum_of_covariances(a, b);
    let (dx, dy) = (a.x - b.x, a.y - b.y);
    dx * dx * yy - 2.0 * dx * dy * xy + dy * dy * xx < PARTNER_CHI_SQUARE * (xx * yy - xy * xy)
}

fn gate_area_m2(a: &Blob, b: &Blob) -> f64 {
    let (xx, xy, yy) = sum_of_covariances(a, b);
    PI * PARTNER_CHI_SQUARE * (xx * yy - xy * xy).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulate::{Conditions, Sampler, Trial, line_paths, trial};

    fn truth(case: &Trial) -> Motion {
        let theta = case.truth();
        Motion::new(theta.x, theta.y, theta.z)
    }

    #[test]
    fn half_a_turn_about_the_middle_of_mirrored_targets_is_a_symmetry() {
        let paths = line_paths(&[[[2.0, 3.0], [8.0, 8.0]], [[8.0, 7.0], [2.0, 2.0]]], 8);
        let case = Sampler::new(5).observe(&paths, &Conditions::MISSES);
        let data = Prepared::new(&case.problem);
        let best = truth(&case);
        // Half a turn about (5, 5) of the world, which is (0, 5) of the reference.
        let turned = Motion { x: -best.x, y: 10.0 - best.y, cos: -best.cos, sin: -best.sin };
        assert!(symmetric_share(&data, &best, &turned) > 0.6);
        assert!(symmetric_share(&data, &turned, &best) > 0.6);
        assert!(symmetric_share(&data, &best, &best) < 0.1);
        let elsewhere = Motion { x: turned.x + 1.0, ..turned };
        assert!(symmetric_share(&data, &best, &elsewhere) < 0.4);
    }

    #[test]
    fn the_paper_scene_has_no_symmetry_of_half_a_turn() {
        let case = trial(&Conditions::CLEAN, 5);
        let data = Prepared::new(&case.problem);
        let best = truth(&case);
        let turned = Motion { x: -best.x, y: 10.0 - best.y, cos: -best.cos, sin: -best.sin };
        assert!(symmetric_share(&data, &best, &turned) < 0.3);
    }

    #[test]
    fn the_motion_between_two_poses_leads_from_the_one_to_the_other() {
        let (best, other) = (Motion::new(1.0, -2.0, 2.9), Motion::new(-3.0, 0.5, -1.2));
        let point = Blob { x: 0.7, y: 4.0, xx: 0.04, xy: 0.01, yy: 0.02 };
        let (found, expected) =
            (between(&best, &other).apply(&best.apply(&point)), other.apply(&point));
        assert!((found.x - expected.x).hypot(found.y - expected.y) < 1e-12);
        assert!((found.xx - expected.xx).abs() + (found.xy - expected.xy).abs() < 1e-12);
    }
}
