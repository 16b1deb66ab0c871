//! Tokens as rows of the tables, for every database.

use treewright_core::words::Word;

use super::{Quota, Scope, Studies, TokenError, TokenRecord, Usage};
use crate::error::StoreError;
use crate::from_row::row;

row! {
    /// A row of `tokens`, with its JSON columns as texts.
    pub(crate) struct TokenRow {
        id: String,
        name: String,
        hash: Vec<u8>,
        scope: String,
        studies: String,
        quota: String,
        create_ms: i64,
        expire_ms: Option<i64>,
        revoke_ms: Option<i64>,
    }
}

impl TokenRow {
    /// Reads the row. An unreadable token is an error, so it admits nobody.
    fn record(self) -> Result<TokenRecord, TokenError> {
        let json = |error: serde_json::Error| inconsistent(format!("a token cannot be read: {error}"));
        let hash = self.hash.as_slice().try_into();
        Ok(TokenRecord {
            id: self.id,
            name: self.name,
            hash: hash.map_err(|_| inconsistent("a token's hash has not 32 bytes".to_owned()))?,
            scope: Scope::from_word(&self.scope)
                .ok_or_else(|| inconsistent(format!("{:?} is no scope", self.scope)))?,
            studies: serde_json::from_str(&self.studies).map_err(json)?,
            quota: serde_json::from_str(&self.quota).map_err(json)?,
            create_ms: self.create_ms,
            expire_ms: self.expire_ms,
            revoke_ms: self.revoke_ms,
        })
    }
}

row! {
    /// Sums over rows of `token_usage`.
    pub(crate) struct UsageRow {
        studies: i64,
        trials: i64,
        bytes: i64,
    }
}

impl From<UsageRow> for Usage {
    fn from(row: UsageRow) -> Self {
        let count = |count: i64| count.max(0) as u64;
        Self { studies: count(row.studies), trials: count(row.trials), bytes: count(row.bytes) }
    }
}

/// Reads all tokens, which come the oldest first.
pub(crate) fn records(rows: Vec<TokenRow>) -> Result<Vec<TokenRecord>, TokenError> {
    debug_assert!(rows.is_sorted_by(|a, b| (a.create_ms, &a.id) < (b.create_ms, &b.id)), "oldest first");
    rows.into_iter().map(TokenRow::record).collect()
}

/// A count in the form of the tables.
pub(crate) fn signed(count: u64) -> i64 {
    i64::try_from(count).unwrap_or(i64::MAX)
}

/// The one row that must have changed.
pub(crate) fn changed(id: &str, rows: u64) -> Result<(), TokenError> {
    assert!(rows <= 1, "{rows} tokens have the id {id:?}");
    if rows == 0 { Err(TokenError::NotFound(id.to_owned())) } else { Ok(()) }
}

impl Word for Scope {
    const WORDS: &'static [(Self, &'static str)] =
        &[(Self::Read, "READ"), (Self::Tune, "TUNE"), (Self::Admin, "ADMIN")];
    const RETIRED_WORDS: &'static [(Self, &'static str)] = &[];
}

impl Usage {
    /// Adds up.
    pub fn add(&mut self, more: Usage) {
        self.studies = self.studies.saturating_add(more.studies);
        self.trials = self.trials.saturating_add(more.trials);
        self.bytes = self.bytes.saturating_add(more.bytes);
    }
}

pub(crate) fn texts(studies: &Studies, quota: &Quota) -> Result<(String, String), TokenError> {
    let json = |error: serde_json::Error| inconsistent(error.to_string());
    let texts = (serde_json::to_string(studies).map_err(json)?, serde_json::to_string(quota).map_err(json)?);
    debug_assert_eq!(serde_json::from_str::<Studies>(&texts.0).ok().as_ref(), Some(studies));
    debug_assert_eq!(serde_json::from_str::<Quota>(&texts.1).ok().as_ref(), Some(quota));
    Ok(texts)
}

fn inconsistent(problem: String) -> TokenError {
    TokenError::Store(StoreError::Inconsistent { study: None, problem })
}

/// [`TokenStore`](super::TokenStore) for a store on a database, in a module with the statements `INSERT`,
/// `LIST` and `USAGE` and the errors `failed`. The store has methods of its own for what differs:
/// `connection`, `create_one`, `count` and `end`.
macro_rules! token_store {
    ($store:ident, $connection:ty) => {
        /// Adds a token, unless there are too many.
        async fn insert(connection: &mut $connection, token: &TokenRecord) -> Result<(), TokenError> {
            let counting = sqlx::query_scalar("SELECT count(*) FROM tokens").fetch_one(&mut *connection);
            let count: i64 = counting.await.map_err(failed)?;
            if count >= i64::from(limits::TOKENS) {
                return Err(TokenError::TooMany(limits::TOKENS));
            }
            let (studies, quota) = texts(&token.studies, &token.quota)?;
            let scope = treewright_core::words::Word::word(token.scope);
            let saving = sqlx::query(INSERT).bind(&token.id).bind(&token.name).bind(token.hash.as_slice());
            let saving = saving.bind(scope).bind(studies).bind(quota).bind(token.create_ms);
            let inserted = saving.bind(token.expire_ms).bind(token.revoke_ms).execute(connection).await;
            match inserted {
                Ok(_) => Ok(()),
                Err(error) if error.as_database_error().is_some_and(|error| error.is_unique_violation()) => {
                    Err(TokenError::Exists(token.id.clone()))
                }
                Err(error) => Err(failed(error)),
            }
        }

        #[async_trait::async_trait]
        impl TokenStore for $store {
            async fn create(&self, token: &TokenRecord) -> Result<(), TokenError> {
                self.create_one(token).await
            }

            async fn list(&self) -> Result<Vec<TokenRecord>, TokenError> {
                let asking = sqlx::query_as(LIST);
                records(asking.fetch_all(&mut *self.connection().await?).await.map_err(failed)?)
            }

            async fn revoke(&self, id: &str, now_ms: i64) -> Result<(), TokenError> {
                let revoking =
                    sqlx::query("UPDATE tokens SET revoke_ms = coalesce(revoke_ms, $1) WHERE id = $2");
                let revoking = revoking.bind(now_ms).bind(id);
                let done = revoking.execute(&mut *self.connection().await?).await.map_err(failed)?;
                changed(id, done.rows_affected())
            }

            async fn forget(&self, id: &str) -> Result<(), TokenError> {
                let forgetting = sqlx::query("DELETE FROM tokens WHERE id = $1").bind(id);
                let done = forgetting.execute(&mut *self.connection().await?).await.map_err(failed)?;
                changed(id, done.rows_affected())
            }

            async fn revision(&self) -> Result<i64, TokenError> {
                let asking = sqlx::query_scalar("SELECT revision FROM token_revision");
                asking.fetch_one(&mut *self.connection().await?).await.map_err(failed)
            }

            async fn usage(&self, id: &str, day: i64) -> Result<(Usage, Usage), TokenError> {
                let mut connection = self.connection().await?;
                let mut sums = [Usage::default(); 2];
                for (sum, (first, last)) in sums.iter_mut().zip([(i64::MIN, i64::MAX), (day, day)]) {
                    let asking = sqlx::query_as(USAGE).bind(id).bind(first).bind(last);
                    let row = asking.fetch_one(&mut *connection).await;
                    *sum = row.map(|row: UsageRow| row.into()).map_err(failed)?;
                }
                Ok((sums[0], sums[1]))
            }

            async fn add_usage(&self, day: i64, used: &[(String, Usage)]) -> Result<(), TokenError> {
                self.count(day, used).await
            }

            async fn close(&self) {
                self.end().await;
            }
        }
    };
}

pub(crate) use token_store;
