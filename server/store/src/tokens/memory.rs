//! Tokens without a disk: the oracle of the contract suite, and quick for tests.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, PoisonError};

use async_trait::async_trait;

use super::{TokenError, TokenRecord, TokenStore, Usage};
use crate::error::StoreError;
use crate::limits;

/// Keeps tokens in memory and forgets them when dropped.
#[derive(Debug, Default)]
pub struct MemoryTokens {
    inner: Mutex<TokenTables>,
}

#[derive(Debug, Default)]
struct TokenTables {
    tokens: Vec<TokenRecord>,
    used: BTreeMap<(String, i64), Usage>,
    revision: i64,
    closed: bool,
}

impl MemoryTokens {
    /// No tokens.
    pub fn new() -> Self {
        Self::default()
    }

    /// A poisoned lock is usable: every change is a single step, so a panic leaves whole values behind.
    fn lock(&self) -> Result<MutexGuard<'_, TokenTables>, TokenError> {
        let inner = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
        if inner.closed { Err(StoreError::Closed.into()) } else { Ok(inner) }
    }
}

#[async_trait]
impl TokenStore for MemoryTokens {
    async fn create(&self, token: &TokenRecord) -> Result<(), TokenError> {
        let mut inner = self.lock()?;
        if inner.tokens.iter().any(|known| known.id == token.id) {
            return Err(TokenError::Exists(token.id.clone()));
        }
        if inner.tokens.len() >= limits::TOKENS as usize {
            return Err(TokenError::TooMany(limits::TOKENS));
        }
        inner.tokens.push(token.clone());
        inner.tokens.sort_by(|a, b| (a.create_ms, &a.id).cmp(&(b.create_ms, &b.id)));
        inner.revision += 1;
        Ok(())
    }

    async fn list(&self) -> Result<Vec<TokenRecord>, TokenError> {
        Ok(self.lock()?.tokens.clone())
    }

    async fn revoke(&self, id: &str, now_ms: i64) -> Result<(), TokenError> {
        let mut inner = self.lock()?;
        let token = inner.tokens.iter_mut().find(|token| token.id == id);
        let token = token.ok_or_else(|| TokenError::NotFound(id.to_owned()))?;
        token.revoke_ms.get_or_insert(now_ms);
        inner.revision += 1;
        Ok(())
    }

    async fn forget(&self, id: &str) -> Result<(), TokenError> {
        let mut inner = self.lock()?;
        let before = inner.tokens.len();
        inner.tokens.retain(|token| token.id != id);
        if inner.tokens.len() == before {
            return Err(TokenError::NotFound(id.to_owned()));
        }
        inner.used.retain(|(token, _), _| token != id);
        inner.revision += 1;
        Ok(())
    }

    async fn revision(&self) -> Result<i64, TokenError> {
        Ok(self.lock()?.revision)
    }

    async fn usage(&self, id: &str, day: i64) -> Result<(Usage, Usage), TokenError> {
        let inner = self.lock()?;
        let mut all = Usage::default();
        for ((token, _), used) in &inner.used {
            if token == id {
                all.add(*used);
            }
        }
        let today = inner.used.get(&(id.to_owned(), day)).copied().unwrap_or_default();
        Ok((all, today))
    }

    async fn add_usage(&self, day: i64, used: &[(String, Usage)]) -> Result<(), TokenError> {
        let mut inner = self.lock()?;
        for (id, more) in used {
            if inner.tokens.iter().any(|token| token.id == *id) {
                inner.used.entry((id.clone(), day)).or_default().add(*more);
            }
        }
        Ok(())
    }

    async fn close(&self) {
        self.inner.lock().unwrap_or_else(PoisonError::into_inner).closed = true;
    }
}
