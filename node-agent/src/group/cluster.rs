//! Clusters of points by density.
//!
//! A point with at least `min_count` points (itself among them) within `radius` is a *core*.
//! Cores within `radius` of each other belong together; a point that is no core joins its nearest
//! core within `radius`; all others are noise. This is DBSCAN (Ester et al. 1996), except that
//! the nearest core takes a border point instead of the first one visited, so that the result
//! does not depend on the order of the points.

/// Indices of the members of each cluster, ascending; clusters in the order of their first
/// member. `positions_m` are `[x, y]` in metres. Cost: `n²` distances.
pub(super) fn clusters(
    positions_m: &[[f64; 2]],
    radius_m: f64,
    min_count: usize,
) -> Vec<Vec<usize>> {
    let near = |a: usize, b: usize| distance_m(positions_m[a], positions_m[b]) <= radius_m;
    let count = positions_m.len();
    let is_core: Vec<bool> =
        (0..count).map(|a| min_count <= (0..count).filter(|&b| near(a, b)).count()).collect();
    let core_labels = connect(&is_core, near);
    let label_of = |index: usize| {
        let cores = (0..count).filter(|&core| is_core[core] && near(index, core));
        let gap_m = |core: &usize| distance_m(positions_m[index], positions_m[*core]);
        cores.min_by(|a, b| gap_m(a).total_cmp(&gap_m(b))).map(|core| core_labels[core])
    };
    let labels: Vec<Option<usize>> = (0..count).map(label_of).collect();
    members_by_label(&labels)
}

/// Gives every core the smallest index of the cores that it is connected with.
fn connect(is_core: &[bool], near: impl Fn(usize, usize) -> bool) -> Vec<usize> {
    let mut labels: Vec<usize> = (0..is_core.len()).collect();
    let mut visited: Vec<bool> = is_core.iter().map(|core| !core).collect();
    for seed in 0..is_core.len() {
        let mut open = if visited[seed] { Vec::new() } else { vec![seed] };
        visited[seed] = true;
        while let Some(core) = open.pop() {
            labels[core] = seed;
            let unvisited = (seed..is_core.len()).filter(|&next| !visited[next]);
            let reached: Vec<usize> = unvisited.filter(|&next| near(core, next)).collect();
            reached.iter().for_each(|&next| visited[next] = true);
            open.extend(reached);
        }
    }
    labels
}

fn members_by_label(labels: &[Option<usize>]) -> Vec<Vec<usize>> {
    let mut seen: Vec<usize> = Vec::new();
    let mut members: Vec<Vec<usize>> = Vec::new();
    for (index, label) in labels.iter().enumerate() {
        let Some(label) = label else { continue };
        let place = seen.iter().position(|known| known == label).unwrap_or(seen.len());
        if place == seen.len() {
            seen.push(*label);
            members.push(Vec::new());
        }
        members[place].push(index);
    }
    members
}

fn distance_m(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

#[cfg(test)]
mod tests {
    use rand::rngs::ChaCha8Rng;
    use rand::{RngExt, SeedableRng};

    use super::*;

    /// The oracle: the transitive closure of "cores within the radius", by brute force, and each
    /// border point asked in turn.
    fn same_cluster(positions_m: &[[f64; 2]], radius_m: f64, min_count: usize) -> Vec<Vec<bool>> {
        let n = positions_m.len();
        let gap_m = |a: usize, b: usize| {
            let [dx, dy] = [0, 1].map(|k| positions_m[a][k] - positions_m[b][k]);
            (dx * dx + dy * dy).sqrt()
        };
        let degree = |a: usize| (0..n).filter(|&b| gap_m(a, b) <= radius_m).count();
        let core: Vec<bool> = (0..n).map(|a| min_count <= degree(a)).collect();
        let mut linked: Vec<Vec<bool>> = (0..n)
            .map(|a| (0..n).map(|b| core[a] && core[b] && gap_m(a, b) <= radius_m).collect())
            .collect();
        let pairs = || (0..n).flat_map(|a| (0..n).map(move |b| (a, b)));
        for via in 0..n {
            pairs().for_each(|(a, b)| linked[a][b] |= linked[a][via] && linked[via][b]);
        }
        let home: Vec<Option<usize>> = (0..n)
            .map(|a| {
                let mut cores: Vec<usize> =
                    (0..n).filter(|&c| core[c] && gap_m(a, c) <= radius_m).collect();
                cores.sort_by(|&c, &d| gap_m(a, c).total_cmp(&gap_m(a, d)));
                cores.first().copied()
            })
            .collect();
        let together = |a: usize, b: usize| match (home[a], home[b]) {
            (Some(c), Some(d)) => linked[c][d],
            _ => false,
        };
        (0..n).map(|a| (0..n).map(|b| together(a, b)).collect()).collect()
    }

    #[test]
    fn members_are_those_of_the_transitive_closure() {
        let mut random = ChaCha8Rng::seed_from_u64(11);
        for trial in 0..200 {
            let count = random.random_range(0..40);
            let mut coordinate = || random.random_range(0.0..4.0);
            let positions_m: Vec<[f64; 2]> =
                (0..count).map(|_| [coordinate(), coordinate()]).collect();
            let min_count = 1 + trial % 6;
            let found = clusters(&positions_m, 0.5, min_count);
            let mut label = vec![None; positions_m.len()];
            for (number, members) in found.iter().enumerate() {
                assert!(members.is_sorted());
                members.iter().for_each(|&index| label[index] = Some(number));
            }
            assert!(found.is_sorted_by_key(|members| members[0]));
            let together = |a: usize, b: usize| label[a].is_some() && label[a] == label[b];
            let all = 0..positions_m.len();
            let labelled: Vec<Vec<bool>> =
                all.clone().map(|a| all.clone().map(|b| together(a, b)).collect()).collect();
            assert_eq!(labelled, same_cluster(&positions_m, 0.5, min_count), "trial {trial}");
        }
    }

    #[test]
    fn a_lone_point_is_noise_unless_one_is_enough() {
        assert_eq!(clusters(&[[0.0, 0.0], [9.0, 0.0]], 0.5, 2), Vec::<Vec<usize>>::new());
        assert_eq!(clusters(&[[0.0, 0.0], [9.0, 0.0]], 0.5, 1), [[0], [1]]);
    }

    #[test]
    fn a_border_point_joins_the_nearer_of_two_clusters() {
        // The last point has three within reach, itself among them: too few for a core of four.
        let xs = [-0.3, -0.2, -0.1, 0.05, 0.92, 1.1, 1.2, 1.3, 0.5];
        let found = clusters(&xs.map(|x| [x, 0.0]), 0.5, 4);
        assert_eq!(found, [vec![0, 1, 2, 3], vec![4, 5, 6, 7, 8]]);
    }
}
