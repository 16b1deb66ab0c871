//! Parameter spaces.

use treewright_model::space::{Condition, Constraint, Domain, Parameter, Scale, Space};
use treewright_model::words::OpenEnum;

use super::values::{value_from_wire, value_to_wire, values_from_wire};
use super::{Malformed, WireEnum};
use crate::v1;

/// A space.
pub fn space_to_wire(space: &Space) -> v1::Space {
    v1::Space {
        parameters: space.parameters().iter().map(parameter_to_wire).collect(),
        constraints: space.constraints().iter().map(constraint_to_wire).collect(),
    }
}

/// Reads and checks a space.
///
/// # Errors
/// [`Malformed`] with the field.
pub fn space_from_wire(field: &str, space: v1::Space) -> Result<Space, Malformed> {
    let parameters = space.parameters.into_iter().enumerate();
    let parameters = parameters
        .map(|(index, wire)| parameter_from_wire(&format!("{field}.parameters[{index}]"), wire))
        .collect::<Result<_, _>>()?;
    let constraints = space.constraints.iter().enumerate();
    let constraints = constraints
        .map(|(index, wire)| constraint_from_wire(&format!("{field}.constraints[{index}]"), wire))
        .collect::<Result<_, _>>()?;
    Space::new(parameters, constraints).map_err(|error| Malformed::new(field, error))
}

/// Orders keep their own form, for clients without expressions.
fn constraint_to_wire(constraint: &Constraint) -> v1::Constraint {
    match constraint.as_order() {
        Some((lesser, greater)) => v1::Constraint {
            lesser: lesser.to_owned(),
            greater: greater.to_owned(),
            expression: String::new(),
        },
        None => v1::Constraint { expression: constraint.to_string(), ..v1::Constraint::default() },
    }
}

fn constraint_from_wire(field: &str, wire: &v1::Constraint) -> Result<Constraint, Malformed> {
    let v1::Constraint { lesser, greater, expression } = wire;
    match (expression.is_empty(), lesser.is_empty() && greater.is_empty()) {
        (true, _) => Ok(Constraint::order(lesser, greater)),
        (false, true) => Constraint::parse(expression).map_err(|error| Malformed::new(field, error)),
        (false, false) => {
            Err(Malformed::new(field, "it has an expression and an order; leave one of them out"))
        }
    }
}

fn parameter_to_wire(parameter: &Parameter) -> v1::Parameter {
    use v1::parameter::Domain as Wire;
    let domain = match &parameter.domain {
        Domain::Integer { min, max, scale } => {
            Wire::Integer(v1::IntegerDomain { min: *min, max: *max, scale: scale.number() })
        }
        Domain::Float { min, max, scale } => {
            Wire::Float(v1::FloatDomain { min: *min, max: *max, scale: scale.number() })
        }
        Domain::Categorical { values } => {
            Wire::Categorical(v1::CategoricalDomain { values: values.iter().map(value_to_wire).collect() })
        }
        Domain::Boolean => Wire::Boolean(v1::BooleanDomain {}),
    };
    v1::Parameter {
        name: parameter.name.clone(),
        domain: Some(domain),
        default_value: Some(value_to_wire(&parameter.default)),
        active_if: parameter.active_if.as_ref().map(|condition| v1::Condition {
            parameter: condition.parameter.clone(),
            any_of: condition.any_of.iter().map(value_to_wire).collect(),
        }),
        setup: parameter.setup,
    }
}

fn parameter_from_wire(field: &str, wire: v1::Parameter) -> Result<Parameter, Malformed> {
    use v1::parameter::Domain as Wire;
    let domain_field = format!("{field}.domain");
    let domain = match wire.domain {
        None => return Err(Malformed::no_kind(domain_field, "integer, float, categorical and boolean")),
        Some(Wire::Integer(domain)) => Domain::Integer {
            min: domain.min,
            max: domain.max,
            scale: scale_from_wire(&domain_field, domain.scale)?,
        },
        Some(Wire::Float(domain)) => Domain::Float {
            min: domain.min,
            max: domain.max,
            scale: scale_from_wire(&domain_field, domain.scale)?,
        },
        Some(Wire::Categorical(domain)) => {
            Domain::Categorical { values: values_from_wire(&domain_field, domain.values)? }
        }
        Some(Wire::Boolean(v1::BooleanDomain {})) => Domain::Boolean,
    };
    let default_field = format!("{field}.default_value");
    let default = wire.default_value.ok_or_else(|| Malformed::missing(&default_field))?;
    let condition = |condition: v1::Condition| {
        let any_of = values_from_wire(&format!("{field}.active_if"), condition.any_of)?;
        Ok(Condition { parameter: condition.parameter, any_of })
    };
    Ok(Parameter {
        name: wire.name,
        domain,
        default: value_from_wire(&default_field, default)?,
        active_if: wire.active_if.map(condition).transpose()?,
        setup: wire.setup,
    })
}

/// An unknown scale is refused, because its meaning for distances cannot be guessed.
pub(super) fn scale_from_wire(field: &str, number: i32) -> Result<Scale, Malformed> {
    match Scale::from_number(number) {
        None => Ok(Scale::default()),
        Some(OpenEnum::Known(scale)) => Ok(scale),
        Some(OpenEnum::Unrecognised(_)) => {
            Err(Malformed::new(format!("{field}.scale"), format!("{number} is not a known value")))
        }
    }
}
