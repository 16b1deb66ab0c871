//! A session's own policy takes the place of the study's here and for the ground of an answer, and nowhere
//! else. By it the dice of the epsilon-greedy decision are thrown.

use rand::RngExt;

use crate::configuration::Configuration;
use crate::decision::{ExploitSource, ExplorationEstimate};
use crate::fnv;
use crate::ids::{StateId, TrialNumber};
use crate::policy::{Policy, PredictorMethod};
use crate::randomness::{Purpose, stream};
use crate::session::SessionPolicy;
use crate::tuner::Prospect;
use crate::tuner::exploring::standings::Standings;
use crate::tuner::knowledge::GainEvidence;
use crate::tuner::proposal::Ground;

/// A client that stays for this number of frames divided by epsilon explores without a draw, unless the
/// policy draws only once.
pub(super) const STAY_EXPLORES: f64 = 3.0;
/// The length of the stay changes these bits of the number by which a visit's dice are thrown.
const THROWS_SHIFT: u32 = 32;

/// The course of a visit, as far as it follows without the exploited configuration.
pub(super) enum Course {
    /// It explores.
    Explore(ExplorationEstimate),
    /// It exploits: the search is over.
    Finished,
    /// It exploits a configuration that is not known to fail: exploring does not pay.
    Weighed(ExplorationEstimate),
    /// It exploits what is known: so the dice fell.
    Drawn(ExplorationEstimate),
}

/// The policy for a session: its own wishes before the study's.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Wishes<'a> {
    pub(crate) session: &'a SessionPolicy,
    pub(crate) standings: Standings<'a>,
    pub(crate) gain: GainEvidence<'a>,
}

impl Wishes<'_> {
    pub(super) fn policy(&self) -> &Policy {
        &self.standings.spec.policy
    }

    /// The probability of exploring a state, which may be unknown yet.
    pub(crate) fn epsilon(&self, state: Option<StateId>) -> f64 {
        let by_policy = || state.map_or(self.policy().epsilon, |state| self.gain.epsilon(state));
        self.session.epsilon.unwrap_or_else(by_policy)
    }

    /// Whether it never explores, as long as anything else can be run.
    pub(crate) fn never_explores(&self) -> bool {
        self.session.epsilon.unwrap_or(self.policy().epsilon) == 0.0
    }

    /// Whether it explores every state until its search has ended, without a draw.
    pub(crate) fn explores_to_the_end(&self) -> bool {
        let has_one_state = self.standings.spec.indicators.indicators().is_empty();
        let offline = self.policy().offline || has_one_state;
        offline && self.session.epsilon.is_none() && self.policy().epsilon > 0.0
    }

    /// After how many trials a state's search is over.
    pub(crate) fn room(&self) -> usize {
        self.session.trials_per_state.unwrap_or(self.policy().trials_per_state) as usize
    }

    /// Whether a state's search is over, and confirmed.
    pub(crate) fn is_finished(&self, state: StateId) -> bool {
        self.is_spent(state) && !self.standings.is_to_be_confirmed(state)
    }

    /// Whether a state's search has spent its number of trials, confirmed or not.
    pub(crate) fn is_spent(&self, state: StateId) -> bool {
        self.standings.is_spent_within(self.room(), state)
    }

    /// The costs of the cheaper levels at which its client runs trials, as shares of a full one, if it runs
    /// any. With a budget of regret there are none, nor where the search tries every configuration.
    pub(crate) fn open_levels(&self, runs_any: bool) -> Vec<f64> {
        let room = self.room();
        let is_open = runs_any
            && self.policy().regret_budget.is_none()
            && self.standings.searches.few().count().is_none_or(|count| count > room);
        let levels = self.standings.spec.objective.fidelities().iter().filter(|_| is_open);
        levels.map(|level| level.cost).collect()
    }

    /// The name of the cheaper level at which a trial measures the point of the state's search. `None` for in
    /// full.
    pub(crate) fn cheaper_level(
        &self,
        runs_any: bool,
        number: TrialNumber,
        state: StateId,
    ) -> Option<String> {
        let own = self.standings.searches.of(state)?;
        let level = own.search.as_ref()?.level_of(*own.open.get(&number.0)?)?;
        let is_open = !self.open_levels(runs_any).is_empty();
        let level = self.standings.spec.objective.fidelities().get(level as usize).filter(|_| is_open);
        level.map(|level| level.name.clone())
    }

    /// Whether a kept configuration was never run in a state while only measurements count: something else
    /// ran there, or nothing but a model names it.
    pub(crate) fn is_unfounded(
        &self,
        state: StateId,
        (configuration, source): (&Configuration, &ExploitSource),
        start: Option<&Configuration>,
    ) -> bool {
        let results = self.standings.states.results(state);
        // The nearest neighbour names what ran in another state.
        let nearest = PredictorMethod::NearestNeighbour;
        let is_modelled = matches!(source, ExploitSource::Predictor(by) if by.predictor != nearest);
        Ground::of(self.policy(), self.session) == Ground::Measured
            && (results.best().is_some() || is_modelled)
            && results.ran(configuration).is_none()
            && start != Some(configuration)
    }

    /// The course of visit `number` of a client to a state, in a study that is not frozen.
    pub(super) fn course(&self, client_id: &str, number: u64, state: StateId) -> Course {
        let policy = self.policy();
        if self.is_finished(state) {
            return Course::Finished;
        }
        let mut estimate = ExplorationEstimate {
            epsilon: Some(self.epsilon(Some(state))),
            ..ExplorationEstimate::default()
        };
        if !(policy.weigh_gain && self.session.epsilon.unwrap_or(policy.epsilon) > 0.0) {
            let draws = self.draws(client_id, number, Some(state));
            return if draws { Course::Explore(estimate) } else { Course::Drawn(estimate) };
        }
        let Prospect { gain, frames, exploring_cost, trials } =
            self.gain.prospect(client_id, state, self.room());
        estimate.expected_gain = Some(gain);
        estimate.expected_frames = Some(frames);
        estimate.exploring_cost = Some(exploring_cost);
        // A search that its budget ended is still to be confirmed.
        if trials == 0 && !self.is_spent(state) {
            return Course::Weighed(estimate);
        }
        let until = (self.standings.states.results(state).tried() + trials) as u64;
        estimate.until = (trials > 0).then_some(until);
        Course::Explore(estimate)
    }

    /// Whether a client explores a state for which the decision of visit `number` is to be taken, as far as
    /// that is known before the exploited configuration is.
    pub(crate) fn explores(&self, client_id: &str, number: u64, state: StateId) -> bool {
        matches!(self.course(client_id, number, state), Course::Explore(_))
    }

    /// Whether the dice of visit `number` of a client to a state, known or not, fall on exploring.
    pub(crate) fn draws(&self, client_id: &str, number: u64, state: Option<StateId>) -> bool {
        if self.explores_to_the_end() {
            return true;
        }
        let epsilon = self.epsilon(state);
        let long = state.filter(|_| !self.policy().dice_once);
        let stay = long.map_or(0, |state| self.gain.history.stay(client_id, state));
        if stay as f64 * epsilon >= STAY_EXPLORES {
            return true;
        }
        // A long stay throws them again, see `Wishes::decides`.
        let throw = if stay > 1 { number ^ (stay << THROWS_SHIFT) } else { number };
        let client = fnv::hash(client_id.bytes());
        let draw: f64 = stream(self.standings.spec.seed, Purpose::Decision, client, throw).random();
        draw < epsilon
    }
}
