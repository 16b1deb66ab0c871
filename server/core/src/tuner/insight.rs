//! The policy's knowledge of a state, for people: why it explores there or not, and its omissions.

pub use crate::trial::OmissionReason;

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::indicator::IndicatorSchema;
use crate::predict::state_index::OmittedIndicator;
use crate::results::ResultTable;
use crate::space::Space;
use crate::standing::Standing;
use crate::tuner::exploring::{Exploiting, Standings};
use crate::tuner::knowledge::States;

/// The policy's knowledge of a state.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Insight {
    /// The state.
    pub state_id: u64,
    /// Configurations with a verdict.
    pub tried: u64,
    /// The number of visits of clients that reported a trial from the state.
    pub visits: u64,
    /// The number of frames reported from it.
    pub frames: u64,
    /// The difference of repeated measurements, relative to the cost: a robust standard deviation. `None`
    /// before anything was measured twice.
    pub noise: Option<f64>,
    /// Measurements that were set aside as outliers.
    pub outliers: u64,
    /// The number of lasting changes of costs.
    pub drifts: u64,
    /// The expected gain and cost of going on with the search.
    pub prospect: Option<Prospect>,
    /// The parameters and indicators that searches and predictors leave out.
    pub omissions: Vec<Omission>,
    /// The standing of the exploited configuration; `None` where nothing measured here can be run.
    pub standing: Option<Standing>,
}

/// The expected gain and cost of exploring a state. Both are relative to the best known cost, so that they
/// exist for states without measurements too.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Prospect {
    /// The share by which the cost of each later frame falls, after the trials that pay most.
    pub gain: f64,
    /// The number of frames that profit.
    pub frames: f64,
    /// The cost of these trials above the reference in all, in frames of the reference.
    pub exploring_cost: f64,
    /// The number of trials before it is weighed again; 0 where exploring does not pay.
    pub trials: usize,
}

/// A parameter or an indicator that is left out.
#[derive(Clone, Debug, PartialEq)]
pub struct Omission {
    /// The parameter, or for [`OmissionReason::Constant`] and [`OmissionReason::Redundant`] the indicator;
    /// `None` for the whole search of the state.
    pub parameter: Option<String>,
    /// Why.
    pub reason: OmissionReason,
    /// For people.
    pub summary: String,
    /// The estimated number of trials that it has saved or will save.
    pub saved_trials: f64,
}

impl Exploiting<'_> {
    /// The insight into a state, whose search a client may want to have `room` trials: more than the study's
    /// operator wants, or fewer.
    pub(super) fn insight(
        &self,
        state: StateId,
        start: Option<&Configuration>,
        room: Option<usize>,
    ) -> Insight {
        let Exploiting { standings, gain, planned, .. } = *self;
        let Standings { spec, states, searches, .. } = standings;
        let results = states.results(state);
        let room = room.unwrap_or(spec.policy.trials_per_state as usize);
        let is_finished = standings.is_spent_within(room, state);
        let prospect = gain.prospect("", state, room);
        let left = room.saturating_sub(searches.taken(state, results, &spec.policy));
        let mut omissions = Vec::new();
        if spec.policy.weigh_gain && !is_finished && prospect.trials == 0 {
            let summary = format!(
                "a gain of {:.1} % over {:.0} frames does not pay for exploring worth {:.1} frames",
                100.0 * prospect.gain,
                prospect.frames,
                prospect.exploring_cost
            );
            let (reason, saved_trials) = (OmissionReason::BelowCost, left as f64);
            omissions.push(Omission { parameter: None, reason, summary, saved_trials });
        }
        omitted_parameters(&spec.space, results, &mut omissions);
        omitted_indicators(&spec.indicators, states, &mut omissions);
        Insight {
            state_id: state.0,
            tried: results.tried() as u64,
            visits: gain.history.visits(state),
            frames: gain.history.frames(state),
            noise: results.noise(),
            outliers: results.outliers(),
            drifts: results.drifts(),
            prospect: (!is_finished).then_some(prospect),
            omissions,
            standing: standings.standing(state, start, planned),
        }
    }
}

/// Parameters that the search of a state leaves out, and why.
fn omitted_parameters(space: &Space, results: &ResultTable, omissions: &mut Vec<Omission>) {
    let best = results.best();
    for parameter in space.parameters() {
        let is_active = best.is_none_or(|best| best.configuration.get(&parameter.name).is_some());
        if let (false, Some(condition)) = (is_active, &parameter.active_if) {
            let summary = format!("it means nothing beside the best known value of {}", condition.parameter);
            omissions.push(Omission {
                parameter: Some(parameter.name.clone()),
                reason: OmissionReason::Inactive,
                summary,
                // To try each of its other values once.
                saved_trials: parameter.domain.alternatives() as f64,
            });
        }
    }
}

/// Indicators that predictors do not look at, and why.
fn omitted_indicators(indicators: &IndicatorSchema, known: &States, omissions: &mut Vec<Omission>) {
    let name = |axis: usize| indicators.indicators()[axis].name.clone();
    let states = known.indicator_statistics().states();
    for OmittedIndicator { axis, redundant_with } in known.omitted_indicators() {
        let (reason, summary) = match redundant_with {
            None => (OmissionReason::Constant, format!("it is equal in all {states} states")),
            Some(other) => {
                let summary = format!("in all {states} states it follows {} in a straight line", name(other));
                (OmissionReason::Redundant, summary)
            }
        };
        let parameter = Some(name(axis));
        omissions.push(Omission { parameter, reason, summary, saved_trials: 0.0 });
    }
}
