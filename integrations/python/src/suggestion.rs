//! Suggestions, and the frame loop.

use std::sync::{Mutex, MutexGuard, PoisonError};

use pyo3::prelude::*;
use treewright_client::{ClientError, Finished, Measurements, Outcome, Source, blocking};

use crate::convert::{Numbers, Shown};
use crate::error::{Invalid, raised};

/// The next configuration to run, and its trial. Report it, or give it back. Leaving a ``with`` block gives
/// back an open trial, and reports an exception as the trial's failure.
#[pyclass(module = "treewright", frozen)]
pub(crate) struct Suggestion {
    /// The configuration to run with.
    #[pyo3(get)]
    configuration: Shown,
    /// Where it came from: daemon, last_good or default.
    #[pyo3(get)]
    source: &'static str,
    /// Name of its trial; None without the daemon.
    #[pyo3(get)]
    trial: Option<String>,
    /// Why this configuration, in a sentence.
    #[pyo3(get)]
    reason: String,
    /// Why the daemon was not the source; None when it was.
    #[pyo3(get)]
    problem: Option<String>,
    /// The predicted objective, where something is known.
    #[pyo3(get)]
    predicted_cost: Option<f64>,
    /// Stop as soon as the objective exceeds this, and call aborted; None is never.
    #[pyo3(get)]
    abort_above: Option<f64>,
    /// The cheaper level at which to run; None for a full trial.
    #[pyo3(get)]
    fidelity: Option<String>,
    /// Whether what was set up for the trial before serves this one: that was measured to its end, with these
    /// values of all parameters with setup. Always false for loops that run side by side in a process.
    #[pyo3(get)]
    is_prepared: bool,
    /// Until it is reported or given back.
    open: Mutex<Option<treewright_client::Suggestion>>,
}

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

pub(crate) fn ended() -> PyErr {
    Invalid::new_err("this trial is reported or given back already")
}

impl Suggestion {
    pub(crate) fn new(inner: treewright_client::Suggestion) -> Self {
        Self {
            configuration: Shown(inner.configuration().clone()),
            source: match inner.source() {
                Source::Daemon => "daemon",
                Source::LastGood => "last_good",
                Source::Default => "default",
            },
            trial: inner.trial().map(str::to_owned),
            reason: inner.reason().summary.clone(),
            problem: inner.problem().map(ToString::to_string),
            predicted_cost: inner.predicted_cost(),
            abort_above: inner.abort_above(),
            fidelity: inner.fidelity().map(str::to_owned),
            is_prepared: inner.is_prepared(),
            open: Mutex::new(Some(inner)),
        }
    }

    /// A wrong question raises its error: it will not pass, and the fallback would hide it.
    pub(crate) fn checked(inner: treewright_client::Suggestion) -> PyResult<Self> {
        match inner.problem() {
            Some(problem @ ClientError::Invalid { .. }) => Err(raised(problem.clone())),
            _ => Ok(Self::new(inner)),
        }
    }

    fn take(&self) -> PyResult<treewright_client::Suggestion> {
        lock(&self.open).take().ok_or_else(ended)
    }

    /// Its trial, which is neither reported nor given back; none without the daemon.
    pub(crate) fn open_trial(&self) -> PyResult<Option<&str>> {
        if self.is_open() { Ok(self.trial.as_deref()) } else { Err(ended()) }
    }

    fn end(&self, measured: Measurements, outcome: Outcome) -> PyResult<()> {
        self.take()?.report(measured, outcome).map_err(raised)
    }
}

#[pymethods]
impl Suggestion {
    /// Whether it is neither reported nor given back.
    #[getter]
    fn is_open(&self) -> bool {
        lock(&self.open).is_some()
    }

    fn __getitem__<'py>(&self, python: Python<'py>, name: &str) -> PyResult<Bound<'py, PyAny>> {
        let known = self.configuration.into_pyobject(python)?;
        known.get_item(name)?.ok_or_else(|| pyo3::exceptions::PyKeyError::new_err(name.to_owned()))
    }

    /// Ends the trial with what was measured; returns at once, and the report is sent in the background.
    /// Standard errors are those of measurements that are estimates, by name: poor ones count for less.
    #[pyo3(signature = (measurements=None, /, *, standard_errors=None, **named))]
    fn report(
        &self,
        measurements: Option<Numbers>,
        standard_errors: Option<Numbers>,
        named: Option<Numbers>,
    ) -> PyResult<()> {
        let measured = crate::convert::measurements(measurements, named, standard_errors);
        self.end(measured, Outcome::Ok)
    }

    /// It was stopped early: the objective is at least this.
    fn aborted(&self, lower_bound: f64) -> PyResult<()> {
        self.end(Measurements::new(), Outcome::aborted(lower_bound))
    }

    /// The configuration cannot work for this input.
    fn infeasible(&self, reason: String) -> PyResult<()> {
        self.end(Measurements::new(), Outcome::infeasible(reason))
    }

    /// It failed for a reason that says nothing about the configuration.
    fn failed(&self, reason: String) -> PyResult<()> {
        self.end(Measurements::new(), Outcome::failed(reason))
    }

    /// Gives the trial back unmeasured.
    fn abandon(&self) {
        drop(lock(&self.open).take());
    }

    fn __enter__(this: PyRef<'_, Self>) -> PyRef<'_, Self> {
        this
    }

    /// An exception is the trial's failure, which says nothing about the configuration; an open trial is
    /// given back.
    fn __exit__(
        &self,
        _kind: &Bound<'_, PyAny>,
        exception: &Bound<'_, PyAny>,
        _traceback: &Bound<'_, PyAny>,
    ) -> PyResult<bool> {
        let open = lock(&self.open).take();
        if let Some(inner) = open
            && exception.is_instance_of::<pyo3::exceptions::PyException>()
        {
            inner
                .report(Measurements::new(), Outcome::failed(exception.repr()?.to_string()))
                .map_err(raised)?;
        }
        Ok(false)
    }

    fn __repr__(&self) -> String {
        format!("<Suggestion {} from {}>", self.configuration.0, self.source)
    }
}

/// A frame loop in which report and question travel together. Used by one thread; each has a tuner of its
/// own. Where ``episode_frames`` of the study is above 1, it keeps a trial for that number of frames without
/// asking, and reports their means. In another state it gives an unfinished trial back.
#[pyclass(module = "treewright", frozen)]
pub(crate) struct Tuner(Mutex<(blocking::Tuner, Option<Finished>)>);

impl Tuner {
    pub(crate) fn new(tuner: blocking::Tuner) -> Self {
        Self(Mutex::new((tuner, None)))
    }
}

#[pymethods]
impl Tuner {
    /// The configuration to run in this frame; sends the report that finish left. Raises Invalid for wrong
    /// indicators.
    #[pyo3(signature = (indicators=None))]
    fn next(&self, python: Python<'_>, indicators: Option<Numbers>) -> PyResult<Suggestion> {
        let numbers = crate::convert::indicators(indicators);
        Suggestion::checked(python.detach(|| {
            let mut frames = lock(&self.0);
            let previous = frames.1.take();
            frames.0.next(&numbers, previous)
        }))
    }

    /// Keeps the frame's result for the next question.
    #[pyo3(signature = (suggestion, measurements=None, /, *, standard_errors=None, **named))]
    fn finish(
        &self,
        python: Python<'_>,
        suggestion: &Suggestion,
        measurements: Option<Numbers>,
        standard_errors: Option<Numbers>,
        named: Option<Numbers>,
    ) -> PyResult<()> {
        let measured = crate::convert::measurements(measurements, named, standard_errors);
        let finished = suggestion.take()?.finished(measured, Outcome::Ok).map_err(raised)?;
        // The lock may be held by a call that waits and needs no interpreter.
        drop(python.detach(|| lock(&self.0).1.replace(finished)));
        Ok(())
    }
}
