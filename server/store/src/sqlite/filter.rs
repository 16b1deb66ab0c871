//! Filters, orders and cursors as SQL. Every value and every name is bound, never spliced into the text.
//!
//! This is the place with SQLite's own dialect: `json_extract` and `json_type`. SQLite reads a number in
//! JSON text to within a last digit, not always exactly. So a number that is compared with one is bound as
//! JSON text as well, and both go through the same reading: equal numbers stay equal.

use sqlx::{QueryBuilder, Sqlite};

use super::rows::signed;
use super::statements::TRIAL_COLUMNS;
use crate::error::StoreError;
use crate::filter::{Comparison, Literal, Operator, OrderKey};
use crate::store::TrialQuery;
use crate::words::{MODES, OUTCOMES, STATES, word};

/// The question for one page, and for one row more, which tells whether another page follows.
pub(super) fn trial_page(study: i64, query: &TrialQuery) -> Result<QueryBuilder<Sqlite>, StoreError> {
    let mut sql = QueryBuilder::new("SELECT ");
    sql.push(TRIAL_COLUMNS).push(" FROM trials WHERE study = ").push_bind(study);
    for comparison in &query.filter.comparisons {
        sql.push(" AND ");
        push_comparison(&mut sql, comparison);
    }
    let direction = if query.order.descending { " DESC" } else { "" };
    if query.order.key == OrderKey::Number {
        // Of its own, so that the primary key serves it.
        if let Some(after) = &query.after {
            let beyond = if query.order.descending { " < " } else { " > " };
            sql.push(" AND number").push(beyond).push_bind(after.number);
        }
        sql.push(" ORDER BY number").push(direction);
    } else {
        if let Some(after) = &query.after {
            push_behind(&mut sql, query, after.value, after.number);
        }
        sql.push(" ORDER BY ");
        push_key(&mut sql, &query.order.key);
        sql.push(" IS NULL, ");
        push_key(&mut sql, &query.order.key);
        sql.push(direction).push(", number");
    }
    let one_more = signed(u64::from(query.size) + 1)?;
    sql.push(" LIMIT ").push_bind(one_more);
    Ok(sql)
}

/// The rows behind one with this value and number; those without a value come last.
fn push_behind(sql: &mut QueryBuilder<Sqlite>, query: &TrialQuery, value: Option<f64>, number: i64) {
    let key = &query.order.key;
    sql.push(" AND (");
    if let Some(value) = value {
        push_key(sql, key);
        sql.push(if query.order.descending { " < " } else { " > " });
        push_key_value(sql, key, value);
        sql.push(" OR (");
        push_key(sql, key);
        sql.push(" = ");
        push_key_value(sql, key, value);
        sql.push(" AND number > ").push_bind(number).push(") OR ");
        push_key(sql, key);
        sql.push(" IS NULL)");
    } else {
        push_key(sql, key);
        sql.push(" IS NULL AND number > ").push_bind(number).push(")");
    }
}

/// A value of the key, read as the key is read.
fn push_key_value(sql: &mut QueryBuilder<Sqlite>, key: &OrderKey, value: f64) {
    match key {
        OrderKey::Number | OrderKey::Cost => sql.push_bind(value),
        OrderKey::Measurement(_) => push_json_number(sql, value),
    };
}

fn push_key(sql: &mut QueryBuilder<Sqlite>, key: &OrderKey) {
    match key {
        OrderKey::Number => sql.push("CAST(number AS REAL)"),
        OrderKey::Cost => sql.push("cost"),
        OrderKey::Measurement(name) => push_member(sql, "json_extract", "measurements", name),
    };
}

/// `function(column, '$.name')`, the path bound.
fn push_member<'q>(
    sql: &'q mut QueryBuilder<Sqlite>,
    function: &str,
    column: &str,
    name: &str,
) -> &'q mut QueryBuilder<Sqlite> {
    sql.push(function).push("(").push(column).push(", ").push_bind(format!("$.{name}")).push(")")
}

/// A number that is compared with one in JSON text.
fn push_json_number(sql: &mut QueryBuilder<Sqlite>, number: f64) -> &mut QueryBuilder<Sqlite> {
    let text = serde_json::Value::from(number).to_string();
    sql.push("json_extract(").push_bind(text).push(", '$')")
}

fn push_comparison(sql: &mut QueryBuilder<Sqlite>, comparison: &Comparison) {
    match comparison {
        Comparison::State(operator, state) => {
            push_operator(sql.push("state"), *operator).push_bind(word(STATES, *state))
        }
        Comparison::Mode(operator, mode) => {
            push_operator(sql.push("mode"), *operator).push_bind(word(MODES, *mode))
        }
        Comparison::Outcome(operator, kind) => {
            push_operator(sql.push("outcome"), *operator).push_bind(word(OUTCOMES, *kind))
        }
        Comparison::Late(operator, late) => {
            push_operator(sql.push("late"), *operator).push_bind(i64::from(*late))
        }
        Comparison::ClientId(operator, text) => {
            push_operator(sql.push("client_id"), *operator).push_bind(text.clone())
        }
        Comparison::StateId(operator, id) => push_operator(sql.push("state_id"), *operator).push_bind(*id),
        Comparison::Number(operator, number) => {
            push_operator(sql.push("number"), *operator).push_bind(*number)
        }
        Comparison::Cost(operator, cost) => push_operator(sql.push("cost"), *operator).push_bind(*cost),
        Comparison::Measurement(name, operator, value) => {
            push_operator(push_member(sql, "json_extract", "measurements", name), *operator);
            push_json_number(sql, *value)
        }
        Comparison::Indicator(name, operator, value) => {
            push_operator(push_member(sql, "json_extract", "indicators", name), *operator);
            push_json_number(sql, *value)
        }
        Comparison::Configuration(name, operator, literal) => push_literal(sql, name, *operator, literal),
    };
}

/// A parameter's value has a kind, and only compares with its own.
fn push_literal<'q>(
    sql: &'q mut QueryBuilder<Sqlite>,
    name: &str,
    operator: Operator,
    literal: &Literal,
) -> &'q mut QueryBuilder<Sqlite> {
    const COLUMN: &str = "configuration";
    let kinds = match literal {
        Literal::Number(_) => " IN ('integer', 'real') AND ",
        Literal::Text(_) => " = 'text' AND ",
        Literal::Boolean(_) => " IN ('true', 'false') AND ",
    };
    sql.push("(");
    push_member(sql, "json_type", COLUMN, name).push(kinds);
    push_operator(push_member(sql, "json_extract", COLUMN, name), operator);
    match literal {
        Literal::Number(number) => push_json_number(sql, *number),
        Literal::Text(text) => sql.push_bind(text.clone()),
        Literal::Boolean(boolean) => sql.push_bind(i64::from(*boolean)),
    }
    .push(")")
}

fn push_operator(sql: &mut QueryBuilder<Sqlite>, operator: Operator) -> &mut QueryBuilder<Sqlite> {
    sql.push(" ").push(operator.symbol()).push(" ")
}
