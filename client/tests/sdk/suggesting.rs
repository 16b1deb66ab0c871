//! Suggestions: from the daemon in time, and without it.

use std::time::Duration;

use tonic::Code;
use treewright_client::{
    Client, ClientError, Configuration, Indicators, Mode, Outcome, Source, Space, Status, StudySpec,
};
use treewright_proto::convert::configuration_to_wire;
use treewright_proto::v1::TrialState;

use crate::support::{Fake, Hold, from_the_daemon, hasty, measured, patient, spec, state, until};

#[tokio::test]
async fn the_daemon_answers_and_gets_the_result() {
    let (fake, client, study) = Fake::with_study().await;
    assert_eq!(study.name(), "studies/scene");
    let suggestion = study.suggest(&state(3)).await;
    assert_eq!((suggestion.source(), suggestion.mode()), (Source::Daemon, Mode::Default.into()));
    assert_eq!(suggestion.trial(), Some("studies/scene/trials/1"));
    assert_eq!(suggestion.configuration().integer("max_depth").unwrap(), 32);
    assert!(suggestion.problem().is_none());
    suggestion.report(measured(12.5).with_standard_error("render_ms", 0.5), Outcome::Ok).unwrap();
    // The next question waits for the report, or it would be answered with that trial.
    let suggestion = study.suggest(&state(3)).await;
    assert_eq!(suggestion.trial(), Some("studies/scene/trials/2"));
    assert_eq!(suggestion.mode(), Mode::Explore);
    suggestion.report(measured(10.0), Outcome::infeasible("depth limit")).unwrap();
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert!(matches!(client.status(), Status::Connected));
    let stats = client.stats();
    assert_eq!((stats.suggestions, stats.fallbacks, stats.acknowledged, stats.queued), (2, 0, 2, 0));
    let book = fake.book();
    assert_eq!(book.trials[0].measurements["render_ms"].to_bits(), 12.5f64.to_bits());
    assert_eq!(book.trials[0].standard_errors["render_ms"], 0.5);
    assert_eq!(book.trials[0].fingerprint.as_ref().map(|f| f.threads > 0), Some(true));
}

#[tokio::test]
async fn a_program_measures_what_it_wants() {
    let (fake, client, study) = Fake::with_study().await;
    let some = Configuration::new().with("max_depth", 17);
    let wanted = Configuration::from(study.spec().space.complete(&some).unwrap());
    for render_ms in [12.5, 12.0] {
        let suggestion = study.trial_of(&state(3), &wanted).await.unwrap();
        assert_eq!((suggestion.mode(), suggestion.configuration()), (Mode::Pinned.into(), &wanted));
        suggestion.report(measured(render_ms), Outcome::Ok).unwrap();
    }
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!(fake.book().stored_reports.len(), 2);
    fake.book().refuse.insert("Suggest", Code::InvalidArgument);
    assert!(matches!(study.trial_of(&state(3), &wanted).await, Err(ClientError::Refused { .. })));
    assert_eq!(client.stats().fallbacks, 0, "there is nothing to fall back on");
}

#[tokio::test]
async fn a_program_begins_with_its_own_default_also_without_the_daemon() {
    let (fake, _client, study) = Fake::with_study().await;
    let some = Configuration::new().with("max_depth", 17);
    let own = Configuration::from(study.spec().space.complete(&some).unwrap());
    study.set_start(Some(&own)).unwrap();
    drop(study.suggest(&state(3)).await);
    let sent = fake.book().starts.clone();
    assert_eq!(sent, [Some(configuration_to_wire(own.as_raw()))]);
    fake.book().refuse.insert("Suggest", Code::InvalidArgument);
    let fallback = study.suggest(&state(5)).await;
    assert_eq!((fallback.source(), fallback.configuration()), (Source::Default, &own));
    let said = &fallback.reason().summary;
    assert!(said.starts_with("the program's own default, because of"), "{said}");
    study.set_start(None).unwrap();
    assert_eq!(study.suggest(&state(5)).await.configuration().integer("max_depth").unwrap(), 32);
    let outside = Configuration::new().with("max_depth", 1);
    assert!(matches!(study.set_start(Some(&outside)), Err(ClientError::Invalid { .. })));
}

#[tokio::test]
async fn what_is_set_up_serves_the_next_trial_that_wants_the_same() {
    let (_fake, client) = Fake::with_client();
    let space = Space::builder().integer("max_depth", 9..=1000).default(32).setup();
    let space = space.boolean("compact").default(false).build().unwrap();
    let study = client.study("scene", StudySpec { space, ..spec() }).await.unwrap();
    let runs = [
        (17i64, false, Outcome::Ok, false),
        (17, true, Outcome::Ok, true),
        (18, true, Outcome::infeasible("depth limit"), false),
        (18, true, Outcome::Ok, false),
        (18, false, Outcome::Ok, true),
    ];
    for (depth, compact, outcome, is_prepared) in runs {
        let wanted = Configuration::new().with("max_depth", depth).with("compact", compact);
        let suggestion = study.trial_of(&state(3), &wanted).await.unwrap();
        assert_eq!(suggestion.is_prepared(), is_prepared, "{wanted}");
        suggestion.report(measured(12.5), outcome).unwrap();
    }
    // Another handle of the study builds something else meanwhile.
    let other = client.study("scene", study.spec().clone()).await.unwrap();
    for (handle, depth, is_prepared) in [(&other, 18i64, true), (&other, 19, false), (&study, 18, false)] {
        let wanted = Configuration::new().with("max_depth", depth).with("compact", false);
        let suggestion = handle.trial_of(&state(3), &wanted).await.unwrap();
        assert_eq!(suggestion.is_prepared(), is_prepared, "{wanted}");
        suggestion.report(measured(12.5), Outcome::Ok).unwrap();
    }
}

#[tokio::test]
async fn a_daemon_that_is_still_loading_the_study_is_asked_again() {
    let (fake, client, study) = Fake::with_study().await;
    let wanted = Configuration::from(spec().space.default_configuration());
    fake.book().loading = 3;
    study.trial_of(&state(3), &wanted).await.unwrap().report(measured(12.5), Outcome::Ok).unwrap();
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!(fake.book().count("Suggest"), 4);
    assert_eq!(client.stats().fallbacks, 0);
    // Calls that only read wait as well.
    for call in ["Predict", "GetBest", "GetStudy"] {
        let before = fake.book().count(call);
        fake.book().loading = 2;
        let answered = match call {
            "Predict" => study.predict(&state(3)).await.map(drop),
            "GetBest" => study.best(&state(3)).await.map(drop),
            _ => study.record().await.map(drop),
        };
        assert!(answered.is_ok(), "{call}: {answered:?}");
        assert_eq!(fake.book().count(call) - before, 3, "{call}");
    }
    // Without an end to it the daemon's own words come back, not that it was late.
    fake.book().loading = usize::MAX;
    let client =
        Client::connect(&fake.url(), patient().client_id("other").deadline(Duration::from_secs(2))).unwrap();
    let study = client.study("scene", spec()).await.unwrap();
    let problem = study.trial_of(&state(3), &wanted).await.err().map(|problem| problem.to_string());
    assert!(problem.as_ref().is_some_and(|text| text.contains("is being loaded")), "{problem:?}");
    // A daemon that is not there at all is said at once.
    fake.book().refuse.insert("Suggest", Code::Unavailable);
    let calls = fake.book().count("Suggest");
    assert!(study.trial_of(&state(3), &wanted).await.is_err_and(|problem| problem.is_unreachable()));
    assert_eq!(fake.book().count("Suggest"), calls + 1);
}

#[tokio::test]
async fn a_hanging_daemon_costs_one_deadline_and_then_nothing() {
    let mut options = patient().deadline(Duration::from_secs(2));
    options.back_off_min = Duration::from_secs(3600);
    options.back_off_max = Duration::from_secs(3600);
    let (fake, client, study) = Fake::with_study_and(options).await;
    study.suggest(&state(1)).await.report(measured(9.0), Outcome::Ok).unwrap();
    client.flush(Duration::from_secs(20)).await.unwrap();
    fake.hold(Hold::Everything);
    let first = study.suggest(&state(2)).await;
    assert!(matches!(first.problem(), Some(ClientError::Late { .. })), "{:?}", first.problem());
    assert!(matches!(client.status(), Status::Away { failures: 1, .. }));
    // A thousand deadlines would be more than an hour; the test ends because nobody waits for them.
    for _ in 0..1000 {
        let next = study.suggest(&state(2)).await;
        assert_eq!(next.source(), Source::Default, "nothing ran in this state");
    }
    assert_eq!(study.suggest(&state(1)).await.source(), Source::LastGood);
    assert_eq!(client.stats().fallbacks, 1002);
}

#[tokio::test]
async fn without_a_daemon_the_default_is_used_and_the_study_created_later() {
    let mut fake = Fake::absent();
    let client = Client::connect(&fake.url(), patient()).unwrap();
    let study = client.study("scene", spec()).await.unwrap();
    let suggestion = study.suggest(&state(1)).await;
    assert_eq!((suggestion.source(), suggestion.mode()), (Source::Default, Mode::Default.into()));
    assert_eq!(*suggestion.configuration(), Configuration::from(spec().space.default_configuration()));
    let problem = suggestion.problem().expect("there is no daemon").to_string();
    assert!(problem.contains(&fake.url()) && problem.contains("treewrightd serve"), "{problem}");
    assert!(suggestion.trial().is_none());
    suggestion.report(measured(1.0), Outcome::Ok).unwrap();
    assert_eq!(client.stats().unreported, 1);
    fake.come_back();
    until("the study is created", || fake.book().studies.contains_key("studies/scene")).await;
    drop(from_the_daemon(async || study.suggest(&state(1)).await).await);
}

#[tokio::test]
async fn the_last_good_configuration_is_not_an_infeasible_one() {
    let (mut fake, client, study) = Fake::with_study().await;
    study.suggest(&state(1)).await.report(measured(9.0), Outcome::Ok).unwrap();
    let good = study.suggest(&state(1)).await;
    let good_configuration = good.configuration().clone();
    good.report(measured(8.0), Outcome::Ok).unwrap();
    // Nor one that the search tried last, here or in another state.
    study.suggest(&state(1)).await.report(measured(80.0), Outcome::Ok).unwrap();
    study.suggest(&state(4)).await.report(measured(0.5), Outcome::Ok).unwrap();
    let bad = study.suggest(&state(1)).await;
    assert_eq!(bad.configuration().integer("max_depth").unwrap(), 36);
    bad.report(treewright_client::Measurements::new(), Outcome::infeasible("depth limit reached")).unwrap();
    // Nor is it one that nobody ran.
    let unknown = study.suggest(&state(1)).await;
    assert_ne!(*unknown.configuration(), good_configuration);
    unknown.abandon();
    client.flush(Duration::from_secs(20)).await.unwrap();
    fake.go_away();
    let fallback = study.suggest(&state(1)).await;
    assert_eq!(fallback.source(), Source::LastGood);
    assert_eq!(*fallback.configuration(), good_configuration);
    fake.come_back();
    until("the connection is back", || !matches!(client.status(), Status::Away { .. })).await;
    assert_eq!(study.suggest(&state(1)).await.source(), Source::Daemon);
}

#[tokio::test]
async fn a_late_answer_is_used_for_the_next_frame_of_the_same_state() {
    let (fake, client, study) = Fake::with_study_and(hasty()).await;
    fake.hold(Hold::Suggestions);
    let missed = study.suggest(&state(3)).await;
    assert_eq!(missed.source(), Source::Default);
    fake.hold(Hold::Nothing);
    until("the trial is handed out", || fake.book().trials.len() == 1).await;
    let trial = from_the_daemon(async || study.suggest(&state(3)).await).await;
    assert_eq!(trial.trial(), Some("studies/scene/trials/1"));
    assert_eq!(fake.book().count("Suggest"), 1, "the late answer was used, not asked for again");
    trial.report(measured(1.0), Outcome::Ok).unwrap();
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!(fake.book().in_state(TrialState::Completed), 1);
}

#[tokio::test]
async fn a_late_answer_for_another_state_is_given_back() {
    let (fake, client, study) = Fake::with_study_and(hasty()).await;
    fake.hold(Hold::Suggestions);
    assert_eq!(study.suggest(&state(1)).await.source(), Source::Default);
    fake.hold(Hold::Nothing);
    until("the trial is handed out", || fake.book().trials.len() == 1).await;
    let other = from_the_daemon(async || study.suggest(&state(4)).await).await;
    let name = other.trial().unwrap().to_owned();
    assert_ne!(name, "studies/scene/trials/1", "the answer to the earlier question");
    until("the late trial is given back", || fake.book().trials[0].state() == TrialState::Abandoned).await;
    other.report(measured(1.0), Outcome::Ok).unwrap();
    client.flush(Duration::from_secs(20)).await.unwrap();
    let book = fake.book();
    let reported = book.trials.iter().find(|trial| trial.name == name).unwrap();
    assert_eq!(reported.indicators, std::collections::BTreeMap::from([("triangles".to_owned(), 1e4)]));
    assert_eq!(book.in_state(TrialState::Open), 0);
}

#[tokio::test]
async fn dropped_suggestions_give_their_trials_back() {
    let (fake, client, study) = Fake::with_study().await;
    let (one, two) = (study.suggest(&state(1)).await, study.suggest(&state(2)).await);
    drop(one);
    two.abandon();
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!(fake.book().in_state(TrialState::Abandoned), 2);
    assert_eq!(client.stats().abandoned, 2);
    // Nonsense is found at once, and the trial given back.
    let error = study.suggest(&state(3)).await.report(measured(f64::NAN), Outcome::Ok).unwrap_err();
    assert!(error.to_string().contains("render_ms"), "{error}");
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!(fake.book().in_state(TrialState::Abandoned), 3);
}

#[tokio::test]
async fn two_trials_of_one_state_do_not_spoil_each_other() {
    let (fake, client, study) = Fake::with_study().await;
    let (one, two) = (study.suggest(&state(1)).await, study.suggest(&state(1)).await);
    assert_ne!(one.trial(), two.trial());
    drop(one);
    two.report(measured(5.0), Outcome::Ok).unwrap();
    client.flush(Duration::from_secs(20)).await.unwrap();
    assert_eq!(fake.book().in_state(TrialState::Completed), 1);
    assert_eq!(fake.book().in_state(TrialState::Abandoned), 1);
}

#[tokio::test]
async fn wrong_indicators_are_named_and_never_sent() {
    let (fake, client, study) = Fake::with_study().await;
    for (wrong, named) in [
        (Indicators::new(), "missing"),
        (Indicators::from([("triangles", f64::NAN)]), "NaN"),
        (Indicators::from([("triangles", 1.0), ("lamps", 1.0)]), "lamps"),
    ] {
        let suggestion = study.suggest(&wrong).await;
        assert_eq!(suggestion.source(), Source::Default);
        let problem = suggestion.problem().expect("it is wrong").to_string();
        assert!(problem.contains(named), "{problem}");
    }
    assert_eq!(fake.book().count("Suggest"), 0);
    assert!(matches!(client.status(), Status::Connected));
}

#[tokio::test]
async fn a_refused_suggestion_is_a_fallback_that_says_why() {
    let (fake, client, study) = Fake::with_study().await;
    fake.book().refuse.insert("Suggest", Code::InvalidArgument);
    let suggestion = study.suggest(&state(1)).await;
    assert!(matches!(suggestion.problem(), Some(ClientError::Refused { code: Code::InvalidArgument, .. })));
    assert!(matches!(client.status(), Status::Connected), "a refusal is an answer");
}

#[tokio::test]
async fn a_daemon_that_forgot_the_study_is_told_again() {
    let (fake, client, study) = Fake::with_study().await;
    fake.book().studies.clear();
    assert_eq!(study.suggest(&state(1)).await.source(), Source::Default);
    until("the study is created again", || fake.book().count("CreateStudy") == 2).await;
    let found = client.existing_study("scene").await.unwrap();
    client.delete_study("scene").await.unwrap();
    let problem = found.suggest(&state(1)).await;
    assert!(problem.problem().is_some_and(ClientError::is_not_found));
    assert_eq!(fake.book().count("CreateStudy"), 2, "a study that was only opened is not created");
}

#[tokio::test]
async fn the_deadline_covers_connecting() {
    // The kernel accepts connections for a listener that nobody serves; they never hear a word.
    let mute = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", mute.local_addr().unwrap());
    let client = Client::connect(&url, hasty().call_deadline(Duration::from_millis(30))).unwrap();
    let study = client.study("scene", spec()).await.unwrap();
    let suggestion = study.suggest(&state(1)).await;
    assert_eq!(suggestion.source(), Source::Default);
    assert!(suggestion.problem().is_some_and(ClientError::is_unreachable));
    assert!(client.flush(Duration::from_millis(30)).await.is_ok(), "nothing was to be reported");
}
