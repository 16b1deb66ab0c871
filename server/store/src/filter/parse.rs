//! Tokens to [`Filter`]: `comparison { AND comparison }`, `comparison = field operator value`.

use treewright_core::names::{NAME_RULE, PARAMETER_NAME_RULE, is_name, is_parameter_name};
use treewright_core::trial::{Mode, OutcomeKind, TrialState};
use treewright_core::words::Word as _;

use super::token::{FilterToken, PlacedToken, tokens};
use super::{FieldComparison, Filter, FilterError, Literal, Operator};
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
    // Three tokens each, and an AND between two.
    let expected = (4 * comparisons.len()).saturating_sub(1);
    assert_eq!((parser.next, parser.tokens.len()), (expected, expected));
    assert!(comparisons.len() <= limits::FILTER_COMPARISONS);
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
        let field = self.take(FIELDS)?;
        let FilterToken::Word(word) = &field.token else {
            return Err(unexpected(field.position, &field.token, FIELDS));
        };
        let prefixed = word.split_once('.');
        let known = match prefixed {
            Some((prefix, _)) => matches!(prefix, "measurement" | "config" | "indicator"),
            None => matches!(
                word.as_str(),
                "state"
                    | "mode"
                    | "outcome"
                    | "client_id"
                    | "state_id"
                    | "number"
                    | "cost"
                    | "late"
                    | "excluded"
            ),
        };
        if !known {
            return Err(unexpected(field.position, &field.token, FIELDS));
        }
        let named = match prefixed {
            Some(("config", rest)) => parameter_name(rest, field.position + "config.".len())?,
            Some((prefix, rest)) => name(rest, field.position + prefix.len() + 1)?,
            None => String::new(),
        };

        let operator = self.operator()?;
        Ok(match prefixed.map_or(word.as_str(), |(prefix, _)| prefix) {
            "state" => {
                FieldComparison::State(operator.equality("state")?, self.word(TrialState::WORDS, "a state")?)
            }
            "mode" => FieldComparison::Mode(operator.equality("mode")?, self.word(Mode::WORDS, "a mode")?),
            "outcome" => FieldComparison::Outcome(
                operator.equality("outcome")?,
                self.word(OutcomeKind::WORDS, "an outcome")?,
            ),
            "late" => {
                FieldComparison::Late(operator.equality("late")?, self.word(BOOLEANS, "a truth value")?)
            }
            "excluded" => FieldComparison::Excluded(
                operator.equality("excluded")?,
                self.word(BOOLEANS, "a truth value")?,
            ),
            "client_id" => FieldComparison::ClientId(operator.operator, self.text()?),
            "state_id" => FieldComparison::StateId(operator.operator, self.whole_number()?),
            "number" => FieldComparison::Number(operator.operator, self.whole_number()?),
            "cost" => FieldComparison::Cost(operator.operator, self.number()?),
            "measurement" => FieldComparison::Measurement(named, operator.operator, self.number()?),
            "indicator" => FieldComparison::Indicator(named, operator.operator, self.number()?),
            _ => {
                let literal = self.literal()?;
                if matches!(literal, Literal::Boolean(_)) {
                    operator.equality("a boolean parameter")?;
                }
                FieldComparison::Configuration(named, operator.operator, literal)
            }
        })
    }

    fn operator(&mut self) -> Result<PlacedOperator, FilterError> {
        const EXPECTED: &str = "an operator: = != < <= > >=";
        let placed = self.take(EXPECTED)?;
        match placed.token {
            FilterToken::Operator(operator) => Ok(PlacedOperator { position: placed.position, operator }),
            other => Err(unexpected(placed.position, &other, EXPECTED)),
        }
    }

    /// One of a list of words.
    fn word<T: Copy>(&mut self, words: &[(T, &str)], what: &str) -> Result<T, FilterError> {
        let list: Vec<&str> = words.iter().map(|(_, word)| *word).collect();
        let expected = format!("{what}: {}", list.join(", "));
        self.read(&expected, |token| match token {
            FilterToken::Word(word) => words.iter().find(|(_, known)| known == word).map(|(value, _)| *value),
            _ => None,
        })
    }

    fn text(&mut self) -> Result<String, FilterError> {
        self.read("text in double quotes", |token| match token {
            FilterToken::Text(text) => Some(text.clone()),
            _ => None,
        })
    }

    fn number(&mut self) -> Result<f64, FilterError> {
        const EXPECTED: &str = "a number";
        let placed = self.take(EXPECTED)?;
        match &placed.token {
            FilterToken::Number(written) => finite(written, placed.position),
            other => Err(unexpected(placed.position, other, EXPECTED)),
        }
    }

    fn whole_number(&mut self) -> Result<i64, FilterError> {
        self.read("a whole number", |token| match token {
            FilterToken::Number(written) => written.parse().ok(),
            _ => None,
        })
    }

    fn literal(&mut self) -> Result<Literal, FilterError> {
        const EXPECTED: &str = "a number, text in double quotes, true or false";
        let placed = self.take(EXPECTED)?;
        match &placed.token {
            FilterToken::Number(written) => finite(written, placed.position).map(Literal::Number),
            FilterToken::Text(text) => Ok(Literal::Text(text.clone())),
            FilterToken::Word(word) if word == "true" => Ok(Literal::Boolean(true)),
            FilterToken::Word(word) if word == "false" => Ok(Literal::Boolean(false)),
            other => Err(unexpected(placed.position, other, EXPECTED)),
        }
    }
}

struct PlacedOperator {
    position: usize,
    operator: Operator,
}

impl PlacedOperator {
    /// The operator, if it needs no order.
    fn equality(&self, field: &str) -> Result<Operator, FilterError> {
        if self.operator.is_equality() {
            Ok(self.operator)
        } else {
            Err(FilterError::new(self.position, format!("{field} is compared with = or != only")))
        }
    }
}

const BOOLEANS: &[(bool, &str)] = &[(true, "true"), (false, "false")];

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
