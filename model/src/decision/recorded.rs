//! Decisions of earlier versions, stored as a mode and a [`Reason`], whose words have to be parsed.
//!
//! They are converted once, where rows are read. The counts of a sentence (measurements, machines) are not
//! known any more, so the sentence itself is kept. A contradictory answer, which exploited by a rule of
//! exploring, becomes the true one: its search was waiting.

use serde::{Deserialize, Serialize};

use super::words::{BEST_KNOWN, DEFAULT, SHADOW, TRANSFER, WANTED};
use super::{
    BudgetStatus, ByMachines, Choice, Decision, Exploit, ExploitRule, ExploitSource, ExplorationEstimate,
    Explore, ExploreRule, ExploredPoint, MachineLevel, Predicted, Step,
};
use crate::policy::{PredictorMethod, SearchMethod};
use crate::reason::{Explanation, Mode, Neighbour, Reason, Rule};
use crate::words::Word as _;

/// A decision as any version stored it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Recorded {
    /// The form of this version.
    Decision(Decision),
    /// The form of versions without [`Decision`].
    Reason(Reason),
}

impl Recorded {
    /// The decision; `mode` is the mode that was stored beside it.
    pub fn decision(self, mode: Mode) -> Decision {
        match self {
            Recorded::Decision(decision) => decision,
            Recorded::Reason(reason) => Decision::recorded(mode, reason),
        }
    }
}

impl ExplorationEstimate {
    /// The part of it that an explanation has.
    pub fn recorded(explanation: &Explanation) -> Self {
        ExplorationEstimate {
            epsilon: explanation.epsilon,
            expected_gain: explanation.expected_gain,
            expected_frames: explanation.expected_frames,
            exploring_cost: explanation.exploring_cost,
            until: None,
        }
    }
}

impl ExploreRule {
    /// The meaning of the rule of a client that explores.
    pub fn recorded(rule: Option<Rule>) -> Self {
        match rule {
            Some(Rule::NothingKnown) => ExploreRule::NothingKnown,
            _ => ExploreRule::Dice,
        }
    }
}

impl Decision {
    /// The decision that an earlier version stored as a mode and a reason.
    pub fn recorded(mode: Mode, reason: Reason) -> Self {
        let Reason { summary, source, step, neighbours, explanation } = reason;
        let choice = match mode {
            Mode::Pinned if source == WANTED => Choice::Wanted,
            Mode::Pinned => Choice::Pinned,
            _ if source == SHADOW => Choice::Shadow {
                instead_of: explanation.instead_of.clone().unwrap_or_default(),
                expected_gain: explanation.expected_gain,
            },
            _ if step.is_empty() => Choice::Exploit(exploit(mode, &source, neighbours, &explanation)),
            _ => Choice::Explore(explore(&source, &step, neighbours, &explanation)),
        };
        Decision { silent: explanation.silent, said: Some(summary), ..choice.decided() }
    }
}

fn budget(explanation: &Explanation) -> BudgetStatus {
    let Explanation { budget_left, set_aside, reference_cost, .. } = *explanation;
    BudgetStatus { budget_left, set_aside, reference_cost }
}

fn by_machines(level: MachineLevel, neighbours: Vec<Neighbour>) -> ByMachines {
    let machines = neighbours.len() as u64;
    ByMachines { level, machines, measurements: 0, software_change: None, neighbours }
}

fn explore(source: &str, step: &str, neighbours: Vec<Neighbour>, explanation: &Explanation) -> Explore {
    let search = SearchMethod::from_word(source);
    let proposed = PredictorMethod::from_word(source).filter(|_| search.is_none());
    let point = match (Step::from_word(step), search) {
        _ if step == TRANSFER => ExploredPoint::ByMachines(by_machines(
            MachineLevel::from_word(source).unwrap_or(MachineLevel::Fleet),
            neighbours,
        )),
        (Some(Step::Default), Some(search)) => ExploredPoint::Baseline(search),
        (Some(Step::Default), None) => ExploredPoint::BaselineOfMachine,
        (Some(step), search) => match proposed {
            Some(predictor) => {
                ExploredPoint::Proposal(Predicted { predictor, expected: (0.0, 0.0), neighbours })
            }
            None => {
                let search = search.unwrap_or_default();
                let measurements = u64::from(step == Step::Replicate);
                ExploredPoint::Search { search, step, measurements, neighbours }
            }
        },
        (None, _) => ExploredPoint::Random,
    };
    Explore {
        point,
        rule: ExploreRule::recorded(explanation.rule),
        estimate: ExplorationEstimate::recorded(explanation),
        budget: budget(explanation),
        abort_above: explanation.abort_above,
    }
}

fn exploit(mode: Mode, source: &str, neighbours: Vec<Neighbour>, explanation: &Explanation) -> Exploit {
    let known = |neighbours: &[Neighbour]| neighbours.first().cloned();
    let source = match (source, MachineLevel::from_word(source), PredictorMethod::from_word(source)) {
        (DEFAULT, ..) => ExploitSource::Default,
        _ if mode == Mode::Default => ExploitSource::Default,
        (_, Some(level), _) => ExploitSource::Machines(by_machines(level, neighbours)),
        (_, _, Some(predictor)) => {
            ExploitSource::Predictor(Predicted { predictor, expected: (0.0, 0.0), neighbours })
        }
        (BEST_KNOWN, ..) | (_, None, None) => ExploitSource::BestKnown {
            tried: 0,
            measurements: 0,
            state: known(&neighbours).unwrap_or(Neighbour { state_id: 0, distance: 0.0, best_cost: 0.0 }),
            gain: None,
            is_maximised: false,
            beside_start: false,
        },
    };
    let rule = match explanation.rule {
        None => ExploitRule::Asked,
        Some(Rule::Exploit) => ExploitRule::Dice,
        Some(Rule::Finished) => ExploitRule::Finished,
        Some(Rule::Budget) => ExploitRule::Budget,
        Some(Rule::Gain) => ExploitRule::Gain,
        Some(Rule::RolledBack) => ExploitRule::RolledBack,
        Some(Rule::Frozen | Rule::Shadow | Rule::Pinned | Rule::Wanted) => ExploitRule::Frozen,
        Some(Rule::Explore | Rule::NothingKnown | Rule::Waiting | Rule::Confirming | Rule::Incumbent) => {
            ExploitRule::Waiting
        }
    };
    let (estimate, budget) = (ExplorationEstimate::recorded(explanation), budget(explanation));
    Exploit { source, rule, estimate, budget }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn old(source: &str, step: &str, explanation: Explanation) -> Reason {
        let neighbours = vec![Neighbour { state_id: 3, distance: 0.5, best_cost: 2.0 }];
        let (source, step) = (source.into(), step.into());
        Reason { summary: "As it was.".into(), source, step, neighbours, explanation }
    }

    #[test]
    fn what_earlier_versions_stored_says_the_same_and_means_the_same() {
        let stored = Explanation {
            rule: Some(Rule::Explore),
            abort_above: Some(8.0),
            budget_left: Some(1.0),
            silent: true,
            ..Explanation::default()
        };
        for (mode, source, step, rule) in [
            (Mode::Explore, "nelder_mead", "reflect", Rule::Explore),
            (Mode::Explore, "auto", "model", Rule::NothingKnown),
            (Mode::Explore, "contextual", "model", Rule::Explore),
            (Mode::Explore, "group", "transfer", Rule::Explore),
            (Mode::Explore, "random", "random_search", Rule::Explore),
            (Mode::Exploit, "best_known", "", Rule::Finished),
            (Mode::Exploit, "fleet", "", Rule::Gain),
            (Mode::Exploit, "nearest_neighbour", "", Rule::Exploit),
            (Mode::Default, "default", "", Rule::Budget),
        ] {
            let abort_above = stored.abort_above.filter(|_| mode == Mode::Explore);
            let explanation = Explanation { rule: Some(rule), abort_above, ..stored.clone() };
            let text = serde_json::to_string(&old(source, step, explanation)).expect("plain data");
            let recorded: Recorded = serde_json::from_str(&text).expect("an old row");
            let decision = recorded.decision(mode);
            let reason = decision.reason();
            assert_eq!((decision.mode(), decision.rule()), (mode, Some(rule)), "{source} {step}");
            assert_eq!((reason.source.as_str(), reason.step.as_str()), (source, step));
            assert_eq!((reason.summary.as_str(), decision.silent), ("As it was.", true));
            assert_eq!(decision.abort_above(), abort_above);
            assert_eq!(reason.explanation.budget_left, Some(1.0));
            // A row of this version is read unchanged.
            let text = serde_json::to_string(&decision).expect("plain data");
            let again: Recorded = serde_json::from_str(&text).expect("a row");
            assert_eq!(again, Recorded::Decision(decision));
        }
    }

    #[test]
    fn an_answer_that_contradicted_itself_was_waiting() {
        let explanation = Explanation { rule: Some(Rule::NothingKnown), ..Explanation::default() };
        let decision = Decision::recorded(Mode::Exploit, old("best_known", "", explanation));
        assert_eq!((decision.mode(), decision.rule()), (Mode::Exploit, Some(Rule::Waiting)));
    }
}
