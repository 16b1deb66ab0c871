//! Page tokens: the end of a page, behind which the next one goes on.
//!
//! A token holds the last row's key rather than a count of rows, so that trials reported between two pages
//! neither repeat rows nor skip any that keep their place. A digest of the question binds it to its filter
//! and order, and a check sum shows a mangled token.

use std::fmt::Write as _;

use treewright_core::fnv;

use crate::limits;

/// A page token that this server did not issue, or issued for another question.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "page_token does not belong to this request; repeat the request that gave it, with the same filter and order, or begin again without a token"
)]
pub struct PageTokenError;

/// The last row of a page of trials.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Cursor {
    /// The value the trials are ordered by; none when the row had none.
    pub value: Option<f64>,
    /// The row's number.
    pub number: i64,
}

impl Cursor {
    /// The token for this place in the answer to `question`.
    pub fn token(&self, question: &[&str]) -> String {
        let value = self.value.map_or("-".to_owned(), |value| format!("{:016x}", value.to_bits()));
        let token = seal(&format!("{value} {}", self.number), question);
        assert!(token.len() <= limits::TOKEN_CHARACTERS, "{} characters are too many to read", token.len());
        debug_assert!(
            self.value.is_some_and(|value| !value.is_finite())
                || Self::parse(&token, question) == Ok(Some(*self)),
            "{token} does not stand for {self:?}"
        );
        token
    }

    /// Reads a token; an empty one names no place.
    ///
    /// # Errors
    /// [`PageTokenError`] when the token was not made by [`token`](Self::token) for this question.
    pub fn parse(token: &str, question: &[&str]) -> Result<Option<Self>, PageTokenError> {
        if token.is_empty() {
            return Ok(None);
        }
        let text = open(token, question)?;
        let (value, number) = text.split_once(' ').ok_or(PageTokenError)?;
        let value = match value {
            "-" => None,
            bits => Some(f64::from_bits(u64::from_str_radix(bits, 16).map_err(|_| PageTokenError)?)),
        };
        if value.is_some_and(|value| !value.is_finite()) {
            return Err(PageTokenError);
        }
        Ok(Some(Self { value, number: number.parse().map_err(|_| PageTokenError)? }))
    }
}

/// Hexadecimal digits of the check sum before the text.
const DIGEST_DIGITS: usize = 16;

/// Makes a token of `text` that only [`open`] with an equal question reads.
pub fn seal(text: &str, question: &[&str]) -> String {
    let mut token = format!("{:016x}", digest(text, question));
    for byte in text.bytes() {
        // Writing to a string cannot fail.
        let _ = write!(token, "{byte:02x}");
    }
    assert_eq!(token.len(), DIGEST_DIGITS + 2 * text.len());
    debug_assert!(
        token.len() > limits::TOKEN_CHARACTERS || open(&token, question).as_deref() == Ok(text),
        "{token} does not stand for {text:?}"
    );
    token
}

/// Reads a token that [`seal`] made.
///
/// # Errors
/// [`PageTokenError`] when the token was not made for this question.
pub fn open(token: &str, question: &[&str]) -> Result<String, PageTokenError> {
    if token.len() > limits::TOKEN_CHARACTERS || !token.is_ascii() || !token.len().is_multiple_of(2) {
        return Err(PageTokenError);
    }
    let (digits, body) = token.split_at_checked(DIGEST_DIGITS).ok_or(PageTokenError)?;
    let bytes = (0..body.len() / 2)
        .map(|i| u8::from_str_radix(&body[2 * i..2 * i + 2], 16))
        .collect::<Result<Vec<u8>, _>>()
        .map_err(|_| PageTokenError)?;
    let text = String::from_utf8(bytes).map_err(|_| PageTokenError)?;
    assert_eq!(token.len(), DIGEST_DIGITS + 2 * text.len());
    match u64::from_str_radix(digits, 16) {
        Ok(found) if found == digest(&text, question) => Ok(text),
        _ => Err(PageTokenError),
    }
}

/// A check sum over the text and the question's parts. It guards against mistakes, not against malice: a
/// forged token only asks for a page that its sender may read anyway.
fn digest(text: &str, question: &[&str]) -> u64 {
    fnv::hash(std::iter::once(&text).chain(question).flat_map(|part| part.bytes().chain([0xff])))
}

#[cfg(test)]
mod tests {
    use super::*;

    const QUESTION: [&str; 3] = ["sponza", "cost < 3", "cost"];

    #[test]
    fn tokens_come_back() {
        for value in [None, Some(0.1), Some(-1e300), Some(0.0)] {
            let cursor = Cursor { value, number: 17 };
            let token = cursor.token(&QUESTION);
            assert_eq!(Cursor::parse(&token, &QUESTION), Ok(Some(cursor)));
        }
        assert_eq!(Cursor::parse("", &QUESTION), Ok(None));
    }

    #[test]
    fn tokens_of_other_questions_and_mangled_ones_are_refused() {
        let cursor = Cursor { value: Some(0.5), number: 3 };
        let token = cursor.token(&QUESTION);
        for other in
            [["sponza", "cost < 4", "cost"], ["hall", "cost < 3", "cost"], ["sponza", "cost < 3cost", ""]]
        {
            assert_eq!(Cursor::parse(&token, &other), Err(PageTokenError));
        }
        for at in 0..token.len() {
            let mut mangled = token.clone().into_bytes();
            mangled[at] = if mangled[at] == b'1' { b'2' } else { b'1' };
            let mangled = String::from_utf8(mangled).unwrap();
            assert_eq!(Cursor::parse(&mangled, &QUESTION), Err(PageTokenError));
        }
        for nonsense in ["x", "zz", "0123456789abcdef", "é0", &"0".repeat(1000)] {
            assert_eq!(Cursor::parse(nonsense, &QUESTION), Err(PageTokenError));
        }
    }
}
