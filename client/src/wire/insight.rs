//! Why the service answers as it does. Rules and reasons that only a newer service knows are shown as such.

use treewright_proto::convert::{WireEnum, readable_configuration, standing_from_wire};
use treewright_proto::v1;

use crate::insight::{Explanation, Omission, StateInsight};

pub(crate) fn explanation_from_wire(explanation: v1::Explanation) -> Explanation {
    // It is for people, who are better served by a part of it than by nothing.
    let instead_of = explanation.instead_of.map(|instead| readable_configuration(instead).0.into());
    Explanation {
        rule: WireEnum::from_number(explanation.rule),
        epsilon: explanation.epsilon,
        budget_left: explanation.budget_left,
        set_aside: explanation.set_aside,
        reference_cost: explanation.reference_cost,
        expected_gain: explanation.expected_gain,
        expected_frames: explanation.expected_frames,
        exploring_cost: explanation.exploring_cost,
        instead_of,
        silent: explanation.silent,
    }
}

pub(crate) fn state_from_wire(state: v1::StateInsight) -> StateInsight {
    StateInsight {
        state_id: state.state_id,
        tried: state.tried,
        visits: state.visits,
        frames: state.frames,
        noise: state.noise,
        outliers: state.outliers,
        drifts: state.drifts,
        expected_gain: state.expected_gain,
        expected_frames: state.expected_frames,
        exploring_cost: state.exploring_cost,
        omissions: state.omissions.into_iter().map(omission).collect(),
        standing: state.standing.map(standing_from_wire),
    }
}

fn omission(omission: v1::Omission) -> Omission {
    Omission {
        parameter: Some(omission.parameter).filter(|name| !name.is_empty()),
        reason: WireEnum::from_number(omission.reason),
        summary: omission.summary,
        saved_trials: omission.saved_trials,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_omission_names_its_parameter_if_it_is_of_one() {
        let named = |name: &str| omission(v1::Omission { parameter: name.to_owned(), ..Default::default() });
        assert_eq!(named("leaf").parameter.as_deref(), Some("leaf"));
        assert_eq!(named("").parameter, None);
    }
}
