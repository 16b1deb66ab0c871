//! The Pareto front of a study's trials, over metrics that the study itself need not minimise.

use treewright_client::blocking::Client;
use treewright_client::{ClientError, Front, FrontQuery};

use crate::arguments::data::FrontOf;
use crate::failure::{Failure, Result};
use crate::output::either;
use crate::show;

pub(super) fn run(client: &Client, wanted: &FrontOf, json: bool) -> Result<String> {
    let named = (!wanted.metrics.is_empty()).then(|| Front::new(&wanted.metrics));
    let front = named.transpose().map_err(ClientError::from)?;
    let reference = Some(wanted.reference.clone()).filter(|values| !values.is_empty());
    let query = FrontQuery { front, state: wanted.state, reference };
    let found = client.front(&wanted.study, &query)?;
    if let Some(file) = wanted.svg.as_ref().filter(|_| !found.points.is_empty()) {
        std::fs::write(file, show::front_svg(&found))
            .map_err(|error| Failure::file(file, error.to_string()))?;
    }
    either(json, &found, || show::front(&found))
}
