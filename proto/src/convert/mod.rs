//! Between messages and the types of `treewright-model`, for the daemon and for clients alike.
//!
//! Reading is tolerant of newer versions: unknown numbers of enums become
//! [`OpenEnum::Unrecognised`](treewright_model::words::OpenEnum), and code that must decide by them refuses
//! them. A message that lacks a required field is [`Malformed`], with the field.
//!
//! | module | converts |
//! |---|---|
//! | `enums` | enums, by number |
//! | `values` | values and configurations |
//! | `space` | parameter spaces |
//! | `study` | specifications of studies |
//! | `policy` | policies, field by field as the model's table lists them |
//! | `session` | policies of sessions |
//! | `standing` | standings of answers |
//! | `time` | points in time |
//! | `trial` | trials, outcomes and machines |
//! | `reason` | reasons of answers |

mod enums;
mod numbers;
mod policy;
mod reason;
mod session;
mod space;
mod standing;
mod study;
mod time;
mod trial;
mod values;

pub use enums::WireEnum;
pub use numbers::{signed, unsigned};
pub use policy::{policy_from_wire, policy_to_wire};
pub use reason::reason_to_wire;
pub use session::{session_policy_from_wire, session_policy_to_wire};
pub use space::{space_from_wire, space_to_wire};
pub use standing::{standing_from_wire, standing_to_wire};
pub use study::{spec_from_wire, spec_to_wire};
pub use time::{timestamp_from_wire, timestamp_to_wire};
pub use trial::{
    fingerprint_from_wire, fingerprint_to_wire, outcome_from_wire, outcome_to_wire, trial_to_wire,
};
pub use values::{
    Values, configuration_from_wire, configuration_to_wire, readable_configuration, value_from_wire,
    value_to_wire,
};

/// A field of a message is missing or malformed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{field}: {problem}")]
pub struct Malformed {
    /// The field, as a path in the message.
    pub field: String,
    /// The mistake, and how to mend it.
    pub problem: String,
}

impl Malformed {
    /// A field is malformed.
    pub fn new(field: impl Into<String>, problem: impl std::fmt::Display) -> Self {
        Self { field: field.into(), problem: problem.to_string() }
    }

    /// A field is missing.
    pub fn missing(field: impl Into<String>) -> Self {
        Self::new(field, "is required")
    }

    /// No alternative of a `oneof` is set, or an unknown one.
    pub fn no_kind(field: impl Into<String>, known: &str) -> Self {
        Self::new(field, format!("is required; known here are {known}"))
    }
}
