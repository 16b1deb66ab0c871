//! What is known of a study: its states with their tables, how they came about, the speeds of machines, what
//! costs are believed to be, and what models and other states say.

pub(super) mod assessment;
mod auxiliaries;
pub(super) mod checkpoint;
mod gain;
mod history;
pub(super) mod models;
mod portfolio;
pub(super) mod progress;
mod rechecks;
mod speeds;
mod states;
pub(super) mod warm_start;

pub(crate) use assessment::{Assessment, AssessmentRequest, Assessments};
pub(crate) use auxiliaries::{Auxiliaries, Beside};
pub(crate) use gain::GainEvidence;
pub(crate) use history::History;
pub(crate) use models::Models;
pub(crate) use portfolio::{MeasuredElsewhere, OtherState};
pub(crate) use rechecks::{Moved, Rechecks};
pub(crate) use speeds::{Speeds, Unheld};
pub(crate) use states::{States, at, place};
pub(crate) use warm_start::WarmStart;

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::configuration::{Configuration, unchecked};
use crate::ids::StateId;
use crate::indicator::IndicatorSchema;
use crate::limits::{STATES_MAX, STATES_OF_NEW_MACHINES_MAX};
use crate::policy::{Policy, PredictorMethod};
use crate::predict::prequential::ErrorInterval;
use crate::predict::{ComputedUpdates, DeferredUpdates};
use crate::study::StudySpec;
use crate::trial::Fingerprint;
use crate::tuner::{Best, TunerError, checks};

/// A configuration as it stands in a state's row.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub(crate) struct Stored(#[serde(with = "unchecked")] pub(crate) Configuration);

/// The learnt cost of a completed trial.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LearntCost {
    /// Its cost as the table has it.
    pub(crate) cost: Option<f64>,
    /// The believed cost: it is drawn in where it lies far from all others.
    pub(crate) believed: Option<f64>,
    /// The speed of its client's machine was found to have jumped.
    pub(crate) has_jumped: bool,
    /// The costs of the state were found to have changed.
    pub(crate) has_changed: bool,
}

/// All that is known of a study.
#[derive(Clone, Debug)]
pub struct Knowledge {
    pub(crate) states: States,
    pub(crate) history: History,
    pub(crate) speeds: Speeds,
    pub(crate) rechecks: Rechecks,
    pub(crate) auxiliaries: Auxiliaries,
    pub(crate) models: Models,
    pub(crate) assessments: Assessments,
    /// The number of completed trials, and the place of the last in the order of completion.
    pub(crate) completed: u64,
    pub(crate) last_completion: u64,
}

impl Knowledge {
    /// Nothing is known yet.
    pub(crate) fn new(spec: &StudySpec) -> Self {
        let states = States::new(spec);
        Knowledge {
            models: Models::new(spec, spec.policy.predictor, &states, 0),
            history: History::default(),
            assessments: Assessments::default(),
            speeds: Speeds::default(),
            rechecks: Rechecks::default(),
            auxiliaries: Auxiliaries::default(),
            completed: 0,
            last_completion: 0,
            states,
        }
    }

    /// Whether a question's state was `found`, or another one can be founded.
    pub(crate) fn check_room(&self, found: Option<StateId>) -> Result<(), TunerError> {
        let is_full = self.states.len() >= STATES_MAX + STATES_OF_NEW_MACHINES_MAX;
        if found.is_none() && is_full { Err(TunerError::TooManyStates) } else { Ok(()) }
    }

    /// Founds a state of a machine with these indicators as its anchor.
    pub(crate) fn found(&mut self, anchor: Vec<f64>, fingerprint: Option<&Fingerprint>) -> StateId {
        self.history.found();
        let state = self.states.found(anchor, fingerprint);
        assert_eq!(self.history.len(), self.states.len(), "every state has a history");
        state
    }

    /// The evidence on exploring that pays.
    pub(crate) fn gain<'a>(&'a self, policy: &'a Policy) -> GainEvidence<'a> {
        let Knowledge { states, history, .. } = self;
        GainEvidence { policy, states, history }
    }

    /// The asked indicators, normalised, and their state: that of the named machine if it has been there,
    /// else of the one with the most frames there.
    pub(crate) fn recognise_for(
        &self,
        indicators: &IndicatorSchema,
        asked: &BTreeMap<String, f64>,
        fingerprint: Option<&Fingerprint>,
    ) -> Result<(Vec<f64>, Option<StateId>), TunerError> {
        checks::fingerprint(fingerprint)?;
        let normalised = indicators.normalise(asked)?;
        let frames = |state| self.history.frames(state);
        let state = self.states.recognise_for(fingerprint, &normalised, frames);
        Ok((normalised, state))
    }

    /// The state whose best is asked for: the one of the asked indicators, or the cheapest of all.
    pub(crate) fn best_state(
        &self,
        indicators: &IndicatorSchema,
        asked: Option<&BTreeMap<String, f64>>,
        fingerprint: Option<&Fingerprint>,
    ) -> Result<Option<StateId>, TunerError> {
        checks::fingerprint(fingerprint)?;
        let best_of =
            |state: &StateId| self.states.results(*state).believed_best().map(|best| best.mean_cost);
        if let Some(asked) = asked {
            let (_, state) = self.recognise_for(indicators, asked, fingerprint)?;
            return Ok(state.filter(|state| best_of(state).is_some()));
        }
        let all = self.states.ids().filter_map(|state| Some((state, best_of(&state)?)));
        Ok(all.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(state, _)| state))
    }

    /// The cost of the configuration exploited in a state, as far as it was assessed; `None` when nothing has
    /// been measured there.
    pub fn best_cost(&self, state: impl Into<StateId>) -> Option<f64> {
        let state = state.into();
        let known = self.states.contains(state).then(|| self.states.results(state))?;
        let assessed = self.assessments.of(state, None).map(|made| made.cost);
        known.believed_best().map(|best| assessed.unwrap_or(best.mean_cost))
    }

    /// The cheapest configuration measured in a state, of those that can be run and that `fits` takes.
    pub fn cheapest(&self, state: u64, fits: impl Fn(&Configuration) -> bool) -> Option<Configuration> {
        let mut ranked = self.states.results(StateId(state)).ranked().map(|record| &record.configuration);
        ranked.find(|configuration| fits(configuration)).cloned()
    }

    /// In place of a state's best: the cheapest configuration measured there, of those that can be run and
    /// that `fits` takes. The standing stays that of the best.
    pub fn cheapest_instead(&self, best: Best, fits: impl Fn(&Configuration) -> bool) -> Option<Best> {
        let results = self.states.results(StateId(best.state_id));
        let record = results.ranked().find(|record| fits(&record.configuration))?;
        let own = (&record.configuration, record.mean_cost);
        let answer = results.record(&best.configuration)?;
        let at_rest = results.at_rest(&best.configuration);
        Some(Best {
            configuration: record.configuration.clone(),
            cost: results.reported_beside(own, (answer, at_rest), None),
            measurements: record.measurements,
            trial: record.last_trial,
            last_measure_ms: record.last_measure_ms,
            ..best
        })
    }

    /// From now on reports defer the models' long updates: see [`Knowledge::deferred_updates`].
    pub fn defer_updates(&mut self) {
        self.models.defers = true;
    }

    /// The updates that reports have deferred, to be computed apart; `None` where there are none. A later
    /// report computes overdue ones.
    pub fn deferred_updates(&self) -> Option<DeferredUpdates> {
        self.models.predictors.deferred()
    }

    /// Whether reports have deferred anything.
    pub fn has_deferred_updates(&self) -> bool {
        self.models.predictors.deferred_count() > 0
    }

    /// Takes over updates that were computed apart, unless another caller was faster.
    pub fn apply_updates(&mut self, updates: ComputedUpdates) {
        self.models.predictors.apply(updates);
    }

    /// The place in the order of completion at which the models in use were begun; to be stored with the
    /// policy.
    pub fn models_since(&self) -> u64 {
        self.models.since
    }

    /// The mean error of each predictor in this study, with its 95 % interval, see
    /// [`prequential`](crate::predict::prequential). `Auto` stands for those that answered.
    pub fn predictor_errors(&self) -> Vec<(PredictorMethod, ErrorInterval)> {
        self.models.predictors.errors()
    }
}
