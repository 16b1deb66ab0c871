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
}
