//! One domain and the unit interval.
//!
//! Discrete domains cut the interval into equal cells (equal in the logarithm for a log scale), and a value
//! sits in the middle of its cell. So uniform points give uniform values, and the ends are not under-sampled.

use crate::limits::{CATEGORIES_MAX, INTEGER_MAGNITUDE_MAX, TEXT_VALUE_CHARACTERS_MAX};
use crate::space::{Domain, Scale};
use crate::value::Value;

impl Domain {
    /// The mistake in the domain itself, in words.
    pub(super) fn problem(&self) -> Option<String> {
        match self {
            Domain::Integer { min, max, scale } => {
                if min > max {
                    Some(format!("the range {min} to {max} is empty; min must not be greater than max"))
                } else if *min < -INTEGER_MAGNITUDE_MAX || *max > INTEGER_MAGNITUDE_MAX {
                    Some(format!("the range {min} to {max} leaves -2^53 to 2^53"))
                } else if *scale == Scale::Log && *min <= 0 {
                    Some(format!("a log scale needs a positive lower bound, not {min}"))
                } else {
                    None
                }
            }
            Domain::Float { min, max, scale } => {
                if !min.is_finite() || !max.is_finite() {
                    Some(format!("the range {min} to {max} must be finite"))
                } else if min > max {
                    Some(format!("the range {min} to {max} is empty; min must not be greater than max"))
                } else if *scale == Scale::Log && *min <= 0.0 {
                    Some(format!("a log scale needs a positive lower bound, not {min}"))
                } else {
                    None
                }
            }
            Domain::Categorical { values } => categories_problem(values),
            Domain::Boolean => None,
        }
    }

    /// Whether `value` is of the right kind and in range.
    pub fn contains(&self, value: &Value) -> bool {
        match (self, value) {
            (Domain::Integer { min, max, .. }, Value::Integer(integer)) => (min..=max).contains(&integer),
            (Domain::Float { min, max, .. }, Value::Float(float)) => (min..=max).contains(&float),
            (Domain::Categorical { values }, value) => values.contains(value),
            (Domain::Boolean, Value::Boolean(_)) => true,
            _ => false,
        }
    }

    /// Lowest and highest number of a numeric domain.
    pub(super) fn bounds(&self) -> Option<(f64, f64)> {
        match self {
            Domain::Integer { min, max, .. } => Some((*min as f64, *max as f64)),
            Domain::Float { min, max, .. } => Some((*min, *max)),
            Domain::Categorical { .. } | Domain::Boolean => None,
        }
    }

    /// The number of values beside one, numbers in four steps at most: the trials to try each of them once.
    pub fn alternatives(&self) -> u64 {
        match self {
            Domain::Boolean => 1,
            Domain::Categorical { values } => values.len() as u64 - 1,
            Domain::Integer { min, max, .. } => max.abs_diff(*min).min(4),
            Domain::Float { min, max, .. } => 4 * u64::from(min < max),
        }
    }

    /// The value at `coordinate`, which is clamped to 0..1 (NaN counts as 0).
    ///
    /// Floats are rounded to twelve significant digits: so names of configurations are short, and values
    /// written by people survive encoding and decoding.
    pub fn decode(&self, coordinate: f64) -> Value {
        let x = if coordinate.is_nan() { 0.0 } else { coordinate.clamp(0.0, 1.0) };
        match self {
            Domain::Integer { min, max, scale: Scale::Linear } => {
                let cells = (max - min) as f64 + 1.0;
                let cell = ((x * cells).floor() as i64).min(max - min);
                Value::Integer(min + cell)
            }
            Domain::Integer { min, max, scale: Scale::Log } => {
                let (low, high) = integer_log_bounds(*min, *max);
                let integer = libm::exp(low + x * (high - low)).round() as i64;
                Value::Integer(integer.clamp(*min, *max))
            }
            // Rounding must not keep a search from the ends of the range.
            Domain::Float { min, .. } if x <= 0.0 => Value::Float(*min),
            Domain::Float { max, .. } if x >= 1.0 => Value::Float(*max),
            Domain::Float { min, max, scale } => {
                let float = match scale {
                    Scale::Linear => min * (1.0 - x) + max * x,
                    Scale::Log => libm::exp(libm::log(*min) * (1.0 - x) + libm::log(*max) * x),
                };
                Value::Float(round_significant(float).clamp(*min, *max)).canonical()
            }
            Domain::Categorical { values } => values[cell_index(x, values.len())].clone(),
            Domain::Boolean => Value::Boolean(x >= 0.5),
        }
    }

    /// The coordinate of a value of this domain, 0 to 1: for discrete domains the middle of its cell.
    pub fn encode(&self, value: &Value) -> f64 {
        let coordinate = match (self, value) {
            (Domain::Integer { min, max, scale: Scale::Linear }, Value::Integer(integer)) => {
                ((integer - min) as f64 + 0.5) / ((max - min) as f64 + 1.0)
            }
            (Domain::Integer { min, max, scale: Scale::Log }, Value::Integer(integer)) => {
                let (low, high) = integer_log_bounds(*min, *max);
                (libm::log(*integer as f64) - low) / (high - low)
            }
            (Domain::Float { min, max, .. }, Value::Float(_)) if min == max => 0.5,
            // Halves keep the differences of very large numbers finite.
            (Domain::Float { min, max, scale: Scale::Linear }, Value::Float(float)) => {
                (float / 2.0 - min / 2.0) / (max / 2.0 - min / 2.0)
            }
            (Domain::Float { min, max, scale: Scale::Log }, Value::Float(float)) => {
                (libm::log(*float) - libm::log(*min)) / (libm::log(*max) - libm::log(*min))
            }
            (Domain::Categorical { values }, value) => {
                let index = values.iter().position(|candidate| candidate == value).unwrap_or(0);
                (index as f64 + 0.5) / values.len() as f64
            }
            (Domain::Boolean, Value::Boolean(boolean)) => {
                if *boolean {
                    0.75
                } else {
                    0.25
                }
            }
            _ => unreachable!("a checked configuration holds values of the right kind"),
        };
        // Only bounds that lie within rounding of each other leave the interval.
        if coordinate.is_nan() { 0.5 } else { coordinate.clamp(0.0, 1.0) }
    }
}

fn categories_problem(values: &[Value]) -> Option<String> {
    if values.is_empty() || values.len() > CATEGORIES_MAX {
        return Some(format!("{} values; give 1 to {CATEGORIES_MAX}", values.len()));
    }
    for (index, value) in values.iter().enumerate() {
        match value {
            Value::Boolean(_) => {
                return Some("values must be integers, floats or text; use a boolean domain".into());
            }
            Value::Float(float) if !float.is_finite() => {
                return Some(format!("the value {float} is not finite"));
            }
            Value::Integer(integer) if integer.unsigned_abs() > INTEGER_MAGNITUDE_MAX as u64 => {
                return Some(format!("the value {integer} leaves -2^53 to 2^53"));
            }
            Value::Text(text) if text.chars().count() > TEXT_VALUE_CHARACTERS_MAX => {
                return Some(format!("a text value is longer than {TEXT_VALUE_CHARACTERS_MAX} characters"));
            }
            _ => {}
        }
        if value.kind() != values[0].kind() {
            return Some(format!(
                "values must be of one kind, not {} and {}",
                values[0].kind(),
                value.kind()
            ));
        }
        if values[..index].contains(value) {
            return Some(format!("the value {value} is listed twice"));
        }
    }
    None
}

fn integer_log_bounds(min: i64, max: i64) -> (f64, f64) {
    (libm::log(min as f64 - 0.5), libm::log(max as f64 + 0.5))
}

fn cell_index(x: f64, cells: usize) -> usize {
    ((x * cells as f64) as usize).min(cells - 1)
}

fn round_significant(float: f64) -> f64 {
    // Formatting is the one exact way to round to decimal digits; reading its output back cannot fail.
    format!("{float:.11e}").parse().unwrap_or(float)
}
