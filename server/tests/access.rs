//! Tokens over a real socket: admission, visible studies, and expiry.

mod common;

use std::sync::Arc;
use std::time::Duration;

use common::{Caller, Server, ask, assert_refused, creation, report, study};
use tonic::metadata::MetadataValue;
use tonic::{Code, Request, Status};
use tonic_types::StatusExt as _;
use treewright_proto::v1::{self as wire};
use treewright_server::access::Access;
use treewright_server::access::token::Token;
use treewright_server::clock::ManualClock;
use treewright_server::serve::Options;
use treewright_store::tokens::{Quota, Scope, TokenRecord};
use treewright_store::{Faults, MemoryStore, MemoryTokens, Store, TokenStore};

struct Guarded {
    server: Server,
    tokens: Arc<MemoryTokens>,
    access: Arc<Access>,
}

impl Guarded {
    async fn start() -> Self {
        Self::on(Arc::new(MemoryStore::new())).await
    }

    async fn on(store: Arc<dyn Store>) -> Self {
        let tokens = Arc::new(MemoryTokens::new());
        let clock = Arc::new(ManualClock::at(common::START_MS));
        let access = Access::open(Arc::clone(&tokens) as _, Arc::clone(&clock) as _).await.expect("opened");
        let access = Arc::new(access);
        let drain = Duration::from_secs(5);
        let options = Options { drain, access: Some(Arc::clone(&access)), ..Options::default() };
        let server = Server::with_options(store, clock, options).await;
        Self { server, tokens, access }
    }

    async fn token(&self, scope: Scope, studies: &[&str], quota: Quota) -> Token {
        let studies = studies.iter().map(|study| (*study).to_owned()).collect();
        let (token, record) = common::token(scope, studies, quota);
        let record = TokenRecord { expire_ms: Some(common::START_MS + 3_600_000), ..record };
        self.tokens.create(&record).await.expect("stored");
        self.access.refresh().await.expect("read");
        token
    }

    async fn with(&self, token: &Token) -> Caller {
        self.server.caller(Some(format!("Bearer {}", token.text()))).await
    }
}

fn named(id: &str) -> wire::CreateStudyRequest {
    creation(id, study())
}

fn get(id: &str) -> wire::GetStudyRequest {
    wire::GetStudyRequest { name: format!("studies/{id}") }
}

fn delete(id: &str) -> wire::DeleteStudyRequest {
    wire::DeleteStudyRequest { name: format!("studies/{id}") }
}

#[tokio::test]
async fn without_a_good_token_nobody_gets_in() {
    let guarded = Guarded::start().await;
    let good = guarded.token(Scope::Admin, &[], Quota::default()).await;
    let other = Token::make().expect("randomness");
    // The right id with another secret.
    let (id, secret) = (good.id(), other.text().split_off(17));
    for (header, reason) in [
        (None, "no token"),
        (Some("Bearer".to_owned()), "not `Bearer TOKEN`"),
        (Some(format!("Basic {}", good.text())), "not `Bearer TOKEN`"),
        (Some(good.text()), "not `Bearer TOKEN`"),
        (Some("Bearer x".to_owned()), "not known"),
        (Some(format!("Bearer {}", other.text())), "not known"),
        (Some(format!("Bearer tw1_{id}_{secret}")), "not known"),
    ] {
        let mut caller = guarded.server.caller(header).await;
        let answer = caller.list_studies(wire::ListStudiesRequest::default()).await;
        assert_refused(answer, Code::Unauthenticated, reason);
    }
    let mut caller = guarded.server.caller(Some(format!("bearer {}", good.text()))).await;
    caller.list_studies(wire::ListStudiesRequest::default()).await.expect("let in");
    // A load balancer asks without a token.
    let mut health = tonic_health::pb::health_client::HealthClient::new(guarded.server.channel().await);
    health.check(tonic_health::pb::HealthCheckRequest::default()).await.expect("answered");
    guarded.server.stop().await;
}

#[tokio::test]
async fn a_token_ends_at_its_time_and_at_its_revocation() {
    let guarded = Guarded::start().await;
    let (one, two) = (
        guarded.token(Scope::Read, &[], Quota::default()).await,
        guarded.token(Scope::Read, &[], Quota::default()).await,
    );
    let (mut first, mut second) = (guarded.with(&one).await, guarded.with(&two).await);
    let list = wire::ListStudiesRequest::default;
    first.list_studies(list()).await.expect("let in");
    guarded.tokens.revoke(one.id(), common::START_MS).await.unwrap();
    // The daemon follows by itself.
    for _ in 0..100 {
        if first.list_studies(list()).await.is_err() {
            break;
        }
        tokio::time::sleep(Duration::from_millis(20)).await;
    }
    assert_refused(first.list_studies(list()).await, Code::Unauthenticated, "revoked");

    second.list_studies(list()).await.expect("let in");
    guarded.server.clock.advance_ms(3_600_000);
    assert_refused(second.list_studies(list()).await, Code::Unauthenticated, "expired");
    guarded.tokens.forget(two.id()).await.unwrap();
    guarded.access.refresh().await.unwrap();
    assert_refused(second.list_studies(list()).await, Code::Unauthenticated, "not known");
    guarded.server.stop().await;
}

#[tokio::test]
async fn scopes_include_each_other_upwards() {
    let guarded = Guarded::start().await;
    let mut caller = Vec::new();
    for scope in [Scope::Read, Scope::Tune, Scope::Admin] {
        let token = guarded.token(scope, &[], Quota::default()).await;
        caller.push(guarded.with(&token).await);
    }
    assert_refused(caller[0].create_study(named("hall")).await, Code::PermissionDenied, "scope");
    caller[1].create_study(named("hall")).await.expect("created");
    caller[0].get_study(get("hall")).await.expect("read");
    assert_refused(caller[0].suggest(ask("one", 5.0)).await, Code::PermissionDenied, "scope");
    assert_refused(caller[1].delete_study(delete("hall")).await, Code::PermissionDenied, "scope");
    let (_sender, frames) = tokio::sync::mpsc::channel::<wire::TuneRequest>(1);
    let stream = caller[0].tune(tokio_stream::wrappers::ReceiverStream::new(frames)).await;
    assert_eq!(stream.err().map(|status| status.code()), Some(Code::PermissionDenied));
    caller[2].suggest(ask("one", 5.0)).await.expect("a trial");
    // The policy is the operator's.
    let study = wire::Study { name: "studies/hall".to_owned(), ..study() };
    let update = wire::UpdateStudyRequest { study: Some(study), update_mask: None };
    assert_refused(caller[1].update_study(update.clone()).await, Code::PermissionDenied, "scope");
    caller[2].update_study(update).await.expect("changed");
    caller[2].delete_study(delete("hall")).await.expect("deleted");
    guarded.server.stop().await;
}

#[tokio::test]
async fn other_studies_are_out_of_reach_and_out_of_sight() {
    let guarded = Guarded::start().await;
    let all = guarded.token(Scope::Admin, &[], Quota::default()).await;
    let some = guarded.token(Scope::Admin, &["hall", "farm-*"], Quota::default()).await;
    let (mut all, mut some) = (guarded.with(&all).await, guarded.with(&some).await);
    for id in ["farm-1", "farm-2", "hall", "secret", "secret2"] {
        all.create_study(named(id)).await.expect("created");
    }
    let hidden = all.get_study(get("secret")).await.expect("read").into_inner().uid;
    let mut seen = Vec::new();
    let mut page_token = String::new();
    loop {
        let page = some.list_studies(wire::ListStudiesRequest { page_size: 2, page_token }).await.unwrap();
        let page = page.into_inner();
        seen.extend(page.studies.into_iter().map(|study| study.name));
        page_token = page.next_page_token;
        if page_token.is_empty() {
            break;
        }
    }
    assert_eq!(seen, ["studies/farm-1", "studies/farm-2", "studies/hall"]);

    // Every RPC gives equal words whether the study exists or not.
    let mut said = std::collections::BTreeSet::new();
    let mut refused = |status: Option<Status>| {
        let status = status.expect("refused");
        assert_eq!(status.code(), Code::PermissionDenied, "{status}");
        said.insert(status.message().to_owned());
    };
    for id in ["secret", "nothing"] {
        let (name, trial) = (format!("studies/{id}"), format!("studies/{id}/trials/1"));
        refused(some.create_study(named(id)).await.err());
        refused(some.get_study(get(id)).await.err());
        refused(some.delete_study(delete(id)).await.err());
        let update = wire::Study { name: name.clone(), ..wire::Study::default() };
        let update = wire::UpdateStudyRequest { study: Some(update), update_mask: None };
        refused(some.update_study(update).await.err());
        refused(some.suggest(wire::SuggestRequest { study: name.clone(), ..ask("one", 1.0) }).await.err());
        refused(some.report(report(&trial, 1.0)).await.err());
        let predict = wire::PredictRequest { study: name.clone(), ..wire::PredictRequest::default() };
        refused(some.predict(predict).await.err());
        refused(some.abandon_trial(wire::AbandonTrialRequest { trial: trial.clone() }).await.err());
        refused(some.extend_lease(wire::ExtendLeaseRequest { trial: trial.clone() }).await.err());
        refused(some.get_trial(wire::GetTrialRequest { name: trial }).await.err());
        let query = wire::QueryTrialsRequest { study: name.clone(), ..wire::QueryTrialsRequest::default() };
        refused(some.query_trials(query).await.err());
        let best = wire::GetBestRequest { study: name, ..wire::GetBestRequest::default() };
        refused(some.get_best(best).await.err());
        let rename = |from: &str, to: &str| wire::RenameStudyRequest {
            name: format!("studies/{from}"),
            study_id: to.to_owned(),
        };
        refused(some.rename_study(rename(id, "farm-3")).await.err());
        refused(some.rename_study(rename("hall", id)).await.err());
        // An identity leads to the study, and to no right in it.
        refused(some.get_study(get(&format!("{id}@{hidden}"))).await.err());
        refused(some.get_study(get(&format!("hall@{hidden}"))).await.err());
        refused(some.get_study(get(&format!("{id}@0123456789abcdef"))).await.err());
    }
    assert_eq!(said.len(), 1, "{said:?}");
    guarded.server.stop().await;
}

#[tokio::test]
async fn who_may_create_no_more_does_not_create_a_study_that_was_just_deleted() {
    let store = Arc::new(MemoryStore::with(Faults { fleeting: true, ..Faults::default() }));
    let guarded = Guarded::on(Arc::clone(&store) as _).await;
    let quota = Quota { studies: Some(1), ..Quota::default() };
    let token = guarded.token(Scope::Tune, &[], quota).await;
    let mut caller = guarded.with(&token).await;
    caller.create_study(named("hall")).await.expect("created");
    caller.create_study(named("hall")).await.expect("found again");
    let gone = store.get_study("hall").await;
    assert!(gone.is_err(), "it was deleted behind the look, and is not created again: {gone:?}");
}

#[tokio::test]
async fn quotas_end_and_say_when_to_try_again() {
    let guarded = Guarded::start().await;
    let quota =
        Quota { studies: Some(1), trials_per_day: Some(2), requests_per_s: Some(50), ..Quota::default() };
    let token = guarded.token(Scope::Tune, &[], quota).await;
    let mut caller = guarded.with(&token).await;
    caller.create_study(named("hall")).await.expect("created");
    caller.create_study(named("hall")).await.expect("found again");
    assert_refused(caller.create_study(named("attic")).await, Code::ResourceExhausted, "1 studies");
    let study = Some(wire::Study { seed: 12, ..study() });
    let other = wire::CreateStudyRequest { study, ..named("hall") };
    assert_refused(caller.create_study(other).await, Code::AlreadyExists, "seed");

    let bad = wire::SuggestRequest { indicators: Default::default(), ..ask("one", 1.0) };
    assert_refused(caller.suggest(bad).await, Code::InvalidArgument, "triangles");
    for count in [5.0, 50.0] {
        caller.suggest(ask("one", count)).await.expect("what was refused does not count");
    }
    let over = caller.suggest(ask("one", 95.0)).await.expect_err("refused");
    assert_eq!(over.code(), Code::ResourceExhausted, "{over}");
    let wait = over.get_details_retry_info().and_then(|info| info.retry_delay).expect("a hint");
    assert!(wait > Duration::from_secs(60) && wait <= Duration::from_secs(86_400), "{wait:?}");
    guarded.server.clock.advance_ms(86_400_000 / 24 - 1);

    // As many at once as a second allows, and no more.
    let mut refused = None;
    for _ in 0..400 {
        if let Err(status) = caller.get_study(get("hall")).await {
            refused = Some(status);
            break;
        }
    }
    let refused = refused.expect("fifty a second are not four hundred at once");
    assert_eq!(refused.code(), Code::ResourceExhausted, "{refused}");
    let wait = refused.get_details_retry_info().and_then(|info| info.retry_delay).expect("a hint");
    assert!(wait <= Duration::from_millis(20), "{wait:?}");
    tokio::time::sleep(wait + Duration::from_millis(5)).await;
    caller.get_study(get("hall")).await.expect("after the pause that was asked for");

    guarded.access.save().await;
    let (all, _) = guarded.tokens.usage(token.id(), 0).await.unwrap();
    assert_eq!((all.studies, all.trials), (1, 2));
    assert!(all.bytes > 100);
    guarded.server.stop().await;
}

#[tokio::test]
async fn a_stream_ends_with_its_token() {
    let guarded = Guarded::start().await;
    let token = guarded.token(Scope::Tune, &["hall"], Quota::default()).await;
    let mut caller = guarded.with(&token).await;
    caller.create_study(named("hall")).await.expect("created");
    let (frames, sent) = tokio::sync::mpsc::channel(4);
    let frame = |study: &str| wire::TuneRequest {
        report: None,
        suggest: Some(wire::SuggestRequest { study: format!("studies/{study}"), ..ask("one", 1.0) }),
    };
    let stream = caller.tune(tokio_stream::wrappers::ReceiverStream::new(sent)).await.expect("open");
    let mut answers = stream.into_inner();
    frames.send(frame("hall")).await.unwrap();
    assert!(answers.message().await.unwrap().unwrap().trial.is_some());
    frames.send(frame("attic")).await.unwrap();
    let refused = answers.message().await.unwrap().unwrap().suggest_error.expect("refused");
    assert_eq!(refused.code, Code::PermissionDenied as i32);

    guarded.tokens.revoke(token.id(), common::START_MS).await.unwrap();
    guarded.access.refresh().await.unwrap();
    frames.send(frame("hall")).await.unwrap();
    assert_eq!(answers.message().await.expect_err("over").code(), Code::Unauthenticated);
    guarded.server.stop().await;
}

#[tokio::test]
async fn request_ids_come_back_and_too_many_headers_do_not_get_in() {
    let (server, mut client) = Server::with_hall().await;
    let asked = |id: &'static str| {
        let mut request = Request::new(get("hall"));
        request.metadata_mut().insert("x-request-id", MetadataValue::from_static(id));
        request
    };
    let id_of = |metadata: &tonic::metadata::MetadataMap| {
        metadata.get("x-request-id").expect("an id").to_str().expect("text").to_owned()
    };
    let answer = client.get_study(asked("frame-7.a_B")).await.unwrap();
    assert_eq!(id_of(answer.metadata()), "frame-7.a_B");
    let missing = Request::new(get("attic"));
    let refused = client.get_study(missing).await.expect_err("there is none");
    let made = id_of(refused.metadata());
    assert!((10..=40).contains(&made.len()), "{made}");
    for bad in ["a b", "\"quoted\"", "x; DROP TABLE studies"] {
        let answer = client.get_study(asked(bad)).await.unwrap();
        assert_ne!(id_of(answer.metadata()), bad);
    }
    let mut many = Request::new(get("hall"));
    for number in 0..60_u32 {
        let key = tonic::metadata::MetadataKey::from_bytes(format!("x-{number}").as_bytes()).unwrap();
        many.metadata_mut().insert(key, MetadataValue::from_static("1"));
    }
    assert_refused(client.get_study(many).await, Code::InvalidArgument, "metadata");
    server.stop().await;
}
