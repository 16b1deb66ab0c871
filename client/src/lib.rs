//! Client SDK of the Treewright tuning service.
//!
//! A program describes its parameters ([`Space`]) and its input ([`Indicators`]), asks for a [`Suggestion`]
//! before each build, and reports its measurements. A frame never waits for the network longer than the
//! deadline: if the daemon is slow or away, the program gets the last good configuration, or the default.
//! Reports wait in a bounded queue and are sent again until they are acknowledged; dropped reports are
//! counted ([`Client::stats`]).
//!
//! Programs without a tokio runtime use [`blocking`], which mirrors this crate's client. The files
//! `proto/treewright/v1/*.proto` define the meaning of every message on the wire.
//!
//! | module | holds |
//! |---|---|
//! | `numbers`, `records`, `insight` | the service's answers as Rust types; `treewright-model` has the rest |
//! | `checks` | checks for values that the service would refuse |
//! | `wire` | messages as records; conversions that both sides need are in `treewright_proto::convert` |
//! | `client`, `study`, `suggestion`, `tuner`, `prefetching`, `pages` | the calls of a program |
//! | `credentials`, `attach`, `machine`, `arguments` (a feature) | additions to every call |
//! | `circuit_breaker`, `back_off` | whether the daemon is there, and when to ask again |
//! | `workers`, `slot` | names of a client's workers, which run trials side by side |
//! | `by_name` | ask and tell as separate calls, for shells and for carrying measurements over |
//! | `outbox`, `delivery`, `stats` | reports on their way, and counts of their fates |
//! | `study_context`, `shared` | the parts of a study that suggestions keep and that its handles share |
//! | `frame_set`, `episode` | trials of several frames, within the program and over its loop |
//! | `front`, `front_loop`, `stored_front` | several metrics of which none is given up for another |
//! | `answer`, `memory`, `stream` | answers within a deadline, and fallbacks without one |
//! | `prepared` | what the last trial has set up |

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
mod episode;
mod error;
mod failover;
mod frame_set;
mod front;
mod front_loop;
mod insight;
pub mod limits;
pub mod local;
mod locks;
mod machine;
mod memory;
mod numbers;
mod options;
mod outbox;
mod pages;
mod prefetching;
mod prepared;
mod records;
mod shared;
mod slot;
mod stats;
mod stored_front;
mod stream;
mod study;
mod study_context;
mod suggestion;
mod tuner;
mod wire;
mod workers;

#[cfg(feature = "arguments")]
pub use arguments::{CredentialArguments, parse_arguments};
pub use by_name::Question;
pub use circuit_breaker::Status;
pub use client::Client;
pub use credentials::Credentials;
pub use episode::episode_trend;
pub use error::{ClientError, SharedError};
pub use frame_set::{FrameSet, FrameSetResult};
pub use front::FrontHistory;
pub use front_loop::FrontLoop;
pub use insight::{Explanation, Omission, StateInsight};
pub use machine::detect_fingerprint;
pub use numbers::{Indicators, Measurements};
pub use options::Options;
pub use pages::{TrialPages, TrialQuery};
pub use prefetching::PrefetchingTuner;
pub use records::{
    Best, ChangedSpace, Neighbour, Prediction, Reason, StudyRecord, StudyStatistics, TextChange, TrialRecord,
};
pub use stats::Stats;
pub use stored_front::FrontQuery;
pub use study::Study;
pub use suggestion::{Finished, Source, Suggestion};
pub use treewright_model::assignment::{Assignment as Configuration, NoSuchValue};
pub use treewright_model::cost_view::CostView;
pub use treewright_model::fidelity::Fidelity;
pub use treewright_model::front::{Front, FrontError, FrontPoint, ParetoFront};
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
