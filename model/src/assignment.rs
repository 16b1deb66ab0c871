//! Unchecked values of some or all parameters by name, for programs and people, with a getter for each kind
//! of value.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use thiserror::Error;

use crate::plain::Plain;
use crate::value::{RawConfiguration, Value};

/// A value for some or all parameters, ordered by name. Serialised it is a plain map:
/// `{"quality":2,"split":"sah"}`.
#[derive(Clone, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Assignment(RawConfiguration);

/// There is no value of that name and kind.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("the configuration has no {wanted} named `{name}`: found {found}")]
pub struct NoSuchValue {
    /// The requested name.
    pub name: String,
    /// The requested kind.
    pub wanted: &'static str,
    /// The value of that name.
    pub found: String,
}

impl Assignment {
    /// An assignment without values.
    pub fn new() -> Self {
        Self::default()
    }

    /// These values, with one added or replaced.
    #[must_use]
    pub fn with(mut self, name: impl Into<String>, value: impl Into<Value>) -> Self {
        self.set(name, value);
        self
    }

    /// Adds or replaces a value.
    pub fn set(&mut self, name: impl Into<String>, value: impl Into<Value>) {
        self.0.insert(name.into(), value.into());
    }

    /// The value of a parameter; `None` where the parameter is unknown or inactive.
    pub fn get(&self, name: &str) -> Option<&Value> {
        self.0.get(name)
    }

    /// An integer parameter.
    ///
    /// # Errors
    /// [`NoSuchValue`] with the value of that name.
    pub fn integer(&self, name: &str) -> Result<i64, NoSuchValue> {
        match self.get(name) {
            Some(Value::Integer(value)) => Ok(*value),
            other => Err(no_such_value(name, "integer", other)),
        }
    }

    /// A float parameter.
    ///
    /// # Errors
    /// [`NoSuchValue`] with the value of that name.
    pub fn float(&self, name: &str) -> Result<f64, NoSuchValue> {
        match self.get(name) {
            Some(Value::Float(value)) => Ok(*value),
            other => Err(no_such_value(name, "float", other)),
        }
    }

    /// A boolean parameter.
    ///
    /// # Errors
    /// [`NoSuchValue`] with the value of that name.
    pub fn boolean(&self, name: &str) -> Result<bool, NoSuchValue> {
        match self.get(name) {
            Some(Value::Boolean(value)) => Ok(*value),
            other => Err(no_such_value(name, "boolean", other)),
        }
    }

    /// A categorical parameter whose values are words.
    ///
    /// # Errors
    /// [`NoSuchValue`] with the value of that name.
    pub fn text(&self, name: &str) -> Result<&str, NoSuchValue> {
        match self.get(name) {
            Some(Value::Text(value)) => Ok(value),
            other => Err(no_such_value(name, "text", other)),
        }
    }

    /// Names and values, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Value)> {
        self.0.iter().map(|(name, value)| (name.as_str(), value))
    }

    /// The number of values.
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is no value at all.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The bare map.
    pub fn as_raw(&self) -> &RawConfiguration {
        &self.0
    }
}

fn no_such_value(name: &str, wanted: &'static str, found: Option<&Value>) -> NoSuchValue {
    let found = found
        .map_or_else(|| "nothing of that name".to_owned(), |value| format!("the {} {value}", value.kind()));
    NoSuchValue { name: name.to_owned(), wanted, found }
}

impl From<RawConfiguration> for Assignment {
    fn from(values: RawConfiguration) -> Self {
        Self(values)
    }
}

impl From<Assignment> for RawConfiguration {
    fn from(assignment: Assignment) -> Self {
        assignment.0
    }
}

impl FromIterator<(String, Value)> for Assignment {
    fn from_iter<I: IntoIterator<Item = (String, Value)>>(values: I) -> Self {
        Self(values.into_iter().collect())
    }
}

impl fmt::Display for Assignment {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, (name, value)) in self.iter().enumerate() {
            let separator = if index == 0 { "" } else { " " };
            write!(f, "{separator}{name}={value}")?;
        }
        Ok(())
    }
}

impl Serialize for Assignment {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        Plain(&self.0).serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Assignment {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let values = BTreeMap::<String, PlainValue>::deserialize(deserializer)?;
        Ok(values.into_iter().map(|(name, value)| (name, value.into())).collect())
    }
}

/// A value from text without its kind: numbers with a point or exponent, or beyond the range of integers, are
/// floats.
#[derive(Deserialize)]
#[serde(untagged, expecting = "expected a boolean, a number or text")]
enum PlainValue {
    Boolean(bool),
    Integer(i64),
    Float(f64),
    Text(String),
}

impl From<PlainValue> for Value {
    fn from(value: PlainValue) -> Self {
        match value {
            PlainValue::Boolean(switch) => Value::Boolean(switch),
            PlainValue::Integer(integer) => Value::Integer(integer),
            PlainValue::Float(float) => Value::Float(float),
            PlainValue::Text(text) => Value::Text(text),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn typed_getters_say_what_is_there_instead() {
        let configuration =
            Assignment::new().with("quality", 2).with("split", "sah").with("cost", 1.5).with("compact", true);
        assert_eq!(configuration.integer("quality"), Ok(2));
        assert_eq!(configuration.text("split"), Ok("sah"));
        assert_eq!(configuration.float("cost"), Ok(1.5));
        assert_eq!(configuration.boolean("compact"), Ok(true));
        let problem = configuration.float("quality").expect_err("an integer").to_string();
        assert_eq!(problem, "the configuration has no float named `quality`: found the integer 2");
        assert_eq!(configuration.integer("depth").expect_err("unknown").found, "nothing of that name");
    }

    #[test]
    fn they_are_ordered_by_name() {
        let configuration = Assignment::new().with("b", 1).with("a", 2.0);
        assert_eq!(configuration.to_string(), "a=2.0 b=1");
        assert_eq!(configuration, Assignment::new().with("a", 2.0).with("b", 1));
    }

    #[test]
    fn json_is_plain_and_keeps_the_kinds() {
        let configuration =
            Assignment::new().with("a", -1).with("b", 2.0).with("c", "x").with("d", true).with("e", 1e300);
        let text = serde_json::to_string(&configuration).expect("plain data");
        assert_eq!(text, r#"{"a":-1,"b":2.0,"c":"x","d":true,"e":1e+300}"#);
        assert_eq!(serde_json::from_str::<Assignment>(&text).expect("own output"), configuration);
        assert!(serde_json::from_str::<Assignment>(r#"{"a":null}"#).is_err());
        assert!(serde_json::from_str::<Assignment>(r#"{"a":{"integer":1}}"#).is_err());
    }
}
