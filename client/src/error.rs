//! The errors of a client, as one small enum. Each message names the cause and the remedy, because it is
//! mostly read in a renderer's log by somebody who does not know this service.

use std::sync::Arc;
use std::time::Duration;

use crate::attach::REQUEST_ID;
use crate::{FrontError, NoSuchValue, PolicyError, SpaceError, StudyError};

/// Why a call did not succeed.
#[derive(Debug, Clone, thiserror::Error)]
pub enum ClientError {
    /// The daemon's address is not a URL that can be connected to.
    #[error("`{url}` is not an address of a daemon: {reason}; write it like http://127.0.0.1:50611")]
    BadUrl {
        /// As given by the caller.
        url: String,
        /// The mistake in it.
        reason: String,
    },

    /// The asynchronous client was used outside a tokio runtime, or its thread could not be started.
    #[error("no tokio runtime: {reason}; use `treewright_client::blocking` in programs without one")]
    NoRuntime {
        /// The missing part.
        reason: String,
    },

    /// There is no daemon of one's own to be had.
    #[error("a local daemon cannot be started: {problem}")]
    NoLocalDaemon {
        /// Why not.
        problem: String,
    },

    /// Nobody answers at the address.
    #[error(
        "no daemon answers at {url} ({reason}); start one with `treewrightd serve --listen ADDRESS --database FILE`, \
         or point the client at a running one"
    )]
    Away {
        /// Where the daemon was expected.
        url: String,
        /// The network's error.
        reason: String,
        /// When it may be asked again, if it answered that it cannot serve yet: while it loads a study, or
        /// drains.
        retry_after: Option<Duration>,
    },

    /// The daemon answers, but cannot do it now: it is reading the study into memory, or about to stop.
    #[error("the daemon at {url} cannot answer now: {reason}")]
    NotNow {
        /// Where the daemon was asked.
        url: String,
        /// The daemon's words.
        reason: String,
        /// When it may be asked again, if it said so.
        retry_after: Option<Duration>,
    },

    /// The daemon took longer than the caller may wait.
    #[error(
        "the daemon at {url} did not answer {call} within {} ms; allow a longer deadline, or look at the daemon's load",
        deadline.as_millis()
    )]
    Late {
        /// Where the daemon was asked.
        url: String,
        /// The call.
        call: &'static str,
        /// The time waited.
        deadline: Duration,
    },

    /// The daemon answered that it will not do it.
    #[error("the daemon refused {call}: {message} ({code:?}{})", request_words(request_id.as_deref()))]
    Refused {
        /// The call.
        call: &'static str,
        /// The canonical gRPC code.
        code: tonic::Code,
        /// The daemon's words.
        message: String,
        /// When it may be asked again, if it said so.
        retry_after: Option<Duration>,
        /// The id under which the daemon's log says more.
        request_id: Option<String>,
    },

    /// The daemon's answer does not follow the wire contract.
    #[error(
        "the daemon's answer to {call} cannot be understood: {problem}; client and daemon may be of different versions"
    )]
    Malformed {
        /// The call.
        call: &'static str,
        /// The fault that was found.
        problem: String,
    },

    /// Something the caller handed in is wrong; nothing was sent.
    #[error("{what}: {problem}")]
    Invalid {
        /// The offending thing, e.g. `parameter max_depth`.
        what: String,
        /// The mistake in it, and how to mend it.
        problem: String,
    },

    /// A configuration was asked for a value that it does not have, or has with another type.
    #[error(transparent)]
    NoSuchValue(#[from] NoSuchValue),

    /// Reports were still waiting when the time for sending them was up.
    #[error("{waiting} report(s) were not acknowledged within {} ms; the last problem was: {last}", deadline.as_millis())]
    Unflushed {
        /// Reports and abandoned trials not yet acknowledged.
        waiting: usize,
        /// The time waited.
        deadline: Duration,
        /// The most recent error, or `none`.
        last: String,
    },

    /// A suggestion that was to be there before it is needed is not there yet.
    #[error("there is no suggestion yet: {why}")]
    NotYet {
        /// Why not.
        why: &'static str,
    },

    /// Too much is under way already.
    #[error("{what}: the limit of {limit} is reached; try again when some are done")]
    Busy {
        /// The items that are too many.
        what: &'static str,
        /// The limit.
        limit: usize,
    },
}

macro_rules! invalid {
    ($($error:ty => $what:literal;)+) => {
        $(
            impl From<$error> for ClientError {
                fn from(error: $error) -> Self {
                    Self::invalid($what, error.to_string())
                }
            }
        )+
    };
}

invalid! {
    FrontError => "metrics of a front";
    PolicyError => "policy";
    SpaceError => "space";
    StudyError => "study";
}

/// An error that several handles share.
pub type SharedError = Arc<ClientError>;

impl ClientError {
    /// Whether the daemon could not be reached in time, so that trying again later makes sense.
    pub fn is_unreachable(&self) -> bool {
        matches!(self, Self::Away { .. } | Self::NotNow { .. } | Self::Late { .. })
    }

    /// Whether a repeated call may succeed later: the daemon could not be reached in time, has too much to
    /// do, or has a defect that may pass.
    pub fn may_pass(&self) -> bool {
        use tonic::Code::{Aborted, Internal, ResourceExhausted, Unknown};
        match self {
            Self::Refused { code, .. } => matches!(code, ResourceExhausted | Aborted | Internal | Unknown),
            _ => self.is_unreachable(),
        }
    }

    /// Whether the daemon said that the thing does not exist.
    pub fn is_not_found(&self) -> bool {
        matches!(self, Self::Refused { code: tonic::Code::NotFound, .. })
    }

    /// Whether the daemon said that it cannot read the request, e.g. its filter.
    pub fn is_invalid_argument(&self) -> bool {
        matches!(self, Self::Refused { code: tonic::Code::InvalidArgument, .. })
    }

    /// The pause that the daemon asked for before another call; at most
    /// [`LONGEST_HINT`](crate::limits::LONGEST_HINT).
    pub fn retry_after(&self) -> Option<Duration> {
        match self {
            Self::Refused { retry_after, .. }
            | Self::Away { retry_after, .. }
            | Self::NotNow { retry_after, .. } => {
                retry_after.map(|wait| wait.min(crate::limits::LONGEST_HINT))
            }
            _ => None,
        }
    }

    /// The error of a daemon that does not answer, for this reason.
    pub(crate) fn away(url: &str, reason: impl Into<String>) -> Self {
        Self::Away { url: url.to_owned(), reason: reason.into(), retry_after: None }
    }

    pub(crate) fn invalid(what: impl Into<String>, problem: impl Into<String>) -> Self {
        Self::Invalid { what: what.into(), problem: problem.into() }
    }

    /// Sorts a gRPC status into "nobody there", "too late" and "refused".
    pub(crate) fn from_status(url: &str, call: &'static str, status: &tonic::Status) -> Self {
        use tonic::Code;
        use tonic_types::StatusExt as _;
        let retry_after = status.get_details_retry_info().and_then(|info| info.retry_delay);
        let away = |reason: String| Self::Away { url: url.to_owned(), reason, retry_after };
        // A status with a source was made on this side, out of a fault of the connection.
        if let Some(source) = std::error::Error::source(status) {
            return away(with_remedy(url, innermost(source)));
        }
        match status.code() {
            Code::Unavailable => {
                Self::NotNow { url: url.to_owned(), reason: status.message().to_owned(), retry_after }
            }
            Code::DeadlineExceeded | Code::Cancelled => {
                away(format!("{:?}: {}", status.code(), status.message()))
            }
            code => Self::Refused {
                call,
                code,
                message: status.message().to_owned(),
                retry_after,
                request_id: status
                    .metadata()
                    .get(REQUEST_ID)
                    .and_then(|id| id.to_str().ok())
                    .map(str::to_owned),
            },
        }
    }
}

/// Adds the likely fault of the address where one side speaks TLS and the other does not.
fn with_remedy(url: &str, reason: String) -> String {
    let rest = url.split_once("://").map_or("", |(_, rest)| rest);
    // rustls says so where the answer is no TLS record.
    if url.starts_with("https://") && reason.contains("InvalidContentType") {
        return format!("{reason}: it speaks plain text there; write http://{rest}");
    }
    // A server with TLS answers plain text with an alert, which is no frame of HTTP/2, or hangs up.
    let is_no_http =
        ["frame with invalid size", "invalid HTTP", "FRAME_SIZE_ERROR", "connection closed", "broken pipe"];
    let lower = reason.to_lowercase();
    if url.starts_with("http://") && is_no_http.iter().any(|words| lower.contains(&words.to_lowercase())) {
        return format!("{reason}: if it speaks TLS there, write https://{rest}");
    }
    reason
}

fn request_words(request_id: Option<&str>) -> String {
    request_id.map_or_else(String::new, |id| format!(", request {id}"))
}

/// The message at the bottom of a chain of errors, which is the one that says something.
pub(crate) fn innermost(error: &dyn std::error::Error) -> String {
    let mut error = error;
    while let Some(source) = error.source() {
        error = source;
    }
    error.to_string()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn statuses_are_sorted_by_what_can_be_done_about_them() {
        use tonic_types::StatusExt as _;
        let error = |status: tonic::Status| ClientError::from_status("http://x", "Suggest", &status);
        let draining = error(tonic::Status::unavailable("draining"));
        assert!(draining.is_unreachable());
        assert_eq!(draining.to_string(), "the daemon at http://x cannot answer now: draining");
        assert!(error(tonic::Status::not_found("studies/x")).is_not_found());
        let refused = error(tonic::Status::invalid_argument("indicator a is not finite"));
        assert!(!refused.is_unreachable());
        assert_eq!(
            refused.to_string(),
            "the daemon refused Suggest: indicator a is not finite (InvalidArgument)"
        );
        assert_eq!(refused.retry_after(), None);
        let wait = Duration::from_millis(100);
        let details = tonic_types::ErrorDetails::with_retry_info(Some(wait));
        let loading = tonic::Status::with_error_details(tonic::Code::Unavailable, "being loaded", details);
        let loading = error(loading);
        assert!(loading.is_unreachable() && loading.retry_after() == Some(wait), "{loading:?}");
        let mut named = tonic::Status::permission_denied("not yours");
        named.metadata_mut().insert("x-request-id", tonic::metadata::MetadataValue::from_static("7-a"));
        assert!(error(named).to_string().ends_with("(PermissionDenied, request 7-a)"));
    }
}
