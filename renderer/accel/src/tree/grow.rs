//! One call of `rtcBuildBVH`.
//!
//! The effect of the parameters in Embree (seen in its builders):
//! * a set of at most `min_leaf_size` triangles becomes a leaf at once; smaller leaves arise where a larger
//!   set is split;
//! * no leaf exceeds `max_leaf_size`; the SAH builders make a leaf of a set between the two limits when
//!   the heuristic says so, the Morton builder only where it nears the depth limit;
//! * eight levels above `max_depth` the heuristic stops and sets are halved until they fit a leaf; a
//!   branch that would still pass the limit fails the build.

use std::{ffi::c_void, sync::atomic::Ordering};

use rayon::prelude::*;

use super::callbacks::{Context, split_callback};
use crate::embree::{Device, ffi};
use crate::parameters::{Quality, TreeParameters};
use crate::{error::BuildError, geometry::Triangles, layout::Bounds, traverse::Isa};

/// Fewest triangles that are worth a task of their own while references are made.
const REFERENCES_PER_TASK: usize = 16_384;

/// Embree's `RTCBVH`: the memory of what a builder makes. The device outlives it.
#[derive(Debug)]
pub(super) struct EmbreeMemory {
    handle: ffi::RTCBVH,
    device: Device,
}

// SAFETY: it is only held while a tree is used, and Embree releases from any thread.
unsafe impl Send for EmbreeMemory {}
// SAFETY: as above.
unsafe impl Sync for EmbreeMemory {}

impl EmbreeMemory {
    pub(super) fn new(device: &Device) -> Result<Self, BuildError> {
        // SAFETY: the device is valid.
        let handle = unsafe { ffi::rtcNewBVH(device.handle()) };
        device.check()?;
        Ok(Self { handle, device: device.clone() })
    }
}

impl Drop for EmbreeMemory {
    fn drop(&mut self) {
        // SAFETY: the handle is valid and ours, and no reference into its nodes outlives the tree.
        unsafe { ffi::rtcReleaseBVH(self.handle) };
    }
}

/// The functions that make nodes and leaves, all for one kind of node.
pub(super) struct Callbacks {
    pub(super) create_node: ffi::RTCCreateNodeFunction,
    pub(super) set_children: ffi::RTCSetNodeChildrenFunction,
    pub(super) set_bounds: ffi::RTCSetNodeBoundsFunction,
    pub(super) create_leaf: ffi::RTCCreateLeafFunction,
}

/// Runs the builder over at least one of the [`references`] and gives the root, as the callbacks made it, in
/// `memory`. Builders that split, and callbacks that fill leaves, take them for `triangles`.
///
/// # Safety
/// The callbacks take a [`Context`] and nodes of `parameters.branching_factor` children.
pub(super) unsafe fn grow(
    memory: &EmbreeMemory,
    triangles: &Triangles,
    mut primitives: Vec<ffi::RTCBuildPrimitive>,
    parameters: &TreeParameters,
    callbacks: &Callbacks,
) -> Result<*mut c_void, BuildError> {
    let context = Context::new(triangles, parameters.robust);
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
        createNode: callbacks.create_node,
        setNodeChildren: callbacks.set_children,
        setNodeBounds: callbacks.set_bounds,
        createLeaf: callbacks.create_leaf,
        splitPrimitive: split_callback(Isa::detect()),
        buildProgress: None,
        userPtr: (&raw const context).cast_mut().cast(),
    };
    // SAFETY: the arguments are valid; the caller vouches for callbacks; all outlive the call.
    let root = unsafe { ffi::rtcBuildBVH(&raw const arguments) };
    let outcome = memory.device.check();
    if context.panicked.load(Ordering::Relaxed) {
        return Err(BuildError::CallbackPanicked);
    }
    if context.out_of_memory.load(Ordering::Relaxed) {
        return Err(BuildError::OutOfMemory);
    }
    match outcome {
        Err(failure) if failure.is_depth_limit() => Err(BuildError::DepthLimit(parameters.max_depth)),
        Err(failure) => Err(failure.into()),
        Ok(()) if root.is_null() => {
            Err(BuildError::Embree(ffi::ERROR_UNKNOWN, "the builder gave no root and no reason".into()))
        }
        Ok(()) => Ok(root),
    }
}

/// The finite boxes to build over, with spare room behind them where the builder splits.
pub(super) fn references(
    count: usize,
    parameters: &TreeParameters,
    bounds: impl Fn(usize) -> Bounds + Sync,
) -> Result<Vec<ffi::RTCBuildPrimitive>, BuildError> {
    let capacity = match parameters.quality {
        Quality::SahSplit => (count as f64 * f64::from(parameters.split_budget)).ceil() as usize,
        Quality::Morton | Quality::Sah => count,
    };
    let mut primitives = Vec::new();
    primitives.try_reserve_exact(capacity).map_err(|_| BuildError::OutOfMemory)?;
    (0..count)
        .into_par_iter()
        .with_min_len(REFERENCES_PER_TASK)
        .map(|number| {
            let Bounds { lower, upper } = bounds(number);
            ffi::RTCBuildPrimitive {
                lower_x: lower[0],
                lower_y: lower[1],
                lower_z: lower[2],
                geomID: 0,
                upper_x: upper[0],
                upper_y: upper[1],
                upper_z: upper[2],
                primID: number as u32,
            }
        })
        .collect_into_vec(&mut primitives);
    Ok(primitives)
}
