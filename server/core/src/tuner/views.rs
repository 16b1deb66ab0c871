//! Views of the tuner: its parts joined for one step each, and those for its caller.

use std::collections::BTreeMap;

use crate::configuration::Configuration;
use crate::ids::StateId;
use crate::policy::PredictorMethod;
use crate::predict::prequential::ErrorInterval;
use crate::session::SessionPolicy;
use crate::trial::{Fingerprint, Trial};
use crate::tuner::exploring::{Exploiting, Racing, Repeats, Standings, Transfer, Walk};
use crate::tuner::knowledge::GainEvidence;
use crate::tuner::learning::Learning;
use crate::tuner::plan::Planned;
use crate::tuner::session::Wishes;
use crate::tuner::{Ask, Best, Prediction, Question, StudyCounts, Tuner, TunerError, checks};

impl Tuner {
    /// Counts.
    pub fn statistics(&self) -> StudyCounts {
        StudyCounts {
            states: self.states.len() as u64,
            trials: self.trials.last().0,
            completed_trials: self.completed,
            open_trials: self.trials.len() as u64,
        }
    }

    /// The open trials, by rising number.
    pub fn open_trials(&self) -> impl Iterator<Item = &Trial> {
        self.trials.all()
    }

    /// The known state of a client's question; `None` where it is new, or the question is not valid.
    pub fn state_of(&self, ask: &Ask) -> Option<u64> {
        Some(self.question(ask).ok()?.state?.get())
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
        Some(Best {
            configuration: record.configuration.clone(),
            cost: results.reported(&record.configuration, record.mean_cost),
            measurements: record.measurements,
            trial: record.last_trial,
            last_measure_ms: record.last_measure_ms,
            ..best
        })
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

    pub(super) fn recognised<'a>(&self, ask: &'a Ask, normalised: Vec<f64>) -> Question<'a> {
        let current = self.visits.state_of(&ask.client_id);
        let state = self.states.recognise(current, ask.fingerprint.as_ref(), &normalised);
        Question { ask, normalised, state }
    }

    pub(super) fn recognise_for(
        &self,
        fingerprint: Option<&Fingerprint>,
        normalised: &[f64],
    ) -> Option<StateId> {
        self.states.recognise_for(fingerprint, normalised, |state| self.history.frames(state))
    }

    pub(super) fn prediction(
        &self,
        indicators: &BTreeMap<String, f64>,
        fingerprint: Option<&Fingerprint>,
        start: Option<&Configuration>,
        planned: &Planned,
    ) -> Result<Prediction, TunerError> {
        checks::fingerprint(fingerprint)?;
        let normalised = self.spec.indicators.normalise(indicators)?;
        let here = self.recognise_for(fingerprint, &normalised);
        let ground = self.wishes(&SessionPolicy::default()).ground();
        let exploit = || self.exploiting(planned).exploitation(start, &normalised, here, ground).asked();
        let prediction = self.pinned().unwrap_or_else(exploit);
        Ok(Prediction { insight: here.map(|here| self.insight(here, start, planned)), ..prediction })
    }

    pub(super) fn gain(&self) -> GainEvidence<'_> {
        let Tuner { spec, states, history, .. } = self;
        GainEvidence { policy: &spec.policy, states, history }
    }

    pub(super) fn standings(&self) -> Standings<'_> {
        let Tuner { spec, states, searches, assessments, .. } = self;
        Standings { spec, states, searches, assessments }
    }

    pub(super) fn racing(&mut self) -> Racing<'_> {
        let Tuner { spec, states, searches, assessments, .. } = self;
        Racing { spec, states, searches, assessments }
    }

    pub(super) fn repeats(&self) -> Repeats<'_> {
        let Tuner { speeds, rechecks, auxiliaries, .. } = self;
        Repeats { standings: self.standings(), transfer: self.transfer(), speeds, rechecks, auxiliaries }
    }

    pub(super) fn walk(&mut self) -> Walk<'_> {
        let Tuner { spec, states, searches, trials, models, .. } = self;
        Walk { spec, states, searches, trials, models }
    }

    pub(super) fn learning(&mut self) -> Learning<'_> {
        let Tuner { spec, states, history, speeds, rechecks, auxiliaries, models, searches, .. } = self;
        Learning { spec, states, history, speeds, rechecks, auxiliaries, models, searches }
    }

    pub(super) fn exploiting<'a>(&'a self, planned: &'a Planned) -> Exploiting<'a> {
        Exploiting { standings: self.standings(), gain: self.gain(), transfer: self.transfer(), planned }
    }

    pub(super) fn wishes<'a>(&'a self, session: &'a SessionPolicy) -> Wishes<'a> {
        Wishes { session, standings: self.standings(), gain: self.gain() }
    }

    pub(super) fn transfer(&self) -> Transfer<'_> {
        let Tuner { spec, states, searches, trials, models, .. } = self;
        Transfer { spec, states, searches, trials, models, asking: None }
    }

    /// The state whose best is asked for.
    pub(super) fn best_state(
        &self,
        indicators: Option<&BTreeMap<String, f64>>,
        fingerprint: Option<&Fingerprint>,
    ) -> Result<Option<StateId>, TunerError> {
        checks::fingerprint(fingerprint)?;
        let best_of =
            |state: &StateId| self.states.results(*state).believed_best().map(|best| best.mean_cost);
        match indicators {
            Some(indicators) => {
                let state = self.recognise_for(fingerprint, &self.spec.indicators.normalise(indicators)?);
                Ok(state.filter(|state| best_of(state).is_some()))
            }
            None => {
                let all = self.states.ids().filter_map(|state| Some((state, best_of(&state)?)));
                Ok(all.min_by(|a, b| a.1.total_cmp(&b.1)).map(|(state, _)| state))
            }
        }
    }
}
