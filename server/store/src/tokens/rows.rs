//! Tokens as rows: the words and JSON texts of the tables, the same for every database.

use super::{Quota, Scope, Studies, TokenError, Usage};
use crate::error::StoreError;

impl Scope {
    /// The word in the tables.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Read => "READ",
            Self::Tune => "TUNE",
            Self::Admin => "ADMIN",
        }
    }

    /// Reads the word.
    pub(crate) fn of_word(word: &str) -> Result<Self, TokenError> {
        [Self::Read, Self::Tune, Self::Admin]
            .into_iter()
            .find(|scope| scope.word() == word)
            .ok_or_else(|| inconsistent(format!("{word:?} is no scope")))
    }
}

impl Usage {
    /// Adds up.
    pub fn add(&mut self, more: Usage) {
        self.studies = self.studies.saturating_add(more.studies);
        self.trials = self.trials.saturating_add(more.trials);
        self.bytes = self.bytes.saturating_add(more.bytes);
    }
}

/// Studies and quota as JSON texts.
pub(crate) fn texts(studies: &Studies, quota: &Quota) -> Result<(String, String), TokenError> {
    let json = |error: serde_json::Error| inconsistent(error.to_string());
    Ok((serde_json::to_string(studies).map_err(json)?, serde_json::to_string(quota).map_err(json)?))
}

/// Reads the JSON texts. What cannot be read lets nobody in.
pub(crate) fn of_texts(studies: &str, quota: &str) -> Result<(Studies, Quota), TokenError> {
    let json = |error: serde_json::Error| inconsistent(format!("a token cannot be read: {error}"));
    Ok((serde_json::from_str(studies).map_err(json)?, serde_json::from_str(quota).map_err(json)?))
}

/// A hash of the right length.
pub(crate) fn hash(bytes: &[u8]) -> Result<[u8; 32], TokenError> {
    bytes.try_into().map_err(|_| inconsistent("a token's hash has not 32 bytes".to_owned()))
}

fn inconsistent(problem: String) -> TokenError {
    TokenError::Store(StoreError::Inconsistent { problem })
}
