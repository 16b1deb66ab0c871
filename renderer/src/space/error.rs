//! Why a configuration cannot be used, in words that name the remedy.

/// Why a configuration cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ConfigurationError {
    /// Not of the form `name=value,name=value`.
    #[error("\"{part}\" is not of the form name=value; write for example quality=3,branching_factor=8")]
    Syntax {
        /// The part that cannot be read.
        part: String,
    },
    /// No parameter has this name.
    #[error("there is no parameter \"{name}\" in --space {space}; the parameters are {known}")]
    Unknown {
        /// The name given.
        name: String,
        /// Name of the space.
        space: &'static str,
        /// All names.
        known: String,
    },
    /// The value lies outside the parameter's domain.
    #[error("{name} cannot be {value}; it must be {domain}")]
    OutOfDomain {
        /// The parameter.
        name: String,
        /// The value given.
        value: String,
        /// What it may be.
        domain: String,
    },
    /// The parameter means nothing with the others as they are.
    #[error("{name} has no effect here: it needs {condition}; leave it out")]
    Inactive {
        /// The parameter.
        name: String,
        /// What it needs.
        condition: String,
    },
    /// Two parameters contradict each other.
    #[error("{lesser} ({low}) must not be above {greater} ({high})")]
    Constraint {
        /// Name of the parameter that should be the smaller one.
        lesser: String,
        /// Its value.
        low: String,
        /// Name of the parameter that should be the larger one.
        greater: String,
        /// Its value.
        high: String,
    },
}
