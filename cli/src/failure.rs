//! Why a command failed, and the exit code that says so to scripts.

use std::process::ExitCode;

use treewright_client::{ClientError, SpaceError};

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// The command line asks for something that makes no sense.
    #[error("{0}")]
    Usage(String),
    /// The client or the daemon says no.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// What is given does not fit the study.
    #[error("space: {0}")]
    Space(#[from] SpaceError),
    /// The result cannot be written out.
    #[error("the result cannot be written: {0}")]
    Output(std::io::Error),
    /// The result cannot be put into JSON.
    #[error("the result cannot be put into JSON: {0}")]
    Json(#[from] serde_json::Error),
}

impl Failure {
    /// 1 the operation failed, 2 wrong usage, 3 no daemon reached.
    pub(crate) fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Self::Usage(_)
            | Self::Space(_)
            | Self::Client(ClientError::BadUrl { .. } | ClientError::Invalid { .. }) => 2,
            Self::Client(error) if error.is_unreachable() => 3,
            Self::Client(_) | Self::Output(_) | Self::Json(_) => 1,
        })
    }
}
