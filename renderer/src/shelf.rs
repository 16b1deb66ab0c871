//! Structures that are kept for later trials of their choice.
//!
//! A search measures its leaders again and again, and a slow build hardly changes their cost. Trees of one
//! choice differ from build to build by one to three percent, though. So each serves a few trials and is then
//! rebuilt.

use std::sync::OnceLock;

use treewright_accel::{BuildChoice, Structure};

use crate::limits::{SHELF_BYTES_MAX, TRIALS_PER_BUILD_MAX};
use crate::scheduling::ThreadTimes;

#[derive(Debug)]
pub(crate) struct Built {
    pub(crate) structure: Structure,
    pub(crate) choice: BuildChoice,
    pub(crate) build_ms: f64,
    /// Of the build.
    pub(crate) threads: ThreadTimes,
    /// The number of trials that it was asked for, the one that it was built for included.
    pub(crate) trials: u32,
    /// Its memory, once that was asked for: it is found by a walk through the whole structure.
    pub(crate) bytes: OnceLock<usize>,
}

/// The structures that were used last, within a budget of memory.
#[derive(Debug, Default)]
pub(crate) struct Shelf {
    /// The one that was used last comes last.
    kept: Vec<Built>,
}

impl Shelf {
    /// The structure of this choice for another trial, if there is one that may serve it.
    pub(crate) fn take(&mut self, choice: &BuildChoice) -> Option<Built> {
        let place = self.kept.iter().position(|kept| kept.choice == *choice)?;
        let mut built = self.kept.remove(place);
        built.serves_again(choice).then_some(built)
    }

    /// Keeps a structure for other trials; where memory lacks, those longest unwanted go.
    pub(crate) fn put(&mut self, built: Built) {
        self.kept.retain(|kept| kept.choice != built.choice);
        if built.trials < TRIALS_PER_BUILD_MAX {
            self.kept.push(built);
        }
        while self.kept.iter().map(Built::bytes).sum::<usize>() > SHELF_BYTES_MAX {
            self.kept.remove(0);
        }
    }

    /// Drops all: the scene has changed.
    pub(crate) fn clear(&mut self) {
        self.kept.clear();
    }
}
