//! The kinds of fields of a policy: a number, a switch or a word, with its range.

use std::fmt;

use super::PolicyError;
use crate::assignment::Assignment;
use crate::value::Value;
use crate::words::{OpenEnum, Word};

/// The allowed numbers of a field.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Range {
    /// No check: a switch or a word.
    Any,
    /// From the first to the second, both included.
    Within(f64, f64),
    /// Above the first, at most the second.
    Above(f64, f64),
}

impl Range {
    /// Whether a number lies in the range; NaN lies in none.
    pub fn contains(self, number: f64) -> bool {
        match self {
            Range::Any => true,
            Range::Within(least, most) => (least..=most).contains(&number),
            Range::Above(bound, most) => number > bound && number <= most,
        }
    }

    /// Refuses a number of a field that is out of its range.
    pub(crate) fn check(self, field: &str, value: f64) -> Result<(), PolicyError> {
        let fits = self.contains(value);
        if fits { Ok(()) } else { Err(PolicyError(format!("{field} is {value}; it must be {self}"))) }
    }
}

impl fmt::Display for Range {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Range::Any => f.write_str("anything"),
            Range::Within(least, most) => write!(f, "between {least} and {most}"),
            Range::Above(bound, most) => write!(f, "above {bound} and at most {most}"),
        }
    }
}

/// A field of a policy, for command lines, help and tables.
#[derive(Clone, Copy, Debug)]
pub struct PolicyField {
    /// Its name, in the field mask too.
    pub name: &'static str,
    /// Its effect, with its unit and range.
    pub about: &'static str,
    /// The value that holds where it is not set, in words.
    pub unset: &'static str,
    /// The values that it may have.
    pub range: Range,
    /// The placeholder of a value in help.
    pub placeholder: &'static str,
    /// The words that can be given, for methods and operations; else none.
    pub words: fn() -> Vec<&'static str>,
}

impl PolicyField {
    /// The first paragraph of its meaning on one line, without the full stop.
    pub fn summary(&self) -> String {
        let lines: Vec<&str> =
            self.about.lines().map(str::trim).take_while(|line| !line.is_empty()).collect();
        lines.join(" ").trim_end_matches('.').to_owned()
    }
}

/// The form in which a field is set.
pub trait SettingValue: Sized + Clone + fmt::Display {
    /// The form for programs.
    type Input: Into<Self>;

    /// Reads text. The error names the allowed values.
    fn parse(text: &str) -> Result<Self, String>;

    /// The value as text.
    fn show(&self) -> String {
        self.to_string()
    }

    /// The value as a number, where it is one.
    fn number(&self) -> Option<f64> {
        None
    }

    /// The words that can be given.
    fn words() -> Vec<&'static str> {
        Vec::new()
    }
}

/// Values that are set, decided and shown as they are.
macro_rules! plain_fields {
    ($($type:ident($value:ident) is $what:literal, $number:expr;)+) => {
        $(
            impl SettingValue for $type {
                type Input = $type;

                fn parse(text: &str) -> Result<Self, String> {
                    text.parse().map_err(|_| format!("`{text}` is {}", $what))
                }

                fn number(&self) -> Option<f64> {
                    let $value = *self;
                    $number
                }
            }

            impl Setting<$type> for $type {
                fn decide(said: $type) -> Result<Self, i32> {
                    Ok(said)
                }

                fn to_setting(self) -> Option<$type> {
                    Some(self)
                }
            }
        )+
    };
}

plain_fields! {
    f64(number) is "not a number", Some(number);
    u32(count) is "not a whole number of at least 0", Some(f64::from(count));
    bool(_switch) is "neither true nor false", None;
}

impl<T: Word + fmt::Display> SettingValue for OpenEnum<T> {
    type Input = T;

    /// Dashes count as underscores, so that words can be written like flags.
    fn parse(text: &str) -> Result<Self, String> {
        let known = T::from_word(&text.replace('-', "_")).map(OpenEnum::Known);
        known.ok_or_else(|| format!("`{text}` is none of {}", Self::words().join(", ")))
    }

    fn words() -> Vec<&'static str> {
        T::WORDS.iter().map(|(_, word)| *word).collect()
    }
}

/// A decided field, from a setting.
pub trait Setting<S>: Sized {
    /// Decides the field. The error is the number of an unknown value.
    fn decide(said: S) -> Result<Self, i32>;

    /// The setting for it; `None` is the default.
    fn to_setting(self) -> Option<S>;
}

impl Setting<f64> for Option<f64> {
    fn decide(said: f64) -> Result<Self, i32> {
        Ok(Some(said))
    }

    fn to_setting(self) -> Option<f64> {
        self
    }
}

impl<T: Word> Setting<OpenEnum<T>> for T {
    fn decide(said: OpenEnum<T>) -> Result<Self, i32> {
        match said {
            OpenEnum::Known(value) => Ok(value),
            OpenEnum::Unrecognised(number) => Err(number),
        }
    }

    fn to_setting(self) -> Option<OpenEnum<T>> {
        Some(OpenEnum::Known(self))
    }
}

/// The pinned configuration, as `name=value,name=value`. A text that would read as something else is in
/// double quotes, within which a backslash stands before a quote and before a backslash.
impl SettingValue for Assignment {
    type Input = Assignment;

    fn parse(text: &str) -> Result<Self, String> {
        let parts = parts(text).map(str::trim).filter(|part| !part.is_empty());
        let pair = |part: &str| match part.split_once('=') {
            Some((name, value)) => Ok((name.trim().to_owned(), value_of(value.trim()))),
            None => Err(format!("`{part}` is not of the form NAME=VALUE")),
        };
        parts.map(pair).collect()
    }

    fn show(&self) -> String {
        let pairs: Vec<String> =
            self.iter().map(|(name, value)| format!("{name}={}", shown(value))).collect();
        pairs.join(",")
    }
}

/// Splits at the commas outside of values in double quotes.
fn parts(text: &str) -> impl Iterator<Item = &str> {
    let (mut is_quoted, mut is_escaped, mut before) = (false, false, ' ');
    text.split(move |each: char| {
        if is_escaped {
            is_escaped = false;
        } else if is_quoted {
            is_escaped = each == '\\';
            is_quoted = each != '"';
        } else {
            is_quoted = each == '"' && before == '=';
        }
        if !each.is_whitespace() {
            before = each;
        }
        each == ',' && !is_quoted
    })
}

/// Reads a value as [`shown`] writes it.
fn value_of(text: &str) -> Value {
    let Some(quoted) = text.strip_prefix('"').and_then(|rest| rest.strip_suffix('"')) else {
        return Value::parse(text);
    };
    let mut plain = String::new();
    let mut rest = quoted.chars().peekable();
    while let Some(each) = rest.next() {
        let escaped = rest.next_if(|next| each == '\\' && matches!(next, '\\' | '"'));
        plain.push(escaped.unwrap_or(each));
    }
    Value::Text(plain)
}

fn shown(value: &Value) -> String {
    match value {
        Value::Text(text)
            if text.contains([',', '"']) || text.trim() != text || Value::parse(text) != *value =>
        {
            format!("\"{}\"", text.replace('\\', r"\\").replace('"', "\\\""))
        }
        _ => value.to_string(),
    }
}
