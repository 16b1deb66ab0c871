//! Named numbers, of two kinds that must not be mixed up: indicators go in, measurements come out.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

macro_rules! named_numbers {
    ($(#[$doc:meta])* $type:ident $(, $errors:ty)?) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $type(pub(crate) BTreeMap<String, f64> $(, #[serde(skip)] pub(crate) $errors)?);

        impl $type {
            /// An empty set.
            pub fn new() -> Self {
                Self::default()
            }

            /// These numbers with one more, or with that one replaced.
            #[must_use]
            pub fn with(mut self, name: impl Into<String>, value: f64) -> Self {
                self.set(name, value);
                self
            }

            /// Adds or replaces a number.
            pub fn set(&mut self, name: impl Into<String>, value: f64) {
                self.0.insert(name.into(), value);
            }

            /// The number of that name.
            pub fn get(&self, name: &str) -> Option<f64> {
                self.0.get(name).copied()
            }

            /// Names and numbers, by name.
            pub fn iter(&self) -> impl Iterator<Item = (&str, f64)> {
                self.0.iter().map(|(name, value)| (name.as_str(), *value))
            }

            /// The number of entries.
            pub fn len(&self) -> usize {
                self.0.len()
            }

            /// Whether there is none.
            pub fn is_empty(&self) -> bool {
                self.0.is_empty()
            }
        }

        impl<N: Into<String>, const COUNT: usize> From<[(N, f64); COUNT]> for $type {
            fn from(numbers: [(N, f64); COUNT]) -> Self {
                numbers.into_iter().collect()
            }
        }

        impl<N: Into<String>> FromIterator<(N, f64)> for $type {
            fn from_iter<I: IntoIterator<Item = (N, f64)>>(numbers: I) -> Self {
                let numbers = numbers.into_iter().map(|(name, value)| (name.into(), value));
                Self(numbers.collect() $(, <$errors>::default())?)
            }
        }
    };
}

named_numbers! {
    /// A description of the input at the moment: one raw number for each indicator of the study, in the
    /// indicator's own unit. The service does the normalising.
    Indicators
}

named_numbers! {
    /// Measurements with a trial's configuration, e.g. `build_ms` and `render_ms`: kept raw by the service.
    /// At most 64, finite, not negative; names spelt like a parameter's.
    Measurements, BTreeMap<String, f64>
}

impl Measurements {
    /// The most entries of a report.
    pub const MOST: usize = treewright_model::limits::MEASUREMENTS_MAX;

    /// These measurements, of which the named one is an estimate with this standard error: finite, not
    /// negative, in its unit. One whose error is large beside the state's noise counts for less than others.
    #[must_use]
    pub fn with_standard_error(mut self, name: impl Into<String>, error: f64) -> Self {
        self.1.insert(name.into(), error);
        self
    }

    /// Whether the service takes the name: 1 to 64 characters of `a-z`, `0-9` and `_`, beginning with a
    /// letter.
    pub fn is_name(name: &str) -> bool {
        treewright_model::names::is_name(name)
    }
}
