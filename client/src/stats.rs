//! Counts of the fates of suggestions and reports.

use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, Ordering};

use serde::Serialize;

use crate::locks::lock;

macro_rules! counted {
    ($($(#[$doc:meta])* $name:ident,)*) => {
        /// Counts of suggestions and reports since the client was made.
        #[derive(Debug, Clone, Default, PartialEq, Eq, Serialize)]
        pub struct Stats {
            $($(#[$doc])* pub $name: u64,)*
            /// Reports and abandoned trials that wait or are on their way at the moment.
            pub queued: u64,
            /// The most recent problem, for people.
            pub last_error: Option<String>,
        }

        #[derive(Debug, Default)]
        pub(crate) struct Counters {
            $(pub(crate) $name: Counter,)*
            last_error: Mutex<Option<String>>,
        }

        impl Counters {
            pub(crate) fn snapshot(&self, queued: usize) -> Stats {
                Stats {
                    $($name: self.$name.get(),)*
                    queued: queued as u64,
                    last_error: self.last_error(),
                }
            }
        }
    };
}

counted! {
    /// Suggestions that came from the daemon in time.
    suggestions,
    /// Suggestions answered without the daemon, from the last good configuration or the default.
    fallbacks,
    /// Results of fallback suggestions: there is no trial to report them to.
    unreported,
    /// Attempts to send a report.
    sent,
    /// Reports that the daemon has stored.
    acknowledged,
    /// Reports among them that were stored already, by an attempt whose answer was lost.
    duplicates,
    /// Attempts to send a report again.
    resent,
    /// Reports that the daemon refused for good.
    refused,
    /// Reports lost because the queue was full, or because the program ended before they could be sent.
    dropped,
    /// Trials given back unmeasured.
    abandoned,
    /// Trials that were not given back, for the reasons of `dropped`; their leases run out by themselves.
    abandons_dropped,
}

impl Counters {
    pub(crate) fn note(&self, problem: impl ToString) {
        *lock(&self.last_error) = Some(problem.to_string());
    }

    pub(crate) fn last_error(&self) -> Option<String> {
        lock(&self.last_error).clone()
    }
}

/// A number that only rises.
#[derive(Debug, Default)]
pub(crate) struct Counter(AtomicU64);

impl Counter {
    pub(crate) fn add(&self, count: usize) {
        self.0.fetch_add(count as u64, Ordering::Relaxed);
    }

    pub(crate) fn get(&self) -> u64 {
        self.0.load(Ordering::Relaxed)
    }
}
