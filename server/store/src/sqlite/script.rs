//! The rows of a commit as one script.
//!
//! A connection's statements run on a separate thread, and the way there and back costs more than the
//! statement itself. So a commit is sent as one text of several statements, whose parameters count on.

use sqlx::AssertSqlSafe;
use sqlx::query::Query;
use sqlx::sqlite::{Sqlite, SqliteArguments};

use super::statements as sql;
use crate::rows::{Rows, StateRow, TrialRow, VisitRow};

/// Most rows of a script that is kept prepared. A frame has two to four; only many leases that end at once
/// have more.
const PREPARED_ROWS: usize = 6;

type Statements<'q> = Query<'q, Sqlite, SqliteArguments>;

/// Binds values one after the other.
macro_rules! bind {
    ($script:ident: $($value:expr),+ $(,)?) => { $script$(.bind($value))+ };
}

/// Stores `rows` inside the transaction that is open.
pub(super) fn rows(study: i64, rows: &Rows) -> Statements<'_> {
    bound(study, rows, text(rows))
}

/// Stores `rows` in a transaction of its own. After an error the transaction may still be open.
pub(super) fn transaction(study: i64, rows: &Rows) -> Statements<'_> {
    bound(study, rows, format!("BEGIN IMMEDIATE;{};COMMIT", text(rows)))
}

/// Removals make room first, then states: visits and trials refer to them.
fn text(rows: &Rows) -> String {
    let forgotten = std::iter::repeat_n(sql::VISIT_DELETE, rows.forgotten.len());
    let states = std::iter::repeat_n(sql::STATE_UPSERT, rows.states.len());
    let visits = std::iter::repeat_n(sql::VISIT_UPSERT, rows.visits.len());
    let trials = std::iter::repeat_n(sql::TRIAL_UPSERT, rows.trials.len());
    let statements: Vec<&str> = forgotten.chain(states).chain(visits).chain(trials).collect();
    assert_eq!(statements.len(), rows.count());
    statements.join(";")
}

fn bound(study: i64, rows: &Rows, text: String) -> Statements<'_> {
    debug_assert_eq!(text.matches('?').count(), parameters(rows), "{text}");
    // The text is put together from fixed parts alone.
    let mut script = sqlx::query(AssertSqlSafe(text)).persistent(rows.count() <= PREPARED_ROWS);
    for client_id in &rows.forgotten {
        script = script.bind(study).bind(client_id);
    }
    for row in &rows.states {
        script = bind_state(script, study, row);
    }
    for row in &rows.visits {
        script = bind_visit(script, study, row);
    }
    for row in &rows.trials {
        script = bind_trial(script, study, row);
    }
    script
}

/// The number of values that are bound below.
fn parameters(rows: &Rows) -> usize {
    2 * rows.forgotten.len() + 5 * rows.states.len() + 8 * rows.visits.len() + 22 * rows.trials.len()
}

fn bind_state<'q>(script: Statements<'q>, study: i64, row: &'q StateRow) -> Statements<'q> {
    bind!(script: study, row.id, &row.indicators, &row.fingerprint, &row.search_packed)
}

fn bind_visit<'q>(script: Statements<'q>, study: i64, row: &'q VisitRow) -> Statements<'q> {
    bind!(script: study, &row.client_id, row.state_id, row.number, row.since, &row.decision, &row.weighed,
        &row.account)
}

/// Binds in the order of the columns in [`TRIAL_UPSERT`](sql::TRIAL_UPSERT).
fn bind_trial<'q>(script: Statements<'q>, study: i64, row: &'q TrialRow) -> Statements<'q> {
    bind!(script: study, row.number, &row.client_id, row.state_id, &row.mode, &row.state, &row.outcome,
        &row.outcome_reason, row.outcome_lower_bound, row.cost, row.predicted_cost, row.late, row.create_ms,
        row.lease_expire_ms, row.complete_ms, row.completion, &row.configuration, &row.indicators,
        &row.measurements, &row.reason, &row.fingerprint, &row.standard_errors)
}
