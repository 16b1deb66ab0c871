//! What a study's parameters do, from its trials.

use treewright_client::TrialQuery;
use treewright_client::blocking::Client;

use crate::analysis::{self, Request, TRIALS_MIN};
use crate::arguments::data::Analyze;
use crate::failure::Failure;
use crate::output::either;

pub(super) fn run(client: &Client, wanted: &Analyze, json: bool) -> Result<String, Failure> {
    let study = client.get_study(&wanted.study)?;
    let spec = study.spec()?.clone();
    let trials = |further: &str| -> Result<Vec<_>, Failure> {
        let parts = ["state = COMPLETED", &wanted.filter, further];
        let filter: Vec<&str> = parts.into_iter().filter(|part| !part.trim().is_empty()).collect();
        let query = TrialQuery::all().filter(filter.join(" AND "));
        Ok(client.trials(&wanted.study, query).collect::<Result<_, _>>()?)
    };
    let all = trials("")?;
    if all.len() < TRIALS_MIN {
        return Err(Failure::Data(format!(
            "{} has {} such trial(s), but the analysis needs {TRIALS_MIN}; record more with `treewright-render sample`",
            wanted.study,
            all.len()
        )));
    }
    let mut conditions = Vec::new();
    for filter in &wanted.conditions {
        conditions.push((filter.clone(), trials(filter)?));
    }
    // Pairs that are ordered, such as both leaf sizes, are looked at together without being asked for.
    let ordered = spec.space.constraints().iter().map(|pair| (pair.lesser.clone(), pair.greater.clone()));
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
