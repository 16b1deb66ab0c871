//! Landscapes that were recorded: a file as `tests/peers/record.py` writes it.

use std::collections::BTreeMap;

use serde::Deserialize;
use treewright_core::configuration::Configuration;
use treewright_core::space::{Condition, Domain, Parameter, Space};
use treewright_core::value::Value;

use crate::problem::{Kind, Problem};

#[derive(Deserialize)]
struct File {
    name: String,
    parameters: Vec<Axis>,
    costs: Vec<Option<f64>>,
}

#[derive(Deserialize)]
struct Axis {
    name: String,
    #[serde(default)]
    values: Vec<serde_json::Value>,
    default: serde_json::Value,
    active_if: Option<(String, Vec<serde_json::Value>)>,
}

fn value(json: &serde_json::Value) -> Value {
    match json {
        serde_json::Value::Bool(boolean) => Value::Boolean(*boolean),
        serde_json::Value::Number(number) => match number.as_i64() {
            Some(integer) => Value::Integer(integer),
            None => Value::Float(number.as_f64().expect("a number")),
        },
        other => Value::Text(other.as_str().expect("a text").to_owned()),
    }
}

impl Axis {
    /// Every number a float where one is: values of one parameter are of one kind.
    fn value(&self, json: &serde_json::Value) -> Value {
        match value(json) {
            Value::Integer(integer) if self.values.iter().any(serde_json::Value::is_f64) => {
                Value::Float(integer as f64)
            }
            same => same,
        }
    }

    fn parameter(&self) -> Parameter {
        let values: Vec<Value> = self.values.iter().map(|each| self.value(each)).collect();
        let domain = if values.is_empty() { Domain::Boolean } else { Domain::Categorical { values } };
        let active_if = self.active_if.as_ref().map(|(parameter, any_of)| Condition {
            parameter: parameter.clone(),
            any_of: any_of.iter().map(value).collect(),
        });
        Parameter { name: self.name.clone(), domain, default: self.value(&self.default), active_if }
    }
}

/// Every configuration, the last parameter fastest, without those that mean nothing beside the others.
fn configurations(parameters: &[Parameter]) -> Vec<BTreeMap<String, Value>> {
    let mut all = vec![BTreeMap::new()];
    for parameter in parameters {
        let values = match &parameter.domain {
            Domain::Categorical { values } => values.clone(),
            _ => vec![Value::Boolean(false), Value::Boolean(true)],
        };
        let extend = |one: BTreeMap<String, Value>| {
            let is_on = parameter.active_if.as_ref().is_none_or(|condition| {
                one.get(&condition.parameter).is_some_and(|value| condition.any_of.contains(value))
            });
            let with = |value: &Value| {
                let mut more = one.clone();
                more.insert(parameter.name.clone(), value.clone());
                more
            };
            if is_on { values.iter().map(with).collect() } else { vec![one] }
        };
        all = all.into_iter().flat_map(extend).collect();
    }
    all
}

/// The landscape of a file, with 5 % noise.
pub(crate) fn problem(path: &str) -> Problem {
    let text = std::fs::read_to_string(path).expect("a landscape");
    let file: File = serde_json::from_str(&text).expect("a landscape as it is recorded");
    let parameters: Vec<Parameter> = file.parameters.iter().map(Axis::parameter).collect();
    let keys = configurations(&parameters);
    assert_eq!(keys.len(), file.costs.len(), "a cost for each configuration");
    let space = Space::new(parameters, Vec::new()).expect("a valid space");
    let costs: BTreeMap<_, _> =
        keys.into_iter().zip(&file.costs).filter_map(|(key, cost)| Some((key, (*cost)?))).collect();
    let optimum = costs.values().copied().fold(f64::INFINITY, f64::min);
    let truth = move |configuration: &Configuration| costs.get(configuration.values()).copied();
    Problem {
        name: file.name,
        kind: Kind::Ratio,
        space,
        truth: Box::new(truth),
        noise: 0.05,
        offset: 0.0,
        optimum,
    }
}
