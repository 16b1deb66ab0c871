//! The portfolio of a study, as it is seen from one state: the few configurations with which its search
//! begins.
//!
//! The nearest states give the candidates: the answer of each, configurations measured in several, and the
//! best known one of every branch of a conditional space. A single measurement in one state is mostly luck:
//! such a candidate is a member only for its branch. [`CostTable::portfolio_among`] chooses among them. A
//! portfolio is computed apart from the tuner whenever a state's search begins, and stored with that search.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use crate::configuration::Configuration;
use crate::limits::{PORTFOLIO_CANDIDATES_MAX, REWARD_COST_MIN};
use crate::results::{Record, ResultTable};
use crate::space::Space;
use crate::statistics::portfolio::{CostEntry, CostTable, MEMBERS};
use crate::tuner::knowledge::gain::MEASUREMENTS_COUNTED;
use crate::value::Value;

/// Number of a state's best configurations that are candidates.
const OF_A_STATE: usize = 3;
/// Most members that only stand for a branch of the space.
const BRANCHES_MAX: usize = 3;

/// The results of another state, and its answers.
#[derive(Clone, Debug)]
pub(crate) struct OtherState {
    pub(crate) results: Arc<ResultTable>,
    /// Its confirmed winner, or the incumbent that it began with, where that is not the default.
    pub(crate) incumbent: Option<Configuration>,
    /// Least number of measurements to count beside the incumbent; `None` where the confirmation has ended.
    pub(crate) measured_least: Option<u64>,
}

impl OtherState {
    /// The answers of the state, none of which is the luck of one measurement.
    pub(crate) fn answers(&self) -> impl Iterator<Item = &Configuration> {
        let incumbent = self.incumbent.iter().filter(|incumbent| self.results.ran(incumbent).is_some());
        let least = self.measured_least.unwrap_or(u64::MAX);
        let often = self.results.ranked().filter(move |record| record.measurements >= least);
        incumbent.chain(often.map(|record| &record.configuration))
    }
}

/// The results of other states, the nearest first.
#[derive(Clone, Debug)]
pub(crate) struct MeasuredElsewhere {
    pub(crate) states: Vec<OtherState>,
    /// The table of the state that asks, if it is there.
    pub(crate) here: Option<Arc<ResultTable>>,
}

impl MeasuredElsewhere {
    pub(crate) fn is_empty(&self) -> bool {
        self.states.is_empty()
    }

    /// Whether the nearest state in which a configuration was tried, the asking one first, could not run it.
    pub(crate) fn fails(&self, configuration: &Configuration) -> bool {
        let tables = self.here.iter().chain(self.states.iter().map(|other| &other.results));
        let tried = |results: &Arc<ResultTable>| results.record(configuration).map(Record::fails);
        tables.filter_map(tried).next().unwrap_or(false)
    }

    /// Whether a configuration was stopped in the asking state, or fails there, and never ran to its end.
    fn fails_here(&self, configuration: &Configuration) -> bool {
        self.here.as_ref().is_some_and(|here| here.fails(configuration))
    }

    /// The best fixed configuration of other states, an incumbent or a confirmed winner that is not known to
    /// fail in the asking state. One that was stopped there counts only where all of them were, and the
    /// default with them. `None` where none of these was measured.
    pub(crate) fn best(&self, space: &Space) -> Option<Configuration> {
        let Choices { candidates, members, table } = Choices::of(space, self);
        let may_run = |place: &usize| !self.fails_here(&candidates[*place]);
        let unstopped: Vec<usize> = members.iter().copied().filter(may_run).collect();
        let among = if unstopped.is_empty() { &members } else { &unstopped };
        let best = candidates[table.best_fixed(among)?].clone();
        self.states.iter().any(|other| other.results.ran(&best).is_some()).then_some(best)
    }

    /// Configurations of other states, the most promising first. Empty where nothing was measured.
    pub(crate) fn members(&self, space: &Space) -> Vec<Configuration> {
        let Choices { candidates, members, table } = Choices::of(space, self);
        let mut branches = branches(space, &table, &candidates);
        // A branch whose best is proven dearer in further states is left to the search's own model.
        if let Some(best) = table.best_fixed(&members) {
            branches.retain(|&place| !table.is_proven(best, place));
        }
        let places = table.portfolio_among(&members, MEMBERS, &branches);
        places.into_iter().map(|place| candidates[place].clone()).collect()
    }
}

/// The candidates of a portfolio and their costs.
struct Choices {
    /// Those that may be members come first.
    candidates: Vec<Configuration>,
    members: Vec<usize>,
    table: CostTable,
}

impl Choices {
    fn of(space: &Space, elsewhere: &MeasuredElsewhere) -> Self {
        let (candidates, answers) = candidates(space, elsewhere);
        assert!(answers <= candidates.len(), "{answers} of {} candidates", candidates.len());
        assert!(candidates.len() <= PORTFOLIO_CANDIDATES_MAX, "{} candidates", candidates.len());
        let members = (0..answers).filter(|&place| !elsewhere.fails(&candidates[place])).collect();
        let row = |other: &OtherState| {
            let noise = other.results.frame_noise();
            let reach = other.results.reach();
            candidates.iter().map(|candidate| known(&other.results, candidate, noise, reach)).collect()
        };
        let table = CostTable { rows: elsewhere.states.iter().map(row).collect() };
        Choices { candidates, members, table }
    }
}

fn known(
    results: &ResultTable,
    configuration: &Configuration,
    noise: f64,
    reach: Option<(f64, f64)>,
) -> CostEntry {
    match results.record(configuration) {
        Some(record) if record.fails() => CostEntry::Infeasible,
        Some(record) if record.measurements > 0 => {
            let Some(cost) = record.told_cost(reach) else { return CostEntry::Unknown };
            let count = record.measurements.min(MEASUREMENTS_COUNTED) as f64;
            let variance = noise * noise / count;
            assert!(variance > 0.0 && variance.is_finite(), "a variance of {variance}");
            CostEntry::LogCost(libm::log(cost.max(REWARD_COST_MIN)), variance)
        }
        _ => CostEntry::Unknown,
    }
}

/// The candidates of a portfolio, and how many of the first may be members: the default, configurations
/// measured in several states, and each state's answer. The others, the best of each, only stand for branches
/// of the space.
fn candidates(space: &Space, elsewhere: &MeasuredElsewhere) -> (Vec<Configuration>, usize) {
    let states = &elsewhere.states;
    let mut seen: HashMap<&Configuration, usize> = HashMap::new();
    let mut several: Vec<(usize, &Configuration)> = Vec::new();
    for record in states.iter().flat_map(|state| state.results.ranked()) {
        let count = seen.entry(&record.configuration).or_insert(0);
        *count += 1;
        if *count == 2 {
            several.push((0, &record.configuration));
        }
    }
    several.iter_mut().for_each(|(count, configuration)| *count = seen[configuration]);
    several.sort_by_key(|(count, _)| std::cmp::Reverse(*count));
    several.truncate(PORTFOLIO_CANDIDATES_MAX / 2);
    let mut candidates = vec![space.default_configuration()];
    let mut offer = |configuration: &Configuration| {
        if candidates.len() < PORTFOLIO_CANDIDATES_MAX && !candidates.contains(configuration) {
            candidates.push(configuration.clone());
        }
        candidates.len()
    };
    let mut answers = 1;
    several.into_iter().for_each(|(_, configuration)| answers = offer(configuration));
    for rank in 0..OF_A_STATE {
        states
            .iter()
            .filter_map(|state| state.answers().nth(rank))
            .for_each(|answer| answers = offer(answer));
    }
    for rank in 0..OF_A_STATE {
        let best = states.iter().filter_map(|state| state.results.ranked().nth(rank));
        best.for_each(|best| {
            offer(&best.configuration);
        });
    }
    (candidates, answers)
}

/// The best known of every branch of the space in which the best fixed configuration does not lie: places of
/// candidates. A branch is a value of an always active parameter that decides whether other parameters are
/// active.
fn branches(space: &Space, table: &CostTable, candidates: &[Configuration]) -> Vec<usize> {
    let prices = table.mean_prices();
    assert!(prices.is_empty() || prices.len() == candidates.len(), "{} prices", prices.len());
    let by_price = |a: &usize, b: &usize| prices[*a].total_cmp(&prices[*b]);
    let Some(best) = (0..prices.len()).min_by(by_price) else { return Vec::new() };
    let decides = |name: &str| {
        let mut conditions = space.parameters().iter().filter_map(|other| other.active_if.as_ref());
        conditions.any(|condition| condition.parameter == name)
    };
    let always_active = space.parameters().iter().filter(|parameter| parameter.active_if.is_none());
    let mut found: Vec<usize> = Vec::new();
    for parameter in always_active.filter(|parameter| decides(&parameter.name)) {
        let mut of_value: BTreeMap<&Value, usize> = BTreeMap::new();
        for (place, candidate) in candidates.iter().enumerate().take(prices.len()) {
            let Some(value) = candidate.get(&parameter.name) else { continue };
            let least = of_value.entry(value).or_insert(place);
            if by_price(&place, least).is_lt() {
                *least = place;
            }
        }
        let own = candidates[best].get(&parameter.name);
        found.extend(of_value.into_iter().filter(|(value, _)| Some(*value) != own).map(|(_, place)| place));
    }
    found.sort_by(by_price);
    found.dedup();
    found.truncate(BRANCHES_MAX);
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_branch_is_a_value_beside_which_other_parameters_are() {
        let space = Space::builder()
            .categorical("backend", ["own", "ready"])
            .default("own")
            .categorical("order", ["rows", "columns"])
            .default("rows")
            .integer("level", 1..=9)
            .default(1)
            .active_if("backend", ["own"])
            .build()
            .expect("it is sound");
        let of = |values: &[(&str, Value)]| {
            let raw = values.iter().map(|(name, value)| ((*name).to_owned(), value.clone())).collect();
            space.complete(&raw).expect("a configuration")
        };
        let word = |text: &str| Value::from(text);
        let candidates = [
            of(&[("backend", word("ready")), ("order", word("rows"))]),
            of(&[("backend", word("ready")), ("order", word("columns"))]),
            of(&[("backend", word("own")), ("order", word("rows")), ("level", 2.into())]),
            of(&[("backend", word("own")), ("order", word("columns")), ("level", 5.into())]),
        ];
        let row = |costs: [f64; 4]| costs.map(|cost| CostEntry::LogCost(libm::log(cost), 1e-4)).to_vec();
        let table = CostTable { rows: vec![row([10.0, 9.0, 12.0, 11.0]), row([20.0, 18.0, 25.0, 23.0])] };
        // The second is the best; of the other back end that is the fourth. The order decides about nothing.
        assert_eq!(branches(&space, &table, &candidates), [3]);
    }
}
