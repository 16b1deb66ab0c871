//! Why a configuration cannot be used, in words that name the remedy.

use treewright_client::SpaceError;

/// Why a configuration cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ConfigurationError {
    /// Neither Embree nor the paper says how light is looked for, or how a structure follows.
    #[error(
        "this space has no such start; leave --start out, or name a file with a configuration of your own"
    )]
    NoSuchStart,
    /// Not of the form `name=value,name=value`.
    #[error("\"{part}\" is not of the form name=value; write for example quality=3,branching_factor=8")]
    Syntax {
        /// The part that cannot be read.
        part: String,
    },
    /// It does not fit the space.
    #[error("--space {space}: {problem}")]
    Space {
        /// Name of the space.
        space: &'static str,
        /// The value that does not fit, and the allowed ones.
        problem: SpaceError,
    },
    /// A parameter that is gone, with a value that nothing does any more.
    #[error(
        "{name}={value} is no longer there, for it made nothing faster; leave {name} out: it is always {kept}"
    )]
    Retired {
        /// The parameter.
        name: &'static str,
        /// The value that was asked for.
        value: String,
        /// The renderer's choice in its place.
        kept: String,
    },
    /// A range or a value that a parameter cannot be held to.
    #[error("{narrowing}: {problem}")]
    Narrowing {
        /// As it was asked for.
        narrowing: String,
        /// Why not.
        problem: String,
    },
}
