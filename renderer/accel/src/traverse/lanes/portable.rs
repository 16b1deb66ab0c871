//! Vectors in plain Rust: the fallback, and the yardstick of the others.

use super::{Lanes, Order};

/// `N` numbers that the compiler may keep in any vectors of the target.
#[derive(Clone, Copy)]
#[repr(align(16))]
pub(crate) struct Portable<const N: usize>([f32; N]);

impl<const N: usize> Portable<N> {
    #[inline(always)]
    fn zip(self, other: Self, operation: impl Fn(f32, f32) -> f32) -> Self {
        Self(std::array::from_fn(|lane| operation(self.0[lane], other.0[lane])))
    }

    #[inline(always)]
    fn compare(self, other: Self, operation: impl Fn(f32, f32) -> bool) -> [bool; N] {
        std::array::from_fn(|lane| operation(self.0[lane], other.0[lane]))
    }
}

impl<const N: usize> Lanes for Portable<N> {
    const COUNT: usize = N;
    type Mask = [bool; N];

    operations! {
        fn splat(value: f32) -> Self { Self([value; N]) }
        fn load(from: *const f32) -> Self {
            // SAFETY: the caller vouches for the pointer; an array needs no more alignment than a number.
            Self(unsafe { from.cast::<[f32; N]>().read() })
        }
        fn store(self, to: *mut f32) {
            // SAFETY: as above.
            unsafe { to.cast::<[f32; N]>().write(self.0) };
        }
        fn add(self, other: Self) -> Self { self.zip(other, |a, b| a + b) }
        fn sub(self, other: Self) -> Self { self.zip(other, |a, b| a - b) }
        fn mul(self, other: Self) -> Self { self.zip(other, |a, b| a * b) }
        fn div(self, other: Self) -> Self { self.zip(other, |a, b| a / b) }
        fn mul_add(self, factor: Self, more: Self) -> Self {
            // Without the instruction a fused operation is a slow library call.
            self.zip(factor, |a, b| a * b).zip(more, |a, b| a + b)
        }
        fn mul_sub(self, factor: Self, less: Self) -> Self {
            self.zip(factor, |a, b| a * b).zip(less, |a, b| a - b)
        }
        fn min(self, other: Self) -> Self { self.zip(other, |a, b| if a < b { a } else { b }) }
        fn max(self, other: Self) -> Self { self.zip(other, |a, b| if a > b { a } else { b }) }
        fn abs(self) -> Self { Self(self.0.map(f32::abs)) }
        fn flip_sign(self, by: Self) -> Self {
            self.zip(by, |a, b| f32::from_bits(a.to_bits() ^ (b.to_bits() & (1 << 31))))
        }
        fn less(self, other: Self) -> Self::Mask { self.compare(other, |a, b| a < b) }
        fn less_equal(self, other: Self) -> Self::Mask { self.compare(other, |a, b| a <= b) }
        fn equal(self, other: Self) -> Self::Mask { self.compare(other, |a, b| a == b) }
        fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask { std::array::from_fn(|lane| a[lane] & b[lane]) }
        fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask { std::array::from_fn(|lane| a[lane] | b[lane]) }
        fn choose(bits: u32, yes: Self, no: Self) -> Self {
            Self(std::array::from_fn(|lane| if bits & 1 << lane == 0 { no.0[lane] } else { yes.0[lane] }))
        }
        fn bits(mask: Self::Mask) -> u32 {
            mask.iter().enumerate().fold(0, |bits, (lane, &set)| bits | u32::from(set) << lane)
        }
    }
}

impl<const N: usize> Order for Portable<N> {}
