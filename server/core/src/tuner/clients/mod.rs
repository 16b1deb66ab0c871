//! The clients of a study: their visits and budgets, and the trials that they hold.

mod trials;
mod visits;

pub(crate) use trials::OpenTrials;
pub(crate) use visits::Visits;
