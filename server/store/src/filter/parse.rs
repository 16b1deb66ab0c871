//! Tokens to [`Filter`]: `comparison { AND comparison }`, `comparison = field operator value`.

use treewright_core::names::{NAME_RULE, PARAMETER_NAME_RULE, is_name, is_parameter_name};
use treewright_core::trial::{Mode, OutcomeKind, TrialState};
use treewright_core::words::Word;

use super::token::{FilterToken, PlacedToken, tokens};
use super::{Field, FieldComparison, Filter, FilterError, Literal};
use crate::limits;

const FIELDS: &str = "a field: state, mode, outcome, client_id, state_id, number, cost, late, excluded, \
                      measurement.NAME, config.NAME or indicator.NAME";

pub(super) fn filter(text: &str) -> Result<Filter, FilterError> {
    if text.chars().nth(limits::FILTER_CHARACTERS).is_some() {
        return Err(FilterError::new(
            limits::FILTER_CHARACTERS + 1,
            format!("a filter has at most {} characters", limits::FILTER_CHARACTERS),
        ));
    }
    let mut parser = Parser { tokens: tokens(text)?, next: 0, end: text.chars().count() + 1 };
    let mut comparisons = Vec::new();
    while parser.next < parser.tokens.len() {
        if !comparisons.is_empty() {
            parser.and()?;
        }
        if comparisons.len() == limits::FILTER_COMPARISONS {
            return Err(FilterError::new(
                parser.position(),
                format!("a filter has at most {} comparisons", limits::FILTER_COMPARISONS),
            ));
        }
        comparisons.push(parser.comparison()?);
    }
    Ok(Filter { comparisons })
}

/// Checks that `name` is one of a metric or an indicator.
pub(super) fn name(name: &str, position: usize) -> Result<String, FilterError> {
    spelt(name, position, is_name(name), NAME_RULE)
}

/// Checks that `name` is one of a parameter.
fn parameter_name(name: &str, position: usize) -> Result<String, FilterError> {
    spelt(name, position, is_parameter_name(name), PARAMETER_NAME_RULE)
}

fn spelt(name: &str, position: usize, is_right: bool, rule: &str) -> Result<String, FilterError> {
    if is_right {
        Ok(name.to_owned())
    } else {
        Err(FilterError::new(position, format!("`{name}` is not a name: {rule}")))
    }
}

struct Parser {
    tokens: Vec<PlacedToken>,
    next: usize,
    /// The place just behind the text, at which missing tokens are reported.
    end: usize,
}

impl Parser {
    fn position(&self) -> usize {
        self.tokens.get(self.next).map_or(self.end, |t| t.position)
    }

    /// Takes the next token, or says that `expected` is missing.
    fn take(&mut self, expected: &str) -> Result<PlacedToken, FilterError> {
        let placed = self
            .tokens
            .get(self.next)
            .cloned()
            .ok_or_else(|| FilterError::new(self.end, format!("the filter ends before {expected}")))?;
        self.next += 1;
        Ok(placed)
    }

    /// Takes the next token as what `read` makes of it, or says that it is not `expected`.
    fn read<T>(
        &mut self,
        expected: &str,
        read: impl FnOnce(&FilterToken) -> Option<T>,
    ) -> Result<T, FilterError> {
        let placed = self.take(expected)?;
        read(&placed.token).ok_or_else(|| unexpected(placed.position, &placed.token, expected))
    }

    fn and(&mut self) -> Result<(), FilterError> {
        self.read("`AND`", |token| matches!(token, FilterToken::Word(word) if word == "AND").then_some(()))
    }

    fn comparison(&mut self) -> Result<FieldComparison, FilterError> {
        let placed = self.take(FIELDS)?;
        let unknown = || unexpected(placed.position, &placed.token, FIELDS);
        let FilterToken::Word(word) = &placed.token else { return Err(unknown()) };
        let rest = word.split_once('.').map_or("", |(_, rest)| rest);
        let rest_position = placed.position + word.chars().count() - rest.chars().count();
        let field = match word.strip_suffix(rest).unwrap_or(word) {
            "state" => Field::State,
            "mode" => Field::Mode,
            "outcome" => Field::Outcome,
            "late" => Field::Late,
            "excluded" => Field::Excluded,
            "client_id" => Field::ClientId,
            "state_id" => Field::StateId,
            "number" => Field::Number,
            "cost" => Field::Cost,
            "measurement." => Field::Measurement(name(rest, rest_position)?),
            "indicator." => Field::Indicator(name(rest, rest_position)?),
            "config." => Field::Configuration(parameter_name(rest, rest_position)?),
            _ => return Err(unknown()),
        };

        let position = self.position();
        let operator = self.read("an operator: = != < <= > >=", |token| match token {
            FilterToken::Operator(operator) => Some(*operator),
            _ => None,
        })?;
        let literal = match &field {
            Field::State => self.word::<TrialState>("a state")?,
            Field::Mode => self.word::<Mode>("a mode")?,
            Field::Outcome => self.word::<OutcomeKind>("an outcome")?,
            Field::Late | Field::Excluded => {
                self.literal("a truth value: true, false", |literal| matches!(literal, Literal::Boolean(_)))?
            }
            Field::ClientId => {
                self.literal("text in double quotes", |literal| matches!(literal, Literal::Text(_)))?
            }
            Field::StateId | Field::Number => self.read("a whole number", |token| match token {
                FilterToken::Number(written) => written.parse().ok().map(Literal::Whole),
                _ => None,
            })?,
            Field::Cost | Field::Measurement(_) | Field::Indicator(_) => {
                self.literal("a number", |literal| matches!(literal, Literal::Number(_)))?
            }
            Field::Configuration(_) => {
                self.literal("a number, text in double quotes, true or false", |_| true)?
            }
        };
        let unordered = match (&field, &literal) {
            (Field::Configuration(_), Literal::Boolean(_)) => Some("a boolean parameter"),
            (Field::State | Field::Mode | Field::Outcome, _) | (_, Literal::Boolean(_)) => Some(&**word),
            _ => None,
        };
        match unordered {
            Some(what) if !operator.is_equality() => {
                Err(FilterError::new(position, format!("{what} is compared with = or != only")))
            }
            _ => Ok(FieldComparison { field, operator, literal }),
        }
    }

    /// One of an enum's words.
    fn word<W: Word>(&mut self, what: &str) -> Result<Literal, FilterError> {
        let words: Vec<&str> = W::WORDS.iter().map(|(_, word)| *word).collect();
        self.read(&format!("{what}: {}", words.join(", ")), |token| match token {
            FilterToken::Word(word) if words.contains(&word.as_str()) => Some(Literal::Text(word.clone())),
            _ => None,
        })
    }

    /// A literal of a kind that the field takes.
    fn literal(&mut self, expected: &str, is_right: fn(&Literal) -> bool) -> Result<Literal, FilterError> {
        let placed = self.take(expected)?;
        let literal = match &placed.token {
            FilterToken::Number(written) => Some(Literal::Number(finite(written, placed.position)?)),
            FilterToken::Text(text) => Some(Literal::Text(text.clone())),
            FilterToken::Word(word) => word.parse().ok().map(Literal::Boolean),
            FilterToken::Operator(_) => None,
        };
        literal.filter(is_right).ok_or_else(|| unexpected(placed.position, &placed.token, expected))
    }
}

fn finite(written: &str, position: usize) -> Result<f64, FilterError> {
    match written.parse::<f64>() {
        // A negative zero would print and hash differently from zero while comparing equal.
        Ok(number) if number.is_finite() => Ok(number + 0.0),
        _ => Err(FilterError::new(position, format!("`{written}` is not a finite number"))),
    }
}

pub(super) fn unexpected(position: usize, found: &FilterToken, expected: &str) -> FilterError {
    FilterError::new(position, format!("found {} instead of {expected}", found.shown()))
}

#[cfg(test)]
mod tests;
