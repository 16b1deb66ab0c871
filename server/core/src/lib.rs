//! The pure tuning core: typed parameter spaces, searches inside one state, predictors across states, and
//! the state machine of one study that joins them.
//!
//! It carries out sections 3.2, 5, 6 and 7.1 of Herveau, Pfaffe, Tillmann, Tichy and Dachsbacher, "Analysis
//! of Acceleration Structure Parameters and Hybrid Autotuning for Ray Tracing" ("the paper" in the comments
//! of this crate). The core does no I/O, reads no clock and no environment, and draws random numbers only
//! from given seeds: equal specifications and equal calls give equal bytes.
//!
//! The way through the crate, from the ground up: the shared words (`treewright-model`) come first.
//! [`value`], [`space`] and [`configuration`] describe the parameters, [`indicator`] an input, [`objective`]
//! the cost; [`study`] joins them with a [`policy`], and a [`trial`] is handed out to a client. [`search`]
//! explores one state, [`predict`] carries knowledge from state to state, and [`machines`] from machine to
//! machine. [`statistics`] judges measurements, and [`tuner`] decides.
// Tests may compare with the platform's functions.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub use treewright_model::{
    assignment, configuration, cost_view, decision, fidelity, fnv, front, ids, indicator, names, objective,
    policy, session, space, standing, study, trial, value, words,
};

mod gp;
pub mod limits;
pub mod machines;
mod matrix;
pub mod pace;
pub mod packed;
pub mod predict;
pub mod quiet;
mod randomness;
pub mod results;
pub mod robust;
pub mod search;
pub mod statistics;
pub mod sum;
#[cfg(test)]
#[allow(dead_code, reason = "the specifications that it draws are used by other crates")]
#[path = "../../../model/src/testing.rs"]
mod testing;
pub mod tuner;
