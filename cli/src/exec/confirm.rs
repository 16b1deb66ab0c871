//! The end of a session: the best of its search against the default.

use treewright_client::{Configuration, TrialRecord};

use super::pairs::Gain;
use super::summary::{Confirmed, Summary, WinnerSource};
use super::{Session, Step};
use crate::failure::Result;
use crate::progress;

impl Session<'_> {
    /// Lets the best run against the default, in turns, and says which of the two to use.
    pub(super) fn confirm(&mut self, pairs: u32, summary: &mut Summary) -> Result<()> {
        let default = &self.job.default;
        // Where nothing is proven yet, the pairs may prove it.
        let found = summary.best.as_ref().map(|best| &best.configuration).filter(|best| *best != default);
        let Some(candidate) = found.cloned().or_else(|| self.own.lowest(default)) else {
            progress::note("nothing beside the default has run, so there is nothing to confirm");
            return Ok(());
        };
        let Some(gain) = self.pairs(&candidate, pairs)? else { return Ok(()) };
        let is_certain = gain.is_certain();
        let configuration = match (is_certain, gain.low > 0.0) {
            (true, true) => &candidate,
            (true, false) => default,
            // All runs together, these among them, may know more.
            (false, _) => match self.winner() {
                Some(best) if best.configuration == candidate => &candidate,
                _ => default,
            },
        };
        let cost = if configuration == default { gain.default_cost } else { gain.cost };
        let costs = (cost, Some(gain.default_cost));
        summary.best = Some(self.job.winner_of(configuration.clone(), costs, WinnerSource::Pairs));
        summary.confirmation = Some(Confirmed { configuration: candidate, gain, is_certain });
        Ok(())
    }

    /// Each run of the pairs is reported.
    fn pairs(&mut self, candidate: &Configuration, pairs: u32) -> Result<Option<Gain>> {
        let job = self.job;
        let mut measured = Vec::new();
        'pairs: for pair in 0..pairs {
            progress::status(&format!("confirming: pair {} of {pairs}", pair + 1));
            // The order changes, so that neither always profits from the other's caches.
            let order = if pair % 2 == 0 { [&job.default, candidate] } else { [candidate, &job.default] };
            let mut costs = [None, None];
            for configuration in order {
                let step = match job.next(Some(configuration)) {
                    Ok(trial) => self.step(&TrialRecord { abort_above: None, ..trial })?,
                    Err(_) if self.is_stopped() => Step::Stopped,
                    Err(problem) => return Err(problem),
                };
                match step {
                    Step::Measured(cost) => costs[usize::from(configuration == candidate)] = Some(cost),
                    Step::Stopped => break 'pairs,
                    Step::Infeasible(_) | Step::Failed(_) | Step::Aborted | Step::Cheaper => {}
                }
            }
            if let [Some(default), Some(winner)] = costs {
                measured.push((default, winner));
            }
        }
        progress::status_end();
        Ok(Gain::of(&measured))
    }
}
