//! `treewright exec`: tunes any program. It asks for a configuration, runs the program with it, takes the times or what
//! the program prints, reports, and repeats until the search ends. At the end the winner may run against the
//! default in interleaved pairs, because the best of many noisy runs is mostly luck.

mod pairs;
pub(crate) mod program;
pub(crate) mod template;

use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

use serde::Serialize;
use treewright_client::blocking::Client;
use treewright_client::{
    Configuration, Indicators, Measurements, OpenEnum, Outcome, Question, Rule, SessionPolicy, StudyRecord,
    StudySpec, TrialRecord,
};

use crate::arguments::exec::Exec;
use crate::failure::Failure;
use crate::output::either;
use crate::progress::{self, Progress};
use crate::show::figure;
use crate::study_file::find::find_or_create;
use pairs::Gain;
use program::{Run, Runner};
use template::Template;

/// Leases are renewed after this share of their time.
const RENEW_AFTER: f64 = 0.4;

/// What the command came to.
#[derive(Debug, Serialize)]
struct Summary {
    study: String,
    /// Runs of the program in this call, the pairs left out.
    trials: u64,
    /// How many of them could not be used.
    infeasible: u64,
    /// Why it ended.
    end: &'static str,
    #[serde(skip_serializing_if = "Option::is_none")]
    best: Option<Winner>,
    #[serde(skip_serializing_if = "Option::is_none")]
    confirmation: Option<Confirmation>,
}

/// What ran against the default in pairs, and what came out.
#[derive(Debug, Serialize)]
struct Confirmation {
    configuration: Configuration,
    #[serde(flatten)]
    gain: Gain,
}

#[derive(Debug, Serialize)]
struct Winner {
    configuration: Configuration,
    cost: f64,
    default_cost: Option<f64>,
    command: Vec<String>,
}

/// A study on one input, with the program to run.
struct Job<'a> {
    client: &'a Client,
    study: StudyRecord,
    spec: StudySpec,
    template: Template,
    runner: Runner<'a>,
    indicators: Indicators,
    client_id: String,
    can_abort: bool,
    session_policy: SessionPolicy,
}

/// What became of one trial.
enum Step {
    Measured(f64),
    Bad,
    Aborted,
    Stopped,
}

/// Tunes a program and says what came out.
pub(crate) fn run(client: &Client, exec: &Exec, json: bool) -> Result<String, Failure> {
    let stop = stop_flag()?;
    let study = find_or_create(client, &exec.study, exec.inline_study()?)?;
    let spec = study.spec()?.clone();
    let template = Template::read(&exec.command, &spec).map_err(Failure::Usage)?;
    let unused = template.unused(&spec);
    if !unused.is_empty() {
        progress::note(&format!(
            "the command does not use {}; every value is also in the program's environment, as {}…",
            unused.join(", "),
            program::variable("TREEWRIGHT_PARAM_", "name")
        ));
    }
    let runner =
        Runner { metric: exec.metric, show_output: exec.show_output, limit: exec.run_timeout, stop: &stop };
    let mut session_policy = SessionPolicy { epsilon: Some(1.0), ..SessionPolicy::default() };
    let room = study.policy.trials_per_state.unwrap_or_default();
    session_policy.trials_per_state = exec.trials.filter(|&trials| trials > room);
    let job = Job {
        client,
        can_abort: only_wall_time(&spec).is_some(),
        client_id: exec.client.clone().unwrap_or_else(default_client),
        indicators: exec.indicators(),
        study,
        spec,
        template,
        runner,
        session_policy,
    };
    let summary = job.tune(exec)?;
    either(json, &summary, || job.words(&summary))
}

impl Job<'_> {
    fn id(&self) -> &str {
        self.study.id()
    }

    fn tune(&self, exec: &Exec) -> Result<Summary, Failure> {
        let mut progress = Progress::new(exec.trials);
        let mut summary = Summary {
            study: self.id().to_owned(),
            trials: 0,
            infeasible: 0,
            end: "the search has ended",
            best: None,
            confirmation: None,
        };
        let default: Configuration = self.spec.space.default_configuration().into();
        let mut lowest: Option<(f64, Configuration)> = None;
        loop {
            if exec.trials.is_some_and(|most| summary.trials >= u64::from(most)) {
                summary.end = "the requested number of trials is reached";
                break;
            }
            let trial = self.client.ask(&self.study.identified_name(), &self.question(None))?;
            if is_over(&trial) {
                self.client.give_back(&trial.name)?;
                break;
            }
            let step = self.step(&trial, summary.trials == 0)?;
            match step {
                Step::Stopped => {
                    summary.end = "interrupted";
                    break;
                }
                Step::Bad => summary.infeasible += 1,
                Step::Measured(cost) => {
                    let is_lower = lowest.as_ref().is_none_or(|(least, _)| cost < *least);
                    if is_lower && trial.configuration != default {
                        lowest = Some((cost, trial.configuration.clone()));
                    }
                }
                Step::Aborted => {}
            }
            summary.trials += 1;
            progress.trial(&trial, step.cost());
        }
        progress.end();
        summary.best = self.winner()?;
        // Where nothing is proven yet, the pairs may prove it.
        let proven = summary.best.as_ref().map(|best| &best.configuration).filter(|best| **best != default);
        let candidate = proven.cloned().or(lowest.map(|(_, configuration)| configuration));
        if let Some(pairs) = exec.confirm.filter(|_| summary.end != "interrupted") {
            if let Some(candidate) = candidate {
                let gain = self.confirm(&default, &candidate, pairs)?;
                summary.confirmation = gain.map(|gain| Confirmation { configuration: candidate, gain });
                summary.best = self.winner()?;
            } else {
                progress::note("nothing better than the default was found, so there is nothing to confirm");
            }
        }
        Ok(summary)
    }

    fn question(&self, wanted: Option<&Configuration>) -> Question {
        Question {
            indicators: self.indicators.clone(),
            client_id: Some(self.client_id.clone()),
            can_abort: self.can_abort,
            session_policy: self.session_policy,
            wanted: wanted.cloned(),
            ..Question::default()
        }
    }

    /// Runs a trial and reports it.
    fn step(&self, trial: &TrialRecord, is_first: bool) -> Result<Step, Failure> {
        let command = self.template.fill(&trial.configuration);
        let weight = only_wall_time(&self.spec);
        let abort_after = match (trial.abort_above, weight) {
            (Some(cost), Some(weight)) => Some(Duration::from_secs_f64((cost / weight / 1e3).min(1e9))),
            _ => None,
        };
        let renew = self.renewal(trial);
        let ran = self.runner.run(&command, &trial.configuration, abort_after, renew);
        let ran = match ran {
            Ok(ran) => ran,
            Err(problem) => {
                self.client.give_back(&trial.name)?;
                let program = command.first().map_or("", String::as_str);
                return Err(Failure::Program(format!("{program} cannot be started: {problem}")));
            }
        };
        Ok(match ran {
            Run::Done(measured) => {
                let cost = self.report_measured(trial, &measured)?;
                Step::Measured(cost)
            }
            Run::Bad { reason, said } => {
                let is_default = trial.configuration == self.spec.space.default_configuration().into();
                if is_first && is_default {
                    self.client.give_back(&trial.name)?;
                    return Err(Failure::Program(format!(
                        "the program fails even with the default parameters: {reason}\n{}\n{said}",
                        shell_words(&command)
                    )));
                }
                self.client.tell(&trial.name, &Measurements::new(), &Outcome::infeasible(reason))?;
                Step::Bad
            }
            Run::TooSlow(wall_ms) => {
                let bound = wall_ms * weight.unwrap_or(1.0);
                self.client.tell(&trial.name, &Measurements::new(), &Outcome::aborted(bound))?;
                Step::Aborted
            }
            Run::Stopped => {
                self.client.give_back(&trial.name)?;
                Step::Stopped
            }
        })
    }

    fn report_measured(&self, trial: &TrialRecord, measured: &Measurements) -> Result<f64, Failure> {
        let missing = self.spec.objective.terms().iter().find(|term| measured.get(&term.metric).is_none());
        if let Some(term) = missing {
            self.client.give_back(&trial.name)?;
            let found: Vec<_> = measured.iter().map(|(name, _)| name).collect();
            let metric = &term.metric;
            let hint = match self.runner.metric {
                program::MetricSource::Time => {
                    format!("with --metric json, the program can print it: {{\"{metric}\": 1.5}}")
                }
                program::MetricSource::Json => "the last output line that is a JSON object counts".to_owned(),
            };
            return Err(Failure::Program(format!(
                "the study minimises {metric}, but only {} was measured; {hint}",
                found.join(", ")
            )));
        }
        let (stored, _) = self.client.tell(&trial.name, measured, &Outcome::Ok)?;
        stored.cost.ok_or_else(|| Failure::Data(format!("{} has no cost", stored.name)))
    }

    /// Renews the trial's lease while the program runs.
    fn renewal(&self, trial: &TrialRecord) -> impl FnMut() + use<'_> {
        let lease_s = f64::from(self.study.policy.lease_s.unwrap_or(60));
        let (every, client, name) =
            (Duration::from_secs_f64(lease_s * RENEW_AFTER), self.client.clone(), trial.name.clone());
        let mut last = Instant::now();
        move || {
            if last.elapsed() > every {
                // A report after the lease has ended is taken all the same.
                let _ = client.renew(&name);
                last = Instant::now();
            }
        }
    }

    /// The best that is known for this input.
    fn winner(&self) -> Result<Option<Winner>, Failure> {
        let best = match self.client.best(self.id(), &self.indicators) {
            Ok(best) => best,
            Err(problem) if problem.is_not_found() => return Ok(None),
            Err(problem) => return Err(problem.into()),
        };
        let command = self.template.fill(&best.configuration);
        let (configuration, cost, default_cost) = (best.configuration, best.cost, best.default_cost);
        Ok(Some(Winner { configuration, cost, default_cost, command }))
    }

    /// Lets the winner run against the default, in turns; each run is reported.
    fn confirm(
        &self,
        default: &Configuration,
        winner: &Configuration,
        pairs: u32,
    ) -> Result<Option<Gain>, Failure> {
        let mut measured = Vec::new();
        for pair in 0..pairs {
            progress::status(&format!("confirming: pair {} of {pairs}", pair + 1));
            // Who goes first changes, so that neither always profits from the other's caches.
            let order = if pair % 2 == 0 { [default, winner] } else { [winner, default] };
            let mut costs = [None, None];
            for configuration in order {
                let trial =
                    self.client.ask(&self.study.identified_name(), &self.question(Some(configuration)))?;
                match self.step(&TrialRecord { abort_above: None, ..trial }, false)? {
                    Step::Measured(cost) => costs[usize::from(configuration == winner)] = Some(cost),
                    Step::Stopped => {
                        progress::status_end();
                        return Ok(Gain::of(&measured));
                    }
                    Step::Bad | Step::Aborted => {}
                }
            }
            if let [Some(default), Some(winner)] = costs {
                measured.push((default, winner));
            }
        }
        progress::status_end();
        Ok(Gain::of(&measured))
    }

    fn words(&self, summary: &Summary) -> String {
        let mut text = format!("{}: {} trial(s), {}", summary.study, summary.trials, summary.end);
        if summary.infeasible > 0 {
            text += &format!("; {} could not be used", summary.infeasible);
        }
        text.push('\n');
        let Some(best) = &summary.best else { return text + "nothing measured\n" };
        text += &format!("best: {}\n", best.configuration);
        let default = best.default_cost.map(|cost| format!(", default {}", figure(cost))).unwrap_or_default();
        text += &format!("cost {}{default}\n", figure(best.cost));
        text += &format!("  {}\n", shell_words(&best.command));
        if let Some(Confirmation { configuration, gain: found }) = &summary.confirmation {
            let percent = |share: f64| format!("{:.1}", 100.0 * share);
            let who = if *configuration == best.configuration {
                String::new()
            } else {
                format!("{configuration}, the best of the runs, ")
            };
            text += &format!(
                "{who}confirmed in {} interleaved pairs: {} % below the default, {} to {} % ({:.0} % interval of the \
                 median)\n",
                found.pairs,
                percent(found.gain),
                percent(found.low),
                percent(found.high),
                100.0 * found.confidence
            );
            if !found.is_certain() {
                text += "that is within the noise; more pairs (--confirm=30) may decide it\n";
            }
        }
        text
    }
}

impl Step {
    fn cost(&self) -> Option<f64> {
        match self {
            Self::Measured(cost) => Some(*cost),
            Self::Bad | Self::Aborted | Self::Stopped => None,
        }
    }
}

/// Whether the search has nothing more to try.
fn is_over(trial: &TrialRecord) -> bool {
    trial.reason.explanation.rule == Some(OpenEnum::Known(Rule::Finished))
}

/// The weight of wall time where nothing else is minimised: then a run that takes too long can be ended.
fn only_wall_time(spec: &StudySpec) -> Option<f64> {
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

/// One for each process, so that several may tune at once.
fn default_client() -> String {
    format!("exec@{}-{}", crate::files::host(), std::process::id())
}

/// Set once somebody wants everything to end.
fn stop_flag() -> Result<std::sync::Arc<AtomicBool>, Failure> {
    let stop = std::sync::Arc::new(AtomicBool::new(false));
    let set = std::sync::Arc::clone(&stop);
    ctrlc::set_handler(move || set.store(true, std::sync::atomic::Ordering::Relaxed))
        .map_err(|error| Failure::Program(format!("signals cannot be caught: {error}")))?;
    Ok(stop)
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
