//! The set-up of the last trial, so that the next one with an equal set-up need not repeat it.
//!
//! It is one for all handles of a study that a client has made, and takes it for granted that one trial runs
//! after the other. Once two ran side by side, the program has several loops, and which of them asks is not
//! known: from then on nothing counts as prepared.

use std::sync::{Arc, Mutex};

use treewright_model::value::RawConfiguration;

use crate::locks::lock;

/// The values that need a set-up, and the level at which the trial runs.
pub(crate) type SetUp = (RawConfiguration, Option<String>);

/// The set-up of one process for a study.
#[derive(Debug, Default)]
pub(crate) struct SetUps(Mutex<SetUpState>);

#[derive(Debug, Default)]
enum SetUpState {
    /// Nothing that is known: no trial yet, or the last one did not end well.
    #[default]
    Unknown,
    Running,
    /// The last trial was measured to its end.
    Done(SetUp),
    SideBySide,
}

/// A suggestion's hold on it, from when the program gets the suggestion until that ends.
#[derive(Debug)]
pub(crate) struct SetUpClaim {
    all: Arc<SetUps>,
    process: u32,
    /// Until it is done.
    own: Option<SetUp>,
    pub(crate) is_prepared: bool,
}

impl SetUpClaim {
    pub(crate) fn new(all: &Arc<SetUps>, own: SetUp) -> Self {
        let mut state = lock(&all.0);
        let is_prepared = matches!(&*state, SetUpState::Done(last) if *last == own);
        *state = match &*state {
            SetUpState::Unknown | SetUpState::Done(_) => SetUpState::Running,
            SetUpState::Running | SetUpState::SideBySide => SetUpState::SideBySide,
        };
        drop(state);
        Self { all: Arc::clone(all), process: std::process::id(), own: Some(own), is_prepared }
    }

    /// The trial was measured to its end.
    pub(crate) fn done(mut self) {
        if let Some(own) = self.own.take() {
            self.all.end(SetUpState::Done(own));
        }
    }
}

impl Drop for SetUpClaim {
    fn drop(&mut self) {
        // In the child of a fork the lock may be held by a thread of the parent.
        if self.own.is_some() && self.process == std::process::id() {
            self.all.end(SetUpState::Unknown);
        }
    }
}

impl SetUps {
    fn end(&self, with: SetUpState) {
        let mut state = lock(&self.0);
        if matches!(*state, SetUpState::Running) {
            *state = with;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tile(size: i64) -> SetUp {
        (RawConfiguration::from([("tile".to_owned(), size.into())]), None)
    }

    #[test]
    fn only_the_last_trial_that_ended_well_prepares() {
        let all = Arc::default();
        let claim = |setup: SetUp| SetUpClaim::new(&all, setup);
        let first = claim(tile(1));
        assert!(!first.is_prepared);
        first.done();
        let second = claim(tile(1));
        assert!(second.is_prepared);
        second.done();
        let at_level = claim((tile(1).0, Some("small".to_owned())));
        assert!(!at_level.is_prepared, "the input may be a smaller one");
        at_level.done();
        claim(tile(2)).done();
        drop(claim(tile(3)));
        assert!(!claim(tile(2)).is_prepared, "what the one between has done is not known");
    }

    #[test]
    fn nothing_is_prepared_once_trials_ran_side_by_side() {
        let all = Arc::default();
        let claim = |setup: SetUp| SetUpClaim::new(&all, setup);
        let (one, other) = (claim(tile(1)), claim(tile(1)));
        one.done();
        other.done();
        for _ in 0..2 {
            let next = claim(tile(1));
            assert!(!next.is_prepared);
            next.done();
        }
    }
}
