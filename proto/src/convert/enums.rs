//! Enums, by number. 0 is an unset value.

use treewright_model::policy::{Method, Operation, PredictorMethod, SearchMethod};
use treewright_model::space::Scale;
use treewright_model::standing::ConfirmationStage;
use treewright_model::trial::{Mode, OmissionReason, Rule, TrialState};
use treewright_model::words::OpenEnum;

use crate::v1;

/// An enum of the model that has a counterpart on the wire.
pub trait WireEnum: Copy {
    /// Its number on the wire, never 0.
    fn number(self) -> i32;

    /// The value that has a number on the wire; `None` for 0.
    fn from_number(number: i32) -> Option<OpenEnum<Self>>;
}

/// The values have equal names on both sides; one that is missing on either does not compile.
macro_rules! wire_enums {
    ($($name:ident { $($value:ident),+ $(,)? })+) => {
        $(
            impl WireEnum for $name {
                fn number(self) -> i32 {
                    match self {
                        $($name::$value => v1::$name::$value.into(),)+
                    }
                }

                fn from_number(number: i32) -> Option<OpenEnum<Self>> {
                    match v1::$name::try_from(number) {
                        Ok(v1::$name::Unspecified) => None,
                        $(Ok(v1::$name::$value) => Some(OpenEnum::Known($name::$value)),)+
                        Err(_) => Some(OpenEnum::Unrecognised(number)),
                    }
                }
            }
        )+
    };
}

wire_enums! {
    Scale { Linear, Log }
    Operation { Tune, Freeze, Shadow }
    Mode { Default, Explore, Exploit, Pinned }
    TrialState { Open, Completed, Abandoned, Expired }
    Rule {
        Explore, NothingKnown, Exploit, Finished, Budget, Gain, RolledBack, Frozen, Shadow, Pinned, Wanted, Waiting,
        Confirming, Incumbent,
    }
    ConfirmationStage { Off, Searching, Racing, Better, NothingBetter }
    OmissionReason { Inactive, BelowNoise, BelowCost, Constant, Redundant }
}

/// Searches and predictors have the numbers of their registry. A test here checks that the contract gives
/// these numbers to these names, and another writes them (`tests/generated.rs`).
macro_rules! registered_enums {
    ($($name:ident)+) => {
        $(
            impl WireEnum for $name {
                fn number(self) -> i32 {
                    let row = Self::REGISTERED.iter().find(|row| row.method == self);
                    row.expect("the enum is made from the registry").number
                }

                fn from_number(number: i32) -> Option<OpenEnum<Self>> {
                    let row = Self::REGISTERED.iter().find(|row| row.number == number);
                    let is_retired = || Self::RETIRED.iter().any(|(retired, _)| *retired == number);
                    let known = row.map(|row| row.method).or_else(|| is_retired().then_some($name::Auto));
                    (number != 0).then_some(known.map_or(OpenEnum::Unrecognised(number), OpenEnum::Known))
                }
            }
        )+
    };
}

registered_enums! { SearchMethod PredictorMethod }

#[cfg(test)]
mod tests {
    use super::*;
    use treewright_model::words::Word;

    /// `SEARCH_METHOD_NELDER_MEAD` on the wire is `nelder_mead` in words.
    fn are_called_the_same<T: WireEnum + Word>(prefix: &str, name: impl Fn(i32) -> Option<&'static str>) {
        for (value, word) in T::WORDS {
            let on_wire = name(value.number()).expect("a number of the wire");
            assert_eq!(on_wire, format!("{prefix}_{}", word.to_uppercase()));
            assert_eq!(T::from_number(value.number()), Some(OpenEnum::Known(*value)));
        }
        assert_eq!(T::from_number(0), None);
        assert_eq!(T::from_number(99), Some(OpenEnum::Unrecognised(99)));
    }

    #[test]
    fn a_retired_predictor_is_auto() {
        for (number, _) in PredictorMethod::RETIRED {
            let read = PredictorMethod::from_number(*number);
            assert_eq!(read, Some(OpenEnum::Known(PredictorMethod::Auto)), "{number}");
        }
    }

    #[test]
    fn words_are_those_of_the_wire() {
        macro_rules! check {
            ($($name:ident $prefix:literal;)+) => {
                $(are_called_the_same::<$name>($prefix, |number| {
                    v1::$name::try_from(number).ok().map(|value| value.as_str_name())
                });)+
            };
        }
        check! {
            SearchMethod "SEARCH_METHOD";
            PredictorMethod "PREDICTOR_METHOD";
            Operation "OPERATION";
            Mode "MODE";
            TrialState "TRIAL_STATE";
            Rule "RULE";
            ConfirmationStage "CONFIRMATION_STAGE";
            OmissionReason "OMISSION_REASON";
        }
    }
}
