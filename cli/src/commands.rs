//! One function per command: ask the daemon, and turn the answer into text.

use serde::Serialize;
use treewright_client::blocking::Client;
use treewright_client::{Configuration, Indicators, Options, PolicyChange, TrialQuery};

use crate::arguments::{self, Arguments, Command, StudyCommand};
use crate::failure::Failure;
use crate::show;

/// Does what the command line says and returns what is to be printed.
pub(crate) fn run(arguments: &Arguments) -> Result<String, Failure> {
    let options =
        Options::new().call_deadline(arguments.timeout).credentials(arguments.credentials.credentials()?);
    let client = Client::connect(&arguments.server, options)?;
    let json = arguments.json;
    match &arguments.command {
        Command::Studies => studies(&client, json),
        Command::Study(StudyCommand::Show { name }) => show_study(&client, name, json),
        Command::Study(StudyCommand::Delete { name, yes }) => delete_study(&client, name, *yes, json),
        Command::Trials(which) => trials(&client, which, json),
        Command::Best(state) => best(&client, state, json),
        Command::Predict(state) => predict(&client, state, json),
        Command::Explain(state) => explain(&client, state, json),
        Command::Policy(change) => policy(&client, change, json),
        Command::Ping => ping(&client, json),
    }
}

/// JSON where it is wished, else the words for people.
fn either(json: bool, record: &impl Serialize, words: impl FnOnce() -> String) -> Result<String, Failure> {
    let mut text = if json { serde_json::to_string_pretty(record)? } else { words() };
    if !text.ends_with('\n') {
        text.push('\n');
    }
    Ok(text)
}

fn studies(client: &Client, json: bool) -> Result<String, Failure> {
    let studies = client.list_studies()?;
    either(json, &studies, || show::studies(&studies))
}

fn show_study(client: &Client, name: &str, json: bool) -> Result<String, Failure> {
    let study = client.get_study(name)?;
    either(json, &study, || show::study(&study))
}

fn delete_study(client: &Client, name: &str, yes: bool, json: bool) -> Result<String, Failure> {
    if !yes {
        let study = client.get_study(name)?;
        let trials = study.statistics.trials;
        let message =
            format!("this deletes {} with its {trials} trial(s) for ever; say --yes to do it", study.name);
        return Err(Failure::Usage(message));
    }
    client.delete_study(name)?;
    either(json, &serde_json::json!({ "deleted": name }), || format!("deleted {name}"))
}

fn trials(client: &Client, which: &arguments::Trials, json: bool) -> Result<String, Failure> {
    let query = TrialQuery::all().filter(&which.filter).order_by(&which.order_by);
    let trials: Vec<_> = client.trials(&which.study, query).take(which.limit).collect::<Result<_, _>>()?;
    either(json, &trials, || show::trials(&trials, which.limit))
}

fn best(client: &Client, state: &arguments::State, json: bool) -> Result<String, Failure> {
    let best = client.best(&state.study, &indicators(state))?;
    if json {
        return either(json, &best, String::new);
    }
    let study = client.get_study(&state.study)?;
    Ok(show::best(&best, study.spec()?))
}

fn predict(client: &Client, state: &arguments::State, json: bool) -> Result<String, Failure> {
    let prediction = client.predict(&state.study, &indicators(state))?;
    if json {
        return either(json, &prediction, String::new);
    }
    let study = client.get_study(&state.study)?;
    Ok(show::prediction(&prediction, study.spec()?))
}

fn explain(client: &Client, state: &arguments::State, json: bool) -> Result<String, Failure> {
    let prediction = client.predict(&state.study, &indicators(state))?;
    either(json, &prediction, || show::explanation(&prediction))
}

fn policy(client: &Client, change: &arguments::Policy, json: bool) -> Result<String, Failure> {
    let mut set = change.settings.0.clone();
    if !change.pin.is_empty() {
        let some: Configuration = change.pin.iter().cloned().collect();
        set.pinned = Some(client.get_study(&change.study)?.spec()?.space.complete(&some)?.into());
    }
    let mut clear = change.clear.clone();
    clear.extend(change.unpin.then(|| "pinned".to_owned()));
    let study = client.update_policy(&change.study, &PolicyChange { set, clear })?;
    either(json, &study.policy, || show::policy(&study.policy))
}

fn ping(client: &Client, json: bool) -> Result<String, Failure> {
    // The first answer includes connecting; the second says how far away the daemon is.
    client.ping()?;
    let round_trip_ms = client.ping()?.as_secs_f64() * 1e3;
    let record =
        serde_json::json!({ "server": client.url(), "serving": true, "round_trip_ms": round_trip_ms });
    either(json, &record, || format!("{} is serving; a round trip takes {round_trip_ms:.2} ms", client.url()))
}

fn indicators(state: &arguments::State) -> Indicators {
    state.indicators.iter().cloned().collect()
}
