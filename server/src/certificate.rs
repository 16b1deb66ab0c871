//! When a certificate ends, read from its DER form (RFC 5280, section 4.1; ITU-T X.690): the one thing that
//! is asked of it here and that the TLS library does not say.

/// Tags of what is read.
const SEQUENCE: u8 = 0x30;
const VERSION: u8 = 0xa0;
const UTC_TIME: u8 = 0x17;
const GENERALIZED_TIME: u8 = 0x18;

/// The end of a certificate's validity, in seconds since 1970; none where it is no certificate.
pub(crate) fn expiry_s(der: &[u8]) -> Option<i64> {
    let certificate = Element::of(&mut &*der, SEQUENCE)?;
    let signed = Element::of(&mut &*certificate, SEQUENCE)?;
    let rest = &mut &*signed;
    if rest.first() == Some(&VERSION) {
        Element::next(rest)?;
    }
    // Serial number, algorithm, issuer.
    for _ in 0..3 {
        Element::next(rest)?;
    }
    let validity = &mut Element::of(rest, SEQUENCE)?;
    Element::next(validity)?;
    let end = Element::next(validity)?;
    let text = std::str::from_utf8(end.content).ok()?.strip_suffix('Z')?;
    match end.tag {
        // Two digits of the year: from 1950 to 2049.
        UTC_TIME => {
            let year: i64 = text.get(..2)?.parse().ok()?;
            seconds(if year < 50 { 2000 + year } else { 1900 + year }, text.get(2..)?)
        }
        GENERALIZED_TIME => seconds(text.get(..4)?.parse().ok()?, text.get(4..)?),
        _ => None,
    }
}

/// One element: its tag and what it holds.
struct Element<'a> {
    tag: u8,
    content: &'a [u8],
}

impl<'a> Element<'a> {
    /// Takes the next element.
    fn next(bytes: &mut &'a [u8]) -> Option<Self> {
        let (tag, rest) = bytes.split_first()?;
        let (first, mut rest) = rest.split_first()?;
        let mut length = usize::from(*first);
        if length >= 0x80 {
            let (long, behind) = rest.split_at_checked(length - 0x80).filter(|(long, _)| long.len() <= 4)?;
            length = long.iter().fold(0, |length, byte| length << 8 | usize::from(*byte));
            rest = behind;
        }
        let (content, behind) = rest.split_at_checked(length)?;
        *bytes = behind;
        Some(Self { tag: *tag, content })
    }

    /// What the next element holds, which has this tag.
    fn of(bytes: &mut &'a [u8], tag: u8) -> Option<&'a [u8]> {
        Self::next(bytes).filter(|element| element.tag == tag).map(|element| element.content)
    }
}

/// Seconds since 1970 of a year and `MMDDHHMMSS`.
fn seconds(year: i64, rest: &str) -> Option<i64> {
    let pair = |place: usize| rest.get(2 * place..2 * place + 2)?.parse::<i64>().ok();
    let (month, day) = (pair(0)?, pair(1)?);
    if rest.len() != 10 || !(1..=12).contains(&month) {
        return None;
    }
    // Days of the civil calendar (H. Hinnant, "chrono-Compatible Low-Level Date Algorithms"): years begin in
    // March.
    let (year, month) = if month > 2 { (year, month - 3) } else { (year - 1, month + 9) };
    let days = 365 * year + year / 4 - year / 100 + year / 400 + (153 * month + 2) / 5 + day - 1 - 719_468;
    Some(((days * 24 + pair(2)?) * 60 + pair(3)?) * 60 + pair(4)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_end_is_read_in_either_form() {
        for (year, month, day, seconds) in [
            (2030, 1, 1, 1_893_456_000),
            (2000, 2, 29, 951_782_400),
            (2051, 12, 31, 2_587_593_600),
            (1999, 3, 1, 920_246_400),
        ] {
            let mut parameters =
                rcgen::CertificateParams::new(vec!["one.example".to_owned()]).expect("a name");
            parameters.not_before = rcgen::date_time_ymd(1990, 1, 1);
            parameters.not_after = rcgen::date_time_ymd(year, month, day);
            let key = rcgen::KeyPair::generate().expect("a key");
            let made = parameters.self_signed(&key).expect("a certificate");
            assert_eq!(expiry_s(made.der()), Some(seconds), "{year}-{month}-{day}");
            for end in 0..made.der().len() {
                // Cut anywhere, it is none, or has its end before the cut.
                assert!(expiry_s(&made.der()[..end]).is_none(), "{end}");
            }
        }
        for nothing in [&b""[..], b"0", b"0\x84\xff\xff\xff\xff", b"\x30\x03\x30\x01\x00"] {
            assert_eq!(expiry_s(nothing), None);
        }
    }
}
