//! Reasons of answers. They are only written: clients show them, and decide nothing by them.

use treewright_model::trial::{Explanation, Neighbour, Reason};

use super::{WireEnum, configuration_to_wire, signed};
use crate::v1;

/// The reason of an answer.
pub fn reason_to_wire(reason: &Reason) -> v1::Reason {
    v1::Reason {
        summary: reason.summary.clone(),
        source: reason.source.clone(),
        step: reason.step.clone(),
        neighbours: reason.neighbours.iter().map(neighbour).collect(),
        explanation: (!reason.explanation.is_empty()).then(|| explanation(&reason.explanation)),
    }
}

fn neighbour(neighbour: &Neighbour) -> v1::Neighbour {
    let Neighbour { state_id, distance, best_cost } = *neighbour;
    v1::Neighbour { state_id: signed(state_id), distance, best_cost }
}

/// The figures that the policy weighed.
fn explanation(explanation: &Explanation) -> v1::Explanation {
    v1::Explanation {
        rule: explanation.rule.map_or(0, WireEnum::number),
        epsilon: explanation.epsilon,
        budget_left: explanation.budget_left,
        set_aside: explanation.set_aside,
        reference_cost: explanation.reference_cost,
        expected_gain: explanation.expected_gain,
        expected_frames: explanation.expected_frames,
        exploring_cost: explanation.exploring_cost,
        instead_of: explanation.instead_of.as_ref().map(configuration_to_wire),
        silent: explanation.silent,
    }
}

#[cfg(test)]
mod tests {
    use treewright_model::trial::Rule;

    use super::*;

    #[test]
    fn an_explanation_is_sent_where_something_was_weighed() {
        let mut reason = Reason { summary: "The best known.".into(), ..Reason::default() };
        reason.neighbours.push(Neighbour { state_id: u64::MAX, distance: 0.5, best_cost: 3.0 });
        let wire = reason_to_wire(&reason);
        assert_eq!((wire.explanation, wire.neighbours[0].state_id), (None, i64::MAX));
        reason.explanation = Explanation { epsilon: Some(0.2), ..Explanation::of(Rule::Exploit) };
        let explanation = reason_to_wire(&reason).explanation.expect("something was weighed");
        assert_eq!((explanation.rule, explanation.epsilon), (v1::Rule::Exploit as i32, Some(0.2)));
    }
}
