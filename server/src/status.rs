//! The one place where errors become gRPC status codes, as the comments of the wire contract promise.
//!
//! Errors that pass with time carry the wait before another try: a `google.rpc.RetryInfo` in the status'
//! details, and `retry_after_ms` in an error inside a stream.

use std::time::Duration;

use tonic::{Code, Status};
use tonic_types::{ErrorDetails, StatusExt as _};
use treewright_core::tuner::TunerError;
use treewright_proto::v1::TuneError;
use treewright_store::StoreError;

use crate::error::Error;
use crate::limits::{LOADING_RETRY, MESSAGE_BYTES};
use crate::redirect::Redirect;

/// The canonical code of an error.
pub fn code(error: &Error) -> Code {
    code_and_reason(error).0
}

/// The kind of an error in one word, for counting. `store` is a failing database, which no client can cause.
pub fn reason(error: &Error) -> &'static str {
    code_and_reason(error).1
}

fn code_and_reason(error: &Error) -> (Code, &'static str) {
    match error {
        Error::Invalid { .. } => (Code::InvalidArgument, "invalid"),
        Error::Tuner(error) => (tuner_code(error), "tuner"),
        Error::Store(error) => of_store(error),
        Error::NothingMeasured { .. } => (Code::NotFound, "nothing_measured"),
        Error::Replaced { .. } | Error::EarlierTrial { .. } => (Code::NotFound, "replaced"),
        Error::SpaceChanged { .. } | Error::TextChanged { .. } => (Code::FailedPrecondition, "replaced"),
        Error::Loading { .. } => (Code::Unavailable, "loading"),
        Error::Reloading { .. } => (Code::Unavailable, "reloading"),
        Error::Draining => (Code::Unavailable, "draining"),
        Error::Busy { .. } => (Code::ResourceExhausted, "busy"),
        Error::Quota { .. } => (Code::ResourceExhausted, "quota"),
        Error::Tokens(_) => (Code::Unavailable, "store"),
        Error::Unauthenticated(_) => (Code::Unauthenticated, "token"),
        Error::Denied(_) => (Code::PermissionDenied, "scope"),
        Error::Deadline { .. } => (Code::DeadlineExceeded, "deadline"),
        Error::Restore { .. } | Error::Defect(_) => (Code::Internal, "defect"),
    }
}

fn tuner_code(error: &TunerError) -> Code {
    match error {
        TunerError::ClientId
        | TunerError::Indicators(_)
        | TunerError::Wanted(_)
        | TunerError::Start(_)
        | TunerError::Fingerprint
        | TunerError::Objective(_)
        | TunerError::LowerBound(_)
        | TunerError::OutcomeReason
        | TunerError::Origin
        | TunerError::Study(_) => Code::InvalidArgument,
        TunerError::TooManyStates | TunerError::TooManyClients | TunerError::TooManyOpenTrials(_) => {
            Code::ResourceExhausted
        }
        TunerError::AlreadyCompleted(_)
        | TunerError::GivenUp(_)
        | TunerError::Outdated(_)
        | TunerError::OutsideSpace(_)
        | TunerError::Abandoned(_)
        | TunerError::NotCompleted { .. }
        | TunerError::NotOpen { .. } => Code::FailedPrecondition,
        TunerError::UnknownTrial(_) => Code::NotFound,
    }
}

fn of_store(error: &StoreError) -> (Code, &'static str) {
    match error {
        StoreError::StudyNotFound { .. } | StoreError::TrialNotFound { .. } => (Code::NotFound, "not_found"),
        StoreError::StudyExists { .. } | StoreError::NameTaken { .. } => (Code::AlreadyExists, "exists"),
        StoreError::TooManyStudies { .. } => (Code::ResourceExhausted, "quota"),
        StoreError::QueueFull { .. } => (Code::ResourceExhausted, "busy"),
        StoreError::Fenced { .. } => (Code::Unavailable, "reloading"),
        StoreError::Elsewhere { .. } => (Code::Unavailable, "elsewhere"),
        StoreError::Unavailable { .. } | StoreError::Closed => (Code::Unavailable, "store"),
        StoreError::Inconsistent { .. } => (Code::Internal, "defect"),
    }
}

/// The beginnings of the gRPC library's refusals of a malformed message. It calls them INTERNAL, but the
/// daemon is healthy.
const MALFORMED: [&str; 2] = ["failed to decode Protobuf message", "protocol error: "];

/// A status with its proper code: INVALID_ARGUMENT for a message that cannot be read.
pub fn corrected(status: Status) -> Status {
    let is_malformed = MALFORMED.iter().any(|begin| status.message().starts_with(begin));
    if status.code() == Code::Internal && is_malformed {
        return Status::invalid_argument(format!("the request cannot be read: {}", status.message()));
    }
    status
}

/// Every word of [`reason`], and `elsewhere`, which is no error.
pub const REASONS: [&str; 17] = [
    "invalid",
    "token",
    "scope",
    "quota",
    "busy",
    "draining",
    "deadline",
    "loading",
    "reloading",
    "nothing_measured",
    "replaced",
    "not_found",
    "exists",
    "tuner",
    "store",
    "elsewhere",
    "defect",
];

/// The wait before another try of a request; `None` where waiting does not help.
pub fn retry_after(error: &Error) -> Option<Duration> {
    const SOON: Duration = Duration::from_millis(100);
    const LATER: Duration = Duration::from_secs(1);
    match error {
        Error::Quota { retry, .. } => *retry,
        Error::Loading { .. } => Some(LOADING_RETRY),
        Error::Busy { .. } | Error::Reloading { .. } => Some(SOON),
        Error::Store(StoreError::QueueFull { .. } | StoreError::Fenced { .. }) => Some(SOON),
        Error::Tuner(TunerError::TooManyOpenTrials(_)) => Some(LATER),
        error if code(error) == Code::Unavailable => Some(LATER),
        _ => None,
    }
}

/// The words of an error for a client and for the log. What a client wrote may stand in them, and is cut
/// where it is too long.
pub fn message(error: &Error) -> String {
    let mut text = error.to_string();
    if text.len() > MESSAGE_BYTES {
        let end = (0..=MESSAGE_BYTES).rev().find(|end| text.is_char_boundary(*end));
        text.truncate(end.unwrap_or(0));
        text.push_str("...");
    }
    text
}

impl From<Error> for Status {
    fn from(error: Error) -> Self {
        let (code, message) = (code(&error), message(&error));
        assert_ne!(code, Code::Ok, "an error says that all went well: {message}");
        let mut status = match retry_after(&error) {
            None => Status::new(code, message),
            Some(wait) => {
                Status::with_error_details(code, message, ErrorDetails::with_retry_info(Some(wait)))
            }
        };
        if let Some(redirect) = Redirect::of(&error) {
            redirect.write(status.metadata_mut());
        }
        status
    }
}

/// An error inside a stream that stays open.
impl From<Error> for TuneError {
    fn from(error: Error) -> Self {
        let retry_after_ms = retry_after(&error).map(|wait| wait.as_millis().try_into().unwrap_or(i64::MAX));
        TuneError { code: code(&error) as i32, message: message(&error), retry_after_ms }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_clients_bring_about_is_no_failure_of_the_database() {
        let study = "hall".to_owned();
        let kinds = [
            (StoreError::StudyNotFound(study.clone()), "not_found"),
            (StoreError::TrialNotFound { study: study.clone(), number: 1 }, "not_found"),
            (StoreError::StudyExists { study: study.clone(), difference: String::new() }, "exists"),
            (StoreError::TooManyStudies(1), "quota"),
            (StoreError::QueueFull(1), "busy"),
            (StoreError::Unavailable(String::new()), "store"),
            (StoreError::Closed, "store"),
        ];
        for (error, expected) in kinds {
            let found = reason(&Error::Store(error));
            assert_eq!(found, expected);
            assert!(REASONS.contains(&found));
        }
    }

    #[test]
    fn what_a_client_wrote_fits_into_a_header() {
        let short = Error::invalid("filter", "äöü");
        assert_eq!(Status::from(short).message(), "filter: äöü");
        for start in ["", "x"] {
            let long = Error::invalid("order_by", format!("{start}{}", "ä".repeat(1 << 19)));
            let status = Status::from(long.clone());
            assert_eq!(status.code(), Code::InvalidArgument);
            let message = status.message();
            assert!(message.starts_with("order_by: ") && message.ends_with("ä..."), "{message}");
            assert!((MESSAGE_BYTES..MESSAGE_BYTES + 4).contains(&message.len()), "{}", message.len());
            assert_eq!(TuneError::from(long).message, message);
        }
    }

    #[test]
    fn what_passes_is_worth_another_try_after_a_while() {
        let wait = |error: &Error| retry_after(error).map(|wait| wait.as_millis());
        let study = || "hall".to_owned();
        assert_eq!(wait(&Error::Loading(study())), Some(LOADING_RETRY.as_millis()));
        assert_eq!(wait(&Error::Reloading(study())), Some(100));
        assert_eq!(wait(&Error::Busy { what: "requests", limit: 1 }), Some(100));
        assert_eq!(wait(&Error::Store(StoreError::QueueFull(1))), Some(100));
        assert_eq!(wait(&Error::Store(StoreError::Closed)), Some(1000));
        assert_eq!(wait(&Error::Quota { what: "studies", limit: 1, retry: None }), None);
        assert_eq!(wait(&Error::Store(StoreError::StudyNotFound(study()))), None);
    }

    #[test]
    fn what_passes_says_when() {
        let wait = Duration::from_millis(1234);
        let quota = Error::Quota { what: "requests a second", limit: 5, retry: Some(wait) };
        let status = Status::from(quota.clone());
        assert_eq!(status.code(), Code::ResourceExhausted);
        assert_eq!(status.get_details_retry_info().and_then(|info| info.retry_delay), Some(wait));
        assert_eq!(TuneError::from(quota).retry_after_ms, Some(1234));
        for passing in [
            Error::Busy { what: "requests", limit: 1 },
            Error::Draining,
            Error::Loading(String::new()),
            Error::Reloading(String::new()),
            Error::Store(StoreError::QueueFull(1)),
            Error::Store(StoreError::Unavailable(String::new())),
        ] {
            assert!(Status::from(passing).get_details_retry_info().is_some());
        }
        let status = Status::from(Error::Store(StoreError::TooManyStudies(1)));
        assert_eq!(status.code(), Code::ResourceExhausted);
        assert!(status.get_details_retry_info().is_none());
    }
}
