//! A bare client of the wire contract, without the SDK's fallbacks: tests see the daemon's own answers.

use std::collections::BTreeMap;

use tonic::transport::Channel;
use tonic::{Response, Status};
use treewright_client::{Policy, Scale, Space, StudySpec};
use treewright_proto::convert::spec_to_wire;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;
use treewright_proto::v1::{self as pb, value::Kind};

/// Connects, or says why not.
pub(crate) async fn connect(url: &str) -> TuningServiceClient<Channel> {
    TuningServiceClient::connect(url.to_owned()).await.expect("the daemon answers")
}

/// A study with two integers, a float and two indicators; every state change explores.
pub(crate) fn study() -> pb::Study {
    let space = Space::builder().integer("fewest", 1..=32).default(1).integer("most", 1..=32).default(32);
    let space = space.float("weight", 0.0..=10.0).default(1.0).less_or_equal("fewest", "most");
    let spec = StudySpec::builder(space.build().expect("a space")).minimise("render_ms", 1.0).seed(7);
    let indicators = ["near", "far"].into_iter();
    let spec = indicators.fold(spec, |spec, name| spec.indicator(name, 0.0..=1.0, Scale::Linear));
    spec_to_wire(&spec.policy(Policy::new().epsilon(1.0)).build().expect("a specification"))
}

/// Creates (or finds) [`study`] as `studies/ID` and returns its name.
pub(crate) async fn create(client: &mut TuningServiceClient<Channel>, id: &str) -> String {
    let request = pb::CreateStudyRequest { study_id: id.into(), study: Some(study()) };
    client.create_study(request).await.expect("the study is taken").into_inner().name
}

/// Asks for a trial in a state.
pub(crate) fn suggestion(study: &str, client_id: &str, near: f64) -> pb::SuggestRequest {
    let indicators = BTreeMap::from([("near".to_owned(), near), ("far".to_owned(), 0.5)]);
    let (study, client_id) = (study.into(), client_id.into());
    pb::SuggestRequest { study, client_id, indicators, ..pb::SuggestRequest::default() }
}

/// A configuration as comparable text.
pub(crate) fn text(configuration: &pb::Configuration) -> String {
    configuration.values.iter().map(|(name, value)| format!("{name}={:?} ", value.kind)).collect()
}

/// A measurement of the pretend renderer: a bowl with its minimum inside the space.
pub(crate) fn render_ms(configuration: &pb::Configuration) -> f64 {
    let number = |name: &str| match configuration.values[name].kind {
        Some(Kind::Integer(value)) => value as f64,
        Some(Kind::Float(value)) => value,
        _ => panic!("{name} is not a number"),
    };
    let (fewest, most, weight) = (number("fewest"), number("most"), number("weight"));
    10.0 + (fewest - 4.0).powi(2) / 50.0 + (most - 12.0).powi(2) / 80.0 + (weight - 3.0).powi(2)
}

/// The report of a trial that went well.
pub(crate) fn report(trial: &pb::Trial) -> pb::ReportRequest {
    let render_ms = render_ms(trial.configuration.as_ref().expect("a trial has a configuration"));
    pb::ReportRequest {
        trial: trial.name.clone(),
        measurements: BTreeMap::from([("render_ms".to_owned(), render_ms), ("build_ms".to_owned(), 3.0)]),
        outcome: Some(pb::Outcome { kind: Some(pb::outcome::Kind::Ok(pb::Ok {})) }),
        ..pb::ReportRequest::default()
    }
}

/// All trials of a study that match a filter, over all pages.
pub(crate) async fn query(
    client: &mut TuningServiceClient<Channel>,
    study: &str,
    filter: &str,
) -> Vec<pb::Trial> {
    query_by(async |request| client.query_trials(request).await, study, filter).await
}

/// Queries trials through any function that asks.
pub(crate) async fn query_by(
    mut ask: impl AsyncFnMut(pb::QueryTrialsRequest) -> Result<Response<pb::QueryTrialsResponse>, Status>,
    study: &str,
    filter: &str,
) -> Vec<pb::Trial> {
    let (study, filter) = (study.into(), filter.into());
    let mut request = pb::QueryTrialsRequest { study, filter, page_size: 50, ..Default::default() };
    let mut trials = Vec::new();
    loop {
        let page = ask(request.clone()).await.expect("the query is answered").into_inner();
        trials.extend(page.trials);
        if page.next_page_token.is_empty() {
            return trials;
        }
        request.page_token = page.next_page_token;
    }
}
