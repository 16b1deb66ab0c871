//! The policy of a study: decided ([`Policy`]), as given by a client ([`PolicySettings`]), and changes to it
//! ([`PolicyChange`]).
//!
//! `table` lists the fields once. `define` makes the structs and their checks from it. `field` holds the
//! kinds of fields. `registry` lists the searches and predictors, and `methods` makes enums of them. `change`
//! replaces fields.

mod change;
mod define;
mod few;
mod field;
mod methods;
mod registry;
mod table;

use thiserror::Error;

pub use change::PolicyChange;
pub use define::{Policy, PolicySettings};
pub use few::Few;
pub use field::{PolicyField, Range, Setting, SettingValue};
pub use methods::{Method, Operation, PredictorMethod, RegisteredMethod, SearchMethod};

use crate::configuration::RawConfiguration;
use crate::space::{Space, SpaceError};

/// The factor of the reference's cost at which exploring trials stop where a budget is kept and the policy
/// names none.
pub const ABORT_ABOVE_DEFAULT: f64 = 2.0;

/// That factor where no budget is kept, for a client that stops trials in time. Costs may differ by orders of
/// magnitude; a factor near 1 would hide what lies behind dear points.
pub const ABORT_ABOVE_STOPPABLE: f64 = 4.0;

/// A policy whose pinned configuration has not been checked yet.
pub type RawPolicy = Policy<RawConfiguration>;

/// Why a policy is refused: names the field, the mistake and its remedy.
#[derive(Clone, Debug, PartialEq, Error)]
#[error("policy.{0}")]
pub struct PolicyError(String);

impl From<SpaceError> for PolicyError {
    fn from(error: SpaceError) -> Self {
        Self(format!("pinned: {error}"))
    }
}

impl PolicySettings {
    /// Fields of earlier versions. Where they are still given they are ignored.
    pub const RETIRED: &'static [&'static str] = &["freeze_risk"];
}

impl PolicyError {
    fn no_such_field(field: &str) -> Self {
        Self(format!("{field} is not a field of a policy; there are {}", field_names()))
    }
}

/// The names of all fields, for messages.
pub fn field_names() -> String {
    let names: Vec<&str> = PolicySettings::FIELDS.iter().map(|field| field.name).collect();
    names.join(", ")
}

impl PolicySettings {
    /// The names of the presets.
    pub const PRESETS: &'static [&'static str] = &["paper"];

    /// The paper's policy. The dice are thrown once for each change of state. A search is the 80 iterations
    /// of a stochastic Nelder-Mead simplex. The nearest known state answers, and no configuration is run
    /// twice or confirmed.
    pub fn paper() -> Self {
        Self::new()
            .epsilon(0.2)
            .dice_once(true)
            .search(SearchMethod::NelderMead)
            .trials_per_state(80)
            .replicates(1)
            .confirm_rounds(0)
            .track_speed(false)
            .roll_back(false)
            .predictor(PredictorMethod::NearestNeighbour)
    }

    /// A preset by its name.
    ///
    /// # Errors
    /// [`PolicyError`] with the known names.
    pub fn preset(name: &str) -> Result<Self, PolicyError> {
        match name {
            "paper" => Ok(Self::paper()),
            _ => Err(PolicyError(format!("preset: `{name}` is none of {}", Self::PRESETS.join(", ")))),
        }
    }
}

impl<C> Policy<C> {
    /// The duration of a lease, in milliseconds.
    pub fn lease_ms(&self) -> i64 {
        i64::from(self.lease_s) * 1000
    }
}

impl Policy {
    /// Checks every field against `space` and the limits.
    ///
    /// # Errors
    /// [`PolicyError`] with the field.
    pub fn validate(&self, space: &Space) -> Result<(), PolicyError> {
        self.check_ranges()?;
        if let Some(pinned) = &self.pinned {
            // The configuration may come from another space than the study's.
            space.configuration(pinned.to_raw())?;
        }
        Ok(())
    }

    /// The unchecked form, for tables.
    pub fn to_raw(&self) -> RawPolicy {
        self.clone().map_pinned(|pinned| Ok::<_, SpaceError>(pinned.into())).expect("the map cannot fail")
    }
}

impl RawPolicy {
    /// Checks every field against `space` and the limits.
    ///
    /// # Errors
    /// [`PolicyError`] with the field.
    pub fn check(self, space: &Space) -> Result<Policy, PolicyError> {
        self.check_ranges()?;
        Ok(self.map_pinned(|pinned| space.configuration(pinned))?)
    }
}

impl From<Policy> for PolicySettings {
    fn from(policy: Policy) -> Self {
        policy.to_raw().into()
    }
}

impl<C> Default for Policy<C> {
    fn default() -> Self {
        Self::defaults()
    }
}

#[cfg(test)]
mod tests;
