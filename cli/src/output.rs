//! The output of a command: JSON, or words for people.

use serde::Serialize;

use crate::failure::Result;

/// JSON where it is wished, else the words for people.
pub(crate) fn either(json: bool, record: &impl Serialize, words: impl FnOnce() -> String) -> Result<String> {
    let mut text = if json { serde_json::to_string_pretty(record)? } else { words() };
    if !text.ends_with('\n') {
        text.push('\n');
    }
    Ok(text)
}
