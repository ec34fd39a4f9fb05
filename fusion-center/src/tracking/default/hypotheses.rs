//! Joint hypotheses of a cluster of targets: which branch of each is the true one.
//!
//! A hypothesis names one branch per member and costs nats; its probability among those that are
//! kept is `exp(−cost) / Σ exp(−cost)`.

/// Hypotheses about the branches of some targets.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Hypotheses {
    /// Which targets, by index.
    pub(super) members: Vec<u32>,
    /// Cost of each hypothesis.
    pub(super) costs: Vec<f64>,
    /// Branch of each member, hypothesis after hypothesis.
    pub(super) leaves: Vec<u16>,
}

impl Hypotheses {
    /// Targets with one branch each.
    pub(super) fn of_singles(members: Vec<u32>) -> Self {
        let leaves = vec![0; members.len()];
        Self { members, costs: vec![0.0], leaves }
    }

    /// How many there are.
    #[cfg(test)]
    pub(super) fn count(&self) -> usize {
        self.costs.len()
    }

    /// The branches of hypothesis `index`.
    pub(super) fn leaves_of(&self, index: usize) -> &[u16] {
        let width = self.members.len();
        &self.leaves[index * width..(index + 1) * width]
    }

    /// The cheapest hypothesis; the first of equals.
    pub(super) fn best(&self) -> usize {
        let mut best = 0;
        for (index, cost) in self.costs.iter().enumerate() {
            if *cost < self.costs[best] {
                best = index;
            }
        }
        best
    }

    /// Probability of each hypothesis.
    pub(super) fn shares(&self) -> Vec<f64> {
        let least = self.costs.iter().copied().fold(f64::INFINITY, f64::min);
        let weights: Vec<f64> = self.costs.iter().map(|cost| (least - cost).exp()).collect();
        let total: f64 = weights.iter().sum();
        weights.into_iter().map(|weight| weight / total).collect()
    }

    /// Both: any hypothesis of `self` with any of `other`, the best `limit` of them.
    pub(super) fn product(&self, other: &Self, limit: usize) -> Self {
        let mut pairs: Vec<(f64, usize, usize)> = Vec::new();
        for (i, a) in self.costs.iter().enumerate() {
            pairs.extend(other.costs.iter().enumerate().map(|(j, b)| (a + b, i, j)));
        }
        pairs.sort_by(|a, b| a.0.total_cmp(&b.0).then((a.1, a.2).cmp(&(b.1, b.2))));
        pairs.truncate(limit);
        let members = self.members.iter().chain(&other.members).copied().collect();
        let mut both = Self { members, costs: Vec::new(), leaves: Vec::new() };
        for (cost, i, j) in pairs {
            both.costs.push(cost);
            both.leaves.extend_from_slice(self.leaves_of(i));
            both.leaves.extend_from_slice(other.leaves_of(j));
        }
        both
    }

    /// Keeps the hypotheses for which `keep` says so of their branches; whether any was dropped.
    pub(super) fn retain(&mut self, mut keep: impl FnMut(&[u16]) -> bool) -> bool {
        let (width, count) = (self.members.len(), self.costs.len());
        let mut kept = 0;
        for index in 0..count {
            if keep(self.leaves_of(index)) {
                self.costs[kept] = self.costs[index];
                self.leaves.copy_within(index * width..(index + 1) * width, kept * width);
                kept += 1;
            }
        }
        self.costs.truncate(kept);
        self.leaves.truncate(kept * width);
        kept < count
    }

    /// Makes costs relative to the best.
    pub(super) fn relate(&mut self) {
        let least = self.costs.iter().copied().fold(f64::INFINITY, f64::min);
        self.costs.iter_mut().for_each(|cost| *cost -= least);
    }

    /// What they say about the members at `places` alone: hypotheses that agree about these become
    /// one, of their summed probability. Costs are relative to the best.
    pub(super) fn about(&self, places: &[usize]) -> Self {
        let shares = self.shares();
        let ln = |share: &f64| -share.max(f64::MIN_POSITIVE).ln();
        if places.len() == self.members.len() {
            let costs = shares.iter().map(ln).collect();
            return Self { members: self.members.clone(), costs, leaves: self.leaves.clone() };
        }
        let mut found: Vec<(Vec<u16>, f64)> = Vec::new();
        for (index, share) in shares.iter().enumerate() {
            let of = self.leaves_of(index);
            let part: Vec<u16> = places.iter().map(|place| of[*place]).collect();
            match found.iter_mut().find(|(leaves, _)| *leaves == part) {
                Some((_, sum)) => *sum += share,
                None => found.push((part, *share)),
            }
        }
        let members = places.iter().map(|place| self.members[*place]).collect();
        let costs = found.iter().map(|(_, share)| ln(share)).collect();
        Self { members, costs, leaves: found.into_iter().flat_map(|(part, _)| part).collect() }
    }

    /// Probability of each value of `of` at the member at `place`, in the order of first mention.
    pub(super) fn shares_by<K: PartialEq>(
        &self,
        place: usize,
        of: impl Fn(u16) -> K,
    ) -> Vec<(K, f64)> {
        let mut sums: Vec<(K, f64)> = Vec::new();
        for (index, share) in self.shares().into_iter().enumerate() {
            let key = of(self.leaves_of(index)[place]);
            match sums.iter_mut().find(|(other, _)| *other == key) {
                Some((_, sum)) => *sum += share,
                None => sums.push((key, share)),
            }
        }
        sums
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Sums of a handful of doubles.
    const TOLERANCE: f64 = 1e-12;

    fn two() -> Hypotheses {
        let costs = vec![2.0_f64.ln(), 4.0_f64.ln(), 4.0_f64.ln()];
        Hypotheses { members: vec![7, 9], costs, leaves: vec![0, 1, 1, 0, 0, 0] }
    }

    #[test]
    fn shares_are_those_of_the_costs() {
        for (share, expected) in two().shares().into_iter().zip([0.5, 0.25, 0.25]) {
            assert!((share - expected).abs() < TOLERANCE);
        }
        let first = two().about(&[0]);
        assert_eq!((&first.members, &first.leaves), (&vec![7], &vec![0, 1]));
        assert!((first.shares()[0] - 0.75).abs() < TOLERANCE);
        let by = two().shares_by(1, |leaf| leaf == 0);
        assert!((by[1].1 - 0.5).abs() < TOLERANCE && by[1].0);
    }

    #[test]
    fn a_product_holds_the_best_pairs() {
        let other = Hypotheses { members: vec![3], costs: vec![1.0, 0.0], leaves: vec![4, 5] };
        let both = two().product(&other, 4);
        assert_eq!(both.members, vec![7, 9, 3]);
        assert_eq!(both.leaves_of(0), &[0, 1, 5]);
        assert_eq!(both.count(), 4);
        assert_eq!(both.best(), 0);
        assert!(both.costs.is_sorted());
        // ln 4 < ln 2 + 1: both of cost ln 4 come before it.
        assert_eq!(both.leaves_of(3), &[0, 1, 4]);
    }

    #[test]
    fn what_is_not_kept_is_gone() {
        let mut kept = two();
        let _dropped = kept.retain(|leaves| leaves[0] == 0);
        assert_eq!((kept.count(), kept.leaves_of(1)), (2, &[0_u16, 0][..]));
    }
}
