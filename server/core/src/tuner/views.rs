//! Views of the tuner: parts of its rooms joined for one step each, and its counts for the caller.

use crate::tuner::exploring::{Exploiting, Racing, Standings, Transfer};
use crate::tuner::knowledge::Knowledge;
use crate::tuner::plan::Planned;
use crate::tuner::{StudyCounts, Tuner};

impl Tuner {
    /// Counts.
    pub fn statistics(&self) -> StudyCounts {
        StudyCounts {
            states: self.knowledge.states.len() as u64,
            trials: self.clients.trials.last().0,
            completed_trials: self.knowledge.completed,
            open_trials: self.clients.trials.len() as u64,
        }
    }

    pub(super) fn standings(&self) -> Standings<'_> {
        let Tuner { spec, knowledge: Knowledge { states, assessments, .. }, searches, .. } = self;
        Standings { spec, states, searches, assessments }
    }

    pub(super) fn racing(&mut self) -> Racing<'_> {
        let Tuner { spec, knowledge: Knowledge { states, assessments, .. }, searches, .. } = self;
        Racing { spec, states, searches, assessments }
    }

    pub(super) fn exploiting<'a>(&'a self, planned: &'a Planned) -> Exploiting<'a> {
        let Tuner { spec, knowledge, clients, searches } = self;
        let (Knowledge { states, models, .. }, trials) = (knowledge, &clients.trials);
        let transfer = Transfer { spec, states, searches, trials, models, asking: None };
        Exploiting { standings: self.standings(), gain: knowledge.gain(&spec.policy), transfer, planned }
    }
}
