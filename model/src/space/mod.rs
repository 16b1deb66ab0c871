//! Typed parameter spaces: parameters, domains, conditions and constraints.
//!
//! A [`Space`] is checked once, when it is made. From then on every [`Configuration`] that it makes is valid.
//! `check` holds the rules. `domain` maps one domain to the unit interval. `builder` is the interface for
//! programs. `constraint` has the language of constraints. `complete` completes some values to a
//! configuration. `codec` maps whole configurations to the unit cube in which searches work.
//!
//! Points of the cube that break constraints are repaired: `repair` does it where all are orders of two
//! parameters, `nearest` where there are expressions. `group` has the parameters that constraints connect,
//! `listing` all solutions where these are few.
//!
//! A study's space may be changed. `revisions` reads the configurations of its earlier spaces.

mod builder;
mod check;
mod codec;
mod complete;
#[cfg(test)]
mod constrained;
mod constraint;
mod domain;
mod group;
mod listing;
mod nearest;
mod partial;
mod repair;
mod revisions;
#[cfg(test)]
mod tests;

use std::fmt;
use std::sync::Arc;

use serde::{Deserialize, Serialize};
use thiserror::Error;

pub use builder::{BooleanParameter, CategoricalParameter, FloatParameter, IntegerParameter, SpaceBuilder};
pub use constraint::{Constraint, ConstraintError};
pub use revisions::{EarlierSpace, EarlierSpaces};

use crate::configuration::{Configuration, RawConfiguration};
use crate::space::constraint::{Extent, Node};
use crate::space::group::Group;
use crate::value::Value;

/// The map of a numeric range to the unit interval.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Scale {
    /// Equal differences are equal steps.
    #[default]
    Linear,
    /// Equal ratios are equal steps. The lower bound of a parameter must be positive.
    Log,
}

/// The values that a parameter may have.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Domain {
    /// Whole numbers `min` to `max`, both included; within -2^53 to 2^53.
    Integer {
        /// Smallest value.
        min: i64,
        /// Largest value, at least `min`.
        max: i64,
        /// Spread over the unit interval.
        scale: Scale,
    },
    /// Finite numbers `min` to `max`, both included.
    Float {
        /// Smallest value.
        min: f64,
        /// Largest value, at least `min`.
        max: f64,
        /// Spread over the unit interval.
        scale: Scale,
    },
    /// One of 1 to 64 distinct values of one kind: integers or floats, which are ordered by size, or text,
    /// which has no order.
    Categorical {
        /// The choices.
        values: Vec<Value>,
    },
    /// `false` or `true`.
    Boolean,
}

/// Holds while the named parameter is active and has one of the values.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Condition {
    /// A parameter that is listed earlier.
    pub parameter: String,
    /// 1 to 64 values of its domain.
    pub any_of: Vec<Value>,
}

/// One tunable.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// 1 to 64 letters and digits of any script, `_`, `-` and `.`, beginning with a letter or `_`.
    pub name: String,
    /// The values that it may have.
    pub domain: Domain,
    /// The recommended value, inside the domain: the baseline of all comparisons.
    pub default: Value,
    /// The parameter exists only while this holds.
    pub active_if: Option<Condition>,
    /// A change of it needs a set-up, such as a build, a compilation or an import; that of all others only a
    /// run.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub setup: bool,
}

impl Parameter {
    /// A parameter that is always active, and needs no set-up.
    pub fn new(name: impl Into<String>, domain: Domain, default: impl Into<Value>) -> Self {
        Self { name: name.into(), domain, default: default.into(), active_if: None, setup: false }
    }

    /// Whether it is active, with the values of those before it.
    fn is_active(&self, values: &RawConfiguration) -> bool {
        self.active_if.as_ref().is_none_or(|condition| {
            values.get(&condition.parameter).is_some_and(|value| condition.any_of.contains(value))
        })
    }
}

/// The parameters and the relations between them, checked.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(try_from = "SpaceParts", into = "SpaceParts")]
pub struct Space {
    parameters: Vec<Parameter>,
    constraints: Vec<Constraint>,
    /// For each parameter, the index of the parameter its condition names.
    condition_of: Vec<Option<usize>>,
    /// The constraints, over indices of parameters.
    rules: Vec<Rule>,
    /// The parameters that constraints connect; none where all constraints are orders.
    groups: Arc<[Group]>,
    /// The possible values of each parameter.
    ranges: Vec<Extent<'static>>,
    default: Configuration,
    /// The default values' coordinates.
    default_point: Vec<f64>,
}

/// A constraint over indices of parameters.
#[derive(Clone, Debug)]
struct Rule {
    root: Node<usize>,
    /// The parameters that it names.
    mentions: Vec<usize>,
    /// The two parameters, the lesser first, where it is an order of two ranges.
    order: Option<(usize, usize)>,
}

/// All other fields follow from these two.
impl PartialEq for Space {
    fn eq(&self, other: &Self) -> bool {
        self.parameters == other.parameters && self.constraints == other.constraints
    }
}

#[derive(Serialize, Deserialize)]
struct SpaceParts {
    parameters: Vec<Parameter>,
    constraints: Vec<Constraint>,
}

/// Why a space or a configuration is refused: names the parameter or the constraint, the mistake and its
/// remedy.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{0}")]
pub struct SpaceError(String);

impl SpaceError {
    fn of_count(what: &str, count: usize, least: usize, most: usize) -> Self {
        Self(format!("the space has {count} {what}; {least} to {most} are allowed"))
    }

    fn of_parameter(parameter: &str, problem: impl fmt::Display) -> Self {
        Self(format!("parameter {parameter:?}{problem}"))
    }

    fn of_value(parameter: &Parameter, value: &Value) -> Self {
        let allowed = &parameter.domain;
        Self::of_parameter(&parameter.name, format!(" is {value}; it must be {allowed}"))
    }

    fn of_constraint(constraint: &Constraint, problem: impl fmt::Display) -> Self {
        Self(format!("constraint `{constraint}`: {problem}"))
    }

    /// A configuration of an earlier revision is not one of the present space.
    pub fn outside(revision: u32) -> Self {
        Self(format!(
            "the configuration of revision {revision} is outside the space that the study has by now; open the \
             study with its present space"
        ))
    }
}

impl From<ConstraintError> for SpaceError {
    fn from(error: ConstraintError) -> Self {
        Self(error.to_string())
    }
}

/// `split = sah or median`.
impl fmt::Display for Condition {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let values: Vec<String> = self.any_of.iter().map(Value::to_string).collect();
        write!(f, "{} = {}", self.parameter, values.join(" or "))
    }
}

impl fmt::Display for Domain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let log = |scale: &Scale| if *scale == Scale::Log { ", log scale" } else { "" };
        match self {
            Domain::Integer { min, max, scale } => {
                write!(f, "a whole number from {min} to {max}{}", log(scale))
            }
            Domain::Float { min, max, scale } => write!(f, "a number from {min} to {max}{}", log(scale)),
            Domain::Categorical { values } => {
                let values: Vec<String> = values.iter().map(Value::to_string).collect();
                write!(f, "one of {}", values.join(", "))
            }
            Domain::Boolean => f.write_str("true or false"),
        }
    }
}

impl Space {
    /// Begins a space.
    pub fn builder() -> SpaceBuilder {
        SpaceBuilder::new()
    }

    /// The parameters in order.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// The constraints in order.
    pub fn constraints(&self) -> &[Constraint] {
        &self.constraints
    }

    /// A parameter.
    pub fn parameter(&self, name: &str) -> Option<&Parameter> {
        self.parameters.iter().find(|parameter| parameter.name == name)
    }

    /// The parameters whose changes need a set-up, in order.
    pub fn setup_parameters(&self) -> impl Iterator<Item = &Parameter> {
        self.parameters.iter().filter(|parameter| parameter.setup)
    }

    /// The part of a configuration whose changes need a set-up. Inactive parameters are not in it.
    pub fn setup_part(&self, values: &RawConfiguration) -> RawConfiguration {
        let part = self.setup_parameters().filter_map(|parameter| values.get_key_value(&parameter.name));
        part.map(|(name, value)| (name.clone(), value.clone())).collect()
    }

    /// The number of coordinates of a point: one per parameter, active or not.
    pub fn dimension(&self) -> usize {
        self.parameters.len()
    }

    /// Whether a configuration of unknown origin is one of this space.
    pub fn owns(&self, configuration: &Configuration) -> bool {
        self.configuration(configuration.to_raw()).is_ok_and(|own| own == *configuration)
    }

    /// The recommended configuration: the baseline.
    pub fn default_configuration(&self) -> Configuration {
        self.default.clone()
    }

    /// The default configuration, by reference.
    pub fn default_ref(&self) -> &Configuration {
        &self.default
    }
}

impl TryFrom<SpaceParts> for Space {
    type Error = SpaceError;

    fn try_from(parts: SpaceParts) -> Result<Self, SpaceError> {
        Space::new(parts.parameters, parts.constraints)
    }
}

impl From<Space> for SpaceParts {
    fn from(space: Space) -> Self {
        SpaceParts { parameters: space.parameters, constraints: space.constraints }
    }
}
