//! Parameter spaces: what can be tuned. A space is made with [`SpaceBuilder`] or read from a stored study.

use std::fmt;

use serde::Serialize;

use crate::{ClientError, Configuration, SpaceBuilder, Value};

/// How a numeric range is spread over the unit interval in which searches work.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Scale {
    /// Equal differences are equal steps.
    #[default]
    Linear,
    /// Equal ratios are equal steps. For parameters the lower bound must be positive.
    Log,
}

/// The values a parameter may have.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Domain {
    /// Whole numbers, both ends included.
    Integer {
        /// Smallest.
        min: i64,
        /// Largest.
        max: i64,
        /// Spread.
        scale: Scale,
    },
    /// Finite numbers, both ends included.
    Float {
        /// Smallest.
        min: f64,
        /// Largest.
        max: f64,
        /// Spread.
        scale: Scale,
    },
    /// One of a list, without an order of its own.
    Categorical {
        /// Distinct values of one kind.
        values: Vec<Value>,
    },
    /// `false` or `true`.
    Boolean,
}

/// Holds while the named parameter is active and has one of the values.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Condition {
    /// A parameter listed earlier.
    pub parameter: String,
    /// The values with which the condition holds.
    pub any_of: Vec<Value>,
}

/// One tunable.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Parameter {
    /// Its name, 1 to 64 characters of `a-z`, `0-9` and `_`.
    pub name: String,
    /// What it may be.
    pub domain: Domain,
    /// The recommended value.
    pub default: Value,
    /// When it exists; `None` is always.
    pub active_if: Option<Condition>,
}

/// `lesser <= greater`, while both parameters are active.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct Constraint {
    /// Name of the parameter that is not the larger one.
    pub lesser: String,
    /// Name of the parameter that is not the smaller one.
    pub greater: String,
}

/// The parameters and the relations between them.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Space {
    pub(crate) parameters: Vec<Parameter>,
    pub(crate) constraints: Vec<Constraint>,
}

impl Space {
    /// Begins a space.
    #[must_use]
    pub fn builder() -> SpaceBuilder {
        SpaceBuilder::new()
    }

    /// The parameters in their order.
    #[must_use]
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// The relations between parameters.
    #[must_use]
    pub fn constraints(&self) -> &[Constraint] {
        &self.constraints
    }

    /// The recommended value of every parameter that is active with the recommended values.
    #[must_use]
    pub fn default_configuration(&self) -> Configuration {
        let mut configuration = Configuration::new();
        for parameter in &self.parameters {
            if parameter.is_active_in(&configuration) {
                configuration.set(parameter.name.clone(), parameter.default.clone());
            }
        }
        configuration
    }

    /// A whole configuration from some values: the others are the recommended ones. Whole numbers are
    /// taken for float parameters, too, so that people may write `2` for `2.0`.
    ///
    /// Errors: [`ClientError::Invalid`] naming a value that is unknown, inactive or outside its domain, or
    /// the constraint that is broken.
    pub fn complete(&self, some: &Configuration) -> Result<Configuration, ClientError> {
        if let Some((name, _)) =
            some.iter().find(|(name, _)| self.parameters.iter().all(|known| known.name != *name))
        {
            let known: Vec<_> = self.parameters.iter().map(|parameter| parameter.name.as_str()).collect();
            let problem = format!("there is no such parameter; the space has {}", known.join(", "));
            return Err(ClientError::invalid(format!("parameter `{name}`"), problem));
        }
        let mut whole = Configuration::new();
        for parameter in &self.parameters {
            let what = || format!("parameter `{}`", parameter.name);
            let given = some.get(&parameter.name);
            if !parameter.is_active_in(&whole) {
                if given.is_some() {
                    let problem = "it does not exist beside the other values; leave it out";
                    return Err(ClientError::invalid(what(), problem));
                }
                continue;
            }
            let value = match (given, &parameter.domain) {
                (None, _) => parameter.default.clone(),
                #[allow(clippy::cast_precision_loss)] // a domain's bounds are checked below
                (Some(Value::Integer(value)), Domain::Float { .. }) => Value::Float(*value as f64),
                (Some(value), _) => value.clone(),
            };
            if !parameter.domain.contains(&value) {
                return Err(ClientError::invalid(what(), format!("{value} is not {}", parameter.domain)));
            }
            whole.set(parameter.name.clone(), value);
        }
        match self.broken_constraint(&whole) {
            Some((broken, problem)) => Err(ClientError::invalid(format!("constraint {broken}"), problem)),
            None => Ok(whole),
        }
    }

    /// The first constraint that a configuration breaks, with its two values.
    pub(crate) fn broken_constraint(&self, configuration: &Configuration) -> Option<(&Constraint, String)> {
        let number = |name: &str| match configuration.get(name) {
            #[allow(clippy::cast_precision_loss)] // integers are at most 2^53
            Some(Value::Integer(value)) => Some(*value as f64),
            Some(Value::Float(value)) => Some(*value),
            _ => None,
        };
        self.constraints.iter().find_map(|constraint| {
            let (low, high) = (number(&constraint.lesser)?, number(&constraint.greater)?);
            (low > high).then(|| (constraint, format!("it is broken: {low} > {high}")))
        })
    }
}

impl Parameter {
    /// Whether the parameter exists beside these values of earlier parameters.
    fn is_active_in(&self, earlier: &Configuration) -> bool {
        self.active_if.as_ref().is_none_or(|condition| {
            earlier.get(&condition.parameter).is_some_and(|value| condition.any_of.contains(value))
        })
    }
}

impl fmt::Display for Constraint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} <= {}", self.lesser, self.greater)
    }
}

impl fmt::Display for Domain {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let log = |scale: &Scale| {
            if *scale == Scale::Log { ", log scale" } else { "" }
        };
        match self {
            Self::Integer { min, max, scale } => {
                write!(f, "a whole number from {min} to {max}{}", log(scale))
            }
            Self::Float { min, max, scale } => {
                write!(f, "a number from {min} to {max}{}", log(scale))
            }
            Self::Categorical { values } => {
                let values: Vec<_> = values.iter().map(ToString::to_string).collect();
                write!(f, "one of {}", values.join(", "))
            }
            Self::Boolean => f.write_str("true or false"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_default_leaves_inactive_parameters_out() {
        let space = |split: &'static str| {
            Space::builder()
                .categorical("split", ["sah", "median"])
                .default(split)
                .integer("bins", 4..=64)
                .default(16)
                .active_if("split", ["sah"])
                .build()
                .unwrap()
        };
        assert_eq!(
            space("sah").default_configuration(),
            Configuration::new().with("split", "sah").with("bins", 16)
        );
        assert_eq!(space("median").default_configuration(), Configuration::new().with("split", "median"));
    }

    #[test]
    fn some_values_make_a_whole_configuration() {
        let space = Space::builder()
            .categorical("split", ["sah", "median"])
            .default("sah")
            .float("cost", 0.5..=4.0)
            .default(1.0)
            .active_if("split", ["sah"])
            .integer("low", 1..=9)
            .default(1)
            .integer("high", 1..=9)
            .default(5)
            .less_or_equal("low", "high")
            .build()
            .unwrap();
        let whole = space.complete(&Configuration::new().with("cost", 2)).unwrap();
        assert_eq!(whole.to_string(), "cost=2.0 high=5 low=1 split=sah");
        let whole = space.complete(&Configuration::new().with("split", "median")).unwrap();
        assert_eq!(whole.get("cost"), None);
        let problem = |some: Configuration| space.complete(&some).unwrap_err().to_string();
        assert!(
            problem(Configuration::new().with("colour", 1)).contains("the space has split, cost, low, high")
        );
        assert!(
            problem(Configuration::new().with("low", 10)).contains("10 is not a whole number from 1 to 9")
        );
        assert!(problem(Configuration::new().with("low", 6)).contains("low <= high: it is broken: 6 > 5"));
        assert!(
            problem(Configuration::new().with("split", "median").with("cost", 1)).contains("leave it out")
        );
    }
}
