//! Tokens in the SQLite file, over a separate connection.
//!
//! The daemon's lock on the file keeps a second daemon out, and is not taken here: SQLite's own locks suffice
//! for a few small rows, so the command line can make and revoke tokens while the daemon runs.

use std::path::Path;

use sqlx::sqlite::{SqliteConnectOptions, SqliteConnection};
use sqlx::{ConnectOptions as _, Connection as _};
use tokio::sync::{MappedMutexGuard, Mutex, MutexGuard};

use super::{open, store_error};
use crate::error::{OpenError, StoreError};
use crate::limits;
use crate::tokens::rows::{UsageRow, changed, records, signed, texts, token_store};
use crate::tokens::{TokenError, TokenRecord, TokenStore, Usage};

const LIST: &str = "SELECT * FROM tokens ORDER BY create_ms, id";

const INSERT: &str = "INSERT INTO tokens VALUES ($1, $2, $3, $4, $5, $6, $7, $8, $9)";

const USAGE: &str = "SELECT coalesce(sum(studies), 0) AS studies, coalesce(sum(trials), 0) AS trials, \
                     coalesce(sum(bytes), 0) AS bytes FROM token_usage \
                     WHERE token = $1 AND day BETWEEN $2 AND $3";

/// Tokens in an SQLite file.
#[derive(Debug)]
pub struct SqliteTokens {
    /// None once closed.
    connection: Mutex<Option<SqliteConnection>>,
}

impl SqliteTokens {
    /// Opens the tokens of a database file, also while a daemon has it. Without a daemon, the file is created
    /// and its schema brought up to date first.
    pub async fn open(path: &Path) -> Result<Self, OpenError> {
        Self::connect(path, open::beside(path).await?).await
    }

    /// Opens the tokens of a database that this process serves, and has therefore locked and brought up to
    /// date.
    pub async fn open_served(path: &Path) -> Result<Self, OpenError> {
        Self::connect(path, open::options(path).create_if_missing(false)).await
    }

    async fn connect(path: &Path, options: SqliteConnectOptions) -> Result<Self, OpenError> {
        let connection = options.connect().await.map_err(|error| open::explain(path, &error))?;
        Ok(Self { connection: Mutex::new(Some(connection)) })
    }

    async fn connection(&self) -> Result<MappedMutexGuard<'_, SqliteConnection>, TokenError> {
        MutexGuard::try_map(self.connection.lock().await, Option::as_mut)
            .map_err(|_| TokenError::Store(StoreError::Closed))
    }

    async fn create_one(&self, token: &TokenRecord) -> Result<(), TokenError> {
        insert(&mut *self.connection().await?, token).await
    }

    async fn count(&self, day: i64, used: &[(String, Usage)]) -> Result<(), TokenError> {
        const ADD: &str = "INSERT INTO token_usage SELECT id, ?, ?, ?, ? FROM tokens WHERE id = ? \
                           ON CONFLICT (token, day) DO UPDATE SET studies = studies + excluded.studies, \
                           trials = trials + excluded.trials, bytes = bytes + excluded.bytes";
        let mut connection = self.connection().await?;
        let mut transaction = connection.begin().await.map_err(failed)?;
        for (id, more) in used {
            let [studies, trials, bytes] = [more.studies, more.trials, more.bytes].map(signed);
            let adding = sqlx::query(ADD).bind(day).bind(studies).bind(trials).bind(bytes).bind(id);
            let added = adding.execute(&mut *transaction).await.map_err(failed)?;
            let rows = added.rows_affected();
            assert!(rows <= 1, "token {id:?} is counted {rows} times");
        }
        transaction.commit().await.map_err(failed)
    }

    async fn end(&self) {
        let connection = self.connection.lock().await.take();
        if let Some(connection) = connection
            && let Err(error) = connection.close().await
        {
            tracing::warn!(%error, "the tokens were not closed cleanly; nothing is lost");
        }
    }
}

fn failed(error: sqlx::Error) -> TokenError {
    store_error(&error).into()
}

token_store!(SqliteTokens, SqliteConnection);
