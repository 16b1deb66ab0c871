//! The Pareto front of a study's trials, over metrics that the study itself need not minimise.

use treewright_client::blocking::Client;
use treewright_client::{Configuration, Front, TrialQuery};

use crate::arguments::data::FrontOf;
use crate::failure::Failure;
use crate::output::either;
use crate::show;

pub(super) fn run(client: &Client, wanted: &FrontOf, json: bool) -> Result<String, Failure> {
    let front = Front::new(&wanted.metrics)?;
    let reference = Some(wanted.reference.as_slice()).filter(|values| !values.is_empty());
    if reference.is_some_and(|values| values.len() != wanted.metrics.len()) {
        return Err(Failure::Usage("--reference wants one number above 0 for each metric".into()));
    }
    let study = client.get_study(&wanted.study)?;
    let spec = study.spec()?;
    let is_input = |name: &str| name != Front::DIRECTION;
    let has_inputs = spec.indicators.indicators().iter().any(|indicator| is_input(&indicator.name));
    if wanted.state.is_none() && has_inputs && study.statistics.states > 1 {
        return Err(Failure::Usage(format!(
            "{} has {} states, whose runs do not compare: choose one with --state NUMBER",
            study.name, study.statistics.states
        )));
    }
    let state = wanted.state.map(|state| format!(" AND state_id = {state}")).unwrap_or_default();
    let query = TrialQuery::all().filter(format!("state = COMPLETED{state}"));
    let trials = client.trials(&study.identified_name(), query).collect::<Result<Vec<_>, _>>()?;
    let default = Configuration::from(spec.space.default_configuration());
    let found = front.of(&trials, &default, reference);
    if let Some(file) = wanted.svg.as_ref().filter(|_| !found.points.is_empty()) {
        std::fs::write(file, show::front_svg(&found))
            .map_err(|error| Failure::file(file, error.to_string()))?;
    }
    either(json, &found, || show::front(&found, &default))
}
