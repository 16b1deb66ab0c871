//! Parameters with a sentence each, written as data: spaces, tables and reports are made of them.

use std::ops::RangeInclusive;

use serde::Serialize;
use treewright_client::{Condition, Domain, Parameter, Scale, Value};

/// A parameter and its effect, in plain words.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Explained {
    /// The parameter.
    #[serde(flatten, serialize_with = "treewright_client::plain")]
    pub parameter: Parameter,
    /// Its effect, without a full stop.
    pub about: &'static str,
}

impl Explained {
    /// The parameter exists only while an earlier one exists and has one of these values.
    pub(super) fn only_while<V: Into<Value>>(
        mut self,
        parameter: &str,
        any_of: impl IntoIterator<Item = V>,
    ) -> Self {
        let any_of = any_of.into_iter().map(Into::into).collect();
        self.parameter.active_if = Some(Condition { parameter: parameter.to_owned(), any_of });
        self
    }

    /// Equal ratios are equal steps.
    pub(super) fn log(mut self) -> Self {
        if let Domain::Integer { scale, .. } | Domain::Float { scale, .. } = &mut self.parameter.domain {
            *scale = Scale::Log;
        }
        self
    }
}

pub(super) fn boolean(name: &str, default: bool, about: &'static str) -> Explained {
    explained(name, Domain::Boolean, default, about)
}

pub(super) fn integer(
    name: &str,
    range: RangeInclusive<i64>,
    default: i64,
    about: &'static str,
) -> Explained {
    let domain = Domain::Integer { min: *range.start(), max: *range.end(), scale: Scale::Linear };
    explained(name, domain, default, about)
}

pub(super) fn float(name: &str, range: RangeInclusive<f64>, default: f64, about: &'static str) -> Explained {
    let domain = Domain::Float { min: *range.start(), max: *range.end(), scale: Scale::Linear };
    explained(name, domain, default, about)
}

pub(super) fn choice<V: Into<Value>>(
    name: &str,
    values: impl IntoIterator<Item = V>,
    default: V,
    about: &'static str,
) -> Explained {
    let values = values.into_iter().map(Into::into).collect();
    explained(name, Domain::Categorical { values }, default, about)
}

fn explained(name: &str, domain: Domain, default: impl Into<Value>, about: &'static str) -> Explained {
    Explained { parameter: Parameter::new(name, domain, default), about }
}
