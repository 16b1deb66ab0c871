//! Morton's curve: neighbours in space become neighbours in order.

/// Spreads the low 16 bits so that a zero lies between each two.
#[inline(always)]
fn spread_2(mut bits: u32) -> u32 {
    bits &= 0xffff;
    bits = (bits | bits << 8) & 0x00ff_00ff;
    bits = (bits | bits << 4) & 0x0f0f_0f0f;
    bits = (bits | bits << 2) & 0x3333_3333;
    (bits | bits << 1) & 0x5555_5555
}

/// Collects every other bit.
#[inline(always)]
fn collect_2(mut bits: u32) -> u32 {
    bits &= 0x5555_5555;
    bits = (bits | bits >> 1) & 0x3333_3333;
    bits = (bits | bits >> 2) & 0x0f0f_0f0f;
    bits = (bits | bits >> 4) & 0x00ff_00ff;
    (bits | bits >> 8) & 0xffff
}

/// Place of (x, y), both below 2¹⁶, on the curve.
#[inline(always)]
pub(crate) fn encode_2(x: u32, y: u32) -> u32 {
    spread_2(x) | spread_2(y) << 1
}

/// The (x, y) of a place on the curve.
#[inline(always)]
pub(crate) fn decode_2(place: u32) -> (u32, u32) {
    (collect_2(place), collect_2(place >> 1))
}

/// Spreads the low 5 bits so that two zeros lie between each two.
#[inline(always)]
fn spread_3(mut bits: u32) -> u32 {
    bits &= 0x1f;
    bits = (bits | bits << 8) & 0x100f;
    bits = (bits | bits << 4) & 0x10c3;
    (bits | bits << 2) & 0x1249
}

/// Place of (x, y, z), each below 32, on the curve: below 2¹⁵.
#[inline(always)]
pub(crate) fn encode_3(x: u32, y: u32, z: u32) -> u32 {
    spread_3(x) | spread_3(y) << 1 | spread_3(z) << 2
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_and_coordinates_belong_together() {
        for place in (0..1 << 12).chain([u32::MAX, u32::MAX - 5, 0x8000_0001]) {
            let (x, y) = decode_2(place);
            assert_eq!(encode_2(x, y), place);
        }
        assert_eq!((0..4).map(decode_2).collect::<Vec<_>>(), [(0, 0), (1, 0), (0, 1), (1, 1)]);
    }

    #[test]
    fn bits_of_three_coordinates_take_turns() {
        for bit in 0..5 {
            let one = 1 << bit;
            assert_eq!(encode_3(one, 0, 0), 1 << (3 * bit));
            assert_eq!(encode_3(0, one, 0), 2 << (3 * bit));
            assert_eq!(encode_3(0, 0, one), 4 << (3 * bit));
        }
        assert_eq!(encode_3(31, 31, 31), (1 << 15) - 1);
    }
}
