//! Values as few bytes: MessagePack with the names of fields, so that a field may be added later, and over it
//! LZ4 ("LZ4 block format description", Collet), which takes the repeated names out again. Every double comes
//! back bit for bit.

use serde::Serialize;
use serde::de::DeserializeOwned;
use thiserror::Error;

use crate::limits::UNPACKED_BYTES_MAX;

/// Why bytes cannot be unpacked.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("packed data cannot be read: {0}")]
pub struct PackedError(pub(crate) String);

pub(crate) fn pack<T: Serialize>(value: &T) -> Vec<u8> {
    let bytes = rmp_serde::to_vec_named(value).expect("plain data in memory can always be written");
    lz4_flex::compress_prepend_size(&bytes)
}

/// Packs plain data by the order of its fields: quicker, for data that need not outlive a version. Data of
/// more than `most` bytes are an error, which holds their number: beyond [`UNPACKED_BYTES_MAX`] nobody could
/// read them.
pub(crate) fn pack_in_order<T: Serialize>(value: &T, most: usize) -> Result<Vec<u8>, usize> {
    let bytes = rmp_serde::to_vec(value).expect("plain data in memory can always be written");
    if bytes.len() > most { Err(bytes.len()) } else { Ok(lz4_flex::compress_prepend_size(&bytes)) }
}

/// Reads the bytes that [`pack`] or [`pack_in_order`] wrote.
pub(crate) fn unpack<T: DeserializeOwned>(bytes: &[u8]) -> Result<T, PackedError> {
    let (size, packed) =
        lz4_flex::block::uncompressed_size(bytes).map_err(|error| PackedError(error.to_string()))?;
    if size > UNPACKED_BYTES_MAX {
        return Err(PackedError(format!("{size} bytes are more than {UNPACKED_BYTES_MAX}")));
    }
    let bytes = lz4_flex::decompress(packed, size).map_err(|error| PackedError(error.to_string()))?;
    // A concrete reader is compiled only once, not once for every type of a value.
    let mut reader = rmp_serde::Deserializer::from_read_ref(&bytes[..]);
    erased_serde::deserialize(&mut <dyn erased_serde::Deserializer<'_>>::erase(&mut reader))
        .map_err(|error| PackedError(error.to_string()))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #![proptest_config(crate::testing::cases(64))]

        #[test]
        fn what_is_packed_comes_back_bit_for_bit(
            bits in prop::collection::vec(any::<u64>(), 0..200),
            names in prop::collection::btree_map("[a-z]{0,9}", any::<i64>(), 0..20),
        ) {
            let floats: Vec<f64> = bits.iter().map(|&bits| f64::from_bits(bits)).collect();
            let packed = pack(&(&floats, &names));
            let (back, named): (Vec<f64>, BTreeMap<String, i64>) = unpack(&packed).expect("own bytes");
            let back: Vec<u64> = back.iter().map(|float| float.to_bits()).collect();
            // A signalling NaN may become a quiet one; no cost is one.
            let same = back.iter().zip(&bits).all(|(a, b)| a == b || f64::from_bits(*b).is_nan());
            prop_assert!(same && back.len() == bits.len());
            prop_assert_eq!(named, names);
        }

        #[test]
        fn damaged_bytes_are_an_error_or_another_value_and_never_a_panic(
            bytes in prop::collection::vec(any::<u8>(), 0..64), place in 0usize..40, with: u8,
        ) {
            let _ = unpack::<Vec<f64>>(&bytes);
            let mut packed = pack(&vec![1.5f64; 20]);
            let place = place % packed.len();
            packed[place] = with;
            let _ = unpack::<Vec<f64>>(&packed);
        }
    }

    #[test]
    fn a_size_beyond_the_limit_is_refused_before_anything_is_allocated() {
        let mut packed = pack(&1u8);
        packed[..4].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(unpack::<u8>(&packed).is_err());
    }
}
