//! The stored trials of a study, as dictionaries.

use std::collections::BTreeMap;
use std::time::{SystemTime, UNIX_EPOCH};

use pyo3::prelude::*;
use pyo3::types::{PyDict, PyList};
use treewright_client::{OpenEnum, Outcome, TrialQuery, TrialRecord, blocking};

use crate::convert::shown;
use crate::error::raised;

/// All that match, in the form that `treewright.trials.Trials` takes.
pub(crate) fn read<'py>(
    python: Python<'py>,
    client: &blocking::Client,
    study: &str,
    query: TrialQuery,
) -> PyResult<Bound<'py, PyAny>> {
    let read = || client.trials(study, query).collect::<Result<Vec<_>, _>>();
    let records = python.detach(read).map_err(raised)?;
    let rows = records.iter().map(|record| row(python, record)).collect::<PyResult<Vec<_>>>()?;
    let list = PyList::new(python, rows)?;
    python.import("treewright.trials")?.getattr("Trials")?.call1((list,))
}

fn row<'py>(python: Python<'py>, record: &TrialRecord) -> PyResult<Bound<'py, PyDict>> {
    let seconds = |time: Option<SystemTime>| {
        time.and_then(|time| time.duration_since(UNIX_EPOCH).ok()).map(|since| since.as_secs_f64())
    };
    let row = PyDict::new(python);
    row.set_item("number", record.number())?;
    row.set_item("client_id", &record.client_id)?;
    row.set_item("state_id", record.state_id)?;
    row.set_item("mode", record.mode.to_string().to_lowercase())?;
    row.set_item("state", record.state.to_string().to_lowercase())?;
    row.set_item("outcome", record.outcome.as_ref().map(ended))?;
    row.set_item("cost", record.cost)?;
    row.set_item("fidelity", record.fidelity.as_deref())?;
    row.set_item("late", record.late)?;
    row.set_item("exclusion", record.exclusion.as_deref())?;
    row.set_item("create_time", seconds(record.create_time))?;
    row.set_item("complete_time", seconds(record.complete_time))?;
    row.set_item("configuration", shown(python, &record.configuration)?)?;
    row.set_item("indicators", record.indicators.iter().collect::<BTreeMap<_, _>>())?;
    row.set_item("measurements", record.measurements.iter().collect::<BTreeMap<_, _>>())?;
    row.set_item("standard_errors", record.standard_errors.iter().collect::<BTreeMap<_, _>>())?;
    Ok(row)
}

fn ended(outcome: &OpenEnum<Outcome>) -> String {
    let word = outcome.as_known().map(|outcome| outcome.kind().to_string().to_lowercase());
    word.unwrap_or_else(|| "unrecognised".to_owned())
}
