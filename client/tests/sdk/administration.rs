//! The calls outside of frames.

use treewright_client::{
    Client, ClientError, Configuration, Front, FrontQuery, Indicators, Mode, Options, Outcome, Policy,
    PolicyChange, Question, Space, StudySpec, TextChange, TrialQuery,
};

use crate::support::{Fake, measured, patient, spec, state};

#[tokio::test]
async fn creating_an_equal_study_finds_it_and_a_different_one_is_refused() {
    let (_fake, client) = Fake::with_client();
    client.study("scene", spec()).await.unwrap();
    client.study("scene", spec()).await.unwrap();
    let space = Space::builder().boolean("compact").default(true).build().unwrap();
    let other = StudySpec::builder(space).minimise("render_ms", 1.0).build().unwrap();
    let error = client.study("scene", other).await.unwrap_err();
    assert!(matches!(error, ClientError::Refused { code: tonic::Code::AlreadyExists, .. }), "{error}");
    assert!(error.to_string().contains("differs in the space"));
}

#[tokio::test]
async fn studies_are_listed_changed_and_deleted() {
    let (_fake, client, study) = Fake::with_study().await;
    client.study("other", spec()).await.unwrap();
    let names: Vec<_> = client.list_studies().await.unwrap().into_iter().map(|study| study.name).collect();
    assert_eq!(names, ["studies/other", "studies/scene"]);
    let pinned = Configuration::new().with("max_depth", 9).with("compact", true);
    let change = PolicyChange::set(Policy::new().epsilon(0.5).pinned(pinned.clone()));
    let changed = client.update_policy("scene", &change).await.unwrap();
    assert_eq!((changed.policy.epsilon, changed.policy.pinned.as_ref()), (Some(0.5), Some(&pinned)));
    let changed = client.update_policy("scene", &PolicyChange::unpin()).await.unwrap();
    assert_eq!((changed.policy.epsilon, changed.policy.pinned.as_ref()), (Some(0.5), None));
    assert!(matches!(
        client.update_policy("scene", &PolicyChange::default()).await,
        Err(ClientError::Invalid { .. })
    ));
    let note = Some("at\nnight".to_owned());
    client.update_texts("scene", &TextChange { note, ..TextChange::default() }).await.unwrap();
    let tags = Some(["gpu".to_owned()].into());
    let changed = client.update_texts("scene", &TextChange { tags, ..TextChange::default() }).await.unwrap();
    assert_eq!((changed.note.as_str(), changed.tags.contains("gpu")), ("at\nnight", true));
    assert_eq!(changed.spec().unwrap().note, changed.note);
    // Each of two who add a tag knows nothing of the other's.
    for tag in ["b", "c"] {
        let added_tags = [tag.to_owned()].into();
        client.update_texts("scene", &TextChange { added_tags, ..TextChange::default() }).await.unwrap();
    }
    let removed_tags = ["b", "d"].map(str::to_owned).into();
    let change = TextChange { removed_tags, ..TextChange::default() };
    let changed = client.update_texts("scene", &change).await.unwrap();
    assert!(changed.tags.iter().eq(["c", "gpu"]), "{:?}", changed.tags);
    let nothing = client.update_texts("scene", &TextChange::default()).await;
    assert!(matches!(nothing, Err(ClientError::Invalid { .. })));
    assert_eq!(study.record().await.unwrap(), client.get_study("studies/scene").await.unwrap());
    client.delete_study("scene").await.unwrap();
    assert!(client.get_study("scene").await.unwrap_err().is_not_found());
    assert!(client.existing_study("scene").await.unwrap_err().is_not_found());
    client.ping().await.unwrap();
}

#[tokio::test]
async fn a_handle_names_its_study_after_the_name_went_to_another() {
    let (fake, client, _unidentified) = Fake::with_study().await;
    fake.book().studies.get_mut("studies/scene").unwrap().uid = "00000000000000aa".to_owned();
    let study = client.existing_study("scene").await.unwrap();
    assert_eq!(study.identified_name(), "studies/scene@00000000000000aa");
    client.rename_study("scene", "hall").await.unwrap();
    client.create_study("scene", &spec()).await.unwrap();
    let note = Some("of the hall".to_owned());
    let change = TextChange { note, ..TextChange::default() };
    client.update_texts(&study.identified_name(), &change).await.unwrap();
    let change = PolicyChange::set(Policy::new().epsilon(0.75));
    let changed = client.update_policy(&study.identified_name(), &change).await.unwrap();
    assert_eq!(changed, study.record().await.unwrap());
    assert_eq!((changed.name.as_str(), changed.note.as_str()), ("studies/hall", "of the hall"));
    let other = client.get_study(study.name()).await.unwrap();
    assert_eq!(other.note, "");
    assert_ne!(other.policy.epsilon, Some(0.75));
}

#[tokio::test]
async fn a_space_is_changed_and_programs_name_the_one_that_they_know() {
    let (fake, client) = Fake::with_client();
    let old = client.study("scene", spec()).await.unwrap();
    let space = Space::builder().integer("max_depth", 9..=2000).default(32).log().build().unwrap();
    let change = async |only_try| {
        let fixed = Configuration::new().with("compact", false);
        client.change_space("scene", 1, &space, &fixed, only_try).await
    };
    assert_eq!(change(true).await.unwrap().study.space_revision, 1);
    let changed = change(false).await.unwrap().study;
    assert_eq!((changed.space_revision, &changed.spec().unwrap().space), (2, &space));
    assert!(change(false).await.unwrap_err().to_string().contains("not revision 1"));
    let new = client.existing_study("scene").await.unwrap();
    for study in [&old, &new] {
        study.suggest(&state(1)).await.abandon();
        client.flush(std::time::Duration::from_secs(20)).await.unwrap();
    }
    let question = Question { indicators: state(1), space_revision: 1, ..Question::default() };
    client.ask("scene", &question).await.unwrap();
    let mut revisions = fake.book().revisions.clone();
    revisions.dedup();
    assert_eq!(revisions, [1, 2, 1]);
}

#[tokio::test]
async fn trials_are_read_across_pages() {
    let (_fake, client, study) = Fake::with_study().await;
    assert!(study.best(&Indicators::new()).await.unwrap_err().is_not_found());
    for render_ms in [9.0, 3.0, 5.0, 8.0, 7.0] {
        study.suggest(&state(1)).await.report(measured(render_ms), Outcome::Ok).unwrap();
    }
    client.flush(std::time::Duration::from_secs(20)).await.unwrap();
    let query = TrialQuery::all().filter("state = COMPLETED").order_by("number desc");
    let all = client.trials("scene", query).take(usize::MAX).await.unwrap();
    assert_eq!(all.iter().map(|trial| trial.number().unwrap()).collect::<Vec<_>>(), [5, 4, 3, 2, 1]);
    let first = client.trials("scene", TrialQuery::all()).take(3).await.unwrap();
    assert_eq!(first.iter().filter_map(|trial| trial.cost).collect::<Vec<_>>(), [9.0, 3.0, 5.0]);
    assert_eq!(first[0].outcome, Some(Outcome::Ok.into()));
    let error = client.trials("scene", TrialQuery::all().filter("rubbish")).next().await.unwrap_err();
    assert!(error.to_string().contains("column 1"), "{error}");
    let best = study.best(&Indicators::new()).await.unwrap();
    assert_eq!(
        (best.trial.as_str(), best.cost, best.default_cost),
        ("studies/scene/trials/2", 3.0, Some(9.0))
    );
    let prediction = study.predict(&state(1)).await.unwrap();
    assert_eq!((prediction.mode, prediction.predicted_cost), (Mode::Exploit.into(), Some(3.0)));
    assert_eq!(prediction.reason.neighbours.len(), 1);
}

#[tokio::test]
async fn a_front_is_read_from_the_trials_that_count() {
    let (fake, client, study) = Fake::with_study().await;
    for (render_ms, bytes) in [(9.0, 10.0), (3.0, 40.0), (5.0, 60.0), (2.0, 50.0), (1.0, 1.0)] {
        let measured = measured(render_ms).with("structure_bytes", bytes);
        study.suggest(&state(1)).await.report(measured, Outcome::Ok).unwrap();
    }
    client.flush(std::time::Duration::from_secs(20)).await.unwrap();
    client.exclude("studies/scene/trials/5", Some("its clock was wrong")).await.unwrap();
    fake.book().trials[1].fidelity = "16".to_owned();
    let front = Some(Front::new(&["render_ms", "structure_bytes"]).unwrap());
    let query = FrontQuery { front, ..FrontQuery::default() };
    let found = study.front(&query).await.unwrap();
    let times: Vec<f64> = found.points.iter().map(|point| point.metrics["render_ms"]).collect();
    assert_eq!((found.runs, times), (3, vec![2.0, 9.0]));
    assert_eq!(client.front("scene", &query).await.unwrap(), found);
    let asked = async |query: FrontQuery| study.front(&query).await.unwrap_err().to_string();
    let unnamed = asked(FrontQuery::default()).await;
    assert!(unnamed.contains("name two or three"), "{unnamed}");
    let beside = asked(FrontQuery { reference: Some(vec![1.0]), ..query.clone() }).await;
    assert!(beside.contains("one number above 0 for each metric"), "{beside}");
    fake.book().trials[0].fingerprint = None;
    let mixed = asked(query.clone()).await;
    assert!(mixed.contains("on 2 machine(s)"), "{mixed}");
    let of_state = study.front(&FrontQuery { state: Some(1), ..query.clone() }).await.unwrap();
    assert_eq!(of_state, found);
    let nowhere = asked(FrontQuery { state: Some(9), ..query }).await;
    assert!(nowhere.contains("no completed trial in state 9"), "{nowhere}");
}

#[tokio::test]
async fn a_wrong_question_is_told_from_a_refusal() {
    let (_fake, _client, study) = Fake::with_study().await;
    let wrong = state(1).with("no_such", 1.0);
    for error in [study.predict(&wrong).await.unwrap_err(), study.best(&wrong).await.unwrap_err()] {
        assert!(matches!(error, ClientError::Invalid { .. }), "{error:?}");
        assert!(error.to_string().contains("no_such"), "{error}");
    }
    let error = study.predict(&Indicators::new()).await.unwrap_err();
    assert!(matches!(error, ClientError::Invalid { .. }), "{error:?}");
}

#[tokio::test]
async fn a_lease_is_extended() {
    let (_fake, _client, study) = Fake::with_study().await;
    let mut suggestion = study.suggest(&state(1)).await;
    let before = suggestion.lease_expire_time().unwrap();
    suggestion.extend_lease().await.unwrap();
    assert!(suggestion.lease_expire_time().unwrap() > before);
}

#[tokio::test]
async fn a_wrong_address_is_an_error_and_an_absent_daemon_is_not() {
    let error = Client::connect("here", Options::default()).unwrap_err();
    assert!(matches!(error, ClientError::BadUrl { .. }) && error.to_string().contains("`here`"), "{error}");
    let fake = Fake::absent();
    let client = Client::connect(&fake.url(), patient()).unwrap();
    let error = client.list_studies().await.unwrap_err();
    assert!(matches!(error, ClientError::Away { .. }) && error.to_string().contains(&fake.url()), "{error}");
    assert!(client.ping().await.unwrap_err().is_unreachable());
}

#[test]
fn without_a_runtime_the_remedy_is_named() {
    let error = Client::connect("http://127.0.0.1:1", Options::default()).unwrap_err().to_string();
    assert!(error.contains("treewright_client::blocking"), "{error}");
}

#[tokio::test]
async fn a_daemon_that_drops_a_part_of_the_objective_is_refused() {
    let (fake, client) = Fake::with_client();
    let space = Space::builder().boolean("compact").default(false).build().unwrap();
    let spec = StudySpec::builder(space).maximise("rate", 1.0).build().unwrap();
    client.study("rates", spec.clone()).await.unwrap();
    fake.book().older = true;
    let refused = client.study("more_rates", spec).await.unwrap_err().to_string();
    assert!(refused.contains("minimises them") && refused.contains("upgrade the daemon"), "{refused}");
    let space = Space::builder().boolean("compact").default(false).build().unwrap();
    let spec = StudySpec::builder(space).minimise("ms", 1.0).limit("memory_mb", None, Some(2000.0));
    let spec = spec.build().unwrap();
    let refused = client.study("limited", spec.clone()).await.unwrap_err().to_string();
    assert!(refused.contains("knows no limits") && refused.contains("upgrade the daemon"), "{refused}");
    let space = Space::builder().boolean("compact").default(false).build().unwrap();
    let long = StudySpec::builder(space).minimise("ms", 1.0).episode_frames(24).build().unwrap();
    let refused = client.study("long", long.clone()).await.unwrap_err().to_string();
    assert!(refused.contains("no trials of several frames"), "{refused}");
    fake.book().older = false;
    client.study("longer", long).await.unwrap();
    client.study("limits", spec).await.unwrap();
}
