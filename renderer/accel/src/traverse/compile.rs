//! The queries compiled for each instruction set, and the choice of those that fit a tree and a machine.

use super::{
    ClosestBelow, Isa, Kernels, LEVEL_WIDTH, LevelKernels, OccludedBelow, boxes, flight, kernel, lanes,
    packet, placed, triangles, watertight,
};
use crate::geometry::{Hit, Ray};
use crate::layout::{NodeRef, Root};
use crate::parameters::TreeParameters;

/// Compiles the queries with the given processor features and tables them by the kind of tree.
macro_rules! compile {
    ($(#[$feature:meta])* $name:ident, $two:ty, $four:ty, $eight:ty, $sixteen:ty) => {
        mod $name {
            use super::boxes::{Boxes, FastBoxes, PaddedBoxes, Planes};
            use super::flight::{ClosestQuery, OccludedQuery};
            use super::lanes::{self, Lanes, Order, Stored};
            use super::packet::boxes::{FastPacket, PacketBoxes, PaddedPacket};
            use super::packet::bundle::{Bundle, Hits};
            use super::packet::triangles::{BlockTree, FastRays, PacketBlockLeaves, PacketBlocks, WatertightRays};
            use super::placed::{LevelTree, Lower, PacketPlacedLeaves, PlacedLeaves};
            use super::triangles::{BlockLeaves, Blocks, FastBlocks};
            use super::watertight::WatertightBlocks;
            use super::{ClosestBelow, Hit, Kernels, LEVEL_WIDTH, LevelKernels, NodeRef, OccludedBelow, Ray, Root};
            use super::{flight, kernel, packet};
            use crate::parameters::TreeParameters;
            use crate::layout::{Node, TreeNode};

            // SAFETY: the caller has the processor features, and a tree of nodes `N` and `T`'s blocks.
            $(#[$feature])*
            unsafe fn closest<N: TreeNode, const B: usize, X: Boxes<N>, T: Blocks<B>>(
                root: &Root,
                start: NodeRef,
                ray: &Ray,
                hit: &mut Hit,
            ) {
                // SAFETY: what the caller promises is what this asks for.
                unsafe {
                    let leaves = BlockLeaves::<'_, T, B> { blocks: T::new(ray), ray, all: &root.triangles };
                    kernel::closest::<N, X, _>(root, start, ray, &leaves, hit)
                }
            }

            // SAFETY: as above.
            $(#[$feature])*
            unsafe fn occluded<N: TreeNode, const B: usize, X: Boxes<N>, T: Blocks<B>>(
                root: &Root,
                start: NodeRef,
                ray: &Ray,
            ) -> bool {
                // SAFETY: what the caller promises is what this asks for.
                unsafe {
                    let leaves = BlockLeaves::<'_, T, B> { blocks: T::new(ray), ray, all: &root.triangles };
                    kernel::occluded::<N, X, _>(root, start, ray, &leaves)
                }
            }

            // SAFETY: as above.
            $(#[$feature])*
            unsafe fn flight_closest<N: TreeNode, const B: usize, X: Boxes<N>, T: Blocks<B>>(
                root: &Root,
                flight: usize,
                rays: &[Ray],
                hits: &mut [Option<Hit>],
            ) {
                // SAFETY: what the caller promises is what this asks for.
                unsafe { flight::each::<ClosestQuery<'_, N, X, T, B>>(root, flight, rays, hits) }
            }

            // SAFETY: as above.
            $(#[$feature])*
            unsafe fn flight_occluded<N: TreeNode, const B: usize, X: Boxes<N>, T: Blocks<B>>(
                root: &Root,
                flight: usize,
                rays: &[Ray],
                occluded: &mut [bool],
            ) {
                // SAFETY: what the caller promises is what this asks for.
                unsafe { flight::each::<OccludedQuery<'_, N, X, T, B>>(root, flight, rays, occluded) }
            }

            // SAFETY: as above.
            $(#[$feature])*
            unsafe fn packet_closest<N, const B: usize, F, X, T>(
                root: &Root,
                start: NodeRef,
                below: ClosestBelow,
                bundle: &Bundle,
                active: u32,
                hits: &mut Hits,
            ) where
                N: Planes,
                F: Order,
                X: PacketBoxes<N>,
                T: PacketBlocks<X::Rays, B>,
            {
                // SAFETY: what the caller promises is what this asks for.
                unsafe {
                    let tree = BlockTree { root, closest: Some(below), occluded: None };
                    packet::closest::<N, F, X, PacketBlockLeaves<'_, X::Rays, T, B>>(
                        root, start, bundle, active, T::classes(bundle), tree, hits,
                    );
                }
            }

            // SAFETY: as above.
            $(#[$feature])*
            unsafe fn packet_occluded<N, const B: usize, F, X, T>(
                root: &Root,
                start: NodeRef,
                below: OccludedBelow,
                bundle: &Bundle,
                active: u32,
                ends: &Stored,
            ) -> u32
            where
                N: Planes,
                F: Order,
                X: PacketBoxes<N>,
                T: PacketBlocks<X::Rays, B>,
            {
                // SAFETY: what the caller promises is what this asks for.
                unsafe {
                    let tree = BlockTree { root, closest: None, occluded: Some(below) };
                    packet::occluded::<N, F, X, PacketBlockLeaves<'_, X::Rays, T, B>>(
                        root, start, bundle, active, T::classes(bundle), tree, ends,
                    )
                }
            }

            // SAFETY: the kernels are those of the tree, else as above.
            $(#[$feature])*
            unsafe fn rays_closest(kernels: &Kernels, root: &Root, rays: &[Ray], hits: &mut [Option<Hit>]) {
                packet::closest_each(rays, hits, |bundle, active, hits| {
                    // SAFETY: what the caller promises is what this asks for.
                    unsafe { (kernels.packet_closest)(root, root.node, kernels.closest, bundle, active, hits) }
                });
            }

            // SAFETY: as above.
            $(#[$feature])*
            unsafe fn rays_occluded(kernels: &Kernels, root: &Root, rays: &[Ray], occluded: &mut [bool]) {
                packet::occluded_each(rays, occluded, |bundle, active, ends| {
                    // SAFETY: what the caller promises is what this asks for.
                    unsafe { (kernels.packet_occluded)(root, root.node, kernels.occluded, bundle, active, ends) }
                });
            }

            // SAFETY: for these, the caller has the processor features and what `LevelKernels` asks for.
            $(#[$feature])*
            unsafe fn level_closest<X: Boxes<Node<LEVEL_WIDTH>>>(
                root: &Root,
                lower: &Lower,
                start: NodeRef,
                ray: &Ray,
                hit: &mut Hit,
            ) {
                // SAFETY: what the caller promises is what this asks for.
                unsafe { kernel::closest::<_, X, _>(root, start, ray, &PlacedLeaves { lower, ray }, hit) }
            }

            // SAFETY: as above.
            $(#[$feature])*
            unsafe fn level_occluded<X: Boxes<Node<LEVEL_WIDTH>>>(
                root: &Root,
                lower: &Lower,
                start: NodeRef,
                ray: &Ray,
            ) -> bool {
                // SAFETY: what the caller promises is what this asks for.
                unsafe { kernel::occluded::<_, X, _>(root, start, ray, &PlacedLeaves { lower, ray }) }
            }

            fn level_tree<'a, X: Boxes<Node<LEVEL_WIDTH>>>(root: &'a Root, lower: &'a Lower) -> LevelTree<'a> {
                LevelTree { root, lower, closest: level_closest::<X>, occluded: level_occluded::<X> }
            }

            // SAFETY: as above.
            $(#[$feature])*
            unsafe fn level_rays_closest<F: Order, X, P>(
                root: &Root,
                lower: &Lower,
                rays: &[Ray],
                hits: &mut [Option<Hit>],
            ) where
                X: Boxes<Node<LEVEL_WIDTH>>,
                P: PacketBoxes<Node<LEVEL_WIDTH>>,
            {
                let tree = level_tree::<X>(root, lower);
                packet::closest_each(rays, hits, |bundle, active, hits| {
                    // SAFETY: what the caller promises is what this asks for.
                    unsafe {
                        packet::closest::<Node<LEVEL_WIDTH>, F, P, PacketPlacedLeaves<'_, P::Rays>>(
                            root, root.node, bundle, active, [0; 2], tree, hits,
                        );
                    }
                });
            }

            // SAFETY: as above.
            $(#[$feature])*
            unsafe fn level_rays_occluded<F: Order, X, P>(
                root: &Root,
                lower: &Lower,
                rays: &[Ray],
                occluded: &mut [bool],
            ) where
                X: Boxes<Node<LEVEL_WIDTH>>,
                P: PacketBoxes<Node<LEVEL_WIDTH>>,
            {
                let tree = level_tree::<X>(root, lower);
                packet::occluded_each(rays, occluded, |bundle, active, ends| {
                    // SAFETY: what the caller promises is what this asks for.
                    unsafe {
                        packet::occluded::<Node<LEVEL_WIDTH>, F, P, PacketPlacedLeaves<'_, P::Rays>>(
                            root, root.node, bundle, active, [0; 2], tree, ends,
                        )
                    }
                });
            }

            /// `F` has a lane for each child, `T` one for each triangle of a block.
            const fn fast<N: Planes, const B: usize, F: Order, T: Lanes>() -> Kernels {
                Kernels {
                    closest: closest::<N, B, FastBoxes<F>, FastBlocks<T>>,
                    occluded: occluded::<N, B, FastBoxes<F>, FastBlocks<T>>,
                    flight_closest: flight_closest::<N, B, FastBoxes<F>, FastBlocks<T>>,
                    flight_occluded: flight_occluded::<N, B, FastBoxes<F>, FastBlocks<T>>,
                    packet_closest: packet_closest::<N, B, F, FastPacket<$sixteen>, FastRays<$sixteen>>,
                    packet_occluded: packet_occluded::<N, B, F, FastPacket<$sixteen>, FastRays<$sixteen>>,
                    rays_closest,
                    rays_occluded,
                }
            }

            const fn watertight<N: Planes, const B: usize, F: Order, T: Lanes>() -> Kernels {
                Kernels {
                    closest: closest::<N, B, PaddedBoxes<F>, WatertightBlocks<T>>,
                    occluded: occluded::<N, B, PaddedBoxes<F>, WatertightBlocks<T>>,
                    flight_closest: flight_closest::<N, B, PaddedBoxes<F>, WatertightBlocks<T>>,
                    flight_occluded: flight_occluded::<N, B, PaddedBoxes<F>, WatertightBlocks<T>>,
                    packet_closest:
                        packet_closest::<N, B, F, PaddedPacket<$sixteen>, WatertightRays<$sixteen>>,
                    packet_occluded:
                        packet_occluded::<N, B, F, PaddedPacket<$sixteen>, WatertightRays<$sixteen>>,
                    rays_closest,
                    rays_occluded,
                }
            }

            /// For the upper level, whose boxes have room for rounding or not, as those below.
            pub(super) fn level(robust: bool) -> Option<LevelKernels> {
                type Fast = FastBoxes<$eight>;
                type Padded = PaddedBoxes<$eight>;
                Some(match robust {
                    false => LevelKernels {
                        closest: level_closest::<Fast>,
                        occluded: level_occluded::<Fast>,
                        rays_closest: level_rays_closest::<$eight, Fast, FastPacket<$sixteen>>,
                        rays_occluded: level_rays_occluded::<$eight, Fast, FastPacket<$sixteen>>,
                    },
                    true => LevelKernels {
                        closest: level_closest::<Padded>,
                        occluded: level_occluded::<Padded>,
                        rays_closest: level_rays_closest::<$eight, Padded, PaddedPacket<$sixteen>>,
                        rays_occluded: level_rays_occluded::<$eight, Padded, PaddedPacket<$sixteen>>,
                    },
                })
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
                match parameters.branching_factor {
                    2 => blocks::<Node<2>, $two>(parameters),
                    4 => blocks::<Node<4>, $four>(parameters),
                    8 => blocks::<Node<8>, $eight>(parameters),
                    16 => blocks::<Node<16>, $sixteen>(parameters),
                    _ => None,
                }
            }
        }
    };
}

#[cfg(kernels_scalar)]
compile!(scalar, lanes::Portable<2>, lanes::Portable<4>, lanes::Portable<8>, lanes::Portable<16>);
#[cfg(all(target_arch = "x86_64", kernels_avx2))]
compile!(
    #[target_feature(enable = "avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    avx2,
    lanes::avx2::Two,
    lanes::avx2::Four,
    lanes::avx2::Eight,
    lanes::avx2::Sixteen
);
#[cfg(all(target_arch = "x86_64", kernels_avx512))]
compile!(
    #[target_feature(enable = "avx512f,avx512vl,avx512dq,avx512bw,avx2,fma,bmi1,bmi2,lzcnt,popcnt")]
    avx512,
    lanes::avx512::Two,
    lanes::avx512::Four,
    lanes::avx512::Eight,
    lanes::avx512::Sixteen
);

/// The answer of an instruction set's module; `None` where it is not available.
macro_rules! of_isa {
    ($isa:expr, $query:ident($parameter:expr)) => {
        match $isa {
            _ if !$isa.is_available() => None,
            #[cfg(kernels_scalar)]
            Isa::Scalar => scalar::$query($parameter),
            #[cfg(all(target_arch = "x86_64", kernels_avx2))]
            Isa::Avx2 => avx2::$query($parameter),
            #[cfg(all(target_arch = "x86_64", kernels_avx512))]
            Isa::Avx512 => avx512::$query($parameter),
            #[allow(
                unreachable_patterns,
                reason = "some are left out on other processors or by the build script"
            )]
            _ => None,
        }
    };
}

impl Kernels {
    /// The functions for trees of these parameters; `None` where `isa` or the tree is not available.
    pub(crate) fn select(isa: Isa, parameters: &TreeParameters) -> Option<Self> {
        of_isa!(isa, select(parameters))
    }
}

impl LevelKernels {
    /// The functions for an upper level, or `None` where `isa` is not available.
    pub(crate) fn select(isa: Isa, robust: bool) -> Option<Self> {
        of_isa!(isa, level(robust))
    }
}
