//! Visits as earlier versions stored them, converted once where rows are read. See
//! [`recorded`](crate::decision::recorded).

use serde::{Deserialize, Serialize};

use crate::configuration::RawConfiguration;
use crate::decision::{Choice, Decision, ExplorationEstimate, ExploreRule};
use crate::trial::{Explanation, Mode, Reason};
use crate::tuner::VisitDecision;

/// A visit's decision as any version stored it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum RecordedVisitDecision {
    /// The form of this version.
    Now(VisitDecision<RawConfiguration>),
    /// The form of versions that stored reasons.
    Before(VisitDecisionBefore),
}

/// A visit's decision in the form of versions that stored reasons. The estimate for exploring stood beside
/// it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum VisitDecisionBefore {
    /// Points of the state's search.
    Explore,
    /// One configuration.
    Exploit {
        /// The kept configuration.
        configuration: RawConfiguration,
        /// `Exploit`, or `Default` when nothing was known.
        mode: Mode,
        /// Predicted objective, where something is known.
        predicted_cost: Option<f64>,
        /// The reason of the choice, in the words of that version.
        reason: Box<Reason>,
    },
}

impl RecordedVisitDecision {
    /// The decision; `weighed` is the estimate that was stored beside it.
    pub fn decision(self, weighed: &Explanation) -> VisitDecision<RawConfiguration> {
        let before = match self {
            RecordedVisitDecision::Now(decision) => return decision,
            RecordedVisitDecision::Before(before) => before,
        };
        if let VisitDecisionBefore::Exploit { configuration, mode, predicted_cost, reason } = before
            && let Decision { choice: Choice::Exploit(exploit), said, .. } = Decision::recorded(mode, *reason)
        {
            let exploit = Box::new(exploit);
            return VisitDecision::Exploit { configuration, predicted_cost, exploit, said };
        }
        let (rule, estimate) = (ExploreRule::recorded(weighed.rule), ExplorationEstimate::recorded(weighed));
        VisitDecision::Explore { rule, estimate }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decision::{ExploitRule, ExploitSource};

    #[test]
    fn what_earlier_versions_stored_is_read_and_written_anew() {
        let explore: RecordedVisitDecision = serde_json::from_str("\"explore\"").expect("an old row");
        let weighed: Explanation =
            serde_json::from_str(r#"{"rule":"nothing_known","epsilon":0.25}"#).expect("an old row");
        let explore = explore.decision(&weighed);
        let expected = ExplorationEstimate { epsilon: Some(0.25), ..ExplorationEstimate::default() };
        assert_eq!(explore, VisitDecision::Explore { rule: ExploreRule::NothingKnown, estimate: expected });
        let text = r#"{"exploit":{"configuration":{},"mode":"default","predicted_cost":null,"reason":{"summary":"Nothing.",
            "source":"default","step":"","neighbours":[],"explanation":{"rule":"gain","expected_gain":0.01}}}}"#;
        let exploit: RecordedVisitDecision = serde_json::from_str(text).expect("an old row");
        let exploit = exploit.decision(&Explanation::default());
        let VisitDecision::Exploit { exploit: ref kept, ref said, .. } = exploit else {
            panic!("{exploit:?}");
        };
        assert_eq!(
            (&kept.source, kept.rule, said.as_deref()),
            (&ExploitSource::Default, ExploitRule::Gain, Some("Nothing."))
        );
        assert_eq!(kept.estimate.expected_gain, Some(0.01));
        for decision in [explore, exploit] {
            let text = serde_json::to_string(&decision).expect("plain data");
            let again: RecordedVisitDecision = serde_json::from_str(&text).expect("a row");
            assert_eq!(again, RecordedVisitDecision::Now(decision));
        }
    }
}
