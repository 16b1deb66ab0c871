//! The structs that follow from the table, with all operations on their fields.

use serde::{Deserialize, Serialize};

use super::field::{PolicyField, Range, Setting, SettingValue};
use super::methods::{Operation, PredictorMethod, SearchMethod};
use super::{PolicyError, RawPolicy};
use crate::assignment::Assignment;
use crate::configuration::Configuration;
use crate::limits::{
    CONFIRM_ROUNDS_MAX, COST_FACTOR_MAX, EPSILON_HALVES_AFTER_MAX, LEASE_S_MAX, REPLICATES_MAX,
    TRIALS_PER_STATE_MAX, WARM_UP_MAX,
};
use crate::words::OpenEnum;

macro_rules! define_policy {
    ($(
        $(#[doc = $about:literal])+
        $name:ident: $decided:ty | $said:ty = $default:expr, unset $unset:literal,
            in $range:expr, as $placeholder:literal;
    )+) => {
        /// A study's policy. `C` is [`Configuration`] once checked,
        /// [`RawConfiguration`](crate::configuration::RawConfiguration) before.
        #[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
        #[serde(default)]
        pub struct Policy<C = Configuration> {
            $(
                $(#[doc = $about])+
                #[doc = concat!("\n\nDefault: ", $unset, ".")]
                pub $name: $decided,
            )+
            /// Every client gets this configuration until it is cleared.
            pub pinned: Option<C>,
        }

        impl<C> Policy<C> {
            pub(super) fn defaults() -> Self {
                Self { $($name: $default,)+ pinned: None }
            }

            pub(super) fn map_pinned<D, E>(self, map: impl FnOnce(C) -> Result<D, E>) -> Result<Policy<D>, E> {
                Ok(Policy { $($name: self.$name,)+ pinned: self.pinned.map(map).transpose()? })
            }

            pub(super) fn check_ranges(&self) -> Result<(), PolicyError> {
                $(
                    let said: Option<$said> = self.$name.clone().to_setting();
                    check_range(stringify!($name), said.as_ref(), $range)?;
                )+
                Ok(())
            }

            /// Copies one field from another policy.
            ///
            /// # Errors
            /// [`PolicyError`] when there is no such field.
            pub fn replace_field(&mut self, field: &str, from: &Self) -> Result<(), PolicyError>
            where
                C: Clone,
            {
                match field {
                    $(stringify!($name) => self.$name = from.$name.clone(),)+
                    "pinned" => self.pinned = from.pinned.clone(),
                    _ => return Err(PolicyError::no_such_field(field)),
                }
                Ok(())
            }
        }

        /// A policy as given: for `None` the daemon's default holds. Searches, predictors and operations of
        /// other versions are carried along.
        #[derive(Clone, Debug, Default, PartialEq, Serialize)]
        pub struct PolicySettings {
            $(
                $(#[doc = $about])+
                #[doc = concat!("\n\n`None`: ", $unset, ".")]
                pub $name: Option<$said>,
            )+
            /// Every client gets this configuration. `None`: none does.
            pub pinned: Option<Assignment>,
        }

        impl PolicySettings {
            /// The fields in order, `pinned` last.
            pub const FIELDS: &'static [PolicyField] = &[
                $(PolicyField {
                    name: stringify!($name),
                    about: concat!($($about, "\n"),+),
                    unset: $unset,
                    range: $range,
                    placeholder: $placeholder,
                    words: <$said as SettingValue>::words,
                },)+
                PolicyField {
                    name: "pinned",
                    about: " Every client gets this configuration.",
                    unset: "nothing",
                    range: Range::Any,
                    placeholder: "NAME=VALUE,…",
                    words: Vec::new,
                },
            ];

            /// Settings without any field: the daemon's defaults hold.
            pub fn new() -> Self {
                Self::default()
            }

            $(
                $(#[doc = $about])+
                #[must_use]
                pub fn $name(mut self, value: <$said as SettingValue>::Input) -> Self {
                    self.$name = Some(value.into());
                    self
                }
            )+

            /// Gives every client this configuration.
            #[must_use]
            pub fn pinned(mut self, configuration: impl Into<Assignment>) -> Self {
                self.pinned = Some(configuration.into());
                self
            }

            /// Checks every number against its range.
            ///
            /// # Errors
            /// [`PolicyError`] with the field and its range.
            pub fn check(&self) -> Result<(), PolicyError> {
                $(check_range(stringify!($name), self.$name.as_ref(), $range)?;)+
                Ok(())
            }

            /// Sets a field from text.
            ///
            /// # Errors
            /// [`PolicyError`] with the field, and the texts that it takes.
            pub fn set_text(&mut self, field: &str, text: &str) -> Result<(), PolicyError> {
                match field {
                    $(stringify!($name) => self.$name = Some(read(stringify!($name), text)?),)+
                    "pinned" => self.pinned = Some(read("pinned", text)?),
                    _ => return Err(PolicyError::no_such_field(field)),
                }
                Ok(())
            }

            /// A field as text; `None` where it is not set, or where there is no such field.
            pub fn show(&self, field: &str) -> Option<String> {
                match field {
                    $(stringify!($name) => self.$name.as_ref().map(SettingValue::show),)+
                    "pinned" => self.pinned.as_ref().map(SettingValue::show),
                    _ => None,
                }
            }

            /// Unsets a field. Unknown names are ignored.
            pub fn unset(&mut self, field: &str) {
                match field {
                    $(stringify!($name) => self.$name = None,)+
                    "pinned" => self.pinned = None,
                    _ => {}
                }
            }

            /// Makes the policy: unset fields take their defaults.
            ///
            /// # Errors
            /// [`PolicyError`] for a search, predictor or operation that is not known here.
            pub fn decide(self) -> Result<RawPolicy, PolicyError> {
                Ok(RawPolicy {
                    $($name: decide(stringify!($name), self.$name, $default)?,)+
                    pinned: self.pinned.map(Into::into),
                })
            }
        }

        impl From<RawPolicy> for PolicySettings {
            fn from(policy: RawPolicy) -> Self {
                Self { $($name: policy.$name.to_setting(),)+ pinned: policy.pinned.map(Into::into) }
            }
        }
    };
}

crate::policy_table!(define_policy);

fn check_range<S: SettingValue>(field: &str, said: Option<&S>, range: Range) -> Result<(), PolicyError> {
    said.and_then(S::number).map_or(Ok(()), |number| range.check(field, number))
}

fn read<S: SettingValue>(field: &str, text: &str) -> Result<S, PolicyError> {
    S::parse(text).map_err(|problem| PolicyError(format!("{field}: {problem}")))
}

fn decide<S: SettingValue, D: Setting<S>>(
    field: &str,
    said: Option<S>,
    default: D,
) -> Result<D, PolicyError> {
    match said {
        None => Ok(default),
        Some(said) => D::decide(said).map_err(|number| {
            let known = S::words().join(", ");
            PolicyError(format!("{field}: {number} is not a known value; known are {known}"))
        }),
    }
}
