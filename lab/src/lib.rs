//! The laboratory: measurements behind the project's claims. Nobody needs them for tuning.
//!
//! | module | contents |
//! |---|---|
//! | `converge` | error against run time: whose picture is good enough first |
//! | `fleet` | a machine's gain from its own measurements, its group's and the fleet's |
//! | `leave_scene_out` | the gain from the service on scenes that it has never seen |
//! | `evaluation` | the paper's section 7: searches along camera paths are recorded, predictors judged by the record |
//! | `geometry` | the hash of a scene's geometry |
//! | `json_lines` | records on disk |
//! | `sessions` | the sums of builds and frames of sessions in which a tree serves some frames |
//! | `simulated` | parts of the studies of examples and tests |
//! | `ways` | ways to do one thing in many worlds: each world's best beside the best of other scenes |
//! | `worlds` | a scene, its motion, the size of its pictures and the threads in one word |
//! | `commands` | the program `treewright-lab`: these |
//!
//! The example `gate` compares searches and answers of the tuner, without a renderer, with recorded figures
//! (`make gate`); `ask_tell` is the tuner for comparisons in other languages. Nothing of the product depends
//! on this crate.

pub mod commands;
pub mod converge;
pub(crate) mod evaluation;
pub(crate) mod fleet;
pub(crate) mod geometry;
pub mod json_lines;
pub(crate) mod leave_scene_out;
pub mod sessions;
pub mod simulated;
pub mod ways;
pub mod worlds;
