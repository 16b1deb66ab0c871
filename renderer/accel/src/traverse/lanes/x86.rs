//! The common part of AVX2 and AVX-512 vectors: everything but comparisons.

/// Implements the arithmetic of [`super::Lanes`] for a wrapper of an x86 vector, given its intrinsics.
macro_rules! arithmetic {
    ($splat:ident $add:ident $sub:ident $mul:ident $div:ident $fmadd:ident $fmsub:ident $min:ident $max:ident $and:ident $andnot:ident $xor:ident) => {
        operations! {
            fn splat(value: f32) -> Self { Self($splat(value)) }
            fn add(self, other: Self) -> Self { Self($add(self.0, other.0)) }
            fn sub(self, other: Self) -> Self { Self($sub(self.0, other.0)) }
            fn mul(self, other: Self) -> Self { Self($mul(self.0, other.0)) }
            fn div(self, other: Self) -> Self { Self($div(self.0, other.0)) }
            fn mul_add(self, factor: Self, more: Self) -> Self { Self($fmadd(self.0, factor.0, more.0)) }
            fn mul_sub(self, factor: Self, less: Self) -> Self { Self($fmsub(self.0, factor.0, less.0)) }
            fn min(self, other: Self) -> Self { Self($min(self.0, other.0)) }
            fn max(self, other: Self) -> Self { Self($max(self.0, other.0)) }
            fn abs(self) -> Self { Self($andnot($splat(-0.0), self.0)) }
            fn flip_sign(self, by: Self) -> Self { Self($xor(self.0, $and(by.0, $splat(-0.0)))) }
        }
    };
}

/// [`arithmetic`] of four lanes; two lanes use the lower half of these registers.
macro_rules! arithmetic_128 {
    () => {
        $crate::traverse::lanes::x86::arithmetic!(_mm_set1_ps _mm_add_ps _mm_sub_ps _mm_mul_ps _mm_div_ps _mm_fmadd_ps _mm_fmsub_ps _mm_min_ps _mm_max_ps _mm_and_ps _mm_andnot_ps _mm_xor_ps);
    };
}

/// [`arithmetic`] of eight lanes.
macro_rules! arithmetic_256 {
    () => {
        $crate::traverse::lanes::x86::arithmetic!(_mm256_set1_ps _mm256_add_ps _mm256_sub_ps _mm256_mul_ps _mm256_div_ps _mm256_fmadd_ps _mm256_fmsub_ps _mm256_min_ps _mm256_max_ps _mm256_and_ps _mm256_andnot_ps _mm256_xor_ps);
    };
}

/// [`arithmetic`] of sixteen lanes. Bitwise operations on 512 bits of numbers need AVX-512DQ.
macro_rules! arithmetic_512 {
    () => {
        $crate::traverse::lanes::x86::arithmetic!(_mm512_set1_ps _mm512_add_ps _mm512_sub_ps _mm512_mul_ps _mm512_div_ps _mm512_fmadd_ps _mm512_fmsub_ps _mm512_min_ps _mm512_max_ps _mm512_and_ps _mm512_andnot_ps _mm512_xor_ps);
    };
}

/// Loads and stores of the lower two lanes.
macro_rules! memory_64 {
    () => {
        operations! {
            fn load(from: *const f32) -> Self { Self(_mm_castpd_ps(_mm_load_sd(from.cast()))) }
            fn store(self, to: *mut f32) { _mm_store_sd(to.cast(), _mm_castps_pd(self.0)) }
        }
    };
}

/// Loads and stores of whole vectors.
macro_rules! memory {
    ($load:ident $store:ident) => {
        operations! {
            fn load(from: *const f32) -> Self { Self($load(from)) }
            fn store(self, to: *mut f32) { $store(to, self.0) }
        }
    };
}

pub(super) use {arithmetic, arithmetic_128, arithmetic_256, arithmetic_512, memory, memory_64};
