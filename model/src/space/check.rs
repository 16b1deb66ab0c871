//! The rules that spaces and configurations fulfil.

use std::collections::BTreeMap;

use crate::configuration::{Configuration, RawConfiguration};
use crate::limits::{CATEGORIES_MAX, CONSTRAINTS_MAX, PARAMETERS_MAX};
use crate::names::is_name;
use crate::space::{Condition, Constraint, Domain, Parameter, Space, SpaceError};
use crate::value::Value;

impl Space {
    /// Checks everything that the limits and the meaning of a space demand: names, ranges, defaults,
    /// conditions that only name earlier parameters, constraints between numbers that the defaults fulfil.
    pub fn new(parameters: Vec<Parameter>, constraints: Vec<Constraint>) -> Result<Self, SpaceError> {
        check_count("parameters", parameters.len(), 1, PARAMETERS_MAX)?;
        check_count("constraints", constraints.len(), 0, CONSTRAINTS_MAX)?;
        let parameters: Vec<Parameter> = parameters.into_iter().map(canonical).collect();
        let mut condition_of = Vec::with_capacity(parameters.len());
        for (index, parameter) in parameters.iter().enumerate() {
            condition_of.push(check_parameter(parameter, &parameters[..index])?);
        }
        let mut order = Vec::with_capacity(constraints.len());
        for constraint in &constraints {
            order.push(check_constraint(constraint, &parameters)?);
        }
        let default_point =
            parameters.iter().map(|parameter| parameter.domain.encode(&parameter.default)).collect();
        let mut space = Space {
            parameters,
            constraints,
            condition_of,
            order,
            default: Configuration::from_checked(BTreeMap::new()),
            default_point,
        };
        let defaults: Vec<Value> =
            space.parameters.iter().map(|parameter| parameter.default.clone()).collect();
        let active = space.active(&defaults);
        if let Some(violation) = space.violations(&defaults, &active).next() {
            let Constraint { lesser, greater } = &space.constraints[violation];
            return Err(SpaceError::Constraint {
                lesser: lesser.clone(),
                greater: greater.clone(),
                problem: "the defaults do not fulfil it; change a default".into(),
            });
        }
        space.default = space.collect(&defaults, &active);
        Ok(space)
    }

    pub(super) fn check_configuration(
        &self,
        mut values: RawConfiguration,
    ) -> Result<Configuration, SpaceError> {
        let mut ordered: Vec<Value> = Vec::with_capacity(self.parameters.len());
        let mut active = Vec::with_capacity(self.parameters.len());
        for (index, parameter) in self.parameters.iter().enumerate() {
            let is_active = self.is_active(index, &ordered, &active);
            let given = values.remove(&parameter.name).map(Value::canonical);
            match given {
                Some(_) if !is_active => {
                    let needs = parameter.active_if.as_ref().map(Condition::to_string).unwrap_or_default();
                    return Err(SpaceError::Inactive { name: parameter.name.clone(), needs });
                }
                None if is_active => {
                    return Err(SpaceError::Missing { name: parameter.name.clone() });
                }
                Some(value) if !parameter.domain.contains(&value) => {
                    return Err(SpaceError::Value {
                        parameter: parameter.name.clone(),
                        value,
                        allowed: parameter.domain.to_string(),
                    });
                }
                Some(value) => ordered.push(value),
                None => ordered.push(parameter.default.clone()),
            }
            active.push(is_active);
        }
        if let Some(name) = values.into_keys().next() {
            let known: Vec<&str> = self.parameters.iter().map(|parameter| parameter.name.as_str()).collect();
            return Err(SpaceError::Unknown { name, known: known.join(", ") });
        }
        if let Some(violation) = self.violations(&ordered, &active).next() {
            let (lesser, greater) = self.order[violation];
            return Err(SpaceError::Violated {
                lesser: self.parameters[lesser].name.clone(),
                lesser_value: ordered[lesser].clone(),
                greater: self.parameters[greater].name.clone(),
                greater_value: ordered[greater].clone(),
            });
        }
        Ok(self.collect(&ordered, &active))
    }

    /// Whether parameter `index` is active, given the values and activity of those before it.
    pub(super) fn is_active(&self, index: usize, values: &[Value], active: &[bool]) -> bool {
        match (&self.parameters[index].active_if, self.condition_of[index]) {
            (Some(condition), Some(other)) => active[other] && condition.any_of.contains(&values[other]),
            _ => true,
        }
    }

    /// Which parameters are active under `values` (one per parameter).
    pub(super) fn active(&self, values: &[Value]) -> Vec<bool> {
        let mut active = Vec::with_capacity(values.len());
        for index in 0..values.len() {
            active.push(self.is_active(index, values, &active));
        }
        active
    }

    /// Indices of the constraints that `values` break.
    pub(super) fn violations<'a>(
        &'a self,
        values: &'a [Value],
        active: &'a [bool],
    ) -> impl Iterator<Item = usize> + 'a {
        self.order.iter().enumerate().filter_map(|(index, &(lesser, greater))| {
            let broken =
                active[lesser] && active[greater] && values[lesser].as_number() > values[greater].as_number();
            broken.then_some(index)
        })
    }

    pub(super) fn collect(&self, values: &[Value], active: &[bool]) -> Configuration {
        let pairs = self.parameters.iter().zip(values).zip(active);
        Configuration::from_checked(
            pairs
                .filter(|(_, active)| **active)
                .map(|((parameter, value), _)| (parameter.name.clone(), value.clone()))
                .collect(),
        )
    }
}

fn check_count(what: &'static str, count: usize, least: usize, most: usize) -> Result<(), SpaceError> {
    if (least..=most).contains(&count) { Ok(()) } else { Err(SpaceError::Count { what, count, least, most }) }
}

/// Negative zeros would make equal spaces look different.
fn canonical(parameter: Parameter) -> Parameter {
    let all = |values: Vec<Value>| values.into_iter().map(Value::canonical).collect();
    Parameter {
        name: parameter.name,
        domain: match parameter.domain {
            Domain::Float { min, max, scale } => Domain::Float { min: min + 0.0, max: max + 0.0, scale },
            Domain::Categorical { values } => Domain::Categorical { values: all(values) },
            other => other,
        },
        default: parameter.default.canonical(),
        active_if: parameter
            .active_if
            .map(|condition| Condition { parameter: condition.parameter, any_of: all(condition.any_of) }),
    }
}

/// Returns the index of the parameter that the condition names.
fn check_parameter(parameter: &Parameter, earlier: &[Parameter]) -> Result<Option<usize>, SpaceError> {
    let name = &parameter.name;
    if !is_name(name) {
        return Err(SpaceError::Name { name: name.clone() });
    }
    if earlier.iter().any(|other| &other.name == name) {
        return Err(SpaceError::Twice { name: name.clone() });
    }
    if let Some(problem) = parameter.domain.problem() {
        return Err(SpaceError::Domain { parameter: name.clone(), problem });
    }
    if !parameter.domain.contains(&parameter.default) {
        return Err(SpaceError::Default {
            parameter: name.clone(),
            value: parameter.default.clone(),
            allowed: parameter.domain.to_string(),
        });
    }
    let Some(condition) = &parameter.active_if else {
        return Ok(None);
    };
    let refuse = |problem: String| SpaceError::Condition { parameter: name.clone(), problem };
    let Some(index) = earlier.iter().position(|other| other.name == condition.parameter) else {
        return Err(refuse(format!("names {:?}, which is not listed earlier", condition.parameter)));
    };
    if condition.any_of.is_empty() || condition.any_of.len() > CATEGORIES_MAX {
        return Err(refuse(format!("has {} values; give 1 to {CATEGORIES_MAX}", condition.any_of.len())));
    }
    let domain = &earlier[index].domain;
    if let Some(value) = condition.any_of.iter().find(|value| !domain.contains(value)) {
        return Err(refuse(format!("asks for {value}, but {:?} is {}", condition.parameter, domain)));
    }
    Ok(Some(index))
}

fn check_constraint(constraint: &Constraint, parameters: &[Parameter]) -> Result<(usize, usize), SpaceError> {
    let Constraint { lesser, greater } = constraint;
    let refuse = |problem: String| SpaceError::Constraint {
        lesser: lesser.clone(),
        greater: greater.clone(),
        problem,
    };
    let find = |name: &String| match parameters.iter().position(|parameter| &parameter.name == name) {
        None => Err(refuse(format!("there is no parameter {name:?}"))),
        Some(index) if parameters[index].domain.bounds().is_none() => {
            Err(refuse(format!("{name:?} is not a number; only integer and float domains can be compared")))
        }
        Some(index) => Ok(index),
    };
    let (lesser_index, greater_index) = (find(lesser)?, find(greater)?);
    if lesser_index == greater_index {
        return Err(refuse("a parameter cannot be compared with itself".into()));
    }
    Ok((lesser_index, greater_index))
}
