//! A client's own default where that is not the study's: its start.
//!
//! For the searches, races and verdicts of a state a start is one more configuration. Its runs take nothing
//! of a search's budget, and a verdict stands beside it unless it beats the incumbent. A client with a start
//! measures it before anything else that has to be compared with it. From then on its answers are those that
//! the measurements of the state show to be better than its start, which takes the place of the study's
//! default and of the incumbent. Where nothing is known, its answer is its start.

use crate::decision::{BudgetStatus, Choice, ExplorationEstimate, Explore, ExploreRule, ExploredPoint};
use crate::ids::StateId;
use crate::policy::Operation;
use crate::tuner::clients::Clients;
use crate::tuner::exploring::wishes::Wishes;
use crate::tuner::{Ask, Prediction, VisitDecision, checks};

impl Wishes<'_> {
    /// The trial of a client's start, where that has to be compared with what else ran in the state, or where
    /// the client explores. Nobody measures it twice, or again where it failed or was lost too often. A
    /// session that never explores measures nothing for that.
    pub(crate) fn start_first(&self, ask: &Ask, state: StateId, clients: &Clients) -> Option<Prediction> {
        let start = checks::start_of(&self.standings.spec.space, ask);
        let start = start.filter(|start| self.standings.may_run_start(state, start))?;
        let results = self.standings.states.results(state);
        let visit = clients.visits.of(&ask.client_id);
        let exploits = visit.is_some_and(|visit| matches!(visit.decision, VisitDecision::Exploit { .. }));
        let is_needed = !exploits || results.best().is_some();
        let may = self.policy().operation == Operation::Tune && !self.never_explores();
        let is_known = results.ran(&start).is_some() || clients.trials.runs(state, &start);
        if !(is_needed && may) || is_known {
            return None;
        }
        let explore = Explore {
            point: ExploredPoint::Start,
            rule: ExploreRule::Dice,
            estimate: ExplorationEstimate::default(),
            budget: BudgetStatus::default(),
            abort_above: None,
        };
        let decision = Choice::Explore(explore).decided();
        Some(Prediction { configuration: start, predicted_cost: None, decision, insight: None })
    }
}
