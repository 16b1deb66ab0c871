//! The nearest-neighbour predictor of paper section 6.1.

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::limits::NEIGHBOURS_MAX;
use crate::matrix::distance_2;
use crate::predict::state_index::{Among, IndexEntry};
use crate::predict::{Answer, Estimate, Predictor, PredictorSetup, Query};
use crate::results::{KnownState, Record};
use crate::trial::Neighbour;

/// Best known configuration of the known state that is closest by Euclidean distance. Its table is the known
/// states of the query.
///
/// A state in which a search was begun counts before all others. An unexplored state has only measured
/// configurations that were predicted for it, and to rely on these would repeat a poor early guess for ever.
/// Among equals the asked state itself comes first, then the nearest.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Nearest;

/// Number of a state's configurations that stand for those it never ran.
const RECORDS: usize = 48;

struct NearState<'a> {
    state: &'a KnownState,
    distance: f64,
}

/// The states that can answer, in the order in which they count, at most [`NEIGHBOURS_MAX`].
fn candidates<'a>(query: &Query<'a>) -> Vec<NearState<'a>> {
    let mut chosen: Vec<NearState<'a>> = Vec::with_capacity(NEIGHBOURS_MAX + 1);
    for explored in [true, false] {
        let left = NEIGHBOURS_MAX.saturating_sub(chosen.len());
        if left == 0 {
            break;
        }
        let from = chosen.len();
        chosen.extend(measured(query, left, explored, |state| state.explored == explored));
        if let Some(here) = query.here.filter(|here| here.explored == explored)
            && here.results.best().is_some()
        {
            let at = chosen[from..].iter().position(|candidate| candidate.state.id == here.id);
            let own = match at {
                Some(at) => chosen.remove(from + at),
                None => {
                    NearState { state: here, distance: query.state_index.distance(query.state, &here.anchor) }
                }
            };
            chosen.insert(from, own);
            chosen.truncate(NEIGHBOURS_MAX);
        }
    }
    chosen
}

/// The states that pass nearest to the query in which anything was measured.
fn measured<'a>(
    query: &Query<'a>,
    count: usize,
    explored: bool,
    passes: impl Fn(&KnownState) -> bool,
) -> Vec<NearState<'a>> {
    let among = if explored { Among::Explored } else { Among::Ran };
    let found = query.nearest(count, among, passes);
    let near = |found: &IndexEntry| {
        let state = query.known.get(found.name as usize)?;
        Some(NearState { state, distance: found.distance_2.sqrt() })
    };
    found.iter().filter_map(near).collect()
}

/// The known states nearest to the query, for reasons.
pub(super) fn neighbours(query: &Query<'_>) -> Vec<Neighbour> {
    listed(query, &candidates(query))
}

fn listed(query: &Query<'_>, candidates: &[NearState<'_>]) -> Vec<Neighbour> {
    let neighbour = |candidate: &NearState<'_>| {
        let best = candidate.state.results.best()?;
        let (state_id, best_cost) =
            (candidate.state.id.get(), query.translate(candidate.state, best.mean_cost));
        Some(Neighbour { state_id, distance: candidate.distance, best_cost })
    };
    candidates.iter().take(NEIGHBOURS_MAX).filter_map(neighbour).collect()
}

/// The cost of a configuration in a state, on the asking machine: its own mean, else that of the state's best
/// configurations that is most like it.
fn cost_in(query: &Query<'_>, state: &KnownState, configuration: &Configuration) -> Option<f64> {
    let own = state.results.record(configuration).filter(|record| record.measurements > 0);
    if let Some(own) = own {
        return Some((query.translate(state, 1.0) * own.mean_cost).min(f64::MAX));
    }
    let point = query.space.encode(configuration);
    let far = |record: &Record| distance_2(&query.space.encode(&record.configuration), &point);
    let records = state.results.ranked().take(RECORDS).map(|record| (far(record), record));
    let nearest = records.min_by(|a, b| a.0.total_cmp(&b.0));
    nearest.map(|(_, record)| query.translate(state, record.mean_cost))
}

/// The first state's cost, with the others' distance from it as deviation; a single state's deviation is its
/// whole cost.
fn first_word(costs: &[f64]) -> Option<Estimate> {
    let (&first, others) = costs.split_first()?;
    if others.is_empty() {
        return Some(Estimate::new(first, first));
    }
    // Divided before they are squared and summed: differences of large costs may overflow.
    let scale = costs.iter().fold(f64::MIN_POSITIVE, |most, &cost| most.max(cost));
    let squares: f64 = others.iter().map(|cost| (cost / scale - first / scale).powi(2)).sum();
    Some(Estimate::new(first, scale * (squares / others.len() as f64).sqrt()))
}

impl Nearest {
    /// There is nothing to set up: the tables come with each query.
    pub(crate) fn new(_setup: PredictorSetup<'_>) -> Self {
        Nearest
    }
}

impl Predictor for Nearest {
    fn learns() -> bool {
        false
    }

    fn estimate(&self, query: &Query<'_>, configuration: &Configuration) -> Option<Estimate> {
        // Searched or not: a replay after a restart must give equal estimates, but does not know when each
        // search began.
        let candidates = measured(query, NEIGHBOURS_MAX, false, |_| true);
        let cost = |candidate: &NearState<'_>| cost_in(query, candidate.state, configuration);
        first_word(&candidates.iter().filter_map(cost).collect::<Vec<_>>())
    }

    fn predict(&self, query: &Query<'_>) -> Option<Answer> {
        let candidates = candidates(query);
        let cost = |state: &KnownState, record: &Record| query.translate(state, record.mean_cost);
        let (state, record) = candidates
            .iter()
            .flat_map(|candidate| candidate.state.results.ranked().map(|record| (candidate.state, record)))
            .find(|(_, record)| !query.excludes(&record.configuration))?;
        let mut costs = vec![cost(state, record)];
        let best = |candidate: &NearState<'_>| {
            candidate.state.results.best().map(|best| cost(candidate.state, best))
        };
        costs.extend(candidates.iter().skip(1).filter_map(best));
        let (configuration, expected) = (record.configuration.clone(), first_word(&costs)?);
        Some(Answer { configuration, expected, neighbours: listed(query, &candidates) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_those_of_their_formulas() {
        let first = first_word(&[2.0, 4.0, 1.0]).expect("a word");
        assert_eq!(first.cost, 2.0);
        // The root of the mean of (4 - 2)² and (1 - 2)².
        assert!((first.deviation - 2.5_f64.sqrt()).abs() < 1e-12, "{first:?}");
        assert_eq!(first_word(&[3.0]), Some(Estimate::new(3.0, 3.0)));
        assert_eq!(first_word(&[]), None);
    }
}
