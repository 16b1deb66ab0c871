//! Points in time.

use prost_types::Timestamp;

/// Milliseconds since 1970 as a timestamp of the wire.
pub fn timestamp_to_wire(ms: i64) -> Timestamp {
    // Below 10^9.
    Timestamp { seconds: ms.div_euclid(1000), nanos: (ms.rem_euclid(1000) * 1_000_000) as i32 }
}

/// Milliseconds since 1970, rounded down. Times that do not fit become the nearest that do.
pub fn timestamp_from_wire(wire: Timestamp) -> i64 {
    wire.seconds.saturating_mul(1000).saturating_add(i64::from(wire.nanos).div_euclid(1_000_000))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_come_back() {
        for ms in [0, 1, -1, 999, -1001, 1_750_000_000_123] {
            assert_eq!(timestamp_from_wire(timestamp_to_wire(ms)), ms);
        }
        assert_eq!(timestamp_from_wire(Timestamp { seconds: i64::MAX, nanos: -1 }), i64::MAX - 1);
    }
}
