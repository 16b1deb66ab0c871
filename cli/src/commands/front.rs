//! The Pareto front of a study's trials, over metrics that the study itself need not minimise.

use std::collections::BTreeSet;

use treewright_client::blocking::Client;
use treewright_client::{ClientError, Configuration, Front, TrialQuery, TrialRecord};

use crate::arguments::data::FrontOf;
use crate::failure::Failure;
use crate::output::either;
use crate::show;

pub(super) fn run(client: &Client, wanted: &FrontOf, json: bool) -> Result<String, Failure> {
    let front = Front::new(&wanted.metrics).map_err(ClientError::from)?;
    let reference = Some(wanted.reference.as_slice()).filter(|values| !values.is_empty());
    if reference.is_some_and(|values| values.len() != wanted.metrics.len()) {
        return Err(Failure::Usage("--reference wants one number above 0 for each metric".into()));
    }
    let study = client.get_study(&wanted.study)?;
    let spec = study.spec()?;
    let is_input = |name: &str| name != Front::DIRECTION;
    let has_inputs = spec.indicators.indicators().iter().any(|indicator| is_input(&indicator.name));
    let query = TrialQuery::all().filter("state = COMPLETED").in_present_space();
    let mut trials = client.trials(&study.identified_name(), query).collect::<Result<Vec<_>, _>>()?;
    trials.retain(|trial| trial.exclusion.is_none() && trial.fidelity.is_none());
    let machine = |trial: &TrialRecord| trial.fingerprint.as_ref().map(|machine| format!("{machine:?}"));
    match wanted.state {
        // The directions of a front are states of one machine, too.
        Some(state) => {
            let of_state = trials.iter().find(|trial| trial.state_id == state).map(machine);
            let is_meant = |trial: &TrialRecord| {
                trial.state_id == state || !has_inputs && Some(machine(trial)) == of_state
            };
            trials.retain(is_meant);
        }
        None => {
            let machines: BTreeSet<_> = trials.iter().map(machine).collect();
            let states: BTreeSet<_> = trials.iter().map(|trial| trial.state_id).collect();
            if machines.len() > 1 || has_inputs && states.len() > 1 {
                return Err(Failure::Usage(format!(
                    "{} has runs in {} states, on {} machine(s), which do not compare: choose one with --state \
                     NUMBER",
                    study.name,
                    states.len(),
                    machines.len()
                )));
            }
        }
    }
    let default = Configuration::from(spec.space.default_configuration());
    let found = front.of(trials.iter().filter_map(TrialRecord::measured_run), &default, reference);
    if let Some(file) = wanted.svg.as_ref().filter(|_| !found.points.is_empty()) {
        std::fs::write(file, show::front_svg(&found))
            .map_err(|error| Failure::file(file, error.to_string()))?;
    }
    either(json, &found, || show::front(&found, &default))
}
