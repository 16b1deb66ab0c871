//! Numbers as the wire has them.

/// Counts and ids never come near the end of the range.
pub(super) fn signed(number: u64) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}
