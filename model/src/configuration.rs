//! Configurations: a value for every active parameter of a space, in canonical form. Unchecked values are in
//! `assignment`.

use std::fmt;
use std::ops::Deref;
use std::sync::Arc;

use serde::{Serialize, Serializer};

use crate::assignment::Assignment;
pub use crate::value::RawConfiguration;

/// A value for every active parameter of a space, and for no other; every value inside its domain, every
/// constraint fulfilled.
///
/// It can only be made by a [`Space`](crate::space::Space), is read like an [`Assignment`], and serialises as
/// a map of values with their kinds. There is on purpose no `Deserialize`: read a [`RawConfiguration`] and
/// hand it to the space.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Configuration {
    /// Shared, because tables, trials and models hold few different configurations.
    values: Arc<Assignment>,
}

impl Configuration {
    /// The only constructor; its caller is the space, which has checked `values`.
    pub(crate) fn from_checked(values: RawConfiguration) -> Self {
        Configuration { values: Arc::new(values.into()) }
    }

    /// The values by parameter name, in the order of the names.
    pub fn values(&self) -> &RawConfiguration {
        self.values.as_raw()
    }

    /// A compact text, equal exactly for equal configurations of one space:
    /// `max_leaf_size=8;robust=false`.
    pub fn key(&self) -> String {
        self.to_string()
    }

    /// The unchecked form, for the wire and for tables.
    pub fn to_raw(&self) -> RawConfiguration {
        self.values().clone()
    }
}

impl fmt::Display for Configuration {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, (name, value)) in self.values().iter().enumerate() {
            let separator = if index == 0 { "" } else { ";" };
            write!(f, "{separator}{name}={}", value.quoted())?;
        }
        Ok(())
    }
}

impl From<Configuration> for RawConfiguration {
    fn from(configuration: Configuration) -> Self {
        Arc::unwrap_or_clone(configuration.values).into()
    }
}

impl Deref for Configuration {
    type Target = Assignment;

    fn deref(&self) -> &Assignment {
        &self.values
    }
}

impl PartialEq<Assignment> for Configuration {
    fn eq(&self, other: &Assignment) -> bool {
        *self.values == *other
    }
}

impl From<Configuration> for Assignment {
    fn from(configuration: Configuration) -> Self {
        Arc::unwrap_or_clone(configuration.values)
    }
}

impl Serialize for Configuration {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        self.values().serialize(serializer)
    }
}

/// For checkpoints alone, whose reader checks every configuration against its space before any use.
pub mod unchecked {
    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use super::{Configuration, RawConfiguration};

    /// Writes the values.
    pub fn serialize<S: Serializer>(value: &Configuration, serializer: S) -> Result<S::Ok, S::Error> {
        value.serialize(serializer)
    }

    /// Reads values without checking them.
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Configuration, D::Error> {
        RawConfiguration::deserialize(deserializer).map(Configuration::from_checked)
    }
}
