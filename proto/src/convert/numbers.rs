//! Counts and ids: they are signed on the wire, because some languages have no unsigned integers.

/// A count for the wire. No count comes near the end of the range.
pub fn signed(count: u64) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}

/// A count from the wire; 0 for a negative number.
pub fn unsigned(count: i64) -> u64 {
    u64::try_from(count).unwrap_or(0)
}
