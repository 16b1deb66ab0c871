//! Parameters and limits in one word, as options have them.

use std::ops::RangeInclusive;

use treewright_client::Value;

use super::{IndicatorEntry, Kind, LimitEntry, Number, ParameterEntry, Plain, ScaleWord};

impl ParameterEntry {
    /// `NAME=LOW..HIGH:DEFAULT`, `NAME=ONE|OTHER:DEFAULT` or `NAME=bool:DEFAULT`, numbers with `:log` if
    /// equal ratios are to be equal steps, and whole numbers with `LOW..HIGH/STEP`.
    pub(crate) fn inline(text: &str) -> Result<Self, String> {
        let wrong =
            || format!("`{text}` is not NAME=LOW..HIGH:DEFAULT, NAME=ONE|OTHER:DEFAULT or NAME=bool:DEFAULT");
        let (name, rest) = text.split_once('=').ok_or_else(wrong)?;
        let (rest, scale) = match rest.strip_suffix(":log") {
            Some(rest) => (rest, ScaleWord::Log),
            None => (rest, ScaleWord::Linear),
        };
        let (domain, default) = rest.rsplit_once(':').ok_or_else(wrong)?;
        let plain = |text: &str| Plain::from(&Value::parse(text.trim()));
        let mut entry = Self {
            name: name.trim().to_owned(),
            kind: Kind::Categorical,
            min: None,
            max: None,
            step: None,
            scale,
            values: Vec::new(),
            default: plain(default),
            active_if: None,
        };
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
        Self { name: name.to_owned(), min, max, scale: ScaleWord::Linear }
    }
}

impl LimitEntry {
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
