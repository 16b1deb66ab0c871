//! Every kind of vector against plain Rust, operation by operation.

use super::*;
use crate::{layout::NodeRef, traverse::Isa};

/// Pairs of numbers with every special value among them.
fn samples() -> Vec<[f32; 2]> {
    let values = [0.0, -0.0, 1.0, -1.5, 3.25e-3, 1e30, -1e30, f32::INFINITY, f32::NEG_INFINITY, f32::NAN];
    values.iter().flat_map(|&a| values.map(|b| [a, b])).collect()
}

fn numbers(lanes: impl Lanes) -> [f32; 16] {
    // SAFETY: the caller checked the processor.
    unsafe { Stored::from(lanes).0 }
}

fn same(a: [f32; 16], b: [f32; 16], count: usize, what: &str) {
    for lane in 0..count {
        let equal = a[lane].to_bits() == b[lane].to_bits() || (a[lane].is_nan() && b[lane].is_nan());
        assert!(equal, "{what}, lane {lane}: {} and {}", a[lane], b[lane]);
    }
}

/// Compares `L` with the portable vector of as many lanes.
fn agrees<L: Lanes, P: Lanes>() {
    assert_eq!(L::COUNT, P::COUNT);
    for window in samples().windows(16) {
        let (mut a, mut b) = (Stored([0.0; 16]), Stored([0.0; 16]));
        for (lane, pair) in window.iter().enumerate() {
            a.0[lane] = pair[0];
            b.0[lane] = pair[1];
        }
        let count = L::COUNT;
        // SAFETY: the caller checked the processor; both arrays are aligned and long enough.
        unsafe {
            let (la, lb) = (L::load(a.0.as_ptr()), L::load(b.0.as_ptr()));
            let (pa, pb) = (P::load(a.0.as_ptr()), P::load(b.0.as_ptr()));
            same(numbers(la.add(lb)), numbers(pa.add(pb)), count, "add");
            same(numbers(la.sub(lb)), numbers(pa.sub(pb)), count, "sub");
            same(numbers(la.mul(lb)), numbers(pa.mul(pb)), count, "mul");
            same(numbers(la.div(lb)), numbers(pa.div(pb)), count, "div");
            same(numbers(la.min(lb)), numbers(pa.min(pb)), count, "min");
            same(numbers(la.max(lb)), numbers(pa.max(pb)), count, "max");
            same(numbers(la.abs()), numbers(pa.abs()), count, "abs");
            same(numbers(la.flip_sign(lb)), numbers(pa.flip_sign(pb)), count, "flip_sign");
            // Exact in single precision, so that fused and separate rounding agree.
            let (two, one) = (L::splat(2.0), L::splat(1.0));
            same(numbers(two.mul_sub(two, one)), numbers(P::splat(3.0)), count, "mul_sub");
            assert_eq!(L::bits(la.less(lb)), P::bits(pa.less(pb)), "less");
            assert_eq!(L::bits(la.less_equal(lb)), P::bits(pa.less_equal(pb)), "less_equal");
            assert_eq!(L::bits(la.equal(lb)), P::bits(pa.equal(pb)), "equal");
            for bits in [0, 1, 0b1010_0110_0101_1001, u32::MAX] {
                same(numbers(L::choose(bits, la, lb)), numbers(P::choose(bits, pa, pb)), count, "choose");
            }
            let (and, or) = (L::and(la.less(lb), la.less_equal(lb)), L::or(la.less(lb), la.equal(lb)));
            assert_eq!(L::bits(and), P::bits(pa.less(pb)), "and");
            assert_eq!(L::bits(or), P::bits(pa.less_equal(pb)), "or");
        }
    }
}

#[test]
fn portable_is_plain_arithmetic() {
    let (a, b) = ([1.0f32, -2.0, 0.5, f32::NAN], [4.0f32, 0.25, -8.0, 1.0]);
    // SAFETY: portable vectors need no features.
    unsafe {
        let (la, lb) = (Portable::<4>::load(a.as_ptr()), Portable::<4>::load(b.as_ptr()));
        assert_eq!(numbers(la.mul(lb))[..3], [4.0, -0.5, -4.0]);
        assert_eq!(numbers(la.max(lb))[..4], [4.0, 0.25, 0.5, 1.0]);
        assert_eq!(Portable::<4>::bits(la.less(lb)), 0b0011);
        assert_eq!(numbers(Portable::<4>::choose(0b0110, la, lb))[..4], [4.0, -2.0, 0.5, 1.0]);
    }
}

/// References as aligned as those of a node.
#[repr(align(64))]
struct Children([NodeRef; 16]);

/// Every set of hits with distances of all kinds: sorted by distance, the nearest last, none lost.
fn orders<L: Order>() {
    let mut random = 1u32;
    let mut next = || {
        random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        random >> 8
    };
    let mut room = [0u8; 32];
    let of = |number: usize| NodeRef::from_raw((&raw mut room).cast::<u8>().wrapping_add(number).cast());
    let children = Children(std::array::from_fn(of));
    let address = |child: NodeRef| child.into_raw().addr();
    for round in 0..20_000u32 {
        let hits = if L::COUNT == 16 { next() } else { round } & ((1 << L::COUNT) - 1);
        let mut times = Stored([0.0; 16]);
        for time in &mut times.0 {
            *time = match next() % 8 {
                0 => 0.0,
                1 => f32::MAX,
                2 => 1.0,
                _ => next() as f32 * 1e-3,
            };
        }
        let (mut nodes, mut keys) = ([NodeRef::EMPTY; 16], [0i32; 16]);
        let met: Vec<usize> = (0..L::COUNT).filter(|lane| hits & 1 << lane != 0).collect();
        // SAFETY: the caller checked the processor; the arrays are long and aligned enough.
        unsafe { L::write_met(hits, children.0.as_ptr(), nodes.as_mut_ptr()) };
        for (place, &lane) in met.iter().enumerate() {
            assert_eq!(address(nodes[place]), address(children.0[lane]), "{hits:b}");
        }
        if met.len() < 2 {
            continue;
        }
        // SAFETY: as above.
        unsafe {
            L::load(times.0.as_ptr()).write_sorted(
                hits,
                children.0.as_ptr(),
                nodes.as_mut_ptr(),
                keys.as_mut_ptr(),
            );
        }
        let mut expected: Vec<i32> = met
            .iter()
            .map(|&lane| times.0[lane].to_bits() as i32 & !(L::COUNT as i32 - 1) | lane as i32)
            .collect();
        expected.sort_unstable_by_key(|&key| std::cmp::Reverse(key));
        assert_eq!(keys[..met.len()], expected, "{hits:b}");
        for (place, key) in expected.into_iter().enumerate() {
            let lane = key as usize & (L::COUNT - 1);
            assert_eq!(address(nodes[place]), address(children.0[lane]), "{hits:b}");
            assert!(met.contains(&lane));
        }
    }
}

#[test]
fn portable_orders_children() {
    orders::<Portable<2>>();
    orders::<Portable<4>>();
    orders::<Portable<8>>();
    orders::<Portable<16>>();
}

#[cfg(target_arch = "x86_64")]
#[test]
fn avx2_agrees_with_portable() {
    if Isa::Avx2.is_available() {
        agrees::<avx2::Two, Portable<2>>();
        agrees::<avx2::Four, Portable<4>>();
        agrees::<avx2::Eight, Portable<8>>();
        agrees::<avx2::Sixteen, Portable<16>>();
        orders::<avx2::Eight>();
        orders::<avx2::Sixteen>();
    }
}

#[cfg(target_arch = "x86_64")]
#[test]
fn avx512_agrees_with_portable() {
    if Isa::Avx512.is_available() {
        agrees::<avx512::Two, Portable<2>>();
        agrees::<avx512::Four, Portable<4>>();
        agrees::<avx512::Eight, Portable<8>>();
        agrees::<avx512::Sixteen, Portable<16>>();
        orders::<avx512::Two>();
        orders::<avx512::Four>();
        orders::<avx512::Eight>();
        orders::<avx512::Sixteen>();
    }
}
