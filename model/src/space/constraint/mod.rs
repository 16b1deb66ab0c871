//! Constraints: expressions over parameters that every configuration fulfils.
//!
//! `parse` reads an expression, `node` holds it and checks it against parameters, `extent` evaluates it, also
//! where only some parameters have a value yet.

mod extent;
mod node;
mod parse;
#[cfg(test)]
mod tests;

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Deserializer, Serialize, Serializer};
use thiserror::Error;

pub(super) use extent::Extent;
pub(super) use node::Node;

use crate::value::Value;
use node::Operator;

/// A condition that every configuration fulfils, such as `block_x * block_y <= 1024`.
///
/// An expression has parameters, numbers, `true`, `false` and text in quotes. Its operators are `+ - * / %`,
/// the comparisons `== != < <= > >=`, `and`, `or`, `not` (or `&& || !`), `min(…)`, `max(…)`, `abs(…)` and
/// parentheses. Names other than letters, digits and `_` stand in backticks.
///
/// - Numbers are doubles, so that whole numbers are exact up to 2^53. `/` is the division of real numbers:
///   `7 / 2` is 3.5. `%` is the remainder with the sign of the dividend, as in C: `-7 % 4` is -3.
/// - Where a division by zero or a number that is not finite decides, the constraint is not fulfilled. `and`
///   and `or` evaluate their right side only where the left one does not decide.
/// - While a parameter that it names is inactive, the constraint holds.
///
/// Constraints that differ only in spaces, brackets or the spelling of operators are equal; `to_string` gives
/// their common spelling.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Constraint {
    root: Node<String>,
}

/// Why a text is not a constraint.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
#[error("constraint `{text}`: {problem}")]
pub struct ConstraintError {
    /// The text.
    pub text: String,
    /// The mistake, its place, and a remedy.
    pub problem: String,
}

impl Constraint {
    /// Reads an expression. Its parameters are checked when a space is made with it.
    ///
    /// # Errors
    /// [`ConstraintError`] with the place of the mistake, in characters from 1.
    pub fn parse(text: &str) -> Result<Self, ConstraintError> {
        let refuse = |problem| ConstraintError { text: parse::excerpt(text), problem };
        let constraint = Constraint { root: parse::expression(text).map_err(refuse)? };
        let common = constraint.to_string();
        match parse::expression(&common) {
            Ok(_) => Ok(constraint),
            // It has blanks and parentheses that the text may lack, and it is what is stored and sent.
            Err(problem) => Err(refuse(format!("as `{}`: {problem}", parse::excerpt(&common)))),
        }
    }

    /// `lesser <= greater`, between two parameters.
    pub fn order(lesser: &str, greater: &str) -> Self {
        let [lesser, greater] = [lesser, greater].map(|name| Node::Parameter(name.to_owned()));
        Constraint { root: Node::Binary(Operator::LessOrEqual, Box::new([lesser, greater])) }
    }

    /// A whole number has one of the values that are `step` apart from each other, from `min` on.
    pub fn step(parameter: &str, min: i64, step: i64) -> Self {
        let name = Node::Parameter(parameter.to_owned());
        let whole = |integer: i64| Node::Literal(Value::Integer(integer));
        let binary = |operator, left, right| Node::Binary(operator, Box::new([left, right]));
        let from = match min.checked_rem(step) {
            Some(0) => name,
            _ => binary(Operator::Subtract, name, whole(min)),
        };
        let remainder = binary(Operator::Remainder, from, whole(step));
        Constraint { root: binary(Operator::Equal, remainder, whole(0)) }
    }

    /// The two parameters, the lesser first, where the constraint is `lesser <= greater`.
    pub fn as_order(&self) -> Option<(&str, &str)> {
        let Node::Binary(Operator::LessOrEqual, sides) = &self.root else { return None };
        match sides.as_ref() {
            [Node::Parameter(lesser), Node::Parameter(greater)] => Some((lesser, greater)),
            _ => None,
        }
    }

    /// The expression, over names.
    pub(super) fn root(&self) -> &Node<String> {
        &self.root
    }
}

/// The expression in the one spelling that reads back as an equal constraint.
impl fmt::Display for Constraint {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.root.fmt(f)
    }
}

impl FromStr for Constraint {
    type Err = ConstraintError;

    fn from_str(text: &str) -> Result<Self, ConstraintError> {
        Constraint::parse(text)
    }
}

/// The form in documents: a pair of names for an order, as in every version, else the expression.
#[derive(Serialize, Deserialize)]
#[serde(untagged, deny_unknown_fields)]
enum StoredConstraint {
    Order { lesser: String, greater: String },
    Expression { expression: String },
}

impl Serialize for Constraint {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let stored = match self.as_order() {
            Some((lesser, greater)) => {
                StoredConstraint::Order { lesser: lesser.to_owned(), greater: greater.to_owned() }
            }
            None => StoredConstraint::Expression { expression: self.to_string() },
        };
        stored.serialize(serializer)
    }
}

impl<'de> Deserialize<'de> for Constraint {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        match StoredConstraint::deserialize(deserializer)? {
            StoredConstraint::Order { lesser, greater } => Ok(Constraint::order(&lesser, &greater)),
            StoredConstraint::Expression { expression } => {
                Constraint::parse(&expression).map_err(serde::de::Error::custom)
            }
        }
    }
}
