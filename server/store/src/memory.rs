//! The store without a disk: the oracle of the contract suite, and quick for tests.

use std::collections::BTreeMap;
use std::hash::{BuildHasher as _, Hasher as _, RandomState};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use async_trait::async_trait;
use treewright_core::ids::StudyUid;
use treewright_core::space::{EarlierSpaces, SpaceError};
use treewright_core::study::StudySpec;
use treewright_core::trial::{RawTrial, Trial, TrialState};
use treewright_core::tuner::{Change, Checkpoint, RawVisit, Snapshot, StateRecord, StudyCounts};

use crate::assembly::study_not_found;
use crate::error::{Result, StoreError};
use crate::fence::{Fence, Receipt};
use crate::limits;
use crate::rows::inconsistent;
use crate::store::{ClosedTrial, Created, Loaded, Store, StudyRecord, StudyWrite, TrialPage, TrialQuery};

/// Keeps everything in memory and forgets it when dropped.
#[derive(Debug, Default)]
pub struct MemoryStore {
    inner: Mutex<MemoryTables>,
    /// What goes wrong.
    pub faults: Faults,
}

/// Troubles of a [`MemoryStore`], as a test wants them.
#[derive(Debug, Default)]
pub struct Faults {
    /// Nothing can be written.
    pub broken: AtomicBool,
    /// Somebody deletes each study as soon as it was read.
    pub fleeting: bool,
    /// Its writer met a defect.
    pub failed: bool,
    /// How long it takes to read a study into memory.
    pub load_takes: Duration,
}

#[derive(Debug, Default)]
struct MemoryTables {
    studies: BTreeMap<String, MemoryStudy>,
    /// Former names of studies, and the highest trial number of each.
    former_names: BTreeMap<String, u64>,
    last_key: i64,
    closed: bool,
}

#[derive(Debug)]
struct MemoryStudy {
    key: i64,
    uid: StudyUid,
    named_after: u64,
    skipped: u64,
    spec: StudySpec,
    earlier: EarlierSpaces,
    create_ms: i64,
    fence: Option<Fence>,
    states: BTreeMap<u64, StateRecord>,
    visits: BTreeMap<String, RawVisit>,
    trials: BTreeMap<u64, RawTrial>,
    /// The numbers of the completed trials, by completion.
    completed: BTreeMap<u64, u64>,
    checkpoint: Option<Checkpoint>,
    models_since: u64,
}

impl MemoryStore {
    /// An empty store.
    pub fn new() -> Self {
        Self::default()
    }

    /// An empty store with faults.
    pub fn with(faults: Faults) -> Self {
        Self { faults, ..Self::default() }
    }

    /// A poisoned lock is usable: each write is checked before it is done, so a panic leaves whole values
    /// behind.
    fn lock(&self) -> Result<MutexGuard<'_, MemoryTables>> {
        let inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        if inner.closed { Err(StoreError::Closed) } else { Ok(inner) }
    }
}

impl MemoryTables {
    fn study(&self, id: &str) -> Result<&MemoryStudy> {
        self.studies.get(id).ok_or_else(|| study_not_found(id))
    }

    /// Checks that a study has the identity, where one is given.
    fn identified(&self, id: &str, uid: Option<StudyUid>) -> Result<()> {
        let found = self.study(id)?.uid;
        if uid.is_none_or(|uid| uid == found) { Ok(()) } else { Err(study_not_found(id)) }
    }

    /// The highest trial number that earlier studies have handed out under a name.
    fn former(&self, id: &str) -> u64 {
        let of = |name: &str| self.former_names.get(name).copied().unwrap_or(0);
        of(id).max(of(""))
    }

    /// Takes a study away from its name, which is noted with the last number under it, and breaks its fence.
    fn take(&mut self, id: &str) -> Result<MemoryStudy> {
        let mut study = self.studies.remove(id).ok_or_else(|| study_not_found(id))?;
        if let Some(fence) = study.fence.take() {
            fence.break_up();
        }
        let last = study.last_trial();
        if last > 0 {
            let noted = self.former_names.entry(id.to_owned()).or_default();
            *noted = last.max(*noted);
        }
        // Where there are too many, the name with the lowest number is merged into the empty name.
        let listed = || self.former_names.iter().filter(|(name, _)| !name.is_empty());
        if listed().count() > limits::FORMER_NAMES as usize
            && let Some((name, last)) =
                listed().min_by_key(|(_, last)| **last).map(|(name, last)| (name.clone(), *last))
        {
            self.former_names.remove(&name);
            let rest = self.former_names.entry(String::new()).or_default();
            *rest = last.max(*rest);
        }
        Ok(study)
    }

    fn fenced(&mut self, fence: &Fence) -> Result<&mut MemoryStudy> {
        fence.check()?;
        self.studies
            .get_mut(fence.study())
            .filter(|study| study.key == fence.key())
            .ok_or_else(|| study_not_found(fence.study()))
    }
}

/// A new identity. The standard library's hashes are keyed with randomness from the system.
fn random_uid() -> StudyUid {
    StudyUid(RandomState::new().build_hasher().finish())
}

impl MemoryStudy {
    fn record(&self, id: &str) -> StudyRecord {
        let is_open = |trial: &&RawTrial| trial.state == TrialState::Open;
        let last_trial = self.last_trial();
        assert!(self.skipped <= last_trial, "{} of {last_trial} numbers were left out", self.skipped);
        StudyRecord {
            id: id.to_owned(),
            uid: self.uid,
            named_after: self.named_after,
            last_trial,
            spec: self.spec.clone(),
            earlier: self.earlier.clone(),
            create_ms: self.create_ms,
            statistics: StudyCounts {
                states: self.states.len() as u64,
                // Numbers and completions rise by one, and the last of each is never removed.
                trials: last_trial - self.skipped,
                completed_trials: self.completed.keys().last().copied().unwrap_or(0),
                open_trials: self.trials.values().filter(is_open).count() as u64,
            },
        }
    }

    /// The highest trial number that was handed out or skipped.
    fn last_trial(&self) -> u64 {
        self.trials.keys().last().copied().unwrap_or(0).max(self.named_after)
    }

    /// Compares the counts of data that is kept in two places.
    fn check(&self) {
        let (completed, trials) = (self.completed.len(), self.trials.len());
        assert!(completed <= trials, "{completed} completed of {trials} trials");
        let last = self.completed.last_key_value();
        assert!(last.is_none_or(|(_, number)| self.trials.contains_key(number)), "{last:?} has no trial");
    }

    /// Carries out a write; `id` is the study's own.
    fn write(&mut self, id: &str, write: StudyWrite<'_>) -> Result<()> {
        match write {
            StudyWrite::Commit(changes) => self.apply(changes)?,
            StudyWrite::Study(spec, earlier, models_since) => {
                (self.spec, self.earlier, self.models_since) = (spec.clone(), earlier.clone(), models_since);
            }
            StudyWrite::Space(spec, earlier) => {
                (self.spec, self.earlier, self.checkpoint) = (spec.clone(), earlier.clone(), None);
                self.states.values_mut().for_each(|state| state.search = None);
            }
            StudyWrite::Exclude(number, reason) => {
                let trial = self.trials.get_mut(&number).filter(|trial| trial.state == TrialState::Completed);
                let missing = || StoreError::TrialNotFound { study: id.to_owned(), number };
                trial.ok_or_else(missing)?.exclusion = reason.map(str::to_owned);
                self.checkpoint = None;
            }
        }
        Ok(())
    }

    fn apply(&mut self, changes: &[Change]) -> Result<()> {
        for trial in changes.iter().flat_map(|change| &change.trials) {
            let stored = self.trials.get(&trial.number);
            if stored.is_some_and(|stored| stored.state == TrialState::Completed) {
                return Err(inconsistent("a completed trial is never changed"));
            }
        }
        for change in changes {
            for state in &change.states {
                self.states.insert(state.id, state.clone());
            }
            for client_id in &change.forgotten {
                self.visits.remove(client_id);
            }
            for visit in &change.visits {
                self.visits.insert(visit.client_id.clone(), visit.clone().into_raw());
            }
            for trial in &change.trials {
                self.completed.extend(trial.completion.map(|completion| (completion, trial.number)));
                let mut trial = Trial { decision: trial.decision.stored(), ..trial.clone() }.into_raw();
                // A stored trial keeps what was handed out, as in the other stores.
                if let Some(stored) = self.trials.get(&trial.number) {
                    trial.configuration.clone_from(&stored.configuration);
                }
                self.trials.insert(trial.number, trial);
            }
        }
        self.check();
        Ok(())
    }
}

#[async_trait]
impl Store for MemoryStore {
    async fn create_study(&self, id: &str, spec: &StudySpec, now_ms: i64) -> Result<Created> {
        let mut inner = self.lock()?;
        if let Some(stored) = inner.studies.get(id) {
            return stored.record(id).found(spec);
        }
        if inner.studies.len() >= limits::STUDIES as usize {
            return Err(StoreError::TooManyStudies(limits::STUDIES));
        }
        inner.last_key += 1;
        let former = inner.former(id);
        let study = MemoryStudy {
            key: inner.last_key,
            uid: random_uid(),
            named_after: former,
            skipped: former,
            spec: spec.clone(),
            earlier: EarlierSpaces::default(),
            create_ms: now_ms,
            fence: None,
            states: BTreeMap::new(),
            visits: BTreeMap::new(),
            trials: BTreeMap::new(),
            completed: BTreeMap::new(),
            checkpoint: None,
            models_since: 0,
        };
        let record = study.record(id);
        inner.studies.insert(id.to_owned(), study);
        Ok(Created { study: record, is_new: true })
    }

    async fn get_study(&self, study: &str) -> Result<StudyRecord> {
        let mut inner = self.lock()?;
        let found = inner.study(study)?.record(study);
        if self.faults.fleeting {
            inner.take(study)?;
        }
        Ok(found)
    }

    async fn list_studies(&self, after: Option<&str>, size: u32) -> Result<Vec<StudyRecord>> {
        let inner = self.lock()?;
        let behind = |id: &str| after.is_none_or(|after| id > after);
        let page = inner.studies.iter().filter(|(id, _)| behind(id)).take(size as usize);
        Ok(page.map(|(id, study)| study.record(id)).collect())
    }

    async fn delete_study(&self, study: &str, uid: Option<StudyUid>) -> Result<()> {
        let mut inner = self.lock()?;
        inner.identified(study, uid)?;
        inner.take(study).map(drop)
    }

    async fn find_study(&self, uid: StudyUid) -> Result<Option<String>> {
        let inner = self.lock()?;
        Ok(inner.studies.iter().find(|(_, study)| study.uid == uid).map(|(id, _)| id.clone()))
    }

    async fn rename_study(&self, study: &str, uid: Option<StudyUid>, to: &str) -> Result<StudyRecord> {
        let mut inner = self.lock()?;
        inner.identified(study, uid)?;
        if study != to {
            if inner.studies.contains_key(to) {
                return Err(StoreError::NameTaken(to.to_owned()));
            }
            let (mut renamed, former) = (inner.take(study)?, inner.former(to));
            let last = renamed.last_trial();
            renamed.skipped += former.saturating_sub(last);
            renamed.named_after = former.max(last);
            inner.studies.insert(to.to_owned(), renamed);
        }
        Ok(inner.study(to)?.record(to))
    }

    async fn load(&self, study: &str) -> Result<Loaded> {
        if !self.faults.load_takes.is_zero() {
            tokio::time::sleep(self.faults.load_takes).await;
        }
        let mut inner = self.lock()?;
        let found = inner.studies.get_mut(study).ok_or_else(|| study_not_found(study))?;
        let fence = Fence::new(study, found.key);
        if let Some(earlier) = found.fence.replace(fence.clone()) {
            earlier.break_up();
        }
        let (space, earlier) = (&found.spec.space, &found.earlier);
        let misfit = |error: SpaceError| inconsistent(error.to_string());
        let open = found.trials.values().filter(|trial| trial.state == TrialState::Open);
        let open = open.map(|trial| trial.clone().adopt(earlier, space).map_err(misfit));
        let visits = found.visits.values().map(|visit| visit.clone().adopt(earlier, space));
        let visits = visits.map(|visit| visit.map_err(misfit));
        Ok(Loaded {
            fence,
            study: found.record(study),
            snapshot: Snapshot {
                states: found.states.values().cloned().collect(),
                visits: visits.filter_map(Result::transpose).collect::<Result<_, _>>()?,
                last_trial: found.last_trial(),
                models_since: found.models_since,
            },
            open_trials: open.filter_map(Result::transpose).collect::<Result<_, _>>()?,
            checkpoint: found.checkpoint.clone(),
        })
    }

    fn queue(&self, fence: &Fence, write: StudyWrite<'_>) -> Receipt {
        if matches!(write, StudyWrite::Commit(_)) && self.faults.broken.load(Ordering::SeqCst) {
            return Receipt::refused(fence, StoreError::Unavailable("database or disk is full".to_owned()));
        }
        match self.lock().and_then(|mut inner| inner.fenced(fence)?.write(fence.study(), write)) {
            Ok(()) => Receipt::settled(Ok(())),
            Err(error) => Receipt::refused(fence, error),
        }
    }

    async fn completed_trials(&self, fence: &Fence, after: u64, size: u32) -> Result<Vec<RawTrial>> {
        let inner = self.lock()?;
        let study = inner.study(fence.study())?;
        let places = study.completed.range(after + 1..).take(size as usize);
        let found = places.filter_map(|(at, number)| Some((*at, study.trials.get(number)?)));
        let trials = found.map(|(at, trial)| {
            assert_eq!(trial.completion, Some(at), "trial {} is listed in another place", trial.number);
            trial.clone()
        });
        Ok(trials.collect())
    }

    async fn save_checkpoint(&self, fence: &Fence, checkpoint: &Checkpoint) -> Result<()> {
        // The other stores find a checkpoint by its parts.
        assert!(!checkpoint.bytes.is_empty(), "a checkpoint of nothing");
        self.lock()?.fenced(fence)?.checkpoint = Some(checkpoint.clone());
        Ok(())
    }

    async fn closed_trials(&self, fence: &Fence, after: u64, to: u64, size: u32) -> Result<Vec<ClosedTrial>> {
        let inner = self.lock()?;
        let found = inner.study(fence.study())?.trials.range(after + 1..to.max(after) + 1);
        let closed = found.map(|(_, trial)| trial).filter(|trial| trial.state != TrialState::Open);
        let closed = closed.map(|trial| ClosedTrial { number: trial.number, completion: trial.completion });
        Ok(closed.take(size as usize).collect())
    }

    async fn remove_trials(&self, fence: &Fence, numbers: &[u64], covered: u64) -> Result<u64> {
        let mut inner = self.lock()?;
        let study = inner.fenced(fence)?;
        let mut removed = 0;
        for number in numbers {
            let may_go = |trial: &RawTrial| {
                trial.state != TrialState::Open && trial.completion.is_none_or(|at| at <= covered)
            };
            if study.trials.get(number).is_some_and(may_go) {
                let trial = study.trials.remove(number);
                let completion = trial.and_then(|trial| trial.completion);
                completion.map(|completion| study.completed.remove(&completion));
                removed += 1;
            }
        }
        study.check();
        Ok(removed)
    }

    async fn get_trial(&self, study: &str, number: u64) -> Result<RawTrial> {
        let inner = self.lock()?;
        let trial = inner.study(study)?.trials.get(&number).cloned();
        trial.ok_or_else(|| StoreError::TrialNotFound { study: study.to_owned(), number })
    }

    async fn query_trials(&self, study: &str, query: &TrialQuery) -> Result<TrialPage> {
        let size = query.size as usize;
        assert!(size > 0, "a page of nothing never comes to an end");
        let inner = self.lock()?;
        let trials = inner.study(study)?.trials.values();
        let mut found: Vec<RawTrial> = trials.filter(|trial| query.filter.matches(trial)).cloned().collect();
        let compare =
            |a: &RawTrial, b: &RawTrial| query.order.compare(&query.order.place(a), &query.order.place(b));
        found.sort_by(compare);
        if let Some(after) = &query.after {
            found.retain(|trial| query.order.compare(&query.order.place(trial), after).is_gt());
        }
        let more = found.len() > size;
        found.truncate(size);
        let next = found.last().filter(|_| more).map(|last| query.order.place(last));
        Ok(TrialPage { next, trials: found })
    }

    async fn studies_with_due_leases(&self, now_ms: i64) -> Result<Vec<String>> {
        let inner = self.lock()?;
        let due = |trial: &RawTrial| trial.state == TrialState::Open && trial.lease_expire_ms < now_ms;
        let found = inner.studies.iter().filter(|(_, study)| study.trials.values().any(due));
        Ok(found.map(|(id, _)| id.clone()).collect())
    }

    fn has_failed(&self) -> bool {
        self.faults.failed
    }

    async fn close(&self) {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner).closed = true;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test]
    async fn memory_is_shared_with_no_other_process_and_has_no_size() {
        let store = MemoryStore::default();
        assert_eq!(store.replica_key(), None);
        assert!(store.size().await.is_none());
        assert!(store.is_held_by("hall", "http://127.0.0.1:1").await, "nobody else could hold it");
    }
}
