//! Checks of the solvers' settings.

use thiserror::Error;

use super::SolverConfig;

/// A solver's setting that makes no sense.
#[derive(Clone, Debug, Error, PartialEq)]
#[error("solver.{name} is {value}: use {least} to {most}")]
pub struct InvalidSolver {
    name: &'static str,
    value: f64,
    least: f64,
    most: f64,
}

impl SolverConfig {
    /// Checks every field.
    ///
    /// # Errors
    /// Names the first field that makes no sense, its value and what would do.
    pub fn check(&self) -> Result<(), InvalidSolver> {
        let Self { decision, default, swarm, graph, l2, .. } = self;
        let count = |count: usize| count as f64;
        for (name, value, least, most) in [
            ("decision.min_matched_count", count(decision.min_matched_count), 3.0, 1e6),
            ("decision.min_matched_share", decision.min_matched_share, 0.0, 1.0),
            ("decision.min_distinct_count", count(decision.min_distinct_count), 2.0, 1e6),
            ("decision.distinct_distance_m", decision.distinct_distance_m, 0.0, 100.0),
            ("decision.min_log_odds", decision.min_log_odds, 0.0, 1e3),
            ("decision.min_rival_log_odds", decision.min_rival_log_odds, 0.0, 1e3),
            ("decision.max_rival_share", decision.max_rival_share, 0.0, 1.0),
            ("decision.max_symmetric_share", decision.max_symmetric_share, 0.0, 1.0),
            ("decision.max_position_sigma_m", decision.max_position_sigma_m, 1e-3, 100.0),
            ("decision.max_heading_sigma_deg", decision.max_heading_sigma_deg, 1e-2, 180.0),
            ("decision.prior_half_width_m", decision.prior_half_width_m, 1.0, 1e5),
            ("default.min_baseline_m", default.min_baseline_m, 0.0, 100.0),
            ("default.length_gate_sigma", default.length_gate_sigma, 0.5, 100.0),
            ("default.exhaustive_pair_limit", count(default.exhaustive_pair_limit), 0.0, 1e9),
            ("default.max_hypothesis_count", count(default.max_hypothesis_count), 1.0, 1e6),
            ("default.ranking_point_count", count(default.ranking_point_count), 1.0, 1e6),
            ("default.mode_count", count(default.mode_count), 2.0, 1e3),
            ("default.merge_distance_m", default.merge_distance_m, 1e-6, 10.0),
            ("default.certificate_visit_count", count(default.certificate_visit_count), 0.0, 1e9),
            ("swarm.particle_count", count(swarm.particle_count), 1.0, 1e6),
            ("swarm.iteration_count", count(swarm.iteration_count), 1.0, 1e6),
            ("swarm.sector_count", count(swarm.sector_count), 1.0, 3600.0),
            ("swarm.half_width_m", swarm.half_width_m, 0.1, 1e5),
            ("swarm.covariance_scale", swarm.covariance_scale, 1e-3, 1e3),
            ("swarm.inertia", swarm.inertia, 0.0, 2.0),
            ("swarm.own_pull", swarm.own_pull, 0.0, 10.0),
            ("swarm.swarm_pull", swarm.swarm_pull, 0.0, 10.0),
            ("swarm.stop_below_per_m2", swarm.stop_below_per_m2, -1e12, 0.0),
            ("graph.common_count", count(graph.common_count), 0.0, 1e6),
            ("graph.max_candidate_count", count(graph.max_candidate_count), 1.0, 5e3),
            ("graph.max_branch_count", count(graph.max_branch_count), 0.0, 1e9),
            ("l2.covariance_scale", l2.covariance_scale, 1e-3, 1e3),
            ("l2.relative_gap", l2.relative_gap, 1e-6, 1.0),
            ("l2.max_box_count", count(l2.max_box_count), 1.0, 1e9),
        ] {
            if !(least..=most).contains(&value) {
                return Err(InvalidSolver { name, value, least, most });
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nonsense_is_named_with_its_remedy() {
        assert_eq!(SolverConfig::default().check(), Ok(()));
        let mut config = SolverConfig::default();
        config.swarm.inertia = f64::NAN;
        let complaint = config.check().unwrap_err().to_string();
        assert_eq!(complaint, "solver.swarm.inertia is NaN: use 0 to 2");
        let mut unbounded = SolverConfig::default();
        unbounded.graph.max_candidate_count = 1_000_000;
        assert!(unbounded.check().unwrap_err().to_string().contains("graph.max_candidate_count"));
        let mut endless = SolverConfig::default();
        endless.l2.relative_gap = 0.0;
        assert!(endless.check().unwrap_err().to_string().contains("l2.relative_gap"));
    }
}
