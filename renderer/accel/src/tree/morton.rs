//! Triangles along a curve that fills space: their boxes, and their numbers in the order of Morton codes.
//!
//! The code of a triangle is that of its box's centre on a grid of 2048 cells an axis (Lauterbach et al., "Fast BVH
//! Construction on GPUs", 2009). Codes stand before numbers in one word, which are sorted by radix, least digit
//! first, all threads together.

use std::sync::atomic::{AtomicU64, Ordering};

use rayon::prelude::*;

use crate::geometry::Triangles;
use crate::layout::Bounds;
use crate::limits::TRIANGLES_MAX;
use crate::memory::wish_for_huge_pages;

/// Bits of a triangle's number.
const NUMBER_BITS: u32 = TRIANGLES_MAX.ilog2();

/// Bits of a digit of the sort.
const DIGIT_BITS: u32 = 11;

/// Digits of a code: as many as axes, so that a grid has as many cells an axis as a digit values.
const DIGITS: u32 = 3;

const DIGIT_VALUES: usize = 1 << DIGIT_BITS;

const _: () = assert!(NUMBER_BITS + DIGITS * DIGIT_BITS <= u64::BITS && TRIANGLES_MAX.is_power_of_two());

/// Fewer keys than this are sorted by comparison.
const RADIX_MIN: usize = 16_384;

/// Fewest triangles that are worth a task of their own.
const TRIANGLES_PER_TASK: usize = 8_192;

/// A code and behind it the number of a triangle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(transparent)]
pub(super) struct Key(u64);

impl Key {
    fn new(code: u64, number: usize) -> Self {
        Self(code << NUMBER_BITS | number as u64)
    }

    pub(super) fn number(self) -> u32 {
        (self.0 & ((1 << NUMBER_BITS) - 1)) as u32
    }

    /// Where sorted keys part: at the first with the highest bit in which codes differ, or in the middle if none does.
    /// There are two or more.
    pub(super) fn middle(keys: &[Self]) -> usize {
        let (first, last) = (keys[0].0 >> NUMBER_BITS, keys[keys.len() - 1].0 >> NUMBER_BITS);
        if first == last {
            return keys.len() / 2;
        }
        let highest = 1 << (NUMBER_BITS + (first ^ last).ilog2());
        keys.partition_point(|key| key.0 & highest == 0)
    }
}

/// Box of every triangle.
pub(super) fn boxes(triangles: &Triangles) -> Vec<Bounds> {
    let mut boxes = Vec::with_capacity(triangles.len());
    wish_for_huge_pages(&boxes);
    (0..triangles.len())
        .into_par_iter()
        .with_min_len(TRIANGLES_PER_TASK)
        .map(|triangle| Bounds::of_corners(&triangles.corners(triangle)))
        .collect_into_vec(&mut boxes);
    boxes
}

/// The boxes' keys in ascending order.
pub(super) fn sorted(boxes: &[Bounds]) -> Vec<Key> {
    let center = |bounds: &Bounds| [0, 1, 2].map(|axis| bounds.lower[axis] * 0.5 + bounds.upper[axis] * 0.5);
    let nothing = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    let (lower, upper) = boxes
        .par_chunks(TRIANGLES_PER_TASK)
        .map(|some| {
            some.iter().fold(nothing, |(mut lower, mut upper), bounds| {
                for (axis, at) in center(bounds).into_iter().enumerate() {
                    lower[axis] = if at < lower[axis] { at } else { lower[axis] };
                    upper[axis] = if at > upper[axis] { at } else { upper[axis] };
                }
                (lower, upper)
            })
        })
        .reduce(
            || nothing,
            |a, b| {
                let join = |axis: usize| (a.0[axis].min(b.0[axis]), a.1[axis].max(b.1[axis]));
                let [x, y, z] = [join(0), join(1), join(2)];
                ([x.0, y.0, z.0], [x.1, y.1, z.1])
            },
        );
    // Cells are cubes, so that no axis is preferred.
    let extent = (0..3).map(|axis| upper[axis] - lower[axis]).fold(0.0, f32::max);
    let scale = if extent > 0.0 { DIGIT_VALUES as f32 * 0.9999 / extent } else { 0.0 };
    let scale = if scale.is_finite() { scale } else { 0.0 };
    let code = |bounds: &Bounds| {
        let at = center(bounds);
        let cell =
            |axis: usize| spread((((at[axis] - lower[axis]) * scale) as u64).min(DIGIT_VALUES as u64 - 1));
        cell(0) << 2 | cell(1) << 1 | cell(2)
    };
    let keys = boxes.par_iter().enumerate().with_min_len(TRIANGLES_PER_TASK);
    let keys = keys.map(|(number, bounds)| Key::new(code(bounds), number));
    if boxes.len() < RADIX_MIN {
        let mut keys: Vec<Key> = keys.collect();
        keys.sort_unstable();
        return keys;
    }
    let mut loose: Vec<AtomicU64> = Vec::with_capacity(boxes.len());
    wish_for_huge_pages(&loose);
    keys.map(|key| AtomicU64::new(key.0)).collect_into_vec(&mut loose);
    sort(loose)
}

/// Every third bit of the result is one of the eleven lowest of `value`.
fn spread(value: u64) -> u64 {
    let value = (value | value << 16) & 0x0700_00ff;
    let value = (value | value << 8) & 0x0700_f00f;
    let value = (value | value << 4) & 0x430c_30c3;
    (value | value << 2) & 0x4924_9249
}

/// Sorts by code. Threads write to places of their own, which the type need not know: relaxed stores cost what plain
/// ones do.
fn sort(mut from: Vec<AtomicU64>) -> Vec<Key> {
    let mut to: Vec<AtomicU64> = Vec::with_capacity(from.len());
    wish_for_huge_pages(&to);
    (0..from.len())
        .into_par_iter()
        .with_min_len(TRIANGLES_PER_TASK)
        .map(|_| AtomicU64::new(0))
        .collect_into_vec(&mut to);
    let chunk = from.len().div_ceil(rayon::current_num_threads());
    for digit in 0..DIGITS {
        let shift = NUMBER_BITS + digit * DIGIT_BITS;
        let value = |key: u64| (key >> shift) as usize % DIGIT_VALUES;
        let mut places: Vec<Vec<u32>> = from
            .par_chunks(chunk)
            .map(|keys| {
                let mut counts = vec![0; DIGIT_VALUES];
                keys.iter().for_each(|key| counts[value(key.load(Ordering::Relaxed))] += 1);
                counts
            })
            .collect();
        let mut next = 0;
        for value in 0..DIGIT_VALUES {
            for of_chunk in &mut places {
                let count = of_chunk[value];
                of_chunk[value] = next;
                next += count;
            }
        }
        from.par_chunks(chunk).zip(&mut places).for_each(|(keys, places)| {
            for key in keys {
                let key = key.load(Ordering::Relaxed);
                let place = &mut places[value(key)];
                to[*place as usize].store(key, Ordering::Relaxed);
                *place += 1;
            }
        });
        std::mem::swap(&mut from, &mut to);
    }
    from.into_iter().map(|key| Key(key.into_inner())).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn interleaved(value: u64) -> u64 {
        (0..11).map(|bit| (value >> bit & 1) << (3 * bit)).sum()
    }

    #[test]
    fn bits_are_spread_to_every_third_place() {
        for value in 0..DIGIT_VALUES as u64 {
            assert_eq!(spread(value), interleaved(value), "{value}");
        }
    }

    #[test]
    fn many_keys_are_sorted_as_few_are() {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            (state >> 40) as f32 / 1e4
        };
        let boxes: Vec<Bounds> = (0..3 * RADIX_MIN)
            .map(|_| {
                let lower = [random(), random(), random()];
                Bounds { lower, upper: lower.map(|at| at + 1.0) }
            })
            .collect();
        let keys = sorted(&boxes);
        assert!(keys.is_sorted_by_key(|key| key.0 >> NUMBER_BITS));
        let mut numbers: Vec<u32> = keys.iter().map(|key| key.number()).collect();
        numbers.sort_unstable();
        assert!(numbers.into_iter().eq(0..boxes.len() as u32));
    }

    proptest! {
        #[test]
        fn keys_part_where_codes_do(mut codes in prop::collection::vec(0u64..1 << 33, 2..40)) {
            codes.sort_unstable();
            let keys: Vec<Key> = codes.iter().enumerate().map(|(number, &code)| Key::new(code, number)).collect();
            let middle = Key::middle(&keys);
            prop_assert!(0 < middle && middle < keys.len());
            if codes[0] != codes[codes.len() - 1] {
                let common = |a: u64, b: u64| (a ^ b).leading_zeros();
                let across = common(codes[middle - 1], codes[middle]);
                prop_assert!(common(codes[0], codes[middle - 1]) > across);
                prop_assert!(common(codes[middle], codes[codes.len() - 1]) > across);
            }
        }
    }
}
