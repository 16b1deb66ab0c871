//! The requests of the measuring examples: a study of one integer, and reports on its trials.

use std::collections::BTreeMap;

use treewright_client::{Space, StudySpec};
use treewright_proto::convert::spec_to_wire;
use treewright_proto::v1 as wire;

/// A study of the parameter `leaf` without indicators; its cost is `render_ms`.
pub(crate) fn study() -> wire::Study {
    let space = Space::builder().integer("leaf", 1..=32).default(8).build().expect("a space");
    spec_to_wire(&StudySpec::builder(space).minimise("render_ms", 1.0).build().expect("a study"))
}

/// The report that a trial took 10 ms.
pub(crate) fn report(trial: wire::Trial) -> wire::ReportRequest {
    wire::ReportRequest {
        trial: trial.name,
        measurements: BTreeMap::from([("render_ms".to_owned(), 10.0)]),
        outcome: Some(wire::Outcome { kind: Some(wire::outcome::Kind::Ok(wire::Ok {})) }),
        ..wire::ReportRequest::default()
    }
}
