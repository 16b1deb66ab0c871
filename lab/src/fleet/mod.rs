//! A predictor for each node, for each group and for the fleet, which the paper's section 8 leaves to future
//! work. It shows a machine's gain from its own measurements, from those of its group, and from those of all.
//!
//! | module | contents |
//! |---|---|
//! | `machines` | emulated machines, their groups, and whose measurements each predictor knows |
//! | `measure` | searches, and the answers of each predictor to an unseen scene |
//! | `record` | everything measured, as JSON Lines |
//! | `judge` | the table from the record |
//!
//! Each machine searches each scene once, by a daemon of its own. Each scene is then unseen once: for each
//! predictor a fresh daemon gets the recorded trials of the other scenes that this predictor may know, under
//! the names of the machines that took them. So predictors differ only in the number of measurements that
//! they know.

pub(crate) mod judge;
pub(crate) mod machines;
pub(crate) mod measure;
pub(crate) mod record;
