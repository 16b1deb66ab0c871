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
mod packet;
mod stack;
mod triangles;
mod watertight;

pub use isa::{Isa, Work};

use crate::geometry::{Hit, Packets, Ray};
use crate::layout::{NodeRef, Root};
use crate::parameters::TreeParameters;

/// Replaces a hit by a nearer one below a node, if there is one.
type ClosestBelow = unsafe fn(&Root, NodeRef, &Ray, &mut Hit);

/// Whether anything below a node is hit.
type OccludedBelow = unsafe fn(&Root, NodeRef, &Ray) -> bool;

/// The queries over one kind of tree.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kernels {
    closest: ClosestBelow,
    occluded: OccludedBelow,
    /// For up to [`packet::PACKET`] rays.
    packet_closest: unsafe fn(&Root, ClosestBelow, &[Ray], &mut [Option<Hit>]),
    packet_occluded: unsafe fn(&Root, OccludedBelow, &[Ray], &mut [bool]),
}

impl Kernels {
    /// The nearest hit.
    ///
    /// # Safety
    /// The tree is of the kind the kernels were selected for, and lives. So for the functions below.
    #[inline(always)]
    pub(crate) unsafe fn closest(&self, root: &Root, ray: &Ray) -> Option<Hit> {
        let mut hit = Hit::none(ray.t_max);
        // SAFETY: the caller vouches for the tree; the processor has what the kernels need, for they were
        // selected.
        unsafe { (self.closest)(root, root.node, ray, &mut hit) };
        hit.found()
    }

    /// Whether anything is hit.
    ///
    /// # Safety
    /// As for [`Kernels::closest`].
    #[inline(always)]
    pub(crate) unsafe fn occluded(&self, root: &Root, ray: &Ray) -> bool {
        // SAFETY: as above.
        unsafe { (self.occluded)(root, root.node, ray) }
    }

    /// The nearest hit of each ray. Rays are packed only if they are said to be coherent: others part at
    /// once and would go alone all the same.
    ///
    /// # Safety
    /// As for [`Kernels::closest`].
    pub(crate) unsafe fn closest_each(
        &self,
        root: &Root,
        packets: Packets,
        rays: &[Ray],
        hits: &mut [Option<Hit>],
    ) {
        assert_eq!(rays.len(), hits.len(), "one hit a ray");
        match together(packets) {
            1 => {
                for (ray, hit) in rays.iter().zip(hits) {
                    // SAFETY: as above.
                    *hit = unsafe { self.closest(root, ray) };
                }
            }
            together => {
                for (rays, hits) in rays.chunks(together).zip(hits.chunks_mut(together)) {
                    // SAFETY: as above.
                    unsafe { (self.packet_closest)(root, self.closest, rays, hits) };
                }
            }
        }
    }

    /// Whether anything is hit, for each ray, packed as in [`Kernels::closest_each`].
    ///
    /// # Safety
    /// As for [`Kernels::closest`].
    pub(crate) unsafe fn occluded_each(
        &self,
        root: &Root,
        packets: Packets,
        rays: &[Ray],
        occluded: &mut [bool],
    ) {
        assert_eq!(rays.len(), occluded.len(), "one answer a ray");
        match together(packets) {
            1 => {
                for (ray, occluded) in rays.iter().zip(occluded) {
                    // SAFETY: as above.
                    *occluded = unsafe { self.occluded(root, ray) };
                }
            }
            together => {
                for (rays, occluded) in rays.chunks(together).zip(occluded.chunks_mut(together)) {
                    // SAFETY: as above.
                    unsafe { (self.packet_occluded)(root, self.occluded, rays, occluded) };
                }
            }
        }
    }
}

/// How many rays are traced together.
fn together(packets: Packets) -> usize {
    match packets {
        Packets::Single | Packets::Eight | Packets::Sixteen => 1,
        Packets::EightCoherent => 8,
        Packets::SixteenCoherent => packet::PACKET,
    }
}

/// Compiles the queries with the given processor features and tables them by the kind of tree.
macro_rules! compile {
    ($(#[$feature:meta])* $name:ident, $two:ty, $four:ty, $eight:ty, $sixteen:ty) => {
        mod $name {
            use super::boxes::{Boxes, FastBoxes, PaddedBoxes, Planes};
            use super::lanes::{self, Lanes, Order};
            use super::packet::boxes::{FastPacket, PacketBoxes, PaddedPacket};
            use super::packet::triangles::{FastRays, PacketBlocks, WatertightRays};
            use super::triangles::{Blocks, FastBlocks};
            use super::watertight::WatertightBlocks;
            use super::{ClosestBelow, Hit, Kernels, NodeRef, OccludedBelow, Ray, Root, kernel, packet};
            use crate::parameters::{NodeFormat, TreeParameters};
            use crate::layout::{Node, QuantisedNode, TreeNode};

            // SAFETY: for all four, the caller has the processor features and a tree of nodes `N` and blocks
            // of the width and kind `T` tests.
            $(#[$feature])*
            unsafe fn closest<N: TreeNode, const B: usize, X: Boxes<N>, T: Blocks<B>>(
                root: &Root,
                start: NodeRef,
                ray: &Ray,
                hit: &mut Hit,
            ) {
                // SAFETY: what the caller promises is what this asks for.
                unsafe { kernel::closest::<N, B, X, T>(root, start, ray, hit) }
            }

            // SAFETY: as above.
            $(#[$feature])*
            unsafe fn occluded<N: TreeNode, const B: usize, X: Boxes<N>, T: Blocks<B>>(
                root: &Root,
                start: NodeRef,
                ray: &Ray,
            ) -> bool {
                // SAFETY: what the caller promises is what this asks for.
                unsafe { kernel::occluded::<N, B, X, T>(root, start, ray) }
            }

            // SAFETY: as above.
            $(#[$feature])*
            unsafe fn packet_closest<N, const B: usize, F, X, T>(
                root: &Root,
                below: ClosestBelow,
                rays: &[Ray],
                hits: &mut [Option<Hit>],
            ) where
                N: Planes,
                F: Order,
                X: PacketBoxes<N>,
                T: PacketBlocks<X::Rays, B>,
            {
                // SAFETY: what the caller promises is what this asks for.
                unsafe { packet::closest::<N, B, F, X, T>(root, below, rays, hits) }
            }

            // SAFETY: as above.
            $(#[$feature])*
            unsafe fn packet_occluded<N, const B: usize, F, X, T>(
                root: &Root,
                below: OccludedBelow,
                rays: &[Ray],
                occluded: &mut [bool],
            ) where
                N: Planes,
                F: Order,
                X: PacketBoxes<N>,
                T: PacketBlocks<X::Rays, B>,
            {
                // SAFETY: what the caller promises is what this asks for.
                unsafe { packet::occluded::<N, B, F, X, T>(root, below, rays, occluded) }
            }

            /// `F` has a lane for each child, `T` one for each triangle of a block.
            const fn fast<N: Planes, const B: usize, F: Order, T: Lanes>() -> Kernels {
                Kernels {
                    closest: closest::<N, B, FastBoxes<F>, FastBlocks<T>>,
                    occluded: occluded::<N, B, FastBoxes<F>, FastBlocks<T>>,
                    packet_closest: packet_closest::<N, B, F, FastPacket<$sixteen>, FastRays<$sixteen>>,
                    packet_occluded: packet_occluded::<N, B, F, FastPacket<$sixteen>, FastRays<$sixteen>>,
                }
            }

            const fn watertight<N: Planes, const B: usize, F: Order, T: Lanes>() -> Kernels {
                Kernels {
                    closest: closest::<N, B, PaddedBoxes<F>, WatertightBlocks<T>>,
                    occluded: occluded::<N, B, PaddedBoxes<F>, WatertightBlocks<T>>,
                    packet_closest:
                        packet_closest::<N, B, F, PaddedPacket<$sixteen>, WatertightRays<$sixteen>>,
                    packet_occluded:
                        packet_occluded::<N, B, F, PaddedPacket<$sixteen>, WatertightRays<$sixteen>>,
                }
            }

            fn blocks<N: Planes, F: Order>(parameters: &TreeParameters) -> Option<Kernels> {
                Some(match (parameters.block_width, parameters.robust) {
                    (4, false) => fast::<N, 4, F, $four>(),
                    (8, false) => fast::<N, 8, F, $eight>(),
                    (4, true) => watertight::<N, 4, F, $four>(),
                    (8, true) => watertight::<N, 8, F, $eight>(),
                    _ => return None,
                })
            }

            pub(super) fn select(parameters: &TreeParameters) -> Option<Kernels> {
                match (parameters.active_format(), parameters.branching_factor) {
                    (NodeFormat::Full, 2) => blocks::<Node<2>, $two>(parameters),
                    (NodeFormat::Full, 4) => blocks::<Node<4>, $four>(parameters),
                    (NodeFormat::Full, 8) => blocks::<Node<8>, $eight>(parameters),
                    (NodeFormat::Full, 16) => blocks::<Node<16>, $sixteen>(parameters),
                    (NodeFormat::Quantised, 8) => blocks::<QuantisedNode<8>, $eight>(parameters),
                    (NodeFormat::Quantised, 16) => blocks::<QuantisedNode<16>, $sixteen>(parameters),
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
