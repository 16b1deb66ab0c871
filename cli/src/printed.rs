//! Reads the measurements from the output of a tuned program: its last JSON object (RFC 8259), on a line of
//! its own or over several, as pretty printers write it.
//!
//! The last object decides, and none but the last. Where it lacks the objective's metric, or cannot be read,
//! an earlier one would be the result of something else: of an epoch before, say. So such a run has no
//! result, and the reason is shown. Words that other languages print for numbers (`NaN`, `inf`, `None`,
//! `-Infinity`, `1e999`) are no numbers, and do not make the object unreadable.

use std::fmt;

use serde_json::{Map, Value};
use treewright_client::{MeasurementLimit, Measurements, ObjectiveTerm};

/// Longest piece of an output that a reason quotes, in characters.
const QUOTED_CHARACTERS: usize = 60;
/// Most printed names that are shown where a metric is missing.
const NAMES_SHOWN: usize = 8;
const NAMES_ARE: &str = "names are a-z, 0-9 and _, beginning with a letter";

/// The measurements in the last JSON object of an output.
#[derive(Clone, Debug, PartialEq)]
pub enum Printed {
    /// All that is minimised was measured.
    Measured {
        /// The numbers that can be reported: finite, at least 0, under names that the service takes, and as
        /// many as it takes at most.
        measurements: Measurements,
        /// Other printed numbers that cannot be reported.
        left_out: Vec<LeftOut>,
    },
    /// The program says that the configuration cannot be used, and why.
    Infeasible(String),
    /// There is no result, for this reason.
    NoResult(String),
}

/// A number beside the objective that cannot be reported.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct LeftOut {
    /// As printed, shortened where it is long.
    pub name: String,
    /// The reason, in words.
    pub why: String,
}

impl fmt::Display for LeftOut {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} ({})", self.name, self.why)
    }
}

/// The metrics that an output is read for.
#[derive(Clone, Copy, Debug)]
pub struct Wanted<'a> {
    /// Metrics that every run measures, with their weights in the cost.
    pub terms: &'a [ObjectiveTerm],
    /// Metrics among them that are to be large.
    pub maximised: &'a [String],
    /// A run beyond one of these has a result whatever its cost: the configuration is infeasible.
    pub limits: &'a [MeasurementLimit],
    /// Most measurements that are taken, at most [`Measurements::MOST`].
    pub most: usize,
}

/// Reads an output. `taken` is what was measured from outside; a number that the program prints under that
/// name counts in its place.
pub fn read(out: &str, wanted: Wanted<'_>, taken: &Measurements) -> Printed {
    let Wanted { terms, maximised, limits, most } = wanted;
    let found = match last_object(out) {
        Ok(found) => found,
        Err(problem) => return Printed::NoResult(problem),
    };
    let is_missing = found.is_none();
    let found = found.unwrap_or_default();
    match found.get("infeasible") {
        Some(Value::String(why)) if !why.trim().is_empty() => return Printed::Infeasible(why.clone()),
        Some(Value::String(_) | Value::Bool(true)) => {
            return Printed::Infeasible("no reason given".to_owned());
        }
        _ => {}
    }
    let mut measurements = Measurements::new();
    for ObjectiveTerm { metric, .. } in terms {
        let is_maximised = maximised.contains(metric);
        match number(metric, is_maximised, found.get(metric), taken.get(metric)) {
            Ok(Some(value)) => measurements.set(metric.clone(), value),
            Ok(None) => return Printed::NoResult(missing(metric, &found, is_missing)),
            Err(problem) => return Printed::NoResult(problem),
        }
    }
    let is_beyond =
        |limit: &MeasurementLimit| measurements.get(&limit.metric).is_some_and(|value| !limit.allows(value));
    if limits.iter().any(is_beyond) {
        return further(&found, taken, measurements, most);
    }
    let mut cost = 0.0;
    for ObjectiveTerm { metric, weight } in terms {
        let value = measurements.get(metric).unwrap_or_default();
        if !maximised.contains(metric) {
            cost += weight * value;
        } else if (weight / value).is_finite() {
            cost += weight / value;
        } else {
            return Printed::NoResult(format!("{metric} is {value}, and what is maximised must be above 0"));
        }
    }
    if !cost.is_finite() {
        return Printed::NoResult("what is minimised is too large a number".to_owned());
    }
    further(&found, taken, measurements, most)
}

/// The value of a metric of the objective; `None` where it was neither printed nor taken.
fn number(
    metric: &str,
    is_maximised: bool,
    printed: Option<&Value>,
    taken: Option<f64>,
) -> Result<Option<f64>, String> {
    let Some(printed) = printed else { return Ok(taken) };
    Err(match printed {
        Value::Number(number) => match number.as_f64() {
            Some(value) if value >= 0.0 && value.is_finite() => return Ok(Some(value)),
            Some(value) if value.is_finite() => match is_maximised {
                true => format!("{metric} is {value}, and what is maximised must be above 0"),
                false => format!("{metric} is {value}, and measurements must be at least 0"),
            },
            _ => format!("{metric} is {number}, not a finite number"),
        },
        Value::String(text) if text.starts_with(NOT_A_NUMBER) => {
            format!("{metric} is {}, not a finite number", short(text))
        }
        Value::Array(_) => format!("{metric} is a list, not a number"),
        Value::Object(_) => format!("{metric} is an object, not a number"),
        Value::Null | Value::Bool(_) | Value::String(_) => {
            format!("{metric} is {}, not a number", short(&printed.to_string()))
        }
    })
}

/// Says that a metric is missing, and lists the keys that are there.
fn missing(metric: &str, found: &Map<String, Value>, is_missing: bool) -> String {
    if is_missing {
        return format!(
            "{metric} is missing: it printed no JSON object, which should say it, like {{\"{metric}\": 1.5}}"
        );
    }
    let names: Vec<_> = found.keys().take(NAMES_SHOWN).map(|name| short(name)).collect();
    let holds = if names.is_empty() { "nothing".to_owned() } else { names.join(", ") };
    format!("{metric} is missing in the last JSON object that it printed, which holds {holds}")
}

/// Adds what can be reported besides, up to `most` in all.
fn further(
    found: &Map<String, Value>,
    taken: &Measurements,
    mut measurements: Measurements,
    most: usize,
) -> Printed {
    let is_of_objective: Vec<String> = measurements.iter().map(|(name, _)| name.to_owned()).collect();
    for (name, value) in taken.iter() {
        if measurements.get(name).is_none() {
            measurements.set(name, value);
        }
    }
    let mut left_out = Vec::new();
    for (name, value) in found.iter().filter(|(name, _)| !is_of_objective.contains(name)) {
        let value = match value {
            Value::Number(number) => number.as_f64().unwrap_or(f64::NAN),
            Value::String(text) if text.starts_with(NOT_A_NUMBER) => f64::NAN,
            // Some languages write this in JSON for a number that is not finite.
            Value::Null => f64::NAN,
            _ => continue,
        };
        let is_new = measurements.get(name).is_none();
        let why = match value {
            _ if !Measurements::is_name(name) => NAMES_ARE.to_owned(),
            _ if !value.is_finite() => "not a finite number".to_owned(),
            _ if value < 0.0 => "below 0".to_owned(),
            _ if is_new && measurements.len() >= most => {
                format!("a run has {} measurements at most", Measurements::MOST)
            }
            _ => {
                measurements.set(name.clone(), value);
                continue;
            }
        };
        left_out.push(LeftOut { name: short(name), why });
    }
    Printed::Measured { measurements, left_out }
}

/// Begins the text that stands for a word in place of a number. No program prints it.
const NOT_A_NUMBER: char = '\u{1}';

/// The last object; `None` where nothing that was printed looks like one. The error says why the last cannot
/// be read.
fn last_object(out: &str) -> Result<Option<Map<String, Value>>, String> {
    let lines: Vec<&str> = out.split(['\n', '\r']).map(|line| line.trim_start_matches('\u{feff}')).collect();
    for (index, line) in lines.iter().enumerate().rev() {
        if looks_like_an_object(line.trim()) {
            return object(line.trim()).map(Some);
        }
        // The end of one over several lines, whose first line is as far to the left.
        if line.trim_end() == "}"
            && let Some(begin) = lines[..index].iter().rposition(|line| line.starts_with('{'))
        {
            return object(&lines[begin..=index].join("\n")).map(Some);
        }
    }
    Ok(None)
}

/// Whether a line is meant as an object: it begins like one, even if it was cut off, or it stands in braces
/// and has a key.
fn looks_like_an_object(line: &str) -> bool {
    let Some(inner) = line.strip_prefix('{').map(str::trim_start) else { return false };
    inner.starts_with(['"', '\'', '}']) || (inner.contains(':') && inner.ends_with('}'))
}

fn object(text: &str) -> Result<Map<String, Value>, String> {
    let found: Map<String, Value> = serde_json::from_str(text)
        .or_else(|_| serde_json::from_str(&with_words_as_text(text)))
        .map_err(|problem| {
            format!("the last JSON object that it printed cannot be read: {}: {problem}", short(text))
        })?;
    // Names without quotation marks are words, too.
    let name = |name: String| name.trim_start_matches(NOT_A_NUMBER).to_owned();
    Ok(found.into_iter().map(|(word, value)| (name(word), value)).collect())
}

/// Quotes each bare word that JSON does not know, and each number beyond a double's range.
fn with_words_as_text(text: &str) -> String {
    let mut done = String::with_capacity(text.len() + 16);
    let mut rest = text;
    while let Some(first) = rest.chars().next() {
        let length = match first {
            '"' => text_length(rest),
            _ if is_of_a_word(first) => rest.find(|each| !is_of_a_word(each)).unwrap_or(rest.len()),
            _ => first.len_utf8(),
        };
        let (token, after) = rest.split_at(length);
        let is_known = !is_of_a_word(first)
            || matches!(token, "true" | "false" | "null")
            || token.parse::<f64>().is_ok_and(f64::is_finite);
        if is_known {
            done.push_str(token);
        } else {
            done.push_str(&Value::String(format!("{NOT_A_NUMBER}{token}")).to_string());
        }
        rest = after;
    }
    done
}

/// Length of the quoted text at the beginning, in bytes, both quotation marks included.
fn text_length(rest: &str) -> usize {
    let mut is_escaped = false;
    for (place, each) in rest.char_indices().skip(1) {
        match each {
            _ if is_escaped => is_escaped = false,
            '\\' => is_escaped = true,
            '"' => return place + 1,
            _ => {}
        }
    }
    rest.len()
}

fn is_of_a_word(each: char) -> bool {
    each.is_alphanumeric() || "+-._".contains(each)
}

/// The beginning of a text, without control characters, for a quotation.
fn short(text: &str) -> String {
    let plain = text.chars().filter(|each| !each.is_control());
    let mut shown: String = plain.clone().take(QUOTED_CHARACTERS).collect();
    if plain.count() > QUOTED_CHARACTERS {
        shown.push('…');
    }
    shown
}
