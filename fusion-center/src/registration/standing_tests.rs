//! Long series of people who stand still most of the time, seen with errors that last as long.

use nalgebra::{Matrix2, Vector2};
use rand::rngs::ChaCha8Rng;
use rand::{RngExt, SeedableRng};
use rand_distr::{Exp1, StandardNormal};

use super::{Outcome, Pairwise, Solver};
use crate::simulate::{Conditions, Paths, Sampler, Trial};

const PERIOD_COUNT: usize = 200;
const PERSON_COUNT: usize = 3;
const PERIOD_S: f64 = 0.1;
const SPEED_MPS: f64 = 1.1;
/// Mean time for which somebody stands, seconds.
const STAND_S: f64 = 4.0;
/// Where on a body the echo comes from, one standard deviation per axis, metres: it stays while the
/// person stands and changes within half a second of walking. The points' covariances hold it.
const GLINT_M: f64 = 0.05;
const GLINT_WALK_S: f64 = 0.5;

struct Person {
    at_m: Vector2<f64>,
    goal_m: Vector2<f64>,
    left_s: f64,
    glints_m: [Vector2<f64>; 2],
}

struct Room {
    rng: ChaCha8Rng,
}

impl Room {
    fn place(&mut self) -> Vector2<f64> {
        Vector2::new(self.rng.random_range(1.0..9.0), self.rng.random_range(2.0..8.0))
    }

    fn normal(&mut self) -> Vector2<f64> {
        Vector2::new(self.rng.sample(StandardNormal), self.rng.sample(StandardNormal))
    }

    fn wait_s(&mut self) -> f64 {
        STAND_S * self.rng.sample::<f64, _>(Exp1)
    }

    fn person(&mut self) -> Person {
        Person {
            at_m: self.place(),
            goal_m: self.place(),
            left_s: self.wait_s(),
            glints_m: [self.normal() * GLINT_M, self.normal() * GLINT_M],
        }
    }

    fn step(&mut self, person: &mut Person) {
        if person.left_s > 0.0 {
            person.left_s -= PERIOD_S;
            return;
        }
        let way_m = person.goal_m - person.at_m;
        let length_m = SPEED_MPS * PERIOD_S;
        if way_m.norm() <= length_m {
            person.at_m = person.goal_m;
            person.goal_m = self.place();
            person.left_s = self.wait_s();
        } else {
            person.at_m += way_m.normalize() * length_m;
        }
        let kept = (-PERIOD_S / GLINT_WALK_S).exp();
        let fresh_m = GLINT_M * (1.0 - kept * kept).sqrt();
        for side in 0..2 {
            person.glints_m[side] = person.glints_m[side] * kept + self.normal() * fresh_m;
        }
    }
}

fn room(seed: u64) -> Trial {
    let mut room = Room { rng: ChaCha8Rng::seed_from_u64(seed) };
    room.rng.set_stream(11);
    let mut people: Vec<Person> = (0..PERSON_COUNT).map(|_| room.person()).collect();
    let (mut paths, mut glints) = (Paths::new(), Vec::new());
    for _ in 0..PERIOD_COUNT {
        people.iter_mut().for_each(|person| room.step(person));
        paths.push(people.iter().map(|person| person.at_m).collect());
        glints.push(people.iter().map(|person| person.glints_m).collect::<Vec<_>>());
    }
    let conditions = Conditions { period_s: PERIOD_S, noise_scale: 0.7, ..Conditions::CLEAN };
    let mut case = Sampler::new(seed).observe(&paths, &conditions);
    let stated = Matrix2::identity() * GLINT_M.powi(2);
    for (period, of_people) in case.problem.periods.iter_mut().zip(&glints) {
        for (index, [of_ref, of_node]) in of_people.iter().enumerate() {
            period.in_ref[index].mean.coords_m += of_ref;
            period.in_ref[index].cov_m2 += stated;
            period.in_node[index].mean.coords_m += of_node;
            period.in_node[index].cov_m2 += stated;
        }
    }
    case
}

/// Mean and median of the squared errors in units of the stated covariance, of the determined among
/// these seeds, and how many those are.
fn nees_of(seeds: std::ops::Range<u64>) -> (f64, f64, usize) {
    let solver = Pairwise::default();
    let nees = seeds.filter_map(|seed| {
        let case = room(seed);
        let solution = solver.solve(&case.problem, None);
        let estimate = solution.estimate.filter(|_| solution.outcome == Outcome::Determined)?;
        Some(case.nees(&estimate))
    });
    let mut nees: Vec<f64> = nees.collect();
    nees.sort_by(f64::total_cmp);
    let count = nees.len();
    (nees.iter().sum::<f64>() / count as f64, nees[count / 2], count)
}

/// Half a dozen places per person tell how long errors last, so that the tails stay those of a
/// distribution with few degrees of freedom: the median of three is 2.4, that of Student's with ten
/// is 2.6. Before long runs counted by their length, the mean was 9.8 and the median 6.6.
#[test]
fn sigma_holds_errors_that_last_while_people_stand() {
    let (mean, median, count) = nees_of(0..50);
    assert!(count >= 40 && median < 4.5 && mean < 6.5, "{mean} {median} {count}");
}

#[test]
#[ignore = "minutes: prints the figures of 400 rooms"]
fn study_of_people_who_stand() {
    for first in [1000, 2000] {
        let (mean, median, count) = nees_of(first..first + 200);
        println!(
            "from seed {first}: NEES {mean:.2}, median {median:.2}, {count} of 200 determined"
        );
    }
}
