//! Statistics of measurements: estimates with intervals, tests that are valid at every step, and the choice
//! of the next run. All functions are pure: numbers in, numbers out.
//!
//! | module | subject |
//! |---|---|
//! | [`estimate`] | the true costs of a state's configurations, and the gain of the best over the default |
//! | [`confirm`] | the race of paired measurements between a challenger and the incumbent |
//! | [`portfolio`] | the few configurations that together serve all known states best |
//! | [`drift`] | the present speed of a client's machine |
//! | [`auxiliary`] | costs without the noise that other measurements explain |
//! | [`movement`] | costs at the anchor of their state |
//! | [`exploration_value`] | the value of the next few trials |
//! | [`distribution`] | the normal distribution and Student's |

pub mod auxiliary;
pub mod confirm;
pub mod distribution;
pub mod drift;
pub mod estimate;
pub mod exploration_value;
pub mod movement;
pub mod portfolio;
