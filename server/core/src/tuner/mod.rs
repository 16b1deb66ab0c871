//! The state machine of one study: who gets which configuration, and what a report teaches.
//!
//! It carries out the workflow of paper section 6 (figure 10). Indicators are recognised as a state; on
//! every change of a client's state an epsilon-greedy decision is taken to explore it with a search or to
//! exploit a predictor's answer, which is then kept until the state changes again; every report feeds the
//! table, the search and the model.
//!
//! The machine is pure. Whatever an answer depends on is either in the rows of the [`Change`]s it returned
//! or is rebuilt from them: a tuner that is [restored](Tuner::restore) gives the same next answers, byte for
//! byte, as one that never stopped. `recognise` finds states, `decide` takes decisions, `explore` walks a
//! search, `suggest` and `report` are the two halves of a client's frame, `restore` rebuilds.

pub mod account;
mod ahead;
mod checkpoint;
mod checks;
mod decide;
mod elsewhere;
mod exploration;
mod explore;
mod history;
mod insight;
mod others;
mod recognise;
mod report;
mod restore;
mod screening;
mod suggest;
mod types;
mod weigh;

use std::collections::{BTreeMap, BTreeSet, HashMap};
use std::sync::Arc;

pub use account::Account;
pub use ahead::{Errand, Thoughts};
pub use checkpoint::Learnt;
pub use exploration::Exploration;
pub use insight::{Insight, Omission, OmissionReason, Prospect};
pub use restore::Restoring;
pub use types::{
    Ask, Best, Change, Checkpoint, Decision, Prediction, RawVisit, RestoreError, Snapshot, StateRecord,
    Statistics, TunerError, Visit,
};

use crate::configuration::Configuration;
use crate::fleet::Fleet;
use crate::knowledge::{KnownState, Record};
use crate::limits::RECORDS_PER_STUDY_MAX;
use crate::policy::{Policy, PredictorMethod};
use crate::predict::prequential::Interval;
use crate::predict::{Atlas, Predictors, Query};
use crate::study::{StudyError, StudySpec};
use crate::trial::{Fingerprint, Trial};
use crate::tuner::history::History;
use crate::tuner::screening::Screening;

/// The state machine of one study. Pure: time comes in as `now_ms`, randomness from the study's seed.
///
/// No call costs more when there are more trials; recognising a state grows with the logarithm of their number. What
/// takes milliseconds all the same can be done [apart](Errand).
#[derive(Clone, Debug)]
pub struct Tuner {
    spec: Arc<StudySpec>,
    /// State `id` sits at place `id - 1`.
    states: Vec<KnownState>,
    /// The work that goes on in each state, in the same order.
    work: Vec<Work>,
    visits: BTreeMap<String, Visit>,
    /// Open trials by number.
    open: BTreeMap<u64, Trial>,
    /// When their leases run out, soonest first.
    leases: BTreeSet<(i64, u64)>,
    /// The open trials of each client: number by state.
    held: BTreeMap<String, BTreeMap<u64, u64>>,
    /// Where the states lie.
    atlas: Atlas,
    /// Whose measurements they are.
    fleet: Fleet,
    /// What the policy's predictor needs, see [`Tuner::set_policy`].
    predictors: Predictors,
    history: History,
    screening: Screening,
    last_trial: u64,
    completed: u64,
    last_completion: u64,
    models_since: u64,
    /// How many configurations are remembered in all states, and above which count some are forgotten.
    remembered: usize,
    forget_above: usize,
    /// While a question is answered whose thinking was done before.
    thoughts: Option<Thoughts>,
    /// Whether reports leave to others what takes long.
    defers: bool,
}

/// The work that goes on in one state.
#[derive(Clone, Debug, Default, PartialEq)]
struct Work {
    exploration: Option<Exploration>,
    /// Rises whenever the exploration may have changed, so that its row is to be written.
    changes: u64,
    /// How many open trials run each configuration here. Only looked up, so its order does not matter.
    running: HashMap<Configuration, u32>,
    /// The states that other machines met the same input as: their places, nearest relations first.
    siblings: Vec<u32>,
}

impl Tuner {
    /// A tuner that has seen nothing yet.
    pub fn new(spec: Arc<StudySpec>) -> Result<Self, StudyError> {
        spec.validate()?;
        let indicators = spec.indicators.indicators().len();
        Ok(Tuner {
            atlas: Atlas::new(indicators),
            predictors: Predictors::new(spec.policy.predictor, &spec.space, indicators, spec.seed, &[]),
            fleet: Fleet::default(),
            states: Vec::new(),
            work: Vec::new(),
            visits: BTreeMap::new(),
            open: BTreeMap::new(),
            leases: BTreeSet::new(),
            held: BTreeMap::new(),
            history: History::default(),
            screening: Screening::new(&spec.space),
            last_trial: 0,
            completed: 0,
            last_completion: 0,
            models_since: 0,
            remembered: 0,
            forget_above: RECORDS_PER_STUDY_MAX,
            thoughts: None,
            defers: false,
            spec,
        })
    }

    /// The specification, with the policy in force.
    pub fn spec(&self) -> &Arc<StudySpec> {
        &self.spec
    }

    /// Replaces the policy. It takes effect with the next suggestion; trials that are out stay as they are.
    ///
    /// Only the models that the policy's predictor needs are kept. Where the new predictor needs others, they
    /// begin with the completed trials of now: they are taught the latest
    /// [`MODELS_TRIALS_MAX`](crate::limits::MODELS_TRIALS_MAX) of them, with the tables as they stand, and all that
    /// follow. The tuner does not have these trials any more, so the answer `true` asks the caller to store the
    /// policy with [`Tuner::models_since`], to drop this tuner, and to [restore](Restoring) it.
    #[must_use = "a tuner that lacks its models must be restored"]
    pub fn set_policy(&mut self, policy: Policy) -> Result<bool, StudyError> {
        policy.validate(&self.spec.space)?;
        let (before, now) = (self.spec.policy.predictor, policy.predictor);
        Arc::make_mut(&mut self.spec).policy = policy;
        if before == now || !(Predictors::are_needed(before) || Predictors::are_needed(now)) {
            return Ok(false);
        }
        self.models_since = self.last_completion;
        self.predictors = self.untaught(now);
        Ok(Predictors::are_needed(now) && self.last_completion > 0)
    }

    /// The models that a predictor needs, before they are taught anything.
    fn untaught(&self, predictor: PredictorMethod) -> Predictors {
        let indicators = self.spec.indicators.indicators().len();
        let mute: Vec<usize> = self.atlas.mute().iter().map(|mute| mute.axis).collect();
        Predictors::new(predictor, &self.spec.space, indicators, self.spec.seed, &mute)
    }

    /// The place in the order of completion at which the models in use were begun; to be stored with the policy.
    pub fn models_since(&self) -> u64 {
        self.models_since
    }

    /// An open trial.
    pub fn open_trial(&self, number: u64) -> Option<&Trial> {
        self.open.get(&number)
    }

    /// When the next lease runs out, in milliseconds of the caller's clock.
    pub fn next_expiry_ms(&self) -> Option<i64> {
        self.leases.first().map(|&(expire_ms, _)| expire_ms)
    }

    /// Counts.
    pub fn statistics(&self) -> Statistics {
        Statistics {
            states: self.states.len() as u64,
            trials: self.last_trial,
            completed_trials: self.completed,
            open_trials: self.open.len() as u64,
        }
    }

    /// How wrong each predictor was in this study: mean error with a 95 % interval, see
    /// [`prequential`](crate::predict::prequential). `Auto` stands for the choice among them.
    pub fn predictor_errors(&self) -> Vec<(PredictorMethod, Interval)> {
        self.predictors.errors()
    }

    /// The best known configuration of the state that matches the indicators, or of all states where none are given.
    /// `None` when nothing has been measured there. The state is that of the named machine if it has been there, else of
    /// the one that has reported the most frames from it.
    pub fn best(
        &self,
        indicators: Option<&BTreeMap<String, f64>>,
        fingerprint: Option<&Fingerprint>,
    ) -> Result<Option<Best>, TunerError> {
        checks::fingerprint(fingerprint)?;
        let best_of = |state: usize| self.states[state].knowledge.best().map(|best| (state, best));
        let found = match indicators {
            Some(indicators) => {
                let state = self.recognise_for(fingerprint, &self.spec.indicators.normalise(indicators)?);
                state.and_then(best_of)
            }
            None => (0..self.states.len())
                .filter_map(best_of)
                .min_by(|a, b| a.1.mean_cost.total_cmp(&b.1.mean_cost)),
        };
        Ok(found.map(|(state, record)| self.best_answer(state, record)))
    }

    /// What the best known configuration of a state costs; `None` when nothing has been measured there.
    pub fn best_cost(&self, state_id: u64) -> Option<f64> {
        let state = self.states.get(usize::try_from(state_id).ok()?.checked_sub(1)?)?;
        state.knowledge.best().map(|best| best.mean_cost)
    }

    fn best_answer(&self, state: usize, record: &Record) -> Best {
        Best {
            configuration: record.configuration.clone(),
            cost: record.mean_cost,
            default_cost: self.default_cost(state),
            measurements: record.measurements,
            state_id: self.states[state].id,
            trial: record.last_trial,
            last_measure_ms: record.last_measure_ms,
        }
    }

    /// Mean cost of the default configuration in a state, if it was measured there.
    fn default_cost(&self, state: usize) -> Option<f64> {
        let record = self.states[state].knowledge.record(self.spec.space.default_ref())?;
        (record.measurements > 0).then_some(record.mean_cost)
    }

    /// The row of a state.
    fn state_record(&self, state: usize) -> StateRecord {
        StateRecord {
            id: self.states[state].id,
            indicators: self.states[state].anchor.clone(),
            fingerprint: self.fleet.fingerprint(self.states[state].machine).cloned(),
            search: self.work[state].exploration.clone(),
        }
    }

    /// Enters an open trial into the tables.
    fn enter(&mut self, trial: Trial) {
        let state = place(trial.state_id);
        let running = self.work[state].running.entry(trial.configuration.clone());
        *running.or_insert(0) += 1;
        let held = self.held.entry(trial.client_id.clone()).or_default();
        held.insert(trial.state_id, trial.number);
        self.leases.insert((trial.lease_expire_ms, trial.number));
        self.open.insert(trial.number, trial);
    }

    /// Takes an open trial out of the tables.
    fn remove(&mut self, number: u64) -> Option<Trial> {
        let trial = self.open.remove(&number)?;
        self.leases.remove(&(trial.lease_expire_ms, number));
        let running = &mut self.work[place(trial.state_id)].running;
        if let Some(count) = running.get_mut(&trial.configuration) {
            *count -= 1;
            if *count == 0 {
                running.remove(&trial.configuration);
            }
        }
        if let Some(held) = self.held.get_mut(&trial.client_id) {
            held.remove(&trial.state_id);
            if held.is_empty() {
                self.held.remove(&trial.client_id);
            }
        }
        Some(trial)
    }
}

/// A question about a state, known or not: then the study's first machine asks.
fn query<'a>(
    spec: &'a StudySpec,
    states: &'a [KnownState],
    atlas: &'a Atlas,
    fleet: &'a Fleet,
    normalised: &'a [f64],
    here: Option<usize>,
) -> Query<'a> {
    let here = here.map(|state| &states[state]);
    let machine = here.map_or(0, |here| here.machine);
    Query { state: normalised, here, known: states, atlas, space: &spec.space, fleet, machine }
}

/// The place of a state in the tables.
fn place(state_id: u64) -> usize {
    state_id as usize - 1
}

#[cfg(test)]
mod replay_tests;
#[cfg(test)]
mod tests;
