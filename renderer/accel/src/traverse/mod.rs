//! Rays through the tree: one algorithm, compiled for each width, test and instruction set.
//!
//! Meaning and machine are kept apart. [`kernel`] walks the tree, [`boxes`] tests a node's children,
//! [`triangles`] and [`watertight`] test a leaf's blocks; all are written once over [`lanes::Lanes`], a
//! handful of vector operations. This file compiles them for each instruction set and picks one set of
//! functions when a tree is built, so that a ray pays one indirect call and no further choice.

mod boxes;
mod isa;
mod kernel;
mod lanes;
mod triangles;
mod watertight;

pub use isa::Isa;

use crate::geometry::{Hit, Ray};
use crate::tree::Root;

/// The two queries over one kind of tree.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kernels {
    pub(crate) closest: unsafe fn(&Root, &Ray) -> Option<Hit>,
    pub(crate) occluded: unsafe fn(&Root, &Ray) -> bool,
}

/// Compiles both queries with the given processor features and tables them by width and test.
macro_rules! compile {
    ($(#[$feature:meta])* $name:ident, $two:ty, $four:ty, $eight:ty) => {
        mod $name {
            use super::boxes::{Boxes, FastBoxes, PaddedBoxes};
            use super::triangles::{Blocks, FastBlocks};
            use super::watertight::WatertightBlocks;
            use super::{Hit, Kernels, Ray, Root, kernel, lanes};

            // SAFETY: for both, the caller has the processor features and a tree of width `W` whose blocks
            // are of the kind `T` tests.
            $(#[$feature])*
            unsafe fn closest<const W: usize, B: Boxes<W>, T: Blocks>(root: &Root, ray: &Ray) -> Option<Hit> {
                unsafe { kernel::closest::<W, B, T>(root, ray) }
            }

            // SAFETY: as above.
            $(#[$feature])*
            unsafe fn occluded<const W: usize, B: Boxes<W>, T: Blocks>(root: &Root, ray: &Ray) -> bool {
                unsafe { kernel::occluded::<W, B, T>(root, ray) }
            }

            const fn pair<const W: usize, B: Boxes<W>, T: Blocks>() -> Kernels {
                Kernels { closest: closest::<W, B, T>, occluded: occluded::<W, B, T> }
            }

            pub(super) fn select(width: u32, watertight: bool) -> Option<Kernels> {
                Some(match (width, watertight) {
                    (2, false) => pair::<2, FastBoxes<$two>, FastBlocks<$four>>(),
                    (4, false) => pair::<4, FastBoxes<$four>, FastBlocks<$four>>(),
                    (8, false) => pair::<8, FastBoxes<$eight>, FastBlocks<$four>>(),
                    (2, true) => pair::<2, PaddedBoxes<$two>, WatertightBlocks<$four>>(),
                    (4, true) => pair::<4, PaddedBoxes<$four>, WatertightBlocks<$four>>(),
                    (8, true) => pair::<8, PaddedBoxes<$eight>, WatertightBlocks<$four>>(),
                    _ => return None,
                })
            }
        }
    };
}

compile!(scalar, lanes::Portable<2>, lanes::Portable<4>, lanes::Portable<8>);
#[cfg(target_arch = "x86_64")]
compile!(
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    avx2,
    lanes::avx2::Two,
    lanes::avx2::Four,
    lanes::avx2::Eight
);
#[cfg(target_arch = "x86_64")]
compile!(
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    avx512,
    lanes::avx512::Two,
    lanes::avx512::Four,
    lanes::avx512::Eight
);

impl Kernels {
    /// The functions for a tree of `width` children a node, or `None` where the processor lacks `isa` or
    /// there is no such width.
    pub(crate) fn select(isa: Isa, width: u32, watertight: bool) -> Option<Self> {
        if !isa.is_available() {
            return None;
        }
        match isa {
            Isa::Scalar => scalar::select(width, watertight),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => avx2::select(width, watertight),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => avx512::select(width, watertight),
            #[cfg(not(target_arch = "x86_64"))]
            _ => None,
        }
    }
}
