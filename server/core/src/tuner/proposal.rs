//! The proposal of a part of the tuner, before a decision: a configuration to exploit or to measure, and why.

use crate::configuration::Configuration;
use crate::decision::{
    BudgetStatus, Choice, Exploit, ExploitRule, ExploitSource, ExplorationEstimate, ExploredPoint,
};
use crate::policy::{Operation, Policy};
use crate::session::SessionPolicy;
use crate::tuner::{Prediction, VisitDecision};

/// The grounds that an answer may rest on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Ground {
    /// Measurements alone: no client gets a configuration that was never run.
    Measured,
    /// A prediction as well, where it is worth its risk.
    Predicted,
}

impl Ground {
    /// The ground of the answers to a session.
    pub(super) fn of(policy: &Policy, session: &SessionPolicy) -> Self {
        let never_explores = session.epsilon.unwrap_or(policy.epsilon) == 0.0;
        match policy.operation == Operation::Freeze || never_explores {
            true => Ground::Measured,
            false => Ground::Predicted,
        }
    }
}

/// A configuration to measure, and why.
#[derive(Clone, Debug)]
pub(super) struct ProposedTrial {
    pub(super) configuration: Configuration,
    pub(super) predicted_cost: Option<f64>,
    pub(super) point: ExploredPoint,
}

/// A configuration to exploit.
#[derive(Clone, Debug)]
pub(super) struct Exploitation {
    pub(super) configuration: Configuration,
    pub(super) predicted_cost: Option<f64>,
    pub(super) source: ExploitSource,
    /// It replaces a predicted configuration that did clearly worse here.
    pub(super) rolled_back: bool,
}

impl Exploitation {
    /// As an answer, by a rule.
    pub(super) fn by(
        self,
        rule: ExploitRule,
        estimate: ExplorationEstimate,
        budget: BudgetStatus,
    ) -> Prediction {
        let Exploitation { configuration, predicted_cost, source, .. } = self;
        let decision = Choice::Exploit(Exploit { source, rule, estimate, budget }).decided();
        Prediction { configuration, predicted_cost, decision, insight: None }
    }

    /// As the answer to a question that runs no trial.
    pub(super) fn asked(self) -> Prediction {
        let rule = if self.rolled_back { ExploitRule::RolledBack } else { ExploitRule::Asked };
        self.by(rule, ExplorationEstimate::default(), BudgetStatus::default())
    }

    /// As the decision for a visit. A configuration that was rolled back is marked as such.
    pub(super) fn kept(self, rule: ExploitRule, estimate: ExplorationEstimate) -> VisitDecision {
        let (rule, estimate) = match self.rolled_back {
            true => (ExploitRule::RolledBack, ExplorationEstimate::default()),
            false => (rule, estimate),
        };
        let Exploitation { configuration, predicted_cost, source, .. } = self;
        let exploit = Box::new(Exploit { source, rule, estimate, budget: BudgetStatus::default() });
        VisitDecision::Exploit { configuration, predicted_cost, exploit, said: None }
    }
}
