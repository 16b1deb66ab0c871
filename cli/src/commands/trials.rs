//! Commands that read results: trials, best configurations, predictions, explanations.

use serde::Serialize;
use treewright_client::blocking::Client;
use treewright_client::{Best, Prediction, StudyRecord, TrialQuery};

use crate::arguments::State;
use crate::arguments::data::{TrialFormat, Trials};
use crate::carry::csv_table;
use crate::failure::{Failure, Result};
use crate::output::either;
use crate::{files, show};

/// Most states whose best configurations are listed.
const STATES_LISTED: i64 = 40;

pub(super) fn list(client: &Client, which: &Trials, json: bool) -> Result<String> {
    let mut filter = which.filter.clone();
    if let Some(after) = which.after {
        let join = if filter.trim().is_empty() { "" } else { " AND " };
        filter += &format!("{join}number > {after}");
    }
    let query = TrialQuery::all().filter(filter).order_by(&which.order_by);
    let limit = if which.all { usize::MAX } else { which.limit };
    let read = |study: &str| client.trials(study, query).take(limit).collect::<Result<Vec<_>, _>>();
    if which.format == TrialFormat::Csv && !json {
        let study = client.get_study(&which.study)?;
        let trials = read(&study.identified_name())?;
        let mut text = Vec::new();
        csv_table::write(&mut text, study.spec()?, trials.into_iter().map(Ok), &files::host())?;
        return Ok(String::from_utf8_lossy(&text).into_owned());
    }
    if which.format == TrialFormat::Table && !json {
        let study = client.get_study(&which.study)?;
        let trials = read(&study.identified_name())?;
        return Ok(show::trials(&trials, limit, which.order_by.is_empty(), &show::view(&study)));
    }
    either(true, &read(&which.study)?, String::new)
}

/// The prediction in a state, and its study, which is asked under its identity: in another study that takes
/// the id meanwhile, a number names another state.
fn predicted(client: &Client, state: &State) -> Result<(Prediction, StudyRecord)> {
    let study = client.get_study(&state.study)?;
    let name = study.identified_name();
    let indicators = match state.state {
        None => state.indicators.iter().cloned().collect(),
        Some(number) => {
            let known = client.trial_in_state(&name, number)?;
            let none = || Failure::Data(format!("{} has no trial in state {number}", state.study));
            known.ok_or_else(none)?.indicators
        }
    };
    Ok((client.predict(&name, &indicators)?, study))
}

pub(super) fn best(client: &Client, state: &State, json: bool) -> Result<String> {
    let study = client.get_study(&state.study)?;
    let name = study.identified_name();
    if let Some(number) = state.state {
        let none = || Failure::Data(format!("nothing measured in state {number} of {}", state.study));
        let best = client.best_of_state(&name, number)?.ok_or_else(none)?;
        return show_best(&best, &study, json);
    }
    if !state.indicators.is_empty() || study.statistics.states <= 1 {
        let best = client.best(&name, &state.indicators.iter().cloned().collect())?;
        return show_best(&best, &study, json);
    }
    if json {
        return Err(Failure::Usage(format!(
            "{} has {} states, each with its own best configuration: choose one with --state NUMBER or \
             --indicator NAME=NUMBER",
            study.name, study.statistics.states
        )));
    }
    let found = super::studies::best_of_states(client, &study, STATES_LISTED)?;
    Ok(show::best_of_states(&found, &study))
}

/// The best with what its costs stand for where one metric is maximised and nothing else counts.
#[derive(Serialize)]
struct BestAsJson<'a> {
    #[serde(flatten)]
    best: &'a Best,
    #[serde(skip_serializing_if = "Option::is_none")]
    value: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    default_value: Option<f64>,
}

fn show_best(best: &Best, study: &StudyRecord, json: bool) -> Result<String> {
    if json {
        let view = show::view(study);
        let (value, default_value) =
            (view.maximum(best.cost), best.default_cost.and_then(|cost| view.maximum(cost)));
        return either(json, &BestAsJson { best, value, default_value }, String::new);
    }
    Ok(show::best(best, study.spec()?))
}

pub(super) fn predict(client: &Client, state: &State, json: bool) -> Result<String> {
    let (prediction, study) = predicted(client, state)?;
    if json {
        return either(json, &prediction, String::new);
    }
    Ok(show::prediction(&prediction, study.spec()?))
}

/// A trial's name without `studies/`, with which it may begin, as names of studies may everywhere here. The
/// study itself may be called `studies`.
fn short(name: &str) -> &str {
    name.strip_prefix("studies/").filter(|rest| rest.contains("/trials/")).unwrap_or(name)
}

fn trial_name(name: &str) -> String {
    format!("studies/{}", short(name))
}

/// Excludes a trial for a reason, or counts it again without one.
pub(super) fn exclude(client: &Client, trial: &str, reason: Option<&str>, json: bool) -> Result<String> {
    let stored = client.exclude(&trial_name(trial), reason)?;
    either(json, &stored, || match reason {
        Some(_) => {
            let name = short(&stored.name);
            format!("nothing is learnt from {name} any more; undo this with `treewright include {name}`")
        }
        None => format!("{} counts again", stored.name),
    })
}

pub(super) fn explain(client: &Client, state: &State, json: bool) -> Result<String> {
    if state.study.contains("/trials/") {
        let trial = client.trial(&trial_name(&state.study))?;
        if json {
            return either(json, &trial, String::new);
        }
        let study = trial.name.split('/').nth(1).unwrap_or_default();
        return Ok(show::trial(&trial, &show::view(&client.get_study(study)?)));
    }
    let (prediction, study) = predicted(client, state)?;
    either(json, &prediction, || show::explanation(&prediction, &show::view(&study)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn trials_are_named_with_or_without_the_prefix_even_those_of_a_study_called_like_it() {
        for (said, meant) in [
            ("hall/trials/3", "studies/hall/trials/3"),
            ("studies/hall/trials/3", "studies/hall/trials/3"),
            ("studies/trials/3", "studies/studies/trials/3"),
            ("studies/studies/trials/3", "studies/studies/trials/3"),
        ] {
            assert_eq!(trial_name(said), meant);
            assert_eq!(trial_name(short(meant)), meant, "the short name means that trial");
        }
    }
}
