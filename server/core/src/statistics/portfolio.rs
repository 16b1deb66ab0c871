//! The few configurations that together serve all known states best.
//!
//! It minimises the mean over states of the best member's cost there, relative to the state's own best. This
//! is the price of the portfolio in place of a search. Its reduction is a submodular function of the set. So
//! adding the most helpful member, one after the other, reaches at least 63 % of the reduction by the best
//! portfolio of that size (Nemhauser, Wolsey and Fisher, "An analysis of approximations for maximizing
//! submodular set functions", Mathematical Programming 14, 1978). Portfolios from configurations of other
//! instances: Xu, Hoos and Leyton-Brown, "Hydra", AAAI 2010; Kadioglu, Malitsky, Sellmann and Tierney,
//! "ISAC", ECAI 2010; as the beginning of a search: Feurer et al., "Auto-sklearn 2.0", JMLR 23, 2022.
//!
//! The first member is the best fixed configuration: of those known in many states the one that is best on
//! average, so that no beginning with the portfolio does worse. In that average a configuration's loss in a
//! state is bounded (as in Huber, "Robust estimation of a location parameter", Annals of Mathematical
//! Statistics 35, 1964). Without the bound one state with a threefold gain from an unusual configuration
//! would choose it for all states, at a loss of a few percent in each. Such a state's own best is among the
//! later members, and runs a few frames later.
//!
//! Not every configuration was measured in every state. A missing cost is the sum of a level of the state and
//! an effect of the configuration. The fewer states have seen a configuration, the more its effect is drawn
//! towards that of a mediocre one, so that one lucky scene makes no member.
//!
//! Effects differ in size from state to state: where a build costs most of a frame, all good configurations
//! are far below the mediocre ones. A configuration measured in such a state alone would look better than one
//! that did well everywhere. So every configuration is compared, in the states that both know, with one good
//! configuration that is known in many: the anchor. The common gain of good configurations in a state drops
//! out of the difference. The variance of a state's part in an effect is estimated from configurations that
//! are known in many states. The best fixed configuration is one of these, and so are the next members as
//! long as they help. A configuration that a search found in one state seems most helpful there, because it
//! is the luckiest of hundreds that were measured once each. Such configurations get the remaining places.

/// Number of members of a portfolio.
pub const MEMBERS: usize = 8;
/// Prior and least variance of a state's part in a configuration's effect, and variance of the effects, in
/// squares of logarithms.
const INTERACTION: f64 = 0.1 * 0.1;
const EFFECT: f64 = 0.2 * 0.2;
/// Excess cost of a configuration that cannot be run in a state, as a logarithm.
const INFEASIBLE: f64 = 1.0;
/// Most excess cost of a configuration in a state over the best of those known in many states, as a
/// logarithm, when the first member is chosen.
const EXCESS_MOST: f64 = 0.25;
/// A member that lowers the mean logarithm of costs by less is not worth a measurement.
const HELP_LEAST: f64 = 1e-4;
/// The least help of those known in many states, which are chosen before the others.
const KNOWN_HELP_LEAST: f64 = 2e-3;

/// The median of squares of normal numbers, in variances.
const MEDIAN_SQUARE: f64 = 0.455;

/// Least number of states that prove a difference for a further one.
const PROVING_STATES: usize = 4;
/// Student's factors for 97.5 % and for 84 % with three degrees of freedom.
const T_OF_MEAN: f64 = 3.18;
const T_OF_NEXT: f64 = 1.2;

/// The known cost of one configuration in one state.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum CostEntry {
    /// The cost is unknown.
    Unknown,
    /// The logarithm of its cost, and the variance of that.
    LogCost(f64, f64),
    /// It cannot be run there.
    Infeasible,
}

/// A table of the costs of configurations in states: `rows[state][configuration]`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CostTable {
    /// One row for each state, all of one length.
    pub rows: Vec<Vec<CostEntry>>,
}

impl CostTable {
    /// Whether a configuration is proven to cost less than another one, for a further state of that kind.
    /// Both were measured in at least `PROVING_STATES` states. The mean of the logarithms of their ratios is
    /// below 0 with 97.5 %, and a single one with 84 % (Student's prediction interval, with its factors for
    /// few states rounded up). A state that cannot run the first of them proves the contrary.
    pub fn is_proven(&self, one: usize, reference: usize) -> bool {
        let mut ratios = Vec::new();
        for row in &self.rows {
            match (row.get(one), row.get(reference)) {
                (Some(CostEntry::Infeasible), _) => return false,
                (Some(CostEntry::LogCost(own, own_variance)), Some(CostEntry::LogCost(theirs, variance))) => {
                    ratios.push((own - theirs, own_variance + variance));
                }
                _ => {}
            }
        }
        let count = ratios.len() as f64;
        if ratios.len() < PROVING_STATES {
            return false;
        }
        let mean = ratios.iter().map(|(ratio, _)| ratio).sum::<f64>() / count;
        let spread =
            ratios.iter().map(|(ratio, _)| (ratio - mean) * (ratio - mean)).sum::<f64>() / (count - 1.0);
        let noise = ratios.iter().map(|(_, variance)| variance).sum::<f64>() / count;
        let variance = spread.max(noise);
        let of_mean = libm::sqrt(variance / count);
        let of_next = libm::sqrt(variance * (1.0 + 1.0 / count));
        mean < -T_OF_MEAN * of_mean && mean < -T_OF_NEXT * of_next
    }

    /// The rows in which anything was measured.
    fn measured(&self) -> Vec<&[CostEntry]> {
        let known = |row: &&Vec<CostEntry>| row.iter().any(|known| matches!(known, CostEntry::LogCost(..)));
        self.rows.iter().filter(known).map(Vec::as_slice).collect()
    }

    /// The expected cost of each configuration above the best of its state: logarithms of ratios, 0 for the
    /// best. Rows without anything measured are left out.
    fn completed(&self) -> Vec<Vec<f64>> {
        let rows = self.measured();
        assert!(rows.windows(2).all(|pair| pair[0].len() == pair[1].len()), "rows of one length");
        let mut fit = Fit::new(&rows);
        // Levels and effects in turn, until they fit each other.
        for _ in 0..30 {
            fit.levels = rows.iter().map(|row| fit.level_of(row)).collect();
            fit.effects = fit.effects_over(&rows);
        }
        // Then by each configuration's cost beside the anchor, where both are known.
        let well_known = well_known(&rows);
        let by_effect = |a: &&usize, b: &&usize| fit.effects[**a].total_cmp(&fit.effects[**b]);
        if let Some(&anchor) = well_known.iter().min_by(by_effect) {
            for (level, row) in fit.levels.iter_mut().zip(&rows) {
                if let CostEntry::LogCost(log_cost, _) = row[anchor] {
                    *level = log_cost - fit.effects[anchor];
                }
            }
            fit.interaction = fit.interaction_of(&rows, &well_known, anchor);
            fit.effects = fit.effects_over(&rows);
        }
        let mut completed: Vec<Vec<f64>> = Vec::with_capacity(rows.len());
        for (row, level) in rows.iter().zip(&fit.levels) {
            let expected = row.iter().zip(&fit.effects).map(|(known, effect)| match known {
                CostEntry::LogCost(log_cost, variance) => {
                    // The measured cost, drawn towards the others' by its noise.
                    let share = fit.interaction / (fit.interaction + variance);
                    effect + share * (log_cost - level - effect)
                }
                CostEntry::Infeasible => INFEASIBLE,
                CostEntry::Unknown => *effect,
            });
            let expected: Vec<f64> = expected.collect();
            let best = expected.iter().copied().fold(f64::INFINITY, f64::min);
            assert!(best.is_finite(), "{best} is the best of a state");
            completed.push(expected.into_iter().map(|x| x - best).collect());
        }
        completed
    }

    /// The expected cost of each configuration above the best of a state, on average: mean logarithms of
    /// ratios. Empty where nothing was measured.
    pub fn mean_prices(&self) -> Vec<f64> {
        let completed = self.completed();
        let count = completed.first().map_or(0, Vec::len);
        let mean =
            |place: usize| completed.iter().map(|row| row[place]).sum::<f64>() / completed.len() as f64;
        (0..count).map(mean).collect()
    }

    /// The members of a portfolio, at most `members` of those `among` which it is chosen, as places of
    /// configurations. The best fixed one is first, then each time the most helpful one: those known in many
    /// states, then `always`, then the others. `always` are members even if they do not help, and count
    /// towards the number. Empty where nothing was measured.
    pub fn portfolio_among(&self, among: &[usize], members: usize, always: &[usize]) -> Vec<usize> {
        let completed = self.completed();
        let Some(count) = completed.first().map(Vec::len) else { return Vec::new() };
        let rows = self.measured();
        let members = members.min(count);
        let well_known: Vec<usize> =
            well_known(&rows).into_iter().filter(|place| among.contains(place)).collect();
        let known = if well_known.is_empty() { among } else { &well_known };
        let Some(first) = first_of(known, &rows, &completed).filter(|_| members > 0) else {
            return Vec::new();
        };
        let dearest = |row: &Vec<f64>| row.iter().copied().fold(0.0, f64::max);
        let paid = completed.iter().map(dearest).collect();
        let mut chosen = Chosen { completed: &completed, paid, places: Vec::new() };
        chosen.add(first);
        chosen.add_while_helpful(known, members.saturating_sub(always.len()), KNOWN_HELP_LEAST);
        for &place in always.iter().filter(|&&place| place < count) {
            if chosen.places.len() < members && !chosen.places.contains(&place) {
                chosen.add(place);
            }
        }
        chosen.add_while_helpful(among, members, HELP_LEAST);
        chosen.places
    }

    /// The best fixed configuration among some: its place. `None` where nothing was measured.
    pub fn best_fixed(&self, among: &[usize]) -> Option<usize> {
        self.portfolio_among(among, 1, &[]).first().copied()
    }
}

/// The best fixed configuration among those. Its excess over the best of them in a state is least on average,
/// where no state in which it can be run counts for more than [`EXCESS_MOST`]. The first of equals.
fn first_of(among: &[usize], rows: &[&[CostEntry]], completed: &[Vec<f64>]) -> Option<usize> {
    let best_of =
        |expected: &Vec<f64>| among.iter().map(|&place| expected[place]).fold(f64::INFINITY, f64::min);
    let best: Vec<f64> = completed.iter().map(best_of).collect();
    let excess = |place: usize| -> f64 {
        let of_state = |state: usize| match rows[state][place] {
            CostEntry::Infeasible => INFEASIBLE,
            _ => (completed[state][place] - best[state]).min(EXCESS_MOST),
        };
        (0..rows.len()).map(of_state).sum()
    };
    let excesses = among.iter().map(|&place| (excess(place), place));
    excesses.min_by(|one, other| one.0.total_cmp(&other.0)).map(|(_, place)| place)
}

/// A portfolio that grows.
struct Chosen<'a> {
    completed: &'a [Vec<f64>],
    /// The cost of each state with the members so far.
    paid: Vec<f64>,
    places: Vec<usize>,
}

impl Chosen<'_> {
    /// The fall of the mean cost by a further member.
    fn help(&self, place: usize) -> f64 {
        let saved = |(row, paid): (&Vec<f64>, &f64)| (paid - row[place]).max(0.0);
        self.completed.iter().zip(&self.paid).map(saved).sum::<f64>() / self.paid.len() as f64
    }

    fn add(&mut self, place: usize) {
        assert!(!self.places.contains(&place), "{place} is a member already");
        self.paid.iter_mut().zip(self.completed).for_each(|(paid, row)| *paid = paid.min(row[place]));
        self.places.push(place);
    }

    /// Adds the most helpful one of them, again and again, until there are `members` members or none helps by
    /// `help_least`.
    fn add_while_helpful(&mut self, among: &[usize], members: usize, help_least: f64) {
        while self.places.len() < members {
            let others = among.iter().filter(|place| !self.places.contains(place));
            let helpful =
                others.map(|&place| (self.help(place), place)).filter(|(help, _)| *help >= help_least);
            // The first of equals.
            let Some((_, place)) = helpful.reduce(|best, one| if one.0 > best.0 { one } else { best }) else {
                break;
            };
            self.add(place);
        }
    }
}

/// Levels of states and effects of configurations, whose sums fit the measurements.
struct Fit {
    levels: Vec<f64>,
    effects: Vec<f64>,
    /// Variance of a state's part in an effect.
    interaction: f64,
}

impl Fit {
    fn new(rows: &[&[CostEntry]]) -> Self {
        let count = rows.first().map_or(0, |row| row.len());
        Fit { levels: vec![0.0; rows.len()], effects: vec![0.0; count], interaction: INTERACTION }
    }

    /// The level of a state: the mean of its measurements less their effects.
    fn level_of(&self, row: &[CostEntry]) -> f64 {
        let (mut sum, mut weight) = (0.0, 0.0);
        for (known, effect) in row.iter().zip(&self.effects) {
            if let CostEntry::LogCost(log_cost, variance) = known {
                let own = 1.0 / (self.interaction + variance);
                sum += own * (log_cost - effect);
                weight += own;
            }
        }
        assert!(weight > 0.0, "something was measured in every row");
        sum / weight
    }

    /// The effects of all configurations: each one's cost above the levels of its states, drawn towards 0, a
    /// mediocre one.
    fn effects_over(&self, rows: &[&[CostEntry]]) -> Vec<f64> {
        let effect = |place: usize| {
            let (mut sum, mut weight) = (0.0, 1.0 / EFFECT);
            for (row, level) in rows.iter().zip(&self.levels) {
                let (above, variance) = match row[place] {
                    CostEntry::LogCost(log_cost, variance) => (log_cost - level, variance),
                    CostEntry::Infeasible => (INFEASIBLE, 0.0),
                    CostEntry::Unknown => continue,
                };
                let own = 1.0 / (self.interaction + variance);
                sum += own * above;
                weight += own;
            }
            sum / weight
        };
        (0..self.effects.len()).map(effect).collect()
    }

    /// The variance of a state's part in an effect, by the well-known configurations beside the anchor. It is
    /// the median of the squared residuals around each one's mean, less the noise.
    fn interaction_of(&self, rows: &[&[CostEntry]], well_known: &[usize], anchor: usize) -> f64 {
        let mut squares = Vec::new();
        for &place in well_known.iter().filter(|&&place| place != anchor) {
            let residual = |(row, level): (&&[CostEntry], &f64)| match row[place] {
                CostEntry::LogCost(log_cost, variance) => Some((log_cost - level, variance)),
                _ => None,
            };
            let residuals: Vec<(f64, f64)> = rows.iter().zip(&self.levels).filter_map(residual).collect();
            let count = residuals.len() as f64;
            let mean = residuals.iter().map(|(residual, _)| residual).sum::<f64>() / count;
            // A mean of few values follows them.
            let widened = count / (count - 1.0).max(1.0);
            let square = |(residual, variance): &(f64, f64)| {
                widened * (residual - mean) * (residual - mean) / MEDIAN_SQUARE - variance
            };
            squares.extend(residuals.iter().map(square));
        }
        squares.sort_by(f64::total_cmp);
        squares.get(squares.len() / 2).map_or(INTERACTION, |median| median.max(INTERACTION))
    }
}

/// Configurations measured in at least two states and in at least half as many as any.
fn well_known(rows: &[&[CostEntry]]) -> Vec<usize> {
    let count = rows.first().map_or(0, |row| row.len());
    let states_of =
        |place: usize| rows.iter().filter(|row| matches!(row[place], CostEntry::LogCost(..))).count();
    let counts: Vec<usize> = (0..count).map(states_of).collect();
    let most = counts.iter().copied().max().unwrap_or(0);
    (0..count).filter(|&place| counts[place] >= most.div_ceil(2).max(2)).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    impl CostTable {
        /// The members of a portfolio of all.
        fn portfolio(&self, members: usize, always: &[usize]) -> Vec<usize> {
            let all: Vec<usize> = (0..self.rows.first().map_or(0, Vec::len)).collect();
            self.portfolio_among(&all, members, always)
        }
    }

    fn table(costs: &[&[f64]]) -> CostTable {
        let known = |cost: &f64| match *cost {
            0.0 => CostEntry::Unknown,
            cost if cost < 0.0 => CostEntry::Infeasible,
            cost => CostEntry::LogCost(cost.ln(), 1e-4),
        };
        CostTable { rows: costs.iter().map(|row| row.iter().map(known).collect()).collect() }
    }

    #[test]
    fn what_states_add_to_an_effect_is_the_spread_beyond_the_noise() {
        let row = |own: f64| vec![CostEntry::LogCost(0.0, 0.1), CostEntry::LogCost(own, 0.1)];
        let rows = [1.0, 2.0, 5.0, 6.0, 11.0].map(row);
        let rows: Vec<&[CostEntry]> = rows.iter().map(Vec::as_slice).collect();
        let fit = Fit::new(&rows);
        // The mean is 5, the median square 9, widened by 5/4.
        let expected = 1.25 * 9.0 / MEDIAN_SQUARE - 0.1;
        let variance = fit.interaction_of(&rows, &[0, 1], 0);
        assert!((variance - expected).abs() < 1e-12, "{variance} {expected}");
        assert_eq!(fit.interaction_of(&rows, &[0], 0), INTERACTION, "none beside the anchor");
    }

    #[test]
    fn a_few_states_that_agree_prove_a_configuration() {
        let rows = |gains: &[f64]| CostTable {
            rows: gains
                .iter()
                .map(|gain| vec![CostEntry::LogCost(1.0, 0.0004), CostEntry::LogCost(1.0 - gain, 0.0004)])
                .collect(),
        };
        assert!(rows(&[0.1, 0.12, 0.09, 0.11]).is_proven(1, 0));
        assert!(!rows(&[0.1, 0.12, 0.09, 0.11]).is_proven(0, 1), "the dearer one");
        assert!(!rows(&[0.1, 0.12, 0.09]).is_proven(1, 0), "too few");
        assert!(!rows(&[0.3, -0.05, 0.2, -0.1, 0.25]).is_proven(1, 0), "a further one may want the opposite");
        assert!(!rows(&[0.01, 0.0, 0.02, 0.01]).is_proven(1, 0), "no more than the noise");
        let mut broken = rows(&[0.1, 0.12, 0.09, 0.11]);
        broken.rows.push(vec![CostEntry::LogCost(1.0, 0.0), CostEntry::Infeasible]);
        assert!(!broken.is_proven(1, 0));
    }

    #[test]
    fn the_best_on_average_comes_first_and_specialists_follow() {
        let costs = table(&[
            &[10.0, 12.0, 7.0, 30.0],
            &[20.0, 21.0, 40.0, 60.0],
            &[5.0, 6.0, 11.0, 15.0],
            &[8.0, 9.0, 18.0, 4.0],
        ]);
        assert_eq!(costs.portfolio(1, &[]), [0]);
        // The second is nowhere the best, and is not needed.
        assert_eq!(costs.portfolio(MEMBERS, &[]), [0, 3, 2]);
        assert_eq!(costs.portfolio(MEMBERS, &[1]), [0, 3, 2, 1]);
        assert_eq!(costs.portfolio(2, &[1]), [0, 1]);
    }

    #[test]
    fn specialists_known_in_many_states_come_before_lucky_finds() {
        // The last three were each measured in one state alone, and look better there than anything known.
        let costs = table(&[
            &[10.0, 12.0, 9.0, 8.5, 0.0, 0.0],
            &[20.0, 18.0, 24.0, 0.0, 17.0, 0.0],
            &[5.0, 5.5, 5.6, 0.0, 0.0, 4.2],
        ]);
        let members = costs.portfolio(MEMBERS, &[]);
        assert_eq!(members[0], 0);
        let (mut known, mut found) = (members[1..3].to_vec(), members[3..].to_vec());
        known.sort_unstable();
        found.sort_unstable();
        assert_eq!((known, found), (vec![1, 2], vec![3, 4, 5]));
        // A branch is a member even if it does not help.
        assert_eq!(costs.portfolio(3, &[5]).last(), Some(&5));
    }

    #[test]
    fn one_lucky_scene_makes_no_best_fixed_configuration() {
        // The last was measured once, where it did a little better than the first does everywhere.
        let costs = table(&[&[8.0, 10.0, 7.9], &[16.0, 20.0, 0.0], &[4.0, 5.0, 0.0], &[12.0, 15.0, 0.0]]);
        assert_eq!(costs.portfolio(1, &[]), [0]);
        // A configuration that cannot be run in some states is not the best fixed one either.
        let costs = table(&[&[8.0, 7.0], &[8.0, 7.0], &[8.0, -1.0]]);
        assert_eq!(costs.portfolio(1, &[]), [0]);
    }

    #[test]
    fn a_state_where_everything_matters_more_makes_no_best_fixed_configuration() {
        // The last was measured in one state, where good ones are far below mediocre ones, and did no better
        // there than the third, which is good everywhere.
        let costs = table(&[
            &[10.0, 10.5, 8.0, 0.0],
            &[20.0, 21.0, 16.0, 0.0],
            &[5.0, 5.3, 4.0, 0.0],
            &[40.0, 42.0, 10.0, 10.1],
        ]);
        assert_eq!(costs.portfolio(1, &[]), [2]);
    }

    #[test]
    fn a_state_that_wants_the_opposite_does_not_decide_for_all_others() {
        // The second is 7 % dearer than the first in six states, and three times as fast in the last.
        let costs = table(&[
            &[10.0, 10.7, 14.0],
            &[20.0, 21.4, 28.0],
            &[5.0, 5.35, 7.0],
            &[40.0, 42.8, 56.0],
            &[8.0, 8.56, 11.2],
            &[30.0, 32.1, 42.0],
            &[90.0, 30.0, 90.0],
        ]);
        assert_eq!(costs.portfolio(MEMBERS, &[]), [0, 1]);
        // A state that cannot run a configuration does so, and counts for more than the bound.
        let costs = table(&[&[10.0, 11.0], &[20.0, 22.0], &[5.0, 5.5], &[-1.0, 40.0]]);
        assert_eq!(costs.portfolio(1, &[]), [1]);
    }

    #[test]
    fn nothing_follows_from_nothing() {
        assert_eq!(CostTable::default().portfolio(MEMBERS, &[]), Vec::<usize>::new());
        assert_eq!(table(&[&[0.0, 0.0]]).best_fixed(&[0, 1]), None);
    }

    proptest! {
        #![proptest_config(crate::testing::cases(64))]

        #[test]
        fn members_are_distinct_and_the_level_of_a_state_says_nothing(
            costs in proptest::collection::vec(proptest::collection::vec(1.0..100.0f64, 5), 1..8),
            factor in 0.01..100.0f64,
        ) {
            let rows: Vec<&[f64]> = costs.iter().map(Vec::as_slice).collect();
            let members = table(&rows).portfolio(4, &[2]);
            let mut distinct = members.clone();
            distinct.sort_unstable();
            distinct.dedup();
            prop_assert_eq!(distinct.len(), members.len());
            prop_assert!(members.len() == 1 || members.contains(&2));
            let scaled: Vec<f64> = costs[0].iter().map(|cost| factor * cost).collect();
            let mut rows = rows.clone();
            rows[0] = &scaled;
            // But for rounding, which may turn a tie.
            let best = |table: &CostTable| table.completed()[0].clone();
            let (one, other) = (best(&table(&costs.iter().map(Vec::as_slice).collect::<Vec<_>>())), best(&table(&rows)));
            for (a, b) in one.iter().zip(&other) {
                prop_assert!((a - b).abs() < 1e-6);
            }
        }
    }
}
