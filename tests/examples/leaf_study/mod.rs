//! The requests of the measuring examples: a study of one integer, and reports on its trials.

use std::collections::BTreeMap;

use treewright_proto::v1 as wire;

/// A study of the parameter `leaf` without indicators; its cost is `render_ms`.
pub(crate) fn study() -> wire::Study {
    let domain = wire::parameter::Domain::Integer(wire::IntegerDomain { min: 1, max: 32, scale: 0 });
    let value = wire::Value { kind: Some(wire::value::Kind::Integer(8)) };
    let leaf = wire::Parameter {
        name: "leaf".into(),
        domain: Some(domain),
        default_value: Some(value),
        active_if: None,
    };
    let term = wire::ObjectiveTerm { metric: "render_ms".into(), weight: 1.0 };
    wire::Study {
        space: Some(wire::Space { parameters: vec![leaf], constraints: Vec::new() }),
        objective: Some(wire::Objective { terms: vec![term], ..Default::default() }),
        ..Default::default()
    }
}

/// The report that a trial took 10 ms.
pub(crate) fn report(trial: wire::Trial) -> wire::ReportRequest {
    wire::ReportRequest {
        trial: trial.name,
        measurements: BTreeMap::from([("render_ms".to_owned(), 10.0)]),
        outcome: Some(wire::Outcome { kind: Some(wire::outcome::Kind::Ok(wire::Ok {})) }),
    }
}
