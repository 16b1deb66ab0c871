//! Named numbers, of two kinds that must not be mixed up: indicators go in, measurements come out.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::{ClientError, limits};

macro_rules! named_numbers {
    ($(#[$doc:meta])* $type:ident) => {
        $(#[$doc])*
        #[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
        #[serde(transparent)]
        pub struct $type(pub(crate) BTreeMap<String, f64>);

        impl $type {
            /// An empty set.
            #[must_use]
            pub fn new() -> Self {
                Self::default()
            }

            /// The same with one number more, or with that number replaced.
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
            #[must_use]
            pub fn get(&self, name: &str) -> Option<f64> {
                self.0.get(name).copied()
            }

            /// Names and numbers, by name.
            pub fn iter(&self) -> impl Iterator<Item = (&str, f64)> {
                self.0.iter().map(|(name, value)| (name.as_str(), *value))
            }

            /// How many there are.
            #[must_use]
            pub fn len(&self) -> usize {
                self.0.len()
            }

            /// Whether there is none.
            #[must_use]
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
                Self(numbers.into_iter().map(|(name, value)| (name.into(), value)).collect())
            }
        }
    };
}

named_numbers! {
    /// What describes the input at the moment: one raw number for each indicator of the study, in the
    /// indicator's own unit. The service does the normalising.
    Indicators
}

named_numbers! {
    /// What was measured with a trial's configuration, e.g. `build_ms` and `render_ms`: kept raw by the
    /// service. At most 64, finite, not negative; names spelt like a parameter's.
    Measurements
}

impl Measurements {
    /// Checks what the service would refuse. Errors: [`ClientError::Invalid`] naming the measurement.
    pub(crate) fn check(&self) -> Result<(), ClientError> {
        if self.len() > limits::MEASUREMENTS {
            let problem = format!("{} of them; a report holds at most {}", self.len(), limits::MEASUREMENTS);
            return Err(ClientError::invalid("measurements", problem));
        }
        for (name, value) in self.iter() {
            let what = || format!("measurement `{name}`");
            check_name(&what(), name)?;
            if !(value.is_finite() && value >= 0.0) {
                return Err(ClientError::invalid(
                    what(),
                    format!("{value} is not a finite number of at least 0"),
                ));
            }
        }
        Ok(())
    }
}

/// Names follow one rule everywhere: a letter, then letters, digits and `_`, all lower case.
pub(crate) fn check_name(what: &str, name: &str) -> Result<(), ClientError> {
    let spelt = name.starts_with(|first: char| first.is_ascii_lowercase())
        && name.chars().all(|each| each.is_ascii_lowercase() || each.is_ascii_digit() || each == '_');
    if spelt && name.len() <= limits::NAME_BYTES {
        return Ok(());
    }
    let rule = format!(
        "a name has 1 to {} characters of a-z, 0-9 and _, and begins with a letter",
        limits::NAME_BYTES
    );
    Err(ClientError::invalid(what, rule))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn measurements_are_checked_before_they_are_sent() {
        assert!(Measurements::from([("build_ms", 0.0), ("render_ms", 12.5)]).check().is_ok());
        for bad in [f64::NAN, f64::INFINITY, -1.0] {
            let error = Measurements::new().with("render_ms", bad).check().unwrap_err().to_string();
            assert!(error.contains("render_ms") && error.contains("finite"), "{error}");
        }
        assert!(Measurements::new().with("Render ms", 1.0).check().is_err());
        let many: Measurements = (0..65).map(|index| (format!("m{index}"), 1.0)).collect();
        assert!(many.check().unwrap_err().to_string().contains("64"));
    }
}
