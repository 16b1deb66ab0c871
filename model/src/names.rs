//! The spelling of names of parameters, indicators and metrics, in one place.

use crate::limits::NAME_CHARACTERS_MAX;

/// Whether the name of an indicator or a metric is 1 to 64 characters of `a-z`, `0-9` and `_`, beginning with
/// a letter.
pub fn is_name(name: &str) -> bool {
    name.len() <= NAME_CHARACTERS_MAX
        && name.starts_with(|first: char| first.is_ascii_lowercase())
        && name.chars().all(|c| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_')
}

/// The rule of [`is_name`] in words, for messages.
pub const NAME_RULE: &str = "1 to 64 characters of a-z, 0-9 and _, beginning with a letter";

/// Whether the name of a parameter is 1 to 64 letters and digits of any script, `_`, `-` and `.`, beginning
/// with a letter or `_`.
///
/// Blanks, quotes, brackets and signs would have to be escaped in filters, constraints, commands, tables and
/// pages.
pub fn is_parameter_name(name: &str) -> bool {
    name.chars().count() <= NAME_CHARACTERS_MAX
        && name.starts_with(|first: char| first.is_alphabetic() || first == '_')
        && name.chars().all(|c| c.is_alphanumeric() || matches!(c, '_' | '-' | '.'))
}

/// The rule of [`is_parameter_name`] in words, for messages.
pub const PARAMETER_NAME_RULE: &str =
    "1 to 64 letters, digits, _, - and ., beginning with a letter or _, without blanks and quotes";

#[cfg(test)]
mod tests {
    use super::{is_name, is_parameter_name};

    #[test]
    fn only_plain_names_pass() {
        for good in ["a", "min_leaf_size", "x9", &"n".repeat(64)] {
            assert!(is_name(good) && is_parameter_name(good), "{good}");
        }
        for bad in ["", "9x", "_x", "Ab", "a-b", "ä", "a b", &"n".repeat(65)] {
            assert!(!is_name(bad), "{bad}");
        }
    }

    #[test]
    fn parameters_are_named_as_programs_name_them() {
        for good in ["blockSize", "learning-rate", "größe", "_x", "BLOCK.x", "μ", "層数", &"ä".repeat(64)]
        {
            assert!(is_parameter_name(good), "{good}");
        }
        let long = "ä".repeat(65);
        for bad in
            ["", "9x", "-x", " x", "x ", "a b", "a\"b", "a'b", "a`b", "a=b", "a;b", "a,b", "a\nb", &long]
        {
            assert!(!is_parameter_name(bad), "{bad}");
        }
    }
}
