//! The order of children in registers: compressed to the front, sorted by a network, no branch but on their
//! number.
//!
//! Embree's traversal for AVX-512 showed that this pays; networks after Knuth, "The Art of Computer
//! Programming" 3, section 5.3.4.

use std::arch::x86_64::*;

use super::avx512::{Eight, Four, Sixteen, Two};
use super::order::Order;
use crate::layout::NodeRef;

/// Four keys, largest first, in three steps.
#[inline(always)]
unsafe fn sort_four(keys: __m128i) -> __m128i {
    let swapped = _mm_shuffle_epi32::<0b10_11_00_01>(keys);
    let keys = _mm_mask_min_epi32(_mm_max_epi32(keys, swapped), 0b1010, keys, swapped);
    let swapped = _mm_shuffle_epi32::<0b01_00_11_10>(keys);
    let keys = _mm_mask_min_epi32(_mm_max_epi32(keys, swapped), 0b1100, keys, swapped);
    let swapped = _mm_shuffle_epi32::<0b11_01_10_00>(keys);
    _mm_mask_min_epi32(_mm_max_epi32(keys, swapped), 0b0100, keys, swapped)
}

/// One step of a network of eight: each lane meets its partner and keeps the larger, or the smaller.
#[inline(always)]
unsafe fn step_eight(keys: __m256i, partners: [i32; 8], small: u8) -> __m256i {
    let [a, b, c, d, e, f, g, h] = partners;
    let met = _mm256_permutexvar_epi32(_mm256_setr_epi32(a, b, c, d, e, f, g, h), keys);
    _mm256_mask_min_epi32(_mm256_max_epi32(keys, met), small, keys, met)
}

/// Eight keys, largest first, in six steps.
#[inline(always)]
unsafe fn sort_eight(keys: __m256i) -> __m256i {
    let keys = step_eight(keys, [1, 0, 3, 2, 5, 4, 7, 6], 0b1010_1010);
    let keys = step_eight(keys, [2, 3, 0, 1, 6, 7, 4, 5], 0b1100_1100);
    let keys = step_eight(keys, [0, 2, 1, 3, 4, 6, 5, 7], 0b0100_0100);
    let keys = step_eight(keys, [4, 5, 6, 7, 0, 1, 2, 3], 0b1111_0000);
    let keys = step_eight(keys, [0, 1, 4, 5, 2, 3, 6, 7], 0b0011_0000);
    step_eight(keys, [0, 2, 1, 4, 3, 6, 5, 7], 0b0101_0100)
}

/// Smaller than every key: goes to the end.
const NONE: i32 = -1;

impl Order for Two {}

impl Order for Four {
    #[inline(always)]
    unsafe fn write_sorted(self, hits: u32, children: *const NodeRef, nodes: *mut NodeRef, keys: *mut i32) {
        let lanes = _mm_setr_epi32(0, 1, 2, 3);
        let all = _mm_or_si128(_mm_andnot_si128(_mm_set1_epi32(3), _mm_castps_si128(self.0)), lanes);
        let sorted = sort_four(_mm_mask_blend_epi32(hits as u8, _mm_set1_epi32(NONE), all));
        _mm_storeu_si128(keys.cast(), sorted);
        let children = _mm256_load_si256(children.cast());
        let picked = _mm256_permutexvar_epi64(_mm256_cvtepu32_epi64(sorted), children);
        _mm256_storeu_si256(nodes.cast(), picked);
    }

    #[inline(always)]
    unsafe fn write_met(hits: u32, children: *const NodeRef, nodes: *mut NodeRef) {
        let met = _mm256_maskz_compress_epi64(hits as u8, _mm256_load_si256(children.cast()));
        _mm256_storeu_si256(nodes.cast(), met);
    }
}

impl Order for Eight {
    #[inline(always)]
    unsafe fn write_sorted(self, hits: u32, children: *const NodeRef, nodes: *mut NodeRef, keys: *mut i32) {
        let lanes = _mm256_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7);
        let all =
            _mm256_or_si256(_mm256_andnot_si256(_mm256_set1_epi32(7), _mm256_castps_si256(self.0)), lanes);
        let met = _mm256_mask_compress_epi32(_mm256_set1_epi32(NONE), hits as u8, all);
        let children = _mm512_load_si512(children.cast());
        if hits.count_ones() <= 4 {
            let sorted = sort_four(_mm256_castsi256_si128(met));
            _mm_storeu_si128(keys.cast(), sorted);
            // A permutation heeds no more bits of an index than it needs.
            let index = _mm512_castsi256_si512(_mm256_cvtepu32_epi64(sorted));
            let picked = _mm512_castsi512_si256(_mm512_permutexvar_epi64(index, children));
            _mm256_storeu_si256(nodes.cast(), picked);
        } else {
            let sorted = sort_eight(met);
            _mm256_storeu_si256(keys.cast(), sorted);
            let picked = _mm512_permutexvar_epi64(_mm512_cvtepu32_epi64(sorted), children);
            _mm512_storeu_si512(nodes.cast(), picked);
        }
    }

    #[inline(always)]
    unsafe fn write_met(hits: u32, children: *const NodeRef, nodes: *mut NodeRef) {
        let met = _mm512_maskz_compress_epi64(hits as u8, _mm512_load_si512(children.cast()));
        _mm512_storeu_si512(nodes.cast(), met);
    }
}

impl Order for Sixteen {
    #[inline(always)]
    unsafe fn write_sorted(self, hits: u32, children: *const NodeRef, nodes: *mut NodeRef, keys: *mut i32) {
        let lanes = _mm512_setr_epi32(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15);
        let all =
            _mm512_or_si512(_mm512_andnot_si512(_mm512_set1_epi32(15), _mm512_castps_si512(self.0)), lanes);
        let met = _mm512_mask_compress_epi32(_mm512_set1_epi32(NONE), hits as u16, all);
        let (low, high) = (_mm512_load_si512(children.cast()), _mm512_load_si512(children.add(8).cast()));
        let pick = |index: __m512i| _mm512_permutex2var_epi64(low, index, high);
        let count = hits.count_ones();
        if count <= 4 {
            let sorted = sort_four(_mm512_castsi512_si128(met));
            _mm_storeu_si128(keys.cast(), sorted);
            let index = _mm512_castsi256_si512(_mm256_cvtepu32_epi64(sorted));
            _mm256_storeu_si256(nodes.cast(), _mm512_castsi512_si256(pick(index)));
            return;
        }
        let first = sort_eight(_mm512_castsi512_si256(met));
        if count <= 8 {
            _mm256_storeu_si256(keys.cast(), first);
            _mm512_storeu_si512(nodes.cast(), pick(_mm512_cvtepu32_epi64(first)));
            return;
        }
        // Two sorted halves, one turned round, are four steps from sorted (a bitonic merge).
        let second = sort_eight(_mm512_extracti64x4_epi64::<1>(met));
        let turned = _mm256_permutexvar_epi32(_mm256_setr_epi32(7, 6, 5, 4, 3, 2, 1, 0), second);
        let halves = [_mm256_max_epi32(first, turned), _mm256_min_epi32(first, turned)];
        for (half, keys_8) in halves.into_iter().enumerate() {
            let keys_8 = step_eight(keys_8, [4, 5, 6, 7, 0, 1, 2, 3], 0b1111_0000);
            let keys_8 = step_eight(keys_8, [2, 3, 0, 1, 6, 7, 4, 5], 0b1100_1100);
            let keys_8 = step_eight(keys_8, [1, 0, 3, 2, 5, 4, 7, 6], 0b1010_1010);
            _mm256_storeu_si256(keys.add(8 * half).cast(), keys_8);
            _mm512_storeu_si512(nodes.add(8 * half).cast(), pick(_mm512_cvtepu32_epi64(keys_8)));
        }
    }

    #[inline(always)]
    unsafe fn write_met(hits: u32, children: *const NodeRef, nodes: *mut NodeRef) {
        Eight::write_met(hits & 0xff, children, nodes);
        Eight::write_met(hits >> 8, children.add(8), nodes.add((hits & 0xff).count_ones() as usize));
    }
}
