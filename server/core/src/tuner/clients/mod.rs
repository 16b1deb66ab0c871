//! The clients of a study: their visits and budgets, and the trials that they hold.

pub(super) mod trials;
pub(super) mod visits;
