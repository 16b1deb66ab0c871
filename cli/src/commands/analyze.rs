//! The influence of a study's parameters, from its trials.

use treewright_client::blocking::Client;
use treewright_client::{ClientError, Constraint, TrialQuery};

use crate::analysis::{self, Request, TRIALS_MIN};
use crate::arguments::data::Analyze;
use crate::failure::{Failure, Result};
use crate::output::either;

pub(super) fn run(client: &Client, wanted: &Analyze, json: bool) -> Result<String> {
    let study = client.get_study(&wanted.study)?;
    let (name, spec) = (study.identified_name(), study.spec()?.clone());
    let trials = |further: &str| -> Result<Vec<_>> {
        let parts = ["state = COMPLETED", &wanted.filter, further];
        let filter: Vec<&str> = parts.into_iter().filter(|part| !part.trim().is_empty()).collect();
        let query = TrialQuery::all().filter(filter.join(" AND ")).in_present_space();
        let mut trials = client.trials(&name, query).collect::<Result<Vec<_>, _>>()?;
        trials.retain(|trial| trial.exclusion.is_none());
        Ok(trials)
    };
    // Each by itself first, so that an error points into the user's own words and not into the joined ones.
    check(client, &name, "--filter", &wanted.filter)?;
    wanted.conditions.iter().try_for_each(|one| check(client, &name, "--condition", one))?;
    let all = trials("")?;
    if all.len() < TRIALS_MIN {
        return Err(Failure::Data(format!(
            "{} has {} such trial(s), but the analysis needs {TRIALS_MIN}; record more, for instance with `treewright exec` or `treewright-render sample`",
            wanted.study,
            all.len()
        )));
    }
    let mut conditions = Vec::new();
    for filter in &wanted.conditions {
        conditions.push((filter.clone(), trials(filter)?));
    }
    // Pairs that are ordered, such as both leaf sizes, are looked at together without being asked for.
    let ordered = spec.space.constraints().iter().filter_map(Constraint::as_order);
    let ordered = ordered.map(|(lesser, greater)| (lesser.to_owned(), greater.to_owned()));
    let maps = if wanted.maps.is_empty() { ordered.collect() } else { wanted.maps.clone() };
    let request = Request { study: wanted.study.clone(), metrics: wanted.metrics.clone(), maps };
    let analysis = analysis::analyse(&spec, &request, &all, &conditions);
    let Some(folder) = &wanted.out else {
        return either(json, &analysis, || analysis.words());
    };
    let failed = |error: std::io::Error| Failure::file(folder, error.to_string());
    std::fs::create_dir_all(folder).map_err(failed)?;
    let mut text = serde_json::to_string_pretty(&analysis)?;
    text.push('\n');
    std::fs::write(folder.join("analysis.json"), text).map_err(failed)?;
    std::fs::write(folder.join("analysis.html"), analysis::html(&analysis)).map_err(failed)?;
    either(json, &analysis, || analysis.words())
}

/// Whether the daemon understands a filter.
fn check(client: &Client, study: &str, option: &str, filter: &str) -> Result<()> {
    let query = TrialQuery::all().filter(filter);
    match client.trials(study, query).next() {
        Some(Err(problem)) if problem.is_invalid_argument() => {
            let ClientError::Refused { message, .. } = &problem else { return Err(problem.into()) };
            Err(Failure::Usage(format!("{option} '{filter}': {message}")))
        }
        Some(Err(problem)) => Err(problem.into()),
        _ => Ok(()),
    }
}
