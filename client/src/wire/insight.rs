//! Why the service answers as it does. Rules and reasons that a newer service may know are passed over: they are for
//! people, and nothing depends on them.

use treewright_proto::v1;

use super::{Problem, configuration_from_wire};
use crate::insight::{Explanation, Omission, OmissionReason, Rule, StateInsight};

pub(crate) fn explanation_from_wire(explanation: v1::Explanation) -> Result<Explanation, Problem> {
    let instead_of = explanation.instead_of.map(|instead| configuration_from_wire(Some(instead)));
    Ok(Explanation {
        rule: rule(explanation.rule),
        epsilon: explanation.epsilon,
        budget_left: explanation.budget_left,
        set_aside: explanation.set_aside,
        reference_cost: explanation.reference_cost,
        expected_gain: explanation.expected_gain,
        expected_frames: explanation.expected_frames,
        exploring_cost: explanation.exploring_cost,
        held: explanation.held,
        instead_of: instead_of.transpose()?,
        silent: explanation.silent,
    })
}

fn rule(rule: i32) -> Option<Rule> {
    Some(match v1::Rule::try_from(rule).ok()? {
        v1::Rule::Unspecified => return None,
        v1::Rule::Explore => Rule::Explore,
        v1::Rule::NothingKnown => Rule::NothingKnown,
        v1::Rule::Exploit => Rule::Exploit,
        v1::Rule::Finished => Rule::Finished,
        v1::Rule::Budget => Rule::Budget,
        v1::Rule::Gain => Rule::Gain,
        v1::Rule::RolledBack => Rule::RolledBack,
        v1::Rule::Frozen => Rule::Frozen,
        v1::Rule::Shadow => Rule::Shadow,
        v1::Rule::Pinned => Rule::Pinned,
        v1::Rule::Wanted => Rule::Wanted,
        v1::Rule::Waiting => Rule::Waiting,
    })
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
    }
}

fn omission(omission: v1::Omission) -> Omission {
    let reason = match v1::OmissionReason::try_from(omission.reason) {
        Ok(v1::OmissionReason::Inactive) => Some(OmissionReason::Inactive),
        Ok(v1::OmissionReason::Insensitive) => Some(OmissionReason::Insensitive),
        Ok(v1::OmissionReason::BelowNoise) => Some(OmissionReason::BelowNoise),
        Ok(v1::OmissionReason::BelowCost) => Some(OmissionReason::BelowCost),
        Ok(v1::OmissionReason::Constant) => Some(OmissionReason::Constant),
        Ok(v1::OmissionReason::Redundant) => Some(OmissionReason::Redundant),
        Ok(v1::OmissionReason::Unspecified) | Err(_) => None,
    };
    Omission {
        parameter: Some(omission.parameter).filter(|name| !name.is_empty()),
        reason,
        summary: omission.summary,
        saved_trials: omission.saved_trials,
        risk: omission.risk,
    }
}
