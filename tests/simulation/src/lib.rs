//! A fault simulator: from one seed, many clients, a network that delays, loses, repeats and reorders, a disk
//! that fails and machines that crash, around the real service.
//!
//! Real are the gRPC service with its validation, the use cases, the tuner, the fences, the checkpoints, the
//! search for the replica that holds a study. Simulated are the clock, the way from client to service and
//! back and between replicas, and the disk, a store that is durable only once its simulated write has ended.
//! Everything runs on one thread with paused time, and all chance comes from one stream, so that a seed
//! always gives one world, as a fingerprint over all events shows. The method is that of FoundationDB (Zhou
//! et al., "FoundationDB: a distributed unbundled transactional key value store", SIGMOD 2021, section 4).
//!
//! [`plan`] draws the troubles of a world, `run` lets it take its course, and [`world`] holds its shared
//! state; `network`, `forward`, `disk`, `durable`, `claims`, `machine` and `machine_life` are its parts, and
//! `client` uses the service. `ledger` checks at every step that no acknowledged report is lost or changed,
//! no trial is handed to two clients, the regret budget is kept, a frozen study answers what ran, every call
//! is answered, and the service comes back from every crash by itself. `replay` and `frozen` ask at the end.

mod claims;
mod client;
mod disk;
mod durable;
mod forward;
mod frozen;
mod ledger;
mod machine;
mod machine_life;
mod network;
pub mod plan;
mod replay;
mod requests;
mod run;
pub mod world;

pub use ledger::{Counts, Violation};
pub use plan::{Bug, Plan};
pub use run::run;
pub use world::Outcome;
