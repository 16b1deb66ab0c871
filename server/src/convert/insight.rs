//! The policy's knowledge of a state, and its omissions.

use treewright_core::tuner::{Insight, Omission};
use treewright_proto::convert::{WireEnum, signed, standing_to_wire};
use treewright_proto::v1;

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
        standing: insight.standing.as_ref().map(standing_to_wire),
    }
}

fn omission(omission: &Omission) -> v1::Omission {
    v1::Omission {
        parameter: omission.parameter.clone().unwrap_or_default(),
        reason: omission.reason.number(),
        summary: omission.summary.clone(),
        saved_trials: omission.saved_trials,
    }
}
