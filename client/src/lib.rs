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
//! | `numbers`, `records`, `insight` | what the service tells, as Rust types; the rest of its words is `treewright-model` |
//! | `checks` | what the service would refuse, found before it is sent |
//! | `wire` | messages as records; what both sides convert alike is in `treewright_proto::convert` |
//! | `client`, `study`, `suggestion`, `tuner`, `prefetching`, `paired`, `pages` | what a program calls |
//! | `credentials`, `attach`, `machine`, `arguments` (a feature) | what is shown to the daemon with every call |
//! | `circuit_breaker`, `back_off` | whether the daemon is there, and when to ask again |
//! | `workers`, `slot` | who runs which trial, under the client's name |
//! | `by_name` | ask and tell apart, for shells and for what carries measurements over |
//! | `outbox`, `delivery`, `stats` | reports on their way, and counts of what became of them |
//! | `study_context`, `shared` | what suggestions keep of their study, and what its handles share |
//! | `front` | several metrics of which none is given up for another |
//! | `answer`, `memory`, `stream` | answers within a deadline, and what to do without one |

mod answer;
#[cfg(feature = "arguments")]
mod arguments;
mod attach;
mod back_off;
pub mod blocking;
mod by_name;
mod checks;
mod circuit_breaker;
mod client;
mod client_id;
mod core;
mod credentials;
mod delivery;
mod error;
mod failover;
mod frame_set;
mod front;
mod insight;
pub mod limits;
pub mod local;
mod machine;
mod memory;
mod numbers;
mod options;
mod outbox;
mod pages;
mod paired;
mod prefetching;
mod records;
mod shared;
mod slot;
mod stats;
mod stream;
mod study;
mod study_context;
mod suggestion;
mod tuner;
mod wire;
mod workers;

#[cfg(feature = "arguments")]
pub use arguments::{CredentialArguments, without_empty_variables};
pub use by_name::Question;
pub use circuit_breaker::Status;
pub use client::Client;
pub use credentials::Credentials;
pub use error::{ClientError, SharedError};
pub use frame_set::{FrameSet, FrameSetResult};
pub use front::{Front, FrontHistory, FrontPoint, ParetoFront};
pub use insight::{Explanation, Omission, StateInsight};
pub use machine::detect_fingerprint;
pub use numbers::{Indicators, Measurements};
pub use options::Options;
pub use pages::{TrialPages, TrialQuery};
pub use paired::{Paired, Side};
pub use prefetching::PrefetchingTuner;
pub use records::{Best, Neighbour, Prediction, Reason, StudyRecord, StudyStatistics, TrialRecord};
pub use stats::Stats;
pub use study::Study;
pub use suggestion::{Finished, Source, Suggestion};
pub use treewright_model::assignment::{Assignment as Configuration, NoSuchValue};
pub use treewright_model::cost_view::CostView;
pub use treewright_model::indicator::Indicator;
pub use treewright_model::objective::{MeasurementLimit, ObjectiveTerm};
pub use treewright_model::plain::{Plain, plain};
pub use treewright_model::policy::{
    Few, Operation, PolicyChange, PolicyError, PolicyField, PolicySettings as Policy, PredictorMethod,
    SearchMethod,
};
pub use treewright_model::session::SessionPolicy;
pub use treewright_model::space::{
    BooleanParameter, CategoricalParameter, Condition, Constraint, Domain, FloatParameter, IntegerParameter,
    Parameter, Scale, Space, SpaceBuilder, SpaceError,
};
pub use treewright_model::standing::{Confirmation, ConfirmationStage, Gain, Standing, StandingVerdict};
pub use treewright_model::study::{StudyBuilder, StudyError};
pub use treewright_model::trial::{Fingerprint, Mode, OmissionReason, Outcome, Rule, TrialState};
pub use treewright_model::value::Value;
pub use treewright_model::words::{OpenEnum, Word};
pub use tuner::Tuner;

/// Everything that defines a study, with its policy as the client says it. Made with [`StudyBuilder`].
pub type StudySpec = treewright_model::study::StudySpec<Policy>;
