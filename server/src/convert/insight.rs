//! Domain to wire: why a policy answers as it does, and what it leaves out.

use treewright_core::trial::{Explanation, Rule};
use treewright_core::tuner::{Insight, Omission, OmissionReason};
use treewright_proto::v1;

use super::to_proto::{configuration, signed};

/// What the policy weighed.
pub(super) fn explanation(explanation: &Explanation) -> v1::Explanation {
    v1::Explanation {
        rule: explanation.rule.map_or(v1::Rule::Unspecified, rule).into(),
        epsilon: explanation.epsilon,
        budget_left: explanation.budget_left,
        set_aside: explanation.set_aside,
        reference_cost: explanation.reference_cost,
        expected_gain: explanation.expected_gain,
        expected_frames: explanation.expected_frames,
        exploring_cost: explanation.exploring_cost,
        held: explanation.held.clone(),
        instead_of: explanation.instead_of.as_ref().map(configuration),
        silent: explanation.silent,
    }
}

fn rule(rule: Rule) -> v1::Rule {
    match rule {
        Rule::Explore => v1::Rule::Explore,
        Rule::NothingKnown => v1::Rule::NothingKnown,
        Rule::Exploit => v1::Rule::Exploit,
        Rule::Finished => v1::Rule::Finished,
        Rule::Budget => v1::Rule::Budget,
        Rule::Gain => v1::Rule::Gain,
        Rule::RolledBack => v1::Rule::RolledBack,
        Rule::Frozen => v1::Rule::Frozen,
        Rule::Shadow => v1::Rule::Shadow,
        Rule::Pinned => v1::Rule::Pinned,
        Rule::Wanted => v1::Rule::Wanted,
        Rule::Waiting => v1::Rule::Waiting,
    }
}

/// What the policy knows of a state.
pub(super) fn state(insight: &Insight) -> v1::StateInsight {
    v1::StateInsight {
        state_id: signed(insight.state_id),
        tried: signed(insight.tried),
        visits: signed(insight.visits),
        frames: signed(insight.frames),
        noise: insight.noise,
        outliers: signed(insight.outliers),
        drifts: signed(insight.drifts),
        expected_gain: insight.prospect.map(|prospect| prospect.gain),
        expected_frames: insight.prospect.map(|prospect| prospect.frames),
        exploring_cost: insight.prospect.map(|prospect| prospect.exploring_cost),
        omissions: insight.omissions.iter().map(omission).collect(),
    }
}

fn omission(omission: &Omission) -> v1::Omission {
    v1::Omission {
        parameter: omission.parameter.clone().unwrap_or_default(),
        reason: match omission.reason {
            OmissionReason::Inactive => v1::OmissionReason::Inactive,
            OmissionReason::Insensitive => v1::OmissionReason::Insensitive,
            OmissionReason::BelowNoise => v1::OmissionReason::BelowNoise,
            OmissionReason::BelowCost => v1::OmissionReason::BelowCost,
            OmissionReason::Constant => v1::OmissionReason::Constant,
            OmissionReason::Redundant => v1::OmissionReason::Redundant,
        }
        .into(),
        summary: omission.summary.clone(),
        saved_trials: omission.saved_trials,
        risk: omission.risk,
    }
}
