//! Values and configurations.

use treewright_model::configuration::{Configuration, RawConfiguration};
use treewright_model::value::Value;

use super::Malformed;
use crate::v1;

/// A value of a parameter.
pub fn value_to_wire(value: &Value) -> v1::Value {
    use v1::value::Kind;
    let kind = match value {
        Value::Integer(integer) => Kind::Integer(*integer),
        Value::Float(float) => Kind::Float(*float),
        Value::Text(text) => Kind::Text(text.clone()),
        Value::Boolean(boolean) => Kind::Boolean(*boolean),
    };
    v1::Value { kind: Some(kind) }
}

fn value(value: v1::Value) -> Option<Value> {
    use v1::value::Kind;
    Some(match value.kind? {
        Kind::Integer(integer) => Value::Integer(integer),
        Kind::Float(float) => Value::Float(float),
        Kind::Text(text) => Value::Text(text),
        Kind::Boolean(boolean) => Value::Boolean(boolean),
    })
}

/// Reads a value.
///
/// # Errors
/// [`Malformed`] when it is empty, or of an unknown kind.
pub fn value_from_wire(field: &str, wire: v1::Value) -> Result<Value, Malformed> {
    value(wire).ok_or_else(|| Malformed::no_kind(field, "integer, float, text and boolean"))
}

pub(super) fn values_from_wire(field: &str, wire: Vec<v1::Value>) -> Result<Vec<Value>, Malformed> {
    wire.into_iter().map(|value| value_from_wire(field, value)).collect()
}

/// The values of a configuration, checked or not.
pub trait Values {
    /// The values by parameter.
    fn values(&self) -> &RawConfiguration;
}

impl Values for Configuration {
    fn values(&self) -> &RawConfiguration {
        Configuration::values(self)
    }
}

impl Values for RawConfiguration {
    fn values(&self) -> &RawConfiguration {
        self
    }
}

/// A configuration.
pub fn configuration_to_wire(configuration: &impl Values) -> v1::Configuration {
    let values = configuration.values().iter().map(|(name, value)| (name.clone(), value_to_wire(value)));
    v1::Configuration { values: values.collect() }
}

/// Reads a configuration that its space has yet to check.
///
/// # Errors
/// [`Malformed`] with the value.
pub fn configuration_from_wire(field: &str, wire: v1::Configuration) -> Result<RawConfiguration, Malformed> {
    let (values, unreadable) = readable_configuration(wire);
    match unreadable.first() {
        None => Ok(values),
        Some(name) => {
            let field = format!("{field}.values[{name:?}]");
            Err(Malformed::no_kind(field, "integer, float, text and boolean"))
        }
    }
}

/// Reads the known values of a configuration. The second part names parameters with values of unknown kinds.
pub fn readable_configuration(wire: v1::Configuration) -> (RawConfiguration, Vec<String>) {
    let (mut values, mut unreadable) = (RawConfiguration::new(), Vec::new());
    for (name, wire) in wire.values {
        match value(wire) {
            Some(value) => drop(values.insert(name, value)),
            None => unreadable.push(name),
        }
    }
    (values, unreadable)
}
