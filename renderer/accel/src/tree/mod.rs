//! The tunable tree: built by Embree's `rtcBuildBVH` or our own builder, optimised, collapsed to wide nodes
//! of least cost, in our own layout, and walked by our own kernels.

mod arena;
mod binary;
mod build;
mod callbacks;
mod clusters;
mod collapse;
mod emit;
mod grow;
mod level;
mod morton;
mod motion;
mod occlusion;
mod order;
mod outline;
mod plan;
mod ploc;
mod refit;
mod reinsertion;
mod sketch;
mod split;
mod statistics;
mod two_level;
mod validate;
mod walk;
mod write;

pub use statistics::TreeStatistics;
pub use two_level::TwoLevel;
pub use validate::TreeFault;

use crate::geometry::{Hit, Intersector, Packets, Ray};
use crate::layout::{Bounds, Root};
use crate::parameters::TreeParameters;
use crate::traverse::{Isa, Kernels, Visits, count};
use arena::Arena;
use grow::EmbreeMemory;

/// A tree over triangles, with the kernels that fit it and this machine.
#[derive(Debug)]
pub struct Tree {
    root: Root,
    kernels: Kernels,
    isa: Isa,
    parameters: TreeParameters,
    /// The memory of updates; `None` for a tree that was never updated.
    motion: Option<Box<motion::Motion>>,
    /// Owns every node and leaf.
    _memory: Memory,
}

/// The owner of the nodes and leaves. It is only held, to be dropped with the tree.
#[derive(Debug)]
#[allow(dead_code, reason = "held for the memory alone")]
enum Memory {
    /// There are none.
    None,
    /// Embree, whose builder made them.
    Embree(EmbreeMemory),
    /// We, in one block.
    Own(Arena),
    /// We, in one block or several for each thread that built.
    Slabs(Vec<Arena>),
}

impl Tree {
    pub(crate) fn bounds(&self) -> Bounds {
        self.root.bounds
    }

    /// The instruction set its kernels use.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// The visits of queries by these rays, any hit or the nearest. Takes some ten times the queries' time.
    pub fn visits(&self, rays: &[Ray], any: bool) -> Visits {
        // SAFETY: the parameters are those that the tree was built with.
        unsafe { count::visits(&self.root, &self.parameters, rays, any) }
    }

    /// This tree walked by another instruction set's kernels, or `None` if the processor lacks it.
    pub fn with_isa(mut self, isa: Isa) -> Option<Self> {
        self.kernels = Kernels::select(isa, &self.parameters)?;
        self.isa = isa;
        Some(self)
    }
}

impl Intersector for Tree {
    #[inline]
    fn closest(&self, ray: &Ray) -> Option<Hit> {
        // SAFETY: the kernels were selected for this tree's width and blocks and for this processor.
        unsafe { self.kernels.closest(&self.root, ray) }
    }

    #[inline]
    fn occluded(&self, ray: &Ray) -> bool {
        // SAFETY: as above.
        unsafe { self.kernels.occluded(&self.root, ray) }
    }

    fn closest_each(&self, packets: Packets, rays: &[Ray], hits: &mut [Option<Hit>]) {
        // SAFETY: as above.
        unsafe { self.kernels.closest_each(&self.root, packets, rays, hits) }
    }

    fn occluded_each(&self, packets: Packets, rays: &[Ray], occluded: &mut [bool]) {
        // SAFETY: as above.
        unsafe { self.kernels.occluded_each(&self.root, packets, rays, occluded) }
    }
}
