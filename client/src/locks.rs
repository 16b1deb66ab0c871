//! Locks.

use std::sync::{Mutex, MutexGuard, PoisonError};

/// Takes a lock. Nothing in this crate panics while it holds one; a poisoned one is still in order.
pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}
