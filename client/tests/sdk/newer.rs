//! A daemon that is newer than the client: it knows methods, modes, rules, outcomes and domains that the
//! client has never heard of. The usable part works; the unreadable part is shown as such, where it stands.

use std::time::Duration;

use treewright_client::{
    Client, ClientError, Mode, OpenEnum, Outcome, Policy, PolicyChange, Source, TrialQuery,
};
use treewright_proto::v1;

use super::support::{Fake, measured, patient, spec, state};

/// Puts the study `scene` under a policy of tomorrow.
fn set_new_methods(fake: &Fake) {
    let mut book = fake.book();
    let study = book.studies.get_mut("studies/scene").expect("the study");
    let policy = study.policy.get_or_insert_default();
    (policy.predictor, policy.search, policy.operation) = (8, 9, 7);
}

#[tokio::test]
async fn unknown_methods_are_listed_and_left_alone() {
    let (fake, client) = Fake::with_client();
    client.study("other", spec()).await.unwrap();
    client.study("scene", spec()).await.unwrap();
    set_new_methods(&fake);

    let studies = client.list_studies().await.unwrap();
    assert_eq!(studies.len(), 2);
    let record = studies.iter().find(|study| study.id() == "scene").unwrap();
    assert_eq!(record.policy.predictor, Some(OpenEnum::Unrecognised(8)));
    assert_eq!(record.policy.show("search").as_deref(), Some("unrecognised (9)"));
    assert_eq!(serde_json::to_value(record).unwrap()["policy"]["operation"], "unrecognised (7)");

    let study = client.existing_study("scene").await.unwrap();
    let suggestion = study.suggest(&state(3)).await;
    assert_eq!(suggestion.source(), Source::Daemon);
    suggestion.report(measured(12.5), Outcome::Ok).unwrap();

    // Changing one field leaves the others as they are.
    let change = PolicyChange::set(Policy::new().epsilon(0.5));
    let changed = client.update_policy("scene", &change).await.unwrap();
    assert_eq!(changed.policy.epsilon, Some(0.5));
    assert_eq!(changed.policy.predictor, Some(OpenEnum::Unrecognised(8)));
}

#[tokio::test]
async fn unknown_modes_and_rules_are_run_and_shown() {
    let fake = Fake::start();
    fake.book().newer = true;
    let client = Client::connect(&fake.url(), patient()).unwrap();
    let study = client.study("scene", spec()).await.unwrap();
    let suggestion = study.suggest(&state(3)).await;
    assert_eq!((suggestion.source(), suggestion.mode()), (Source::Daemon, OpenEnum::Unrecognised(17)));
    assert_ne!(suggestion.mode(), Mode::Explore);
    let rule = suggestion.reason().explanation.rule.unwrap();
    assert_eq!(rule.to_string(), "unrecognised (77)");
    suggestion.report(measured(12.5), Outcome::Ok).unwrap();
    client.flush(Duration::from_secs(20)).await.unwrap();

    fake.book().trials[0].outcome = Some(v1::Outcome { kind: None });
    fake.book().trials[0].state = 9;
    let trials = client.trials("scene", TrialQuery::all()).take(10).await.unwrap();
    assert_eq!(trials[0].outcome, Some(OpenEnum::Unrecognised(0)));
    assert_eq!(trials[0].state.to_string(), "unrecognised (9)");
    let json = serde_json::to_value(&trials[0]).unwrap();
    assert_eq!([&json["mode"], &json["outcome"]], ["unrecognised (17)", "unrecognised"]);
}

#[tokio::test]
async fn a_space_that_cannot_be_read_is_told_by_its_study_alone() {
    let (fake, client) = Fake::with_client();
    client.study("other", spec()).await.unwrap();
    client.study("scene", spec()).await.unwrap();
    {
        let mut book = fake.book();
        let study = book.studies.get_mut("studies/scene").expect("the study");
        study.space.as_mut().expect("a space").parameters[0].domain = None;
    }
    let studies = client.list_studies().await.unwrap();
    let readable: Vec<bool> = studies.iter().map(|study| study.spec().is_ok()).collect();
    assert_eq!(readable, [true, false]);
    let json = serde_json::to_value(&studies[1]).unwrap();
    assert!(json["spec"]["unreadable"].as_str().unwrap().contains("parameters[0].domain"));
    let error = client.existing_study("scene").await.unwrap_err();
    assert!(matches!(error, ClientError::Malformed { .. }), "{error}");
    assert!(error.to_string().contains("different versions"), "{error}");
}

#[tokio::test]
async fn a_value_that_cannot_be_read_is_shown_and_not_run() {
    let (fake, client, study) = Fake::with_study().await;
    study.suggest(&state(3)).await.report(measured(12.5), Outcome::Ok).unwrap();
    client.flush(Duration::from_secs(20)).await.unwrap();
    {
        let mut book = fake.book();
        let name = "studies/scene/trials/2".to_owned();
        let mut next = v1::Trial { name, state: v1::TrialState::Open.into(), ..book.trials[0].clone() };
        next.indicators = state(4).iter().map(|(name, value)| (name.to_owned(), value)).collect();
        let configuration = next.configuration.as_mut().expect("a configuration");
        configuration.values.insert("max_depth".to_owned(), v1::Value { kind: None });
        book.trials.push(next);
    }
    let trials = client.trials("scene", TrialQuery::all()).take(2).await.unwrap();
    assert_eq!(trials[1].unreadable, ["max_depth"]);
    let suggestion = study.suggest(&state(4)).await;
    // That trial was given back. Another may have come in its place.
    assert_ne!(suggestion.trial(), Some("studies/scene/trials/2"));
    assert!(suggestion.configuration().integer("max_depth").is_ok());
}
