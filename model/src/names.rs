//! How names of parameters, indicators and metrics are spelt, in one place.

use crate::limits::NAME_CHARACTERS_MAX;

/// Whether `name` is 1 to 64 characters of `a-z`, `0-9` and `_`, beginning with a letter.
pub fn is_name(name: &str) -> bool {
    name.len() <= NAME_CHARACTERS_MAX
        && name.starts_with(|first: char| first.is_ascii_lowercase())
        && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
}

/// The rule of [`is_name`] in words, for messages.
pub const NAME_RULE: &str = "1 to 64 characters of a-z, 0-9 and _, beginning with a letter";

#[cfg(test)]
mod tests {
    use super::is_name;

    #[test]
    fn only_plain_names_pass() {
        for good in ["a", "min_leaf_size", "x9", &"n".repeat(64)] {
            assert!(is_name(good), "{good}");
        }
        for bad in ["", "9x", "_x", "Ab", "a-b", "ä", "a b", &"n".repeat(65)] {
            assert!(!is_name(bad), "{bad}");
        }
    }
}
