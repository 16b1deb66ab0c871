//! The connection and the study.

use std::collections::HashMap;
use std::time::Duration;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use treewright_client::{Credentials, Options, blocking};

use crate::convert::{Numbers, configuration_of, shown};
use crate::error::{Invalid, raised};
use crate::space::{Definition, Range, Space};
use crate::suggestion::{Suggestion, Tuner};

/// Longest deadline, in milliseconds: an hour.
const DEADLINE_MS_MAX: f64 = 3.6e6;

/// See the stubs.
#[pyclass(module = "treewright", frozen)]
pub(crate) struct Client(blocking::Client);

fn milliseconds(ms: f64) -> PyResult<Duration> {
    if (0.0..=DEADLINE_MS_MAX).contains(&ms) {
        return Ok(Duration::from_secs_f64(ms / 1e3));
    }
    Err(Invalid::new_err(format!("a deadline of {ms} ms is not within 0 to {DEADLINE_MS_MAX}")))
}

#[pymethods]
impl Client {
    #[new]
    #[pyo3(signature = (url="http://127.0.0.1:50611", *, client_id=None, deadline_ms=50.0, call_deadline_ms=5000.0, queue=1024,
        can_abort=false, token=None, authority_file=None, software=HashMap::new()))]
    #[allow(clippy::too_many_arguments)] // keywords of Python
    fn new(
        python: Python<'_>,
        url: &str,
        client_id: Option<String>,
        deadline_ms: f64,
        call_deadline_ms: f64,
        queue: usize,
        can_abort: bool,
        token: Option<&str>,
        authority_file: Option<std::path::PathBuf>,
        software: HashMap<String, String>,
    ) -> PyResult<Self> {
        let mut options = Options::new()
            .deadline(milliseconds(deadline_ms)?)
            .call_deadline(milliseconds(call_deadline_ms)?)
            .queue(queue)
            .can_abort(can_abort);
        if let Some(client_id) = client_id {
            options = options.client_id(client_id);
        }
        for (name, version) in software {
            options.fingerprint = options.fingerprint.software(name, version);
        }
        let mut credentials = Credentials::new();
        if let Some(token) = token {
            credentials = credentials.token(token).map_err(raised)?;
        }
        if let Some(path) = authority_file {
            credentials = credentials.authority_file(&path).map_err(raised)?;
        }
        let options = options.credentials(credentials);
        python.detach(|| blocking::Client::connect(url, options)).map(Self).map_err(raised)
    }

    #[pyo3(signature = (id, space, *, minimise, indicators=HashMap::new(), auxiliary=Vec::new(), policy=HashMap::new(),
        display_name=String::new(), state_tolerance=None, seed=0))]
    #[allow(clippy::too_many_arguments)] // keywords of Python
    fn study(
        &self,
        python: Python<'_>,
        id: &str,
        space: &Space,
        minimise: &Bound<'_, PyDict>,
        indicators: HashMap<String, Range>,
        auxiliary: Vec<String>,
        policy: HashMap<String, Bound<'_, PyAny>>,
        display_name: String,
        state_tolerance: Option<f64>,
        seed: u64,
    ) -> PyResult<Study> {
        let mut indicators: Vec<_> = indicators.into_iter().collect();
        // Dictionaries have no order here, and the order is part of what a study is.
        indicators.sort_by(|a, b| a.0.cmp(&b.0));
        let mut terms: Vec<(String, f64)> = minimise.extract::<HashMap<_, _>>()?.into_iter().collect();
        terms.sort_by(|a, b| a.0.cmp(&b.0));
        let words =
            |(field, value): (String, Bound<'_, PyAny>)| Ok((field, value.str()?.to_string().to_lowercase()));
        let policy = policy.into_iter().map(words).collect::<PyResult<_>>()?;
        let definition = Definition {
            indicators,
            minimise: terms,
            auxiliary,
            policy,
            display_name,
            state_tolerance,
            seed,
        };
        let spec = definition.spec(space)?;
        python.detach(|| self.0.study(id, spec)).map(Study).map_err(raised)
    }

    fn existing_study(&self, python: Python<'_>, id: &str) -> PyResult<Study> {
        python.detach(|| self.0.existing_study(id)).map(Study).map_err(raised)
    }

    fn delete_study(&self, python: Python<'_>, id: &str) -> PyResult<()> {
        python.detach(|| self.0.delete_study(id)).map_err(raised)
    }

    fn studies(&self, python: Python<'_>) -> PyResult<Vec<String>> {
        let studies = python.detach(|| self.0.list_studies()).map_err(raised)?;
        Ok(studies.iter().map(|study| study.id().to_owned()).collect())
    }

    #[pyo3(signature = (deadline_ms=5000.0))]
    fn flush(&self, python: Python<'_>, deadline_ms: f64) -> PyResult<()> {
        let deadline = milliseconds(deadline_ms)?;
        python.detach(|| self.0.flush(deadline)).map_err(raised)
    }

    fn ping_ms(&self, python: Python<'_>) -> PyResult<f64> {
        python.detach(|| self.0.ping()).map(|took| took.as_secs_f64() * 1e3).map_err(raised)
    }

    fn stats<'py>(&self, python: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let stats = self.0.stats();
        let shown = PyDict::new(python);
        for (name, count) in [
            ("suggestions", stats.suggestions),
            ("fallbacks", stats.fallbacks),
            ("unreported", stats.unreported),
            ("sent", stats.sent),
            ("acknowledged", stats.acknowledged),
            ("resent", stats.resent),
            ("refused", stats.refused),
            ("dropped", stats.dropped),
            ("abandoned", stats.abandoned),
            ("queued", stats.queued),
        ] {
            shown.set_item(name, count)?;
        }
        shown.set_item("last_error", stats.last_error)?;
        Ok(shown)
    }
}

/// See the stubs.
#[pyclass(module = "treewright", frozen)]
pub(crate) struct Study(blocking::Study);

#[pymethods]
impl Study {
    #[getter]
    fn name(&self) -> &str {
        self.0.name()
    }

    #[pyo3(signature = (indicators=None))]
    fn suggest(&self, python: Python<'_>, indicators: Option<Numbers>) -> Suggestion {
        let numbers = crate::convert::indicators(indicators);
        Suggestion::new(python.detach(|| self.0.suggest(&numbers)))
    }

    #[pyo3(signature = (configuration, indicators=None))]
    fn trial_of(
        &self,
        python: Python<'_>,
        configuration: &Bound<'_, PyDict>,
        indicators: Option<Numbers>,
    ) -> PyResult<Suggestion> {
        let (wanted, numbers) = (configuration_of(configuration)?, crate::convert::indicators(indicators));
        python.detach(|| self.0.trial_of(&numbers, &wanted)).map(Suggestion::new).map_err(raised)
    }

    #[pyo3(signature = (indicators=None))]
    fn predict<'py>(
        &self,
        python: Python<'py>,
        indicators: Option<Numbers>,
    ) -> PyResult<(Bound<'py, PyDict>, Option<f64>)> {
        let numbers = crate::convert::indicators(indicators);
        let known = python.detach(|| self.0.predict(&numbers)).map_err(raised)?;
        Ok((shown(python, &known.configuration)?, known.predicted_cost))
    }

    #[pyo3(signature = (indicators=None))]
    fn best<'py>(
        &self,
        python: Python<'py>,
        indicators: Option<Numbers>,
    ) -> PyResult<(Bound<'py, PyDict>, f64)> {
        let numbers = crate::convert::indicators(indicators);
        let best = python.detach(|| self.0.best(&numbers)).map_err(raised)?;
        Ok((shown(python, &best.configuration)?, best.cost))
    }

    fn tuner(&self, python: Python<'_>) -> Tuner {
        Tuner::new(python.detach(|| self.0.tuner()))
    }
}
