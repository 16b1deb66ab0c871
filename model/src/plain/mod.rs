//! Values without their kinds, in JSON for people and other programs: `{"quality":2}`, where stored rows have
//! `{"quality":{"integer":2}}`.

mod spec;

use serde::{Serialize, Serializer};

use crate::value::{RawConfiguration, Value};

/// Serialises its target, with values as bare numbers, words and switches.
#[derive(Clone, Copy, Debug)]
pub struct Plain<'a, T: ?Sized>(pub &'a T);

impl Serialize for Plain<'_, Value> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self.0 {
            Value::Integer(integer) => serializer.serialize_i64(*integer),
            Value::Float(float) => serializer.serialize_f64(*float),
            Value::Text(text) => serializer.serialize_str(text),
            Value::Boolean(boolean) => serializer.serialize_bool(*boolean),
        }
    }
}

impl Serialize for Plain<'_, [Value]> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_seq(self.0.iter().map(Plain))
    }
}

impl Serialize for Plain<'_, RawConfiguration> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_map(self.0.iter().map(|(name, value)| (name, Plain(value))))
    }
}

/// For `#[serde(serialize_with = "…::plain")]`.
///
/// # Errors
/// The errors of the serializer.
pub fn plain<T, S: Serializer>(value: &T, serializer: S) -> Result<S::Ok, S::Error>
where
    for<'a> Plain<'a, T>: Serialize,
{
    Plain(value).serialize(serializer)
}

/// For `#[serde(skip_serializing_if = "…::is_default")]`: rows leave out what a reader takes for granted.
pub fn is_default<T: Default + PartialEq>(value: &T) -> bool {
    *value == T::default()
}
