//! Filters in SQLite's own terms: `json_extract` and `json_type`.
//!
//! SQLite reads a number in JSON text to within a last digit, not always exactly. So a number to compare is
//! bound as JSON text as well. Both are read alike, and equal numbers stay equal.

use sqlx::{QueryBuilder, Sqlite};

use crate::filter::{Literal, Operator};
use crate::question::{Dialect, push_operator};

impl Dialect for QueryBuilder<Sqlite> {
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
        self.push_bind(value.to_owned())
    }

    fn flag(&mut self, value: bool) -> &mut Self {
        self.push_bind(i64::from(value))
    }

    fn member(&mut self, column: &str, name: &str) -> &mut Self {
        push_member(self, "json_extract", column, name)
    }

    fn member_value(&mut self, value: f64) -> &mut Self {
        let text = serde_json::Value::from(value).to_string();
        self.push("json_extract(").push_bind(text).push(", '$')")
    }

    fn parameter(&mut self, name: &str, operator: Operator, literal: &Literal) -> &mut Self {
        const COLUMN: &str = "configuration";
        let kinds = match literal {
            Literal::Number(_) | Literal::Whole(_) => " IN ('integer', 'real') AND ",
            Literal::Text(_) => " = 'text' AND ",
            Literal::Boolean(_) => " IN ('true', 'false') AND ",
        };
        push_member(self.push("("), "json_type", COLUMN, name).push(kinds);
        push_operator(push_member(self, "json_extract", COLUMN, name), operator);
        self.member_literal(literal).push(")")
    }
}

/// `function(column, '$."name"')`, the path bound. Names hold no quotes.
fn push_member<'q>(
    sql: &'q mut QueryBuilder<Sqlite>,
    function: &str,
    column: &str,
    name: &str,
) -> &'q mut QueryBuilder<Sqlite> {
    sql.push(function).push("(").push(column).push(", ").push_bind(format!("$.\"{name}\"")).push(")")
}

#[cfg(test)]
mod tests {
    use sqlx::sqlite::SqliteConnection;
    use sqlx::{Connection as _, Row as _};

    use super::*;
    use crate::filter::{Filter, Order};
    use crate::question;
    use crate::store::TrialQuery;

    async fn plan(connection: &mut SqliteConnection, filter: &str, order: &str) -> Vec<String> {
        let filter = Filter::parse(filter).expect("a filter");
        let query =
            TrialQuery { filter, order: Order::parse(order).expect("an order"), after: None, size: 50 };
        let mut sql = QueryBuilder::new("EXPLAIN QUERY PLAN ");
        question::trial_page(&mut sql, 1, &query).expect("a question");
        let rows = sql.build().fetch_all(connection).await.expect("a plan");
        rows.iter().map(|row| row.get("detail")).collect()
    }

    /// The questions of the dashboard's pages read no more trials than they show, even in a large study.
    #[tokio::test]
    async fn questions_of_pages_read_what_they_show() {
        let mut connection = SqliteConnection::connect("sqlite::memory:").await.expect("a database");
        crate::migrations::sqlite().run(&mut connection).await.expect("its schema");
        let states = "trials_by_state (study=? AND state_id=?)";
        for (filter, order, index) in [
            ("", "number desc", "sqlite_autoindex_trials_1 (study=?)"),
            ("state_id = 3", "", states),
            ("state_id = 3", "number desc", states),
            ("state_id = 3 AND outcome = OK", "number desc", states),
        ] {
            let plan = plan(&mut connection, filter, order).await;
            assert!(plan.len() == 1 && plan[0].ends_with(index), "{filter} {order}: {plan:?}");
        }
        // The few open trials are sorted.
        let plan = plan(&mut connection, "state = OPEN", "").await;
        assert!(plan[0].contains("trials_open"), "{plan:?}");
    }

    #[tokio::test]
    async fn names_with_dots_and_dashes_are_members() {
        let mut connection = SqliteConnection::connect("sqlite::memory:").await.expect("a database");
        let mut sql = QueryBuilder::new("SELECT ");
        push_member(&mut sql, "json_extract", r#"'{"block.x-größe": 7}'"#, "block.x-größe");
        let row = sql.build().fetch_one(&mut connection).await.expect("a row");
        assert_eq!(row.get::<i64, _>(0), 7);
    }
}
