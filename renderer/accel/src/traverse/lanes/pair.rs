//! Two vectors as one of twice the length, where the machine has none so long.

use super::{Lanes, Order};

/// The lower lanes, then the upper ones.
#[derive(Clone, Copy)]
pub(crate) struct Pair<L>(L, L);

impl<L: Lanes> Lanes for Pair<L> {
    const COUNT: usize = 2 * L::COUNT;
    type Mask = (L::Mask, L::Mask);

    operations! {
        fn splat(value: f32) -> Self { Self(L::splat(value), L::splat(value)) }
        fn load(from: *const f32) -> Self { Self(L::load(from), L::load(from.add(L::COUNT))) }
        fn store(self, to: *mut f32) {
            self.0.store(to);
            self.1.store(to.add(L::COUNT));
        }
        fn add(self, other: Self) -> Self { Self(self.0.add(other.0), self.1.add(other.1)) }
        fn sub(self, other: Self) -> Self { Self(self.0.sub(other.0), self.1.sub(other.1)) }
        fn mul(self, other: Self) -> Self { Self(self.0.mul(other.0), self.1.mul(other.1)) }
        fn div(self, other: Self) -> Self { Self(self.0.div(other.0), self.1.div(other.1)) }
        fn mul_add(self, factor: Self, more: Self) -> Self {
            Self(self.0.mul_add(factor.0, more.0), self.1.mul_add(factor.1, more.1))
        }
        fn mul_sub(self, factor: Self, less: Self) -> Self {
            Self(self.0.mul_sub(factor.0, less.0), self.1.mul_sub(factor.1, less.1))
        }
        fn min(self, other: Self) -> Self { Self(self.0.min(other.0), self.1.min(other.1)) }
        fn max(self, other: Self) -> Self { Self(self.0.max(other.0), self.1.max(other.1)) }
        fn abs(self) -> Self { Self(self.0.abs(), self.1.abs()) }
        fn flip_sign(self, by: Self) -> Self { Self(self.0.flip_sign(by.0), self.1.flip_sign(by.1)) }
        fn less(self, other: Self) -> Self::Mask { (self.0.less(other.0), self.1.less(other.1)) }
        fn less_equal(self, other: Self) -> Self::Mask {
            (self.0.less_equal(other.0), self.1.less_equal(other.1))
        }
        fn equal(self, other: Self) -> Self::Mask { (self.0.equal(other.0), self.1.equal(other.1)) }
        fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask { (L::and(a.0, b.0), L::and(a.1, b.1)) }
        fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask { (L::or(a.0, b.0), L::or(a.1, b.1)) }
        fn choose(bits: u32, yes: Self, no: Self) -> Self {
            Self(L::choose(bits, yes.0, no.0), L::choose(bits >> L::COUNT, yes.1, no.1))
        }
        fn bits(mask: Self::Mask) -> u32 { L::bits(mask.0) | L::bits(mask.1) << L::COUNT }
    }
}

impl<L: Lanes> Order for Pair<L> {}
