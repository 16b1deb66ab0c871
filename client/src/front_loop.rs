//! The loop over the runs of a front, for programs without one of their own.

use std::sync::Mutex;

use crate::blocking::Client;
use crate::locks::lock;
use crate::{
    ClientError, Configuration, Front, FrontHistory, Measurements, OpenEnum, Outcome, ParetoFront, Question,
    Rule, SessionPolicy, StudySpec, TrialQuery, TrialRecord,
};

/// A front with its next runs: looks for the configurations of which no other is better in all metrics. One
/// program at a time adds to a front, and runs one trial at a time.
///
/// ```no_run
/// # use treewright_client::{blocking::Client, ClientError, Front, FrontLoop, Measurements};
/// # use treewright_client::{Outcome, Space, StudySpec};
/// # fn run() -> Measurements { Measurements::from([("time_ms", 1.0), ("memory_mb", 1.0)]) }
/// # fn tune(client: &Client, space: Space) -> Result<(), ClientError> {
/// let front = Front::new(&["time_ms", "memory_mb"])?;
/// let spec = StudySpec::builder(space).front(&front).build().expect("a good study");
/// let runs = FrontLoop::open(client, "lists", &spec, front, 60)?;
/// while let Some(trial) = runs.ask()? {
///     runs.tell(&trial, run(), &Outcome::Ok)?;
/// }
/// for point in runs.found().points {
///     println!("{}: {:?}", point.configuration, point.metrics);
/// }
/// # Ok(())
/// # }
/// ```
#[derive(Debug)]
pub struct FrontLoop {
    client: Client,
    /// Its name with its identity.
    study: String,
    space_revision: u32,
    default: Configuration,
    runs: Mutex<FrontRuns>,
}

#[derive(Debug)]
struct FrontRuns {
    history: FrontHistory,
    /// Planned ones that are still to be done.
    left: u32,
}

impl FrontLoop {
    /// Creates the study, or goes on with the one of that id. `spec` is made with
    /// [`crate::StudyBuilder::front`]; `planned` is the number of runs that [`FrontLoop::ask`] gives.
    ///
    /// # Errors
    /// [`ClientError::Invalid`] where the study was made for something else; [`ClientError::Refused`],
    /// [`ClientError::Away`], [`ClientError::Late`].
    pub fn open(
        client: &Client,
        id: &str,
        spec: &StudySpec,
        front: Front,
        planned: u32,
    ) -> Result<Self, ClientError> {
        let record = client.create_study(id, spec)?;
        if record.display_name != front.study_name() {
            let problem = format!("it is no {}, but `{}`", front.study_name(), record.display_name);
            return Err(ClientError::invalid(record.name, problem));
        }
        let study = record.identified_name();
        let query = TrialQuery::all().filter("state = COMPLETED").in_present_space();
        let mut known = client.trials(&study, query).collect::<Result<Vec<_>, _>>()?;
        // Costs of different machines are never mixed.
        known.retain(|trial| trial.fingerprint.as_ref() == Some(client.fingerprint()));
        // Trials are read as they are in the present space, of which the program may know an earlier one.
        let default = client.get_study(&study)?.spec()?.space.default_configuration().into();
        Ok(Self {
            client: client.clone(),
            study,
            space_revision: record.space_revision,
            default,
            runs: Mutex::new(FrontRuns { history: FrontHistory::new(front, known, planned), left: planned }),
        })
    }

    /// The name of its study, with its identity.
    pub fn study(&self) -> &str {
        &self.study
    }

    /// The names of its metrics.
    pub fn metrics(&self) -> Vec<String> {
        lock(&self.runs).history.front().metrics().map(str::to_owned).collect()
    }

    /// The next run. It stays that run until it is reported or given back. `None` once the planned runs are
    /// done, or nothing more is to be tried.
    ///
    /// # Errors
    /// [`ClientError::Refused`], [`ClientError::Away`], [`ClientError::Late`].
    pub fn ask(&self) -> Result<Option<TrialRecord>, ClientError> {
        let mut runs = lock(&self.runs);
        if runs.left == 0 {
            return Ok(None);
        }
        self.carry_over(&mut runs.history)?;
        while let Some(direction) = runs.history.next_direction() {
            let session_policy = SessionPolicy { epsilon: Some(1.0), ..SessionPolicy::default() };
            let own = Question { session_policy, space_revision: self.space_revision, ..Question::default() };
            let trial = self.client.ask(&self.study, &runs.history.question(direction, own))?;
            if trial.reason.explanation.rule != Some(OpenEnum::Known(Rule::Finished)) {
                return Ok(Some(trial));
            }
            self.client.give_back(&trial.name)?;
            runs.history.end(direction);
        }
        Ok(None)
    }

    /// Ends a run, and reports it to every direction.
    ///
    /// # Errors
    /// [`ClientError::Invalid`] where it succeeded and a metric is missing or not above 0;
    /// [`ClientError::Refused`], [`ClientError::Away`], [`ClientError::Late`]. The run is open then.
    pub fn tell(
        &self,
        trial: &TrialRecord,
        measured: Measurements,
        outcome: &Outcome,
    ) -> Result<(), ClientError> {
        let mut runs = lock(&self.runs);
        let measured =
            if *outcome == Outcome::Ok { runs.history.with_cost(trial, measured)? } else { measured };
        let (stored, _) = self.client.tell(&trial.name, &measured, outcome)?;
        runs.history.push(stored);
        runs.left = runs.left.saturating_sub(1);
        // What fails here is done before the next question.
        let _ = self.carry_over(&mut runs.history);
        Ok(())
    }

    /// Gives a run back unmeasured.
    ///
    /// # Errors
    /// [`ClientError::Refused`], [`ClientError::Away`], [`ClientError::Late`]. Its lease runs out then.
    pub fn give_back(&self, trial: &TrialRecord) -> Result<(), ClientError> {
        self.client.give_back(&trial.name).map(drop)
    }

    /// The front of all runs so far on this machine. The hypervolume refers to the default.
    pub fn found(&self) -> ParetoFront {
        let runs = lock(&self.runs);
        let measured = runs.history.trials().iter().filter_map(TrialRecord::measured_run);
        runs.history.front().of(measured, &self.default, None)
    }

    /// Reports runs for the directions that do not know of them. None of these trials is a run.
    fn carry_over(&self, history: &mut FrontHistory) -> Result<(), ClientError> {
        for (question, measured, outcome) in history.owed() {
            let trial = self.client.ask(&self.study, &question)?;
            history.push(self.client.tell(&trial.name, &measured, &outcome)?.0);
        }
        Ok(())
    }
}
