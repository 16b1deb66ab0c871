//! Small made-up records for tests.

use std::collections::BTreeMap;

use treewright_client::{Configuration, Outcome};
use treewright_renderer::frame::FrameTimes;

use super::record::{Conditions, Group, GroupKind, Iteration, Member, Place, Search, VERSION};

pub(crate) fn conditions(iterations: u32) -> Conditions {
    Conditions {
        version: VERSION,
        size: [160, 120],
        iterations,
        cameras: 4,
        space: "paper".to_owned(),
        ..Conditions::default()
    }
}

pub(crate) fn place(scene: &str) -> Place {
    Place { scene: scene.to_owned(), camera: 0 }
}

/// A configuration with a number, which distinguishes it from others.
pub(crate) fn numbered(number: i64) -> Configuration {
    Configuration::new().with("quality", number)
}

/// A search for render time: configurations with their milliseconds, none where they could not be built.
pub(crate) fn search(scene: &str, tried: &[(Configuration, Option<f64>)]) -> Search {
    let iteration = |(configuration, ms): &(Configuration, Option<f64>)| Iteration {
        configuration: configuration.clone(),
        step: "initial".to_owned(),
        outcome: Outcome::Ok,
        times: ms.map(|ms| FrameTimes::of(500.0, ms)),
    };
    Search {
        objective: "render".to_owned(),
        method: "nelder_mead".to_owned(),
        place: place(scene),
        state: BTreeMap::new(),
        iterations: tried.iter().map(iteration).collect(),
        other_cores: None,
        provenance: None,
    }
}

/// Configurations with their milliseconds in each round.
pub(crate) fn group(kind: GroupKind, scene: &str, measured: &[(Configuration, &[f64])]) -> Group {
    let member = |(configuration, rounds): &(Configuration, &[f64])| Member {
        configuration: configuration.clone(),
        rounds: rounds.iter().map(|ms| FrameTimes::of(500.0, *ms)).collect(),
        failure: None,
    };
    let members = measured.iter().map(member).collect();
    Group { kind, place: place(scene), members, other_cores: None, provenance: None }
}
