//! The one place where types of this crate become wire types and back.

mod insight;
mod study;
mod trial;

pub(crate) use study::{policy_to_wire, session_policy_to_wire, spec_to_wire, study_from_wire};
pub(crate) use trial::{
    best_from_wire, fingerprint_to_wire, outcome_to_wire, prediction_from_wire, trial_from_wire,
};

use treewright_proto::v1;

use crate::{Configuration, Value};

/// Something the daemon sent that the contract does not allow; says what.
pub(crate) type Problem = String;

pub(crate) fn value_to_wire(value: &Value) -> v1::Value {
    use v1::value::Kind;
    let kind = match value {
        Value::Boolean(value) => Kind::Boolean(*value),
        Value::Integer(value) => Kind::Integer(*value),
        Value::Float(value) => Kind::Float(*value),
        Value::Text(value) => Kind::Text(value.clone()),
    };
    v1::Value { kind: Some(kind) }
}

pub(crate) fn value_from_wire(value: v1::Value) -> Result<Value, Problem> {
    use v1::value::Kind;
    match value.kind {
        Some(Kind::Boolean(value)) => Ok(Value::Boolean(value)),
        Some(Kind::Integer(value)) => Ok(Value::Integer(value)),
        Some(Kind::Float(value)) => Ok(Value::Float(value)),
        Some(Kind::Text(value)) => Ok(Value::Text(value)),
        None => Err("a value without a type".into()),
    }
}

pub(crate) fn configuration_to_wire(configuration: &Configuration) -> v1::Configuration {
    let values = configuration.iter().map(|(name, value)| (name.to_owned(), value_to_wire(value))).collect();
    v1::Configuration { values }
}

pub(crate) fn configuration_from_wire(
    configuration: Option<v1::Configuration>,
) -> Result<Configuration, Problem> {
    let configuration = configuration.ok_or("no configuration")?;
    configuration.values.into_iter().map(|(name, value)| Ok((name, value_from_wire(value)?))).collect()
}

/// A time, where there is one that this machine can represent.
pub(crate) fn time_from_wire(time: Option<prost_types::Timestamp>) -> Option<std::time::SystemTime> {
    time.and_then(|time| time.try_into().ok())
}
