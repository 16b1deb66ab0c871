//! Statistics of measurements: estimates with intervals, tests that are valid at every step, and the choice
//! of the next run. All functions are pure: numbers in, numbers out.
//!
//! | module | what it answers |
//! |---|---|
//! | [`estimate`] | what each configuration of a state really costs, and what the best gains over the default |
//! | [`confirm`] | whether a challenger is better than the incumbent, as a race of paired measurements |
//! | [`portfolio`] | which few configurations together serve all known states best |
//! | [`drift`] | how fast a client's machine is at the moment |
//! | [`auxiliary`] | what a cost would have been without the noise that other measurements explain |
//! | [`movement`] | what a cost would have been at the anchor of its state |
//! | [`exploration_value`] | whether the next few trials pay for themselves |
//! | [`distribution`] | the normal distribution and Student's |

pub mod auxiliary;
pub mod confirm;
pub mod distribution;
pub mod drift;
pub mod estimate;
pub mod exploration_value;
pub mod movement;
pub mod portfolio;
#[cfg(test)]
pub(crate) mod simulated;
