//! Values that belong to one process. After a fork the child has a copy of its parent's memory and none of
//! its threads. A lock that one of them held stays locked, and a question to one gets no answer. So the child
//! neither uses nor cleans up the parent's values.

use std::sync::OnceLock;

use crate::ClientError;

/// A value of the process that made it. Elsewhere it is forgotten and not dropped.
#[derive(Debug)]
pub(super) struct OfProcess<T> {
    process: u32,
    /// `None` only while it is dropped.
    value: Option<T>,
}

impl<T> OfProcess<T> {
    pub(super) fn new(value: T) -> Self {
        Self { process: std::process::id(), value: Some(value) }
    }

    /// The value, in its process. Errors: [`ClientError::Invalid`] for `what` elsewhere.
    pub(super) fn here(&mut self, what: &'static str) -> Result<&mut T, ClientError> {
        let problem = || {
            let other = self.process;
            ClientError::invalid(
                what,
                format!("it was begun by process {other}, before a fork; begin another in this one"),
            )
        };
        let is_here = self.process == std::process::id();
        if is_here { self.value.as_mut() } else { None }.ok_or_else(problem)
    }

    /// This process's value in `place`, which is made if there is none or another process's.
    pub(super) fn of_this(place: &mut Option<Self>, make: impl FnOnce() -> T) -> &mut T {
        if place.as_ref().is_none_or(|there| there.process != std::process::id()) {
            *place = None;
        }
        place.get_or_insert_with(|| Self::new(make())).value.as_mut().expect("it is only taken when dropped")
    }
}

impl<T> Drop for OfProcess<T> {
    fn drop(&mut self) {
        if self.process != std::process::id() {
            std::mem::forget(self.value.take());
        }
    }
}

/// A value for each process that uses it: of the one that made it, of its child after a fork, of that one's
/// child, and so on.
#[derive(Debug)]
pub(super) struct PerProcess<T> {
    first: OfProcess<T>,
    child: OnceLock<Box<PerProcess<T>>>,
}

impl<T> PerProcess<T> {
    pub(super) fn new(value: T) -> Self {
        Self { first: OfProcess::new(value), child: OnceLock::new() }
    }

    /// The value of the process that made it, for reading the parts that are equal in all processes.
    pub(super) fn first(&self) -> &T {
        self.first.value.as_ref().expect("it is only taken when dropped")
    }

    /// The value of this process; made with that of the one before where it has none yet. Errors: those of
    /// `make`.
    pub(super) fn get(&self, make: impl Fn(&T) -> Result<T, ClientError>) -> Result<&T, ClientError> {
        let mut at = self;
        while at.first.process != std::process::id() {
            at = match at.child.get() {
                Some(child) => child,
                None => {
                    let made = Self::new(make(at.first())?);
                    // Where two threads make one at a time, the first is taken.
                    at.child.get_or_init(|| Box::new(made))
                }
            };
        }
        Ok(at.first())
    }
}
