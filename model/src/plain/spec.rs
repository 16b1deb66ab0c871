//! Spaces and specifications of studies, with plain values.

use serde::{Serialize, Serializer};

use super::Plain;
use crate::indicator::Indicator;
use crate::objective::{MeasurementLimit, ObjectiveTerm};
use crate::policy::PolicySettings;
use crate::space::{Condition, Constraint, Domain, Parameter, Space};
use crate::study::StudySpec;
use crate::value::Value;

impl Serialize for Plain<'_, Domain> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        #[serde(rename_all = "snake_case")]
        enum Shown<'a> {
            Categorical { values: Plain<'a, [Value]> },
        }
        match self.0 {
            Domain::Categorical { values } => {
                Shown::Categorical { values: Plain(values.as_slice()) }.serialize(serializer)
            }
            // They hold no values.
            other => other.serialize(serializer),
        }
    }
}

impl Serialize for Plain<'_, Condition> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Shown<'a> {
            parameter: &'a str,
            any_of: Plain<'a, [Value]>,
        }
        let Condition { parameter, any_of } = self.0;
        Shown { parameter, any_of: Plain(any_of.as_slice()) }.serialize(serializer)
    }
}

impl Serialize for Plain<'_, Parameter> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Shown<'a> {
            name: &'a str,
            domain: Plain<'a, Domain>,
            default: Plain<'a, Value>,
            active_if: Option<Plain<'a, Condition>>,
        }
        let Parameter { name, domain, default, active_if } = self.0;
        let active_if = active_if.as_ref().map(Plain);
        Shown { name, domain: Plain(domain), default: Plain(default), active_if }.serialize(serializer)
    }
}

impl Serialize for Plain<'_, Space> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Shown<'a> {
            parameters: Vec<Plain<'a, Parameter>>,
            constraints: &'a [Constraint],
        }
        let parameters = self.0.parameters().iter().map(Plain).collect();
        Shown { parameters, constraints: self.0.constraints() }.serialize(serializer)
    }
}

impl Serialize for Plain<'_, StudySpec<PolicySettings>> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        #[derive(Serialize)]
        struct Shown<'a> {
            display_name: &'a str,
            space: Plain<'a, Space>,
            indicators: &'a [Indicator],
            objective: &'a [ObjectiveTerm],
            auxiliary: &'a [String],
            limits: &'a [MeasurementLimit],
            #[serde(skip_serializing_if = "<[String]>::is_empty")]
            maximised: &'a [String],
            state_tolerance: f64,
            policy: &'a PolicySettings,
            seed: u64,
        }
        let StudySpec { display_name, space, indicators, objective, state_tolerance, policy, seed } = self.0;
        Shown {
            display_name,
            space: Plain(space),
            indicators: indicators.indicators(),
            objective: objective.terms(),
            auxiliary: objective.auxiliary(),
            limits: objective.limits(),
            maximised: objective.maximised(),
            state_tolerance: *state_tolerance,
            policy,
            seed: *seed,
        }
        .serialize(serializer)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn spaces_are_written_without_the_kinds_of_values() {
        let space = Space::builder()
            .categorical("split", ["sah", "median"])
            .default("sah")
            .integer("bins", 4..=64)
            .default(16)
            .active_if("split", ["sah"])
            .build()
            .expect("a space");
        let json = serde_json::to_value(Plain(&space)).expect("plain data");
        assert_eq!(json["parameters"][0]["domain"]["categorical"]["values"][1], "median");
        assert_eq!(json["parameters"][1]["domain"]["integer"]["max"], 64);
        assert_eq!(json["parameters"][1]["default"], 16);
        assert_eq!(json["parameters"][1]["active_if"]["any_of"][0], "sah");
        assert_eq!(json["parameters"][0]["active_if"], serde_json::Value::Null);
    }
}
