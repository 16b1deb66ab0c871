//! Numbers that name a study or a part of it, each with its own type, so that they cannot be confused.
//!
//! Those within a study are written as the bare number, in rows, on the wire and in messages.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use thiserror::Error;

/// The identity of a study, drawn when it was created: no other study has it, not even an earlier one of its
/// name. Written as 16 hexadecimal digits.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct StudyUid(pub u64);

/// A text is no identity of a study.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("a study's identity is 16 hexadecimal digits in lower case")]
pub struct StudyUidError;

impl fmt::Display for StudyUid {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:016x}", self.0)
    }
}

impl FromStr for StudyUid {
    type Err = StudyUidError;

    fn from_str(text: &str) -> Result<Self, StudyUidError> {
        let is_spelt = text.len() == 16 && text.bytes().all(|b| matches!(b, b'0'..=b'9' | b'a'..=b'f'));
        let number = is_spelt.then(|| u64::from_str_radix(text, 16).ok()).flatten();
        number.map(Self).ok_or(StudyUidError)
    }
}

macro_rules! ids {
    ($($(#[$doc:meta])* $name:ident;)+) => {
        $(
            $(#[$doc])*
            #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
            #[serde(transparent)]
            pub struct $name(pub u64);

            impl $name {
                /// The bare number.
                pub const fn get(self) -> u64 {
                    self.0
                }

                /// The next number.
                ///
                /// # Panics
                /// After 2^64 - 1, which no count from 1 reaches.
                #[must_use]
                pub const fn next(self) -> Self {
                    Self(self.0 + 1)
                }
            }

            impl From<u64> for $name {
                fn from(number: u64) -> Self {
                    Self(number)
                }
            }

            impl From<$name> for u64 {
                fn from(id: $name) -> u64 {
                    id.0
                }
            }

            impl fmt::Display for $name {
                fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                    self.0.fmt(f)
                }
            }
        )+
    };
}

ids! {
    /// A state of a study: rises by one from 1, equal for equal states of one machine.
    StateId;
    /// A trial of a study: rises by one, from 1 where no study had the name before.
    TrialNumber;
    /// A machine of a study, by its fingerprint: rises by one from 0, in the order in which they founded
    /// states.
    MachineId;
}

#[cfg(test)]
mod tests {
    use super::{StateId, StudyUid, TrialNumber};

    #[test]
    fn ids_are_written_as_bare_numbers() {
        assert_eq!(serde_json::to_string(&TrialNumber(17)).expect("plain data"), "17");
        assert_eq!(serde_json::from_str::<StateId>("3").expect("a number"), StateId(3));
        assert_eq!(format!("{:>4}", StateId(3).next()), "   4");
    }

    #[test]
    fn identities_are_read_as_they_are_written() {
        for uid in [StudyUid(0), StudyUid(0xabc), StudyUid(u64::MAX)] {
            assert_eq!(uid.to_string().parse(), Ok(uid));
        }
        for other in ["", "abc", "000000000000ABCD", "+00000000000abcd", "0000000000000abcd"] {
            assert!(other.parse::<StudyUid>().is_err(), "{other}");
        }
    }
}
