//! The rules of spaces and configurations.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::configuration::{Configuration, RawConfiguration};
use crate::limits::{CATEGORIES_MAX, CONSTRAINTS_MAX, PARAMETERS_MAX};
use crate::names::{PARAMETER_NAME_RULE, is_parameter_name};
use crate::space::constraint::Extent;
use crate::space::{Condition, Constraint, Domain, Parameter, Rule, Space, SpaceError};
use crate::value::Value;

impl Space {
    /// Checks the limits and the rules of a space: names, ranges, defaults, conditions that only name earlier
    /// parameters, constraints that fit the parameters and that the defaults fulfil.
    pub fn new(parameters: Vec<Parameter>, constraints: Vec<Constraint>) -> Result<Self, SpaceError> {
        check_count("parameters", parameters.len(), 1, PARAMETERS_MAX)?;
        check_count("constraints", constraints.len(), 0, CONSTRAINTS_MAX)?;
        let parameters: Vec<Parameter> = parameters.into_iter().map(canonical).collect();
        let mut condition_of = Vec::with_capacity(parameters.len());
        for (index, parameter) in parameters.iter().enumerate() {
            condition_of.push(check_parameter(parameter, &parameters[..index])?);
        }
        let rules = constraints.iter().map(|constraint| check_constraint(constraint, &parameters));
        let rules = rules.collect::<Result<Vec<_>, _>>()?;
        let default_point =
            parameters.iter().map(|parameter| parameter.domain.encode(&parameter.default)).collect();
        let mut space = Space {
            groups: Arc::default(),
            ranges: parameters.iter().map(|parameter| Extent::of_domain(&parameter.domain)).collect(),
            parameters,
            constraints,
            condition_of,
            rules,
            default: Configuration::from_checked(BTreeMap::new()),
            default_point,
        };
        let defaults: Vec<Value> =
            space.parameters.iter().map(|parameter| parameter.default.clone()).collect();
        let active = space.active(&defaults);
        if let Some(violation) = space.violations(&defaults, &active).next() {
            let values = space.mentioned(violation, &defaults);
            let problem = format!("the defaults do not fulfil it, with {values}; change a default");
            return Err(SpaceError::of_constraint(&space.constraints[violation], problem));
        }
        space.default = space.collect(&defaults, &active);
        space.groups = space.grouped().into();
        Ok(space)
    }

    /// Checks a set of values: exactly the active parameters, each in its domain, every constraint fulfilled.
    /// The error names the mistake.
    pub fn configuration(&self, mut values: RawConfiguration) -> Result<Configuration, SpaceError> {
        let mut ordered: Vec<Value> = Vec::with_capacity(self.parameters.len());
        let mut active = Vec::with_capacity(self.parameters.len());
        for (index, parameter) in self.parameters.iter().enumerate() {
            let is_active = self.is_active(index, &ordered, &active);
            let given = values.remove(&parameter.name).map(Value::canonical);
            match given {
                Some(_) if !is_active => {
                    let needs = parameter.active_if.as_ref().map(Condition::to_string).unwrap_or_default();
                    let problem = format!(" is not active here: it needs {needs}; leave it out");
                    return Err(SpaceError::of_parameter(&parameter.name, problem));
                }
                None if is_active => {
                    let problem = " is active here and has no value; give it one";
                    return Err(SpaceError::of_parameter(&parameter.name, problem));
                }
                Some(value) if !parameter.domain.contains(&value) => {
                    return Err(SpaceError::of_value(parameter, &value));
                }
                Some(value) => ordered.push(value),
                None => ordered.push(parameter.default.clone()),
            }
            active.push(is_active);
        }
        if let Some(name) = values.into_keys().next() {
            let known: Vec<&str> = self.parameters.iter().map(|parameter| parameter.name.as_str()).collect();
            let problem = format!(" is unknown; the space has {}", known.join(", "));
            return Err(SpaceError::of_parameter(&name, problem));
        }
        if let Some(violation) = self.violations(&ordered, &active).next() {
            let (values, constraint) = (self.mentioned(violation, &ordered), &self.constraints[violation]);
            return Err(SpaceError(format!(
                "{values} break the constraint `{constraint}`; change one of them"
            )));
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

    /// The activity of each parameter under `values` (one per parameter).
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
        let broken =
            |rule: &Rule| rule.mentions.iter().all(|&index| active[index]) && !rule.is_fulfilled(values);
        self.rules.iter().enumerate().filter_map(move |(index, rule)| broken(rule).then_some(index))
    }

    /// The parameters that a constraint names, and their values: `block_x = 64, block_y = 32`.
    fn mentioned(&self, rule: usize, values: &[Value]) -> String {
        let value = |&index: &usize| format!("{} = {}", self.parameters[index].name, values[index]);
        self.rules[rule].mentions.iter().map(value).collect::<Vec<_>>().join(", ")
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

fn check_count(what: &str, count: usize, least: usize, most: usize) -> Result<(), SpaceError> {
    let fits = (least..=most).contains(&count);
    if fits { Ok(()) } else { Err(SpaceError::of_count(what, count, least, most)) }
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
        setup: parameter.setup,
    }
}

/// Returns the index of the parameter that the condition names.
fn check_parameter(parameter: &Parameter, earlier: &[Parameter]) -> Result<Option<usize>, SpaceError> {
    let Parameter { name, domain, default, active_if, .. } = parameter;
    let refuse = |problem: String| SpaceError::of_parameter(name, problem);
    if !is_parameter_name(name) {
        return Err(refuse(format!(" is not a name; use {PARAMETER_NAME_RULE}")));
    }
    if earlier.iter().any(|other| &other.name == name) {
        return Err(refuse(" is listed twice; remove or rename one".to_owned()));
    }
    if let Some(problem) = domain.problem() {
        return Err(refuse(format!(": {problem}")));
    }
    if !domain.contains(default) {
        return Err(refuse(format!(": the default {default} is not {domain}")));
    }
    let Some(condition) = active_if else { return Ok(None) };
    let refuse = |problem: String| refuse(format!(": active_if {problem}"));
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

fn check_constraint(constraint: &Constraint, parameters: &[Parameter]) -> Result<Rule, SpaceError> {
    let root = constraint.root().placed(parameters);
    let root = root.map_err(|problem| SpaceError::of_constraint(constraint, problem))?;
    let mut mentions = Vec::new();
    root.mentions(&mut mentions);
    let place = |name: &str| parameters.iter().position(|parameter| parameter.name == name);
    let order = constraint.as_order().and_then(|(lesser, greater)| Some((place(lesser)?, place(greater)?)));
    // Bounds say too little of a list of numbers.
    let has_bounds = |place: usize| parameters[place].domain.bounds().is_some();
    let order = order.filter(|&(lesser, greater)| has_bounds(lesser) && has_bounds(greater));
    Ok(Rule { root, mentions, order })
}

impl Rule {
    /// Whether values of all parameters fulfil it, if every parameter counts as active.
    pub(super) fn is_fulfilled(&self, values: &[Value]) -> bool {
        match self.order {
            Some((lesser, greater)) => values[lesser].as_number() <= values[greater].as_number(),
            None => self.root.may_hold(&|index| Extent::of_value(&values[index])),
        }
    }
}
