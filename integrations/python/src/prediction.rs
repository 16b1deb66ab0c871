//! The configuration that would be exploited.

use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;

use crate::convert::Shown;

/// The configuration that would be exploited: `configuration, cost = study.predict()`, or by name, with the
/// reason for it.
#[pyclass(module = "treewright", frozen, get_all)]
pub(crate) struct Prediction {
    /// The configuration to run with.
    configuration: Shown,
    /// The predicted objective; None where nothing was measured that tells it, as where the answer is what
    /// served other states best.
    predicted_cost: Option<f64>,
    /// The kind of answer: exploit where something is known, here or elsewhere; default where nothing is;
    /// pinned where the policy says so.
    mode: String,
    /// Why this configuration, in a sentence.
    reason: String,
}

impl Prediction {
    pub(crate) fn new(known: treewright_client::Prediction) -> Self {
        let treewright_client::Prediction { configuration, mode, predicted_cost, reason, .. } = known;
        let (configuration, mode) = (Shown(configuration), mode.to_string().to_lowercase());
        Self { configuration, predicted_cost, mode, reason: reason.summary }
    }
}

#[pymethods]
impl Prediction {
    fn __len__(&self) -> usize {
        2
    }

    fn __getitem__<'py>(&self, python: Python<'py>, place: isize) -> PyResult<Bound<'py, PyAny>> {
        match place {
            0 | -2 => Ok(self.configuration.into_pyobject(python)?.into_any()),
            1 | -1 => Ok(self.predicted_cost.into_pyobject(python)?.into_any()),
            _ => Err(PyIndexError::new_err("it is a configuration and its predicted cost")),
        }
    }

    fn __repr__(&self) -> String {
        let Self { configuration: Shown(configuration), predicted_cost, mode, .. } = self;
        let cost = predicted_cost.map_or_else(String::new, |cost| format!(" at {cost}"));
        format!("<Prediction {configuration}{cost}, {mode}>")
    }
}
