//! A front in a session: the direction of a run, its cost there, and its reports to the other directions.

use treewright_client::{
    Configuration, Front, FrontHistory, ObjectiveTerm, Policy, StudySpec, TrialQuery, TrialRecord,
    detect_fingerprint,
};

use super::program::Run;
use super::summary::Summary;
use super::{Job, Session, is_over};
use crate::arguments::exec::Exec;
use crate::failure::{Failure, Result};
use crate::show::figure;

/// Runs of a call that does not say how many, where the study has no budget of its own.
const RUNS: u32 = 80;

/// The metrics that every run has to measure.
pub(super) fn terms(front: &Front) -> Vec<ObjectiveTerm> {
    front.metrics().map(|metric| ObjectiveTerm { metric: metric.to_owned(), weight: 1.0 }).collect()
}

/// The use of a metric in a study.
pub(super) fn what_is_done(term: &ObjectiveTerm, spec: &StudySpec, front: Option<&Front>) -> &'static str {
    let is_of_front = front.is_some_and(|front| front.maximised().any(|metric| metric == term.metric));
    match is_of_front || spec.objective.maximised().contains(&term.metric) {
        true => "maximises",
        false if term.weight > 0.0 => "minimises",
        false => "limits",
    }
}

fn planned(exec: &Exec, policy: &Policy) -> u32 {
    exec.trials.or(policy.trials_per_state.filter(|runs| *runs > 0)).unwrap_or(RUNS)
}

impl Job<'_> {
    /// The study's trials of the front so far, and its default, as they are in the present space, of which
    /// this call may know an earlier one.
    pub(super) fn front(&self, front: Front, exec: &Exec) -> Result<(FrontHistory, Configuration)> {
        let wanted = front.study_name();
        if self.study.display_name != wanted {
            let found = &self.study.display_name;
            return Err(Failure::Data(format!("{} is no {wanted}, but `{found}`", self.study.name)));
        }
        let completed = || TrialQuery::all().filter("state = COMPLETED").in_present_space();
        let known = |client: &treewright_client::blocking::Client| {
            client.trials(&self.study.identified_name(), completed()).collect::<Result<Vec<_>, _>>()
        };
        let mut known = self.daemon.ask(known)?;
        // Costs of different machines are never mixed.
        let machine = detect_fingerprint();
        known.retain(|trial| trial.fingerprint.as_ref() == Some(&machine));
        let present = self.daemon.ask(|client| client.get_study(&self.study.identified_name()))?;
        let default = present.spec()?.space.default_configuration().into();
        Ok((FrontHistory::new(front, known, planned(exec, &self.study.policy)), default))
    }
}

impl Session<'_> {
    /// The most runs of this call.
    pub(super) fn most(&self, exec: &Exec) -> Option<u32> {
        self.front.as_ref().map_or(exec.trials, |_| Some(planned(exec, &self.job.study.policy)))
    }

    /// The next trial; `None` where there is nothing more to try.
    pub(super) fn ask(&mut self) -> Result<Option<TrialRecord>> {
        let job = self.job;
        self.carry_over()?;
        let Some(history) = &mut self.front else {
            let trial = job.next(None)?;
            let is_over = is_over(&trial);
            if is_over {
                job.give_back(&trial);
            }
            return Ok((!is_over).then_some(trial));
        };
        while let Some(direction) = history.next_direction() {
            let question = history.question(direction, job.question(None));
            let trial = job.daemon.ask(|client| client.ask(&job.study.identified_name(), &question))?;
            if !is_over(&trial) {
                return Ok(Some(trial));
            }
            job.give_back(&trial);
            history.end(direction);
        }
        Ok(None)
    }

    pub(super) fn with_cost(&self, trial: &TrialRecord, ran: Run) -> Run {
        match (&self.front, ran) {
            (Some(history), Run::Done(measured, left_out)) => match history.with_cost(trial, measured) {
                Ok(measured) => Run::Done(measured, left_out),
                Err(problem) => Run::Failed { reason: problem.to_string(), said: String::new() },
            },
            (_, ran) => ran,
        }
    }

    /// Takes a run that was reported for the front, and reports it to the other directions. Returns its
    /// measurements in words.
    pub(super) fn learn(&mut self, trial: &TrialRecord) -> Result<Option<String>> {
        let Some(history) = &mut self.front else { return Ok(None) };
        let stored = self.job.daemon.ask(|client| client.trial(&trial.name))?;
        let shown =
            |metric| format!("{metric} {}", figure(stored.measurements.get(metric).unwrap_or(f64::NAN)));
        let words = history.front().metrics().map(shown).collect::<Vec<_>>().join(", ");
        history.push(stored);
        self.carry_over()?;
        Ok(Some(words))
    }

    /// Reports runs for the directions that do not know of them. None of these trials is a run.
    fn carry_over(&mut self) -> Result<()> {
        let Some(history) = &mut self.front else { return Ok(()) };
        let daemon = &self.job.daemon;
        for (question, measured, outcome) in history.owed() {
            let trial = daemon.ask(|client| client.ask(&self.job.study.identified_name(), &question))?;
            history.push(daemon.ask(|client| client.tell(&trial.name, &measured, &outcome))?.0);
        }
        Ok(())
    }
}

impl Summary {
    pub(super) fn found(&mut self, history: &FrontHistory, default: &Configuration) {
        let runs = history.trials().iter().filter_map(TrialRecord::measured_run);
        let front = history.front().of(runs, default, None);
        self.objective = front.metrics.join(", ");
        self.front = Some(front);
    }
}
