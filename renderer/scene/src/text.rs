//! Text as files hold it: with or without a byte order mark, UTF-8 or UTF-16, with every line end.

use std::borrow::Cow;

/// A file's text with line feeds alone and no byte order mark. Invalid bytes are replaced.
pub(super) fn decoded(bytes: &[u8]) -> Cow<'_, str> {
    let text = match bytes {
        [0xff, 0xfe, rest @ ..] => Cow::Owned(utf16(rest, u16::from_le_bytes)),
        [0xfe, 0xff, rest @ ..] => Cow::Owned(utf16(rest, u16::from_be_bytes)),
        _ => String::from_utf8_lossy(without_mark(bytes)),
    };
    if text.contains('\r') { Cow::Owned(text.replace("\r\n", "\n").replace('\r', "\n")) } else { text }
}

/// The bytes behind the byte order mark of UTF-8.
pub(super) fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

/// A sentence with a count in place of `{}`; none where nothing is counted.
pub(super) fn counted(count: usize, sentence: &str) -> Option<String> {
    (count > 0).then(|| sentence.replace("{}", &count.to_string()))
}

fn utf16(bytes: &[u8], unit: fn([u8; 2]) -> u16) -> String {
    let units = bytes.as_chunks().0.iter().map(|pair| unit(*pair));
    char::decode_utf16(units).map(|unit| unit.unwrap_or(char::REPLACEMENT_CHARACTER)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_go_and_line_ends_become_line_feeds() {
        assert_eq!(decoded(b"\xef\xbb\xbfv 1\r\nv 2\rv 3\n"), "v 1\nv 2\nv 3\n");
        assert!(matches!(decoded(b"v 1\n"), Cow::Borrowed("v 1\n")));
        let both = |unit: fn(u16) -> [u8; 2]| "\u{feff}o \u{e9}\r".encode_utf16().flat_map(unit).collect();
        let (little, big): (Vec<u8>, Vec<u8>) = (both(u16::to_le_bytes), both(u16::to_be_bytes));
        assert_eq!((decoded(&little), decoded(&big)), (Cow::from("o \u{e9}\n"), Cow::from("o \u{e9}\n")));
        assert_eq!(decoded(b"\xef\xbb"), "\u{fffd}");
    }
}
