//! Numbers that name something within a study, each a type of its own, so that one is not taken for another.
//!
//! They are written as the bare number, in rows, on the wire and in messages.

use std::fmt;

use serde::{Deserialize, Serialize};

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

                /// The one after it.
                ///
                /// # Panics
                /// After 2^64 - 1, which nothing that counts up from 1 reaches.
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
    /// A trial of a study: rises by one from 1.
    TrialNumber;
    /// A machine of a study, told by its fingerprint: rises by one from 0, in the order in which they founded states.
    MachineId;
}

#[cfg(test)]
mod tests {
    use super::{StateId, TrialNumber};

    #[test]
    fn ids_are_written_as_bare_numbers() {
        assert_eq!(serde_json::to_string(&TrialNumber(17)).expect("plain data"), "17");
        assert_eq!(serde_json::from_str::<StateId>("3").expect("a number"), StateId(3));
        assert_eq!(format!("{:>4}", StateId(3).next()), "   4");
    }
}
