//! Ask and tell in a shell.

use treewright_client::blocking::Client;
use treewright_client::{Configuration, Measurements, Outcome, Question, Value};

use crate::arguments::exec::{Report, Suggest, SuggestFormat};
use crate::exec::program::{same_words, variable};
use crate::exec::quoted;
use crate::failure::{Failure, Result};
use crate::files;
use crate::output::either;
use crate::progress;
use crate::show;

pub(super) fn suggest(client: &Client, ask: &Suggest, json: bool) -> Result<String> {
    let study = client.get_study(&ask.study)?;
    let parameters = study.spec().map(|spec| spec.space.parameters()).unwrap_or_default();
    let names: Vec<&str> = parameters.iter().map(|parameter| parameter.name.as_str()).collect();
    if ask.format == SuggestFormat::Args && !json {
        // Before there is a trial that nobody could run.
        distinct_arguments(&names)?;
    }
    let complete = |some: &[(String, Value)]| -> Result<Option<Configuration>> {
        if some.is_empty() {
            return Ok(None);
        }
        let some: Configuration = some.iter().cloned().collect();
        Ok(Some(study.spec()?.space.complete(&some)?.into()))
    };
    let question = Question {
        indicators: ask.indicators.iter().cloned().collect(),
        // One client for every line of a script, so that a trial that was not reported comes again.
        client_id: Some(ask.client.clone().unwrap_or_else(|| format!("shell@{}", files::host()))),
        session: Some(0),
        wanted: complete(&ask.wanted)?,
        start: complete(&ask.start)?,
        space_revision: study.space_revision,
        ..Question::default()
    };
    // The trial's name says of which study it is, should that be deleted and created again before the report.
    let trial = client.ask(&study.identified_name(), &question)?;
    match ask.format {
        SuggestFormat::Env if !json => {
            for (variable, _) in same_words(|name| variable(&ask.prefix, name), names.iter().copied()) {
                let advice = "only one of their values is in it; use --format json";
                progress::note(&format!("{variable} stands for several parameters, and {advice}"));
            }
            Ok(environment(&trial.name, &trial.configuration, &names, &ask.prefix))
        }
        SuggestFormat::Args if !json => {
            progress::note(&format!("trial: {}", trial.name));
            let words: Vec<_> = trial
                .configuration
                .iter()
                .map(|(name, value)| quoted(&format!("{}={value}", argument(name))))
                .collect();
            Ok(words.join(" ") + "\n")
        }
        _ => either(true, &trial, String::new),
    }
}

/// The argument for a parameter, as most programs spell theirs.
fn argument(parameter: &str) -> String {
    format!("--{}", parameter.replace('_', "-"))
}

/// Checks that no two parameters have one argument.
fn distinct_arguments(parameters: &[&str]) -> Result<()> {
    match same_words(argument, parameters.iter().copied()).first() {
        None => Ok(()),
        Some((word, parameter)) => Err(Failure::Usage(format!(
            "{word} would stand for the parameter {parameter} and for one before it; use --format json"
        ))),
    }
}

/// Lines that a shell takes as assignments. Of `parameters`, those that have no value in this trial are
/// unset: an earlier trial may have given them one in this shell.
fn environment(trial: &str, configuration: &Configuration, parameters: &[&str], prefix: &str) -> String {
    let mut text = format!("export TREEWRIGHT_TRIAL={}\n", quoted(trial));
    for name in parameters.iter().filter(|name| configuration.get(name).is_none()) {
        text += &format!("unset {}\n", variable(prefix, name));
    }
    for (name, value) in configuration.iter() {
        text += &format!("export {}={}\n", variable(prefix, name), quoted(&value.to_string()));
    }
    text
}

pub(super) fn report(client: &Client, report: &Report, json: bool) -> Result<String> {
    if report.abandon {
        let trial = client.give_back(&report.trial)?;
        return either(json, &trial, || format!("gave back {}", trial.name));
    }
    let outcome = match (&report.infeasible, &report.failed, report.aborted) {
        (Some(reason), _, _) => Outcome::infeasible(reason),
        (_, Some(reason), _) => Outcome::failed(reason),
        (_, _, Some(bound)) => Outcome::aborted(bound),
        _ => Outcome::Ok,
    };
    let measured: Measurements = report.measurements.iter().cloned().collect();
    let (trial, duplicate) = client.tell(&report.trial, &measured, &outcome)?;
    either(json, &trial, || {
        // A token that may only report reads no study.
        let study = trial.name.split('/').nth(1).and_then(|study| client.get_study(study).ok());
        let shown = trial.cost.zip(study).map(|(cost, study)| {
            let view = show::view(&study);
            format!(", {} {}", view.name(), show::figure(view.value(cost)))
        });
        let cost = shown.unwrap_or_default();
        let known = if duplicate { " (already reported before; unchanged)" } else { "" };
        format!("reported {}{known}{cost}", trial.name)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_of_one_argument_are_refused() {
        assert!(distinct_arguments(&["a_b", "ab", "A_B"]).is_ok());
        let refused = distinct_arguments(&["a_b", "c", "a-b"]).expect_err("both are --a-b").to_string();
        assert!(refused.contains("--a-b") && refused.contains("--format json"), "{refused}");
    }

    #[test]
    fn what_an_earlier_trial_left_in_the_shell_is_gone() {
        let configuration = Configuration::new().with("level", 3).with("mode", "a b");
        let text = environment("studies/s/trials/2", &configuration, &["level", "window", "mode"], "P_");
        let lines = ["export TREEWRIGHT_TRIAL=studies/s/trials/2", "unset P_WINDOW", "export P_LEVEL=3"];
        assert_eq!(text.lines().collect::<Vec<_>>(), [&lines[..], &["export P_MODE='a b'"]].concat());
    }
}
