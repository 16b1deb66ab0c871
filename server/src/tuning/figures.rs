//! Collects the figures of the studies in memory for the metrics.

use std::sync::Arc;

use super::Tuning;
use super::runtime::{Live, Runtime};
use crate::metrics::StudyFigures;

impl Tuning {
    /// Figures of the `most` studies in memory that were used last.
    pub(crate) fn figures(&self, most: usize) -> Vec<StudyFigures> {
        let now_ms = self.now_ms();
        let studies = self.last_used(most);
        let look =
            |(study, runtime): (String, Arc<Runtime>)| runtime.peek(|live| live.figures(study, now_ms));
        studies.into_iter().filter_map(look).collect()
    }
}

impl Live {
    fn figures(&self, study: String, now_ms: i64) -> StudyFigures {
        let mut statistics = self.tuner.statistics();
        let skipped = self.identity.skipped;
        debug_assert!(skipped <= statistics.trials, "{skipped} of {} are another's", statistics.trials);
        statistics.trials = statistics.trials.saturating_sub(skipped);
        let view = self.tuner.spec().objective.view();
        let errors = self.tuner.knowledge().predictor_errors().into_iter();
        StudyFigures {
            study,
            statistics,
            tally: self.tally,
            maximised: view.is_maximised().then(|| view.name().to_owned()),
            errors: errors.map(|(method, error)| (method.name(), error.mean)).collect(),
            unsaved_trials: statistics.completed_trials.saturating_sub(self.saved.completion),
            model_age_ms: self.tally.learnt_ms.map(|learnt_ms| (now_ms - learnt_ms).max(0)),
        }
    }
}

#[cfg(test)]
mod tests {
    use treewright_store::MemoryStore;

    use super::super::checkpoints::tests::{alive, explore, sweep_a_minute};
    use super::*;
    use crate::clock::ManualClock;

    /// The second lost lease of a configuration completes its trial as infeasible.
    #[tokio::test]
    async fn a_configuration_that_is_given_up_lost_its_lease_and_had_no_late_report() {
        let clock = Arc::new(ManualClock::at(1_000));
        let tuning = Tuning::new(Arc::new(MemoryStore::new()), Arc::clone(&clock) as _);
        explore(&tuning).await;
        let before = tuning.get_study("hall").await.expect("there").statistics.completed_trials;
        for _ in 0..2 {
            alive(&tuning, "one").await;
            sweep_a_minute(&tuning, &clock).await;
        }
        let after = tuning.get_study("hall").await.expect("there").statistics.completed_trials;
        assert_eq!(after, before + 1, "one is given up");
        assert_eq!(tuning.figures(1)[0].tally.expired, 2);
        let text = tuning.metrics().text(&[], |_| {}).expect("text");
        for line in ["treewright_expired_leases_total 2", "treewright_late_reports_total 0"] {
            assert!(text.contains(line), "{line} is not in\n{text}");
        }
    }
}
