//! Values of parameters, with a total order so that configurations can be compared, sorted and hashed.

use std::cmp::Ordering;
use std::collections::BTreeMap;
use std::fmt;
use std::hash::{Hash, Hasher};

use serde::{Deserialize, Serialize};

/// A value of a parameter.
///
/// Equality, order and hash are total and agree with each other. Floats compare by their canonical form:
/// `-0.0` equals `0.0`, and every NaN equals every other; a [`Space`](crate::space::Space) refuses NaN and
/// infinities, so they never reach a configuration.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Value {
    /// A whole number, -2^53 to 2^53.
    Integer(i64),
    /// A finite number.
    Float(f64),
    /// A name of a choice.
    Text(String),
    /// A switch.
    Boolean(bool),
}

/// A configuration that has not been checked against a space yet, from the wire or from a table.
/// [`Space::configuration`](crate::space::Space::configuration) turns it into a
/// [`Configuration`](crate::configuration::Configuration).
pub type RawConfiguration = BTreeMap<String, Value>;

impl Value {
    /// The kind of the value in one word, for messages.
    pub fn kind(&self) -> &'static str {
        match self {
            Value::Integer(_) => "integer",
            Value::Float(_) => "float",
            Value::Text(_) => "text",
            Value::Boolean(_) => "boolean",
        }
    }

    /// The value as a number, where it is one.
    pub fn as_number(&self) -> Option<f64> {
        match self {
            // Integers are limited to 2^53, so nothing is lost.
            Value::Integer(integer) => Some(*integer as f64),
            Value::Float(float) => Some(*float),
            Value::Text(_) | Value::Boolean(_) => None,
        }
    }

    /// The canonical form: a negative zero becomes zero.
    pub fn canonical(self) -> Value {
        match self {
            // Adding a positive zero turns -0.0 into 0.0 and leaves every other number alone.
            Value::Float(float) => Value::Float(float + 0.0),
            other => other,
        }
    }

    /// Reads a value from text: `true`, `32`, `0.5`, or else text. A value in double quotes is text.
    pub fn parse(text: &str) -> Self {
        if let Some(quoted) = text.strip_prefix('"').and_then(|rest| rest.strip_suffix('"')) {
            return Value::Text(quoted.to_owned());
        }
        if let Ok(boolean) = text.parse() {
            return Value::Boolean(boolean);
        }
        if let Ok(integer) = text.parse() {
            return Value::Integer(integer);
        }
        match text.parse::<f64>() {
            Ok(float) if float.is_finite() => Value::Float(float),
            _ => Value::Text(text.to_owned()),
        }
    }

    /// A text that differs for different values: text values are in double quotes, with escapes.
    pub fn quoted(&self) -> impl fmt::Display {
        struct Quoted<'a>(&'a Value);
        impl fmt::Display for Quoted<'_> {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                match self.0 {
                    Value::Text(text) => write!(f, "{text:?}"),
                    other => other.fmt(f),
                }
            }
        }
        Quoted(self)
    }

    fn rank(&self) -> u8 {
        match self {
            Value::Integer(_) => 0,
            Value::Float(_) => 1,
            Value::Text(_) => 2,
            Value::Boolean(_) => 3,
        }
    }
}

fn canonical_float(float: f64) -> f64 {
    if float.is_nan() { f64::NAN.abs() } else { float + 0.0 }
}

impl Ord for Value {
    fn cmp(&self, other: &Self) -> Ordering {
        match (self, other) {
            (Value::Integer(a), Value::Integer(b)) => a.cmp(b),
            (Value::Float(a), Value::Float(b)) => canonical_float(*a).total_cmp(&canonical_float(*b)),
            (Value::Text(a), Value::Text(b)) => a.cmp(b),
            (Value::Boolean(a), Value::Boolean(b)) => a.cmp(b),
            _ => self.rank().cmp(&other.rank()),
        }
    }
}

impl PartialOrd for Value {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

impl PartialEq for Value {
    fn eq(&self, other: &Self) -> bool {
        self.cmp(other) == Ordering::Equal
    }
}

impl Eq for Value {}

impl Hash for Value {
    fn hash<H: Hasher>(&self, state: &mut H) {
        self.rank().hash(state);
        match self {
            Value::Integer(integer) => integer.hash(state),
            Value::Float(float) => canonical_float(*float).to_bits().hash(state),
            Value::Text(text) => text.hash(state),
            Value::Boolean(boolean) => boolean.hash(state),
        }
    }
}

macro_rules! from {
    ($($type:ty => $kind:ident;)+) => {
        $(
            impl From<$type> for Value {
                fn from(value: $type) -> Self {
                    Value::$kind(value.into())
                }
            }
        )+
    };
}

from! {
    bool => Boolean;
    i32 => Integer;
    u32 => Integer;
    i64 => Integer;
    f64 => Float;
    &str => Text;
    String => Text;
}

/// Integers, booleans and text as usual, floats in the shortest form that reads back exactly (always with a
/// point or an exponent).
impl fmt::Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Value::Integer(integer) => write!(f, "{integer}"),
            Value::Float(float) => write!(f, "{float:?}"),
            Value::Text(text) => f.write_str(text),
            Value::Boolean(boolean) => write!(f, "{boolean}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::Value;

    #[test]
    fn zeros_are_equal_and_kinds_are_not() {
        assert_eq!(Value::Float(0.0), Value::Float(-0.0));
        assert_eq!(Value::Float(-0.0).canonical().to_string(), "0.0");
        assert_ne!(Value::Integer(1), Value::Float(1.0));
        assert_ne!(Value::Boolean(true), Value::Integer(1));
        let all = [Value::Float(-0.0), Value::Float(0.0), Value::Text("0".into()), Value::Integer(0)];
        assert_eq!(all.into_iter().collect::<BTreeSet<_>>().len(), 3);
    }

    #[test]
    fn written_values_are_read_back_as_the_same_kind() {
        for value in
            [Value::from(true), Value::from(-3), Value::from(2.0), Value::from(0.125), Value::from("sah")]
        {
            assert_eq!(Value::parse(&value.to_string()), value);
        }
        assert_eq!(Value::parse("\"12\""), Value::from("12"));
        assert_eq!(Value::from("12").quoted().to_string(), "\"12\"");
        assert_eq!(Value::parse("nan"), Value::from("nan"));
    }
}
