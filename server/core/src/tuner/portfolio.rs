//! The portfolio of a study, as it is seen from one state: the few configurations with which its search begins.
//!
//! From the tables of the nearest states come the candidates: the best of each, what was measured in several, and the best
//! known of every branch of a conditional space. [`CostTable::portfolio`] chooses among them. It is made anew, apart from the
//! tuner, whenever a state's search begins, so that it always knows everything, and is stored with that search.

use std::collections::{BTreeMap, HashMap};
use std::sync::Arc;

use crate::configuration::Configuration;
use crate::limits::{PORTFOLIO_CANDIDATES_MAX, REWARD_COST_MIN};
use crate::results::ResultTable;
use crate::space::Space;
use crate::statistics::portfolio::{CostEntry, CostTable, MEMBERS};
use crate::tuner::gain::{NOISE_LEAST, NOISE_PRIOR};
use crate::value::Value;

/// How many of the best of a state are candidates.
const OF_A_STATE: usize = 3;
/// Most measurements that make a cost more certain.
const MEASUREMENTS_COUNTED: u64 = 16;
/// Most members that only stand for a branch of the space.
const BRANCHES_MAX: usize = 3;

/// Configurations of other states, the most promising first. Empty where nothing was measured.
pub(super) fn members(space: &Space, states: &[Arc<ResultTable>]) -> Vec<Configuration> {
    let candidates = candidates(space, states);
    let known = |results: &Arc<ResultTable>| {
        let noise = results.noise().unwrap_or(NOISE_PRIOR).max(NOISE_LEAST);
        candidates.iter().map(|candidate| known(results, candidate, noise)).collect()
    };
    let table = CostTable { rows: states.iter().map(known).collect() };
    let mut branches = branches(space, &table, &candidates);
    // A branch whose best is proven dearer in further states is left to the search's own model.
    if let Some(best) = table.best_fixed() {
        branches.retain(|&place| !table.is_proven(best, place));
    }
    let places = table.portfolio(MEMBERS, &branches);
    places.into_iter().map(|place| candidates[place].clone()).collect()
}

/// What a state knows of a configuration.
fn known(results: &ResultTable, configuration: &Configuration, noise: f64) -> CostEntry {
    match results.record(configuration) {
        Some(record) if record.infeasible => CostEntry::Infeasible,
        Some(record) if record.measurements > 0 => {
            let count = record.measurements.min(MEASUREMENTS_COUNTED) as f64;
            CostEntry::LogCost(libm::log(record.mean_cost.max(REWARD_COST_MIN)), noise * noise / count)
        }
        _ => CostEntry::Unknown,
    }
}

/// What a portfolio is chosen among: the default, what was measured in several states, and the best of each.
fn candidates(space: &Space, states: &[Arc<ResultTable>]) -> Vec<Configuration> {
    let mut seen: HashMap<&Configuration, usize> = HashMap::new();
    let mut several: Vec<(usize, &Configuration)> = Vec::new();
    for record in states.iter().flat_map(|state| state.ranked()) {
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
    };
    several.into_iter().for_each(|(_, configuration)| offer(configuration));
    for rank in 0..OF_A_STATE {
        states
            .iter()
            .filter_map(|state| state.ranked().nth(rank))
            .for_each(|best| offer(&best.configuration));
    }
    candidates
}

/// The best known of every branch of the space in which the best fixed configuration does not lie: places of candidates.
/// A branch is a value of a parameter that is always active and beside whose values others are.
fn branches(space: &Space, table: &CostTable, candidates: &[Configuration]) -> Vec<usize> {
    let prices = table.mean_prices();
    let by_price = |a: &usize, b: &usize| prices[*a].total_cmp(&prices[*b]);
    let Some(best) = (0..prices.len()).min_by(by_price) else {
        return Vec::new();
    };
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
