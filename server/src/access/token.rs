//! The text of a token: `tw1_ID_SECRET`.
//!
//! The id is public: it finds the token in the database and names it in logs. The secret is 256 random bits
//! from the system, in URL-safe base64. Only its SHA-256 is kept; `treewright_store::tokens` explains why
//! that suffices.

use std::fmt;

use base64::Engine as _;
use base64::engine::general_purpose::URL_SAFE_NO_PAD;
use sha2::{Digest as _, Sha256};
use subtle::ConstantTimeEq as _;

/// The beginning of every token: a mark by which leaked ones can be searched for, and the version of the
/// form.
pub const TOKEN_MARK: &str = "tw1_";

const ID_DIGITS: usize = 12;

/// Characters of the secret: 32 bytes in base64 without padding.
pub const SECRET_CHARACTERS: usize = 43;

/// A token with its secret, which is only in the output of [`Token::text`].
pub struct Token {
    id: String,
    secret: [u8; 32],
}

impl Token {
    /// Makes a new token from the system's randomness.
    pub fn make() -> Result<Self, getrandom::Error> {
        let (mut id, mut secret) = ([0; ID_DIGITS / 2], [0; 32]);
        getrandom::fill(&mut id)?;
        getrandom::fill(&mut secret)?;
        let id: String = id.iter().map(|byte| format!("{byte:02x}")).collect();
        assert_eq!(id.len(), ID_DIGITS);
        Ok(Self { id, secret })
    }

    /// Reads a token; `None` if the text has another form.
    pub fn parse(text: &str) -> Option<Self> {
        let (id, secret) = text.strip_prefix(TOKEN_MARK)?.split_once('_')?;
        let plain = id.len() == ID_DIGITS && id.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
        if !plain || secret.len() != SECRET_CHARACTERS {
            return None;
        }
        let secret = URL_SAFE_NO_PAD.decode(secret).ok()?.try_into().ok()?;
        Some(Self { id: id.to_owned(), secret })
    }

    /// The public part.
    pub fn id(&self) -> &str {
        &self.id
    }

    /// The whole token, to be shown to its holder once.
    pub fn text(&self) -> String {
        let text = format!("{TOKEN_MARK}{}_{}", self.id, URL_SAFE_NO_PAD.encode(self.secret));
        assert_eq!(text.len(), TOKEN_MARK.len() + ID_DIGITS + 1 + SECRET_CHARACTERS);
        let is_read = |read: Self| read.id == self.id && read.secret == self.secret;
        debug_assert!(Self::parse(&text).is_some_and(is_read), "what is shown is not what was made");
        text
    }

    /// The stored hash of the secret.
    pub fn hash(&self) -> [u8; 32] {
        Sha256::digest(self.secret).into()
    }

    /// Whether this is the token with that hash. The comparison takes constant time.
    pub fn fits(&self, hash: &[u8; 32]) -> bool {
        self.hash().ct_eq(hash).into()
    }
}

impl fmt::Debug for Token {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{TOKEN_MARK}{}_…", self.id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_token_is_read_as_it_was_written() {
        let token = Token::make().unwrap();
        let read = Token::parse(&token.text()).unwrap();
        assert_eq!(read.id(), token.id());
        assert!(read.fits(&token.hash()));
        assert!(!Token::make().unwrap().fits(&token.hash()));
        assert_ne!(Token::make().unwrap().text(), token.text());
    }

    #[test]
    fn what_is_no_token_is_not_read() {
        let good = Token::make().unwrap().text();
        let (short, upper) = (&good[..good.len() - 1], good.to_uppercase());
        let long = format!("{good}A");
        let id = format!("tw1_{}_{}", "0".repeat(ID_DIGITS - 1), "A".repeat(SECRET_CHARACTERS));
        for bad in ["", "tw1_", "tw1__", short, &upper, &long, &id, "Bearer", "tw1_äöü_x"] {
            assert!(Token::parse(bad).is_none(), "{bad}");
        }
    }

    #[test]
    fn debug_output_holds_no_secret() {
        let token = Token::make().unwrap();
        let secret = token.text().split_off(TOKEN_MARK.len() + ID_DIGITS + 1);
        assert_eq!(secret.len(), SECRET_CHARACTERS);
        let shown = format!("{token:?} {token:#?}");
        assert!(shown.contains(token.id()) && !shown.contains(&secret), "{shown}");
    }
}
