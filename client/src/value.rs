//! Values and configurations as a program sees them: typed, ordered by name, comparable.

use std::collections::BTreeMap;
use std::fmt;

use serde::{Deserialize, Serialize};

use crate::ClientError;

/// The value of one parameter.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Value {
    /// `true` or `false`.
    Boolean(bool),
    /// A whole number.
    Integer(i64),
    /// A finite number.
    Float(f64),
    /// A word, of a categorical parameter.
    Text(String),
}

impl Value {
    /// The value's type, for messages.
    #[must_use]
    pub fn kind(&self) -> &'static str {
        match self {
            Self::Boolean(_) => "boolean",
            Self::Integer(_) => "integer",
            Self::Float(_) => "float",
            Self::Text(_) => "text",
        }
    }

    /// Reads a value as people write it: `true`, `32`, `0.5`, or else text. What is in double quotes is text.
    #[must_use]
    pub fn parse(text: &str) -> Self {
        if let Some(quoted) = text.strip_prefix('"').and_then(|rest| rest.strip_suffix('"')) {
            return Self::Text(quoted.to_owned());
        }
        if let Ok(value) = text.parse() {
            return Self::Boolean(value);
        }
        if let Ok(value) = text.parse() {
            return Self::Integer(value);
        }
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() => Self::Float(value),
            _ => Self::Text(text.to_owned()),
        }
    }
}

impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Boolean(value) => write!(f, "{value}"),
            Self::Integer(value) => write!(f, "{value}"),
            // `{:?}` keeps the point, so that a float is not read back as an integer.
            Self::Float(value) => write!(f, "{value:?}"),
            Self::Text(value) => write!(f, "{value}"),
        }
    }
}

impl From<bool> for Value {
    fn from(value: bool) -> Self {
        Self::Boolean(value)
    }
}
impl From<i64> for Value {
    fn from(value: i64) -> Self {
        Self::Integer(value)
    }
}
impl From<i32> for Value {
    fn from(value: i32) -> Self {
        Self::Integer(i64::from(value))
    }
}
impl From<u32> for Value {
    fn from(value: u32) -> Self {
        Self::Integer(i64::from(value))
    }
}
impl From<f64> for Value {
    fn from(value: f64) -> Self {
        Self::Float(value)
    }
}
impl From<&str> for Value {
    fn from(value: &str) -> Self {
        Self::Text(value.to_owned())
    }
}
impl From<String> for Value {
    fn from(value: String) -> Self {
        Self::Text(value)
    }
}

/// A value for every active parameter, ordered by name.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Configuration(BTreeMap<String, Value>);

impl Configuration {
    /// One without values.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// The same with one value more, or with that value replaced.
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
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Value> {
        self.0.get(name)
    }

    /// An integer parameter. Errors: [`ClientError::NoSuchValue`].
    pub fn integer(&self, name: &str) -> Result<i64, ClientError> {
        match self.get(name) {
            Some(Value::Integer(value)) => Ok(*value),
            other => Err(no_such_value(name, "integer", other)),
        }
    }

    /// A float parameter. Errors: [`ClientError::NoSuchValue`].
    pub fn float(&self, name: &str) -> Result<f64, ClientError> {
        match self.get(name) {
            Some(Value::Float(value)) => Ok(*value),
            other => Err(no_such_value(name, "float", other)),
        }
    }

    /// A boolean parameter. Errors: [`ClientError::NoSuchValue`].
    pub fn boolean(&self, name: &str) -> Result<bool, ClientError> {
        match self.get(name) {
            Some(Value::Boolean(value)) => Ok(*value),
            other => Err(no_such_value(name, "boolean", other)),
        }
    }

    /// A categorical parameter whose values are words. Errors: [`ClientError::NoSuchValue`].
    pub fn text(&self, name: &str) -> Result<&str, ClientError> {
        match self.get(name) {
            Some(Value::Text(value)) => Ok(value),
            other => Err(no_such_value(name, "text", other)),
        }
    }

    /// Names and values, by name.
    pub fn iter(&self) -> impl Iterator<Item = (&str, &Value)> {
        self.0.iter().map(|(name, value)| (name.as_str(), value))
    }

    /// How many values there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.0.len()
    }

    /// Whether there is no value at all.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }
}

impl FromIterator<(String, Value)> for Configuration {
    fn from_iter<I: IntoIterator<Item = (String, Value)>>(values: I) -> Self {
        Self(values.into_iter().collect())
    }
}

impl fmt::Display for Configuration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, (name, value)) in self.iter().enumerate() {
            let separator = if index == 0 { "" } else { " " };
            write!(f, "{separator}{name}={value}")?;
        }
        Ok(())
    }
}

fn no_such_value(name: &str, wanted: &'static str, found: Option<&Value>) -> ClientError {
    let found = found
        .map_or_else(|| "nothing of that name".to_owned(), |value| format!("the {} {value}", value.kind()));
    ClientError::NoSuchValue { name: name.to_owned(), wanted, found }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn typed_getters_say_what_is_there_instead() {
        let configuration = Configuration::new()
            .with("quality", 2)
            .with("split", "sah")
            .with("cost", 1.5)
            .with("compact", true);
        assert_eq!(configuration.integer("quality").unwrap(), 2);
        assert_eq!(configuration.text("split").unwrap(), "sah");
        assert!((configuration.float("cost").unwrap() - 1.5).abs() < f64::EPSILON);
        assert!(configuration.boolean("compact").unwrap());
        assert_eq!(
            configuration.float("quality").unwrap_err().to_string(),
            "the configuration has no float named `quality`: found the integer 2"
        );
        assert!(configuration.integer("depth").unwrap_err().to_string().contains("nothing of that name"));
    }

    #[test]
    fn written_values_are_read_back_as_the_same_type() {
        for value in
            [Value::from(true), Value::from(-3), Value::from(2.0), Value::from(0.125), Value::from("sah")]
        {
            assert_eq!(Value::parse(&value.to_string()), value);
        }
        assert_eq!(Value::parse("\"12\""), Value::from("12"));
        assert_eq!(Value::parse("nan"), Value::from("nan"));
    }

    #[test]
    fn configurations_are_ordered_by_name() {
        let configuration = Configuration::new().with("b", 1).with("a", 2.0);
        assert_eq!(configuration.to_string(), "a=2.0 b=1");
        assert_eq!(configuration, Configuration::new().with("a", 2.0).with("b", 1));
    }
}
