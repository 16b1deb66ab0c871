//! The end of a certificate's validity, which the TLS library does not give.

/// The end of a certificate's validity, in seconds since 1970; none where it is no certificate.
pub(crate) fn expiry_s(der: &[u8]) -> Option<i64> {
    let (_, certificate) = x509_parser::parse_x509_certificate(der).ok()?;
    Some(certificate.validity().not_after.timestamp())
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
