//! The choices among the axes of a space: few values with equal shares of the axis.

use crate::space::{Domain, Scale, Space};

/// Most values of a choice. Axes of more are searched like continuous ones.
const LEVELS_MAX: u64 = 8;

/// The number of values of each parameter that is a choice between few; 0 for all others.
pub fn levels(space: &Space) -> Vec<u32> {
    let count = |domain: &Domain| match domain {
        Domain::Boolean => 2,
        Domain::Categorical { values } => values.len() as u64,
        Domain::Integer { min, max, scale: Scale::Linear } => max.abs_diff(*min) + 1,
        // Their values do not hold equal shares of the axis, or cannot be counted.
        Domain::Integer { scale: Scale::Log, .. } | Domain::Float { .. } => 0,
    };
    let few = |count: u64| if (2..=LEVELS_MAX).contains(&count) { count as u32 } else { 0 };
    space.parameters().iter().map(|parameter| few(count(&parameter.domain))).collect()
}
