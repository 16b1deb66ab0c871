//! The eleven parameters of the paper's Table 1 as a tuning space, and configurations of it as build choices.
//!
//! Two rules make parameters inactive: `compact` is Embree's own compact structure and has none of the
//! others but `robust` (section 4.1), and the Morton builder (quality 1) ignores the block size and both
//! costs (section 3.2). Leaves of more than 32 triangles overrun the builder, so the leaf sizes end there.

use treewright_accel::{BuildChoice, Quality, TreeParameters};
use treewright_client::{Configuration, Constraint, Domain, Parameter, Space, Value};

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
    #[error("there is no parameter \"{name}\"; the parameters are {known}")]
    Unknown {
        /// The name given.
        name: String,
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

/// The space of Table 1, with its recommended values as defaults.
pub fn table_1() -> Space {
    Space::builder()
        .boolean("compact")
        .default(false)
        .boolean("robust")
        .default(false)
        .integer("quality", 1..=3)
        .default(2)
        .active_if("compact", [false])
        .categorical("branching_factor", [2, 4, 8])
        .default(2)
        .active_if("compact", [false])
        .integer("max_depth", 9..=64)
        .default(32)
        .active_if("compact", [false])
        .categorical("sah_block_size", [1, 2, 4, 8, 16, 32])
        .default(1)
        .active_if("quality", [2, 3])
        .integer("min_leaf_size", 1..=32)
        .default(1)
        .active_if("compact", [false])
        .integer("max_leaf_size", 1..=32)
        .default(32)
        .active_if("compact", [false])
        .float("traversal_cost", 0.0..=10.0)
        .default(1.0)
        .active_if("quality", [2, 3])
        .float("intersection_cost", 0.1..=10.0)
        .default(1.0)
        .active_if("quality", [2, 3])
        .boolean("static")
        .default(false)
        .active_if("compact", [false])
        .less_or_equal("min_leaf_size", "max_leaf_size")
        .build()
        .expect("the paper's space is sound")
}

/// Reads `name=value,name=value`. The values are checked by [`complete`].
pub fn parse(text: &str) -> Result<Configuration, ConfigurationError> {
    text.split(',')
        .map(str::trim)
        .filter(|part| !part.is_empty())
        .map(|part| match part.split_once('=') {
            Some((name, value)) if !name.trim().is_empty() && !value.trim().is_empty() => {
                Ok((name.trim().to_owned(), Value::parse(value.trim())))
            }
            _ => Err(ConfigurationError::Syntax { part: part.to_owned() }),
        })
        .collect()
}

/// Fills what is missing with recommended values and checks everything. The result is canonical: a value
/// for each active parameter and no other.
pub fn complete(space: &Space, given: &Configuration) -> Result<Configuration, ConfigurationError> {
    for (name, _) in given.iter() {
        if space.parameters().iter().all(|parameter| parameter.name != name) {
            let known = space
                .parameters()
                .iter()
                .map(|parameter| parameter.name.as_str())
                .collect::<Vec<_>>()
                .join(", ");
            return Err(ConfigurationError::Unknown { name: name.to_owned(), known });
        }
    }
    let mut complete = Configuration::new();
    for parameter in space.parameters() {
        let missing = parameter.active_if.as_ref().filter(|condition| {
            !complete.get(&condition.parameter).is_some_and(|value| condition.any_of.contains(value))
        });
        match (missing, given.get(&parameter.name)) {
            (None, value) => complete.set(parameter.name.clone(), in_domain(parameter, value)?),
            (Some(_), None) => {}
            (Some(condition), Some(_)) => {
                let condition = format!("{} = {}", condition.parameter, list(&condition.any_of, " or "));
                return Err(ConfigurationError::Inactive { name: parameter.name.clone(), condition });
            }
        }
    }
    for Constraint { lesser, greater } in space.constraints() {
        if let (Some(low), Some(high)) = (complete.get(lesser), complete.get(greater))
            && number(low) > number(high)
        {
            let (low, high) = (low.to_string(), high.to_string());
            return Err(ConfigurationError::Constraint {
                lesser: lesser.clone(),
                low,
                greater: greater.clone(),
                high,
            });
        }
    }
    Ok(complete)
}

/// What to build for a configuration of [`table_1`].
pub fn build_choice(configuration: &Configuration) -> Result<BuildChoice, ConfigurationError> {
    let complete = complete(&table_1(), configuration)?;
    let default = TreeParameters::default();
    let integer = |name: &str, default: u32| match complete.get(name) {
        Some(Value::Integer(value)) => u32::try_from(*value).unwrap_or(default),
        _ => default,
    };
    let float = |name: &str, default: f32| match complete.get(name) {
        Some(Value::Float(value)) => *value as f32,
        _ => default,
    };
    let boolean = |name: &str| matches!(complete.get(name), Some(Value::Boolean(true)));
    Ok(BuildChoice::Tree(TreeParameters {
        quality: match integer("quality", 2) {
            1 => Quality::Morton,
            3 => Quality::SahSplit,
            _ => Quality::Sah,
        },
        branching_factor: integer("branching_factor", default.branching_factor),
        max_depth: integer("max_depth", default.max_depth),
        sah_block_size: integer("sah_block_size", default.sah_block_size),
        min_leaf_size: integer("min_leaf_size", default.min_leaf_size),
        max_leaf_size: integer("max_leaf_size", default.max_leaf_size),
        traversal_cost: float("traversal_cost", default.traversal_cost),
        intersection_cost: float("intersection_cost", default.intersection_cost),
        static_scene: boolean("static"),
        compact: boolean("compact"),
        robust: boolean("robust"),
        ..default
    }))
}

/// What a parameter may be, in words.
pub fn domain_in_words(domain: &Domain) -> String {
    match domain {
        Domain::Integer { min, max, .. } => format!("a whole number from {min} to {max}"),
        Domain::Float { min, max, .. } => format!("a number from {min} to {max}"),
        Domain::Categorical { values } => format!("one of {}", list(values, ", ")),
        Domain::Boolean => "true or false".to_owned(),
    }
}

fn in_domain(parameter: &Parameter, value: Option<&Value>) -> Result<Value, ConfigurationError> {
    let value = match (value, &parameter.domain) {
        (None, _) => return Ok(parameter.default.clone()),
        // People write 1 for 1.0.
        (Some(Value::Integer(value)), Domain::Float { .. }) => Value::Float(*value as f64),
        (Some(value), _) => value.clone(),
    };
    if parameter.domain.contains(&value) {
        Ok(value)
    } else {
        Err(ConfigurationError::OutOfDomain {
            name: parameter.name.clone(),
            value: value.to_string(),
            domain: domain_in_words(&parameter.domain),
        })
    }
}

fn number(value: &Value) -> f64 {
    match value {
        Value::Integer(value) => *value as f64,
        Value::Float(value) => *value,
        Value::Boolean(_) | Value::Text(_) => 0.0,
    }
}

fn list(values: &[Value], separator: &str) -> String {
    values.iter().map(Value::to_string).collect::<Vec<_>>().join(separator)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn choice(text: &str) -> Result<TreeParameters, ConfigurationError> {
        match build_choice(&parse(text)?)? {
            BuildChoice::Tree(parameters) => Ok(parameters),
            other => unreachable!("{other:?}"),
        }
    }

    fn problem(text: &str) -> String {
        choice(text).expect_err("it is refused").to_string()
    }

    #[test]
    fn the_default_is_the_papers() {
        let default = table_1().default_configuration();
        assert_eq!(default.len(), 11);
        assert_eq!(build_choice(&default), Ok(BuildChoice::Tree(TreeParameters::default())));
        assert_eq!(choice(""), Ok(TreeParameters::default()));
    }

    #[test]
    fn every_value_arrives() {
        let text = "quality=3, branching_factor=8, max_depth=40, sah_block_size=4, min_leaf_size=2, max_leaf_size=9, \
                    traversal_cost=2, intersection_cost=0.5, static=true, robust=true";
        let parameters = choice(text).expect("it is sound");
        assert_eq!(
            parameters,
            TreeParameters {
                quality: Quality::SahSplit,
                branching_factor: 8,
                max_depth: 40,
                sah_block_size: 4,
                min_leaf_size: 2,
                max_leaf_size: 9,
                traversal_cost: 2.0,
                intersection_cost: 0.5,
                static_scene: true,
                compact: false,
                robust: true,
                ..TreeParameters::default()
            }
        );
        assert!(parameters.check().is_ok());
        assert!(
            choice("compact=true,robust=true")
                .is_ok_and(|parameters| parameters.compact && parameters.robust)
        );
    }

    #[test]
    fn both_ends_of_every_domain_are_accepted_by_the_builder() {
        for parameter in table_1().parameters() {
            let ends = match &parameter.domain {
                Domain::Integer { min, max, .. } => vec![Value::from(*min), Value::from(*max)],
                Domain::Float { min, max, .. } => vec![Value::from(*min), Value::from(*max)],
                Domain::Categorical { values } => values.clone(),
                Domain::Boolean => vec![Value::from(false), Value::from(true)],
            };
            for value in ends {
                let text = format!("{}={value}", parameter.name);
                assert!(choice(&text).is_ok_and(|parameters| parameters.check().is_ok()), "{text}");
            }
        }
    }

    #[test]
    fn mistakes_are_named() {
        assert!(
            problem("colour=blue").contains("\"colour\"") && problem("colour=blue").contains("max_leaf_size")
        );
        assert!(problem("quality").contains("\"quality\" is not of the form"));
        assert!(problem("quality=9").contains("from 1 to 3"));
        assert!(problem("quality=fast").contains("cannot be fast"));
        assert!(problem("branching_factor=3").contains("one of 2, 4, 8"));
        assert!(problem("intersection_cost=0").contains("from 0.1 to 10"));
        assert!(
            problem("min_leaf_size=9,max_leaf_size=3")
                .contains("min_leaf_size (9) must not be above max_leaf_size (3)")
        );
        assert!(problem("compact=true,quality=3").contains("it needs compact = false"));
        assert!(problem("quality=1,sah_block_size=4").contains("it needs quality = 2 or 3"));
    }

    #[test]
    fn inactive_parameters_are_left_out() {
        let complete =
            |text: &str| complete(&table_1(), &parse(text).expect("it reads")).expect("it is sound");
        assert_eq!(complete("quality=1").len(), 8);
        assert_eq!(
            complete("compact=true"),
            Configuration::new().with("compact", true).with("robust", false)
        );
    }
}
