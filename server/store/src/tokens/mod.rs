//! Stored tokens: rights, expiry and quotas of their holders.
//!
//! [`TokenStore`] stands beside [`Store`](crate::Store), in one database, so that one backup holds both, and
//! several daemons on it accept equal tokens. Only the SHA-256 of a token's secret is kept. A slow password
//! hash would buy nothing: the secret is 256 random bits, so that guessing is hopeless at any speed, while
//! every request pays for the hash.
//!
//! The command line writes to these tables while the daemon runs. [`TokenStore::revision`] shows such a
//! change to the daemon at little cost.

mod memory;
pub(crate) mod rows;

use async_trait::async_trait;
use serde::{Deserialize, Serialize};

use crate::error::StoreError;

pub use memory::MemoryTokens;

/// The rights of a token's holder. Each scope includes those before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Scope {
    /// Look at studies and trials, and predict.
    Read,
    /// Create studies, change policies, and tune.
    Tune,
    /// Delete studies.
    Admin,
}

/// The studies that a token is good for: ids, and prefixes that end with `*`. Empty means all.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct Studies(pub Vec<String>);

impl Studies {
    /// Whether a study is among them.
    pub fn contains(&self, study: &str) -> bool {
        self.0.is_empty()
            || self.0.iter().any(|pattern| match pattern.strip_suffix('*') {
                Some(prefix) => study.starts_with(prefix),
                None => study == pattern,
            })
    }
}

/// The quota of a token. A field that is not set means no limit.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Quota {
    /// Requests and stream frames a second, in the long run; a second's worth may come at once.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub requests_per_s: Option<u32>,
    /// The number of studies that it may create in all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub studies: Option<u64>,
    /// The number of trials that it may receive in all.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trials: Option<u64>,
    /// The number of trials that it may receive in a day (UTC).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub trials_per_day: Option<u64>,
    /// Bytes of requests that it may send in a day (UTC).
    #[serde(skip_serializing_if = "Option::is_none")]
    pub bytes_per_day: Option<u64>,
}

/// The usage of a token.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Usage {
    /// Studies created.
    pub studies: u64,
    /// Trials handed out.
    pub trials: u64,
    /// Bytes of requests.
    pub bytes: u64,
}

/// A token as it is stored.
#[derive(Clone, Debug, PartialEq)]
pub struct TokenRecord {
    /// The public part, by which it is looked up, listed and logged.
    pub id: String,
    /// For people.
    pub name: String,
    /// SHA-256 of the secret part.
    pub hash: [u8; 32],
    /// The rights of its holder.
    pub scope: Scope,
    /// The studies for which it is valid.
    pub studies: Studies,
    /// The quota.
    pub quota: Quota,
    /// The time of its creation, in milliseconds since 1970.
    pub create_ms: i64,
    /// The end of its validity, if it has one.
    pub expire_ms: Option<i64>,
    /// The time of its revocation, if it was revoked.
    pub revoke_ms: Option<i64>,
}

impl TokenRecord {
    /// Whether it is valid at this time.
    pub fn is_live(&self, now_ms: i64) -> bool {
        self.revoke_ms.is_none() && self.expire_ms.is_none_or(|expire_ms| now_ms < expire_ms)
    }
}

/// The day of a time: days since 1970, UTC.
pub fn day(now_ms: i64) -> i64 {
    now_ms.div_euclid(86_400_000)
}

/// Why a token could not be stored or changed.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TokenError {
    /// No token has this id.
    #[error("there is no token {0:?}; `treewrightd token list` shows those there are")]
    NotFound(String),
    /// The id is taken.
    #[error("there is a token {0:?} already; try again")]
    Exists(String),
    /// The database is full of tokens.
    #[error("the database holds {0} tokens, which is its limit; remove revoked ones")]
    TooMany(u32),
    /// The database fails.
    #[error(transparent)]
    Store(#[from] StoreError),
}

/// Keeps tokens and their usage.
#[async_trait]
pub trait TokenStore: Send + Sync + 'static {
    /// Adds a token.
    async fn create(&self, token: &TokenRecord) -> Result<(), TokenError>;

    /// All tokens, the oldest first.
    async fn list(&self) -> Result<Vec<TokenRecord>, TokenError>;

    /// Ends a token. A token that was revoked before keeps the first time.
    async fn revoke(&self, id: &str, now_ms: i64) -> Result<(), TokenError>;

    /// Removes a token with its usage.
    async fn forget(&self, id: &str) -> Result<(), TokenError>;

    /// A number that rises with each change of a token, through any replica or command.
    async fn revision(&self) -> Result<i64, TokenError>;

    /// The usage of a token in all, and on one day.
    async fn usage(&self, id: &str, day: i64) -> Result<(Usage, Usage), TokenError>;

    /// Adds to the tokens' usage on a day. Removed tokens are ignored.
    async fn add_usage(&self, day: i64, used: &[(String, Usage)]) -> Result<(), TokenError>;

    /// Closes. Later calls answer [`StoreError::Closed`].
    async fn close(&self);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patterns_are_ids_or_prefixes() {
        let some = Studies(vec!["hall".into(), "farm-*".into()]);
        for (study, inside) in
            [("hall", true), ("hall2", false), ("farm-", true), ("farm-1", true), ("farm", false)]
        {
            assert_eq!(some.contains(study), inside, "{study}");
        }
        assert!(Studies::default().contains("anything"));
    }

    #[test]
    fn days_are_counted_from_1970() {
        assert_eq!((day(0), day(86_399_999), day(86_400_000), day(-1)), (0, 0, 1, -1));
    }
}
