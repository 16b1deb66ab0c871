//! PLY files as their parser wants them: a header of plain lines, and in text one element a line.

use std::borrow::Cow;

use ply_rs_bw::ply::{ElementDef, Header, PropertyType};

use super::text;

const END: &[u8] = b"end_header";

/// The file with a header of plain lines, changed only where it has to be; and where its body begins.
pub(super) fn with_plain_header(bytes: &[u8]) -> (Cow<'_, [u8]>, usize) {
    let unmarked = text::without_mark(bytes);
    let is_line_end = |byte: &u8| matches!(byte, b'\n' | b'\r');
    let ends = unmarked.windows(END.len()).enumerate().filter(|(_, window)| *window == END);
    let starts_line = |place: usize| place > 0 && is_line_end(&unmarked[place - 1]);
    let Some((place, _)) = ends.into_iter().find(|(place, _)| starts_line(*place)) else {
        return (Cow::Borrowed(unmarked), unmarked.len());
    };
    let end_line = if unmarked[..place].contains(&b'\n') { b'\n' } else { b'\r' };
    let rest = &unmarked[place..];
    let body = place + rest.iter().position(|byte| *byte == end_line).map_or(rest.len(), |end| end + 1);
    let header = text::decoded(&unmarked[..body]);
    let mut lines = header.lines().map(str::trim).filter(|line| !line.is_empty());
    // Some programs write the first word in capitals, and other readers take it.
    let first = lines.next().map(|line| if line.eq_ignore_ascii_case("ply") { "ply" } else { line });
    let plain: String = first.into_iter().chain(lines).flat_map(|line| [line, "\n"]).collect();
    if plain.as_bytes() == &unmarked[..body] {
        (Cow::Borrowed(unmarked), body)
    } else {
        (Cow::Owned([plain.as_bytes(), &unmarked[body..]].concat()), plain.len())
    }
}

/// The body of a text file with one element a line, where it has another number of lines.
pub(super) fn with_a_line_each<'a>(body: &'a str, header: &Header) -> Cow<'a, str> {
    let count: usize = header.elements.values().map(|element| element.count).fold(0, usize::saturating_add);
    if body.trim_end().split('\n').count() == count {
        return Cow::Borrowed(body);
    }
    let mut words = body.split_whitespace();
    let mut lines = String::with_capacity(body.len());
    for element in header.elements.values() {
        for _ in 0..element.count {
            if push_element(element, &mut words, &mut lines).is_none() {
                return Cow::Owned(lines);
            }
        }
    }
    Cow::Owned(lines)
}

/// Takes the words of one element. `None` if there are too few, or a list's length is no number.
fn push_element<'a>(
    element: &ElementDef,
    words: &mut impl Iterator<Item = &'a str>,
    lines: &mut String,
) -> Option<()> {
    for property in element.properties.values() {
        let mut push = |word: &str| {
            if !lines.is_empty() && !lines.ends_with('\n') {
                lines.push(' ');
            }
            lines.push_str(word);
        };
        let first = words.next()?;
        push(first);
        if let PropertyType::List(..) = property.data_type {
            for _ in 0..first.parse::<usize>().ok()? {
                push(words.next()?);
            }
        }
    }
    lines.push('\n');
    Some(())
}
