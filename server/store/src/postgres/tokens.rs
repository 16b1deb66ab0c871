//! Tokens in PostgreSQL, where every replica finds them.
//!
//! Each replica asks for the [revision](TokenStore::revision) often, so that a token made or revoked through
//! any replica, or by the command line, counts everywhere soon. Changes of tokens wait for each other at the
//! one row of the revision; the database adds up the usage of tokens over all replicas.

use std::collections::BTreeSet;
use std::time::Duration;

use sqlx::pool::PoolConnection;
use sqlx::postgres::{PgConnection, PgPool, Postgres};
use sqlx::{Connection as _, Executor as _};

use super::{PostgresAddress, failed as store_error, open};
use crate::error::OpenError;
use crate::limits;
use crate::tokens::rows::{UsageRow, changed, records, signed, texts, token_store};
use crate::tokens::{TokenError, TokenRecord, TokenStore, Usage};

const LIST: &str = "SELECT id, name, hash, scope, studies::text AS studies, quota::text AS quota, create_ms, \
                    expire_ms, revoke_ms FROM tokens ORDER BY create_ms, id";

const INSERT: &str = "INSERT INTO tokens VALUES ($1, $2, $3, $4, $5::json, $6::json, $7, $8, $9)";

/// A sum that does not fit becomes the largest number.
const USAGE: &str = "SELECT least(coalesce(sum(studies), 0), 9223372036854775807)::bigint AS studies, \
                     least(coalesce(sum(trials), 0), 9223372036854775807)::bigint AS trials, \
                     least(coalesce(sum(bytes), 0), 9223372036854775807)::bigint AS bytes \
                     FROM token_usage WHERE token = $1 AND day BETWEEN $2 AND $3";

/// Adds in one statement, in the order of the ids, so that two replicas never wait for each other crosswise.
const ADD_USAGE: &str = "INSERT INTO token_usage AS u (token, day, studies, trials, bytes) \
                         SELECT t.id, $1, r.studies, r.trials, r.bytes \
                         FROM unnest($2::text[], $3::bigint[], $4::bigint[], $5::bigint[]) \
                             AS r (id, studies, trials, bytes) JOIN tokens t ON t.id = r.id ORDER BY t.id \
                         ON CONFLICT (token, day) DO UPDATE SET studies = u.studies + excluded.studies, \
                         trials = u.trials + excluded.trials, bytes = u.bytes + excluded.bytes";

/// Tokens in a PostgreSQL database.
#[derive(Debug)]
pub struct PostgresTokens {
    connections: PgPool,
}

impl PostgresTokens {
    /// Opens the tokens of a database, also while daemons serve it, and brings its schema up to date first.
    /// `patience` is the longest wait for a server that comes up.
    ///
    /// # Errors
    /// [`OpenError`] with the cause and a remedy, never with a password.
    pub async fn open(database: &PostgresAddress, patience: Duration) -> Result<Self, OpenError> {
        let connection = open::open(database, patience).await?;
        if let Err(error) = connection.close().await {
            tracing::debug!(%error, "a connection was not closed in order");
        }
        Ok(Self { connections: database.pool(limits::POSTGRES_TOKENS) })
    }

    async fn connection(&self) -> Result<PoolConnection<Postgres>, TokenError> {
        self.connections.acquire().await.map_err(failed)
    }

    async fn create_one(&self, token: &TokenRecord) -> Result<(), TokenError> {
        let mut connection = self.connection().await?;
        let mut transaction = connection.begin().await.map_err(failed)?;
        // This transaction holds the row from the count until the new token counts.
        transaction.execute("SELECT FROM token_revision FOR UPDATE").await.map_err(failed)?;
        insert(&mut transaction, token).await?;
        transaction.commit().await.map_err(failed)
    }

    async fn count(&self, day: i64, used: &[(String, Usage)]) -> Result<(), TokenError> {
        debug_assert_eq!(
            used.iter().map(|(id, _)| id).collect::<BTreeSet<_>>().len(),
            used.len(),
            "a statement may touch a row only once"
        );
        let column =
            |of: fn(&Usage) -> u64| used.iter().map(|(_, used)| signed(of(used))).collect::<Vec<_>>();
        let adding = sqlx::query(ADD_USAGE)
            .bind(day)
            .bind(used.iter().map(|(id, _)| id.as_str()).collect::<Vec<_>>())
            .bind(column(|used| used.studies))
            .bind(column(|used| used.trials))
            .bind(column(|used| used.bytes));
        let added = adding.execute(&mut *self.connection().await?).await.map_err(failed)?.rows_affected();
        assert!(added <= used.len() as u64, "{added} tokens of {} are counted", used.len());
        Ok(())
    }

    async fn end(&self) {
        self.connections.close().await;
    }
}

fn failed(error: sqlx::Error) -> TokenError {
    store_error(error).into()
}

token_store!(PostgresTokens, PgConnection);
