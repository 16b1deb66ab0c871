//! Filters, orders and cursors as SQL for every database. Every value and every name is bound, never spliced
//! into the text.
//!
//! [`filter`](crate::filter) defines the meaning of a filter; here it becomes the part of a statement that
//! all databases share. A [`Dialect`] adds a database's own way to bind values, and to read and compare a
//! member of a JSON document.

use treewright_core::trial::TrialState;
use treewright_core::words::Word as _;

use crate::error::Result;
use crate::filter::{Field, FieldComparison, Literal, Operator, OrderKey};
use crate::limits;
use crate::rows::signed;
use crate::statements::TRIALS_OF_STUDY;
use crate::store::TrialQuery;

/// A statement under construction, in one database's dialect.
pub(crate) trait Dialect {
    fn text(&mut self, sql: &str) -> &mut Self;
    fn integer(&mut self, value: i64) -> &mut Self;
    /// Binds a number that is compared with a column of numbers.
    fn real(&mut self, value: f64) -> &mut Self;
    fn string(&mut self, value: &str) -> &mut Self;
    /// Binds a truth value that is compared with a column of such.
    fn flag(&mut self, value: bool) -> &mut Self;
    /// The number under `name` in the JSON document `column`; NULL where there is none.
    fn member(&mut self, column: &str, name: &str) -> &mut Self;
    /// Binds a number that is compared with a [`member`](Self::member).
    fn member_value(&mut self, value: f64) -> &mut Self;
    /// Binds a literal that is compared with a column.
    fn literal(&mut self, literal: &Literal) -> &mut Self {
        match literal {
            Literal::Number(number) => self.real(*number),
            Literal::Whole(number) => self.integer(*number),
            Literal::Text(text) => self.string(text),
            Literal::Boolean(boolean) => self.flag(*boolean),
        }
    }
    /// Binds a literal that is compared with a member of a document.
    fn member_literal(&mut self, literal: &Literal) -> &mut Self {
        match literal {
            Literal::Number(number) => self.member_value(*number),
            other => self.literal(other),
        }
    }
    /// Compares a parameter of the document `configuration` with a literal; false where its kind is another.
    fn parameter(&mut self, name: &str, operator: Operator, literal: &Literal) -> &mut Self;
}

/// The question for one page and one row more, which shows whether another page follows.
pub(crate) fn trial_page<D: Dialect>(sql: &mut D, study: i64, query: &TrialQuery) -> Result<()> {
    assert!((1..=limits::PAGE_SIZE).contains(&query.size), "a page of {} rows", query.size);
    sql.text(TRIALS_OF_STUDY).integer(study);
    for comparison in &query.filter.comparisons {
        sql.text(" AND ");
        push_comparison(sql, comparison);
    }
    let direction = if query.order.descending { " DESC" } else { "" };
    if query.order.key == OrderKey::Number {
        // The number alone, so that a key serves the order. Open trials are few: they are found by their
        // index and sorted.
        let number = if query.filter.comparisons.iter().any(is_open) { "number + 0" } else { "number" };
        if let Some(after) = &query.after {
            let beyond = if query.order.descending { " < " } else { " > " };
            sql.text(" AND ").text(number).text(beyond).integer(after.number);
        }
        sql.text(" ORDER BY ").text(number).text(direction);
    } else {
        if let Some(after) = &query.after {
            push_behind(sql, query, after.value, after.number);
        }
        sql.text(" ORDER BY ");
        push_key(sql, &query.order.key).text(" IS NULL, ");
        push_key(sql, &query.order.key).text(direction).text(", number");
    }
    sql.text(" LIMIT ").integer(signed(u64::from(query.size) + 1)?);
    Ok(())
}

/// The rows behind one with this value and number; those without a value come last.
fn push_behind<D: Dialect>(sql: &mut D, query: &TrialQuery, value: Option<f64>, number: i64) {
    let key = &query.order.key;
    assert!(*key != OrderKey::Number, "the numbers have a question of their own");
    debug_assert!(value.is_none_or(f64::is_finite), "no row lies behind {value:?}");
    sql.text(" AND (");
    if let Some(value) = value {
        push_key(sql, key).text(if query.order.descending { " < " } else { " > " });
        push_key_value(sql, key, value).text(" OR (");
        push_key(sql, key).text(" = ");
        push_key_value(sql, key, value).text(" AND number > ").integer(number).text(") OR ");
        push_key(sql, key).text(" IS NULL)");
    } else {
        push_key(sql, key).text(" IS NULL AND number > ").integer(number).text(")");
    }
}

/// A value of the key, read like the key.
fn push_key_value<'d, D: Dialect>(sql: &'d mut D, key: &OrderKey, value: f64) -> &'d mut D {
    match key {
        OrderKey::Number | OrderKey::Cost => sql.real(value),
        OrderKey::Measurement(_) => sql.member_value(value),
    }
}

fn push_key<'d, D: Dialect>(sql: &'d mut D, key: &OrderKey) -> &'d mut D {
    match key {
        OrderKey::Number => sql.text("number"),
        OrderKey::Cost => sql.text("cost"),
        OrderKey::Measurement(name) => sql.member("measurements", name),
    }
}

/// Whether a comparison asks for trials under a lease only.
fn is_open(comparison: &FieldComparison) -> bool {
    let FieldComparison { field, operator, literal } = comparison;
    let is_open = matches!(literal, Literal::Text(word) if word == TrialState::Open.word());
    (field, operator, is_open) == (&Field::State, &Operator::Equal, true)
}

fn push_comparison<D: Dialect>(sql: &mut D, comparison: &FieldComparison) {
    let FieldComparison { field, operator, literal } = comparison;
    let column = match field {
        // Fixed text, because a partial index is only used where the statement shows that it covers the
        // question.
        Field::State if is_open(comparison) => {
            sql.text("state = 'OPEN'");
            return;
        }
        Field::State => "state",
        Field::Mode => "mode",
        Field::Outcome => "outcome",
        Field::Late => "late",
        Field::Excluded => "(exclusion IS NOT NULL)",
        Field::ClientId => "client_id",
        Field::StateId => "state_id",
        Field::Number => "number",
        Field::Cost => "cost",
        Field::Measurement(name) => {
            push_operator(sql.member("measurements", name), *operator).member_literal(literal);
            return;
        }
        Field::Indicator(name) => {
            push_operator(sql.member("indicators", name), *operator).member_literal(literal);
            return;
        }
        Field::Configuration(name) => {
            sql.parameter(name, *operator, literal);
            return;
        }
    };
    push_operator(sql.text(column), *operator).literal(literal);
}

/// ` operator `; the filter language and SQL have equal symbols.
pub(crate) fn push_operator<D: Dialect>(sql: &mut D, operator: Operator) -> &mut D {
    sql.text(" ").text(operator.symbol()).text(" ")
}
