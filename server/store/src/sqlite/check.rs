//! Checks of a database file: the tables against the migrations, the pages by SQLite's own checks, and beyond
//! SQLite's knowledge that documents can be read and counts agree.
//!
//! A start checks for a moment only, so that it takes no longer with a long history; `treewrightd check` does
//! the rest.

use std::collections::BTreeMap;
use std::time::Instant;

use sqlx::Connection as _;
use sqlx::sqlite::SqliteConnection;

use crate::limits;

/// Number of steps after which SQLite asks whether it should go on; each is at most a page.
const STEPS: i32 = 256;

#[derive(Debug)]
pub(crate) enum Unsound {
    /// The problems, at least one, each in a line.
    Problems(Vec<String>),
    /// The file cannot be read at all.
    Unreadable(sqlx::Error),
}

impl From<sqlx::Error> for Unsound {
    fn from(error: sqlx::Error) -> Self {
        // SQLITE_CORRUPT and SQLITE_NOTADB are findings.
        match super::codes::primary_code(&error) {
            Some(11 | 26) => Self::Problems(vec![super::codes::message(&error)]),
            _ => Self::Unreadable(error),
        }
    }
}

impl Unsound {
    fn unless_empty(problems: Vec<String>) -> Result<(), Self> {
        if problems.is_empty() { Ok(()) } else { Err(Self::Problems(problems)) }
    }
}

/// Checks everything in a database whose schema is up to date.
pub(crate) async fn check(connection: &mut SqliteConnection) -> Result<(), Unsound> {
    check_schema(connection).await?;
    look(connection, "PRAGMA integrity_check(20)").await?;
    Unsound::unless_empty(strays(connection).await?)?;
    Unsound::unless_empty(contents(connection).await?)
}

/// Checks the pages alone, for any schema, but not whether indexes and tables agree: enough for a copy that
/// was just written.
pub(crate) async fn check_pages(connection: &mut SqliteConnection) -> Result<(), Unsound> {
    look(connection, "PRAGMA quick_check(20)").await
}

/// The check at a start: for a moment, and no longer. Returns whether there was time for all pages.
pub(super) async fn at_start(connection: &mut SqliteConnection) -> Result<bool, Unsound> {
    check_schema(connection).await?;
    let until = Instant::now() + limits::START_CHECK;
    connection.lock_handle().await?.set_progress_handler(STEPS, move || Instant::now() < until);
    let looked = check_pages(connection).await;
    connection.lock_handle().await?.remove_progress_handler();
    match looked {
        Ok(()) => Ok(true),
        // SQLITE_INTERRUPT: the time is over.
        Err(Unsound::Unreadable(error)) if super::codes::primary_code(&error) == Some(9) => Ok(false),
        Err(other) => Err(other),
    }
}

/// Asks SQLite, which answers "ok" or with problems.
async fn look(connection: &mut SqliteConnection, pragma: &'static str) -> Result<(), Unsound> {
    let mut found: Vec<String> = sqlx::query_scalar(pragma).fetch_all(connection).await?;
    found.retain(|line| line != "ok");
    Unsound::unless_empty(found)
}

/// Rows that refer to missing rows.
async fn strays(connection: &mut SqliteConnection) -> Result<Vec<String>, Unsound> {
    let sql = "SELECT \"table\" || ' row ' || coalesce(rowid, '?') || ' refers to a missing row of ' || parent \
               FROM pragma_foreign_key_check LIMIT 20";
    Ok(sqlx::query_scalar(sql).fetch_all(connection).await?)
}

/// Documents that cannot be read: SQLite keeps no check sums, so a flipped bit inside a text can only show
/// here. One of a state or a visit keeps its study from being loaded, one of a token keeps out every caller.
async fn contents(connection: &mut SqliteConnection) -> Result<Vec<String>, Unsound> {
    let sql = "SELECT 'trial ' || number || ' of study ' || study || ' cannot be read' FROM trials \
               WHERE NOT (json_valid(configuration) AND json_valid(indicators) AND json_valid(measurements) \
               AND json_valid(reason) AND json_valid(coalesce(fingerprint, 'null')) \
               AND json_valid(coalesce(standard_errors, 'null'))) \
               UNION ALL SELECT 'state ' || id || ' of study ' || study || ' cannot be read' FROM states \
               WHERE NOT (json_valid(indicators) AND json_valid(coalesce(fingerprint, 'null'))) \
               UNION ALL SELECT 'the visit of ' || client_id || ' in study ' || study || ' cannot be read' \
               FROM visits WHERE NOT (json_valid(decision) AND json_valid(coalesce(weighed, 'null')) \
               AND json_valid(coalesce(account, 'null'))) \
               UNION ALL SELECT 'token ' || id || ' cannot be read' FROM tokens \
               WHERE NOT (json_valid(studies) AND json_valid(quota)) \
               UNION ALL SELECT 'study ' || name || ' cannot be read' FROM studies \
               WHERE NOT (json_valid(specification) AND json_valid(policy)) LIMIT 20";
    Ok(sqlx::query_scalar(sql).fetch_all(connection).await?)
}

/// Looks for tables, indexes and triggers that are missing or differ from those of the migrations. An
/// operator's own indexes and views are ignored.
pub(crate) async fn check_schema(connection: &mut SqliteConnection) -> Result<(), Unsound> {
    let found = objects(connection).await?;
    let mut fresh = SqliteConnection::connect("sqlite::memory:").await?;
    let migrated = crate::migrations::sqlite().run(&mut fresh).await;
    migrated.map_err(|error| Unsound::Unreadable(sqlx::Error::Protocol(error.to_string())))?;
    let expected = objects(&mut fresh).await?;
    fresh.close().await?;
    assert!(!expected.is_empty(), "without tables to look for every file is sound");
    let problem = |((kind, name), sql): ((String, String), String)| {
        let key = (kind, name);
        match found.get(&key) {
            None => Some(format!("{} {} is missing", key.0, key.1)),
            Some(other) if *other != sql => Some(format!("{} {} was altered", key.0, key.1)),
            Some(_) => None,
        }
    };
    Unsound::unless_empty(expected.into_iter().filter_map(problem).collect())
}

/// All objects of the schema but SQLite's and the migrator's own: kind, name, and SQL.
async fn objects(
    connection: &mut SqliteConnection,
) -> Result<BTreeMap<(String, String), String>, sqlx::Error> {
    let sql = "SELECT type, name, sql FROM sqlite_master WHERE sql IS NOT NULL AND name NOT LIKE 'sqlite%' \
               AND name <> '_sqlx_migrations'";
    let rows: Vec<(String, String, String)> = sqlx::query_as(sql).fetch_all(connection).await?;
    Ok(rows.into_iter().map(|(kind, name, sql)| ((kind, name), sql)).collect())
}
