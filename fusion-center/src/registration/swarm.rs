//! The paper's solver: one particle swarm per sector of the heading, the best of all.
//!
//! A particle is `(Δx, Δy, φ)`. Per iteration, for every particle and dimension,
//! `p ← p + v`, `v ← ω v + c₁ r₁ (p_own − p) + c₂ r₂ (p_swarm − p)`, `r₁, r₂` uniform in 0..1
//! \[registration, eqs (19)-(20)\], on the objective of eq. (18) with widened covariances. The
//! velocity is cut so that the particle stays inside its bounds. The start velocity, which the
//! paper leaves open, leads half way to a random point inside the bounds. The paper gives no limit
//! of iterations: it is a setting. Cost: sectors × particles × iterations × pairs of points.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rayon::iter::{IntoParallelIterator, ParallelIterator};
use serde::{Deserialize, Serialize};

use super::decide::{DecisionConfig, decide_first};
use super::modes::{Mode, fixed, merged, refine, separated};
use super::objective::l2_value;
use super::prepared::{Motion, Prepared};
use super::{Known, Problem, Solution, Solver};

/// Poses of other sectors that carry the points less than this apart, metres, are one rival.
const RIVAL_DISTANCE_M: f64 = 0.1;

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

    /// The best pose of every sector with its objective, best first.
    fn sector_bests(&self, data: &Prepared) -> Vec<(f64, Vector3<f64>)> {
        let mut bests: Vec<(f64, Vector3<f64>)> = (0..self.config.sector_count)
            .into_par_iter()
            .map(|sector| search_sector(data, &self.config, sector))
            .collect();
        bests.sort_by(|a, b| a.0.total_cmp(&b.0));
        bests
    }
}

impl Solver for Swarm {
    fn name(&self) -> &'static str {
        "swarm"
    }

    fn solve(&self, problem: &Problem, _known: Option<&Known>) -> Solution {
        let data = Prepared::new(problem);
        if data.spans.is_empty() || self.config.particle_count == 0 {
            return decide_first(&data, &[], problem.periods.len(), &self.decision);
        }
        let motions: Vec<Motion> = self
            .sector_bests(&data)
            .iter()
            .map(|(_, best)| Motion::new(best.x, best.y, best.z))
            .collect();
        let modes = modes_of(&data, &motions);
        decide_first(&data, &modes, problem.periods.len(), &self.decision)
    }
}

/// The swarm's pose as it is, then the other sectors' poses, refined so that the decision sees
/// how good they really are.
fn modes_of(data: &Prepared, motions: &[Motion]) -> Vec<Mode> {
    let separate = separated(data, motions, motions.len(), RIVAL_DISTANCE_M);
    let Some((first, others)) = separate.split_first() else { return Vec::new() };
    let Some(best) = fixed(data, *first) else { return Vec::new() };
    let near_best = refine(data, *first);
    let is_other = |mode: &Mode| {
        let climbed = near_best.as_ref().map_or(*first, |refined| refined.motion);
        data.displacement_m(&climbed, &mode.motion) > RIVAL_DISTANCE_M
            && data.displacement_m(first, &mode.motion) > RIVAL_DISTANCE_M
    };
    let rivals = others.iter().filter_map(|m| refine(data, *m)).filter(is_other).collect();
    let mut modes = vec![best];
    modes.extend(merged(data, rivals, RIVAL_DISTANCE_M));
    modes
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

    fn solve_with_threads(problem: &Problem, thread_count: usize) -> Solution {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(thread_count).build().unwrap();
        pool.install(|| Swarm::default().solve(problem, None))
    }

    #[test]
    fn lands_in_the_box_of_the_paper_and_does_not_depend_on_threads() {
        for seed in 0..3 {
            let case = trial(&Conditions::CLEAN, seed);
            let solution = solve_with_threads(&case.problem, 2);
            let error = case.error(&solution.estimate.unwrap());
            assert!(error.xy().norm() < 0.05 && error.z.abs().to_degrees() < 1.0, "{error:?}");
            assert_eq!(solution.outcome, Outcome::Determined);
            if seed == 0 {
                assert_eq!(solution, solve_with_threads(&case.problem, 1));
            }
        }
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
