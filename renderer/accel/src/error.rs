//! Why a structure was not built.

use crate::embree::device::EmbreeFailure;
use crate::embree::ffi;

/// Why a structure was not built.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum BuildError {
    /// A parameter is outside its range, or two contradict each other.
    #[error("{parameter} is {value}, but {rule}")]
    InvalidParameters {
        /// Name of the parameter.
        parameter: &'static str,
        /// What it was, as text.
        value: String,
        /// What it must be.
        rule: &'static str,
    },
    /// The tree would be deeper than `max_depth`. Depends on the scene: mostly binary trees with small limits.
    #[error(
        "the tree reached the depth limit of {max_depth}: raise max_depth, branching_factor or max_leaf_size"
    )]
    DepthLimit {
        /// The limit.
        max_depth: u32,
    },
    /// A structure was asked to follow triangles that are not its own.
    #[error("the structure has {before} triangles and cannot be updated to {now}: build it anew")]
    OtherTriangles {
        /// Triangles it has.
        before: usize,
        /// Triangles it was given.
        now: usize,
    },
    /// Memory ran out.
    #[error("memory ran out while the structure was built")]
    OutOfMemory,
    /// Any other error of Embree.
    #[error("Embree failed with error {code}: {message}")]
    Embree {
        /// Embree's error code.
        code: u32,
        /// Embree's own words.
        message: String,
    },
    /// One of our own builder callbacks panicked; the panic's message went to standard error.
    #[error("a builder callback panicked: this is a defect of treewright-accel")]
    CallbackPanicked,
}

impl BuildError {
    /// Refuses triangles of another number.
    pub(crate) fn same_count(before: usize, now: usize) -> Result<(), Self> {
        if before == now { Ok(()) } else { Err(Self::OtherTriangles { before, now }) }
    }

    /// Whether this configuration cannot work for this scene on this machine, so that a tuner should try
    /// another one. Everything else is a mistake of the caller or a defect.
    pub fn is_infeasible(&self) -> bool {
        matches!(self, Self::DepthLimit { .. } | Self::OutOfMemory)
    }
}

impl From<EmbreeFailure> for BuildError {
    fn from(failure: EmbreeFailure) -> Self {
        match failure.code {
            ffi::ERROR_OUT_OF_MEMORY => Self::OutOfMemory,
            code => Self::Embree { code, message: failure.message },
        }
    }
}
