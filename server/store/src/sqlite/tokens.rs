//! Tokens in the SQLite file, over a separate connection.
//!
//! The daemon's lock on the file keeps a second daemon out, and is not taken here: SQLite's own locks suffice
//! for a few small rows, so the command line can make and revoke tokens while the daemon runs.

use std::path::Path;

use async_trait::async_trait;
use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{ConnectOptions as _, Connection as _};
use tokio::sync::{Mutex, MutexGuard};

use super::{open, store_error};
use crate::error::{OpenError, StoreError};
use crate::limits;
use crate::tokens::rows::{TokenRow, UsageRow, changed, records, signed, texts};
use crate::tokens::{TokenError, TokenRecord, TokenStore, Usage};

/// Tokens in an SQLite file.
#[derive(Debug)]
pub struct SqliteTokens {
    /// None once closed.
    connection: Mutex<Option<SqliteConnection>>,
}

impl SqliteTokens {
    /// Opens the tokens of a database file, also while a daemon has it. Without a daemon, the file is created
    /// and its schema brought up to date first.
    ///
    /// # Errors
    /// [`OpenError`] with the cause and a remedy.
    pub async fn open(path: &Path) -> Result<Self, OpenError> {
        Self::connect(path, open::beside(path).await?).await
    }

    /// Opens the tokens of a database that this process serves, and has therefore locked and brought up to
    /// date.
    ///
    /// # Errors
    /// [`OpenError`] with the cause and a remedy.
    pub async fn open_served(path: &Path) -> Result<Self, OpenError> {
        Self::connect(path, open::options(path).create_if_missing(false)).await
    }

    async fn connect(path: &Path, options: SqliteConnectOptions) -> Result<Self, OpenError> {
        let connection = options.connect().await.map_err(|error| open::explain(path, &error))?;
        Ok(Self { connection: Mutex::new(Some(connection)) })
    }

    async fn lock(&self) -> Guard<'_> {
        Guard(self.connection.lock().await)
    }
}

/// The connection, for one use.
struct Guard<'a>(MutexGuard<'a, Option<SqliteConnection>>);

impl Guard<'_> {
    fn open(&mut self) -> Result<&mut SqliteConnection, TokenError> {
        self.0.as_mut().ok_or(TokenError::Store(StoreError::Closed))
    }
}

fn failed(error: sqlx::Error) -> TokenError {
    store_error(&error).into()
}

#[async_trait]
impl TokenStore for SqliteTokens {
    async fn create(&self, token: &TokenRecord) -> Result<(), TokenError> {
        let mut guard = self.lock().await;
        let connection = guard.open()?;
        let count: i64 = sqlx::query_scalar("SELECT count(*) FROM tokens")
            .fetch_one(&mut *connection)
            .await
            .map_err(failed)?;
        if count >= i64::from(limits::TOKENS) {
            return Err(TokenError::TooMany { limit: limits::TOKENS });
        }
        let (studies, quota) = texts(&token.studies, &token.quota)?;
        let inserted = sqlx::query("INSERT INTO tokens VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)")
            .bind(&token.id)
            .bind(&token.name)
            .bind(token.hash.as_slice())
            .bind(token.scope.word())
            .bind(studies)
            .bind(quota)
            .bind(token.create_ms)
            .bind(token.expire_ms)
            .bind(token.revoke_ms)
            .execute(connection)
            .await;
        match inserted {
            Ok(_) => Ok(()),
            Err(error) if error.as_database_error().is_some_and(|error| error.is_unique_violation()) => {
                Err(TokenError::Exists { id: token.id.clone() })
            }
            Err(error) => Err(failed(error)),
        }
    }

    async fn list(&self) -> Result<Vec<TokenRecord>, TokenError> {
        let rows: Vec<TokenRow> = sqlx::query_as("SELECT * FROM tokens ORDER BY create_ms, id")
            .fetch_all(self.lock().await.open()?)
            .await
            .map_err(failed)?;
        records(rows)
    }

    async fn revoke(&self, id: &str, now_ms: i64) -> Result<(), TokenError> {
        let done = sqlx::query("UPDATE tokens SET revoke_ms = coalesce(revoke_ms, ?) WHERE id = ?")
            .bind(now_ms)
            .bind(id)
            .execute(self.lock().await.open()?)
            .await
            .map_err(failed)?;
        changed(id, done.rows_affected())
    }

    async fn forget(&self, id: &str) -> Result<(), TokenError> {
        let done = sqlx::query("DELETE FROM tokens WHERE id = ?")
            .bind(id)
            .execute(self.lock().await.open()?)
            .await
            .map_err(failed)?;
        changed(id, done.rows_affected())
    }

    async fn revision(&self) -> Result<i64, TokenError> {
        sqlx::query_scalar("SELECT revision FROM token_revision")
            .fetch_one(self.lock().await.open()?)
            .await
            .map_err(failed)
    }

    async fn usage(&self, id: &str, day: i64) -> Result<(Usage, Usage), TokenError> {
        const SUMS: &str = "SELECT coalesce(sum(studies), 0) AS studies, coalesce(sum(trials), 0) AS trials, \
                            coalesce(sum(bytes), 0) AS bytes FROM token_usage WHERE token = ? AND day BETWEEN ? AND ?";
        let mut guard = self.lock().await;
        let mut sums = [Usage::default(); 2];
        for (sum, (first, last)) in sums.iter_mut().zip([(i64::MIN, i64::MAX), (day, day)]) {
            let row = sqlx::query_as(SUMS).bind(id).bind(first).bind(last).fetch_one(guard.open()?).await;
            *sum = row.map(|row: UsageRow| row.into()).map_err(failed)?;
        }
        Ok((sums[0], sums[1]))
    }

    async fn add_usage(&self, day: i64, used: &[(String, Usage)]) -> Result<(), TokenError> {
        const ADD: &str = "INSERT INTO token_usage SELECT id, ?, ?, ?, ? FROM tokens WHERE id = ? \
                           ON CONFLICT (token, day) DO UPDATE SET studies = studies + excluded.studies, \
                           trials = trials + excluded.trials, bytes = bytes + excluded.bytes";
        let mut guard = self.lock().await;
        let mut transaction = guard.open()?.begin().await.map_err(failed)?;
        for (id, more) in used {
            let added = sqlx::query(ADD)
                .bind(day)
                .bind(signed(more.studies))
                .bind(signed(more.trials))
                .bind(signed(more.bytes))
                .bind(id)
                .execute(&mut *transaction)
                .await
                .map_err(failed)?;
            let rows = added.rows_affected();
            assert!(rows <= 1, "token {id:?} is counted {rows} times");
        }
        transaction.commit().await.map_err(failed)
    }

    async fn close(&self) {
        let connection = self.connection.lock().await.take();
        if let Some(connection) = connection
            && let Err(error) = connection.close().await
        {
            tracing::warn!(%error, "the tokens were not closed cleanly; nothing is lost");
        }
    }
}
