//! Output warping: the transformations through which processes see costs.
//!
//! Costs span magnitudes and their noise grows with them, so that processes look at logarithms.
//! [`ShiftedLog`] chooses the origin of the logarithm by likelihood, and suits the measurements of one state,
//! of which the least count most. [`RobustLog`] is fixed by median and quartiles, and suits measurements of
//! many states, among which there are wild ones.

mod robust_log;
mod shifted_log;

pub(crate) use robust_log::RobustLog;
pub(crate) use shifted_log::ShiftedLog;
