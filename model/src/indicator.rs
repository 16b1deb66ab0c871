//! Indicators: the numbers that describe an input, and their common scale.
//!
//! Paper section 6.2: indicators span very different ranges, and the widest would dominate a distance between
//! states. So each is mapped to 0..1 by a range that the study declares.

use std::collections::{BTreeMap, BTreeSet};

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::limits::{INDICATORS_MAX, NORMALISED_MAGNITUDE_MAX};
use crate::names::{NAME_RULE, is_name};
use crate::space::Scale;

/// One number that describes the input.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Indicator {
    /// Spelt like a parameter.
    pub name: String,
    /// The value that maps to 0. Finite.
    pub min: f64,
    /// The value that maps to 1. Finite, greater than `min`.
    pub max: f64,
    /// `Log` maps `ln(1 + value - min)`, which keeps 0 in range.
    pub scale: Scale,
}

impl Indicator {
    /// Maps a finite value: `min` to 0, `max` to 1, values outside to numbers beyond 0..1 on that scale
    /// (mirrored below `min` where the scale is logarithmic). The result is finite, at most
    /// [`NORMALISED_MAGNITUDE_MAX`] in magnitude.
    pub fn normalise(&self, value: f64) -> f64 {
        // Halves keep the differences of numbers as large as 1.7e308 finite.
        let offset = value / 2.0 - self.min / 2.0;
        let range = self.max / 2.0 - self.min / 2.0;
        let normalised = match self.scale {
            Scale::Linear => offset / range,
            Scale::Log => offset.signum() * ln_one_plus_twice(offset.abs()) / ln_one_plus_twice(range),
        };
        // 0/0 arises where the range is so small that its half is zero; the value is then at `min`.
        let normalised = if normalised.is_nan() { 0.0 } else { normalised };
        normalised.clamp(-NORMALISED_MAGNITUDE_MAX, NORMALISED_MAGNITUDE_MAX) + 0.0
    }
}

/// `ln(1 + 2 half)` for `half >= 0`, without overflow.
fn ln_one_plus_twice(half: f64) -> f64 {
    if half < f64::MAX / 4.0 { libm::log1p(2.0 * half) } else { libm::log(half) + std::f64::consts::LN_2 }
}

/// The indicators of a study, in the order in which normalised states list them. May be empty.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "Vec<Indicator>", into = "Vec<Indicator>")]
pub struct IndicatorSchema {
    pub(crate) indicators: Vec<Indicator>,
}

/// Why a schema or a set of indicator values is refused: names the indicator, the mistake and its remedy.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("{0}")]
pub struct IndicatorError(String);

impl IndicatorSchema {
    /// Checks and takes the indicators.
    pub fn new(indicators: Vec<Indicator>) -> Result<Self, IndicatorError> {
        if indicators.len() > INDICATORS_MAX {
            let count = indicators.len();
            return refuse(format!("{count} indicators; at most {INDICATORS_MAX} are allowed"));
        }
        let mut seen = BTreeSet::new();
        for Indicator { name, min, max, .. } in &indicators {
            if !is_name(name) {
                return refuse(format!("indicator {name:?} is not a name; use {NAME_RULE}"));
            }
            if !seen.insert(name) {
                return refuse(format!("indicator {name:?} is listed twice; remove one"));
            }
            if !min.is_finite() || !max.is_finite() || min >= max {
                return refuse(format!(
                    "indicator {name:?} has range {min} to {max}; both must be finite and min less than max"
                ));
            }
        }
        Ok(IndicatorSchema { indicators })
    }

    /// The indicators in order.
    pub fn indicators(&self) -> &[Indicator] {
        &self.indicators
    }

    /// The state: one normalised number per indicator, in the schema's order. Exactly the schema's
    /// indicators must be given, all finite.
    pub fn normalise(&self, values: &BTreeMap<String, f64>) -> Result<Vec<f64>, IndicatorError> {
        let mut state = Vec::with_capacity(self.indicators.len());
        for indicator in &self.indicators {
            let name = &indicator.name;
            let Some(&value) = values.get(name) else {
                return refuse(format!(
                    "indicator {name:?} is missing; send a value for each indicator of the study"
                ));
            };
            if !value.is_finite() {
                return refuse(format!("indicator {name:?} is {value}; it must be finite"));
            }
            state.push(indicator.normalise(value));
        }
        if values.len() == self.indicators.len() {
            return Ok(state);
        }
        let names: Vec<&str> = self.indicators.iter().map(|indicator| indicator.name.as_str()).collect();
        let unknown = values.keys().find(|name| !names.contains(&name.as_str())).cloned().unwrap_or_default();
        let known = if names.is_empty() { "none".to_owned() } else { names.join(", ") };
        refuse(format!("indicator {unknown:?} is unknown; the study has {known}"))
    }
}

fn refuse<T>(problem: String) -> Result<T, IndicatorError> {
    Err(IndicatorError(problem))
}

impl TryFrom<Vec<Indicator>> for IndicatorSchema {
    type Error = IndicatorError;

    fn try_from(indicators: Vec<Indicator>) -> Result<Self, IndicatorError> {
        IndicatorSchema::new(indicators)
    }
}

impl From<IndicatorSchema> for Vec<Indicator> {
    fn from(schema: IndicatorSchema) -> Self {
        schema.indicators
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn finite() -> impl Strategy<Value = f64> {
        use prop::num::f64::{NEGATIVE, NORMAL, POSITIVE, SUBNORMAL, ZERO};
        POSITIVE | NEGATIVE | NORMAL | SUBNORMAL | ZERO
    }

    fn indicator(min: f64, max: f64, scale: Scale) -> Indicator {
        Indicator { name: "x".into(), min, max, scale }
    }

    #[test]
    fn ends_of_the_range_map_to_zero_and_one() {
        for scale in [Scale::Linear, Scale::Log] {
            for (min, max) in [(0.0, 1e7), (-10.0, 10.0), (-1.7e308, 1.7e308), (0.0, 1e-2)] {
                let indicator = indicator(min, max, scale);
                assert_eq!(indicator.normalise(min), 0.0);
                assert!((indicator.normalise(max) - 1.0).abs() < 1e-12);
            }
        }
        let triangles = indicator(0.0, 1e7, Scale::Log);
        assert!(triangles.normalise(1e3) > 0.4 && triangles.normalise(1e3) < 0.45);
    }

    #[test]
    fn missing_unknown_and_non_finite_values_are_named() {
        let schema = IndicatorSchema::new(vec![indicator(0.0, 1.0, Scale::Linear)]).expect("valid");
        let state = |pairs: &[(&str, f64)]| {
            schema.normalise(&pairs.iter().map(|(name, value)| ((*name).to_owned(), *value)).collect())
        };
        assert_eq!(state(&[("x", 0.25)]), Ok(vec![0.25]));
        assert!(state(&[]).expect_err("missing").to_string().contains("\"x\" is missing"));
        assert!(
            state(&[("x", 0.0), ("y", 0.0)]).expect_err("unknown").to_string().contains("\"y\" is unknown")
        );
        for (value, text) in [(f64::NAN, "NaN"), (f64::INFINITY, "inf"), (f64::NEG_INFINITY, "-inf")] {
            let refused = state(&[("x", value)]).expect_err("not finite").to_string();
            assert!(refused.contains(&format!("\"x\" is {text}")), "{refused}");
        }
    }

    proptest! {
        #![proptest_config(crate::testing::cases(256))]

        #[test]
        fn normalised_values_are_finite_and_keep_their_order(
            a in finite(), b in finite(), low in finite(), high in finite(), log in any::<bool>(),
        ) {
            let (low, high) = (low.min(high), low.max(high));
            // Such an indicator is refused. An assumption of the property test would end long runs, because
            // the number of dropped cases is limited.
            if low == high {
                return Ok(());
            }
            let indicator = indicator(low, high, if log { Scale::Log } else { Scale::Linear });
            let (small, large) = (a.min(b), a.max(b));
            let (small, large) = (indicator.normalise(small), indicator.normalise(large));
            prop_assert!(small.is_finite() && large.is_finite());
            prop_assert!(small <= large);
        }
    }
}
