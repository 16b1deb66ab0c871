//! The words of tuning, each declared once: what the daemon, the clients, the renderer and the tables all
//! mean by a value, a parameter space, an indicator, an objective, a policy, a study and a trial.
//!
//! The terms are those of Herveau, Pfaffe, Tillmann, Tichy and Dachsbacher, "Analysis of Acceleration
//! Structure Parameters and Hybrid Autotuning for Ray Tracing" ("the paper" in the comments of this crate).
//! The crate does no I/O and knows no wire format: `treewright-proto` converts between these types and its
//! messages. The forms in which the types are serialised are those of the daemon's stored rows.
//!
//! The way through the crate: [`value`], [`space`] and [`configuration`] say what can be run; [`indicator`]
//! and [`objective`] what is known of an input and what is minimised; [`policy`] how a study decides;
//! [`study`] joins them; [`trial`] is what is handed out and what came of it, [`standing`] what is proven of
//! the best. [`ids`], [`names`] and [`limits`] hold for all of them.
// Tests may compare with what the platform computes.
#![cfg_attr(test, allow(clippy::disallowed_methods))]

pub mod assignment;
pub mod configuration;
pub mod cost_view;
pub mod decision;
pub mod fnv;
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
