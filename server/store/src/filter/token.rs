//! Cuts a filter into words, operators, numbers and quoted text, each with its place.

use super::{FilterError, Operator};

#[derive(Clone, Debug, PartialEq)]
pub(super) enum FilterToken {
    /// A field, an enum's value, `AND`, `true` or `false`.
    Word(String),
    Operator(Operator),
    /// A number as it was written. The field decides whether it must be whole.
    Number(String),
    /// Text between double quotes, unescaped.
    Text(String),
}

impl FilterToken {
    /// The token as an error message shows it.
    pub(super) fn shown(&self) -> String {
        match self {
            Self::Word(word) => format!("`{word}`"),
            Self::Operator(operator) => format!("`{}`", operator.symbol()),
            Self::Number(number) => format!("`{number}`"),
            Self::Text(_) => "quoted text".to_owned(),
        }
    }
}

/// A token and where it begins, in characters from 1.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PlacedToken {
    pub(super) position: usize,
    pub(super) token: FilterToken,
}

pub(super) fn tokens(text: &str) -> Result<Vec<PlacedToken>, FilterError> {
    let characters: Vec<char> = text.chars().collect();
    let mut found = Vec::new();
    let mut at = 0;
    while at < characters.len() {
        let first = characters[at];
        if first.is_ascii_whitespace() {
            at += 1;
            continue;
        }
        let (token, length) = match first {
            '_' => word(&characters[at..]),
            letter if letter.is_alphabetic() => word(&characters[at..]),
            '0'..='9' | '-' | '.' => number(&characters[at..]),
            '"' => quoted(&characters[at..], at + 1)?,
            _ => operator(&characters[at..])
                .ok_or_else(|| FilterError::new(at + 1, format!("`{first}` has no meaning here")))?,
        };
        assert!(length > 0 && at + length <= characters.len(), "{length} characters at {at} are {token:?}");
        found.push(PlacedToken { position: at + 1, token });
        at += length;
    }
    Ok(found)
}

fn word(rest: &[char]) -> (FilterToken, usize) {
    // Parameters may be called `learning-rate`.
    let length = run(rest, |c| c.is_alphanumeric() || matches!(c, '_' | '.' | '-'));
    (FilterToken::Word(rest[..length].iter().collect()), length)
}

/// Takes everything that can belong to a number; the parser decides whether it is one. A sign inside
/// belongs to it only after an exponent's `e`.
fn number(rest: &[char]) -> (FilterToken, usize) {
    let mut length = 1;
    while length < rest.len() {
        let previous = rest[length - 1];
        let belongs = match rest[length] {
            '0'..='9' | '.' | 'a'..='z' | 'A'..='Z' | '_' => true,
            '+' | '-' => matches!(previous, 'e' | 'E'),
            _ => false,
        };
        if !belongs {
            break;
        }
        length += 1;
    }
    (FilterToken::Number(rest[..length].iter().collect()), length)
}

/// Text in double quotes, in which a backslash makes the next quote or backslash literal.
fn quoted(rest: &[char], position: usize) -> Result<(FilterToken, usize), FilterError> {
    let mut text = String::new();
    let mut at = 1;
    while let Some(&c) = rest.get(at) {
        match c {
            '"' => return Ok((FilterToken::Text(text), at + 1)),
            '\\' => match rest.get(at + 1) {
                Some(&escaped @ ('"' | '\\')) => {
                    text.push(escaped);
                    at += 2;
                }
                _ => {
                    return Err(FilterError::new(
                        position + at,
                        r#"a backslash stands only before `"` or another backslash"#,
                    ));
                }
            },
            '\0' => {
                return Err(FilterError::new(position + at, "text cannot hold the character NUL"));
            }
            _ => {
                text.push(c);
                at += 1;
            }
        }
    }
    Err(FilterError::new(position, r#"this text is not closed with `"`"#))
}

fn operator(rest: &[char]) -> Option<(FilterToken, usize)> {
    let second_is_equal = rest.get(1) == Some(&'=');
    let (operator, length) = match (rest[0], second_is_equal) {
        ('=', _) => (Operator::Equal, 1),
        ('!', true) => (Operator::NotEqual, 2),
        ('<', true) => (Operator::LessOrEqual, 2),
        ('<', false) => (Operator::Less, 1),
        ('>', true) => (Operator::GreaterOrEqual, 2),
        ('>', false) => (Operator::Greater, 1),
        _ => return None,
    };
    Some((FilterToken::Operator(operator), length))
}

fn run(rest: &[char], belongs: impl Fn(char) -> bool) -> usize {
    rest.iter().take_while(|&&c| belongs(c)).count()
}
