//! The paper's solver: one particle swarm per sector of the heading, the best of all.
//!
//! A particle is `(Δx, Δy, φ)`. Per iteration, for every particle and dimension,
//! `p ← p + v`, `v ← ω v + c₁ r₁ (p_own − p) + c₂ r₂ (p_swarm − p)`, `r₁, r₂` uniform in 0..1
//! \[registration, eqs (19)-(20)\], on the objective of eq. (18) with widened covariances. The
//! velocity is cut so that the particle stays inside its bounds. The start velocity, which the
//! paper leaves open, leads half way to a random point inside the bounds. The paper ends a search
//! below a threshold or after a number of iterations and gives neither: both are settings.
//!
//! The pose is the swarm's as it is. Its covariance is that of the objective's minimum plus the
//! square of the distance from the minimum beside it, which the swarm has not reached.
//! Cost: sectors × particles × iterations × pairs of points.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde::{Deserialize, Serialize};

use super::decide::DecisionConfig;
use super::judged::{Case, l2_covariance};
use super::l2::distance_from_minimum;
use super::objective::l2_value;
use super::prepared::{Motion, Prepared};
use super::{Known, Problem, Solution, Solver};

/// Settings of the particle swarm.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct SwarmConfig {
    /// Seed of all sectors' random streams.
    pub seed: u64,
    /// Particles per sector, the paper's J.
    pub particle_count: usize,
    /// Iterations per sector.
    pub iteration_count: usize,
    /// Sectors of equal width into which the full turn is cut.
    pub sector_count: usize,
    /// Δx and Δy lie within plus and minus this many metres.
    pub half_width_m: f64,
    /// Factor on all covariances in the objective.
    pub covariance_scale: f64,
    /// ω: how much of its velocity a particle keeps.
    pub inertia: f64,
    /// c₁: pull towards the particle's own best.
    pub own_pull: f64,
    /// c₂: pull towards the swarm's best.
    pub swarm_pull: f64,
    /// A sector's search ends early where its objective, 1/m², falls below this.
    pub stop_below_per_m2: f64,
}

impl Default for SwarmConfig {
    fn default() -> Self {
        Self {
            seed: 1,
            particle_count: 500,
            iteration_count: 100,
            sector_count: 36,
            half_width_m: 20.0,
            covariance_scale: 4.0,
            inertia: 0.6,
            own_pull: 0.9,
            swarm_pull: 0.9,
            // The paper names a threshold and no value: never.
            stop_below_per_m2: -1e12,
        }
    }
}

/// The particle swarm solver.
#[derive(Clone, Debug, Default)]
pub struct Swarm {
    config: SwarmConfig,
    decision: DecisionConfig,
}

impl Swarm {
    /// The solver with these settings.
    #[must_use]
    pub fn new(config: SwarmConfig, decision: DecisionConfig) -> Self {
        Self { config, decision }
    }

    /// The best pose of every sector, best first.
    pub(super) fn motions(&self, data: &Prepared) -> Vec<Motion> {
        let mut bests: Vec<(f64, Vector3<f64>)> = (0..self.config.sector_count)
            .into_par_iter()
            .map(|sector| search_sector(data, &self.config, sector))
            .collect();
        bests.sort_by(|a, b| a.0.total_cmp(&b.0));
        bests.iter().map(|(_, best)| Motion::new(best.x, best.y, best.z)).collect()
    }
}

impl Solver for Swarm {
    fn name(&self) -> &'static str {
        "swarm"
    }

    fn solve(&self, problem: &Problem, _known: Option<&Known>) -> Solution {
        let data = Prepared::new(problem);
        let case = Case::new(&data, problem, &self.decision);
        if data.spans.is_empty() || self.config.particle_count == 0 {
            return case.nothing_found();
        }
        let motions = self.motions(&data);
        let Some((found, others)) = motions.split_first() else { return case.nothing_found() };
        let scale = self.config.covariance_scale;
        case.judge(found, others, |mode| {
            let of_minimum = l2_covariance(&data, mode, scale)?;
            Some(of_minimum + distance_from_minimum(&data, found, scale))
        })
    }
}

/// Bounds of one sector: lower corner and widths of `(Δx, Δy, φ)`.
struct Bounds {
    low: Vector3<f64>,
    width: Vector3<f64>,
}

impl Bounds {
    fn of_sector(config: &SwarmConfig, sector: usize) -> Self {
        let sector_width = TAU / config.sector_count as f64;
        let start = -0.5 * TAU + sector as f64 * sector_width;
        let half = config.half_width_m;
        Self {
            low: Vector3::new(-half, -half, start),
            width: Vector3::new(2.0 * half, 2.0 * half, sector_width),
        }
    }

    fn draw(&self, rng: &mut ChaCha8Rng) -> Vector3<f64> {
        self.low + self.width.map(|width| width * rng.random::<f64>())
    }

    /// The velocity cut so that `position + velocity` lies inside.
    fn cut(&self, position: &Vector3<f64>, velocity: &Vector3<f64>) -> Vector3<f64> {
        let target = position + velocity;
        target.sup(&self.low).inf(&(self.low + self.width)) - position
    }
}

struct Particle {
    position: Vector3<f64>,
    velocity: Vector3<f64>,
    best: Vector3<f64>,
    best_value: f64,
}

impl Particle {
    fn draw(bounds: &Bounds, rng: &mut ChaCha8Rng) -> Self {
        let position = bounds.draw(rng);
        let velocity = (bounds.draw(rng) - position) * 0.5;
        Self { position, velocity, best: position, best_value: f64::INFINITY }
    }
}

fn search_sector(data: &Prepared, config: &SwarmConfig, sector: usize) -> (f64, Vector3<f64>) {
    let mut rng = ChaCha8Rng::seed_from_u64(config.seed);
    rng.set_stream(sector as u64);
    let bounds = Bounds::of_sector(config, sector);
    let mut particles: Vec<Particle> =
        (0..config.particle_count).map(|_| Particle::draw(&bounds, &mut rng)).collect();
    let mut swarm_best = (f64::INFINITY, bounds.low);
    for _ in 0..config.iteration_count.max(1) {
        for particle in &mut particles {
            rate(data, config.covariance_scale, particle);
            if particle.best_value < swarm_best.0 {
                swarm_best = (particle.best_value, particle.best);
            }
        }
        if swarm_best.0 < config.stop_below_per_m2 {
            break;
        }
        for particle in &mut particles {
            fly(config, &bounds, (particle, &swarm_best.1), &mut rng);
        }
    }
    swarm_best
}

fn rate(data: &Prepared, covariance_scale: f64, particle: &mut Particle) {
    let position = particle.position;
    let value = l2_value(data, &Motion::new(position.x, position.y, position.z), covariance_scale);
    if value < particle.best_value {
        (particle.best_value, particle.best) = (value, position);
    }
}

fn fly(
    config: &SwarmConfig,
    bounds: &Bounds,
    (particle, swarm_best): (&mut Particle, &Vector3<f64>),
    rng: &mut ChaCha8Rng,
) {
    particle.velocity = bounds.cut(&particle.position, &particle.velocity);
    particle.position += particle.velocity;
    for axis in 0..3 {
        let (own, common): (f64, f64) = (rng.random(), rng.random());
        particle.velocity[axis] = config.inertia * particle.velocity[axis]
            + config.own_pull * own * (particle.best[axis] - particle.position[axis])
            + config.swarm_pull * common * (swarm_best[axis] - particle.position[axis]);
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Missing, Outcome};
    use super::*;
    use crate::simulate::{Conditions, trial};

    #[test]
    fn lands_in_the_box_of_the_paper() {
        for seed in 0..3 {
            let case = trial(&Conditions::CLEAN, seed);
            let solution = Swarm::default().solve(&case.problem, None);
            let error = case.error(&solution.estimate.unwrap());
            assert!(error.xy().norm() < 0.05 && error.z.abs().to_degrees() < 1.0, "{error:?}");
            assert_eq!(solution.outcome, Outcome::Determined);
        }
    }

    #[test]
    fn the_result_does_not_depend_on_threads() {
        let case = trial(&Conditions::CLEAN, 0);
        let small = || {
            let config =
                SwarmConfig { particle_count: 120, iteration_count: 60, ..SwarmConfig::default() };
            Swarm::new(config, DecisionConfig::default())
        };
        let solve = |thread_count: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(thread_count).build().unwrap();
            pool.install(|| small().solve(&case.problem, None))
        };
        let one = solve(1);
        assert!(one.estimate.is_some());
        for thread_count in [2, 5] {
            assert_eq!(solve(thread_count), one, "{thread_count}");
        }
    }

    #[test]
    fn a_step_is_that_of_the_equations() {
        let config = SwarmConfig::default();
        let bounds = Bounds::of_sector(&config, 20);
        let mut start_rng = ChaCha8Rng::seed_from_u64(9);
        let mut particle = Particle::draw(&bounds, &mut start_rng);
        particle.best = bounds.draw(&mut start_rng);
        let swarm_best = bounds.draw(&mut start_rng);
        let (old, start, own) = (particle.velocity, particle.position, particle.best);
        let (mut rng, mut same_draws) =
            (ChaCha8Rng::seed_from_u64(10), ChaCha8Rng::seed_from_u64(10));
        fly(&config, &bounds, (&mut particle, &swarm_best), &mut rng);
        for axis in 0..3 {
            let (r1, r2): (f64, f64) = (same_draws.random(), same_draws.random());
            let position = start[axis] + old[axis];
            let velocity = 0.6 * old[axis]
                + 0.9 * r1 * (own[axis] - position)
                + 0.9 * r2 * (swarm_best[axis] - position);
            assert!((particle.position[axis] - position).abs() < 1e-12);
            assert!((particle.velocity[axis] - velocity).abs() < 1e-12);
        }
    }

    #[test]
    fn a_reached_threshold_ends_a_sector() {
        let case = trial(&Conditions::CLEAN, 0);
        let data = Prepared::new(&case.problem);
        let full = SwarmConfig { particle_count: 60, ..SwarmConfig::default() };
        // Any overlap is below this.
        let early = SwarmConfig { stop_below_per_m2: -1e-3, ..full.clone() };
        let sector = 18;
        let (soon, late) =
            (search_sector(&data, &early, sector).0, search_sector(&data, &full, sector).0);
        assert!(soon < -1e-3 && soon > late, "{soon} {late}");
    }

    #[test]
    fn particles_stay_inside_their_sector() {
        let config = SwarmConfig::default();
        let bounds = Bounds::of_sector(&config, 35);
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let mut particle = Particle::draw(&bounds, &mut rng);
        for _ in 0..200 {
            particle.velocity *= 30.0;
            fly(&config, &bounds, (&mut particle, &bounds.low), &mut rng);
            let inside = (particle.position - bounds.low).min() > -1e-9
                && (bounds.low + bounds.width - particle.position).min() > -1e-9;
            assert!(inside, "{:?}", particle.position);
        }
        assert!((bounds.low.z + bounds.width.z - 0.5 * TAU).abs() < 1e-12);
    }

    #[test]
    fn nothing_shared_is_underdetermined() {
        let solution = Swarm::default().solve(&Problem::default(), None);
        let missing = Missing::SharedPeriods { period_count: 0 };
        assert_eq!(solution.outcome, Outcome::Underdetermined { missing });
        assert_eq!(solution.estimate, None);
    }
}
