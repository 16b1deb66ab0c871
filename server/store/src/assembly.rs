//! From rows to answers: the steps that both databases share once the rows are read.

use treewright_core::ids::StudyUid;
use treewright_core::trial::{RawTrial, Trial};
use treewright_core::tuner::{Checkpoint, Snapshot, StateRecord, StudyCounts};

use crate::error::{Result, StoreError};
use crate::fence::Fence;
use crate::from_row::row;
use crate::rows::{TrialRow, VisitRow, inconsistent, into_specification, unsigned};
use crate::store::{ClosedTrial, Loaded, StudyRecord, TrialPage, TrialQuery};

row! {
    pub(crate) struct StudyRow {
        name: String,
        uid: String,
        named_after: i64,
        skipped: i64,
        specification: String,
        policy: String,
        create_ms: i64,
        models_since: i64,
        states: i64,
        last_trial: i64,
        completed_trials: i64,
        open_trials: i64,
    }
}

impl StudyRow {
    pub(crate) fn follow(rows: &[Self], after: &str) -> bool {
        let names = std::iter::once(after).chain(rows.iter().map(|row| row.name.as_str()));
        names.is_sorted_by(|before, name| before < name)
    }

    pub(crate) fn into_record(self) -> Result<StudyRecord> {
        let id = self.name.clone();
        self.into_checked().map_err(|error| error.in_study(&id))
    }

    fn into_checked(self) -> Result<StudyRecord> {
        let last_trial = unsigned(self.last_trial.max(self.named_after))?;
        let (spec, earlier) = into_specification(&self.specification, &self.policy)?;
        let record = StudyRecord {
            id: self.name,
            uid: self
                .uid
                .parse::<StudyUid>()
                .map_err(|error| inconsistent(format!("{:?}: {error}", self.uid)))?,
            named_after: unsigned(self.named_after)?,
            last_trial,
            spec,
            earlier,
            create_ms: self.create_ms,
            statistics: StudyCounts {
                states: unsigned(self.states)?,
                trials: last_trial.saturating_sub(unsigned(self.skipped)?),
                completed_trials: unsigned(self.completed_trials)?,
                open_trials: unsigned(self.open_trials)?,
            },
        };
        debug_assert!(record.named_after <= record.last_trial);
        debug_assert!(record.statistics.trials <= record.last_trial);
        Ok(record)
    }
}

pub(crate) fn study_not_found(study: &str) -> StoreError {
    StoreError::StudyNotFound(study.to_owned())
}

/// Whether the numbers rise, from above `after`.
pub(crate) fn rise_behind(after: u64, numbers: impl Iterator<Item = u64>) -> bool {
    std::iter::once(after).chain(numbers).is_sorted_by(|before, number| before < number)
}

pub(crate) struct StudyRows {
    pub(crate) study: StudyRow,
    pub(crate) states: Vec<StateRecord>,
    pub(crate) visits: Vec<VisitRow>,
    pub(crate) open_trials: Vec<TrialRow>,
    pub(crate) checkpoint: Option<Checkpoint>,
}

impl StudyRows {
    /// Reads every row in the study's space. Open trials and visits outside are left out.
    pub(crate) fn into_loaded(self, fence: Fence) -> Result<Loaded> {
        let models_since = unsigned(self.study.models_since)?;
        let study = self.study.into_record()?;
        let (space, earlier) = (&study.spec.space, &study.earlier);
        let misfit = |error| inconsistent(format!("a configuration does not fit its study: {error}"));
        let open_trials = self
            .open_trials
            .into_iter()
            .filter_map(|row| adopted(row.into_trial(), |trial| trial.adopt(earlier, space).map_err(misfit)))
            .collect::<Result<Vec<Trial>, _>>()?;
        debug_assert!(rise_behind(0, open_trials.iter().map(|trial| trial.number)), "numbers rise from 1");
        debug_assert!(rise_behind(0, self.states.iter().map(|state| state.id)), "ids rise from 1");
        let snapshot = Snapshot {
            states: self.states,
            visits: self
                .visits
                .into_iter()
                .filter_map(|row| {
                    adopted(row.into_visit(), |visit| visit.adopt(earlier, space).map_err(misfit))
                })
                .collect::<Result<_, _>>()?,
            last_trial: study.last_trial,
            models_since,
        };
        Ok(Loaded { fence, snapshot, open_trials, checkpoint: self.checkpoint, study })
    }
}

/// A row in the study's space, or an error; nothing where it is outside.
fn adopted<R, T>(row: Result<R>, adopt: impl FnOnce(R) -> Result<Option<T>>) -> Option<Result<T>> {
    row.and_then(adopt).transpose()
}

/// Numbers and completions from rows as they are read.
pub(crate) fn closed(rows: Vec<(i64, Option<i64>)>) -> Result<Vec<ClosedTrial>> {
    let trial = |(number, completion): (i64, Option<i64>)| {
        Ok(ClosedTrial { number: unsigned(number)?, completion: completion.map(unsigned).transpose()? })
    };
    rows.into_iter().map(trial).collect()
}

/// A page of the found rows: one row more than fits means that another page follows.
pub(crate) fn page(rows: Vec<TrialRow>, query: &TrialQuery) -> Result<TrialPage> {
    let size = query.size as usize;
    assert!(size > 0, "a page of nothing never comes to an end");
    let more = rows.len() > size;
    assert!(rows.len() <= size + 1, "{} rows for a page of {size} and one more", rows.len());
    let trials =
        rows.into_iter().take(size).map(TrialRow::into_trial).collect::<Result<Vec<RawTrial>, _>>()?;
    let next = trials.last().filter(|_| more).map(|last| query.order.place(last));
    Ok(TrialPage { trials, next })
}
