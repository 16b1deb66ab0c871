//! A state with its table.

use std::sync::Arc;

use super::ResultTable;
use crate::ids::{MachineId, StateId};

/// A known state of the study with its measurements.
#[derive(Clone, Debug, PartialEq)]
pub struct KnownState {
    /// Rises by one from 1 within the study.
    pub id: StateId,
    /// The normalised indicators that founded it.
    pub anchor: Vec<f64>,
    /// The machine of these measurements: its place in the study's [`Machines`](crate::machines::Machines).
    pub machine: MachineId,
    /// A search was begun in it, or clients brought along the measurements of one.
    pub explored: bool,
    /// The table of its configurations.
    pub results: Arc<ResultTable>,
}
