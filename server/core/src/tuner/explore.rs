//! The next step of a state's search, for one client among several.

use crate::configuration::Configuration;
use crate::decision::{self, ExploitRule, Predicted};
use crate::ids::{StateId, TrialNumber};
use crate::predict::Answer;
use crate::trial::Trial;
use crate::tuner::exploring::{NextPoint, Transfer, drawn, unseen};
use crate::tuner::plan::Planned;
use crate::tuner::proposal::{Exploitation, ProposedTrial};
use crate::tuner::{Ask, Tuner, checks};

/// The result of exploring.
pub(super) enum Explored {
    /// A configuration to measure.
    Candidate(ProposedTrial),
    /// By a rule, a known configuration is run instead.
    Nothing { instead: Exploitation, rule: ExploitRule },
}

impl Explored {
    /// Whether a configuration beside the default and the incumbent is measured.
    pub(super) fn explores(&self) -> bool {
        let is_baseline = |point: &decision::ExploredPoint| {
            use decision::ExploredPoint::{Baseline, BaselineOfMachine, Incumbent};
            matches!(point, Baseline(_) | BaselineOfMachine | Incumbent { .. })
        };
        matches!(self, Explored::Candidate(candidate) if !is_baseline(&candidate.point))
    }
}

impl Tuner {
    /// The configuration that a client runs in trial `number` while it explores `state`: the search's next
    /// point that is worth a measurement. Where there is none (the search waits for other clients, or the
    /// budget is spent), it is the best known, because a client never waits. The best may then change from
    /// one answer to the next: only repeats of the leaders separate luck from merit.
    pub(super) fn explore(
        &mut self,
        (ask, room): (&Ask, usize),
        state: StateId,
        number: TrialNumber,
        normalised: &[f64],
        planned: &mut Planned,
    ) -> Explored {
        let client_id = ask.client_id.as_str();
        if let Some(candidate) = self.repeats().recheck(client_id, state)
            && self.standings().is_spent_within(room, state)
            && !self.standings().is_to_be_confirmed(state)
        {
            return Explored::Candidate(candidate);
        }
        // A session may want fewer trials than the study.
        let is_open = !self.standings().is_spent_within(room, state);
        let candidate = is_open.then(|| self.transfer().untried_by_machines(state)).flatten();
        let candidate =
            candidate.or_else(|| first_of_a_state(&self.transfer(), state, number, normalised, planned));
        let candidate = candidate.or_else(|| self.repeats().incumbent_again(client_id, room, state));
        if let Some(candidate) = candidate.or_else(|| self.repeats().leader_again(room, state)) {
            return Explored::Candidate(candidate);
        }
        self.walk().ensure(room, state, planned);
        let is_exhausted = self.searches.few().is_exhausted(self.knowledge.states.results(state));
        let next = match is_exhausted {
            true => NextPoint::Wait,
            false => {
                let shares = self.wishes(&ask.session_policy).open_levels(ask.fidelities);
                self.walk().next_point((room, shares.as_slice()), state, planned)
            }
        };
        let mut rule = match next {
            NextPoint::Measure(point, configuration) => {
                return Explored::Candidate(self.walk().measure(state, number, point, configuration));
            }
            NextPoint::Wait if is_exhausted => match self.repeats().contender_again(room, state) {
                Some(candidate) => return Explored::Candidate(candidate),
                None if self.standings().is_spent_within(room, state) => ExploitRule::Finished,
                None => ExploitRule::Waiting,
            },
            NextPoint::OnlyKnown => match unseen(&self.transfer(), state, number) {
                Some(configuration) => {
                    let point = decision::ExploredPoint::Random;
                    let candidate = ProposedTrial { configuration, predicted_cost: None, point };
                    return Explored::Candidate(candidate);
                }
                None => ExploitRule::Finished,
            },
            NextPoint::Wait if self.standings().is_over(room, state) => ExploitRule::Finished,
            NextPoint::Wait => ExploitRule::Waiting,
        };
        if rule == ExploitRule::Finished {
            if let Some(candidate) = self.racing().confirm(state, number, planned) {
                return Explored::Candidate(candidate);
            }
            if self.standings().is_to_be_confirmed(state) {
                rule = ExploitRule::Waiting;
            }
        }
        let exploiting = self.exploiting(planned);
        let best = exploiting.best_known(state, None);
        let instead = best.unwrap_or_else(|| exploiting.measured_answer(normalised, Some(state)));
        let instead =
            exploiting.beside_start(instead, checks::start_of(&self.spec.space, ask).as_ref(), Some(state));
        Explored::Nothing { instead, rule }
    }

    /// In place of a trial that was to explore and that its client cannot run: a configuration without a
    /// verdict that `of` makes of another one. `None` where the trial does not explore or somebody limits its
    /// cost, and once as many configurations were tried as the policy searches.
    pub fn explored_instead(
        &self,
        (trial, ask): (&Trial, &Ask),
        of: impl Fn(Configuration) -> Option<Configuration>,
    ) -> Option<Configuration> {
        let (state, policy) = (StateId(trial.state_id), &self.spec.policy);
        let is_wanted = policy.abort_above.or(ask.session_policy.abort_above).is_some();
        let is_stopped = is_wanted && trial.decision.abort_above().is_some();
        let is_limited = policy.regret_budget.is_some() || is_stopped;
        let goes_on = self.knowledge.states.results(state).tried() < policy.trials_per_state as usize;
        let explores = trial.decision.explores() && goes_on && !is_limited;
        explores.then(|| drawn(&self.transfer(), state, TrialNumber(trial.number), of)).flatten()
    }
}

/// The first configuration of a state without measurements, if the predictor expects much gain from other
/// states' measurements. A client that stays goes on with the state's search. Where every input is met
/// only once, there is no other exploring.
fn first_of_a_state<'a>(
    transfer: &Transfer<'a>,
    state: StateId,
    number: TrialNumber,
    normalised: &'a [f64],
    planned: &Planned,
) -> Option<ProposedTrial> {
    let (answer, predictor) = transfer.first(state, number.0, normalised, planned)?;
    let Answer { configuration, expected, neighbours } = answer;
    let predicted_cost = Some(expected.cost);
    let expected = (expected.cost, expected.deviation);
    let point = decision::ExploredPoint::Proposal(Predicted { predictor, expected, neighbours });
    Some(ProposedTrial { configuration, predicted_cost, point })
}
