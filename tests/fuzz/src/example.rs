//! A small study with one parameter of each kind, a condition and a constraint.

use std::collections::BTreeMap;

use treewright_proto::v1::{self as wire, parameter, value};

fn parameter(name: &str, domain: parameter::Domain, default: value::Kind) -> wire::Parameter {
    let default_value = Some(wire::Value { kind: Some(default) });
    wire::Parameter { name: name.into(), domain: Some(domain), default_value, active_if: None, setup: false }
}

/// The study.
pub fn study() -> wire::Study {
    let integer = parameter::Domain::Integer(wire::IntegerDomain { min: 1, max: 8, scale: 0 });
    let float = parameter::Domain::Float(wire::FloatDomain { min: 0.0, max: 1.0, scale: 0 });
    let texts = ["low", "high"].map(|text| wire::Value { kind: Some(value::Kind::Text(text.into())) });
    let choice = parameter::Domain::Categorical(wire::CategoricalDomain { values: texts.to_vec() });
    wire::Study {
        space: Some(wire::Space {
            parameters: vec![
                parameter("a", integer.clone(), value::Kind::Integer(1)),
                parameter("b", integer, value::Kind::Integer(8)),
                parameter("f", float, value::Kind::Float(0.5)),
                parameter("q", choice, value::Kind::Text("low".into())),
            ],
            constraints: vec![wire::Constraint {
                lesser: "a".into(),
                greater: "b".into(),
                ..wire::Constraint::default()
            }],
        }),
        indicators: vec![wire::Indicator { name: "i".into(), min: 0.0, max: 1.0, scale: 0 }],
        objective: Some(wire::Objective {
            terms: vec![wire::ObjectiveTerm { metric: "m".into(), weight: 1.0 }],
            ..wire::Objective::default()
        }),
        policy: Some(wire::Policy { epsilon: Some(1.0), trials_per_state: 5, ..Default::default() }),
        ..Default::default()
    }
}

/// A question for the next trial of `studies/s`.
pub fn suggest(client_id: &str) -> wire::SuggestRequest {
    let (study, client_id) = ("studies/s".into(), client_id.into());
    let indicators = BTreeMap::from([("i".to_owned(), 0.5)]);
    wire::SuggestRequest { study, client_id, indicators, ..Default::default() }
}
