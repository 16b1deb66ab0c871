//! The best known configuration, with its standing.

use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;
use treewright_client::{CostView, Standing, Word as _};

use crate::convert::Shown;

/// The best that is known: `configuration, cost = study.best()`, or by name, with what is proven of it.
#[pyclass(module = "treewright", frozen, get_all)]
pub(crate) struct Best {
    /// The configuration to run with.
    configuration: Shown,
    /// Mean objective of its measurements.
    cost: f64,
    /// The 95 % interval of the cost, estimated from all that was measured in the state; None from a daemon
    /// that does not tell.
    cost_interval: Option<(f64, f64)>,
    /// Mean objective of the default there; None where it was not measured.
    default_cost: Option<f64>,
    /// The value behind the cost: the metric where one is maximised and nothing else counts, else the cost.
    value: f64,
    /// The 95 % interval of the value, the lower end first; None where there is no cost_interval.
    value_interval: Option<(f64, f64)>,
    /// The value behind default_cost.
    default_value: Option<f64>,
    /// The name of such values: "cost", or the metric and that higher is better.
    value_title: String,
    /// The share by which the cost is estimated to lie below the default's; None where that was not measured.
    gain: Option<f64>,
    /// The 95 % interval of the gain; an end of which nothing is known is None.
    gain_interval: Option<(Option<f64>, Option<f64>)>,
    /// The probability that it costs less than the default, where that is known.
    probability_better: Option<f64>,
    /// Whether the answer is what was run before.
    nothing_better: Option<bool>,
    /// How far confirmation is: off, searching, racing, better, nothing_better.
    stage: Option<String>,
    /// The standing in a word or two: proven better, likely better, searching, confirming, open, nothing
    /// better, nothing to win.
    status: Option<&'static str>,
    /// The standing as a sentence.
    verdict: Option<String>,
    /// How many measurements the cost rests on.
    measurements: i32,
    /// Name of the most recent trial that measured it.
    trial: String,
}

impl Best {
    pub(crate) fn new(best: treewright_client::Best, view: &CostView) -> Self {
        let known = best.standing.as_ref();
        let gain = known.and_then(|known| known.gain);
        let cost_interval = known.map(|known| (known.cost_low, known.cost_high));
        Self {
            cost: best.cost,
            cost_interval,
            default_cost: best.default_cost,
            value: view.value(best.cost),
            value_interval: cost_interval.map(|(low, high)| view.interval(low, high)),
            default_value: best.default_cost.map(|cost| view.value(cost)),
            value_title: view.title(),
            gain: gain.map(|gain| gain.share),
            gain_interval: gain.map(|gain| (gain.low, gain.high)),
            probability_better: gain.and_then(|gain| gain.probability_better),
            nothing_better: known.map(|known| known.nothing_better),
            stage: known.map(|known| known.confirmation.stage.word().to_lowercase()),
            status: known.map(Standing::in_short),
            verdict: known.map(|known| known.sentence_by(view)),
            measurements: best.measurements,
            trial: best.trial,
            configuration: Shown(best.configuration),
        }
    }
}

#[pymethods]
impl Best {
    fn __len__(&self) -> usize {
        2
    }

    fn __getitem__<'py>(&self, python: Python<'py>, place: isize) -> PyResult<Bound<'py, PyAny>> {
        match place {
            0 | -2 => Ok(self.configuration.into_pyobject(python)?.into_any()),
            1 | -1 => Ok(self.cost.into_pyobject(python)?.into_any()),
            _ => Err(PyIndexError::new_err("it is a configuration and its cost")),
        }
    }

    fn __repr__(&self) -> String {
        let Self { configuration: Shown(configuration), value_title, value, .. } = self;
        let interval =
            self.value_interval.map_or_else(String::new, |(low, high)| format!(" [{low}, {high}]"));
        format!("<Best {configuration} at {value_title} {value}{interval}>")
    }
}
