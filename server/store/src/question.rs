//! Filters, orders and cursors as SQL for every database. Every value and every name is bound, never spliced
//! into the text.
//!
//! [`filter`](crate::filter) defines the meaning of a filter; here it becomes the part of a statement that
//! all databases share. A [`Dialect`] adds a database's own way to bind values, and to read and compare a
//! member of a JSON document.

use treewright_core::trial::TrialState;
use treewright_core::words::Word as _;

use crate::error::StoreError;
use crate::filter::{FieldComparison, Literal, Operator, OrderKey};
use crate::limits;
use crate::rows::signed;
use crate::statements::TRIALS_OF_STUDY;
use crate::store::TrialQuery;

/// A statement under construction, in one database's dialect.
pub(crate) trait Dialect {
    /// Adds fixed text.
    fn text(&mut self, sql: &str) -> &mut Self;
    /// Binds an integer.
    fn integer(&mut self, value: i64) -> &mut Self;
    /// Binds a number that is compared with a column of numbers.
    fn real(&mut self, value: f64) -> &mut Self;
    /// Binds text.
    fn string(&mut self, value: &str) -> &mut Self;
    /// Binds a truth value that is compared with a column of such.
    fn flag(&mut self, value: bool) -> &mut Self;
    /// The number under `name` in the JSON document `column`; NULL where there is none.
    fn member(&mut self, column: &str, name: &str) -> &mut Self;
    /// Binds a number that is compared with a [`member`](Self::member).
    fn member_value(&mut self, value: f64) -> &mut Self;
    /// Compares a parameter of the document `configuration` with a literal; false where its kind is another.
    fn parameter(&mut self, name: &str, operator: Operator, literal: &Literal) -> &mut Self;
}

/// The question for one page and one row more, which shows whether another page follows.
pub(crate) fn trial_page<D: Dialect>(sql: &mut D, study: i64, query: &TrialQuery) -> Result<(), StoreError> {
    assert!((1..=limits::PAGE_SIZE).contains(&query.size), "a page of {} rows", query.size);
    let comparisons = query.filter.comparisons.len();
    assert!(comparisons <= limits::FILTER_COMPARISONS, "a filter of {comparisons} comparisons");
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
    matches!(comparison, FieldComparison::State(Operator::Equal, TrialState::Open))
}

fn push_comparison<D: Dialect>(sql: &mut D, comparison: &FieldComparison) {
    use FieldComparison::{Cost, Indicator, Measurement};
    if let Cost(_, value) | Measurement(_, _, value) | Indicator(_, _, value) = comparison {
        assert!(value.is_finite(), "a comparison with {value}");
    }
    match comparison {
        // Fixed text, because a partial index is only used where the statement shows that it covers the
        // question.
        open if is_open(open) => {
            sql.text("state = 'OPEN'");
        }
        FieldComparison::State(operator, state) => {
            push_equality(sql, "state", *operator).string(state.word());
        }
        FieldComparison::Mode(operator, mode) => {
            push_equality(sql, "mode", *operator).string(mode.word());
        }
        FieldComparison::Outcome(operator, kind) => {
            push_equality(sql, "outcome", *operator).string(kind.word());
        }
        FieldComparison::Late(operator, late) => {
            push_equality(sql, "late", *operator).flag(*late);
        }
        FieldComparison::Excluded(operator, excluded) => {
            push_equality(sql, "(exclusion IS NOT NULL)", *operator).flag(*excluded);
        }
        FieldComparison::ClientId(operator, text) => {
            push(sql, "client_id", *operator).string(text);
        }
        FieldComparison::StateId(operator, id) => {
            push(sql, "state_id", *operator).integer(*id);
        }
        FieldComparison::Number(operator, number) => {
            push(sql, "number", *operator).integer(*number);
        }
        FieldComparison::Cost(operator, cost) => {
            push(sql, "cost", *operator).real(*cost);
        }
        FieldComparison::Measurement(name, operator, value) => {
            push_operator(sql.member("measurements", name), *operator).member_value(*value);
        }
        FieldComparison::Indicator(name, operator, value) => {
            push_operator(sql.member("indicators", name), *operator).member_value(*value);
        }
        FieldComparison::Configuration(name, operator, literal) => {
            sql.parameter(name, *operator, literal);
        }
    }
}

/// A column whose values have no order.
fn push_equality<'d, D: Dialect>(sql: &'d mut D, column: &str, operator: Operator) -> &'d mut D {
    assert!(operator.is_equality(), "{column} is compared with {}", operator.symbol());
    push(sql, column, operator)
}

fn push<'d, D: Dialect>(sql: &'d mut D, column: &str, operator: Operator) -> &'d mut D {
    push_operator(sql.text(column), operator)
}

/// ` operator `; the filter language and SQL have equal symbols.
pub(crate) fn push_operator<D: Dialect>(sql: &mut D, operator: Operator) -> &mut D {
    sql.text(" ").text(operator.symbol()).text(" ")
}
