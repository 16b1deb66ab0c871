//! The nearest-neighbour predictors: paper section 6.1 as it stands, and its distance-weighted form.

use serde::{Deserialize, Serialize};

use crate::configuration::Configuration;
use crate::limits::NEIGHBOURS_MAX;
use crate::matrix::distance_2;
use crate::predict::state_index::IndexEntry;
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

/// The configuration that did best over the eight nearest states, each weighing by the inverse square of its
/// distance (Shepard, "A two-dimensional interpolation function for irregularly-spaced data", 1968).
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Weighted;

/// Number of states that [`Weighted`] asks.
const WEIGHTED: usize = 8;
/// Number of each state's best configurations among which it chooses.
const CANDIDATES: usize = 3;
/// Number of a state's configurations that stand for those it never ran.
const RECORDS: usize = 48;
/// Distances count as no less than this share of that of the furthest state asked, so that one state among
/// equals does not decide alone.
const NEARNESS_MAX: f64 = 0.1;

/// A state that can answer, and its distance.
struct NearState<'a> {
    state: &'a KnownState,
    distance: f64,
}

/// The states that can answer, in the order in which they count, at most `count`.
fn candidates<'a>(query: &Query<'a>, count: usize) -> Vec<NearState<'a>> {
    let mut chosen: Vec<NearState<'a>> = Vec::with_capacity(count + 1);
    for explored in [true, false] {
        let left = count.saturating_sub(chosen.len());
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
            chosen.truncate(count);
        }
        assert!(chosen.len() <= count, "{} of {count} states", chosen.len());
    }
    chosen
}

/// The states nearest to the query in which anything was measured, searched or not, for estimates. Estimates
/// are compared with later measurements. A replay after a restart must give equal estimates, but does not
/// know when each search began.
fn closest<'a>(query: &Query<'a>, count: usize) -> Vec<NearState<'a>> {
    measured(query, count, false, |_| true)
}

/// The states that pass nearest to the query in which anything was measured.
fn measured<'a>(
    query: &Query<'a>,
    count: usize,
    explored: bool,
    passes: impl Fn(&KnownState) -> bool,
) -> Vec<NearState<'a>> {
    let found = query.nearest(count, explored, |state| state.results.best().is_some() && passes(state));
    let near = |found: &IndexEntry| {
        let state = query.known.get(found.name as usize)?;
        Some(NearState { state, distance: found.distance_2.sqrt() })
    };
    found.iter().filter_map(near).collect()
}

/// The known states nearest to the query, for reasons.
pub(super) fn neighbours(query: &Query<'_>) -> Vec<Neighbour> {
    listed(query, &candidates(query, NEIGHBOURS_MAX))
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

/// A state's table as points: its best configurations and their mean costs, on the asking machine.
struct StateCosts<'a> {
    state: &'a KnownState,
    factor: f64,
    points: Vec<(Vec<f64>, f64)>,
}

impl<'a> StateCosts<'a> {
    fn of(query: &Query<'_>, state: &'a KnownState) -> Self {
        let records = state.results.ranked().take(RECORDS);
        let points = records.map(|record| {
            (query.space.encode(&record.configuration), query.translate(state, record.mean_cost))
        });
        let factor = query.translate(state, 1.0);
        StateCosts { state, factor, points: points.collect() }
    }

    /// The cost of a configuration in the state: its own mean, else that of the configuration most like it.
    fn cost(&self, configuration: &Configuration, point: &[f64]) -> Option<f64> {
        let own = self.state.results.record(configuration).filter(|record| record.measurements > 0);
        own.map(|record| (self.factor * record.mean_cost).min(f64::MAX)).or_else(|| {
            let alike = |(other, _): &(Vec<f64>, f64)| distance_2(other, point);
            let nearest = self.points.iter().min_by(|a, b| alike(a).total_cmp(&alike(b)));
            nearest.map(|(_, cost)| *cost)
        })
    }
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
    assert!(scale > 0.0, "a scale of {scale}");
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
        let point = query.space.encode(configuration);
        let candidates = closest(query, NEIGHBOURS_MAX);
        let cost =
            |candidate: &NearState<'_>| StateCosts::of(query, candidate.state).cost(configuration, &point);
        first_word(&candidates.iter().filter_map(cost).collect::<Vec<_>>())
    }

    fn predict(&self, query: &Query<'_>) -> Option<Answer> {
        let candidates = candidates(query, NEIGHBOURS_MAX);
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
        assert!(costs.len() <= candidates.len(), "{} costs of {} states", costs.len(), candidates.len());
        Some(Answer {
            configuration: record.configuration.clone(),
            expected: first_word(&costs)?,
            neighbours: listed(query, &candidates),
        })
    }
}

/// Weights of candidates, of sum one.
fn weights(candidates: &[NearState<'_>]) -> Vec<f64> {
    let furthest = candidates.iter().map(|candidate| candidate.distance).fold(0.0, f64::max);
    let floor = (NEARNESS_MAX * furthest).powi(2);
    let square = |candidate: &NearState<'_>| candidate.distance * candidate.distance + floor;
    // States at one place have equal weights.
    let weight = |candidate: &NearState<'_>| if furthest > 0.0 { floor / square(candidate) } else { 1.0 };
    let sum: f64 = candidates.iter().map(weight).sum();
    candidates.iter().map(|candidate| weight(candidate) / sum).collect()
}

/// The weighted mean of costs, and their spread.
fn weighted_word(costs: &[(f64, f64)]) -> Option<Estimate> {
    let total: f64 = costs.iter().map(|(weight, _)| weight).sum();
    if costs.is_empty() || total <= 0.0 {
        return None;
    }
    let scale = costs.iter().fold(f64::MIN_POSITIVE, |most, &(_, cost)| most.max(cost));
    let mean: f64 = costs.iter().map(|(weight, cost)| weight / total * (cost / scale)).sum();
    let squares: f64 =
        costs.iter().map(|(weight, cost)| weight / total * (cost / scale - mean).powi(2)).sum();
    let deviation = if costs.len() == 1 { mean } else { squares.sqrt() };
    Some(Estimate::new(scale * mean, scale * deviation))
}

impl Weighted {
    /// There is nothing to set up: the tables come with each query.
    pub(crate) fn new(_setup: PredictorSetup<'_>) -> Self {
        Weighted
    }

    fn word(
        tables: &[(f64, StateCosts<'_>)],
        configuration: &Configuration,
        point: &[f64],
    ) -> Option<(Estimate, f64)> {
        let (mut costs, mut score, mut total) = (Vec::new(), 0.0, 0.0);
        for (weight, table) in tables {
            let best = table.state.results.best().map(|best| table.factor * best.mean_cost);
            let (Some(cost), Some(best)) = (table.cost(configuration, point), best) else { continue };
            costs.push((*weight, cost));
            // States differ in the level of costs, so a cost counts by its ratio to the state's best.
            let ratio = if best > 0.0 { (cost / best).min(f64::MAX) } else { 1.0 };
            score += weight * libm::log(ratio.max(f64::MIN_POSITIVE));
            total += weight;
        }
        Some((weighted_word(&costs)?, score / total))
    }

    fn tables<'a>(
        query: &Query<'a>,
        candidates: Vec<NearState<'a>>,
    ) -> (Vec<(f64, StateCosts<'a>)>, Vec<Neighbour>) {
        let weights = weights(&candidates);
        let tables = candidates.iter().map(|candidate| StateCosts::of(query, candidate.state));
        assert_eq!(weights.len(), candidates.len(), "a weight for every state");
        (weights.into_iter().zip(tables).collect(), listed(query, &candidates))
    }
}

impl Predictor for Weighted {
    fn learns() -> bool {
        false
    }

    fn estimate(&self, query: &Query<'_>, configuration: &Configuration) -> Option<Estimate> {
        let (tables, _) = Self::tables(query, closest(query, WEIGHTED));
        Self::word(&tables, configuration, &query.space.encode(configuration)).map(|(expected, _)| expected)
    }

    fn predict(&self, query: &Query<'_>) -> Option<Answer> {
        let (tables, neighbours) = Self::tables(query, candidates(query, WEIGHTED));
        let leaders = tables.iter().flat_map(|(_, table)| {
            let usable = table.state.results.ranked().filter(|record| !query.excludes(&record.configuration));
            usable.take(CANDIDATES)
        });
        let mut best: Option<(&Configuration, Estimate, f64)> = None;
        for record in leaders {
            let configuration = &record.configuration;
            let point = query.space.encode(configuration);
            let Some((expected, score)) = Self::word(&tables, configuration, &point) else { continue };
            if best.is_none_or(|(_, _, least)| score < least) {
                best = Some((configuration, expected, score));
            }
        }
        let (configuration, expected, _) = best?;
        Some(Answer { configuration: configuration.clone(), expected, neighbours })
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
        let weighted = weighted_word(&[(1.0, 2.0), (3.0, 6.0)]).expect("a word");
        assert!((weighted.cost - 5.0).abs() < 1e-12, "{weighted:?}");
        // A quarter of (2 - 5)², three quarters of (6 - 5)².
        assert!((weighted.deviation - 3.0_f64.sqrt()).abs() < 1e-12, "{weighted:?}");
        assert_eq!((first_word(&[]), weighted_word(&[])), (None, None));
    }
}
