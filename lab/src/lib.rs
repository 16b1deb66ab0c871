//! The laboratory: measurements behind what the project claims, and none that a user needs while tuning.
//!
//! | module | what it does |
//! |---|---|
//! | `converge` | error against run time: whose picture is good enough first |
//! | `ablation` | a winner taken apart, one value at a time |
//! | `fleet` | what a machine gains from its own measurements, its group's and the fleet's |
//! | `leave_scene_out` | what the service is worth on scenes it has never seen |
//! | `evaluation` | the paper's section 7: searches along camera paths are recorded, predictors judged by the record |
//! | `simulated` | what the studies of the examples are made of |
//! | `commands` | the program `treewright-lab`: these, `verify` and `leave-out` |
//!
//! The examples of this crate measure the tuner without a renderer: searches, predictors, regret
//! (`cargo run --release -p treewright-lab --example NAME`). Nothing of the product depends on this crate.

pub mod ablation;
pub mod commands;
pub mod converge;
pub(crate) mod evaluation;
pub(crate) mod fleet;
pub(crate) mod leave_scene_out;
pub mod simulated;
