//! Whether exploring is worth it, and whether it can be afforded: the rules of the policy beside the dice.

use crate::configuration::Configuration;
use crate::policy::{ABORT_ABOVE_DEFAULT, Operation, Policy};
use crate::predict::atlas::Mute;
use crate::search::Verdict;
use crate::trial::{Explanation, Mode, Rule};
use crate::tuner::account::{Denied, Leave, Terms};
use crate::tuner::decide::plain_reason;
use crate::tuner::{Account, Ask, Insight, Omission, OmissionReason, Prediction, Prospect, Tuner};

/// The noise that is assumed before anything was measured twice: of frames, a tenth.
pub(super) const NOISE_PRIOR: f64 = 0.1;
/// Noise is never taken to be less: timers and clocks are not that good.
pub(super) const NOISE_LEAST: f64 = 0.01;
/// Standard deviations by which a configuration must be dearer to be called clearly worse.
const CLEARLY: f64 = 3.0;
/// More measurements than this say nothing more about a configuration.
const MEASUREMENTS_COUNTED: u64 = 16;

/// On which terms a policy lets clients explore within a budget.
pub(super) fn terms(policy: &Policy, budget: f64) -> Terms {
    let abort_above = policy.abort_above.unwrap_or(ABORT_ABOVE_DEFAULT);
    Terms { budget, abort_above, worst_factor: policy.worst_factor }
}

impl Tuner {
    /// The probability of exploring a state, after the visits that it has had.
    pub(super) fn epsilon(&self, state: usize) -> f64 {
        let policy = &self.spec.policy;
        if policy.epsilon_halves_after == 0 {
            return policy.epsilon;
        }
        let half = f64::from(policy.epsilon_halves_after);
        policy.epsilon * half / (half + self.history.visits(state) as f64)
    }

    /// What going on with the search of a state is expected to bring this client's frames and all others.
    pub(super) fn prospect(&self, client_id: &str, state: usize) -> Prospect {
        let tried = self.states[state].knowledge.tried();
        let left = (self.spec.policy.trials_per_state as usize).saturating_sub(tried);
        let (gain, gain_at_most) = self.history.gains(state, tried);
        Prospect {
            gain,
            gain_at_most,
            frames: self.history.frames_ahead(client_id, state),
            exploring_cost: self.history.excess() * left as f64,
        }
    }

    /// Why exploring the state is not worth it; `None` when it is.
    pub(super) fn not_worth(&self, state: usize, prospect: &Prospect) -> Option<OmissionReason> {
        let noise = self.states[state].knowledge.noise();
        if noise.is_some_and(|noise| prospect.gain_at_most < noise) {
            return Some(OmissionReason::BelowNoise);
        }
        let pays = prospect.gain * prospect.frames > prospect.exploring_cost;
        (!pays).then_some(OmissionReason::BelowCost)
    }

    /// Whether a configuration does clearly worse in a state than the best that was measured there.
    pub(super) fn does_clearly_worse(&self, state: usize, configuration: &Configuration) -> bool {
        let knowledge = &self.states[state].knowledge;
        let (Some(own), Some(best)) = (knowledge.record(configuration), knowledge.best()) else {
            return false;
        };
        // One frame is no evidence.
        if own.measurements < 2 || best.configuration == *configuration {
            return false;
        }
        let noise = knowledge.noise().unwrap_or(NOISE_PRIOR).max(NOISE_LEAST);
        let part = |measurements: u64| 1.0 / measurements.clamp(1, MEASUREMENTS_COUNTED) as f64;
        let margin = CLEARLY * noise * (part(own.measurements) + part(best.measurements)).sqrt();
        own.mean_cost > best.mean_cost * (1.0 + margin)
    }

    /// Opens the client's account if the policy keeps one, and notes where the client is.
    pub(super) fn keep_account(&mut self, ask: &Ask, state_id: u64) {
        let policy = &self.spec.policy;
        let wanted = policy.regret_budget.is_some() || policy.warm_up > 0;
        let first_trial = self.last_trial + 1;
        let Some(visit) = self.visits.get_mut(&ask.client_id) else {
            return;
        };
        let current = visit.account.take().filter(|account| account.is_of(ask.session));
        visit.account = wanted.then(|| current.unwrap_or_else(|| Account::open(ask.session, first_trial)));
        if let Some(account) = &mut visit.account {
            account.enter(state_id);
        }
    }

    pub(super) fn account_mut(&mut self, client_id: &str) -> Option<&mut Account> {
        self.visits.get_mut(client_id)?.account.as_mut()
    }

    /// Counts the trial that is about to be handed out in its session, and tells whether it is not to be learnt.
    pub(super) fn is_silent(&mut self, client_id: &str) -> bool {
        let warm_up = u64::from(self.spec.policy.warm_up);
        let frozen = self.spec.policy.operation == Operation::Freeze;
        let before = self.account_mut(client_id).map(Account::count);
        frozen || before.is_some_and(|before| before < warm_up)
    }

    /// The search's next point where the budget allows it, told to stop at the policy's cap.
    pub(super) fn explore_within_means(
        &mut self,
        ask: &Ask,
        number: u64,
        normalised: &[f64],
        state: usize,
    ) -> Prediction {
        let policy = &self.spec.policy;
        let weighed = self.visits.get(&ask.client_id).map(|visit| visit.weighed.clone()).unwrap_or_default();
        let account = self.visits.get(&ask.client_id).and_then(|visit| visit.account.as_ref());
        let (Some(budget), Some(account)) = (policy.regret_budget, account) else {
            let cap = policy.abort_above;
            let reference = self.states[state].knowledge.best().map(|best| best.mean_cost);
            let mut prediction = self.explore(state, number, normalised);
            let explanation = &mut prediction.reason.explanation;
            let held = std::mem::take(&mut explanation.held);
            *explanation = Explanation { held, ..weighed };
            if prediction.mode == Mode::Explore
                && let (Some(factor), Some(reference)) = (cap, reference)
            {
                explanation.reference_cost = Some(reference);
                explanation.abort_above = Some(factor * reference).filter(|cost| cost.is_finite());
            }
            return prediction;
        };
        match account.leave(terms(policy, budget), ask.can_abort, self.default_runs(state)) {
            Ok(leave) => self.explore_on(leave, weighed, ask, number, normalised, state),
            Err(denied) => {
                let left = account.left(budget);
                self.keep_to_the_baseline(denied, left, weighed, number, normalised, state)
            }
        }
    }

    /// Explores with enough set aside for the worst.
    fn explore_on(
        &mut self,
        leave: Leave,
        weighed: Explanation,
        ask: &Ask,
        number: u64,
        normalised: &[f64],
        state: usize,
    ) -> Prediction {
        let mut prediction = self.explore(state, number, normalised);
        let held = std::mem::take(&mut prediction.reason.explanation.held);
        let mut explanation = Explanation {
            held,
            budget_left: Some(leave.left),
            reference_cost: Some(leave.reference),
            ..weighed
        };
        if prediction.mode == Mode::Explore {
            explanation.set_aside = Some(leave.set_aside);
            explanation.abort_above = Some(leave.abort_above);
            if let Some(account) = self.account_mut(&ask.client_id) {
                account.set_aside(number, leave.set_aside);
            }
        }
        prediction.reason.explanation = explanation;
        prediction
    }

    /// Whether the default can be run in a state, as far as is known.
    pub(super) fn default_runs(&self, state: usize) -> bool {
        let settled = self.states[state].knowledge.settled(self.spec.space.default_ref(), 1);
        settled != Some(Verdict::Infeasible)
    }

    /// What is run while the budget does not allow exploring: the default once in each stay, so that what exploring
    /// costs can be told, then the best that was measured there. Where there is neither, the only way on is to explore.
    fn keep_to_the_baseline(
        &mut self,
        denied: Denied,
        left: f64,
        weighed: Explanation,
        number: u64,
        normalised: &[f64],
        state: usize,
    ) -> Prediction {
        let default = self.spec.space.default_ref().clone();
        let mut prediction = if matches!(denied, Denied::NoReference) && self.default_runs(state) {
            let summary =
                "The baseline must be measured before anything is explored within a budget.".to_owned();
            Prediction {
                configuration: default,
                mode: Mode::Default,
                predicted_cost: self.default_cost(state),
                reason: plain_reason("default", summary),
                insight: None,
            }
        } else if let Some(mut known) = self.best_known(state) {
            known.reason.summary.push_str(" Exploring has to wait for its budget.");
            known
        } else {
            return self.explore(state, number, normalised);
        };
        let (set_aside, reference_cost) = match denied {
            Denied::NoReference => (None, None),
            Denied::TooLittle(leave) => (Some(leave.set_aside), Some(leave.reference)),
        };
        prediction.reason.explanation = Explanation {
            rule: Some(Rule::Budget),
            budget_left: Some(left),
            set_aside,
            reference_cost,
            ..weighed
        };
        prediction
    }

    /// Parameters that the search of a state leaves out, and why.
    fn omitted_parameters(&self, state: usize, omissions: &mut Vec<Omission>) {
        let space = &self.spec.space;
        let best = self.states[state].knowledge.best();
        let held = self.work[state].exploration.as_ref().and_then(|exploration| exploration.held.as_ref());
        for (axis, parameter) in space.parameters().iter().enumerate() {
            // To try each of its other values once.
            let saved_trials = parameter.domain.alternatives() as f64;
            let mut add = |reason, summary, risk| {
                let parameter = Some(parameter.name.clone());
                omissions.push(Omission { parameter, reason, summary, saved_trials, risk });
            };
            let is_active = best.is_none_or(|best| best.configuration.get(&parameter.name).is_some());
            if let (false, Some(condition)) = (is_active, &parameter.active_if) {
                let summary =
                    format!("it means nothing beside the best known value of {}", condition.parameter);
                add(OmissionReason::Inactive, summary, None);
            } else if let Some(held) = held.and_then(|held| held.axes.iter().find(|held| held.axis == axis)) {
                let summary = format!(
                    "no other value gains more than {:.2} % (held since {} configurations were tried)",
                    100.0 * held.gain_at_most,
                    held.since
                );
                add(OmissionReason::Insensitive, summary, self.spec.policy.freeze_risk);
            }
        }
    }

    /// Indicators that predictors do not look at, and why.
    fn omitted_indicators(&self, omissions: &mut Vec<Omission>) {
        let name = |axis: usize| self.spec.indicators.indicators()[axis].name.clone();
        let states = self.atlas.spread().states();
        for Mute { axis, says } in self.atlas.mute() {
            let (reason, summary) = match says {
                None => (OmissionReason::Constant, format!("it is the same in all {states} states")),
                Some(other) => {
                    let summary =
                        format!("in all {states} states it follows {} in a straight line", name(other));
                    (OmissionReason::Redundant, summary)
                }
            };
            let parameter = Some(name(axis));
            omissions.push(Omission { parameter, reason, summary, saved_trials: 0.0, risk: None });
        }
    }

    /// What is known of a state.
    pub(super) fn insight(&self, state: usize) -> Insight {
        let knowledge = &self.states[state].knowledge;
        let prospect = self.prospect("", state);
        let left = (self.spec.policy.trials_per_state as usize).saturating_sub(knowledge.tried());
        let mut omissions = Vec::new();
        if self.spec.policy.weigh_gain
            && !self.is_finished(state)
            && let Some(reason) = self.not_worth(state, &prospect)
        {
            let percent = 100.0 * prospect.gain_at_most;
            let noise = 100.0 * knowledge.noise().unwrap_or(0.0);
            let summary = match reason {
                OmissionReason::BelowNoise => {
                    format!("at most {percent:.1} % can be gained, less than frames vary ({noise:.1} %)")
                }
                _ => format!(
                    "a gain of {:.1} % over {:.0} frames does not pay for exploring worth {:.1} frames",
                    100.0 * prospect.gain,
                    prospect.frames,
                    prospect.exploring_cost
                ),
            };
            let saved_trials = left as f64;
            omissions.push(Omission { parameter: None, reason, summary, saved_trials, risk: None });
        }
        self.omitted_parameters(state, &mut omissions);
        self.omitted_indicators(&mut omissions);
        Insight {
            state_id: self.states[state].id,
            tried: knowledge.tried() as u64,
            visits: self.history.visits(state),
            frames: self.history.frames(state),
            noise: knowledge.noise(),
            outliers: knowledge.outliers(),
            drifts: knowledge.drifts(),
            prospect: (!self.is_finished(state)).then_some(prospect),
            omissions,
        }
    }
}
