//! Shared state of the parts of a PostgreSQL store: its identity, its studies, and the known studies of other
//! replicas.

use std::collections::HashMap;
use std::sync::atomic::{AtomicI32, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use super::open::PostgresAddress;
use crate::fence::Fence;
use crate::limits;

/// Shared by the store, its writers, its session and its listener.
pub(super) struct SharedState {
    pub(super) database: PostgresAddress,
    /// The address of this replica for others.
    pub(super) advertised: String,
    me: AtomicI32,
    fences: Mutex<HashMap<i64, Fence>>,
    owners: Mutex<HashMap<String, StudyHolder>>,
}

#[derive(Clone, Debug)]
pub(super) struct StudyHolder {
    pub(super) key: i64,
    pub(super) replica: i32,
    pub(super) address: String,
    pub(super) seen: Instant,
}

/// A poisoned lock is usable: a panic leaves whole entries behind.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl SharedState {
    pub(super) fn new(database: PostgresAddress, advertised: String, me: i32) -> Self {
        let me = AtomicI32::new(me);
        Self { database, advertised, me, fences: Mutex::default(), owners: Mutex::default() }
    }

    pub(super) fn me(&self) -> i32 {
        self.me.load(Ordering::Acquire)
    }

    /// Goes on under another id. Studies held under the old id are no longer this replica's.
    pub(super) fn become_replica(&self, me: i32) {
        self.me.store(me, Ordering::Release);
        for (_, fence) in lock(&self.fences).drain() {
            fence.break_up();
        }
    }

    /// Puts a new fence in force and breaks the earlier one of the study.
    pub(super) fn hold(&self, fence: Fence) {
        lock(&self.owners).remove(fence.study());
        if let Some(earlier) = lock(&self.fences).insert(fence.key(), fence) {
            earlier.break_up();
        }
    }

    /// Another load raised the study's epoch, so the copy in memory is no longer current.
    pub(super) fn claimed(&self, key: i64, epoch: i64) {
        let mut fences = lock(&self.fences);
        if fences.get(&key).is_some_and(|fence| fence.epoch() < epoch)
            && let Some(fence) = fences.remove(&key)
        {
            fence.break_up();
        }
        drop(fences);
        self.forget_owners(|owner| owner.key == key);
    }

    pub(super) fn deleted(&self, key: i64) {
        if let Some(fence) = lock(&self.fences).remove(&key) {
            fence.break_up();
        }
        self.forget_owners(|owner| owner.key == key);
    }

    /// The known holder of the study, if it was found recently.
    pub(super) fn owner(&self, study: &str) -> Option<StudyHolder> {
        lock(&self.owners).get(study).filter(|owner| owner.seen.elapsed() < limits::OWNER_REMEMBERED).cloned()
    }

    pub(super) fn remember_owner(&self, study: &str, owner: StudyHolder) {
        let mut owners = lock(&self.owners);
        if owners.len() >= limits::OWNERS_REMEMBERED {
            owners.clear();
        }
        owners.insert(study.to_owned(), owner);
    }

    pub(super) fn forget_owner(&self, study: &str) {
        lock(&self.owners).remove(study);
    }

    pub(super) fn forget_owners(&self, which: impl Fn(&StudyHolder) -> bool) {
        lock(&self.owners).retain(|_, owner| !which(owner));
    }
}
