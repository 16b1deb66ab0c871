//! A study of another tuner, turned into a study of this one.

use std::collections::BTreeMap;
use std::path::Path;

use serde_json::{Value as Json, json};
use treewright_client::{StudySpec, Value};

use super::CarriedTrial;
use crate::failure::{Failure, Result};
use crate::study_file::{Plain, StudyFile};

/// The metric of a study that is created.
pub(super) const METRIC: &str = "value";

/// A study of another tuner.
#[derive(Debug)]
pub(crate) struct Foreign {
    pub(crate) study: StudyFile,
    /// Its trials that say something; the measurement is called `value`.
    pub(crate) trials: Vec<CarriedTrial>,
    /// Trials without a finite value.
    pub(crate) without_value: u64,
    /// Its one objective is to be large.
    pub(crate) is_maximised: bool,
}

impl Foreign {
    /// The name of a study's first metric, which its trials are to measure. It is an error when one of the
    /// two studies minimises and the other maximises.
    pub(crate) fn metric_in(&self, spec: &StudySpec) -> Result<String, String> {
        let Some(term) = spec.objective.terms().first() else { return Ok(METRIC.to_owned()) };
        let metric = term.metric.clone();
        match (self.is_maximised, spec.objective.maximised().contains(&metric)) {
            (true, false) => Err(format!("the file's study maximises, and this one minimises {metric}")),
            (false, true) => Err(format!("the file's study minimises, and this one maximises {metric}")),
            _ => Ok(metric),
        }
    }

    /// Calls the measurement as the study's first metric is called.
    pub(crate) fn with_metric(mut self, metric: &str) -> Self {
        for trial in &mut self.trials {
            if let Some(value) = trial.measurements.remove(METRIC) {
                trial.measurements.insert(metric.to_owned(), value);
            }
        }
        self
    }
}

/// Reads a file with a reader that waits for a database.
pub(super) fn read_with(
    path: &Path,
    reader: impl Future<Output = Result<Foreign, String>>,
) -> Result<Foreign> {
    let runtime = tokio::runtime::Builder::new_current_thread().enable_all().build();
    let read = runtime.map_err(|error| error.to_string()).and_then(|runtime| runtime.block_on(reader));
    read.map_err(|problem| Failure::file(path, problem))
}

pub(super) fn json_of(value: &Value) -> Json {
    json!(Plain::from(value))
}

/// A name as ours are spelt.
pub(super) fn our_name(name: &str) -> String {
    let plain = |each: char| if each.is_ascii_alphanumeric() { each.to_ascii_lowercase() } else { '_' };
    let name: String = name.chars().map(plain).collect();
    if name.starts_with(|first: char| first.is_ascii_lowercase()) { name } else { format!("p_{name}") }
}

/// Looks whether parameters stay apart under our names. The error names two that would become one.
pub(super) fn check_names<'a>(names: impl IntoIterator<Item = &'a str>) -> Result<(), String> {
    let mut ours = BTreeMap::new();
    for name in names {
        let own = our_name(name);
        match ours.insert(own.clone(), name) {
            Some(other) if other != name => {
                return Err(format!("its parameters {other} and {name} would both be called {own} here"));
            }
            _ => {}
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_that_would_become_one_are_named() {
        assert_eq!(check_names(["Depth", "lr", "Depth"]), Ok(()));
        let pairs = [["lr-a", "lr_a", "lr_a"], ["Depth", "depth", "depth"], ["α", "β", "p__"]];
        for [one, other, own] in pairs {
            let problem = check_names([one, "kind", other]).expect_err("two of one name");
            assert_eq!(problem, format!("its parameters {one} and {other} would both be called {own} here"));
        }
    }
}
