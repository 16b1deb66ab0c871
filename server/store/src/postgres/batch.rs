//! The rows of several commits as the columns of one statement.

use std::collections::{BTreeMap, BTreeSet, HashSet};

use sqlx::postgres::PgConnection;

use super::statements as sql;
use crate::fence::Fence;
use crate::rows::{Rows, StateRow, TrialRow, VisitRow};
use treewright_core::trial::TrialState;
use treewright_core::words::Word as _;

/// Commits that share a statement. Of several changes to one row the last is kept, because a statement may
/// touch a row only once.
#[derive(Default)]
pub(super) struct Batch<'r> {
    fences: BTreeMap<i64, i64>,
    states: BTreeMap<(i64, i64), &'r StateRow>,
    visits: BTreeMap<(i64, &'r str), &'r VisitRow>,
    /// Clients whose visits are removed, none of them among the visits.
    forgotten: BTreeSet<(i64, &'r str)>,
    trials: BTreeMap<(i64, i64), &'r TrialRow>,
}

impl<'r> Batch<'r> {
    /// Adds a commit, or leaves it out when it must wait for the batch. It waits if the batch completes one
    /// of its trials, so that the database sees both changes and can refuse to change a final one. It also
    /// waits for another epoch of that study.
    pub(super) fn add(&mut self, fence: &Fence, rows: &'r Rows) -> bool {
        let study = fence.key();
        let completed = TrialState::Completed.word();
        let is_final = |row: &TrialRow| {
            self.trials.get(&(study, row.number)).is_some_and(|earlier| earlier.state == completed)
        };
        let other_epoch = self.fences.get(&study).is_some_and(|epoch| *epoch != fence.epoch());
        if other_epoch || rows.trials.iter().any(is_final) {
            return false;
        }
        self.fences.insert(study, fence.epoch());
        self.states.extend(rows.states.iter().map(|row| ((study, row.id), row)));
        for client_id in &rows.forgotten {
            self.visits.remove(&(study, client_id.as_str()));
            self.forgotten.insert((study, client_id));
        }
        for row in &rows.visits {
            self.forgotten.remove(&(study, row.client_id.as_str()));
        }
        self.visits.extend(rows.visits.iter().map(|row| ((study, row.client_id.as_str()), row)));
        self.trials.extend(rows.trials.iter().map(|row| ((study, row.number), row)));
        true
    }

    /// Whether there are no rows to store, so that only the epochs are checked.
    fn is_empty(&self) -> bool {
        self.states.is_empty()
            && self.visits.is_empty()
            && self.trials.is_empty()
            && self.forgotten.is_empty()
    }

    /// Stores the rows of studies whose epoch still holds, durably, and returns the keys of these studies.
    pub(super) async fn store(&self, connection: &mut PgConnection) -> Result<HashSet<i64>, sqlx::Error> {
        let states = || self.states.iter().map(|((study, _), row)| (*study, *row));
        let visits = || self.visits.iter().map(|((study, _), row)| (*study, *row));
        let trials = || self.trials.iter().map(|((study, _), row)| (*study, *row));
        let keys: Vec<i64> = self.fences.keys().copied().collect();
        let epochs: Vec<i64> = self.fences.values().copied().collect();
        if self.is_empty() {
            let asking = sqlx::query_scalar(sql::HELD_STUDIES).bind(keys).bind(epochs);
            return Ok(self.held(asking.fetch_all(connection).await?));
        }
        let held: Vec<i64> = sqlx::query_scalar(sql::BATCH)
            .bind(keys)
            .bind(epochs)
            .bind(column(states(), |study, _| study))
            .bind(column(states(), |_, row| row.id))
            .bind(column(states(), |_, row| row.indicators.as_str()))
            .bind(column(states(), |_, row| row.fingerprint.as_deref()))
            .bind(column(states(), |_, row| row.search_packed.as_deref()))
            .bind(column(visits(), |study, _| study))
            .bind(column(visits(), |_, row| row.client_id.as_str()))
            .bind(column(visits(), |_, row| row.state_id))
            .bind(column(visits(), |_, row| row.number))
            .bind(column(visits(), |_, row| row.decision.as_str()))
            .bind(column(visits(), |_, row| row.weighed.as_deref()))
            .bind(column(visits(), |_, row| row.account.as_deref()))
            .bind(column(trials(), |study, _| study))
            .bind(column(trials(), |_, row| row.number))
            .bind(column(trials(), |_, row| row.client_id.as_str()))
            .bind(column(trials(), |_, row| row.state_id))
            .bind(column(trials(), |_, row| row.mode.as_str()))
            .bind(column(trials(), |_, row| row.state.as_str()))
            .bind(column(trials(), |_, row| row.outcome.as_deref()))
            .bind(column(trials(), |_, row| row.outcome_reason.as_deref().map(without_nul)))
            .bind(column(trials(), |_, row| row.outcome_lower_bound))
            .bind(column(trials(), |_, row| row.cost))
            .bind(column(trials(), |_, row| row.predicted_cost))
            .bind(column(trials(), |_, row| row.late))
            .bind(column(trials(), |_, row| row.create_ms))
            .bind(column(trials(), |_, row| row.lease_expire_ms))
            .bind(column(trials(), |_, row| row.complete_ms))
            .bind(column(trials(), |_, row| row.completion))
            .bind(column(trials(), |_, row| row.configuration.as_str()))
            .bind(column(trials(), |_, row| row.indicators.as_str()))
            .bind(column(trials(), |_, row| row.measurements.as_str()))
            .bind(column(trials(), |_, row| row.reason.as_str()))
            .bind(column(trials(), |_, row| row.fingerprint.as_deref()))
            .bind(column(visits(), |_, row| row.since))
            .bind(self.forgotten.iter().map(|(study, _)| *study).collect::<Vec<_>>())
            .bind(self.forgotten.iter().map(|(_, client_id)| *client_id).collect::<Vec<_>>())
            .bind(column(trials(), |_, row| row.standard_errors.as_deref()))
            .fetch_all(connection)
            .await?;
        Ok(self.held(held))
    }

    /// The keys of studies whose epoch still holds, as they are read.
    fn held(&self, keys: Vec<i64>) -> HashSet<i64> {
        assert!(keys.len() <= self.fences.len(), "more studies are held than were asked for");
        debug_assert!(keys.iter().all(|key| self.fences.contains_key(key)), "{keys:?} were not asked for");
        keys.into_iter().collect()
    }
}

fn column<'r, R: 'r, T>(rows: impl Iterator<Item = (i64, &'r R)>, of: impl Fn(i64, &'r R) -> T) -> Vec<T> {
    rows.map(|(study, row)| of(study, row)).collect()
}

/// PostgreSQL's text cannot hold the character NUL; the replacement character stands in.
pub(super) fn without_nul(text: &str) -> String {
    text.replace('\0', "\u{fffd}")
}
