//! Pareto fronts: the loop over their directions, and what was found.

use std::sync::Mutex;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use treewright_client::{ClientError, FrontLoop, Measurements, Outcome, StudySpec, TrialRecord};

use crate::client::{Client, policy_of};
use crate::convert::{Named, Numbers, shown};
use crate::error::raised;
use crate::space::{Ends, Space};
use crate::suggestion::{ended, lock};

/// Two or three metrics of which none is given up for another: runs that look for the configurations of which
/// no other is better in all of them. One program at a time adds to a front, and runs one trial at a time.
#[pyclass(module = "treewright", frozen)]
pub(crate) struct Front(FrontLoop);

#[pymethods]
impl Front {
    /// Creates the study, or goes on with the one of that id that was made for these metrics. All metrics are
    /// above 0 in every run; ``1/rate`` is one that is to be large. ``trials`` are the planned runs.
    #[new]
    #[pyo3(signature = (client, id, space, metrics, *, trials=80, limits=Named::default(), policy=Named::default()))]
    #[allow(clippy::too_many_arguments)] // some are keywords of Python
    fn new(
        python: Python<'_>,
        client: &Client,
        id: &str,
        space: &Space,
        metrics: Vec<String>,
        trials: u32,
        limits: Named<Ends>,
        policy: Named<Bound<'_, PyAny>>,
    ) -> PyResult<Self> {
        let front = treewright_client::Front::new(&metrics).map_err(|error| raised(error.into()))?;
        let mut study = StudySpec::builder(space.build().map_err(raised)?).policy(policy_of(policy)?);
        for (metric, (at_least, at_most)) in limits.0 {
            study = study.limit(&metric, at_least, at_most);
        }
        let spec = study.front(&front).build().map_err(|error| raised(error.into()))?;
        let client = client.inner().clone();
        python.detach(|| FrontLoop::open(&client, id, &spec, front, trials)).map(Self).map_err(raised)
    }

    /// The names of the metrics.
    #[getter]
    fn metrics(&self, python: Python<'_>) -> Vec<String> {
        python.detach(|| self.0.metrics())
    }

    /// The next run. It stays that run until it is reported or given back. None once the planned runs are
    /// done, or nothing more is to be tried. Raises where no daemon answers.
    fn suggest(this: &Bound<'_, Self>) -> PyResult<Option<FrontTrial>> {
        let own = this.get();
        let trial = this.py().detach(|| own.0.ask()).map_err(raised)?;
        let front = || this.clone().unbind();
        Ok(trial.map(|trial| FrontTrial { front: front(), trial, is_open: Mutex::new(true) }))
    }

    /// The front of all runs so far on this machine, as a ``treewright.front.ParetoFront``. The hypervolume
    /// refers to the default.
    fn found<'py>(&self, python: Python<'py>) -> PyResult<Bound<'py, PyAny>> {
        crate::pareto::front(python, &python.detach(|| self.0.found()))
    }

    fn __repr__(&self) -> String {
        format!("<Front {}>", self.0.study())
    }
}

/// A run of a front. Report every metric of it, or give it back; leaving a ``with`` block gives back what is
/// open, and tells an exception as the run's failure.
#[pyclass(module = "treewright", frozen)]
pub(crate) struct FrontTrial {
    front: Py<Front>,
    trial: TrialRecord,
    is_open: Mutex<bool>,
}

impl FrontTrial {
    fn end(&self, python: Python<'_>, measured: Measurements, outcome: &Outcome) -> PyResult<()> {
        let front = self.front.get();
        let told = python.detach(|| -> Result<bool, ClientError> {
            let mut is_open = lock(&self.is_open);
            if !*is_open {
                return Ok(false);
            }
            front.0.tell(&self.trial, measured, outcome)?;
            *is_open = false;
            Ok(true)
        });
        if told.map_err(raised)? { Ok(()) } else { Err(ended()) }
    }
}

#[pymethods]
impl FrontTrial {
    /// The configuration to run with.
    #[getter]
    fn configuration<'py>(&self, python: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        shown(python, &self.trial.configuration)
    }

    /// Name of its trial.
    #[getter]
    fn trial(&self) -> &str {
        &self.trial.name
    }

    /// Whether it is neither reported nor given back.
    #[getter]
    fn is_open(&self, python: Python<'_>) -> bool {
        python.detach(|| *lock(&self.is_open))
    }

    fn __getitem__<'py>(&self, python: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let known = shown(python, &self.trial.configuration)?;
        known.get_item(name)?.ok_or_else(|| pyo3::exceptions::PyKeyError::new_err(name.to_owned()))
    }

    /// Ends the run with what was measured, and tells every direction. Waits for the daemon. Raises Invalid
    /// where a metric is missing or not above 0; the run is open then.
    #[pyo3(signature = (measurements=None, /, **named))]
    fn report(
        &self,
        python: Python<'_>,
        measurements: Option<Numbers>,
        named: Option<Numbers>,
    ) -> PyResult<()> {
        self.end(python, crate::convert::measurements(measurements, named, None), &Outcome::Ok)
    }

    /// The configuration cannot work.
    fn infeasible(&self, python: Python<'_>, reason: String) -> PyResult<()> {
        self.end(python, Measurements::new(), &Outcome::infeasible(reason))
    }

    /// It failed for a reason that says nothing about the configuration.
    fn failed(&self, python: Python<'_>, reason: String) -> PyResult<()> {
        self.end(python, Measurements::new(), &Outcome::failed(reason))
    }

    /// Gives the run back unmeasured. Where that fails, its lease runs out.
    fn abandon(&self, python: Python<'_>) {
        let front = self.front.get();
        python.detach(|| {
            let mut is_open = lock(&self.is_open);
            if std::mem::take(&mut *is_open) {
                let _ = front.0.give_back(&self.trial);
            }
        });
    }

    fn __enter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    /// An exception is the run's failure; an open run is given back.
    fn __exit__(
        &self,
        python: Python<'_>,
        _kind: &Bound<'_, PyAny>,
        exception: &Bound<'_, PyAny>,
        _traceback: &Bound<'_, PyAny>,
    ) -> PyResult<bool> {
        if exception.is_instance_of::<pyo3::exceptions::PyException>() && self.is_open(python) {
            self.failed(python, exception.repr()?.to_string())?;
        } else {
            self.abandon(python);
        }
        Ok(false)
    }
}
