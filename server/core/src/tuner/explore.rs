//! The next step of a state's search, for one client among several.

use crate::configuration::Configuration;
use crate::decision::{self, ExploitRule, Predicted};
use crate::ids::{StateId, TrialNumber};
use crate::predict::Answer;
use crate::trial::Trial;
use crate::tuner::exploring::{Exploiting, NextPoint, Repeats, Transfer, Walk, drawn, unseen};
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
        let exploiting = self.exploiting(planned);
        let Exploiting { standings, transfer, .. } = exploiting;
        let repeats = Repeats::of(&exploiting, &self.knowledge);
        // A session may want fewer trials than the study.
        let is_open = !standings.is_spent_within(room, state);
        if let Some(candidate) = repeats.recheck(client_id, state)
            && !is_open
            && !standings.is_to_be_confirmed(state)
        {
            return Explored::Candidate(candidate);
        }
        let candidate = is_open.then(|| transfer.untried_by_machines(state)).flatten();
        let candidate = candidate.or_else(|| first_of_a_state(&transfer, state, number, normalised, planned));
        let candidate = candidate.or_else(|| repeats.incumbent_again(client_id, room, state));
        if let Some(candidate) = candidate.or_else(|| repeats.leader_again(room, state)) {
            return Explored::Candidate(candidate);
        }
        let is_exhausted = self.searches.few().is_exhausted(self.knowledge.states.results(state));
        let shares = exploiting.wishes(&ask.session_policy).open_levels(ask.fidelities);
        let trials = &self.clients.trials;
        let mut walk = Walk::of(&self.spec, &mut self.knowledge, &mut self.searches, trials);
        walk.ensure(room, state, planned);
        let next =
            if is_exhausted { NextPoint::Wait } else { walk.next_point((room, &shares), state, planned) };
        if let NextPoint::Measure(point, configuration) = next {
            return Explored::Candidate(walk.measure(state, number, point, configuration));
        }
        let exploiting = self.exploiting(planned);
        let mut rule = match next {
            _ if is_exhausted => match Repeats::of(&exploiting, &self.knowledge).contender_again(room, state)
            {
                Some(candidate) => return Explored::Candidate(candidate),
                None if exploiting.standings.is_spent_within(room, state) => ExploitRule::Finished,
                None => ExploitRule::Waiting,
            },
            NextPoint::OnlyKnown => match unseen(&exploiting.transfer, state, number) {
                Some(configuration) => {
                    let point = decision::ExploredPoint::Random;
                    let candidate = ProposedTrial { configuration, predicted_cost: None, point };
                    return Explored::Candidate(candidate);
                }
                None => ExploitRule::Finished,
            },
            _ if exploiting.standings.is_over(room, state) => ExploitRule::Finished,
            _ => ExploitRule::Waiting,
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
        let start = checks::start_of(&self.spec.space, ask);
        let instead = exploiting.beside_start(instead, start.as_ref(), Some(state));
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
        explores
            .then(|| drawn(&self.exploiting(&Planned::AtOnce).transfer, state, TrialNumber(trial.number), of))
            .flatten()
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
