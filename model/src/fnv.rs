//! The FNV-1a hash (Fowler, Noll and Vo): a number for bytes that does not change with the release or the
//! machine, unlike that of the standard library's hasher. It guards against mistakes, not against attackers.

/// The hash of no bytes.
pub const EMPTY: u64 = 0xcbf2_9ce4_8422_2325;

/// Adds one byte to a hash (or a whole word, where bytes would be too slow).
pub fn add(hash: u64, byte: u64) -> u64 {
    (hash ^ byte).wrapping_mul(0x0000_0100_0000_01b3)
}

/// The hash of bytes.
pub fn hash(bytes: impl IntoIterator<Item = u8>) -> u64 {
    bytes.into_iter().fold(EMPTY, |hash, byte| add(hash, u64::from(byte)))
}

#[cfg(test)]
mod tests {
    use super::hash;

    #[test]
    fn it_matches_the_published_vectors() {
        assert_eq!(hash("".bytes()), 0xcbf2_9ce4_8422_2325);
        assert_eq!(hash("a".bytes()), 0xaf63_dc4c_8601_ec8c);
        assert_eq!(hash("foobar".bytes()), 0x8594_4171_f739_67e8);
    }
}
