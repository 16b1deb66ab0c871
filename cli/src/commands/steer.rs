//! The policy of a study: show and change it, pin a configuration, freeze.

use treewright_client::blocking::Client;
use treewright_client::{Configuration, Operation, Policy, PolicyChange, StudyRecord};

use crate::arguments::study::{self, Pin};
use crate::failure::{Failure, Result};
use crate::output::either;
use crate::show;

pub(super) fn policy(client: &Client, change: &study::Policy, json: bool) -> Result<String> {
    let (mut name, mut set) = (change.study.clone(), change.settings.0.clone());
    if !change.pin.is_empty() {
        let study = client.get_study(&change.study)?;
        set.pinned = Some(whole(&study, &change.pin.iter().cloned().collect())?);
        name = study.identified_name();
    }
    let mut clear = change.clear.clone();
    clear.extend(change.unpin.then(|| "pinned".to_owned()));
    if set == Policy::new() && clear.is_empty() {
        return show_policy(&client.get_study(&change.study)?, json);
    }
    show_policy(&client.update_policy(&name, &PolicyChange { set, clear })?, json)
}

/// A configuration of all parameters.
fn whole(study: &StudyRecord, some: &Configuration) -> Result<Configuration> {
    Ok(study.spec()?.space.complete(some)?.into())
}

fn show_policy(study: &StudyRecord, json: bool) -> Result<String> {
    either(json, &study.policy, || show::policy(&study.policy))
}

pub(super) fn pin(client: &Client, pin: &Pin, json: bool) -> Result<String> {
    let study = client.get_study(&pin.study)?;
    let name = study.identified_name();
    let configuration = if !pin.values.is_empty() {
        whole(&study, &pin.values.iter().cloned().collect())?
    } else {
        let states = study.statistics.states;
        let best = match pin.state {
            None if states > 1 => {
                return Err(Failure::Usage(format!(
                    "{} has {states} states, and a pinned configuration applies to all of them: name the \
                     configuration, or use the best of one state with --state NUMBER",
                    pin.study
                )));
            }
            state => client.best_of_state(&name, state.unwrap_or(1))?,
        };
        best.ok_or_else(|| Failure::Data(format!("nothing measured there in {}", pin.study)))?.configuration
    };
    let change = PolicyChange::set(Policy::new().pinned(configuration.clone()));
    let study = client.update_policy(&name, &change)?;
    either(json, &study.policy, || {
        format!(
            "every client of {} gets {configuration}; undo this with `treewright unpin {}`",
            pin.study, pin.study
        )
    })
}

pub(super) fn unpin(client: &Client, study: &str, json: bool) -> Result<String> {
    let stored = client.update_policy(study, &PolicyChange::unpin())?;
    either(json, &stored.policy, || format!("{study} follows its policy again"))
}

pub(super) fn freeze(client: &Client, study: &str, freezes: bool, json: bool) -> Result<String> {
    let change = if freezes {
        PolicyChange::set(Policy::new().operation(Operation::Freeze))
    } else {
        PolicyChange::clear(["operation"])
    };
    let stored = client.update_policy(study, &change)?;
    either(json, &stored.policy, || {
        if freezes {
            format!("{study} is frozen; undo this with `treewright thaw {study}`")
        } else {
            format!("{study} explores and learns again")
        }
    })
}
