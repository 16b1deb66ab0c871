//! The common types of the daemon, the clients, the renderer and the tables, each declared once: value,
//! parameter space, indicator, objective, policy, study and trial.
//!
//! The terms are those of Herveau, Pfaffe, Tillmann, Tichy and Dachsbacher, "Analysis of Acceleration
//! Structure Parameters and Hybrid Autotuning for Ray Tracing" ("the paper" in the comments of this crate).
//! The crate does no I/O and knows no wire format: `treewright-proto` converts between these types and its
//! messages. The types serialise in the form of the daemon's stored rows.
//!
//! The way through the crate: [`value`], [`space`] and [`configuration`] describe the parameters,
//! [`indicator`] an input, [`objective`] the cost, [`fidelity`] cheaper ways to measure it, and [`policy`]
//! the decisions of a study; [`study`] joins them. A [`trial`] is a configuration that is handed out, with
//! its result, a [`standing`] is the proof of the best one, and a [`front`] holds the best by several metrics
//! at once. [`ids`], [`names`] and [`limits`] hold for all of them.
// Tests may compare with the platform's functions.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

// Tests that other crates share call this one by its name.
#[cfg(test)]
extern crate self as treewright_model;

pub mod assignment;
pub mod configuration;
pub mod cost_view;
pub mod decision;
pub mod fidelity;
pub mod fnv;
pub mod front;
pub mod ids;
pub mod indicator;
pub mod limits;
pub mod names;
pub mod objective;
pub mod plain;
pub mod policy;
pub mod reason;
pub mod session;
pub mod space;
pub mod standing;
pub mod study;
#[cfg(test)]
mod testing;
pub mod trial;
pub mod value;
pub mod words;
