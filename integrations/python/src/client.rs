//! The connection and the study.

use std::collections::HashMap;
use std::path::PathBuf;
use std::time::Duration;

use pyo3::prelude::*;
use pyo3::types::PyDict;
use treewright_client::{
    Credentials, Front, FrontQuery, Operation, Options, Policy, PolicyChange, StudySpec, TextChange,
    TrialQuery, blocking, local::LocalDaemon,
};

use crate::best::Best;
use crate::convert::{Named, Numbers, configuration_of};
use crate::error::{Invalid, raised};
use crate::prediction::Prediction;
use crate::space::{Ends, Range, Space};
use crate::suggestion::{Suggestion, Tuner};

/// Longest deadline, in milliseconds: an hour.
const DEADLINE_MS_MAX: f64 = 3.6e6;

/// A connection to a daemon, with a thread of its own. May be shared between threads. In the child of a fork
/// it connects again at its first use, as another worker under its name.
#[pyclass(module = "treewright", frozen)]
pub(crate) struct Client(blocking::Client);

fn milliseconds(ms: f64) -> PyResult<Duration> {
    if (0.0..=DEADLINE_MS_MAX).contains(&ms) {
        return Ok(Duration::from_secs_f64(ms / 1e3));
    }
    Err(Invalid::new_err(format!("a deadline of {ms} ms is not within 0 to {DEADLINE_MS_MAX}")))
}

/// A field of a policy as it is written. Python writes `True`; a configuration is spelt as its study does.
fn words(field: &str, value: &Bound<'_, PyAny>) -> PyResult<String> {
    let text = value.str()?.to_string();
    Ok(if field == "pinned" { text } else { text.to_lowercase() })
}

pub(crate) fn policy_of(fields: Named<Bound<'_, PyAny>>) -> PyResult<Policy> {
    let mut policy = Policy::new();
    for (field, value) in fields.0 {
        policy.set_text(&field, &words(&field, &value)?).map_err(|error| raised(error.into()))?;
    }
    Ok(policy)
}

impl Client {
    pub(crate) fn inner(&self) -> &blocking::Client {
        &self.0
    }

    fn holding(&self, study: blocking::Study) -> Study {
        Study(study, self.0.clone())
    }
}

#[pymethods]
impl Client {
    #[new]
    #[pyo3(signature = (url="http://127.0.0.1:50611", *, client_id=None, deadline_ms=50.0, call_deadline_ms=5000.0, queue=1024,
        can_abort=false, fidelities=false, token=None, token_file=None, authority_file=None, certificate_file=None, key_file=None,
        software=Named::default()))]
    #[allow(clippy::too_many_arguments)] // keywords of Python
    fn new(
        python: Python<'_>,
        url: &str,
        client_id: Option<String>,
        deadline_ms: f64,
        call_deadline_ms: f64,
        queue: usize,
        can_abort: bool,
        fidelities: bool,
        token: Option<&str>,
        token_file: Option<PathBuf>,
        authority_file: Option<PathBuf>,
        certificate_file: Option<PathBuf>,
        key_file: Option<PathBuf>,
        software: Named<String>,
    ) -> PyResult<Self> {
        let mut options = Options::new()
            .deadline(milliseconds(deadline_ms)?)
            .call_deadline(milliseconds(call_deadline_ms)?)
            .queue(queue)
            .can_abort(can_abort)
            .fidelities(fidelities);
        if let Some(client_id) = client_id {
            options = options.client_id(client_id);
        }
        for (name, version) in software.0 {
            options.fingerprint = options.fingerprint.software(name, version);
        }
        let mut credentials = match (token, token_file) {
            (Some(token), None) => Credentials::new().token(token).map_err(raised)?,
            (None, Some(path)) => Credentials::new().token_file(&path).map_err(raised)?,
            (None, None) => Credentials::new(),
            (Some(_), Some(_)) => return Err(Invalid::new_err("give either token or token_file")),
        };
        if let Some(path) = authority_file {
            credentials = credentials.authority_file(&path).map_err(raised)?;
        }
        credentials = match (certificate_file, key_file) {
            (Some(certificate), Some(key)) => {
                credentials.certificate_files(&certificate, &key).map_err(raised)?
            }
            (None, None) => credentials,
            _ => return Err(Invalid::new_err("certificate_file and key_file go together: give both")),
        };
        let options = options.credentials(credentials);
        python.detach(|| blocking::Client::connect(url, options)).map(Self).map_err(raised)
    }

    /// A client of the user's own daemon, which is started where it is not running and ends by itself when
    /// nobody has asked it anything for ten minutes. It is the one that the package holds, and its database
    /// lies in ``~/.local/share/treewright``. Options are those of ``Client``. Raises Unreachable when it
    /// cannot be started.
    #[staticmethod]
    #[pyo3(signature = (**options))]
    fn local<'py>(python: Python<'py>, options: Option<&Bound<'py, PyDict>>) -> PyResult<Bound<'py, PyAny>> {
        let program = python.import("treewright.programs")?.call_method1("held", ("treewrightd",))?;
        let program: Option<PathBuf> = program.extract()?;
        let start = || {
            let daemon = LocalDaemon::of_user()?;
            program.map_or(daemon.clone(), |program| daemon.with_program(program)).start(|_| {})
        };
        let url = python.detach(start).map_err(raised)?;
        python.get_type::<Self>().call((url,), options)
    }

    /// The address that it was made with.
    #[getter]
    fn url(&self) -> String {
        self.0.url().to_owned()
    }

    /// Creates the study, or finds the equal one of that id. An absent daemon is no error: it is created when
    /// it is there.
    ///
    /// ``minimise`` has the weight of each measurement, of which the weighted sum is the objective. What is
    /// to be large, such as a rate, stands in ``maximise``: its weight over the measurement is added.
    /// ``indicators`` describe the input: the lowest and the highest value of each, and ``"log"`` where
    /// factors count; larger and smaller values are taken, too. ``policy`` is how the daemon decides, e.g.
    /// ``{"epsilon": 0.1}``; see ``Study.policy``. ``limits`` say what measurements may be at least and at
    /// most, e.g. ``{"memory_mb": (None, 2000)}``; a configuration that goes beyond is infeasible.
    /// ``episode_frames`` is how many frames make a trial, for costs that rise or fall while a configuration
    /// is in use; see ``Tuner``. ``fidelities`` are cheaper levels, e.g. ``{"16": 0.1}``: the cost of a trial
    /// there as a share of a full one.
    #[pyo3(signature = (id, space, *, minimise=Named::default(), maximise=Named::default(), indicators=Named::default(),
        auxiliary=Vec::new(), limits=Named::default(), policy=Named::default(), display_name=String::new(), state_tolerance=None, seed=0,
        episode_frames=1, fidelities=Named::default()))]
    #[allow(clippy::too_many_arguments)] // keywords of Python
    fn study(
        &self,
        python: Python<'_>,
        id: &str,
        space: &Space,
        minimise: Numbers,
        maximise: Numbers,
        indicators: Named<Range>,
        auxiliary: Vec<String>,
        limits: Named<Ends>,
        policy: Named<Bound<'_, PyAny>>,
        display_name: String,
        state_tolerance: Option<f64>,
        seed: u64,
        episode_frames: u32,
        fidelities: Numbers,
    ) -> PyResult<Study> {
        let mut study = StudySpec::builder(space.build().map_err(raised)?)
            .display_name(display_name)
            .episode_frames(episode_frames)
            .seed(seed)
            .policy(policy_of(policy)?);
        // By name: dictionaries have no order here, and the order is part of what a study is.
        for (name, range) in indicators.0 {
            let (range, scale) = range.read()?;
            study = study.indicator(&name, range, scale);
        }
        study = minimise.0.iter().fold(study, |study, (metric, weight)| study.minimise(metric, *weight));
        study = maximise.0.iter().fold(study, |study, (metric, weight)| study.maximise(metric, *weight));
        study = auxiliary.iter().fold(study, |study, metric| study.auxiliary(metric));
        for (metric, (at_least, at_most)) in limits.0 {
            study = study.limit(&metric, at_least, at_most);
        }
        // A dictionary does not say which is the cheapest.
        let mut levels: Vec<(String, f64)> = fidelities.0.into_iter().collect();
        levels.sort_by(|a, b| a.1.total_cmp(&b.1));
        study = levels.into_iter().fold(study, |study, (name, cost)| study.fidelity(name, cost));
        if let Some(tolerance) = state_tolerance {
            study = study.state_tolerance(tolerance);
        }
        let spec = study.build().map_err(|error| raised(error.into()))?;
        python.detach(|| self.0.study(id, spec)).map(|study| self.holding(study)).map_err(raised)
    }

    /// A study that exists. Raises Refused when there is none.
    fn existing_study(&self, python: Python<'_>, id: &str) -> PyResult<Study> {
        python.detach(|| self.0.existing_study(id)).map(|study| self.holding(study)).map_err(raised)
    }

    /// Changes the space of a study for all programs. Trials stay; those outside the new space are not used.
    /// Programs that know the space of before go on in it; ``study`` with the new one works in that.
    /// ``fixed`` has values of parameters that are added or removed, where they are not the defaults. Of an
    /// added parameter it is the value of all trials before, of a removed one that of all trials from now on.
    /// With ``only_try`` nothing is changed. Returns the ``revision`` of the space, and the numbers of
    /// trials: ``kept_trials``, ``outside_trials`` and open ones that were given back, ``given_back_trials``.
    /// Raises Invalid for a space with mistakes, and Refused where the daemon will not do it.
    #[pyo3(signature = (id, space, *, fixed=None, only_try=false))]
    fn change_space<'py>(
        &self,
        python: Python<'py>,
        id: &str,
        space: &Space,
        fixed: Option<&Bound<'_, PyAny>>,
        only_try: bool,
    ) -> PyResult<Bound<'py, PyDict>> {
        let space = space.build().map_err(raised)?;
        let fixed = fixed.map(configuration_of).transpose()?.unwrap_or_default();
        let change = || {
            let study = self.0.get_study(id)?;
            let (name, revision) = (study.identified_name(), study.space_revision);
            self.0.change_space(&name, revision, &space, &fixed, only_try)
        };
        let changed = python.detach(change).map_err(raised)?;
        let shown = PyDict::new(python);
        shown.set_item("revision", changed.study.space_revision)?;
        shown.set_item("kept_trials", changed.kept_trials)?;
        shown.set_item("outside_trials", changed.outside_trials)?;
        shown.set_item("given_back_trials", changed.given_back_trials)?;
        Ok(shown)
    }

    /// Deletes a study with all that was learnt.
    fn delete_study(&self, python: Python<'_>, id: &str) -> PyResult<()> {
        python.detach(|| self.0.delete_study(id)).map_err(raised)
    }

    /// The ids of all studies.
    fn studies(&self, python: Python<'_>) -> PyResult<Vec<String>> {
        let studies = python.detach(|| self.0.list_studies()).map_err(raised)?;
        Ok(studies.iter().map(|study| study.id().to_owned()).collect())
    }

    /// Waits until every report is acknowledged. Raises Unreachable when some are not.
    #[pyo3(signature = (deadline_ms=5000.0))]
    fn flush(&self, python: Python<'_>, deadline_ms: f64) -> PyResult<()> {
        let deadline = milliseconds(deadline_ms)?;
        python.detach(|| self.0.flush(deadline)).map_err(raised)
    }

    /// How long the daemon takes to answer, in milliseconds.
    fn ping_ms(&self, python: Python<'_>) -> PyResult<f64> {
        python.detach(|| self.0.ping()).map(|took| took.as_secs_f64() * 1e3).map_err(raised)
    }

    /// Counts of suggestions and reports since the client was made.
    fn stats<'py>(&self, python: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let stats = self.0.stats();
        let shown = PyDict::new(python);
        for (name, count) in [
            ("suggestions", stats.suggestions),
            ("fallbacks", stats.fallbacks),
            ("unreported", stats.unreported),
            ("sent", stats.sent),
            ("acknowledged", stats.acknowledged),
            ("duplicates", stats.duplicates),
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

/// A study: asks for suggestions, and for known results. May be shared between threads and tasks.
#[pyclass(module = "treewright", frozen)]
pub(crate) struct Study(blocking::Study, blocking::Client);

impl Study {
    fn change(&self, python: Python<'_>, change: &PolicyChange) -> PyResult<()> {
        python.detach(|| self.1.update_policy(&self.0.identified_name(), change)).map(drop).map_err(raised)
    }
}

#[pymethods]
impl Study {
    /// Its resource name, ``studies/ID``.
    #[getter]
    fn name(&self) -> &str {
        self.0.name()
    }

    /// The measurements that a report has to hold, each with its weight in the objective.
    #[getter]
    fn metrics(&self) -> HashMap<String, f64> {
        let terms = self.0.spec().objective.terms();
        terms.iter().map(|term| (term.metric.clone(), term.weight)).collect()
    }

    /// Those of the metrics that are maximised: the objective counts their weights over the measurements.
    #[getter]
    fn maximised(&self) -> Vec<String> {
        self.0.spec().objective.maximised().to_vec()
    }

    /// Number of frames of a trial. The report of a trial from ``suggest`` holds the means over them.
    #[getter]
    fn episode_frames(&self) -> u32 {
        self.0.spec().objective.episode_frames()
    }

    /// The study's objective of measurements, which is minimised. Raises Invalid where one is missing, or is
    /// not what it may be.
    fn cost(&self, measured: Numbers) -> PyResult<f64> {
        self.0.spec().objective.cost(&measured.0).map_err(|error| Invalid::new_err(error.to_string()))
    }

    /// The first limit of the study that measurements are beyond, in words; None where they are within all of
    /// them. What is beyond a limit is infeasible, whatever it costs. Raises Invalid where one is missing.
    fn beyond(&self, measured: Numbers) -> PyResult<Option<String>> {
        self.0.spec().objective.beyond(&measured.0).map_err(|error| Invalid::new_err(error.to_string()))
    }

    /// The value behind a cost: the metric where one is maximised and nothing else counts, else the cost.
    fn value(&self, cost: f64) -> f64 {
        self.0.spec().objective.view().value(cost)
    }

    /// The name of such values: "cost", or the metric and that higher is better.
    #[getter]
    fn value_title(&self) -> String {
        self.0.spec().objective.view().title()
    }

    /// Waits until every report of its client is acknowledged. Raises Unreachable when some are not.
    #[pyo3(signature = (deadline_ms=5000.0))]
    fn flush(&self, python: Python<'_>, deadline_ms: f64) -> PyResult<()> {
        let deadline = milliseconds(deadline_ms)?;
        python.detach(|| self.1.flush(deadline)).map_err(raised)
    }

    /// How the daemon decides: each field as it is written. Fields that are left to themselves are not there.
    fn policy(&self, python: Python<'_>) -> PyResult<HashMap<&'static str, String>> {
        let policy = python.detach(|| self.0.record()).map_err(raised)?.policy;
        let field = |name: &'static str| policy.show(name).map(|value| (name, value));
        Ok(Policy::FIELDS.iter().filter_map(|one| field(one.name)).collect())
    }

    /// Changes fields of the policy for all clients; None gives one its default back. Raises Invalid for a
    /// field that there is not, and for a value out of its range.
    #[pyo3(signature = (**fields))]
    fn set_policy(
        &self,
        python: Python<'_>,
        fields: Option<HashMap<String, Bound<'_, PyAny>>>,
    ) -> PyResult<()> {
        let mut change = PolicyChange::default();
        for (field, value) in fields.unwrap_or_default() {
            if value.is_none() {
                change.clear.push(field);
            } else {
                change.set.set_text(&field, &words(&field, &value)?).map_err(|error| raised(error.into()))?;
            }
        }
        self.change(python, &change)
    }

    /// The note for people, as it is stored.
    fn note(&self, python: Python<'_>) -> PyResult<String> {
        Ok(python.detach(|| self.0.record()).map_err(raised)?.note)
    }

    /// The words by which people group studies, sorted, as they are stored.
    fn tags(&self, python: Python<'_>) -> PyResult<Vec<String>> {
        Ok(python.detach(|| self.0.record()).map_err(raised)?.tags.into_iter().collect())
    }

    /// Changes the texts for people; what is None stays as it is. ``tags`` are all from now on. Raises
    /// Refused for what is too long, or no tag.
    #[pyo3(signature = (*, display_name=None, note=None, tags=None))]
    fn set_texts(
        &self,
        python: Python<'_>,
        display_name: Option<String>,
        note: Option<String>,
        tags: Option<Vec<String>>,
    ) -> PyResult<()> {
        let tags = tags.map(|tags| tags.into_iter().collect());
        let change = TextChange { display_name, note, tags, ..TextChange::default() };
        python.detach(|| self.1.update_texts(&self.0.identified_name(), &change)).map(drop).map_err(raised)
    }

    /// Neither explores nor learns any more, until ``thaw``: answers stay what they are.
    fn freeze(&self, python: Python<'_>) -> PyResult<()> {
        self.change(python, &PolicyChange::set(Policy::new().operation(Operation::Freeze)))
    }

    /// Explores and learns again.
    fn thaw(&self, python: Python<'_>) -> PyResult<()> {
        self.change(python, &PolicyChange::clear(["operation"]))
    }

    /// Gives every client this configuration, until ``unpin``. Parameters that are not named have their
    /// defaults.
    fn pin(&self, python: Python<'_>, configuration: &Bound<'_, PyAny>) -> PyResult<()> {
        let wanted = configuration_of(configuration)?;
        let whole = self.0.spec().space.complete(&wanted).map_err(|error| raised(error.into()))?;
        self.change(python, &PolicyChange::set(Policy::new().pinned(whole)))
    }

    /// Undoes ``pin``.
    fn unpin(&self, python: Python<'_>) -> PyResult<()> {
        self.change(python, &PolicyChange::unpin())
    }

    fn __repr__(&self) -> String {
        format!("<Study {}>", self.0.name())
    }

    /// The next configuration to run, within the deadline. Without the daemon it is the last good
    /// configuration, or the default; see Suggestion.problem. Each suggestion that is open is a trial of its
    /// own, whichever thread or task asked for it. Raises Invalid for wrong indicators.
    #[pyo3(signature = (indicators=None))]
    fn suggest(&self, python: Python<'_>, indicators: Option<Numbers>) -> PyResult<Suggestion> {
        let numbers = crate::convert::indicators(indicators);
        Suggestion::checked(python.detach(|| self.0.suggest(&numbers)))
    }

    /// A trial of the caller's own configuration. Raises where no daemon answers.
    #[pyo3(signature = (configuration, indicators=None))]
    fn trial_of(
        &self,
        python: Python<'_>,
        configuration: &Bound<'_, PyAny>,
        indicators: Option<Numbers>,
    ) -> PyResult<Suggestion> {
        let (wanted, numbers) = (configuration_of(configuration)?, crate::convert::indicators(indicators));
        python.detach(|| self.0.trial_of(&numbers, &wanted)).map(Suggestion::new).map_err(raised)
    }

    /// Sets what this program runs by default, where that is not the study's default; None for that.
    /// Parameters that are not named have their defaults. It is measured first in a state, and answers there
    /// are what is better than it. Raises Invalid for one that does not fit the space.
    #[pyo3(signature = (configuration=None))]
    fn set_start(&self, configuration: Option<&Bound<'_, PyAny>>) -> PyResult<()> {
        let Some(given) = configuration else { return self.0.set_start(None).map_err(raised) };
        let whole = self.0.spec().space.complete(&configuration_of(given)?);
        let whole = whole.map_err(|error| raised(error.into()))?;
        self.0.set_start(Some(&whole.into())).map_err(raised)
    }

    /// Renews the lease of an open suggestion, counted from now, for work that takes longer than ``lease_s``
    /// of the policy. Does nothing for one that came without the daemon. Raises Invalid where it is reported
    /// or given back, and Refused where the daemon has ended its trial.
    fn extend_lease(&self, python: Python<'_>, suggestion: &Suggestion) -> PyResult<()> {
        let Some(trial) = suggestion.open_trial()? else { return Ok(()) };
        python.detach(|| self.1.renew(trial)).map(drop).map_err(raised)
    }

    /// The configuration that would be exploited, and the predicted objective: the result unpacks into both.
    /// Writes nothing. Raises Invalid for wrong indicators.
    #[pyo3(signature = (indicators=None))]
    fn predict(&self, python: Python<'_>, indicators: Option<Numbers>) -> PyResult<Prediction> {
        let numbers = crate::convert::indicators(indicators);
        python.detach(|| self.0.predict(&numbers)).map(Prediction::new).map_err(raised)
    }

    /// The best known, which unpacks into a configuration and its mean objective, and tells what is proven of
    /// it; of all states without indicators. Raises Invalid for wrong indicators, and Refused when nothing
    /// was measured.
    #[pyo3(signature = (indicators=None))]
    fn best(&self, python: Python<'_>, indicators: Option<Numbers>) -> PyResult<Best> {
        let numbers = crate::convert::indicators(indicators);
        let best = python.detach(|| self.0.best(&numbers)).map_err(raised)?;
        Ok(Best::new(best, &self.0.spec().objective.view()))
    }

    /// The stored trials that match, e.g. ``state = COMPLETED AND cost < 12.5``; by number, or by ``cost`` or
    /// ``measurement.NAME``, each with an optional `` desc``. ``study.trials().to_pandas()`` is a table.
    #[pyo3(signature = (filter="", order_by=""))]
    fn trials<'py>(&self, python: Python<'py>, filter: &str, order_by: &str) -> PyResult<Bound<'py, PyAny>> {
        let query = TrialQuery::all().filter(filter).order_by(order_by);
        crate::trials::read(python, &self.1, &self.0.identified_name(), query)
    }

    /// The Pareto front of the stored trials, as a ``treewright.front.ParetoFront``, whatever the study
    /// minimises. ``metrics`` are two or three measurements, with ``1/rate`` for one that is to be large; by
    /// default those that the study was made for. ``state`` is the ``state_id`` of a trial, needed where
    /// trials are of several inputs or machines. ``reference`` is a value of each metric, to which the
    /// hypervolume refers; by default those of the default. Trials that are excluded or ran at a cheaper
    /// level do not count. Raises Invalid where there is no such front.
    #[pyo3(signature = (metrics=None, *, state=None, reference=None))]
    fn front<'py>(
        &self,
        python: Python<'py>,
        metrics: Option<Vec<String>>,
        state: Option<i64>,
        reference: Option<Vec<f64>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let front = metrics.map(|metrics| Front::new(&metrics)).transpose();
        let query = FrontQuery { front: front.map_err(|error| raised(error.into()))?, state, reference };
        let found = python.detach(|| self.0.front(&query)).map_err(raised)?;
        crate::pareto::front(python, &found)
    }

    /// A frame loop, in which report and question travel together.
    fn tuner(&self, python: Python<'_>) -> Tuner {
        Tuner::new(python.detach(|| self.0.tuner()))
    }
}
