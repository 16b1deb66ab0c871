//! Studies over the wire: each request that works, and each error that the contract names.

mod common;

use common::{Server, ask, assert_refused, create, creation, done, integer, study, suggest, text};
use prost_types::FieldMask;
use tonic::codec::CompressionEncoding;
use tonic::{Code, Request};
use treewright_proto::v1::{self as wire, parameter};

#[tokio::test]
async fn a_study_comes_back_as_it_was_created() {
    let (_server, mut client) = Server::with_client().await;
    let mut given = study();
    let parameters = &mut given.space.as_mut().unwrap().parameters;
    parameters.push(wire::Parameter {
        name: "bias".to_owned(),
        domain: Some(parameter::Domain::Float(wire::FloatDomain {
            min: 0.5,
            max: 8.0,
            scale: wire::Scale::Log.into(),
        })),
        default_value: Some(wire::Value { kind: Some(wire::value::Kind::Float(1.0)) }),
        active_if: Some(wire::Condition { parameter: "quality".to_owned(), any_of: vec![text("high")] }),
        setup: true,
    });
    parameters.push(wire::Parameter {
        name: "compact".to_owned(),
        domain: Some(parameter::Domain::Boolean(wire::BooleanDomain {})),
        default_value: Some(wire::Value { kind: Some(wire::value::Kind::Boolean(true)) }),
        active_if: None,
        setup: false,
    });
    let request = creation("hall", given.clone());
    let created = client.create_study(request).await.unwrap().into_inner();

    assert_eq!(created.name, "studies/hall");
    assert_eq!(created.create_time.unwrap().seconds, common::START_MS / 1000);
    assert_eq!(created.statistics, Some(wire::StudyStatistics::default()));
    assert_eq!(created.state_tolerance, Some(0.01));
    let policy = created.policy.clone().unwrap();
    assert_eq!((policy.trials_per_state, policy.lease_s), (80, 60));
    assert_eq!(policy.epsilon, Some(1.0));
    let mut space = created.space.clone().unwrap();
    for parameter in &mut space.parameters {
        // LINEAR is what an unspecified scale means.
        if let Some(parameter::Domain::Integer(domain)) = &mut parameter.domain {
            domain.scale = 0;
        }
    }
    assert_eq!(Some(space), given.space);
    assert_eq!(created.objective, given.objective);

    let name = "studies/hall".to_owned();
    let read = client.get_study(wire::GetStudyRequest { name }).await;
    assert_eq!(read.unwrap().into_inner(), created);

    // Sent again as it was read, it is that study.
    let again = client.create_study(creation("hall", created.clone())).await;
    assert_eq!(again.unwrap().into_inner(), created);
}

#[tokio::test]
async fn another_specification_under_the_same_id_is_refused() {
    let (_server, mut client) = Server::with_hall().await;
    let mut other = study();
    other.space.as_mut().unwrap().parameters[1].default_value = Some(integer(9));
    let answer = client.create_study(creation("hall", other)).await;
    assert_refused(answer, Code::AlreadyExists, "parameter \"max_leaf\"");
}

#[tokio::test]
async fn malformed_specifications_name_the_field() {
    let (_server, mut client) = Server::with_client().await;
    type Change = fn(&mut wire::Study);
    let cases: [(Change, &str); 15] = [
        (|s| s.space = None, "study.space: is required"),
        (|s| s.objective = None, "study.objective: is required"),
        (|s| space(s)[0].domain = None, "study.space.parameters[0].domain: is required"),
        (|s| space(s)[1].default_value = None, "study.space.parameters[1].default_value: is required"),
        (
            |s| space(s)[1].default_value = Some(wire::Value { kind: None }),
            "parameters[1].default_value: is required; known here are integer",
        ),
        (|s| space(s)[1].default_value = Some(integer(99)), "\"max_leaf\": the default 99"),
        (|s| space(s)[0].name = "leaf size".to_owned(), "\"leaf size\" is not a name"),
        (
            |s| match &mut space(s)[2].domain {
                Some(parameter::Domain::Categorical(domain)) => domain.values.push(text("no\0text")),
                other => panic!("{other:?}"),
            },
            "study.space: parameter \"quality\": the value \"no\\0text\" has a control character",
        ),
        (|s| s.indicators[0].scale = 77, "study.indicators.scale: 77 is not a known value"),
        (|s| s.indicators[0].max = f64::NAN, "study.indicators: "),
        (|s| s.objective.as_mut().unwrap().terms.clear(), "study.objective: "),
        (|s| s.state_tolerance = Some(2.0), "state_tolerance is 2"),
        (|s| s.display_name = "x".repeat(201), "display_name must be at most 200"),
        (|s| s.policy.as_mut().unwrap().epsilon = Some(1.5), "policy.epsilon is 1.5"),
        (|s| s.policy.as_mut().unwrap().lease_s = 100_000, "policy.lease_s is 100000"),
    ];
    fn space(study: &mut wire::Study) -> &mut Vec<wire::Parameter> {
        &mut study.space.as_mut().unwrap().parameters
    }
    for (change, fragment) in cases {
        let mut changed = study();
        change(&mut changed);
        let answer = client.create_study(creation("hall", changed)).await;
        assert_refused(answer, Code::InvalidArgument, fragment);
    }
    let answer = client.create_study(creation("Hall", study())).await;
    assert_refused(answer, Code::InvalidArgument, "study_id: \"Hall\" must be 1 to 64");
    let nothing = wire::CreateStudyRequest { study_id: "hall".to_owned(), study: None };
    let answer = client.create_study(nothing).await;
    assert_refused(answer, Code::InvalidArgument, "study: is required");
    // A request beyond the limit of a message is refused before it is read.
    let mut huge = study();
    huge.display_name = "x".repeat(treewright_server::limits::REQUEST_BYTES);
    let answer = client.create_study(creation("hall", huge)).await;
    assert_refused(answer, Code::OutOfRange, "limit");
}

#[tokio::test]
async fn studies_are_listed_page_by_page() {
    let (_server, mut client) = Server::with_client().await;
    for id in ["sponza", "bmw", "hall"] {
        create(&mut client, id).await;
    }
    let mut names = Vec::new();
    let mut request = wire::ListStudiesRequest { page_size: 2, ..wire::ListStudiesRequest::default() };
    loop {
        let page = client.list_studies(request.clone()).await.unwrap().into_inner();
        names.push(page.studies.into_iter().map(|s| s.name).collect::<Vec<_>>());
        if page.next_page_token.is_empty() {
            break;
        }
        request.page_token = page.next_page_token;
    }
    assert_eq!(names, [vec!["studies/bmw", "studies/hall"], vec!["studies/sponza"]]);

    request.page_token = "forged".to_owned();
    let answer = client.list_studies(request.clone()).await;
    assert_refused(answer, Code::InvalidArgument, "page_token");
    request.page_size = 1001;
    let answer = client.list_studies(request).await;
    assert_refused(answer, Code::InvalidArgument, "page_size: 1001 must be 0 to 1000");
}

#[tokio::test]
async fn the_study_of_a_front_keeps_its_display_name() {
    let (_server, mut client) = Server::with_client().await;
    let mut made = study();
    made.display_name = "front of time_ms, 1/rate".to_owned();
    made.indicators = vec![wire::Indicator { name: "direction".to_owned(), min: 0.0, max: 8.0, scale: 0 }];
    made.objective = Some(wire::Objective {
        terms: vec![wire::ObjectiveTerm { metric: "front_cost".to_owned(), weight: 1.0 }],
        ..wire::Objective::default()
    });
    client.create_study(creation("lists", made.clone())).await.unwrap();
    let texts = |display_name: &str| wire::UpdateStudyRequest {
        study: Some(wire::Study {
            name: "studies/lists".to_owned(),
            display_name: display_name.to_owned(),
            note: "of linked lists".to_owned(),
            ..wire::Study::default()
        }),
        update_mask: Some(FieldMask { paths: ["display_name", "note"].map(str::to_owned).to_vec() }),
    };
    for other in ["linked lists", "front of time_ms, memory_mb"] {
        let answer = client.update_study(texts(other)).await;
        assert_refused(answer, Code::InvalidArgument, "says which metrics the front has");
    }
    let updated = client.update_study(texts(&made.display_name)).await.unwrap().into_inner();
    assert_eq!((updated.display_name, updated.note.as_str()), (made.display_name, "of linked lists"));
}

#[tokio::test]
async fn texts_for_people_change_and_are_not_compared() {
    let (_server, mut client) = Server::with_hall().await;
    let policy = wire::Policy { epsilon: Some(0.9), ..wire::Policy::default() };
    let mut request = wire::UpdateStudyRequest {
        study: Some(wire::Study {
            name: "studies/hall".to_owned(),
            display_name: "An attic".to_owned(),
            note: "measured\n\tat night".to_owned(),
            tags: ["gpu", "b", "gpu"].map(str::to_owned).to_vec(),
            policy: Some(policy),
            ..wire::Study::default()
        }),
        update_mask: Some(FieldMask { paths: ["note", "tags"].map(str::to_owned).to_vec() }),
    };
    let updated = client.update_study(request.clone()).await.unwrap().into_inner();
    assert_eq!((updated.note.as_str(), updated.tags.join(" ").as_str()), ("measured\n\tat night", "b gpu"));
    assert_eq!((updated.display_name, updated.policy.unwrap().epsilon), (study().display_name, Some(1.0)));
    // A client with other texts gets that study, with the stored texts.
    let found = create(&mut client, "hall").await;
    assert_eq!((found.note.as_str(), found.tags.len()), ("measured\n\tat night", 2));
    request.update_mask = Some(FieldMask { paths: vec!["display_name".to_owned()] });
    let updated = client.update_study(request.clone()).await.unwrap().into_inner();
    assert_eq!((updated.display_name.as_str(), updated.tags.len()), ("An attic", 2));

    request.update_mask = Some(FieldMask { paths: ["note", "tags"].map(str::to_owned).to_vec() });
    type Break = fn(&mut wire::Study);
    let wrong: [(Break, &str); 4] = [
        (|s| s.note = "x".repeat(4097), "note must be at most 4096 bytes"),
        (|s| s.note = "a\r\nb".to_owned(), r"control characters but tabs and \n (not \r\n)"),
        (|s| s.tags = vec!["two words".to_owned()], "tags: \"two words\" must be 1 to 32 letters"),
        (|s| s.tags = (0..17).map(|n| n.to_string()).collect(), "tags has 17; give at most 16"),
    ];
    for (break_it, problem) in wrong {
        let mut request = request.clone();
        break_it(request.study.as_mut().unwrap());
        let answer = client.update_study(request.clone()).await;
        assert_refused(answer, Code::InvalidArgument, problem);
        let given = request.study.unwrap();
        let given = wire::Study { note: given.note, tags: given.tags, ..study() };
        let answer = client.create_study(creation("other", given)).await;
        assert_refused(answer, Code::InvalidArgument, problem);
    }
    let stored = client.get_study(wire::GetStudyRequest { name: "studies/hall".to_owned() }).await;
    assert_eq!(stored.unwrap().into_inner().tags.len(), 2);
}

#[tokio::test]
async fn who_sets_one_tag_undoes_nobody_elses_change() {
    let (_server, mut client) = Server::with_hall().await;
    let request = |given: &[String], set: &[String]| wire::UpdateStudyRequest {
        study: Some(wire::Study {
            name: "studies/hall".to_owned(),
            tags: given.to_vec(),
            ..wire::Study::default()
        }),
        update_mask: Some(FieldMask { paths: set.iter().map(|tag| format!("tags.{tag}")).collect() }),
    };
    let words = |text: &str| text.split(',').map(str::to_owned).collect::<Vec<_>>();
    for (given, set, there) in [
        ("gpu", "gpu", "gpu"),
        ("b", "b", "b gpu"),
        ("層.1,x", "層.1,c", "b gpu 層.1"),
        ("c", "c,b", "c gpu 層.1"),
    ] {
        let updated = client.update_study(request(&words(given), &words(set))).await.unwrap().into_inner();
        assert_eq!(updated.tags.join(" "), there);
        assert_eq!(updated.policy.unwrap().epsilon, study().policy.unwrap().epsilon);
    }
    let many: Vec<String> = (0..14).map(|number| number.to_string()).collect();
    let answer = client.update_study(request(&many, &many)).await;
    assert_refused(answer, Code::InvalidArgument, "tags has 17; give at most 16");
    let wrong = ["two words".to_owned()];
    let answer = client.update_study(request(&wrong, &wrong)).await;
    assert_refused(answer, Code::InvalidArgument, "tags: \"two words\" must be 1 to 32 letters");
}

#[tokio::test]
async fn a_policy_changes_field_by_field_and_takes_effect() {
    let (_server, mut client) = Server::with_hall().await;
    let first = suggest(&mut client, "a", 10.0).await;
    done(&mut client, &first.name, 5.0).await;

    let pinned = wire::Configuration {
        values: [("min_leaf", integer(2)), ("max_leaf", integer(4)), ("quality", text("high"))]
            .map(|(name, value)| (name.to_owned(), value))
            .into(),
    };
    let policy = wire::Policy { pinned: Some(pinned.clone()), lease_s: 5, ..wire::Policy::default() };
    let name = "studies/hall".to_owned();
    let mut request = wire::UpdateStudyRequest {
        study: Some(wire::Study { name, policy: Some(policy), ..wire::Study::default() }),
        update_mask: Some(FieldMask { paths: vec!["policy.pinned".to_owned()] }),
    };
    let updated = client.update_study(request.clone()).await.unwrap().into_inner();
    let policy = updated.policy.unwrap();
    assert_eq!((policy.pinned.as_ref(), policy.lease_s), (Some(&pinned), 60));
    let trial = suggest(&mut client, "a", 10.0).await;
    assert_eq!(trial.mode(), wire::Mode::Pinned);
    assert_eq!(trial.configuration, Some(pinned));

    // An unset mask replaces the whole policy, and so unpins.
    request.update_mask = None;
    request.study.as_mut().unwrap().policy.as_mut().unwrap().pinned = None;
    let updated = client.update_study(request.clone()).await.unwrap().into_inner();
    let policy = updated.policy.unwrap();
    assert_eq!((policy.pinned, policy.lease_s, policy.epsilon), (None, 5, Some(0.2)));
    assert_ne!(suggest(&mut client, "a", 10.0).await.mode(), wire::Mode::Pinned);

    request.update_mask = Some(FieldMask { paths: vec!["seed".to_owned()] });
    let answer = client.update_study(request.clone()).await;
    assert_refused(answer, Code::InvalidArgument, "update_mask: \"seed\" cannot be changed");
    request.update_mask = None;
    request.study.as_mut().unwrap().policy.as_mut().unwrap().pinned =
        Some(wire::Configuration { values: [("min_leaf".to_owned(), integer(2))].into() });
    let answer = client.update_study(request.clone()).await;
    assert_refused(answer, Code::InvalidArgument, "policy.pinned");
    request.study.as_mut().unwrap().name = "studies/none".to_owned();
    request.study.as_mut().unwrap().policy = None;
    let answer = client.update_study(request).await;
    assert_refused(answer, Code::NotFound, "study \"none\" does not exist");
}

#[tokio::test]
async fn a_deleted_study_is_gone_and_its_id_is_free() {
    let (_server, mut client) = Server::with_hall().await;
    let trial = suggest(&mut client, "a", 10.0).await;
    let delete = || wire::DeleteStudyRequest { name: "studies/hall".to_owned() };
    client.delete_study(delete()).await.expect("deleted");
    assert_refused(client.delete_study(delete()).await, Code::NotFound, "hall");
    let answer = client.report(common::report(&trial.name, 1.0)).await;
    assert_refused(answer, Code::NotFound, "study \"hall\" does not exist");
    let answer = client.suggest(common::ask("a", 10.0)).await;
    assert_refused(answer, Code::NotFound, "study \"hall\" does not exist");

    create(&mut client, "hall").await;
    let answer = client.report(common::report(&trial.name, 1.0)).await;
    assert_refused(answer, Code::NotFound, "trial 1");
    assert_eq!(suggest(&mut client, "a", 10.0).await.name, "studies/hall/trials/2");
    let answer = client.report(common::report(&trial.name, 1.0)).await;
    assert_refused(answer, Code::NotFound, "trial 1 was handed out before study \"hall\" was created");
}

/// `studies/{study}@{uid}`.
fn identified(study: &wire::Study) -> String {
    assert_eq!(study.uid.len(), 16);
    format!("{}@{}", study.name, study.uid)
}

#[tokio::test]
async fn a_study_that_is_created_again_is_told_from_the_one_before_by_its_identity() {
    let (_server, mut client) = Server::with_client().await;
    let before = create(&mut client, "hall").await;
    let ask = |name: &str| wire::SuggestRequest { study: name.to_owned(), ..common::ask("a", 10.0) };
    let stale = client.suggest(ask(&identified(&before))).await.expect("a trial").into_inner();
    assert_eq!(stale.name, format!("{}/trials/1", identified(&before)), "named as it was asked for");
    client.delete_study(wire::DeleteStudyRequest { name: before.name.clone() }).await.expect("deleted");
    let answer = client.report(common::report(&stale.name, 0.001)).await;
    assert_refused(answer, Code::NotFound, "study \"hall\" does not exist");
    let after = create(&mut client, "hall").await;
    assert_ne!(before.uid, after.uid);

    let message = "was deleted and created again";
    let trial = || stale.name.clone();
    assert_refused(client.report(common::report(&stale.name, 0.001)).await, Code::NotFound, message);
    let abandon = wire::AbandonTrialRequest { trial: trial() };
    assert_refused(client.abandon_trial(abandon).await, Code::NotFound, message);
    let extend = wire::ExtendLeaseRequest { trial: trial() };
    assert_refused(client.extend_lease(extend).await, Code::NotFound, message);
    assert_refused(client.get_trial(wire::GetTrialRequest { name: trial() }).await, Code::NotFound, message);
    let study = || identified(&before);
    assert_refused(client.suggest(ask(&study())).await, Code::NotFound, message);
    assert_refused(client.get_study(wire::GetStudyRequest { name: study() }).await, Code::NotFound, message);
    let best = wire::GetBestRequest { study: study(), ..Default::default() };
    assert_refused(client.get_best(best).await, Code::NotFound, message);
    let query = wire::QueryTrialsRequest { study: study(), ..Default::default() };
    assert_refused(client.query_trials(query).await, Code::NotFound, message);
    let predict = wire::PredictRequest { study: study(), ..common::predict() };
    assert_refused(client.predict(predict).await, Code::NotFound, message);
    let delete = wire::DeleteStudyRequest { name: study() };
    assert_refused(client.delete_study(delete).await, Code::NotFound, message);

    // The new one's own frames go on, with and without its identity.
    let own = client.suggest(ask(&identified(&after))).await.expect("a trial").into_inner();
    let done = client.report(common::report(&own.name, 50.0)).await.expect("taken").into_inner();
    assert!(!done.duplicate);
    assert_eq!(done.trial.expect("the trial").name, own.name);
    let best = wire::GetBestRequest { study: "studies/hall".to_owned(), ..Default::default() };
    assert_eq!(client.get_best(best).await.expect("measured").into_inner().cost, 50.0);
}

#[tokio::test]
async fn who_names_a_study_by_its_identity_does_not_notice_that_it_is_renamed() {
    let (_server, mut client) = Server::with_client().await;
    let study = create(&mut client, "hall").await;
    let ask = || wire::SuggestRequest { study: identified(&study), ..common::ask("a", 10.0) };
    let open = client.suggest(ask()).await.expect("a trial").into_inner();
    let plain = suggest(&mut client, "b", 10.0).await;
    let rename =
        |name: &str, to: &str| wire::RenameStudyRequest { name: name.to_owned(), study_id: to.to_owned() };
    create(&mut client, "attic").await;
    assert_refused(client.rename_study(rename("studies/hall", "attic")).await, Code::AlreadyExists, "attic");
    assert_refused(client.rename_study(rename("studies/none", "loft")).await, Code::NotFound, "none");
    let answer = client.rename_study(rename("studies/hall", "Loft")).await;
    assert_refused(answer, Code::InvalidArgument, "study_id");
    let renamed = client.rename_study(rename("studies/hall", "loft")).await.expect("renamed").into_inner();
    assert_eq!((renamed.name.as_str(), &renamed.uid), ("studies/loft", &study.uid));
    assert_eq!(renamed.statistics.expect("counts").trials, 2);

    let done = client.report(common::report(&open.name, 7.0)).await.expect("taken").into_inner();
    let name = format!("studies/loft@{}/trials", study.uid);
    assert_eq!(done.trial.expect("the trial").name, format!("{name}/1"));
    assert_eq!(client.suggest(ask()).await.expect("a trial").into_inner().name, format!("{name}/3"));
    // A client that goes by the name has to learn the new one; its trial may be of a later study.
    let answer = client.report(common::report(&plain.name, 7.0)).await;
    assert_refused(answer, Code::NotFound, "study \"hall\" does not exist");
    create(&mut client, "hall").await;
    let answer = client.report(common::report(&plain.name, 7.0)).await;
    assert_refused(answer, Code::NotFound, "trial 2 was handed out before study \"hall\"");
    let under_new_name = plain.name.replace("hall", "loft");
    assert_refused(client.report(common::report(&under_new_name, 7.0)).await, Code::NotFound, "trial 2");
    let known = format!("{name}/2");
    client.report(common::report(&known, 7.0)).await.expect("its identity proves it");
}

/// A GetStudyRequest whose name need not be text.
#[derive(Clone, PartialEq, prost::Message)]
struct NameOfBytes {
    #[prost(bytes = "vec", tag = "1")]
    name: Vec<u8>,
}

#[tokio::test]
async fn messages_that_cannot_be_read_are_the_clients_mistake() {
    let server = Server::in_memory().await;
    let mut client = tonic::client::Grpc::new(server.channel().await);
    client.ready().await.expect("ready");
    let path = http::uri::PathAndQuery::from_static("/treewright.v1.TuningService/GetStudy");
    let codec = tonic_prost::ProstCodec::<NameOfBytes, wire::Study>::default();
    let sent = client.unary(Request::new(NameOfBytes { name: vec![0xff] }), path, codec).await;
    assert_refused(sent, Code::InvalidArgument, "cannot be read");
    server.stop().await;
}

#[tokio::test]
async fn compressed_requests_are_taken() {
    let server = Server::in_memory().await;
    let mut client = server.client().await.send_compressed(CompressionEncoding::Gzip);
    create(&mut client, "hall").await;
    let answer = client.suggest(ask("one", 5.0)).await;
    answer.expect("a trial");
    server.stop().await;
}
