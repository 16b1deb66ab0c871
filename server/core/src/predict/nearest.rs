//! The nearest-neighbour predictor of paper section 6.1: the best known configuration of the known state
//! that is closest by Euclidean distance.

use crate::knowledge::KnownState;
use crate::limits::NEIGHBOURS_MAX;
use crate::predict::{Answer, Lesson, Predictor, Query};
use crate::trial::Neighbour;

/// The predictor. Its table are the known states that come with each query.
///
/// A state in which a search was begun counts before all others: what an unexplored state knows is only
/// how the configurations did that were predicted for it, and to rely on that would repeat a poor early
/// guess for ever. Among equals the asked state itself comes first, then the nearest.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Nearest;

/// A state that can answer, and the square of its distance.
struct Candidate<'a> {
    state: &'a KnownState,
    unexplored: bool,
    elsewhere: bool,
    distance_2: f64,
}

impl Candidate<'_> {
    fn comes_before(&self, other: &Candidate<'_>) -> bool {
        let key = |candidate: &Candidate<'_>| (candidate.unexplored, candidate.elsewhere);
        // States come by rising id, so equal distances leave the older one in front.
        (key(self), self.distance_2) < (key(other), other.distance_2)
    }
}

/// The square of the Euclidean distance, or `None` as soon as it must exceed `limit`.
fn distance_2_within(a: &[f64], b: &[f64], limit: f64) -> Option<f64> {
    let mut sum = 0.0;
    for (a, b) in a.iter().zip(b) {
        sum += (a - b) * (a - b);
        if sum > limit {
            return None;
        }
    }
    Some(sum)
}

/// The candidates nearest to the query, in order, at most [`NEIGHBOURS_MAX`].
fn candidates<'a>(query: &Query<'a>) -> Vec<Candidate<'a>> {
    let mut nearest: Vec<Candidate<'a>> = Vec::with_capacity(NEIGHBOURS_MAX + 1);
    for state in query.known {
        if state.knowledge.best().is_none() {
            continue;
        }
        let (unexplored, elsewhere) = (!state.explored, query.here.is_none_or(|here| here.id != state.id));
        // Only a candidate of the same rank makes a distance hopeless.
        let limit = match nearest.last() {
            Some(last)
                if nearest.len() == NEIGHBOURS_MAX
                    && (last.unexplored, last.elsewhere) <= (unexplored, elsewhere) =>
            {
                last.distance_2
            }
            _ => f64::INFINITY,
        };
        let Some(distance_2) = distance_2_within(&state.anchor, query.state, limit) else {
            continue;
        };
        let candidate = Candidate { state, unexplored, elsewhere, distance_2 };
        let place = nearest.partition_point(|other| !candidate.comes_before(other));
        nearest.insert(place, candidate);
        nearest.truncate(NEIGHBOURS_MAX);
    }
    nearest
}

/// The known states nearest to the query, for reasons.
pub(super) fn neighbours(query: &Query<'_>) -> Vec<Neighbour> {
    candidates(query).iter().filter_map(neighbour).collect()
}

fn neighbour(candidate: &Candidate<'_>) -> Option<Neighbour> {
    let best = candidate.state.knowledge.best()?;
    Some(Neighbour {
        state_id: candidate.state.id,
        distance: candidate.distance_2.sqrt(),
        best_cost: best.mean_cost,
    })
}

impl Predictor for Nearest {
    fn learn(&mut self, _lesson: &Lesson<'_>) {}

    fn predict(&self, query: &Query<'_>) -> Option<Answer> {
        let candidates = candidates(query);
        let record = candidates
            .iter()
            .flat_map(|candidate| candidate.state.knowledge.ranked())
            .find(|record| !query.excludes(&record.configuration))?;
        Some(Answer {
            configuration: record.configuration.clone(),
            predicted_cost: Some(record.mean_cost),
            neighbours: candidates.iter().filter_map(neighbour).collect(),
        })
    }
}
