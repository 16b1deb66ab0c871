//! The Treewright daemon: the gRPC front of the tuning core.
//!
//! A request's way: `connections` and [`tls`] bring it, [`front`] names it and asks [`access`] who sent it, [`gate`]
//! lets it in, [`rpc`] reads it with [`convert`], [`tuning`] does its work on a tuner in memory and on the store,
//! [`convert`] writes the answer, and [`status`] says what went wrong.
//! `metrics` counts all that, and `watch` shows it. [`serve`] runs all that until told to stop;
//! [`daemon`] adds what makes it a process, and [`administration`] makes and revokes tokens, [`keeping`] copies,
//! restores and checks database files.
#![forbid(unsafe_code)]

pub mod access;
pub mod administration;
pub mod clock;
pub mod config;
mod connections;
pub mod convert;
pub mod daemon;
pub mod error;
pub mod forward;
pub mod front;
pub mod gate;
pub mod keeping;
pub mod limits;
mod metrics;
pub mod peers;
pub mod rpc;
pub mod serve;
pub mod status;
pub mod telemetry;
pub mod tls;
pub mod tuning;
mod watch;
