//! The errors of requests. [`status`](crate::status) gives the code of each for clients.

use std::time::Duration;

use treewright_core::tuner::{RestoreError, TunerError};
use treewright_proto::convert::Malformed;
use treewright_store::StoreError;
use treewright_store::tokens::TokenError;

/// What a request comes to.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Why a request was refused. Nothing of it was done.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum Error {
    /// A field of the request is missing, malformed or over its limit.
    #[error("{field}: {problem}")]
    Invalid {
        /// The field, as a path in the request message.
        field: String,
        /// The mistake, and how to mend it.
        problem: String,
    },
    /// The tuner refuses.
    #[error(transparent)]
    Tuner(#[from] TunerError),
    /// The store refuses.
    #[error(transparent)]
    Store(#[from] StoreError),
    /// The stored rows do not make a tuner.
    #[error("study {study:?}: {problem}")]
    Restore {
        /// The study.
        study: String,
        /// The inconsistency.
        problem: RestoreError,
    },
    /// The requested study is gone, and another has its name.
    #[error(
        "study {0:?} was deleted and created again, and this request is for the one before; open the study again"
    )]
    Replaced(String),
    /// The space was changed since the revision that a change is for.
    #[error("the space of study {study:?} has revision {present}, not {given}; read the study again")]
    SpaceChanged {
        /// The study's id.
        study: String,
        /// Its revision.
        present: u32,
        /// The revision in the request.
        given: u32,
    },
    /// A text of the study was changed since the form for it was shown.
    #[error("somebody else has changed the {text} of study {study:?} meanwhile; load its page again")]
    TextChanged {
        /// The study's id.
        study: String,
        /// `note` or `tags`.
        text: &'static str,
    },
    /// The trial was handed out under a name that another study had at that time.
    #[error(
        "trial {number} was handed out before study {study:?} was created or renamed, and this is another study; \
         open the study again"
    )]
    EarlierTrial {
        /// The study's id.
        study: String,
        /// The trial's number.
        number: u64,
    },
    /// The study is being loaded from the database, which goes on even if the request is cancelled.
    #[error("study {0:?} is being loaded; try again")]
    Loading(String),
    /// No best configuration is known yet.
    #[error("nothing has been measured {place} of study {study:?} yet; report a trial first")]
    NothingMeasured {
        /// The study.
        study: String,
        /// `in this state` or `in any state`.
        place: &'static str,
    },
    /// The study could not be kept in memory long enough to answer.
    #[error("study {0:?} is being reloaded; try again later")]
    Reloading(String),
    /// Too many requests or streams at once.
    #[error("the daemon is working on {limit} {what}, which is its limit; try again later")]
    Busy {
        /// The counted things.
        what: &'static str,
        /// The limit.
        limit: usize,
    },
    /// The daemon is draining.
    #[error("the daemon is draining and takes no new requests; try again later")]
    Draining,
    /// The caller has shown no valid token.
    #[error("{0}")]
    Unauthenticated(&'static str),
    /// The caller may not do this. The words do not show whether the object exists.
    #[error("{0}; ask the operator of the daemon for a token that does")]
    Denied(&'static str),
    /// The token's quota is used up.
    #[error("the token's quota of {limit} {what} is used up")]
    Quota {
        /// The counted things.
        what: &'static str,
        /// The greatest number.
        limit: u64,
        /// The wait before another try; none for a quota that time does not renew.
        retry: Option<Duration>,
    },
    /// The tokens cannot be read.
    #[error("the token cannot be looked up: {0}")]
    Tokens(TokenError),
    /// The request took too long.
    #[error("the request was not finished within {} s", .0.as_secs())]
    Deadline(Duration),
    /// A part of the daemon failed unexpectedly.
    #[error("the daemon has a defect: {0}")]
    Defect(&'static str),
}

impl From<Malformed> for Error {
    fn from(Malformed { field, problem }: Malformed) -> Self {
        Self::Invalid { field, problem }
    }
}

impl Error {
    /// A field is wrong.
    pub fn invalid(field: impl Into<String>, problem: impl std::fmt::Display) -> Self {
        Self::Invalid { field: field.into(), problem: problem.to_string() }
    }
}
