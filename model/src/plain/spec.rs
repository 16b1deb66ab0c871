//! Spaces and specifications of studies, with plain values.

use serde::ser::SerializeMap as _;
use serde::{Serialize, Serializer};

use super::Plain;
use crate::policy::PolicySettings;
use crate::space::{Condition, Domain, Parameter, Space};
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

/// Writes named values as an object; one with a condition only where that holds.
macro_rules! object {
    ($serializer:ident: $($name:ident = $value:expr $(, if $is_shown:expr)?;)+) => {{
        let mut object = $serializer.serialize_map(None)?;
        $(
            $(if $is_shown)? {
                object.serialize_entry(stringify!($name), &$value)?;
            }
        )+
        object.end()
    }};
}

impl Serialize for Plain<'_, Condition> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Condition { parameter, any_of } = self.0;
        object! { serializer: parameter = parameter; any_of = Plain(any_of.as_slice()); }
    }
}

impl Serialize for Plain<'_, Parameter> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let Parameter { name, domain, default, active_if, setup } = self.0;
        object! {
            serializer:
            name = name;
            domain = Plain(domain);
            default = Plain(default);
            active_if = active_if.as_ref().map(Plain);
            setup = setup, if *setup;
        }
    }
}

impl Serialize for Plain<'_, Space> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let parameters: Vec<_> = self.0.parameters().iter().map(Plain).collect();
        object! { serializer: parameters = parameters; constraints = self.0.constraints(); }
    }
}

impl Serialize for Plain<'_, StudySpec<PolicySettings>> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let (spec, objective) = (self.0, &self.0.objective);
        object! {
            serializer:
            display_name = spec.display_name;
            note = spec.note, if !spec.note.is_empty();
            tags = spec.tags, if !spec.tags.is_empty();
            space = Plain(&spec.space);
            indicators = spec.indicators.indicators();
            objective = objective.terms();
            auxiliary = objective.auxiliary();
            limits = objective.limits();
            maximised = objective.maximised(), if !objective.maximised().is_empty();
            episode_frames = objective.episode_frames(), if objective.episode_frames() > 1;
            fidelities = objective.fidelities(), if !objective.fidelities().is_empty();
            state_tolerance = spec.state_tolerance;
            policy = spec.policy;
            seed = spec.seed;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde::de::DeserializeOwned;
    use serde_json::{Value as Json, json};

    use super::*;
    use crate::testing::{cases, studies};

    /// A plain value with its kind.
    fn of_kind(value: &Json) -> Json {
        let kind = match value {
            Json::Bool(_) => "boolean",
            Json::String(_) => "text",
            number if number.is_f64() => "float",
            _ => "integer",
        };
        json!({ kind: value })
    }

    /// Gives the values of a space the kinds that stored rows have.
    fn give_kinds(space: &mut Json) {
        for parameter in space["parameters"].as_array_mut().expect("a list") {
            parameter["default"] = of_kind(&parameter["default"]);
            for list in ["/domain/categorical/values", "/active_if/any_of"] {
                let values = parameter.pointer_mut(list).and_then(Json::as_array_mut);
                values.into_iter().flatten().for_each(|value| *value = of_kind(value));
            }
        }
    }

    fn read<T: DeserializeOwned>(json: &Json) -> T {
        serde_json::from_value(json.clone()).expect("one of the parts")
    }

    proptest! {
        #![proptest_config(cases(128))]

        #[test]
        fn a_specification_is_written_whole_and_without_the_kinds_of_values(spec in studies()) {
            let text = serde_json::to_string(&Plain(&spec)).expect("plain data");
            let mut json: Json = serde_json::from_str(&text).expect("own output");
            give_kinds(&mut json["space"]);
            let empty = json!([]);
            let maximised = json.get("maximised").unwrap_or(&empty);
            let one = json!(1);
            let objective = json!({
                "directed_terms": json["objective"], "auxiliary": json["auxiliary"],
                "limits": json["limits"], "maximised": maximised,
                "episode_frames": json.get("episode_frames").unwrap_or(&one),
                "fidelities": json.get("fidelities").unwrap_or(&empty),
            });
            let policy = serde_json::to_value(&spec.policy).expect("plain data");
            prop_assert_eq!(&json["policy"], &policy);
            let again = StudySpec {
                display_name: read(&json["display_name"]),
                note: json.get("note").map(read).unwrap_or_default(),
                tags: json.get("tags").map(read).unwrap_or_default(),
                space: read(&json["space"]),
                indicators: read(&json["indicators"]),
                objective: read(&objective),
                state_tolerance: read(&json["state_tolerance"]),
                policy: spec.policy.clone(),
                seed: read(&json["seed"]),
            };
            prop_assert_eq!(again, spec);
        }
    }
}
