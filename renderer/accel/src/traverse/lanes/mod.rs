//! The few vector operations the kernels are written in, and their kinds.

#![allow(unsafe_op_in_unsafe_fn, reason = "each operation is unsafe for the one reason that `Lanes` states")]

/// Operations of [`Lanes`], all inlined, as a table of a line each.
macro_rules! operations {
    ($(fn $name:ident($($parameters:tt)*) $(-> $result:ty)? $body:block)*) => {$(
        #[inline(always)]
        unsafe fn $name($($parameters)*) $(-> $result)? $body
    )*};
}

#[cfg(target_arch = "x86_64")]
pub(crate) mod avx2;
#[cfg(target_arch = "x86_64")]
pub(crate) mod avx512;
#[cfg(target_arch = "x86_64")]
mod avx512_order;
mod order;
#[cfg(target_arch = "x86_64")]
mod pair;
mod portable;
#[cfg(target_arch = "x86_64")]
mod x86;

pub(crate) use order::Order;
#[cfg(target_arch = "x86_64")]
pub(crate) use pair::Pair;
pub(crate) use portable::Portable;

/// A vector of `COUNT` numbers.
///
/// `min` and `max` give the second operand if either is NaN, as x86 does; comparisons with NaN are false.
///
/// # Safety
/// Every function requires the processor features the type is named after. Pointers must be valid for `COUNT`
/// numbers and aligned to their whole size.
pub(crate) trait Lanes: Copy {
    const COUNT: usize;
    /// One truth value a lane.
    type Mask: Copy;

    unsafe fn splat(value: f32) -> Self;
    unsafe fn load(from: *const f32) -> Self;
    unsafe fn store(self, to: *mut f32);
    unsafe fn add(self, other: Self) -> Self;
    unsafe fn sub(self, other: Self) -> Self;
    unsafe fn mul(self, other: Self) -> Self;
    unsafe fn div(self, other: Self) -> Self;
    /// `self * factor + more`, rounded once where the machine can.
    unsafe fn mul_add(self, factor: Self, more: Self) -> Self;
    /// `self * factor - less`, rounded once where the machine can.
    unsafe fn mul_sub(self, factor: Self, less: Self) -> Self;
    unsafe fn min(self, other: Self) -> Self;
    unsafe fn max(self, other: Self) -> Self;
    unsafe fn abs(self) -> Self;
    /// Changes the sign where `by` is negative.
    unsafe fn flip_sign(self, by: Self) -> Self;
    unsafe fn less(self, other: Self) -> Self::Mask;
    unsafe fn less_equal(self, other: Self) -> Self::Mask;
    unsafe fn equal(self, other: Self) -> Self::Mask;
    unsafe fn and(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    unsafe fn or(a: Self::Mask, b: Self::Mask) -> Self::Mask;
    /// One bit a lane, the first lane lowest.
    unsafe fn bits(mask: Self::Mask) -> u32;
    /// `yes` where the lane's bit is set, `no` elsewhere.
    unsafe fn choose(bits: u32, yes: Self, no: Self) -> Self;
}

/// Room for any vector, aligned for all.
#[derive(Clone, Copy)]
#[repr(C, align(64))]
pub(crate) struct Stored(pub(crate) [f32; 16]);

impl Stored {
    /// A vector's numbers.
    ///
    /// # Safety
    /// As for [`Lanes`].
    #[inline(always)]
    pub(crate) unsafe fn from<L: Lanes>(lanes: L) -> Self {
        let mut stored = Self([0.0; 16]);
        // SAFETY: sixteen numbers are room for every kind, and 64 bytes the largest alignment.
        unsafe { lanes.store(stored.0.as_mut_ptr()) };
        stored
    }
}

/// Three vectors: a point or direction a lane.
#[derive(Clone, Copy)]
pub(crate) struct Lanes3<L>(pub(crate) [L; 3]);

impl<L: Lanes> Lanes3<L> {
    #[inline(always)]
    pub(crate) unsafe fn splat(of: glam::Vec3) -> Self {
        Self([L::splat(of.x), L::splat(of.y), L::splat(of.z)])
    }

    #[inline(always)]
    pub(crate) unsafe fn load<const B: usize>(from: &[[f32; B]; 3]) -> Self {
        debug_assert!(L::COUNT == B);
        Self([L::load(from[0].as_ptr()), L::load(from[1].as_ptr()), L::load(from[2].as_ptr())])
    }

    #[inline(always)]
    pub(crate) unsafe fn sub(self, other: Self) -> Self {
        let ([ax, ay, az], [bx, by, bz]) = (self.0, other.0);
        Self([ax.sub(bx), ay.sub(by), az.sub(bz)])
    }

    #[inline(always)]
    pub(crate) unsafe fn add(self, other: Self) -> Self {
        let ([ax, ay, az], [bx, by, bz]) = (self.0, other.0);
        Self([ax.add(bx), ay.add(by), az.add(bz)])
    }

    #[inline(always)]
    pub(crate) unsafe fn cross(self, other: Self) -> Self {
        let ([ax, ay, az], [bx, by, bz]) = (self.0, other.0);
        Self([ay.mul_sub(bz, az.mul(by)), az.mul_sub(bx, ax.mul(bz)), ax.mul_sub(by, ay.mul(bx))])
    }

    #[inline(always)]
    pub(crate) unsafe fn dot(self, other: Self) -> L {
        let ([ax, ay, az], [bx, by, bz]) = (self.0, other.0);
        ax.mul_add(bx, ay.mul_add(by, az.mul(bz)))
    }
}

#[cfg(test)]
mod tests;
