//! The Treewright daemon: serves the tuning core over gRPC.
//!
//! A request comes in through [`connections`] and [`tls`]. [`middleware`] gives it an id and asks [`access`]
//! for its sender. [`admission`] limits the requests in progress. [`rpc`] reads it with [`convert`].
//! [`tuning`] does its work on a tuner in memory and on the store. [`convert`] writes the answer, and
//! [`status`] turns errors into gRPC codes. Where several daemons share a database, [`forward`] and [`peers`]
//! bring it to the one that holds its study. [`metrics`] counts requests, [`refusals`] logs refused ones, and
//! `watch` shows the figures.
//!
//! [`serve`] runs these parts until a signal to stop; [`daemon`] makes a process of them. [`administration`]
//! makes and revokes tokens, [`maintenance`] backs up, restores and checks database files, [`manual`] writes
//! manual pages and completions.

pub mod access;
pub mod administration;
pub mod admission;
mod certificate;
pub mod clock;
pub mod config;
pub mod connections;
pub mod convert;
pub mod daemon;
mod dashboard;
pub mod descriptors;
pub mod error;
pub mod forward;
mod idle;
pub mod inherited;
pub mod limits;
pub mod listeners;
pub mod maintenance;
pub mod manual;
pub mod metrics;
pub mod middleware;
pub mod peers;
pub mod redirect;
pub mod refusals;
pub mod rpc;
pub mod serve;
pub mod status;
pub mod telemetry;
pub mod tls;
mod trouble;
pub mod tuning;
mod watch;
