//! Enums whose values have words, and such enums with values of other versions of this software.

use std::fmt;

use serde::{Serialize, Serializer};

/// An enum with one word for each value, for filters, tables, command lines, messages and JSON for people.
/// (Stored rows hold the values in snake case, see the types' `Serialize`.)
pub trait Word: Copy + PartialEq + fmt::Debug + 'static {
    /// Every value with its word, in the order of declaration.
    const WORDS: &'static [(Self, &'static str)];
    /// Words of earlier versions, each with the value that has taken its place.
    const RETIRED_WORDS: &'static [(Self, &'static str)];

    /// The word for a value.
    fn word(self) -> &'static str {
        let found = Self::WORDS.iter().find(|(value, _)| *value == self);
        found.expect("the list is made with the enum").1
    }

    /// The value that a word stands for, if any.
    fn from_word(word: &str) -> Option<Self> {
        let mut all = Self::WORDS.iter().chain(Self::RETIRED_WORDS);
        all.find(|(_, known)| *known == word).map(|(value, _)| *value)
    }
}

/// Declares an enum and its words together, so that neither can be forgotten. Words of earlier versions,
/// whose place a value has taken, stand behind it after bars.
macro_rules! words {
    (
        $(#[$meta:meta])*
        pub enum $name:ident {
            $($(#[$value_meta:meta])* $value:ident = $word:literal $(| $retired:literal)*,)+
        }
    ) => {
        $(#[$meta])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
        #[serde(rename_all = "snake_case")]
        pub enum $name {
            $($(#[$value_meta])* $(#[serde(alias = $retired)])* $value,)+
        }

        impl $crate::words::Word for $name {
            const WORDS: &'static [(Self, &'static str)] = &[$((Self::$value, $word),)+];
            const RETIRED_WORDS: &'static [(Self, &'static str)] = &[$($((Self::$value, $retired),)*)+];
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.pad($crate::words::Word::word(*self))
            }
        }
    };
}

pub(crate) use words;

/// A value from any version of this software (an "open enum" in the words of Protocol Buffers). An unknown
/// value is carried along unchanged and shown as such.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum OpenEnum<T> {
    /// A value of this version.
    Known(T),
    /// The number that it has on the wire; 0 for an alternative of a `oneof`, whose number is not known.
    Unrecognised(i32),
}

impl<T> OpenEnum<T> {
    /// The value, where it is known.
    pub fn known(self) -> Option<T> {
        match self {
            OpenEnum::Known(value) => Some(value),
            OpenEnum::Unrecognised(_) => None,
        }
    }

    /// The known value, by reference.
    pub fn as_known(&self) -> Option<&T> {
        match self {
            OpenEnum::Known(value) => Some(value),
            OpenEnum::Unrecognised(_) => None,
        }
    }
}

impl<T> From<T> for OpenEnum<T> {
    fn from(value: T) -> Self {
        OpenEnum::Known(value)
    }
}

impl<T: PartialEq> PartialEq<T> for OpenEnum<T> {
    fn eq(&self, other: &T) -> bool {
        self.as_known() == Some(other)
    }
}

impl<T: fmt::Display> fmt::Display for OpenEnum<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            OpenEnum::Known(value) => value.fmt(f),
            OpenEnum::Unrecognised(0) => f.pad("unrecognised"),
            OpenEnum::Unrecognised(number) => f.pad(&format!("unrecognised ({number})")),
        }
    }
}

/// The form for people: the word.
impl<T: Word + fmt::Display> Serialize for OpenEnum<T> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        serializer.collect_str(self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::{Method as _, PredictorMethod, SearchMethod};
    use crate::trial::{Mode, TrialState};

    fn are_distinct<T: Word>() {
        for (value, word) in T::WORDS {
            assert_eq!(T::from_word(word), Some(*value));
            assert_eq!(value.word(), *word);
        }
        assert_eq!(T::from_word("no such word"), None);
    }

    #[test]
    fn words_are_read_as_they_are_written() {
        are_distinct::<Mode>();
        are_distinct::<TrialState>();
        are_distinct::<SearchMethod>();
        are_distinct::<PredictorMethod>();
    }

    #[test]
    fn methods_are_stored_under_the_word_they_are_called_by() {
        for (method, word) in PredictorMethod::WORDS {
            assert_eq!(serde_json::to_string(method).expect("plain data"), format!("{word:?}"));
        }
        for (method, word) in SearchMethod::WORDS {
            assert_eq!(serde_json::to_string(method).expect("plain data"), format!("{word:?}"));
        }
    }

    #[test]
    fn retired_predictors_are_read_as_auto() {
        for (number, word) in PredictorMethod::RETIRED {
            assert_eq!(PredictorMethod::from_word(word), Some(PredictorMethod::Auto));
            let stored = serde_json::from_str::<PredictorMethod>(&format!("{word:?}"));
            assert_eq!(stored.expect("an earlier version stored it"), PredictorMethod::Auto);
            assert!(PredictorMethod::REGISTERED.iter().all(|row| row.number != *number), "{word}");
        }
        assert_eq!((PredictorMethod::RETIRED.len(), SearchMethod::RETIRED.len()), (3, 0));
    }

    #[test]
    fn what_is_not_known_is_shown_as_such() {
        let known = OpenEnum::from(Mode::Explore);
        assert_eq!(known, Mode::Explore);
        assert_eq!(known.to_string(), "EXPLORE");
        let newer = OpenEnum::<Mode>::Unrecognised(8);
        assert_ne!(newer, Mode::Explore);
        assert_eq!(newer.known(), None);
        assert_eq!(serde_json::to_string(&newer).expect("plain data"), "\"unrecognised (8)\"");
        assert_eq!(OpenEnum::<Mode>::Unrecognised(0).to_string(), "unrecognised");
    }
}
