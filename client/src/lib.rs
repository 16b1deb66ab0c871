//! Client SDK of the Treewright tuning service.
//!
//! A program describes what it can tune ([`Space`]) and what describes its input ([`Indicators`]),
//! asks for a [`Suggestion`] before each build, and reports what it measured. A frame never waits for
//! the network longer than the deadline: if the daemon is slow or away, the program gets the last good
//! configuration, or the default. Reports wait in a bounded queue and are sent again until they are
//! acknowledged; what is dropped is counted ([`Client::stats`]).
//!
//! Programs without a tokio runtime use [`blocking`], which has the same shape. The meaning of every
//! message on the wire stands in `proto/treewright/v1/*.proto`.
//!
//! | module | what it holds |
//! |---|---|
//! | `space`, `study_spec`, `policy`, `value`, `numbers`, `outcome`, `records` | the words of the service as Rust types |
//! | `wire` | the only place that knows both these and the wire types |
//! | `client`, `study`, `suggestion`, `tuner`, `pages` | what a program calls |
//! | `credentials`, `attach`, `arguments` (a feature) | what is shown to the daemon with every call |
//! | `link`, `back_off` | whether the daemon is there, and when to ask again |
//! | `outbox`, `delivery`, `stats` | reports on their way, and counts of what became of them |
//! | `answer`, `memory`, `stream` | answers within a deadline, and what to do without one |
#![forbid(unsafe_code)]

mod answer;
#[cfg(feature = "arguments")]
mod arguments;
mod attach;
mod back_off;
pub mod blocking;
mod client;
mod core;
mod credentials;
mod delivery;
mod error;
mod failover;
mod fingerprint;
mod frame_set;
mod insight;
pub mod limits;
mod link;
mod memory;
mod numbers;
mod options;
mod outbox;
mod outcome;
mod pages;
mod policy;
mod records;
mod space;
mod space_builder;
mod stats;
mod stream;
mod study;
mod study_spec;
mod suggestion;
mod tuner;
mod value;
mod wire;

#[cfg(feature = "arguments")]
pub use arguments::CredentialArguments;
pub use client::Client;
pub use credentials::Credentials;
pub use error::{ClientError, SharedError};
pub use fingerprint::Fingerprint;
pub use frame_set::{FrameSet, FrameSetResult};
pub use insight::{Explanation, Omission, OmissionReason, Rule, StateInsight};
pub use link::Status;
pub use numbers::{Indicators, Measurements};
pub use options::Options;
pub use outcome::Outcome;
pub use pages::{TrialPages, TrialQuery};
pub use policy::{Operation, Policy, PolicyChange, PredictorMethod, SearchMethod};
pub use records::{
    Best, Mode, Neighbour, Prediction, Reason, StudyRecord, StudyStatistics, TrialRecord, TrialState,
};
pub use space::{Condition, Constraint, Domain, Parameter, Scale, Space};
pub use space_builder::{
    BooleanParameter, CategoricalParameter, FloatParameter, IntegerParameter, SpaceBuilder,
};
pub use stats::Stats;
pub use study::Study;
pub use study_spec::{Indicator, ObjectiveTerm, StudyBuilder, StudySpec};
pub use suggestion::{Finished, Source, Suggestion};
pub use treewright_model::session::SessionPolicy;
pub use tuner::Tuner;
pub use value::{Configuration, Value};
