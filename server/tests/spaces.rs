//! A study's space changes while it has trials: nothing is lost, and clients of the space before go on.

mod common;

use std::collections::BTreeMap;

use common::{
    Client, START_MS, Server, ask, assert_refused, configuration, create, creation, done, get, integer,
    report, study, text,
};
use tonic::Code;
use treewright_proto::v1::{self as wire, parameter, value};

fn whole(name: &str, min: i64, max: i64, default: i64) -> wire::Parameter {
    wire::Parameter {
        name: name.to_owned(),
        domain: Some(parameter::Domain::Integer(wire::IntegerDomain { min, max, scale: 0 })),
        default_value: Some(integer(default)),
        active_if: None,
        setup: false,
    }
}

fn space() -> wire::Space {
    study().space.expect("it has one")
}

/// The space with other values of `quality`.
fn of_qualities(qualities: &[&str]) -> wire::Space {
    let mut space = space();
    let values = qualities.iter().map(|quality| text(quality)).collect();
    space.parameters[2].domain = Some(parameter::Domain::Categorical(wire::CategoricalDomain { values }));
    space
}

/// More room: further values of `max_leaf` and `quality`, and another parameter.
fn wider() -> wire::Space {
    let mut space = of_qualities(&["low", "high", "ultra"]);
    space.parameters[1] = whole("max_leaf", 1, 64, 8);
    space.parameters.push(whole("spp", 1, 16, 4));
    space
}

fn change(revision: u32, space: wire::Space) -> wire::ChangeSpaceRequest {
    let (name, space) = ("studies/hall".to_owned(), Some(space));
    wire::ChangeSpaceRequest { name, revision, space, ..Default::default() }
}

/// Kept, outside and given back.
async fn changed(client: &mut Client, request: wire::ChangeSpaceRequest) -> (i64, i64, i64) {
    let answer = client.change_space(request).await.expect("changed").into_inner();
    (answer.kept_trials, answer.outside_trials, answer.given_back_trials)
}

fn values(trial: &wire::Trial) -> BTreeMap<String, wire::Value> {
    trial.configuration.clone().expect("it has one").values
}

fn number(values: &BTreeMap<String, wire::Value>, name: &str) -> Option<i64> {
    match values.get(name)?.kind {
        Some(value::Kind::Integer(number)) => Some(number),
        _ => None,
    }
}

/// A frame of a client that knows a revision of the space, 0 for the present one.
async fn frame(client: &mut Client, name: &str, space_revision: u32) -> wire::Trial {
    let request = wire::SuggestRequest { space_revision, ..ask(name, 10.0) };
    let trial = client.suggest(request).await.expect("a trial").into_inner();
    let values = values(&trial);
    let cost = 100 - number(&values, "max_leaf").unwrap_or(0) - number(&values, "spp").unwrap_or(4);
    done(client, &trial.name, cost as f64).await;
    trial
}

async fn created(client: &mut Client, space: wire::Space) -> Result<wire::Study, tonic::Status> {
    let study = wire::Study { space: Some(space), ..study() };
    client.create_study(creation("hall", study)).await.map(tonic::Response::into_inner)
}

async fn best(client: &mut Client) -> wire::Best {
    let request = wire::GetBestRequest { study: "studies/hall".to_owned(), ..Default::default() };
    client.get_best(request).await.expect("something was measured").into_inner()
}

#[tokio::test]
async fn trials_stay_and_clients_of_both_spaces_are_served() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let path = folder.path().join("studies.db");
    let server = Server::on_disk(&path, START_MS).await;
    let mut client = server.client().await;
    assert_eq!(create(&mut client, "hall").await.space_revision, 1);
    for _ in 0..12 {
        frame(&mut client, "a", 1).await;
    }
    let dry = wire::ChangeSpaceRequest { validate_only: true, ..change(1, wider()) };
    assert_eq!(changed(&mut client, dry).await, (12, 0, 0));
    assert_eq!(create(&mut client, "hall").await.space_revision, 1, "nothing was changed");
    assert_eq!(changed(&mut client, change(1, wider())).await, (12, 0, 0));
    assert_eq!(changed(&mut client, change(1, wider())).await, (12, 0, 0), "it is repeated");
    let stale = client.change_space(change(1, of_qualities(&["low"]))).await;
    assert_refused(stale, Code::FailedPrecondition, "has revision 2, not 1");

    let first = get(&mut client, "studies/hall/trials/1").await;
    assert_eq!(number(&values(&first), "spp"), None, "a trial keeps what it ran with");
    for (in_present_space, spp) in [(false, None), (true, Some(4))] {
        let study = "studies/hall".to_owned();
        let query = wire::QueryTrialsRequest { study, in_present_space, ..Default::default() };
        let page = client.query_trials(query).await.expect("a page").into_inner();
        assert_eq!(page.trials.len(), 12);
        assert!(page.trials.iter().all(|trial| number(&values(trial), "spp") == spp));
    }
    let known = best(&mut client).await.configuration.expect("it has one");
    assert_eq!(number(&known.values, "spp"), Some(4), "and is read with the default");

    let mut explored = false;
    for _ in 0..30 {
        let values = values(&frame(&mut client, "new", 0).await);
        explored |= number(&values, "spp") != Some(4);
    }
    assert!(explored, "the search goes on in the new space");
    for _ in 0..20 {
        let trial = frame(&mut client, "old", 1).await;
        let values = values(&trial);
        let names: Vec<&str> = values.keys().map(String::as_str).collect();
        assert_eq!(names, ["max_leaf", "min_leaf", "quality"], "{trial:?}");
        assert!(number(&values, "max_leaf") <= Some(32) && values["quality"] != text("ultra"), "{trial:?}");
        let stored = get(&mut client, &trial.name).await;
        assert_eq!(stored.state(), wire::TrialState::Completed);
        assert!(number(&self::values(&stored), "spp").is_some(), "{stored:?}");
    }

    for (space_revision, parameters) in [(0, 4), (1, 3), (2, 4)] {
        let (study, indicators) = ("studies/hall".to_owned(), common::triangles(10.0));
        let request = wire::PredictRequest { study, indicators, space_revision, ..Default::default() };
        let predicted = client.predict(request).await.expect("an answer").into_inner();
        assert_eq!(predicted.configuration.expect("it has one").values.len(), parameters);
    }

    let old = created(&mut client, space()).await.expect("found");
    assert_eq!((old.space_revision, old.space.expect("it has one").parameters.len()), (1, 3));
    let new = created(&mut client, wider()).await.expect("found");
    assert_eq!((new.space_revision, new.space.expect("it has one").parameters.len()), (2, 4));
    let other = created(&mut client, of_qualities(&["low"])).await;
    assert_refused(other, Code::AlreadyExists, "change the study's space");

    let before = best(&mut client).await;
    server.stop().await;
    let server = Server::on_disk(&path, START_MS).await;
    let mut client = server.client().await;
    assert_eq!(best(&mut client).await, before);
    frame(&mut client, "old", 1).await;
    frame(&mut client, "new", 0).await;
    server.stop().await;
}

/// A trial of a configuration that the client wants.
async fn wanted(client: &mut Client, name: &str, quality: &str) -> wire::Trial {
    let wanted = Some(configuration(8, quality));
    client.suggest(wire::SuggestRequest { wanted, ..ask(name, 10.0) }).await.expect("a trial").into_inner()
}

#[tokio::test]
async fn clients_of_the_space_before_explore_it_by_themselves() {
    let (server, mut client) = Server::with_hall().await;
    assert_eq!(changed(&mut client, change(1, wider())).await, (0, 0, 0));
    let mut met = Vec::new();
    for _ in 0..30 {
        let trial = frame(&mut client, "old", 1).await;
        let values = values(&trial);
        assert!(number(&values, "max_leaf") <= Some(32) && !values.contains_key("spp"), "{trial:?}");
        if !met.contains(&values) {
            met.push(values);
        }
    }
    assert!(met.len() >= 10, "{} configurations", met.len());
    server.stop().await;
}

#[tokio::test]
async fn the_best_is_told_to_clients_of_the_space_before_as_they_know_it() {
    let (server, mut client) = Server::with_hall().await;
    assert_eq!(changed(&mut client, change(1, wider())).await, (0, 0, 0));
    let best = |space_revision| wire::GetBestRequest {
        study: "studies/hall".to_owned(),
        space_revision,
        ..Default::default()
    };
    for (max_leaf, spp, cost) in [(50, 9, 1.0), (24, 4, 5.0)] {
        let unknown = client.get_best(best(1)).await.expect_err("nothing that it knows");
        assert_eq!(unknown.code(), if max_leaf == 50 { Code::NotFound } else { Code::FailedPrecondition });
        let numbers = [("min_leaf", 1), ("max_leaf", max_leaf), ("spp", spp)];
        let mut values = BTreeMap::from([("quality".to_owned(), text("low"))]);
        values.extend(numbers.map(|(name, number)| (name.to_owned(), integer(number))));
        let wanted = Some(wire::Configuration { values });
        let request = wire::SuggestRequest { wanted, ..ask("new", 10.0) };
        let trial = client.suggest(request).await.expect("a trial").into_inner();
        done(&mut client, &trial.name, cost).await;
    }
    let known = client.get_best(best(1)).await.expect("it knows one").into_inner();
    let values = known.configuration.clone().expect("it has one").values;
    assert_eq!((values.len(), number(&values, "max_leaf"), known.cost), (3, Some(24), 5.0), "{known:?}");
    server.stop().await;
}

#[tokio::test]
async fn what_is_outside_is_left_out_until_it_is_inside_again() {
    let (server, mut client) = Server::with_hall().await;
    for (quality, cost) in [("high", 1.0), ("low", 5.0)] {
        let trial = wanted(&mut client, "a", quality).await;
        done(&mut client, &trial.name, cost).await;
    }
    let open = wanted(&mut client, "b", "high").await;
    assert_eq!(changed(&mut client, change(1, of_qualities(&["low"]))).await, (1, 1, 1));
    let late = client.report(report(&open.name, 1.0)).await;
    assert_refused(late, Code::FailedPrecondition, "outside the space");
    let only = best(&mut client).await;
    assert_eq!((only.cost, only.measurements), (5.0, 1));
    let study = "studies/hall".to_owned();
    let query = wire::QueryTrialsRequest { study, in_present_space: true, ..Default::default() };
    let inside = client.query_trials(query).await.expect("a page").into_inner().trials;
    assert_eq!(inside.len(), 1, "{inside:?}");
    for _ in 0..5 {
        assert_eq!(values(&frame(&mut client, "a", 0).await)["quality"], text("low"));
    }
    assert_eq!(changed(&mut client, change(2, space())).await, (7, 0, 0), "nothing is lost");
    server.stop().await;
}

#[tokio::test]
async fn an_open_trial_that_ran_with_another_value_than_it_has_by_now_is_given_back() {
    let (server, mut client) = Server::with_hall().await;
    let open = wanted(&mut client, "a", "high").await;
    let mut without = space();
    without.parameters.truncate(2);
    let mut removed = change(1, without);
    removed.fixed.insert("quality".to_owned(), text("high"));
    assert_eq!(changed(&mut client, removed).await, (0, 0, 0), "it ran with what all have");
    // `quality` comes again, and has been `low` meanwhile.
    assert_eq!(changed(&mut client, change(2, of_qualities(&["low"]))).await, (0, 0, 1));
    assert_eq!(get(&mut client, &open.name).await.state(), wire::TrialState::Abandoned);
    server.stop().await;
}

#[tokio::test]
async fn who_knows_an_earlier_space_gets_nothing_else_than_it_wants_and_its_own_default_in_shadow() {
    let (server, mut client) = Server::with_hall().await;
    let cheap = wanted(&mut client, "a", "high").await;
    done(&mut client, &cheap.name, 1.0).await;
    let mut far = space();
    far.parameters[1] = whole("max_leaf", 1, 64, 40);
    assert_eq!(changed(&mut client, change(1, far)).await, (1, 0, 0));

    let wanted = Some(configuration(50, "low"));
    let request = wire::SuggestRequest { wanted, space_revision: 1, ..ask("old", 10.0) };
    assert_refused(client.suggest(request).await, Code::InvalidArgument, "outside the space");

    let operation = wire::Operation::Shadow as i32;
    let policy = wire::Policy { operation, ..study().policy.expect("it has one") };
    let shadow = wire::Study { name: "studies/hall".to_owned(), policy: Some(policy), ..study() };
    let update = wire::UpdateStudyRequest { study: Some(shadow), update_mask: None };
    client.update_study(update).await.expect("in shadow");
    let values = self::values(&frame(&mut client, "old", 1).await);
    assert_eq!((number(&values, "max_leaf"), &values["quality"]), (Some(8), &text("low")));
    server.stop().await;
}

#[tokio::test]
async fn where_no_default_is_of_both_spaces_a_measured_configuration_answers() {
    let (server, mut client) = Server::with_hall().await;
    let mut apart = space();
    apart.parameters[1] = whole("max_leaf", 20, 64, 40);
    assert_eq!(changed(&mut client, change(1, apart)).await, (0, 0, 0));
    let of_both = |space_revision| {
        let wanted = Some(configuration(24, "low"));
        wire::SuggestRequest { wanted, space_revision, ..ask("a", 10.0) }
    };
    let old = |count| wire::SuggestRequest { space_revision: 1, ..ask("old", count) };
    let nothing_fits = client.suggest(old(10.0)).await;
    assert_refused(nothing_fits, Code::FailedPrecondition, "start the program with");
    // A start that is of both takes the place of the defaults.
    let start = Some(configuration(24, "low"));
    let begun = wire::SuggestRequest { start: start.clone(), ..old(50.0) };
    let trial = client.suggest(begun).await.expect("its start").into_inner();
    assert_eq!(trial.configuration, start);
    // What it wants itself is of both.
    for revision in [1, 2] {
        let trial = client.suggest(of_both(revision)).await.expect("a trial").into_inner();
        done(&mut client, &trial.name, 1.0).await;
    }
    let trial = client.suggest(old(10.0)).await.expect("a trial").into_inner();
    let found = number(&values(&trial), "max_leaf");
    assert!(found.is_some_and(|found| (20..=32).contains(&found)), "{trial:?}");
    let elsewhere = client.suggest(old(90.0)).await;
    assert_refused(elsewhere, Code::FailedPrecondition, "start the program with");
    server.stop().await;
}

#[tokio::test]
async fn what_a_study_remembers_of_its_spaces_is_limited() {
    let (server, mut client) = Server::with_hall().await;
    // About 700 kB each.
    let values: Vec<_> = (0..64).map(|value| text(&format!("{value:0256}"))).collect();
    let parameter = |number: usize| wire::Parameter {
        name: format!("p{number}"),
        domain: Some(parameter::Domain::Categorical(wire::CategoricalDomain { values: values.clone() })),
        default_value: Some(values[0].clone()),
        active_if: None,
        setup: false,
    };
    for revision in 1..=4 {
        let mut large = space();
        large.parameters.extend((0..40).map(parameter));
        large.parameters[1] = whole("max_leaf", 1, 32, 8 + i64::from(revision));
        assert_eq!(changed(&mut client, change(revision, large)).await, (0, 0, 0), "{revision}");
    }
    let last = client.change_space(change(5, space())).await;
    assert_refused(last, Code::InvalidArgument, "copy the study");
    server.stop().await;
}

#[tokio::test]
async fn what_cannot_be_served_is_refused_with_a_remedy() {
    let (server, mut client) = Server::with_hall().await;
    let mut apart = space();
    apart.parameters[1] = whole("max_leaf", 33, 64, 40);
    let mut odd = change(1, apart.clone());
    odd.fixed.insert("quality".to_owned(), text("low"));
    assert_refused(client.change_space(odd).await, Code::InvalidArgument, "neither adds nor removes");

    let pinned = wanted(&mut client, "a", "high").await.configuration;
    let policy = wire::Policy { pinned, ..study().policy.expect("it has one") };
    let pinned = wire::Study { name: "studies/hall".to_owned(), policy: Some(policy), ..study() };
    let update = wire::UpdateStudyRequest { study: Some(pinned), update_mask: None };
    client.update_study(update).await.expect("pinned");
    let refused = client.change_space(change(1, apart.clone())).await;
    assert_refused(refused, Code::InvalidArgument, "the pinned configuration");
    let free = wire::Study { name: "studies/hall".to_owned(), ..study() };
    let update = wire::UpdateStudyRequest { study: Some(free), update_mask: None };
    client.update_study(update).await.expect("not pinned");

    assert_eq!(changed(&mut client, change(1, apart)).await, (0, 0, 1));
    let old = wire::SuggestRequest { space_revision: 1, ..ask("old", 10.0) };
    assert_refused(client.suggest(old).await, Code::FailedPrecondition, "start the program with");
    let trial = frame(&mut client, "new", 2).await;
    assert!(number(&values(&trial), "max_leaf") >= Some(33));
    server.stop().await;
}
