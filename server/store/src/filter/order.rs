//! The order in which trials are read: `number`, `cost desc`, `measurement.render_ms`.

use std::cmp::Ordering;

use treewright_core::trial::Trial;

use super::FilterError;
use super::parse::{self, unexpected};
use super::token::{FilterToken, tokens};
use crate::cursor::Cursor;

/// An order. Trials without the value come last. Ties are broken by rising number, so that an order is always
/// total and a page can go on where the last one ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Order {
    /// The key that is compared.
    pub key: OrderKey,
    /// Largest first.
    pub descending: bool,
}

/// The keys by which trials can be ordered.
#[derive(Clone, Debug, PartialEq)]
pub enum OrderKey {
    /// The trial's number.
    Number,
    /// The measured objective.
    Cost,
    /// A measurement, by name.
    Measurement(String),
}

impl Default for Order {
    fn default() -> Self {
        Self { key: OrderKey::Number, descending: false }
    }
}

impl Order {
    /// Reads an order. Blank text means rising number.
    pub fn parse(text: &str) -> Result<Self, FilterError> {
        const KEYS: &str = "number, cost or measurement.NAME";
        const DIRECTION: &str = "`desc` or the end";
        let mut tokens = tokens(text)?.into_iter();
        let Some(first) = tokens.next() else {
            return Ok(Self::default());
        };
        let key = match &first.token {
            FilterToken::Word(word) if word == "number" => OrderKey::Number,
            FilterToken::Word(word) if word == "cost" => OrderKey::Cost,
            FilterToken::Word(word) => match word.split_once('.') {
                Some(("measurement", name)) => {
                    OrderKey::Measurement(parse::name(name, first.position + "measurement.".len())?)
                }
                _ => return Err(unexpected(first.position, &first.token, KEYS)),
            },
            other => return Err(unexpected(first.position, other, KEYS)),
        };
        let descending = match tokens.next() {
            None => false,
            Some(placed) if placed.token == FilterToken::Word("desc".to_owned()) => true,
            Some(placed) => return Err(unexpected(placed.position, &placed.token, DIRECTION)),
        };
        if let Some(placed) = tokens.next() {
            return Err(unexpected(placed.position, &placed.token, "the end"));
        }
        Ok(Self { key, descending })
    }

    /// The value by which `trial` is ordered; without one it comes last. Both zeros are one value, as they
    /// are to databases.
    #[allow(clippy::cast_precision_loss)] // Numbers are far below 2^53.
    pub fn value<C>(&self, trial: &Trial<C>) -> Option<f64> {
        let value = match &self.key {
            OrderKey::Number => Some(trial.number as f64),
            OrderKey::Cost => trial.cost,
            OrderKey::Measurement(name) => trial.measurements.get(name).copied(),
        };
        // Turns -0.0 into 0.0.
        value.map(|value| value + 0.0)
    }

    /// The place of `trial` in this order: a page can go on behind it.
    pub fn place<C>(&self, trial: &Trial<C>) -> Cursor {
        Cursor { value: self.value(trial), number: i64::try_from(trial.number).unwrap_or(i64::MAX) }
    }

    /// The order of two rows.
    pub fn compare(&self, left: &Cursor, right: &Cursor) -> Ordering {
        let values = match (left.value, right.value) {
            (Some(left), Some(right)) if self.descending => right.total_cmp(&left),
            (Some(left), Some(right)) => left.total_cmp(&right),
            (left, right) => right.is_some().cmp(&left.is_some()),
        };
        values.then(left.number.cmp(&right.number))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_parse() {
        assert_eq!(Order::parse(" ").unwrap(), Order::default());
        assert_eq!(Order::parse("number").unwrap(), Order::default());
        let order = Order::parse("measurement.render_ms desc").unwrap();
        assert_eq!(order.key, OrderKey::Measurement("render_ms".into()));
        assert!(order.descending);
        assert_eq!(Order::parse("cost").unwrap().key, OrderKey::Cost);
    }

    #[test]
    fn mistakes_are_pointed_at() {
        for (text, position, fragment) in [
            ("price", 1, "instead of number, cost or measurement.NAME"),
            ("cost down", 6, "instead of `desc` or the end"),
            ("cost desc, number", 10, "has no meaning"),
            ("cost desc number", 11, "instead of the end"),
            ("measurement.A", 13, "is not a name"),
        ] {
            let error = Order::parse(text).unwrap_err();
            assert_eq!(error.position, position, "{text}: {error}");
            assert!(error.problem.contains(fragment), "{text}: {error}");
        }
    }
}
