//! Pareto fronts: the runs that look for them, and what was found, as C reads it.

use std::ffi::{CString, c_char};
use std::sync::Arc;

use treewright_client::{
    ClientError, FrontLoop, FrontQuery, Measurements, Outcome, ParetoFront, TrialRecord,
};

use crate::client::Client;
use crate::configuration::Configuration;
use crate::edge::{Array, ErrorOut, Number, Text, guard, measurements, need};
use crate::error::{Failure, c_text};
use crate::spec::Spec;
use crate::study::Study;

#[derive(Debug)]
pub(crate) struct Front(CString);

impl Front {
    fn new(found: &ParetoFront) -> Self {
        Self(c_text(&serde_json::to_string(found).unwrap_or_default()))
    }
}

#[derive(Debug)]
pub(crate) struct FrontRuns(Arc<FrontLoop>);

/// One of them. Used by one thread at a time.
#[derive(Debug)]
pub(crate) struct FrontRun {
    runs: Arc<FrontLoop>,
    record: TrialRecord,
    configuration: Configuration,
    trial: CString,
}

impl FrontRun {
    fn new(runs: &Arc<FrontLoop>, record: TrialRecord) -> Self {
        let configuration = Configuration::new(record.configuration.clone());
        Self { runs: Arc::clone(runs), configuration, trial: c_text(&record.name), record }
    }
}

/// Metrics that C names; `None` where it names none.
fn named(metrics: Array<Text>, count: usize) -> Result<Option<treewright_client::Front>, Failure> {
    let metrics = metrics.read(count, "the list of metrics")?;
    let metrics: Vec<&str> =
        metrics.iter().map(|each| each.read("the name of a metric")).collect::<Result<_, _>>()?;
    let named = (!metrics.is_empty()).then(|| treewright_client::Front::new(&metrics));
    Ok(named.transpose().map_err(ClientError::from)?)
}

exports! {
    fn tw_study_front(
        study: Option<&Study>, metrics: Array<Text>, count: usize, state: i64; error
    ) -> Option<Box<Front>> {
        let state = (state != 0).then_some(state);
        let query = FrontQuery { front: named(metrics, count)?, state, reference: None };
        Ok(Front::new(&need(study, "study")?.0.front(&query)?))
    }

    fn tw_front_json(front: Option<&Front>) -> *const c_char {
        front.map_or(c"{}".as_ptr(), |front| front.0.as_ptr())
    }

    fn tw_front_free(front: Front);

    fn tw_client_front_runs(
        client: Option<&Client>, id: Text, spec: Option<&Spec>, metrics: Array<Text>, count: usize,
        planned: u32; error
    ) -> Option<Box<FrontRuns>> {
        let front = need(named(metrics, count)?, "list of metrics")?;
        let spec = need(spec, "specification")?.of_front(&front)?;
        let client = &need(client, "client")?.0;
        let runs = FrontLoop::open(client, id.read("the study's id")?, &spec, front, planned)?;
        Ok(FrontRuns(Arc::new(runs)))
    }

    fn tw_front_runs_suggest(runs: Option<&FrontRuns>, error: ErrorOut) -> Option<Box<FrontRun>> {
        let body = || {
            let runs = &need(runs, "loop of the front")?.0;
            Ok(runs.ask()?.map(|record| Box::new(FrontRun::new(runs, record))))
        };
        guard(error, body).flatten()
    }

    fn tw_front_runs_found(runs: Option<&FrontRuns>; error) -> Option<Box<Front>> {
        Ok(Front::new(&need(runs, "loop of the front")?.0.found()))
    }

    fn tw_front_runs_free(runs: FrontRuns);

    fn tw_front_run_configuration(run: Option<&FrontRun>) -> Option<&Configuration> {
        run.map(|run| &run.configuration)
    }

    fn tw_front_run_trial(run: Option<&FrontRun>) -> *const c_char {
        run.map_or(c"".as_ptr(), |run| run.trial.as_ptr())
    }
}

fn end(
    run: Option<Box<FrontRun>>,
    measured: Result<Measurements, Failure>,
    outcome: Result<Outcome, Failure>,
) -> Result<(), Failure> {
    let run = need(run, "run")?;
    Ok(run.runs.tell(&run.record, measured?, &outcome?)?)
}

exports! {
    fn tw_front_run_report(
        run: Option<Box<FrontRun>>, numbers: Array<Number>, count: usize; error
    ) -> bool {
        end(run, measurements(numbers, count), Ok(Outcome::Ok))
    }

    fn tw_front_run_infeasible(run: Option<Box<FrontRun>>, reason: Text; error) -> bool {
        end(run, Ok(Measurements::new()), reason.read("the reason").map(Outcome::infeasible))
    }

    fn tw_front_run_failed(run: Option<Box<FrontRun>>, reason: Text; error) -> bool {
        end(run, Ok(Measurements::new()), reason.read("the reason").map(Outcome::failed))
    }

    fn tw_front_run_free(run: Option<Box<FrontRun>>) {
        let body = || {
            // Where that fails, its lease runs out.
            run.map_or(Ok(()), |run| Ok(run.runs.give_back(&run.record)?))
        };
        guard(ErrorOut::nowhere(), body);
    }
}
