//! `treewright exec`: tunes any program. It asks for a configuration, runs the program with it, measures the
//! run or reads its output, reports, and repeats until the search ends. At the end the winner may run against
//! the default in interleaved pairs, because the best of many noisy runs is mostly luck.
//!
//! One bad run, number or daemon does not end the session: failed runs are tried again, numbers that cannot
//! be reported are left out, and the session waits for a daemon that is away. It shows its result at the end,
//! also after an interruption.

mod confirm;
mod daemon;
mod front;
mod pairs;
pub(crate) mod program;
mod signals;
mod summary;
pub(crate) mod supervisor;
pub(crate) mod template;

use std::cell::Cell;
use std::collections::BTreeSet;
use std::sync::atomic::Ordering;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use treewright_cli::printed::{LeftOut, Wanted};
use treewright_client::blocking::Client;
use treewright_client::{
    Configuration, Few, Fidelity, Front, FrontHistory, Indicators, Measurements, ObjectiveTerm, OpenEnum,
    Outcome, Question, Rule, SessionPolicy, StudyRecord, StudySpec, TrialRecord,
};

use crate::arguments::exec::Exec;
use crate::failure::{Failure, Result};
use crate::output::either;
use crate::progress::{self, Progress};
use crate::study_file::find::find_or_create;
use daemon::PatientClient;
use program::{MetricSource, Run, Runner};
use signals::LastRun;
use summary::{OwnRuns, Summary, Winner, WinnerSource};
use template::Template;

/// Leases are renewed after this share of their time.
const RENEW_AFTER: f64 = 0.4;
/// Failed runs after which the default counts as unusable. Where three of ten runs fail by chance, one of
/// four hundred sessions gives up wrongly.
const TRIES_OF_DEFAULT: u32 = 5;
/// Failures after which a configuration without one good run counts as unusable.
const FAILURES_MAX: u32 = 2;
/// Number of failures in a row, without a run that worked, after which the session ends.
const FAILURES_IN_VAIN_MAX: u32 = 10;
/// Most different numbers whose leaving out is shown.
const LEFT_OUT_SHOWN_MAX: usize = 64;

/// The daemon that a session talks to.
pub(crate) struct Service<'a> {
    pub(crate) client: &'a Client,
    /// Longest time for which a call is repeated.
    pub(crate) timeout: Duration,
    /// It is the user's own, which is started when it is needed.
    pub(crate) is_local: bool,
}

/// A study on one input, with the program to run.
struct Job<'a> {
    daemon: PatientClient<'a>,
    study: StudyRecord,
    spec: &'a StudySpec,
    default: Configuration,
    template: Template,
    runner: Runner<'a>,
    indicators: Indicators,
    client_id: String,
    /// The program is known to look at the level.
    fidelities: bool,
    session_policy: SessionPolicy,
    last_run: LastRun,
}

/// A session: the job and its results so far.
struct Session<'a> {
    job: &'a Job<'a>,
    own: OwnRuns,
    /// Where several metrics are minimised at once.
    front: Option<FrontHistory>,
    /// Runs that failed since one worked.
    failures_in_vain: u32,
    /// The cost of the runs, in full ones.
    full_runs: f64,
    left_out: BTreeSet<LeftOut>,
}

/// The end of one trial.
enum Step {
    Measured(f64),
    Infeasible(String),
    Failed(String),
    Aborted,
    /// Measured at a cheaper level.
    Cheaper,
    Stopped,
}

/// Tunes a program and says what came out.
pub(crate) fn run(service: &Service, exec: &Exec, json: bool) -> Result<String, Failure> {
    let (stop, last_run) = signals::listen(service.client)?;
    let daemon = PatientClient::new(service, &stop);
    let study = daemon.ask(|client| find_or_create(client, &exec.study, exec.inline_study()?))?;
    let spec = study.spec()?.clone();
    let template = Template::read(&exec.command, &spec).map_err(Failure::Usage)?;
    note_unused(&template, &spec, exec);
    program::note_same_variables(&spec);
    let front = exec.front()?;
    let needed = needed(&spec, front.as_ref());
    let runner = Runner {
        metric: exec.metric,
        wanted: Wanted {
            terms: &needed,
            maximised: spec.objective.maximised(),
            limits: spec.objective.limits(),
            // A front adds a cost of its own.
            most: Measurements::MOST - usize::from(front.is_some()),
        },
        accepted: &exec.accept_exit,
        show_output: exec.show_output,
        limit: exec.run_timeout,
        stop: &stop,
        prints_time: Cell::new((exec.metric == MetricSource::Time).then_some(false)),
    };
    check_metrics(&runner, &spec, front.as_ref())?;
    announce(&spec, &study);
    let mut session_policy = SessionPolicy { epsilon: Some(1.0), ..SessionPolicy::default() };
    let room = study.policy.trials_per_state.unwrap_or_default();
    session_policy.trials_per_state = exec.trials.filter(|&trials| trials > room);
    // One for each process, so that several may tune at once.
    let own_name = || format!("exec@{}-{}", crate::files::host(), std::process::id());
    let job = Job {
        daemon,
        fidelities: front.is_none() && (!exec.fidelities.is_empty() || template.has_level()),
        client_id: exec.client.clone().unwrap_or_else(own_name),
        indicators: exec.indicators(),
        default: spec.space.default_configuration().into(),
        study,
        spec: &spec,
        template,
        runner,
        session_policy,
        last_run,
    };
    let (front, present_default) = front.map(|front| job.front(front, exec)).transpose()?.unzip();
    let (own, left_out) = (OwnRuns::default(), BTreeSet::new());
    let mut session = Session { job: &job, own, front, failures_in_vain: 0, full_runs: 0.0, left_out };
    let mut summary = Summary::new(job.id(), &spec);
    let done = session.tune(exec, &mut summary);
    match session.front.as_ref().zip(present_default.as_ref()) {
        Some((history, default)) => summary.found(history, default),
        None if summary.best.is_none() => summary.best = session.winner(),
        None => {}
    }
    let Err(problem) = done else { return either(json, &summary, || summary.words(&job.default)) };
    if session.own.is_empty() {
        return Err(problem);
    }
    summary.end = "ended by an error";
    summary.error = Some(problem.to_string());
    let found = either(json, &summary, || summary.words(&job.default))?;
    Err(Failure::Unfinished { found, cause: Box::new(problem) })
}

fn note_unused(template: &Template, spec: &StudySpec, exec: &Exec) {
    if !spec.objective.fidelities().is_empty() && !template.has_level() {
        progress::note(match exec.fidelities.is_empty() {
            true => {
                "the study has cheaper levels, but the command has no {fidelity}: every run is a full one"
            }
            false => "the level of a run is in the program's environment, as TREEWRIGHT_FIDELITY",
        });
    }
    let unused = template.unused(spec);
    if !unused.is_empty() {
        progress::note(&format!(
            "the command does not use {}; every value is also in the program's environment, as {}…",
            unused.join(", "),
            program::variable("TREEWRIGHT_PARAM_", "name")
        ));
    }
}

/// The metrics that have to be measured: minimised ones, and limited ones, which cost nothing.
fn needed(spec: &StudySpec, front: Option<&Front>) -> Vec<ObjectiveTerm> {
    let mut all = front.map_or_else(|| spec.objective.terms().to_vec(), front::terms);
    for limit in spec.objective.limits() {
        if all.iter().all(|term| term.metric != limit.metric) {
            all.push(ObjectiveTerm { metric: limit.metric.clone(), weight: 0.0 });
        }
    }
    all
}

/// Whether all that is minimised or limited can be measured at all.
fn check_metrics(runner: &Runner, spec: &StudySpec, front: Option<&Front>) -> Result<()> {
    let is_taken = |metric: &str| metric == "wall_ms" || metric == "cpu_ms";
    match runner.wanted.terms.iter().find(|term| !is_taken(&term.metric)) {
        Some(term) if runner.metric == MetricSource::Time => Err(Failure::Usage(format!(
            "the study {1} {0}, but only cpu_ms, wall_ms are measured; with --metric json, the program can print \
             it: {{\"{0}\": 1.5}}",
            term.metric,
            front::what_is_done(term, spec, front)
        ))),
        _ => Ok(()),
    }
}

/// Says how many configurations there are, where all of them can be tried, and about how many runs that
/// takes.
fn announce(spec: &StudySpec, study: &StudyRecord) {
    if let Some(Few { configurations, runs }) = study.policy.few(&spec.space) {
        progress::note(&format!("{configurations} configurations; about {runs} runs"));
    }
}

impl Job<'_> {
    fn id(&self) -> &str {
        self.study.id()
    }

    fn question(&self, wanted: Option<&Configuration>) -> Question {
        Question {
            indicators: self.indicators.clone(),
            client_id: Some(self.client_id.clone()),
            can_abort: self.stops_by().is_some(),
            session_policy: self.session_policy,
            wanted: wanted.cloned(),
            fidelities: self.fidelities,
            space_revision: self.study.space_revision,
            ..Question::default()
        }
    }

    /// The weight of wall time where a run can be ended that takes too long. A time that the program prints
    /// itself says nothing of how long the run takes.
    fn stops_by(&self) -> Option<f64> {
        only_wall_time(self.spec).filter(|_| self.runner.prints_time.get() == Some(false))
    }

    fn next(&self, wanted: Option<&Configuration>) -> Result<TrialRecord> {
        self.daemon.ask(|client| client.ask(&self.study.identified_name(), &self.question(wanted)))
    }

    fn command(&self, trial: &TrialRecord) -> Vec<String> {
        self.template.fill(&trial.configuration, trial.fidelity.as_deref())
    }

    /// The cost of a trial, in full ones.
    fn share(&self, trial: &TrialRecord) -> f64 {
        let mut levels = self.spec.objective.fidelities().iter();
        levels.find(|level| Some(&level.name) == trial.fidelity.as_ref()).map_or(1.0, |level| level.cost)
    }

    fn run(&self, trial: &TrialRecord) -> Result<Run> {
        let command = self.command(trial);
        let abort_after = match (trial.abort_above, self.stops_by()) {
            (Some(cost), Some(weight)) => Some(Duration::from_secs_f64((cost / weight / 1e3).min(1e9))),
            _ => None,
        };
        let renew = self.renewal(trial);
        if let Ok(mut last_run) = self.last_run.lock() {
            *last_run = Some(trial.name.clone());
        }
        let has_levels = !self.spec.objective.fidelities().is_empty();
        let level = has_levels.then(|| trial.fidelity.as_deref().unwrap_or(Fidelity::FULL));
        self.runner.run(&command, &trial.configuration, level, abort_after, renew).map_err(|problem| {
            let program = command.first().map_or("", String::as_str);
            Failure::Program(format!("{program} cannot be started: {problem}"))
        })
    }

    /// Renews the trial's lease while the program runs, beside everything else: a daemon that hangs must not
    /// stop the clock.
    fn renewal(&self, trial: &TrialRecord) -> impl FnMut() + use<> {
        let lease_s = f64::from(self.study.policy.lease_s.unwrap_or(60));
        let (every, client, name) =
            (Duration::from_secs_f64(lease_s * RENEW_AFTER), self.daemon.client.clone(), trial.name.clone());
        let mut last = Instant::now();
        let mut under_way: Option<JoinHandle<()>> = None;
        move || {
            if last.elapsed() > every && under_way.as_ref().is_none_or(JoinHandle::is_finished) {
                let (client, name) = (client.clone(), name.clone());
                // A failed renewal may be ignored: the service also takes a report after the lease has ended.
                under_way = Some(std::thread::spawn(move || drop(client.renew(&name))));
                last = Instant::now();
            }
        }
    }

    /// Reports a result. A finished run is not lost: where the daemon does not come back, the error says how
    /// to hand it in.
    fn tell(&self, trial: &TrialRecord, measured: &Measurements, outcome: &Outcome) -> Result<TrialRecord> {
        let reported = self.daemon.ask(|client| client.tell(&trial.name, measured, outcome));
        if matches!(&reported, Err(Failure::Client(problem)) if problem.may_pass()) {
            let numbers: Vec<_> = measured.iter().map(|(name, value)| format!("{name}={value}")).collect();
            let what = match outcome {
                Outcome::Ok => numbers.join(" "),
                Outcome::Infeasible { reason } => format!("--infeasible {}", quoted(reason)),
                Outcome::Failed { reason } => format!("--failed {}", quoted(reason)),
                Outcome::Aborted { lower_bound } => format!("--aborted {lower_bound}"),
            };
            progress::note(&format!(
                "a finished run could not be reported; hand it in when the daemon is back: treewright report {} {what}",
                trial.name
            ));
        }
        Ok(reported?.0)
    }

    /// Gives a trial back. Where that fails, its lease runs out.
    fn give_back(&self, trial: &TrialRecord) {
        self.daemon.ask_once(|client| client.give_back(&trial.name));
    }

    fn winner_of(
        &self,
        configuration: Configuration,
        costs: (f64, Option<f64>),
        source: WinnerSource,
    ) -> Winner {
        let command = self.template.fill(&configuration, None);
        let (cost, default_cost) = costs;
        let view = self.spec.objective.view();
        let (value, default_value) = (view.maximum(cost), default_cost.and_then(|cost| view.maximum(cost)));
        let standing = None;
        Winner { configuration, cost, default_cost, value, default_value, command, source, standing }
    }
}

impl Session<'_> {
    fn tune(&mut self, exec: &Exec, summary: &mut Summary) -> Result<()> {
        self.search(exec, summary)?;
        if self.front.is_some() {
            return Ok(());
        }
        summary.best = self.winner();
        if let Some(pairs) = exec.confirm.filter(|_| summary.end != "interrupted") {
            self.confirm(pairs, summary)?;
            if self.is_stopped() {
                summary.end = "interrupted";
            }
        }
        Ok(())
    }

    fn search(&mut self, exec: &Exec, summary: &mut Summary) -> Result<()> {
        let spec = self.job.spec;
        let mut progress = Progress::new(self.most(exec), summary::objective(spec), spec.objective.view());
        loop {
            if self.most(exec).is_some_and(|most| self.full_runs >= f64::from(most)) {
                summary.end = "the requested number of trials is reached";
                break;
            }
            let trial = match self.ask() {
                Ok(Some(trial)) => trial,
                Ok(None) => break,
                Err(_) if self.is_stopped() => {
                    summary.end = "interrupted";
                    break;
                }
                Err(problem) => return Err(problem),
            };
            let step = self.step(&trial)?;
            let learnt = if matches!(step, Step::Stopped) { Ok(None) } else { self.learn(&trial) };
            let learnt = match learnt {
                Err(_) if self.is_stopped() => None,
                learnt => learnt?,
            };
            let result = match &step {
                Step::Stopped => {
                    summary.end = "interrupted";
                    break;
                }
                Step::Cheaper => {
                    summary.cheaper += 1;
                    self.full_runs += self.job.share(&trial);
                    let level = trial.fidelity.as_deref().unwrap_or(Fidelity::FULL);
                    progress::status(&format!("at the level {level}  {}", trial.configuration));
                    continue;
                }
                Step::Measured(cost) => learnt.map_or(Ok(*cost), Err),
                Step::Aborted => Err("stopped early".to_owned()),
                Step::Infeasible(reason) => Err(format!("not usable: {reason}")),
                Step::Failed(reason) => Err(format!("failed: {reason}")),
            };
            summary.trials += 1;
            self.full_runs += self.job.share(&trial);
            summary.infeasible += u64::from(matches!(step, Step::Infeasible(_)));
            summary.failed += u64::from(matches!(step, Step::Failed(_)));
            progress.trial(&trial, result.as_ref().map(|cost| *cost).map_err(String::as_str));
        }
        progress::status_end();
        Ok(())
    }

    fn is_stopped(&self) -> bool {
        self.job.runner.stop.load(Ordering::Relaxed)
    }

    fn step(&mut self, trial: &TrialRecord) -> Result<Step> {
        let job = self.job;
        let is_first_default = self.own.is_empty() && trial.configuration == job.default;
        let mut ran = job.run(trial);
        for again in 2..=TRIES_OF_DEFAULT {
            let Ok(Run::Failed { reason, .. }) = &ran else { break };
            if !is_first_default {
                break;
            }
            progress::note(&format!("the default failed: {reason}; try {again} of {TRIES_OF_DEFAULT}"));
            ran = job.run(trial);
        }
        let ran = match ran {
            // Its file is being written, say; it was there before.
            Err(Failure::Program(reason)) if !self.own.is_empty() => {
                Run::Failed { reason, said: String::new() }
            }
            ran => ran.inspect_err(|_| job.give_back(trial))?,
        };
        match self.with_cost(trial, ran) {
            Run::Done(measured, left_out) => {
                self.tell_left_out(left_out);
                let stored = job.tell(trial, &measured, &Outcome::Ok)?;
                // Beyond a limit of the study.
                if let Some(OpenEnum::Known(Outcome::Infeasible { reason })) = stored.outcome {
                    return Ok(Step::Infeasible(reason));
                }
                if stored.fidelity.is_some() {
                    self.failures_in_vain = 0;
                    return Ok(Step::Cheaper);
                }
                let cost =
                    stored.cost.ok_or_else(|| Failure::Data(format!("{} has no cost", stored.name)))?;
                self.own.measured(&trial.configuration, cost);
                self.failures_in_vain = 0;
                Ok(Step::Measured(cost))
            }
            Run::Infeasible(reason) if is_first_default => Err(self.useless_default(trial, &reason, "")),
            Run::Failed { reason, said } if is_first_default => {
                Err(self.useless_default(trial, &reason, &said))
            }
            // A configuration that worked before is not infeasible.
            Run::Infeasible(reason) if self.own.has_worked(&trial.configuration) => {
                self.failed(trial, reason, "")
            }
            Run::Infeasible(reason) => {
                job.tell(trial, &Measurements::new(), &Outcome::infeasible(&reason))?;
                Ok(Step::Infeasible(reason))
            }
            Run::Failed { reason, said } => self.failed(trial, reason, &said),
            Run::TooSlow(wall_ms) => {
                let bound = wall_ms * only_wall_time(job.spec).unwrap_or(1.0);
                job.tell(trial, &Measurements::new(), &Outcome::aborted(bound))?;
                Ok(Step::Aborted)
            }
            Run::Stopped => {
                job.give_back(trial);
                Ok(Step::Stopped)
            }
        }
    }

    /// A run that failed: chance the first time; the configuration's fault where it fails again and never
    /// worked, while others do.
    fn failed(&mut self, trial: &TrialRecord, reason: String, said: &str) -> Result<Step> {
        let works = self.own.has_worked(&trial.configuration);
        let is_unusable =
            !works && self.own.failed(&trial.configuration) >= FAILURES_MAX && !self.own.is_empty();
        if is_unusable {
            self.job.tell(trial, &Measurements::new(), &Outcome::infeasible(&reason))?;
            return Ok(Step::Infeasible(reason));
        }
        self.failures_in_vain += 1;
        if self.own.is_empty() && self.failures_in_vain >= FAILURES_IN_VAIN_MAX {
            self.job.give_back(trial);
            return Err(Failure::Program(format!(
                "the last {FAILURES_IN_VAIN_MAX} runs failed, and none worked: {reason}\n{}\n{said}",
                shell_words(&self.job.command(trial))
            )));
        }
        self.job.tell(trial, &Measurements::new(), &Outcome::failed(&reason))?;
        Ok(Step::Failed(reason))
    }

    fn useless_default(&self, trial: &TrialRecord, reason: &str, said: &str) -> Failure {
        self.job.give_back(trial);
        let command = shell_words(&self.job.command(trial));
        Failure::Program(format!(
            "the program fails even with the default parameters: {reason}\n{command}\n{said}"
        ))
    }

    /// Says, once of each, which numbers are not reported.
    fn tell_left_out(&mut self, left_out: Vec<LeftOut>) {
        let new: Vec<_> = left_out.into_iter().filter(|one| !self.left_out.contains(one)).collect();
        if new.is_empty() || self.left_out.len() >= LEFT_OUT_SHOWN_MAX {
            return;
        }
        let room = LEFT_OUT_SHOWN_MAX - self.left_out.len();
        let more = if new.len() > room { format!(" and {} more", new.len() - room) } else { String::new() };
        let names: Vec<_> = new.iter().take(room).map(ToString::to_string).collect();
        progress::note(&format!("left out of what the program prints: {}{more}", names.join(", ")));
        self.left_out.extend(new.into_iter().take(room));
    }

    /// The best that is known for this input: to the service, or, where that cannot be asked, to this call.
    fn winner(&self) -> Option<Winner> {
        let job = self.job;
        let study = job.study.identified_name();
        if let Some(best) = job.daemon.ask_once(|client| client.best(&study, &job.indicators)) {
            let costs = (best.cost, best.default_cost);
            let winner = job.winner_of(best.configuration, costs, WinnerSource::Service);
            return Some(Winner { standing: best.standing, ..winner });
        }
        let (configuration, cost) = self.own.best()?;
        let costs = (cost, self.own.mean_cost(&job.default));
        Some(job.winner_of(configuration.clone(), costs, WinnerSource::Runs))
    }
}

/// Whether the search has nothing more to try.
fn is_over(trial: &TrialRecord) -> bool {
    trial.reason.explanation.rule == Some(OpenEnum::Known(Rule::Finished))
}

/// The weight of wall time where nothing else is minimised: then a run that takes too long can be ended.
fn only_wall_time(spec: &StudySpec) -> Option<f64> {
    if !spec.objective.maximised().is_empty() {
        return None;
    }
    match spec.objective.terms() {
        [term] if term.metric == "wall_ms" => Some(term.weight),
        _ => None,
    }
}

/// As it would be typed.
fn shell_words(command: &[String]) -> String {
    let words: Vec<_> = command.iter().map(|word| quoted(word)).collect();
    words.join(" ")
}

/// A word as a shell reads it.
pub(crate) fn quoted(word: &str) -> String {
    let is_plain = |each: char| each.is_ascii_alphanumeric() || "-_./=:,+@%".contains(each);
    if !word.is_empty() && word.chars().all(is_plain) {
        word.to_owned()
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_for_a_shell() {
        let words = ["zstd", "-3", "a b", "it's", "", "$x"].map(str::to_owned);
        assert_eq!(shell_words(&words), r"zstd -3 'a b' 'it'\''s' '' '$x'");
    }
}
