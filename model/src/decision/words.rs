//! Decisions in words: all sentences for people about an answer are made here.

use super::{
    ByMachines, Choice, Decision, Exploit, ExploitRule, ExploitSource, Explore, ExploredPoint, MachineLevel,
    Predicted, Step,
};
use crate::cost_view::CostView;
use crate::policy::PredictorMethod;
use crate::reason::{Explanation, Neighbour, Reason};
use crate::standing::Gain;
use crate::words::Word as _;

/// The step that a configuration of other machines carries.
pub(super) const TRANSFER: &str = "transfer";
/// The sources of answers that no search and no predictor chose.
pub(super) const PINNED: &str = "pinned";
pub(super) const WANTED: &str = "wanted";
pub(super) const SHADOW: &str = "shadow";
pub(super) const DEFAULT: &str = "default";
pub(super) const START: &str = "start";
pub(super) const BEST_KNOWN: &str = "best_known";
pub(super) const PORTFOLIO: &str = "portfolio";
pub(super) const RANDOM: &str = "random";
pub(super) const CONFIRMATION: &str = "confirmation";
pub(super) const INCUMBENT: &str = "incumbent";

pub(super) fn reason(decision: &Decision) -> Reason {
    let (source, step) = source(&decision.choice);
    Reason {
        summary: decision.said.clone().unwrap_or_else(|| match &decision.origin {
            Some(origin) => format!("It was measured elsewhere, as {origin}, and carried over."),
            None => summary(&decision.choice),
        }) + of_lost(decision.lost_leases)
            + &of_level(decision.fidelity.as_deref()),
        source: source.to_owned(),
        step: step.to_owned(),
        neighbours: neighbours(&decision.choice).to_vec(),
        explanation: explanation(decision),
    }
}

/// The names of the source of the configuration and of the asking step, as in reasons.
fn source(choice: &Choice) -> (&'static str, &'static str) {
    match choice {
        Choice::Pinned => (PINNED, ""),
        Choice::Wanted => (WANTED, ""),
        Choice::Shadow { .. } => (SHADOW, ""),
        Choice::Explore(Explore { point, .. }) => match point {
            ExploredPoint::Baseline(search) => (search.name(), Step::Default.word()),
            ExploredPoint::BaselineOfMachine => (DEFAULT, Step::Default.word()),
            ExploredPoint::Start => (START, Step::Default.word()),
            ExploredPoint::Search { search, step, .. } => (search.name(), step.word()),
            ExploredPoint::Proposal(predicted) => (predicted.predictor.name(), Step::Model.word()),
            ExploredPoint::ByMachines(by) => (by.level.word(), TRANSFER),
            ExploredPoint::Random => (RANDOM, Step::RandomSearch.word()),
            ExploredPoint::Confirming { .. } => (CONFIRMATION, Step::Replicate.word()),
            ExploredPoint::Incumbent { round: Some(_), .. } => (CONFIRMATION, Step::Replicate.word()),
            ExploredPoint::Incumbent { round: None, .. } => (INCUMBENT, Step::Replicate.word()),
        },
        Choice::Exploit(Exploit { source, .. }) => match source {
            ExploitSource::Default => (DEFAULT, ""),
            ExploitSource::BestKnown { .. } => (BEST_KNOWN, ""),
            ExploitSource::Incumbent { .. } => (INCUMBENT, ""),
            ExploitSource::Portfolio { .. } => (PORTFOLIO, ""),
            ExploitSource::Predictor(predicted) => (predicted.predictor.name(), ""),
            ExploitSource::Machines(by) => (by.level.word(), ""),
        },
    }
}

fn neighbours(choice: &Choice) -> &[Neighbour] {
    match choice {
        Choice::Explore(Explore { point, .. }) => match point {
            ExploredPoint::Search { neighbours, .. }
            | ExploredPoint::Proposal(Predicted { neighbours, .. })
            | ExploredPoint::ByMachines(ByMachines { neighbours, .. }) => neighbours,
            _ => &[],
        },
        Choice::Exploit(Exploit { source, .. }) => match source {
            ExploitSource::BestKnown { state, .. } => std::slice::from_ref(state),
            ExploitSource::Portfolio { neighbours, .. }
            | ExploitSource::Predictor(Predicted { neighbours, .. })
            | ExploitSource::Machines(ByMachines { neighbours, .. }) => neighbours,
            ExploitSource::Default | ExploitSource::Incumbent { .. } => &[],
        },
        Choice::Pinned | Choice::Wanted | Choice::Shadow { .. } => &[],
    }
}

/// The figures that the policy weighed.
fn explanation(decision: &Decision) -> Explanation {
    let mut explanation =
        Explanation { rule: decision.rule(), silent: decision.silent, ..Explanation::default() };
    let (estimate, budget) = match &decision.choice {
        Choice::Pinned | Choice::Wanted => return explanation,
        Choice::Shadow { instead_of, expected_gain } => {
            explanation.instead_of = Some(instead_of.clone());
            explanation.expected_gain = *expected_gain;
            return explanation;
        }
        Choice::Explore(explore) => {
            explanation.abort_above = explore.abort_above;
            (explore.estimate, explore.budget)
        }
        Choice::Exploit(exploit) => (exploit.estimate, exploit.budget),
    };
    Explanation {
        epsilon: estimate.epsilon,
        expected_gain: estimate.expected_gain,
        expected_frames: estimate.expected_frames,
        exploring_cost: estimate.exploring_cost,
        budget_left: budget.budget_left,
        set_aside: budget.set_aside,
        reference_cost: budget.reference_cost,
        ..explanation
    }
}

/// One plain sentence, or two.
fn summary(choice: &Choice) -> String {
    match choice {
        Choice::Pinned => "The policy pins this configuration.".into(),
        Choice::Wanted => "The client asked for this configuration.".into(),
        Choice::Shadow { .. } => "The study answers the default and learns silently.".into(),
        Choice::Explore(explore) => of_point(&explore.point),
        Choice::Exploit(exploit) => of_exploit(exploit),
    }
}

fn of_lost(leases: u32) -> &'static str {
    match leases {
        0 => "",
        1 => " A lease of it was lost here; after another it counts as infeasible in this state.",
        _ => " Its leases were lost here again and again: it counts as infeasible in this state.",
    }
}

fn of_level(fidelity: Option<&str>) -> String {
    fidelity.map_or_else(String::new, |level| {
        format!(" It runs at the level {level}, to see whether a full trial is worth its cost.")
    })
}

fn of_point(point: &ExploredPoint) -> String {
    match point {
        ExploredPoint::Baseline(_) => "The baseline comes first in a state that is explored.".into(),
        ExploredPoint::BaselineOfMachine => {
            "The baseline comes first: by it this machine is compared with the others.".into()
        }
        ExploredPoint::Start => {
            "The client's own default comes first in a state: its answers there are told beside it.".into()
        }
        ExploredPoint::Search { measurements: 0, step: Step::Elsewhere, .. } => {
            "It did well in other states; here it was not measured yet.".into()
        }
        ExploredPoint::Search { measurements: 0, .. } => "The next point of the state's search.".into(),
        ExploredPoint::Search { measurements, .. } => {
            format!("Another replicate, after {measurements} measurements.")
        }
        ExploredPoint::Proposal(Predicted { expected, .. }) => format!(
            "Nothing was measured in this state; by what is known of others this may do better than the rest, if its \
             cost is predicted well{}.",
            uncertainty(*expected)
        ),
        ExploredPoint::ByMachines(by) => of_machines(by),
        ExploredPoint::Confirming { round, rounds_max } => format!(
            "One of the best few of the search runs against the incumbent: round {round} of at most {rounds_max}."
        ),
        ExploredPoint::Incumbent { round: Some(round), .. } => {
            format!("The incumbent runs against the best few of the search: round {round}.")
        }
        ExploredPoint::Incumbent { round: None, .. } => {
            "The incumbent is measured again: it shows the speed of the machine.".into()
        }
        ExploredPoint::Random => {
            "The search only met known configurations; this one was drawn at random.".into()
        }
    }
}

fn of_exploit(exploit: &Exploit) -> String {
    let said = match (&exploit.source, exploit.rule) {
        (ExploitSource::Default, ExploitRule::Budget) => {
            return "The baseline must be measured before anything is explored within a budget.".into();
        }
        (ExploitSource::Default, _) => "Nothing better is known yet.".to_owned(),
        (ExploitSource::BestKnown { tried, measurements, gain, is_maximised, beside_start, .. }, _) => {
            let mut said = format!(
                "Best of {tried} configurations tried in this state; its cost rests on {measurements} measurements."
            );
            if let Some(Gain { share, low: Some(low), high: Some(high), .. }) = *gain {
                let (view, default) = (view(*is_maximised), default_words(*beside_start));
                let [share, low, high] = [share, low, high].map(|share| view.percent(share));
                said.push_str(&match *is_maximised {
                    true => format!(" Its value lies {share} % above {default}'s ({low} to {high} %)."),
                    false => format!(" It costs {share} % less than {default} ({low} to {high} %)."),
                });
            }
            said
        }
        (ExploitSource::Incumbent { tried, gain_at_most, is_maximised, beside_start }, _) => {
            let default = default_words(*beside_start);
            let tried =
                format!("Nothing better is proven: of {tried} configurations tried in this state none");
            match gain_at_most {
                Some(most) => {
                    let most = view(*is_maximised).percent(*most);
                    format!("{tried} is likely to gain more than {most} % over {default}.")
                }
                None => format!("{tried} was shown to gain anything over {default}."),
            }
        }
        (ExploitSource::Portfolio { states, .. }, _) => {
            format!(
                "Nothing that can be run was measured here yet; of what {states} known states answer this serves them \
                 best on average."
            )
        }
        (ExploitSource::Predictor(predicted), _) => of_predictor(predicted),
        (ExploitSource::Machines(by), _) => of_machines(by),
    };
    match exploit.rule {
        ExploitRule::RolledBack => said + " What was predicted did clearly worse here.",
        ExploitRule::Budget => said + " Exploring has to wait for its budget.",
        ExploitRule::Waiting => said + " The search waits for what others are measuring.",
        _ => said,
    }
}

/// What a gain is told over.
fn default_words(beside_start: bool) -> &'static str {
    if beside_start { "the client's own default" } else { "the default" }
}

/// The view in which a gain is told: by the cost, or by what is maximised, whose name stands elsewhere.
fn view(is_maximised: bool) -> CostView {
    if is_maximised { CostView::maximising("", 1.0) } else { CostView::default() }
}

fn of_predictor(predicted: &Predicted) -> String {
    let Predicted { predictor, expected, neighbours } = predicted;
    match (predictor, neighbours.first()) {
        (PredictorMethod::NearestNeighbour, Some(Neighbour { state_id, distance, .. })) => format!(
            "Not measured here: the answer of state {state_id}, the nearest known one, at distance {distance:.4}."
        ),
        _ => format!(
            "Predicted, not measured here: the model learnt from all trials expects so much less cost of it{} than of \
             what was measured that it is worth its risk.",
            uncertainty(*expected)
        ),
    }
}

/// The deviation of an expected cost as a share of it. The cost itself stands beside these words, in the
/// study's view.
fn uncertainty((cost, deviation): (f64, f64)) -> String {
    if cost > 0.0 { format!(" (± {:.1} %)", 100.0 * deviation / cost) } else { String::new() }
}

fn of_machines(by: &ByMachines) -> String {
    let ByMachines { level, machines, measurements, software_change, .. } = by;
    let who = match level {
        MachineLevel::Group => "with the same processor and software",
        MachineLevel::Machine | MachineLevel::Fleet => "of the fleet",
    };
    let mut said = format!(
        "Best by what {machines} other machines {who} measured in this state, {measurements} times; this one has less \
         to say of it itself."
    );
    if let Some(changes) = software_change {
        said.push_str(&format!(
            " What this machine measured before its software changed ({changes}) counts as the fleet's only."
        ));
    }
    said
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decision::{BudgetStatus, ExplorationEstimate};

    /// The words for a configuration that costs a fifth less than the default, 10 % to 50 %.
    fn said(source: impl Fn(bool) -> ExploitSource) -> [String; 2] {
        let (estimate, budget) = (ExplorationEstimate::default(), BudgetStatus::default());
        let of = |source| of_exploit(&Exploit { source, rule: ExploitRule::Dice, estimate, budget });
        [false, true].map(|is_maximised| of(source(is_maximised)))
    }

    #[test]
    fn a_gain_is_told_of_the_cost_or_of_what_is_maximised() {
        let gain = Gain { share: 0.2, low: Some(0.1), high: Some(0.5), probability_better: None };
        let state = Neighbour { state_id: 1, distance: 0.0, best_cost: 8.0 };
        let [cost, rate] = said(|is_maximised| ExploitSource::BestKnown {
            tried: 9,
            measurements: 3,
            state: state.clone(),
            gain: Some(gain),
            is_maximised,
            beside_start: false,
        });
        assert!(cost.ends_with(" It costs 20.0 % less than the default (10.0 to 50.0 %)."), "{cost}");
        assert!(rate.ends_with(" Its value lies 25.0 % above the default's (11.1 to 100.0 %)."), "{rate}");
        let incumbent = |gain_at_most, is_maximised| ExploitSource::Incumbent {
            tried: 9,
            gain_at_most,
            is_maximised,
            beside_start: is_maximised,
        };
        let [unknown, own] = said(|is_maximised| incumbent(None, is_maximised));
        assert!(unknown.ends_with("none was shown to gain anything over the default."), "{unknown}");
        assert!(own.ends_with("none was shown to gain anything over the client's own default."), "{own}");
        let [cost, rate] = said(|is_maximised| incumbent(Some(0.2), is_maximised));
        assert!(cost.contains("more than 20.0 % over"), "{cost}");
        assert!(rate.contains("more than 25.0 % over"), "{rate}");
    }
}
