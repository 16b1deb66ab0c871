//! The best known configuration, with its standing.

use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use treewright_client::{Configuration, CostView, Gain, Standing, Word as _};

use crate::convert::shown;

/// The best that is known: `configuration, cost = study.best()`, or by name, with what is proven of it.
#[pyclass(module = "treewright", frozen)]
pub(crate) struct Best(treewright_client::Best, CostView);

impl Best {
    pub(crate) fn new(best: treewright_client::Best, view: CostView) -> Self {
        Self(best, view)
    }

    fn standing(&self) -> Option<&Standing> {
        self.0.standing.as_ref()
    }

    fn gain(&self) -> Option<Gain> {
        self.standing()?.gain
    }

    fn configuration(&self) -> &Configuration {
        &self.0.configuration
    }
}

#[pymethods]
impl Best {
    /// The configuration to run with.
    #[getter(configuration)]
    fn shown<'py>(&self, python: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        shown(python, self.configuration())
    }

    /// Mean objective of its measurements.
    #[getter]
    fn cost(&self) -> f64 {
        self.0.cost
    }

    /// The 95 % interval of the cost, estimated from all that was measured in the state; None from a daemon
    /// that does not tell.
    #[getter]
    fn cost_interval(&self) -> Option<(f64, f64)> {
        self.standing().map(|known| (known.cost_low, known.cost_high))
    }

    /// Mean objective of the default there; None where it was not measured.
    #[getter]
    fn default_cost(&self) -> Option<f64> {
        self.0.default_cost
    }

    /// The value behind the cost: the metric where one is maximised and nothing else counts, else the cost.
    #[getter]
    fn value(&self) -> f64 {
        self.1.value(self.0.cost)
    }

    /// The 95 % interval of the value, the lower end first; None where there is no cost_interval.
    #[getter]
    fn value_interval(&self) -> Option<(f64, f64)> {
        self.cost_interval().map(|(low, high)| self.1.interval(low, high))
    }

    /// The value behind default_cost.
    #[getter]
    fn default_value(&self) -> Option<f64> {
        self.0.default_cost.map(|cost| self.1.value(cost))
    }

    /// The share by which the cost is estimated to lie below the default's; None where that was not measured.
    #[getter(gain)]
    fn gain_share(&self) -> Option<f64> {
        self.gain().map(|gain| gain.share)
    }

    /// The 95 % interval of the gain; an end of which nothing is known is None.
    #[getter]
    fn gain_interval(&self) -> Option<(Option<f64>, Option<f64>)> {
        self.gain().map(|gain| (gain.low, gain.high))
    }

    /// The probability that it costs less than the default, where that is known.
    #[getter]
    fn probability_better(&self) -> Option<f64> {
        self.gain().and_then(|gain| gain.probability_better)
    }

    /// Whether the answer is what was run before.
    #[getter]
    fn nothing_better(&self) -> Option<bool> {
        self.standing().map(|known| known.nothing_better)
    }

    /// How far confirmation is: off, searching, racing, better, nothing_better.
    #[getter]
    fn stage(&self) -> Option<String> {
        self.standing().map(|known| known.confirmation.stage.word().to_lowercase())
    }

    /// The standing in a word or two: proven better, likely better, searching, confirming, open, nothing
    /// better, nothing to win.
    #[getter]
    fn status(&self) -> Option<&'static str> {
        self.standing().map(Standing::in_short)
    }

    /// The standing as a sentence.
    #[getter]
    fn verdict(&self) -> Option<String> {
        self.standing().map(|known| known.sentence_by(&self.1))
    }

    /// How many measurements the cost rests on.
    #[getter]
    fn measurements(&self) -> i32 {
        self.0.measurements
    }

    /// Name of the most recent trial that measured it.
    #[getter]
    fn trial(&self) -> &str {
        &self.0.trial
    }

    fn __len__(&self) -> usize {
        2
    }

    fn __getitem__<'py>(&self, python: Python<'py>, place: isize) -> PyResult<Bound<'py, PyAny>> {
        match place {
            0 | -2 => Ok(shown(python, self.configuration())?.into_any()),
            1 | -1 => Ok(self.0.cost.into_pyobject(python)?.into_any()),
            _ => Err(PyIndexError::new_err("it is a configuration and its cost")),
        }
    }

    fn __repr__(&self) -> String {
        let interval = self.value_interval();
        let interval = interval.map_or_else(String::new, |(low, high)| format!(" [{low}, {high}]"));
        format!("<Best {} at {} {}{interval}>", self.configuration(), self.1.title(), self.value())
    }
}
