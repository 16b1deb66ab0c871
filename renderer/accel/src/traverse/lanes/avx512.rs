//! Vectors of AVX-512 at 128, 256 and 512 bits: comparisons give bits at once.

use std::arch::x86_64::*;

use super::Lanes;
use super::x86::{arithmetic_128, arithmetic_256, arithmetic_512, memory, memory_64};

/// Comparisons straight into mask registers.
macro_rules! comparisons {
    ($compare:ident $blend:ident, $mask:ident, $used:literal) => {
        type Mask = $mask;

        operations! {
            fn less(self, other: Self) -> $mask { $compare::<_CMP_LT_OQ>(self.0, other.0) }
            fn less_equal(self, other: Self) -> $mask { $compare::<_CMP_LE_OQ>(self.0, other.0) }
            fn equal(self, other: Self) -> $mask { $compare::<_CMP_EQ_OQ>(self.0, other.0) }
            fn and(a: $mask, b: $mask) -> $mask { a & b }
            fn or(a: $mask, b: $mask) -> $mask { a | b }
            fn choose(bits: u32, yes: Self, no: Self) -> Self { Self($blend(bits as $mask, no.0, yes.0)) }
            fn bits(mask: $mask) -> u32 { u32::from(mask) & $used }
        }
    };
}

#[derive(Clone, Copy)]
pub(crate) struct Two(pub(super) __m128);

impl Lanes for Two {
    const COUNT: usize = 2;
    arithmetic_128!();
    memory_64!();
    comparisons!(_mm_cmp_ps_mask _mm_mask_blend_ps, u8, 0b11);
}

#[derive(Clone, Copy)]
pub(crate) struct Four(pub(super) __m128);

impl Lanes for Four {
    const COUNT: usize = 4;
    arithmetic_128!();
    memory!(_mm_load_ps _mm_store_ps);
    comparisons!(_mm_cmp_ps_mask _mm_mask_blend_ps, u8, 0b1111);
}

#[derive(Clone, Copy)]
pub(crate) struct Eight(pub(super) __m256);

impl Lanes for Eight {
    const COUNT: usize = 8;
    arithmetic_256!();
    memory!(_mm256_load_ps _mm256_store_ps);
    comparisons!(_mm256_cmp_ps_mask _mm256_mask_blend_ps, u8, 0xff);
}

#[derive(Clone, Copy)]
pub(crate) struct Sixteen(pub(super) __m512);

impl Lanes for Sixteen {
    const COUNT: usize = 16;
    arithmetic_512!();
    memory!(_mm512_load_ps _mm512_store_ps);
    comparisons!(_mm512_cmp_ps_mask _mm512_mask_blend_ps, u16, 0xffff);
}
