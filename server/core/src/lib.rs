//! The pure tuning core: typed parameter spaces, searches inside one state, predictors across states, and
//! the state machine of one study that joins them.
//!
//! It carries out sections 3.2, 5, 6 and 7.1 of Herveau, Pfaffe, Tillmann, Tichy and Dachsbacher,
//! "Analysis of Acceleration Structure Parameters and Hybrid Autotuning for Ray Tracing" ("the paper" in
//! the comments of this crate). The core does no I/O, reads no clock and no environment, and owns no
//! randomness it was not handed: the same specification and the same calls give the same bytes.
//!
//! The way through the crate, from the ground up: of the shared words (`treewright-model`), [`value`],
//! [`space`] and [`configuration`] say what can be run; [`indicator`] and [`objective`] say what is known of
//! an input and what is minimised; [`study`] joins them with a [`policy`]; [`trial`] is what is handed out;
//! [`search`] explores one state; [`predict`] carries knowledge from state to state, [`machines`] from
//! machine to machine; [`statistics`] says what measurements prove; [`tuner`] decides.
// Tests may compare with what the platform computes.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub use treewright_model::{
    configuration, cost_view, decision, fnv, ids, indicator, names, objective, policy, session, space,
    standing, study, trial, value, words,
};

mod gp;
pub mod limits;
pub mod machines;
mod matrix;
pub mod pace;
pub mod packed;
pub mod predict;
mod randomness;
mod rank;
pub mod results;
pub mod robust;
pub mod search;
pub mod statistics;
pub mod sum;
#[cfg(test)]
#[path = "../../../model/src/testing.rs"]
mod testing;
pub mod tuner;
