//! The configuration that would be exploited.

use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::shown;

/// The configuration that would be exploited: `configuration, cost = study.predict()`, or by name, with the
/// reason for it.
#[pyclass(module = "treewright", frozen)]
pub(crate) struct Prediction(treewright_client::Prediction);

impl Prediction {
    pub(crate) fn new(known: treewright_client::Prediction) -> Self {
        Self(known)
    }
}

#[pymethods]
impl Prediction {
    /// The configuration to run with.
    #[getter]
    fn configuration<'py>(&self, python: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        shown(python, &self.0.configuration)
    }

    /// The predicted objective; None where nothing was measured that tells it, as where the answer is what
    /// served other states best.
    #[getter]
    fn predicted_cost(&self) -> Option<f64> {
        self.0.predicted_cost
    }

    /// The kind of answer: exploit where something is known, here or elsewhere; default where nothing is;
    /// pinned where the policy says so.
    #[getter]
    fn mode(&self) -> String {
        self.0.mode.to_string().to_lowercase()
    }

    /// Why this configuration, in a sentence.
    #[getter]
    fn reason(&self) -> &str {
        &self.0.reason.summary
    }

    fn __len__(&self) -> usize {
        2
    }

    fn __getitem__<'py>(&self, python: Python<'py>, place: isize) -> PyResult<Bound<'py, PyAny>> {
        match place {
            0 | -2 => Ok(shown(python, &self.0.configuration)?.into_any()),
            1 | -1 => Ok(self.0.predicted_cost.into_pyobject(python)?.into_any()),
            _ => Err(PyIndexError::new_err("it is a configuration and its predicted cost")),
        }
    }

    fn __repr__(&self) -> String {
        let cost = self.0.predicted_cost.map_or_else(String::new, |cost| format!(" at {cost}"));
        format!("<Prediction {}{cost}, {}>", self.0.configuration, self.mode())
    }
}
