//! Policies, field by field as the model's table lists them. A field that is only in one of the table and
//! `message Policy` does not compile here.

use treewright_model::policy::PolicySettings;
use treewright_model::words::{OpenEnum, Word};

use super::values::{configuration_from_wire, configuration_to_wire};
use super::{Malformed, WireEnum};
use crate::v1;

/// A field that is set, in the wire's type `W`.
trait WireField<W>: Sized {
    fn to_wire(said: Option<Self>) -> W;

    /// The error names the mistake.
    fn from_wire(wire: W) -> Result<Option<Self>, String>;
}

/// `optional` fields.
impl<T> WireField<Option<T>> for T {
    fn to_wire(said: Option<T>) -> Option<T> {
        said
    }

    fn from_wire(wire: Option<T>) -> Result<Option<T>, String> {
        Ok(wire)
    }
}

/// Counts, where 0 stands for an unset field.
impl WireField<i32> for u32 {
    fn to_wire(said: Option<u32>) -> i32 {
        said.map_or(0, |count| i32::try_from(count).unwrap_or(i32::MAX))
    }

    fn from_wire(wire: i32) -> Result<Option<u32>, String> {
        let count = u32::try_from(wire).map_err(|_| format!("{wire} must not be negative"))?;
        Ok(Some(count).filter(|count| *count > 0))
    }
}

/// Switches that are off by default.
impl WireField<bool> for bool {
    fn to_wire(said: Option<bool>) -> bool {
        said.unwrap_or_default()
    }

    fn from_wire(wire: bool) -> Result<Option<bool>, String> {
        Ok(Some(wire))
    }
}

impl<T: WireEnum + Word> WireField<i32> for OpenEnum<T> {
    fn to_wire(said: Option<Self>) -> i32 {
        match said {
            None => 0,
            Some(OpenEnum::Known(value)) => value.number(),
            Some(OpenEnum::Unrecognised(number)) => number,
        }
    }

    fn from_wire(wire: i32) -> Result<Option<Self>, String> {
        Ok(T::from_number(wire))
    }
}

macro_rules! define_conversion {
    ($(
        $(#[$about:meta])+
        $name:ident: $decided:ty | $said:ty = $default:expr, unset $unset:literal,
            in $range:expr, as $placeholder:literal;
    )+) => {
        /// A policy's settings.
        pub fn policy_to_wire(policy: PolicySettings) -> v1::Policy {
            v1::Policy {
                $($name: WireField::to_wire(policy.$name),)+
                pinned: policy.pinned.map(|pinned| configuration_to_wire(pinned.as_raw())),
            }
        }

        /// Reads a policy; unknown methods are carried along.
        ///
        /// # Errors
        /// [`Malformed`] with the field.
        pub fn policy_from_wire(field: &str, policy: v1::Policy) -> Result<PolicySettings, Malformed> {
            let malformed =
                |name: &str, problem: String| Malformed::new(format!("{field}.{name}"), problem);
            let pinned = policy.pinned;
            let pinned = pinned.map(|pinned| configuration_from_wire(&format!("{field}.pinned"), pinned));
            Ok(PolicySettings {
                $($name: WireField::from_wire(policy.$name)
                    .map_err(|problem| malformed(stringify!($name), problem))?,)+
                pinned: pinned.transpose()?.map(Into::into),
            })
        }
    };
}

treewright_model::policy_table!(define_conversion);
