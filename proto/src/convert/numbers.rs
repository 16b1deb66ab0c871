//! Counts and ids: the wire has them signed, since some languages know no others.

/// As the wire has it. None comes near the end of the range.
#[must_use]
pub fn signed(count: u64) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}

/// As the model has it; 0 for what no count can be.
#[must_use]
pub fn unsigned(count: i64) -> u64 {
    u64::try_from(count).unwrap_or(0)
}
