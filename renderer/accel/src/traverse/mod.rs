//! Rays through the tree: one algorithm, compiled for each kind of tree and instruction set.
//!
//! Meaning and machine are kept apart. [`kernel`] walks the tree, [`boxes`] tests a node's children,
//! [`triangles`] and [`watertight`] test a leaf's blocks; all are written once over [`lanes::Lanes`], a
//! handful of vector operations. This file compiles them for each instruction set and picks one set of
//! functions when a tree is built, so that a ray pays one indirect call and no further choice.

mod boxes;
mod isa;
mod kernel;
mod lanes;
mod stack;
mod triangles;
mod watertight;

pub use isa::Isa;

use crate::geometry::{Hit, Ray};
use crate::parameters::TreeParameters;
use crate::tree::Root;

/// The two queries over one kind of tree.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kernels {
    pub(crate) closest: unsafe fn(&Root, &Ray) -> Option<Hit>,
    pub(crate) occluded: unsafe fn(&Root, &Ray) -> bool,
}

/// Compiles both queries with the given processor features and tables them by the kind of tree.
macro_rules! compile {
    ($(#[$feature:meta])* $name:ident, $two:ty, $four:ty, $eight:ty, $sixteen:ty) => {
        mod $name {
            use super::boxes::{Boxes, FastBoxes, PaddedBoxes};
            use super::triangles::{Blocks, FastBlocks};
            use super::watertight::WatertightBlocks;
            use super::{Hit, Kernels, Ray, Root, kernel, lanes};
            use crate::parameters::{NodeFormat, TreeParameters};
            use crate::tree::layout::{Node, QuantisedNode, TreeNode};

            // SAFETY: for both, the caller has the processor features and a tree of nodes `N` and blocks of
            // the width and kind `T` tests.
            $(#[$feature])*
            unsafe fn closest<N: TreeNode, const B: usize, X: Boxes<N>, T: Blocks<B>>(
                root: &Root,
                ray: &Ray,
            ) -> Option<Hit> {
                unsafe { kernel::closest::<N, B, X, T>(root, ray) }
            }

            // SAFETY: as above.
            $(#[$feature])*
            unsafe fn occluded<N: TreeNode, const B: usize, X: Boxes<N>, T: Blocks<B>>(
                root: &Root,
                ray: &Ray,
            ) -> bool {
                unsafe { kernel::occluded::<N, B, X, T>(root, ray) }
            }

            const fn pair<N: TreeNode, const B: usize, X: Boxes<N>, T: Blocks<B>>() -> Kernels {
                Kernels { closest: closest::<N, B, X, T>, occluded: occluded::<N, B, X, T> }
            }

            fn blocks<N: TreeNode, X: Boxes<N>, Y: Boxes<N>>(parameters: &TreeParameters) -> Option<Kernels> {
                Some(match (parameters.block_width, parameters.robust) {
                    (4, false) => pair::<N, 4, X, FastBlocks<$four>>(),
                    (8, false) => pair::<N, 8, X, FastBlocks<$eight>>(),
                    (4, true) => pair::<N, 4, Y, WatertightBlocks<$four>>(),
                    (8, true) => pair::<N, 8, Y, WatertightBlocks<$eight>>(),
                    _ => return None,
                })
            }

            pub(super) fn select(parameters: &TreeParameters) -> Option<Kernels> {
                match (parameters.active_format(), parameters.branching_factor) {
                    (NodeFormat::Full, 2) => blocks::<Node<2>, FastBoxes<$two>, PaddedBoxes<$two>>(parameters),
                    (NodeFormat::Full, 4) => blocks::<Node<4>, FastBoxes<$four>, PaddedBoxes<$four>>(parameters),
                    (NodeFormat::Full, 8) => blocks::<Node<8>, FastBoxes<$eight>, PaddedBoxes<$eight>>(parameters),
                    (NodeFormat::Full, 16) => {
                        blocks::<Node<16>, FastBoxes<$sixteen>, PaddedBoxes<$sixteen>>(parameters)
                    }
                    (NodeFormat::Quantised, 8) => {
                        blocks::<QuantisedNode<8>, FastBoxes<$eight>, PaddedBoxes<$eight>>(parameters)
                    }
                    (NodeFormat::Quantised, 16) => {
                        blocks::<QuantisedNode<16>, FastBoxes<$sixteen>, PaddedBoxes<$sixteen>>(parameters)
                    }
                    _ => None,
                }
            }
        }
    };
}

compile!(scalar, lanes::Portable<2>, lanes::Portable<4>, lanes::Portable<8>, lanes::Portable<16>);
#[cfg(target_arch = "x86_64")]
compile!(
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    avx2,
    lanes::avx2::Two,
    lanes::avx2::Four,
    lanes::avx2::Eight,
    lanes::avx2::Sixteen
);
#[cfg(target_arch = "x86_64")]
compile!(
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    avx512,
    lanes::avx512::Two,
    lanes::avx512::Four,
    lanes::avx512::Eight,
    lanes::avx512::Sixteen
);

impl Kernels {
    /// The functions for trees of these parameters, or `None` where the processor lacks `isa` or there is no
    /// such tree.
    pub(crate) fn select(isa: Isa, parameters: &TreeParameters) -> Option<Self> {
        if !isa.is_available() {
            return None;
        }
        match isa {
            Isa::Scalar => scalar::select(parameters),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => avx2::select(parameters),
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => avx512::select(parameters),
            #[cfg(not(target_arch = "x86_64"))]
            _ => None,
        }
    }
}
