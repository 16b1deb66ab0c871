//! Vectors of AVX-512 at 128, 256 and 512 bits: comparisons give bits at once.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

use std::arch::x86_64::*;

use super::Lanes;
use super::x86::{
    arithmetic_128, arithmetic_256, arithmetic_512, memory_64, memory_128, memory_256, memory_512,
};

/// Comparisons straight into mask registers.
macro_rules! comparisons {
    ($compare:ident $blend:ident, $mask:ident, $used:literal) => {
        type Mask = $mask;

        #[inline(always)]
        unsafe fn less(self, other: Self) -> $mask {
            $compare::<_CMP_LT_OQ>(self.0, other.0)
        }

        #[inline(always)]
        unsafe fn less_equal(self, other: Self) -> $mask {
            $compare::<_CMP_LE_OQ>(self.0, other.0)
        }

        #[inline(always)]
        unsafe fn equal(self, other: Self) -> $mask {
            $compare::<_CMP_EQ_OQ>(self.0, other.0)
        }

        #[inline(always)]
        unsafe fn and(a: $mask, b: $mask) -> $mask {
            a & b
        }

        #[inline(always)]
        unsafe fn or(a: $mask, b: $mask) -> $mask {
            a | b
        }

        #[inline(always)]
        unsafe fn choose(bits: u32, yes: Self, no: Self) -> Self {
            Self($blend(bits as $mask, no.0, yes.0))
        }

        #[inline(always)]
        unsafe fn bits(mask: $mask) -> u32 {
            u32::from(mask) & $used
        }
    };
}

/// Two lanes.
#[derive(Clone, Copy)]
pub(crate) struct Two(pub(super) __m128);

impl Lanes for Two {
    const COUNT: usize = 2;
    arithmetic_128!();
    memory_64!();
    comparisons!(_mm_cmp_ps_mask _mm_mask_blend_ps, u8, 0b11);
}

/// Four lanes.
#[derive(Clone, Copy)]
pub(crate) struct Four(pub(super) __m128);

impl Lanes for Four {
    const COUNT: usize = 4;
    arithmetic_128!();
    memory_128!();
    comparisons!(_mm_cmp_ps_mask _mm_mask_blend_ps, u8, 0b1111);
}

/// Eight lanes.
#[derive(Clone, Copy)]
pub(crate) struct Eight(pub(super) __m256);

impl Lanes for Eight {
    const COUNT: usize = 8;
    arithmetic_256!();
    memory_256!();
    comparisons!(_mm256_cmp_ps_mask _mm256_mask_blend_ps, u8, 0xff);
}

/// Sixteen lanes.
#[derive(Clone, Copy)]
pub(crate) struct Sixteen(pub(super) __m512);

impl Lanes for Sixteen {
    const COUNT: usize = 16;
    arithmetic_512!();
    memory_512!();
    comparisons!(_mm512_cmp_ps_mask _mm512_mask_blend_ps, u16, 0xffff);
}
