//! Vectors of AVX2 and fused multiply-add: comparisons give vectors.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

use std::arch::x86_64::*;

use super::x86::{arithmetic_128, arithmetic_256, memory_64, memory_128, memory_256};
use super::{Lanes, Order, Pair};

/// Comparisons by vectors, gathered into bits at the end.
macro_rules! comparisons {
    ($vector:ident $compare:ident $and:ident $or:ident $movemask:ident, $used:literal) => {
        type Mask = $vector;

        #[inline(always)]
        unsafe fn less(self, other: Self) -> Self::Mask {
            $compare::<_CMP_LT_OQ>(self.0, other.0)
        }

        #[inline(always)]
        unsafe fn less_equal(self, other: Self) -> Self::Mask {
            $compare::<_CMP_LE_OQ>(self.0, other.0)
        }

        #[inline(always)]
        unsafe fn equal(self, other: Self) -> Self::Mask {
            $compare::<_CMP_EQ_OQ>(self.0, other.0)
        }

        #[inline(always)]
        unsafe fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask {
            $and(a, b)
        }

        #[inline(always)]
        unsafe fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask {
            $or(a, b)
        }

        #[inline(always)]
        unsafe fn bits(mask: Self::Mask) -> u32 {
            $movemask(mask) as u32 & $used
        }
    };
}

/// Two lanes.
#[derive(Clone, Copy)]
pub(crate) struct Two(__m128);

impl Lanes for Two {
    const COUNT: usize = 2;
    arithmetic_128!();
    memory_64!();
    comparisons!(__m128 _mm_cmp_ps _mm_and_ps _mm_or_ps _mm_movemask_ps, 0b11);
}

/// Four lanes.
#[derive(Clone, Copy)]
pub(crate) struct Four(__m128);

impl Lanes for Four {
    const COUNT: usize = 4;
    arithmetic_128!();
    memory_128!();
    comparisons!(__m128 _mm_cmp_ps _mm_and_ps _mm_or_ps _mm_movemask_ps, 0b1111);
}

/// Eight lanes.
#[derive(Clone, Copy)]
pub(crate) struct Eight(__m256);

impl Lanes for Eight {
    const COUNT: usize = 8;
    arithmetic_256!();
    memory_256!();
    comparisons!(__m256 _mm256_cmp_ps _mm256_and_ps _mm256_or_ps _mm256_movemask_ps, 0xff);
}

/// Sixteen lanes in two vectors.
pub(crate) type Sixteen = Pair<Eight>;

impl Order for Two {}
impl Order for Four {}
impl Order for Eight {}
