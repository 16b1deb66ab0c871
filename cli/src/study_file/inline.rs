//! Limits and cheaper levels, and how options have these and parameters in one word.

use std::ops::RangeInclusive;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use treewright_client::{Domain, Fidelity, MeasurementLimit, Parameter, Scale, Value};

use super::{IndicatorEntry, Kind, Number, ParameterEntry, Plain};

/// A limit on a measurement, on either side or both.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct LimitEntry {
    /// Name of a measurement.
    pub(crate) metric: String,
    /// The smallest allowed value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) at_least: Option<f64>,
    /// The largest allowed value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) at_most: Option<f64>,
}

impl LimitEntry {
    pub(super) fn of(limit: &MeasurementLimit) -> Self {
        let MeasurementLimit { metric, at_least, at_most } = limit.clone();
        Self { metric, at_least, at_most }
    }

    /// Reads `NAME<=NUMBER` or `NAME>=NUMBER`.
    pub(crate) fn inline(text: &str) -> Result<Self, String> {
        let wrong =
            || "a limit is written NAME<=NUMBER or NAME>=NUMBER, for example 'memory_mb<=2000'".to_owned();
        let (metric, end, is_upper) = match (text.split_once("<="), text.split_once(">=")) {
            (Some((metric, end)), None) => (metric, end, true),
            (None, Some((metric, end))) => (metric, end, false),
            _ => return Err(wrong()),
        };
        let end: f64 = end.trim().parse().map_err(|_| wrong())?;
        let (at_least, at_most) = if is_upper { (None, Some(end)) } else { (Some(end), None) };
        Ok(Self { metric: metric.trim().to_owned(), at_least, at_most })
    }
}

/// A cheaper level at which a trial can run.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct FidelityEntry {
    /// 1 to 64 of `A-Z`, `a-z`, `0-9`, `_`, `-` and `.`, in quotes.
    pub(crate) name: String,
    /// The cost of a trial there, as a share of a full one; above that of the level before, below 1.
    pub(crate) cost: f64,
}

impl FidelityEntry {
    pub(super) fn of(level: &Fidelity) -> Self {
        let Fidelity { name, cost } = level.clone();
        Self { name, cost }
    }

    /// Reads `NAME=COST`.
    pub(crate) fn inline(text: &str) -> Result<Self, String> {
        let parts = text.split_once('=').map(|(name, cost)| (name.trim(), cost.trim().parse::<f64>()));
        match parts {
            Some((name, Ok(cost))) => Ok(Self { name: name.to_owned(), cost }),
            _ => Err(format!(
                "`{text}` is not NAME=COST, the cost as a share of a full run: for example 'small=0.1'"
            )),
        }
    }
}

impl ParameterEntry {
    /// `NAME=LOW..HIGH:DEFAULT`, `NAME=ONE|OTHER:DEFAULT` or `NAME=bool:DEFAULT`, numbers with `:log` if
    /// equal ratios are to be equal steps, and whole numbers with `LOW..HIGH/STEP`.
    pub(crate) fn inline(text: &str) -> Result<Self, String> {
        let wrong =
            || format!("`{text}` is not NAME=LOW..HIGH:DEFAULT, NAME=ONE|OTHER:DEFAULT or NAME=bool:DEFAULT");
        let (name, rest) = text.split_once('=').ok_or_else(wrong)?;
        let (rest, scale) = match rest.strip_suffix(":log") {
            Some(rest) => (rest, Scale::Log),
            None => (rest, Scale::Linear),
        };
        let (domain, default) = rest.rsplit_once(':').ok_or_else(wrong)?;
        let plain = |text: &str| Plain::from(&Value::parse(text.trim()));
        let plainest = Parameter::new(name.trim(), Domain::Boolean, Value::parse(default.trim()));
        let mut entry = Self { kind: Kind::Categorical, scale, ..Self::of(&plainest) };
        if let Some((low, high)) = domain.split_once("..") {
            let (high, step) = high.split_once('/').map_or((high, None), |(high, step)| (high, Some(step)));
            let step =
                step.map(|step| step.trim().parse().map_err(|_| format!("`{step}` is no whole number")));
            entry.step = step.transpose()?;
            let number = |text: &str| match plain(text) {
                Plain::Integer(integer) => Ok(Number::Integer(integer)),
                Plain::Float(float) => Ok(Number::Float(float)),
                _ => Err(format!("`{text}` in `{domain}` is no number")),
            };
            let (min, max) = (number(low)?, number(high.trim_start_matches('='))?);
            let all_whole = matches!(
                (min, max, &entry.default),
                (Number::Integer(_), Number::Integer(_), Plain::Integer(_))
            );
            entry.kind = if all_whole { Kind::Integer } else { Kind::Float };
            (entry.min, entry.max) = (Some(min), Some(max));
        } else if domain.trim() == "bool" {
            entry.kind = Kind::Boolean;
        } else {
            entry.values = domain.split('|').map(plain).collect();
        }
        Ok(entry)
    }
}

impl IndicatorEntry {
    /// One with a linear scale.
    pub(crate) fn inline(name: &str, range: RangeInclusive<f64>) -> Self {
        let (min, max) = (Number::Float(*range.start()), Number::Float(*range.end()));
        Self { name: name.to_owned(), min, max, scale: Scale::Linear }
    }
}
