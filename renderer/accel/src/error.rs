//! Why triangles were refused, or a structure was not built.

use crate::embree::ffi;
use crate::limits::{COORDINATE_MAX, MASK_EDGE_MAX, MASKS_MAX, TRIANGLES_MAX};

/// Why triangles were refused.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum GeometryError {
    /// An index names a vertex that does not exist.
    #[error("triangle {triangle} names vertex {vertex}, but there are only {vertices} vertices")]
    IndexOutOfRange {
        /// Number of the triangle.
        triangle: usize,
        /// The index it holds.
        vertex: u32,
        /// Number of vertices.
        vertices: usize,
    },
    /// A vertex with a coordinate that is NaN, infinite or too large for single-precision intersection.
    #[error("vertex {0} has a coordinate that is not finite or beyond ±{COORDINATE_MAX:e}")]
    BadCoordinate(usize),
    /// A mask without its pixels, or too large.
    #[error(
        "a mask of {width}x{height} pixels with {values} values: it takes one a pixel, at most {MASK_EDGE_MAX} an edge, and a cutoff from 0"
    )]
    BadMask {
        /// Pixels across.
        width: u32,
        /// Pixels down.
        height: u32,
        /// The number of values.
        values: usize,
    },
    /// A card names a triangle or a mask that does not exist.
    #[error("triangle {triangle} is to have mask {mask}, but one of them does not exist")]
    NoSuchMask {
        /// Number of the triangle.
        triangle: u32,
        /// Number of the mask.
        mask: u32,
    },
    /// More masks than the limit.
    #[error("{0} masks are more than the limit of {MASKS_MAX}")]
    TooManyMasks(usize),
    /// More triangles than the limit.
    #[error("{0} triangles are more than the limit of {TRIANGLES_MAX}")]
    TooMany(usize),
}

/// Why a structure was not built.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BuildError {
    /// A parameter is outside its range, or two contradict each other.
    #[error("{parameter} is {value}, but {rule}")]
    InvalidParameters {
        /// Name of the parameter.
        parameter: &'static str,
        /// The value, as text.
        value: String,
        /// The rule that it breaks.
        rule: &'static str,
    },
    /// The tree would be deeper than this limit, `max_depth`: mostly binary trees with small limits.
    #[error("the tree reached the depth limit of {0}: raise max_depth, branching_factor or max_leaf_size")]
    DepthLimit(u32),
    /// A structure was asked to follow triangles that are not its own.
    #[error("the structure has {before} triangles and cannot be updated to {now}: rebuild it")]
    OtherTriangles {
        /// Triangles it has.
        before: usize,
        /// Triangles it was given.
        now: usize,
    },
    /// A structure was asked to follow instances that do not place its objects in its order.
    #[error("the structure has other objects or instances and cannot be updated to these: rebuild it")]
    OtherInstances,
    /// Memory ran out.
    #[error("memory ran out while the structure was built")]
    OutOfMemory,
    /// Any other error of Embree, with its code and in its own words.
    #[error("Embree failed with error {0}: {1}")]
    Embree(u32, String),
    /// One of our own builder callbacks panicked; the panic's message went to standard error.
    #[error("a builder callback panicked: this is a defect of treewright-accel")]
    CallbackPanicked,
}

impl BuildError {
    /// Refuses triangles of another number.
    pub(crate) fn same_count(before: usize, now: usize) -> Result<(), Self> {
        if before == now { Ok(()) } else { Err(Self::OtherTriangles { before, now }) }
    }

    /// Whether this cannot work for this scene on this machine. Other errors are mistakes or defects.
    pub fn is_infeasible(&self) -> bool {
        matches!(self, Self::DepthLimit(_) | Self::OutOfMemory)
    }
}

impl From<EmbreeFailure> for BuildError {
    fn from(failure: EmbreeFailure) -> Self {
        match failure.code {
            ffi::ERROR_OUT_OF_MEMORY => Self::OutOfMemory,
            code => Self::Embree(code, failure.message),
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct EmbreeFailure {
    pub(crate) code: u32,
    pub(crate) message: String,
}

impl EmbreeFailure {
    /// Whether a builder ran into its depth limit, which has no code of its own.
    pub(crate) fn is_depth_limit(&self) -> bool {
        self.code == ffi::ERROR_UNKNOWN && self.message.contains("depth limit")
    }
}
