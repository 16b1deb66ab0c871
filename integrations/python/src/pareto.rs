//! A front that was found, in the form of `treewright.front.ParetoFront`.

use pyo3::prelude::*;
use pyo3::types::PyDict;
use treewright_client::{FrontPoint, ParetoFront};

use crate::convert::shown;

pub(crate) fn front<'py>(python: Python<'py>, found: &ParetoFront) -> PyResult<Bound<'py, PyAny>> {
    let points =
        |points: &[FrontPoint]| points.iter().map(|one| point(python, one)).collect::<PyResult<Vec<_>>>();
    let facts = PyDict::new(python);
    facts.set_item("metrics", found.metrics.clone())?;
    facts.set_item("maximised", found.maximised.clone())?;
    facts.set_item("runs", found.runs)?;
    facts.set_item("default", found.default.as_ref().map(|one| point(python, one)).transpose()?)?;
    facts.set_item("dominated", points(&found.dominated)?)?;
    facts.set_item("hypervolume", found.hypervolume)?;
    let on_it = points(&found.points)?;
    python.import("treewright.front")?.getattr("ParetoFront")?.call((on_it,), Some(&facts))
}

fn point<'py>(python: Python<'py>, point: &FrontPoint) -> PyResult<Bound<'py, PyDict>> {
    let row = PyDict::new(python);
    row.set_item("configuration", shown(python, &point.configuration)?)?;
    row.set_item("runs", point.runs)?;
    row.set_item("metrics", point.metrics.clone())?;
    row.set_item("ratios", point.ratios.clone())?;
    Ok(row)
}
