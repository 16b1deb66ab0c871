//! Vectors of AVX2 and fused multiply-add: comparisons give vectors.

use std::arch::x86_64::*;

use super::x86::{arithmetic_128, arithmetic_256, memory, memory_64};
use super::{Lanes, Order, Pair};

/// Comparisons by vectors, gathered into bits at the end.
macro_rules! comparisons {
    ($vector:ident $compare:ident $and:ident $or:ident $movemask:ident, $used:literal, $set_lanes:expr, $set_whole:ident $and_whole:ident $equal:ident $cast:ident $blend:ident) => {
        type Mask = $vector;

        operations! {
            fn less(self, other: Self) -> Self::Mask { $compare::<_CMP_LT_OQ>(self.0, other.0) }
            fn less_equal(self, other: Self) -> Self::Mask { $compare::<_CMP_LE_OQ>(self.0, other.0) }
            fn equal(self, other: Self) -> Self::Mask { $compare::<_CMP_EQ_OQ>(self.0, other.0) }
            fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask { $and(a, b) }
            fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask { $or(a, b) }
            fn choose(bits: u32, yes: Self, no: Self) -> Self {
                // Each lane looks at its own bit.
                let of_lanes = $set_lanes;
                let set = $equal($and_whole($set_whole(bits as i32), of_lanes), of_lanes);
                Self($blend(no.0, yes.0, $cast(set)))
            }
            fn bits(mask: Self::Mask) -> u32 { $movemask(mask) as u32 & $used }
        }
    };
}

#[derive(Clone, Copy)]
pub(crate) struct Two(__m128);

impl Lanes for Two {
    const COUNT: usize = 2;
    arithmetic_128!();
    memory_64!();
    comparisons!(__m128 _mm_cmp_ps _mm_and_ps _mm_or_ps _mm_movemask_ps, 0b11, _mm_setr_epi32(1, 2, 4, 8), _mm_set1_epi32 _mm_and_si128 _mm_cmpeq_epi32 _mm_castsi128_ps _mm_blendv_ps);
}

#[derive(Clone, Copy)]
pub(crate) struct Four(__m128);

impl Lanes for Four {
    const COUNT: usize = 4;
    arithmetic_128!();
    memory!(_mm_load_ps _mm_store_ps);
    comparisons!(__m128 _mm_cmp_ps _mm_and_ps _mm_or_ps _mm_movemask_ps, 0b1111, _mm_setr_epi32(1, 2, 4, 8), _mm_set1_epi32 _mm_and_si128 _mm_cmpeq_epi32 _mm_castsi128_ps _mm_blendv_ps);
}

#[derive(Clone, Copy)]
pub(crate) struct Eight(__m256);

impl Lanes for Eight {
    const COUNT: usize = 8;
    arithmetic_256!();
    memory!(_mm256_load_ps _mm256_store_ps);
    comparisons!(__m256 _mm256_cmp_ps _mm256_and_ps _mm256_or_ps _mm256_movemask_ps, 0xff, _mm256_setr_epi32(1, 2, 4, 8, 16, 32, 64, 128), _mm256_set1_epi32 _mm256_and_si256 _mm256_cmpeq_epi32 _mm256_castsi256_ps _mm256_blendv_ps);
}

/// Sixteen lanes in two vectors.
pub(crate) type Sixteen = Pair<Eight>;

impl Order for Two {}
impl Order for Four {}
impl Order for Eight {}
