//! Rays through the tree: one algorithm, compiled for each kind of tree and instruction set.
//!
//! [`kernel`] walks the tree. In [`flight`] several rays take turns. [`boxes`] tests a node's children,
//! [`triangles`] and [`watertight`] a leaf's blocks, over the vectors of [`lanes::Lanes`]. [`compile`]
//! compiles them for each instruction set and picks functions when a tree is built.

mod boxes;
mod compile;
pub(crate) mod count;
mod flight;
mod isa;
mod kernel;
mod lanes;
mod packet;
pub(crate) mod placed;
mod stack;
mod triangles;
mod watertight;

pub use count::Visits;
pub use isa::{Isa, Work};

use self::packet::bundle::{Bundle, Hits};
use self::{lanes::Stored, placed::Lower};
use crate::geometry::{Hit, Packets, Ray};
use crate::layout::{NodeRef, Root};
use crate::rays::one_by_one;

/// Replaces a hit by a nearer one below a node, if there is one.
type ClosestBelow = unsafe fn(&Root, NodeRef, &Ray, &mut Hit);

/// Whether a ray hits a triangle below a node.
type OccludedBelow = unsafe fn(&Root, NodeRef, &Ray) -> bool;

/// The closest hits of the active rays of a packet.
type PacketClosest = unsafe fn(&Root, NodeRef, ClosestBelow, &Bundle, u32, &mut Hits);

/// Which of the active rays of a packet, which end there, hit anything below a node.
type PacketOccluded = unsafe fn(&Root, NodeRef, OccludedBelow, &Bundle, u32, &Stored) -> u32;

/// Both for the upper level of two.
type LevelClosest = unsafe fn(&Root, &Lower, NodeRef, &Ray, &mut Hit);
type LevelOccluded = unsafe fn(&Root, &Lower, NodeRef, &Ray) -> bool;

/// The queries over one kind of tree.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Kernels {
    closest: ClosestBelow,
    occluded: OccludedBelow,
    /// For any number of rays; the `usize` is the number of them in flight at most.
    flight_closest: unsafe fn(&Root, usize, &[Ray], &mut [Option<Hit>]),
    flight_occluded: unsafe fn(&Root, usize, &[Ray], &mut [bool]),
    packet_closest: PacketClosest,
    packet_occluded: PacketOccluded,
    /// For up to [`packet::PACKET`] rays.
    rays_closest: unsafe fn(&Kernels, &Root, &[Ray], &mut [Option<Hit>]),
    rays_occluded: unsafe fn(&Kernels, &Root, &[Ray], &mut [bool]),
}

/// The queries over the upper level of two. Its nodes have eight children, with any width below.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LevelKernels {
    closest: LevelClosest,
    occluded: LevelOccluded,
    rays_closest: unsafe fn(&Root, &Lower, &[Ray], &mut [Option<Hit>]),
    rays_occluded: unsafe fn(&Root, &Lower, &[Ray], &mut [bool]),
}

/// Children a node of the upper level.
pub(crate) const LEVEL_WIDTH: usize = 8;

impl Kernels {
    /// The nearest hit.
    ///
    /// # Safety
    /// The tree is of the kind the kernels were selected for, and lives. So for the functions below.
    #[inline(always)]
    pub(crate) unsafe fn closest(&self, root: &Root, ray: &Ray) -> Option<Hit> {
        let mut hit = Hit::none(ray.t_max);
        // SAFETY: the caller vouches for the tree; the selected kernels suit the processor.
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

    /// The nearest hit of each ray. Rays are packed only if `packets` calls them coherent: others part at
    /// once and go alone, but in turns.
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
        if let Some(flight) = in_flight(packets) {
            // SAFETY: as above.
            return unsafe { (self.flight_closest)(root, flight, rays, hits) };
        }
        // SAFETY: as above.
        let alone = |ray: &Ray| unsafe { self.closest(root, ray) };
        // SAFETY: as above.
        let packed =
            |rays: &[Ray], hits: &mut [Option<Hit>]| unsafe { (self.rays_closest)(self, root, rays, hits) };
        each(packets, rays, hits, alone, packed);
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
        if let Some(flight) = in_flight(packets) {
            // SAFETY: as above.
            return unsafe { (self.flight_occluded)(root, flight, rays, occluded) };
        }
        // SAFETY: as above.
        let alone = |ray: &Ray| unsafe { self.occluded(root, ray) };
        // SAFETY: as above.
        let packed =
            |rays: &[Ray], occluded: &mut [bool]| unsafe { (self.rays_occluded)(self, root, rays, occluded) };
        each(packets, rays, occluded, alone, packed);
    }
}

impl LevelKernels {
    /// The nearest hit.
    ///
    /// # Safety
    /// The upper level has nodes of [`LEVEL_WIDTH`] children and leaves of placed parts, whose nodes are of
    /// the objects in `lower`. Its kernels are those of the objects' trees. All of them live. So for the
    /// functions below.
    #[inline(always)]
    pub(crate) unsafe fn closest(&self, root: &Root, lower: &Lower, ray: &Ray) -> Option<Hit> {
        let mut hit = Hit::none(ray.t_max);
        // SAFETY: the caller vouches for the trees; the selected kernels suit the processor.
        unsafe { (self.closest)(root, lower, root.node, ray, &mut hit) };
        hit.found()
    }

    /// Whether anything is hit.
    ///
    /// # Safety
    /// As for [`LevelKernels::closest`].
    #[inline(always)]
    pub(crate) unsafe fn occluded(&self, root: &Root, lower: &Lower, ray: &Ray) -> bool {
        // SAFETY: as above.
        unsafe { (self.occluded)(root, lower, root.node, ray) }
    }

    /// The nearest hit of each ray, packed as in [`Kernels::closest_each`]. Others go alone, one by one.
    ///
    /// # Safety
    /// As for [`LevelKernels::closest`].
    pub(crate) unsafe fn closest_each(
        &self,
        root: &Root,
        lower: &Lower,
        packets: Packets,
        rays: &[Ray],
        hits: &mut [Option<Hit>],
    ) {
        // SAFETY: as above.
        let alone = |ray: &Ray| unsafe { self.closest(root, lower, ray) };
        // SAFETY: as above.
        let packed =
            |rays: &[Ray], hits: &mut [Option<Hit>]| unsafe { (self.rays_closest)(root, lower, rays, hits) };
        each(packets, rays, hits, alone, packed);
    }

    /// Whether anything is hit, for each ray, packed as in [`Kernels::closest_each`].
    ///
    /// # Safety
    /// As for [`LevelKernels::closest`].
    pub(crate) unsafe fn occluded_each(
        &self,
        root: &Root,
        lower: &Lower,
        packets: Packets,
        rays: &[Ray],
        occluded: &mut [bool],
    ) {
        // SAFETY: as above.
        let alone = |ray: &Ray| unsafe { self.occluded(root, lower, ray) };
        // SAFETY: as above.
        let packed = |rays: &[Ray], occluded: &mut [bool]| unsafe {
            (self.rays_occluded)(root, lower, rays, occluded)
        };
        each(packets, rays, occluded, alone, packed);
    }
}

/// How many rays are in flight, where rays go alone but in turns.
fn in_flight(packets: Packets) -> Option<usize> {
    match packets {
        Packets::Four => Some(4),
        Packets::Eight | Packets::Sixteen => Some(flight::FLIGHT_MAX),
        Packets::Single | Packets::EightCoherent | Packets::SixteenCoherent => None,
    }
}

/// One answer a ray, from rays alone or from packets of them.
#[inline(always)]
fn each<T>(
    packets: Packets,
    rays: &[Ray],
    answers: &mut [T],
    alone: impl Fn(&Ray) -> T,
    packed: impl Fn(&[Ray], &mut [T]),
) {
    assert_eq!(rays.len(), answers.len(), "one answer a ray");
    let together = match packets {
        Packets::Single | Packets::Four | Packets::Eight | Packets::Sixteen => {
            return one_by_one(rays, answers, alone);
        }
        Packets::EightCoherent => 8,
        Packets::SixteenCoherent => packet::PACKET,
    };
    for (rays, answers) in rays.chunks(together).zip(answers.chunks_mut(together)) {
        packed(rays, answers);
    }
}
