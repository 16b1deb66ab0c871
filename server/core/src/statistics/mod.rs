//! Statistics of measurements: estimates with intervals, tests that are valid at every step, and the choice
//! of the next run. All functions are pure: numbers in, numbers out.

pub mod auxiliary;
pub mod confirm;
pub mod distribution;
pub mod drift;
pub mod estimate;
pub mod exploration_value;
pub mod movement;
pub mod portfolio;
