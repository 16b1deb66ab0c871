//! Filters in PostgreSQL's own terms: `->>` and `json_typeof`.
//!
//! A number in a document is cast to double precision, which PostgreSQL does exactly. A cast of another kind
//! would be an error, and SQL may evaluate the parts of an AND in any order. So CASE, which has an order,
//! separates the kinds.

use sqlx::{Postgres, QueryBuilder};

use super::batch::without_nul;
use crate::filter::{Literal, Operator};
use crate::question::{Dialect, push_operator};

impl Dialect for QueryBuilder<Postgres> {
    fn text(&mut self, sql: &str) -> &mut Self {
        self.push(sql)
    }

    fn integer(&mut self, value: i64) -> &mut Self {
        self.push_bind(value)
    }

    fn real(&mut self, value: f64) -> &mut Self {
        self.push_bind(value)
    }

    fn string(&mut self, value: &str) -> &mut Self {
        self.push_bind(without_nul(value))
    }

    fn flag(&mut self, value: bool) -> &mut Self {
        self.push_bind(value)
    }

    fn member(&mut self, column: &str, name: &str) -> &mut Self {
        self.push("(").push(column).push(" ->> ").push_bind(name.to_owned()).push(")::double precision")
    }

    fn member_value(&mut self, value: f64) -> &mut Self {
        self.push_bind(value)
    }

    fn parameter(&mut self, name: &str, operator: Operator, literal: &Literal) -> &mut Self {
        let (kind, cast) = match literal {
            Literal::Number(_) | Literal::Whole(_) => ("number", "::double precision"),
            Literal::Text(_) => ("string", " COLLATE \"C\""),
            Literal::Boolean(_) => ("boolean", "::boolean"),
        };
        self.push("(CASE WHEN json_typeof(configuration -> ").push_bind(name.to_owned());
        self.push(") = ").push_bind(kind).push(" THEN (configuration ->> ").push_bind(name.to_owned());
        push_operator(self.push(")").push(cast), operator);
        self.member_literal(literal).push(" ELSE false END)")
    }
}
