//! The one place where errors become gRPC status codes, as the comments of the wire contract promise.

use tonic::{Code, Status};
use treewright_core::tuner::TunerError;
use treewright_proto::v1::TuneError;
use treewright_store::StoreError;

use crate::error::Error;
use crate::peers::Fate;

/// The canonical code of an error.
#[must_use]
pub fn code(error: &Error) -> Code {
    match error {
        Error::Invalid { .. } => Code::InvalidArgument,
        Error::Tuner(error) => tuner_code(error),
        Error::Store(error) => store_code(error),
        Error::NothingMeasured { .. } => Code::NotFound,
        Error::Reloading { .. } | Error::Draining => Code::Unavailable,
        Error::Busy { .. } => Code::ResourceExhausted,
        Error::Restore { .. } | Error::Defect(_) => Code::Internal,
    }
}

fn tuner_code(error: &TunerError) -> Code {
    match error {
        TunerError::ClientId
        | TunerError::Indicators(_)
        | TunerError::Wanted(_)
        | TunerError::Fingerprint
        | TunerError::TooManyMeasurements { .. }
        | TunerError::MeasurementName { .. }
        | TunerError::Objective(_)
        | TunerError::LowerBound(_)
        | TunerError::OutcomeReason
        | TunerError::Study(_) => Code::InvalidArgument,
        TunerError::TooManyStates | TunerError::TooManyClients | TunerError::TooManyOpenTrials { .. } => {
            Code::ResourceExhausted
        }
        TunerError::AlreadyCompleted { .. } | TunerError::Abandoned { .. } | TunerError::NotOpen { .. } => {
            Code::FailedPrecondition
        }
        TunerError::UnknownTrial { .. } => Code::NotFound,
    }
}

fn store_code(error: &StoreError) -> Code {
    match error {
        StoreError::StudyNotFound { .. } | StoreError::TrialNotFound { .. } => Code::NotFound,
        StoreError::StudyExists { .. } => Code::AlreadyExists,
        StoreError::TooManyStudies { .. } | StoreError::QueueFull { .. } => Code::ResourceExhausted,
        StoreError::Fenced { .. }
        | StoreError::Elsewhere { .. }
        | StoreError::Unavailable { .. }
        | StoreError::Closed => Code::Unavailable,
        StoreError::Inconsistent { .. } => Code::Internal,
    }
}

impl From<Error> for Status {
    fn from(error: Error) -> Self {
        let mut status = Status::new(code(&error), error.to_string());
        if let Some(fate) = Fate::of(&error) {
            fate.write(status.metadata_mut());
        }
        status
    }
}

/// The same inside a stream that stays open.
impl From<Error> for TuneError {
    fn from(error: Error) -> Self {
        TuneError { code: code(&error) as i32, message: error.to_string() }
    }
}
