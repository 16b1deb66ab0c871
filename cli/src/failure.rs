//! Why a command failed, and the exit code that says so to scripts.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use treewright_client::{ClientError, SpaceError};

/// What a command comes to.
pub(crate) type Result<T, E = Failure> = std::result::Result<T, E>;

/// Why a command failed.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Failure {
    /// The command line asks for something that makes no sense.
    #[error("{0}")]
    Usage(String),
    /// The client or the daemon says no.
    #[error(transparent)]
    Client(#[from] ClientError),
    /// A given value does not fit the study.
    #[error("space: {0}")]
    Space(#[from] SpaceError),
    /// A file cannot be read or written, or holds something else.
    #[error("{}: {problem}", path.display())]
    File { path: PathBuf, problem: String },
    /// The program that is tuned does not do as it should.
    #[error("{0}")]
    Program(String),
    /// The requested data is not there, or says something else than it should.
    #[error("{0}")]
    Data(String),
    /// The result cannot be written out.
    #[error("the result cannot be written: {0}")]
    Output(std::io::Error),
    /// Something was found before it went wrong.
    #[error("{cause}")]
    Unfinished {
        /// The text to print of the results so far.
        found: String,
        cause: Box<Failure>,
    },
    /// The result cannot be put into JSON.
    #[error("the result cannot be put into JSON: {0}")]
    Json(#[from] serde_json::Error),
}

impl Failure {
    pub(crate) fn file(path: &Path, problem: impl Into<String>) -> Self {
        Self::File { path: path.to_owned(), problem: problem.into() }
    }

    /// 1 the operation failed, 2 wrong usage, 3 no daemon reached.
    pub(crate) fn exit_code(&self) -> ExitCode {
        ExitCode::from(match self {
            Self::Unfinished { cause, .. } => return cause.exit_code(),
            Self::Usage(_)
            | Self::Space(_)
            | Self::Client(ClientError::BadUrl { .. } | ClientError::Invalid { .. }) => 2,
            Self::Client(error) if error.is_unreachable() => 3,
            Self::Client(ClientError::NoLocalDaemon { .. }) => 3,
            _ => 1,
        })
    }
}
