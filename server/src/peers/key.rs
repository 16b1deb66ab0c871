//! The key by which replicas recognise each other.
//!
//! A forwarded request carries the client's token, and is authorised by it as if it came from the client. The
//! key only shows that the request was counted already and must not be forwarded again. Every replica finds
//! the key in the database. A client cannot know it, and the middleware removes a false one.

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use http::{HeaderMap, HeaderValue, Request};
use subtle::ConstantTimeEq as _;

use crate::access::token::TOKEN_MARK;

/// Marks a request that another replica forwarded.
pub const FORWARDED: &str = "treewright-forwarded";

/// In the extensions of a request: it was counted against its quotas, here or at the forwarding replica.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Counted;

/// The replicas' key.
#[derive(Clone)]
pub struct ReplicaKey(HeaderValue);

impl ReplicaKey {
    /// The key of these bytes.
    pub fn new(bytes: &[u8; 32]) -> Self {
        // With the mark of a token, so that the log hides it as well.
        let text = format!("{TOKEN_MARK}replicas_{}", URL_SAFE_NO_PAD.encode(bytes));
        let mut value = HeaderValue::from_str(&text).unwrap_or(HeaderValue::from_static(""));
        assert!(!value.is_empty(), "the replicas' key cannot be sent");
        value.set_sensitive(true);
        Self(value)
    }

    pub(crate) fn show(&self, headers: &mut HeaderMap) {
        headers.insert(FORWARDED, self.0.clone());
    }

    fn fits(&self, given: &HeaderValue) -> bool {
        !self.0.is_empty() && bool::from(self.0.as_bytes().ct_eq(given.as_bytes()))
    }
}

/// Removes the mark from a request that does not come from a replica, and notes that one from a replica was
/// counted.
pub(crate) fn check<B>(key: Option<&ReplicaKey>, request: &mut Request<B>) {
    let mut values = request.headers().get_all(FORWARDED).iter();
    let Some(given) = values.next() else {
        return;
    };
    if values.next().is_none() && key.is_some_and(|key| key.fits(given)) {
        request.extensions_mut().insert(Counted);
    } else {
        request.headers_mut().remove(FORWARDED);
    }
    let has_mark = request.headers().contains_key(FORWARDED);
    let is_counted = request.extensions().get::<Counted>().is_some();
    assert_eq!(has_mark, is_counted, "it keeps the mark and is not from a replica, or the other way");
}

impl std::fmt::Debug for ReplicaKey {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("ReplicaKey(…)")
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether a request with these marks counts as passed on; and whether a mark is left.
    fn checked(key: Option<&ReplicaKey>, marks: &[&HeaderValue]) -> (bool, bool) {
        let mut request = Request::new(());
        for mark in marks {
            request.headers_mut().append(FORWARDED, (*mark).clone());
        }
        check(key, &mut request);
        (request.extensions().get::<Counted>().is_some(), request.headers().contains_key(FORWARDED))
    }

    #[test]
    fn only_replicas_can_say_that_they_are() {
        let (ours, other) = (ReplicaKey::new(&[7; 32]), ReplicaKey::new(&[8; 32]));
        assert_eq!(checked(Some(&ours), &[]), (false, false));
        assert_eq!(checked(Some(&ours), &[&ours.0]), (true, true));
        for lie in ["", "1", "true", "tw1_replicas_"] {
            assert_eq!(checked(Some(&ours), &[&HeaderValue::from_static(lie)]), (false, false), "{lie}");
        }
        assert_eq!(checked(Some(&ours), &[&other.0]), (false, false));
        assert_eq!(checked(Some(&ours), &[&ours.0, &other.0]), (false, false), "one of them is a lie");
        assert_eq!(checked(None, &[&ours.0]), (false, false), "a daemon that is alone has no replicas");
    }

    #[test]
    fn the_key_is_not_shown() {
        let key = ReplicaKey::new(&[7; 32]);
        let mut headers = HeaderMap::new();
        key.show(&mut headers);
        assert!(!format!("{key:?} {headers:?}").contains("BwcH"));
    }
}
