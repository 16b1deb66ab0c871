//! Failures as C sees them: a number to switch on, and a message with cause and remedy.

use std::ffi::{CString, c_char};

use treewright_client::ClientError;

/// The kind of a failure; `enum tw_code` of the header.
#[repr(i32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Code {
    /// An argument is wrong; nothing was sent.
    Invalid = 1,
    /// No daemon answers.
    Away = 2,
    /// The daemon took too long.
    Late = 3,
    /// The daemon will not do it.
    Refused = 4,
    /// The daemon's answer makes no sense.
    Malformed = 5,
    /// A configuration has no such value.
    NoSuchValue = 6,
    /// Reports are still waiting.
    Unflushed = 7,
    /// Too much is under way, or nothing is there yet.
    Busy = 8,
    /// The client's thread could not be started.
    NoThread = 9,
    /// A defect of the library.
    Internal = 10,
}

/// A failure. C frees it.
#[derive(Debug)]
pub(crate) struct Failure {
    code: Code,
    grpc: i32,
    message: CString,
}

/// Text for C; a zero within it, which no message of ours has, becomes a question mark.
pub(crate) fn c_text(text: &str) -> CString {
    CString::new(text.replace('\0', "?")).unwrap_or_default()
}

impl Failure {
    pub(crate) fn new(code: Code, message: impl AsRef<str>) -> Self {
        Self { code, grpc: 0, message: c_text(message.as_ref()) }
    }

    pub(crate) fn invalid(message: impl AsRef<str>) -> Self {
        Self::new(Code::Invalid, message)
    }
}

impl From<ClientError> for Failure {
    fn from(error: ClientError) -> Self {
        let code = match &error {
            ClientError::BadUrl { .. } | ClientError::Invalid { .. } => Code::Invalid,
            ClientError::NoRuntime { .. } => Code::NoThread,
            ClientError::Away { .. } | ClientError::NotNow { .. } | ClientError::NoLocalDaemon { .. } => {
                Code::Away
            }
            ClientError::Late { .. } => Code::Late,
            ClientError::Refused { .. } => Code::Refused,
            ClientError::Malformed { .. } => Code::Malformed,
            ClientError::NoSuchValue(_) => Code::NoSuchValue,
            ClientError::Unflushed { .. } => Code::Unflushed,
            ClientError::NotYet { .. } | ClientError::Busy { .. } => Code::Busy,
        };
        let grpc = match &error {
            ClientError::Refused { code, .. } => *code as i32,
            _ => 0,
        };
        Self { grpc, ..Self::new(code, error.to_string()) }
    }
}

exports! {
    fn tw_error_code(error: Option<&Failure>) -> i32 {
        error.map_or(0, |error| error.code as i32)
    }

    fn tw_error_grpc_code(error: Option<&Failure>) -> i32 {
        error.map_or(0, |error| error.grpc)
    }

    fn tw_error_message(error: Option<&Failure>) -> *const c_char {
        error.map_or(c"".as_ptr(), |error| error.message.as_ptr())
    }

    fn tw_error_free(error: Failure);
}
