//! Triangles along a curve that fills space: their boxes, and their numbers in the order of Morton codes.
//!
//! The code of a triangle is that of its box's centre on a grid of 2048 cells an axis (Lauterbach et al.,
//! "Fast BVH Construction on GPUs", 2009). Codes stand before numbers in one word. All threads together first
//! part these words by the highest eleven bits of the code. Then each part is sorted by one thread, mostly in
//! its own cache (radix sort from the most significant digit, with one digit: Knuth, The Art of Computer
//! Programming 3, 5.2.5).

use glam::Vec3A;
use rayon::prelude::*;

use crate::{geometry::Triangles, layout::Bounds, limits::TRIANGLES_MAX, memory::wish_for_huge_pages};

const NUMBER_BITS: u32 = TRIANGLES_MAX.ilog2();
/// Bits of the digit by which keys are parted.
const DIGIT_BITS: u32 = 11;
/// Bits of a code: a digit for each axis.
const CODE_BITS: u32 = 3 * DIGIT_BITS;
const DIGIT_VALUES: usize = 1 << DIGIT_BITS;
const _: () = assert!(NUMBER_BITS + CODE_BITS <= u64::BITS && TRIANGLES_MAX.is_power_of_two());
/// Fewer keys than this are sorted by comparison, more by counting digits.
const COUNTED_MIN: usize = 1_024;
/// Least number of keys that all threads part together.
const SHARED_MIN: usize = 65_536;
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

    /// Where two or more sorted keys part: at the highest bit in which codes differ, or in the middle.
    pub(super) fn middle(keys: &[Self]) -> usize {
        let (first, last) = (keys[0].0 >> NUMBER_BITS, keys[keys.len() - 1].0 >> NUMBER_BITS);
        if first == last {
            return keys.len() / 2;
        }
        let highest = 1 << (NUMBER_BITS + (first ^ last).ilog2());
        keys.partition_point(|key| key.0 & highest == 0)
    }
}

/// Every triangle's box, and the box around their centres.
pub(super) fn boxes(triangles: &Triangles) -> (Vec<Bounds>, Bounds) {
    let mut boxes = Vec::with_capacity(triangles.len());
    wish_for_huge_pages(&boxes);
    let places = &mut boxes.spare_capacity_mut()[..triangles.len()];
    let nothing = (Vec3A::INFINITY, Vec3A::NEG_INFINITY);
    let (lower, upper) = places
        .par_chunks_mut(TRIANGLES_PER_TASK)
        .enumerate()
        .map(|(task, places)| {
            let first = task * TRIANGLES_PER_TASK;
            places.iter_mut().enumerate().fold(nothing, |(lower, upper), (place, of_triangle)| {
                let [a, b, c] = triangles.corners(first + place);
                let (least, most) = (a.min(b).min(c), a.max(b).max(c));
                of_triangle.write(Bounds { lower: least.to_array(), upper: most.to_array() });
                let center = least * 0.5 + most * 0.5;
                (lower.min(center), upper.max(center))
            })
        })
        .reduce(|| nothing, |a, b| (a.0.min(b.0), a.1.max(b.1)));
    // SAFETY: the tasks together have written all of them.
    unsafe { boxes.set_len(triangles.len()) };
    (boxes, Bounds { lower: lower.to_array(), upper: upper.to_array() })
}

/// The boxes' keys in ascending order; `around` is the box around their centres.
pub(super) fn sorted(boxes: &[Bounds], around: &Bounds) -> Vec<Key> {
    let (lower, upper) = (Vec3A::from_array(around.lower), Vec3A::from_array(around.upper));
    // Cells are cubes, so that no axis is preferred.
    let extent = (upper - lower).max_element();
    let scale = if extent > 0.0 { DIGIT_VALUES as f32 * 0.9999 / extent } else { 0.0 };
    let scale = if scale.is_finite() { scale } else { 0.0 };
    let key = |(number, bounds): (usize, &Bounds)| {
        let [x, y, z] = [0, 1, 2].map(|axis| {
            let center = bounds.lower[axis] * 0.5 + bounds.upper[axis] * 0.5;
            spread((((center - lower[axis]) * scale) as i32).clamp(0, DIGIT_VALUES as i32 - 1) as u32)
        });
        Key::new(u64::from(x) << 2 | u64::from(y) << 1 | u64::from(z), number)
    };
    let [mut keys, mut room] = [(); 2].map(|()| Vec::with_capacity(boxes.len()));
    wish_for_huge_pages(&keys);
    wish_for_huge_pages(&room);
    boxes.par_iter().enumerate().with_min_len(TRIANGLES_PER_TASK).map(key).collect_into_vec(&mut keys);
    let nothing = rayon::iter::repeat_n(Key(0), boxes.len()).with_min_len(TRIANGLES_PER_TASK);
    nothing.collect_into_vec(&mut room);
    sort(&mut keys, &mut room, CODE_BITS);
    keys
}

/// Every third bit of the result is one of the eleven lowest of `value`.
fn spread(value: u32) -> u32 {
    let value = (value | value << 16) & 0x0700_00ff;
    let value = (value | value << 8) & 0x0700_f00f;
    let value = (value | value << 4) & 0x430c_30c3;
    (value | value << 2) & 0x4924_9249
}

/// Sorts keys, stably, whose codes differ in the lowest `bits` only; `room` is as long as the keys.
fn sort(keys: &mut [Key], room: &mut [Key], bits: u32) {
    if keys.len() < COUNTED_MIN {
        keys.sort_unstable();
        return;
    }
    if keys.len() < SHARED_MIN || bits <= DIGIT_BITS {
        sort_by_counting(keys, room, bits);
        return;
    }
    let shift = NUMBER_BITS + bits - DIGIT_BITS;
    let digit = |key: &Key| (key.0 >> shift) as usize % DIGIT_VALUES;
    let chunk = keys.len().div_ceil(rayon::current_num_threads());
    let mut places: Vec<Vec<u32>> = keys
        .par_chunks(chunk)
        .map(|keys| {
            let mut counts = vec![0; DIGIT_VALUES];
            keys.iter().for_each(|key| counts[digit(key)] += 1);
            counts
        })
        .collect();
    let (mut next, mut counts) = (0, vec![0; DIGIT_VALUES]);
    for (value, of_value) in counts.iter_mut().enumerate() {
        let first = next;
        for of_chunk in &mut places {
            let count = of_chunk[value];
            of_chunk[value] = next;
            next += count;
        }
        *of_value = (next - first) as usize;
    }
    let parted = Scattered(room.as_mut_ptr());
    keys.par_chunks(chunk).zip(&mut places).for_each(|(keys, places)| {
        let parted = &parted;
        for key in keys {
            let place = &mut places[digit(key)];
            // SAFETY: each chunk has the places of its own digits for itself.
            unsafe { parted.0.add(*place as usize).write(*key) };
            *place += 1;
        }
    });
    let (mut rest, mut rest_of_room) = (room, keys);
    let parts: Vec<_> = counts
        .into_iter()
        .filter(|&count| count > 0)
        .map(|count| {
            let parted = rest.split_off_mut(..count).expect("the counts come to all keys");
            (parted, rest_of_room.split_off_mut(..count).expect("the counts come to all keys"))
        })
        .collect();
    parts.into_par_iter().for_each(|(parted, room)| {
        sort(parted, room, bits - DIGIT_BITS);
        room.copy_from_slice(parted);
    });
}

/// Where threads write, each to places of its own.
struct Scattered(*mut Key);

// SAFETY: each write through it says why no other thread uses the place.
unsafe impl Sync for Scattered {}

/// Sorts on one thread, from the lowest digit to the highest.
fn sort_by_counting(keys: &mut [Key], room: &mut [Key], bits: u32) {
    let digits = bits.div_ceil(DIGIT_BITS);
    let (mut from, mut to) = (keys, room);
    for number in 0..digits {
        let digit = |key: &Key| (key.0 >> (NUMBER_BITS + number * DIGIT_BITS)) as usize % DIGIT_VALUES;
        let mut places = [0u32; DIGIT_VALUES];
        from.iter().for_each(|key| places[digit(key)] += 1);
        let mut next = 0;
        for place in &mut places {
            next += std::mem::replace(place, next);
        }
        for key in &*from {
            let place = &mut places[digit(key)];
            to[*place as usize] = *key;
            *place += 1;
        }
        std::mem::swap(&mut from, &mut to);
    }
    if digits % 2 == 1 {
        to.copy_from_slice(from);
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn interleaved(value: u32) -> u32 {
        (0..11).map(|bit| (value >> bit & 1) << (3 * bit)).sum()
    }

    #[test]
    fn bits_are_spread_to_every_third_place() {
        for value in 0..DIGIT_VALUES as u32 {
            assert_eq!(spread(value), interleaved(value), "{value}");
        }
    }

    /// Triangles are where people put detail: most of a scene's are in few cells of the grid.
    #[test]
    fn crowded_cells_are_sorted_too() {
        let mut state = 1u64;
        let mut random = || {
            state = state.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
            state >> 33
        };
        let spread_out = 0..20_000;
        let codes = (0..3 * SHARED_MIN as u64).map(|number| match number {
            number if spread_out.contains(&number) => random() % (1 << CODE_BITS),
            // One value of the first digit, and of the second in most of them.
            number if number % 8 == 0 => (5 << (2 * DIGIT_BITS)) + random() % (1 << (2 * DIGIT_BITS)),
            _ => (5 << (2 * DIGIT_BITS)) + (7 << DIGIT_BITS) + random() % 300,
        });
        let mut keys: Vec<Key> = codes.enumerate().map(|(number, code)| Key::new(code, number)).collect();
        let mut expected = keys.clone();
        expected.sort();
        let mut room = vec![Key(0); keys.len()];
        sort(&mut keys, &mut room, CODE_BITS);
        assert!(keys == expected);
    }

    proptest! {
        #[test]
        fn counting_sorts_as_comparing_does(
            codes in prop::collection::vec(0u64..1 << CODE_BITS, 0..40),
            digits in 0u32..=3,
        ) {
            let bits = digits * DIGIT_BITS;
            let codes = codes.into_iter().map(|code| code % (1 << bits)).enumerate();
            let mut keys: Vec<Key> = codes.map(|(number, code)| Key::new(code, number)).collect();
            let mut expected = keys.clone();
            expected.sort();
            let mut room = keys.clone();
            sort_by_counting(&mut keys, &mut room, bits);
            prop_assert_eq!(keys, expected);
        }

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
