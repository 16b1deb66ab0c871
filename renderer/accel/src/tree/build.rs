//! From parameters to a tree: one call of `rtcBuildBVH`.
//!
//! What Embree makes of the parameters (seen in its builders):
//! * a set of at most `min_leaf_size` triangles becomes a leaf at once; leaves smaller than that arise all
//!   the same, when a larger set is split;
//! * no leaf exceeds `max_leaf_size`; the SAH builders make a leaf of a set between the two limits when
//!   the heuristic says so, the Morton builder only where it nears the depth limit;
//! * eight levels above `max_depth` the heuristic stops and sets are halved until they fit a leaf; a
//!   branch that would still pass the limit fails the build.

use std::sync::Arc;
use std::sync::atomic::Ordering;

use rayon::prelude::*;

use super::callbacks::{Context, create_leaf, create_node, set_bounds, set_children, split_callback};
use super::layout::{Block, Bounds, NodeRef, TreeNode, for_block, for_node};
use super::{Memory, Root, Tree};
use crate::embree::{Device, ffi};
use crate::error::BuildError;
use crate::geometry::Triangles;
use crate::parameters::{Quality, TreeParameters};
use crate::traverse::{Isa, Kernels};

/// Fewest triangles that are worth a task of their own while references are made.
const REFERENCES_PER_TASK: usize = 16_384;

impl Tree {
    /// Checks the parameters and builds.
    pub(crate) fn build(
        device: &Device,
        triangles: &Arc<Triangles>,
        parameters: &TreeParameters,
    ) -> Result<Self, BuildError> {
        parameters.check()?;
        let isa = Isa::detect();
        let kernels = Kernels::select(isa, parameters)
            .expect("the parameters were checked and the instruction set detected");
        // SAFETY: the device is valid.
        let memory = Memory { handle: unsafe { ffi::rtcNewBVH(device.handle()) }, _device: device.clone() };
        device.check()?;
        let node = match triangles.is_empty() {
            true => NodeRef::EMPTY,
            false => grow(device, &memory, triangles, parameters)?,
        };
        let bounds = root_bounds(node, parameters, triangles);
        let root = Root { node, bounds };
        Ok(Self {
            root,
            kernels,
            isa,
            parameters: *parameters,
            triangles: Arc::clone(triangles),
            _memory: memory,
        })
    }
}

/// Runs the builder and gives the root.
fn grow(
    device: &Device,
    memory: &Memory,
    triangles: &Triangles,
    parameters: &TreeParameters,
) -> Result<NodeRef, BuildError> {
    let mut primitives = references(triangles, parameters)?;
    let context = Context::new(triangles, parameters.robust);
    let (create, children, bounds) = for_node!(parameters, N => node_callbacks::<N>());
    let leaf: ffi::RTCCreateLeafFunction = for_block!(parameters, B => Some(create_leaf::<B>));
    let arguments = ffi::RTCBuildArguments {
        byteSize: size_of::<ffi::RTCBuildArguments>(),
        buildQuality: match parameters.quality {
            Quality::Morton => ffi::RTCBuildQuality::LOW,
            Quality::Sah => ffi::RTCBuildQuality::MEDIUM,
            Quality::SahSplit => ffi::RTCBuildQuality::HIGH,
        },
        buildFlags: if parameters.static_scene {
            ffi::RTCBuildFlags::NONE
        } else {
            ffi::RTCBuildFlags::DYNAMIC
        },
        // The Morton builder keeps a node's children in a fixed array of eight.
        maxBranchingFactor: match parameters.quality {
            Quality::Morton => parameters.branching_factor.min(8),
            Quality::Sah | Quality::SahSplit => parameters.branching_factor,
        },
        maxDepth: parameters.max_depth,
        sahBlockSize: parameters.sah_block_size,
        minLeafSize: parameters.min_leaf_size,
        maxLeafSize: parameters.max_leaf_size,
        traversalCost: parameters.traversal_cost,
        intersectionCost: parameters.intersection_cost,
        bvh: memory.handle,
        primitives: primitives.as_mut_ptr(),
        primitiveCount: primitives.len(),
        primitiveArrayCapacity: primitives.capacity(),
        createNode: create,
        setNodeChildren: children,
        setNodeBounds: bounds,
        createLeaf: leaf,
        splitPrimitive: split_callback(Isa::detect()),
        buildProgress: None,
        userPtr: (&raw const context).cast_mut().cast(),
    };
    // SAFETY: the arguments are valid and checked to lie where the builders are well behaved; the
    // callbacks fit the width; context and primitives outlive the call.
    let root = unsafe { ffi::rtcBuildBVH(&raw const arguments) };
    let outcome = device.check();
    if context.panicked.load(Ordering::Relaxed) {
        return Err(BuildError::CallbackPanicked);
    }
    if context.out_of_memory.load(Ordering::Relaxed) {
        return Err(BuildError::OutOfMemory);
    }
    match outcome {
        Err(failure) if failure.is_depth_limit() => {
            Err(BuildError::DepthLimit { max_depth: parameters.max_depth })
        }
        Err(failure) => Err(failure.into()),
        Ok(()) if root.is_null() => Err(BuildError::Embree {
            code: ffi::ERROR_UNKNOWN,
            message: "the builder gave no root and no reason".into(),
        }),
        Ok(()) => Ok(NodeRef::from_raw(root)),
    }
}

/// Embree's names for what makes and fills a node.
type NodeCallbacks =
    (ffi::RTCCreateNodeFunction, ffi::RTCSetNodeChildrenFunction, ffi::RTCSetNodeBoundsFunction);

fn node_callbacks<N: TreeNode>() -> NodeCallbacks {
    (Some(create_node::<N>), Some(set_children::<N>), Some(set_bounds::<N>))
}

/// One box a triangle, with spare room behind them where the builder splits. The coordinates are finite
/// by the invariant of [`Triangles`]; a NaN here would spoil other triangles' nodes without an error.
fn references(
    triangles: &Triangles,
    parameters: &TreeParameters,
) -> Result<Vec<ffi::RTCBuildPrimitive>, BuildError> {
    let count = triangles.len();
    let capacity = match parameters.quality {
        Quality::SahSplit => (count as f64 * f64::from(parameters.split_budget)).ceil() as usize,
        Quality::Morton | Quality::Sah => count,
    };
    let mut primitives = Vec::new();
    primitives.try_reserve_exact(capacity).map_err(|_| BuildError::OutOfMemory)?;
    (0..count)
        .into_par_iter()
        .with_min_len(REFERENCES_PER_TASK)
        .map(|triangle| {
            let Bounds { lower, upper } = Bounds::of_corners(&triangles.corners(triangle));
            ffi::RTCBuildPrimitive {
                lower_x: lower[0],
                lower_y: lower[1],
                lower_z: lower[2],
                geomID: 0,
                upper_x: upper[0],
                upper_y: upper[1],
                upper_z: upper[2],
                primID: triangle as u32,
            }
        })
        .collect_into_vec(&mut primitives);
    Ok(primitives)
}

/// Box of the whole tree, from the root alone.
fn root_bounds(node: NodeRef, parameters: &TreeParameters, triangles: &Triangles) -> Bounds {
    fn of_children<N: TreeNode>(node: NodeRef) -> Bounds {
        // SAFETY: the builder made this node of the kind `N`, and its memory lives.
        let node = unsafe { node.node::<N>() };
        (0..node.count()).map(|child| node.child_bounds(child)).fold(Bounds::EMPTY, Bounds::union)
    }
    fn of_blocks<const B: usize>(node: NodeRef, triangles: &Triangles) -> Bounds {
        // SAFETY: the builder made this leaf of blocks of width `B`, and its memory lives.
        let blocks = unsafe { node.blocks::<B>() };
        let numbers = blocks.iter().flat_map(Block::numbers);
        numbers
            .map(|number| Bounds::of_corners(&triangles.corners(number as usize)))
            .fold(Bounds::EMPTY, Bounds::union)
    }
    match node.is_leaf() {
        true => for_block!(parameters, B => of_blocks::<B>(node, triangles)),
        false => for_node!(parameters, N => of_children::<N>(node)),
    }
}
