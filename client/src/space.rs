//! Parameter spaces: what can be tuned. A space is made with [`SpaceBuilder`] or read from a stored study.

use serde::Serialize;

use crate::{Configuration, SpaceBuilder, Value};

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
            let active = parameter.active_if.as_ref().is_none_or(|condition| {
                configuration
                    .get(&condition.parameter)
                    .is_some_and(|value| condition.any_of.contains(value))
            });
            if active {
                configuration.set(parameter.name.clone(), parameter.default.clone());
            }
        }
        configuration
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
        assert_eq!(
            space("median").default_configuration(),
            Configuration::new().with("split", "median")
        );
    }
}
