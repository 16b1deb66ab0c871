//! A server in this process, over a real socket, with a clock that stands still until it is moved.
#![allow(dead_code)] // Each test file uses its own part.

use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use tokio::io::{AsyncReadExt as _, AsyncWriteExt as _};
use tokio::net::{TcpListener, TcpStream};
use tokio::sync::oneshot;
use tokio::task::JoinHandle;
use tonic::metadata::{Ascii, MetadataValue};
use tonic::service::Interceptor;
use tonic::service::interceptor::InterceptedService;
use tonic::transport::Channel;
use tonic::{Code, Request, Status};
use treewright_proto::v1::tuning_service_client::TuningServiceClient;
use treewright_proto::v1::{self as wire, outcome, parameter, value};
use treewright_server::access::token::Token;
use treewright_server::clock::ManualClock;
use treewright_server::serve;
use treewright_store::tokens::{Quota, Scope, Studies, TokenRecord};
use treewright_store::{MemoryStore, PostgresAddress, PostgresStore, SqliteStore, Store};
use treewright_test_postgres::Database;

pub(crate) type Client = TuningServiceClient<Channel>;

pub(crate) type Caller = TuningServiceClient<InterceptedService<Channel, Show>>;

/// Shows a header with every request.
#[derive(Clone)]
pub(crate) struct Show(Option<MetadataValue<Ascii>>);

impl Interceptor for Show {
    fn call(&mut self, mut request: Request<()>) -> Result<Request<()>, Status> {
        if let Some(value) = &self.0 {
            request.metadata_mut().insert("authorization", value.clone());
        }
        Ok(request)
    }
}

pub(crate) const START_MS: i64 = 1_750_000_000_000;

pub(crate) struct Server {
    pub(crate) address: SocketAddr,
    pub(crate) clock: Arc<ManualClock>,
    stop: Option<oneshot::Sender<()>>,
    task: JoinHandle<()>,
}

impl Server {
    pub(crate) async fn in_memory() -> Self {
        Self::with(Arc::new(MemoryStore::new()), START_MS).await
    }

    pub(crate) async fn with_client() -> (Self, Client) {
        let server = Self::in_memory().await;
        let client = server.client().await;
        (server, client)
    }

    /// In memory, with the study `hall` and a client.
    pub(crate) async fn with_hall() -> (Self, Client) {
        let (server, mut client) = Self::with_client().await;
        create(&mut client, "hall").await;
        (server, client)
    }

    pub(crate) async fn on_disk(path: &Path, now_ms: i64) -> Self {
        let store = SqliteStore::open(path).await.expect("a database");
        Self::with(Arc::new(store), now_ms).await
    }

    /// On disk, with the study `hall` and a client.
    pub(crate) async fn on_disk_with_hall(path: &Path) -> (Self, Client) {
        let server = Self::on_disk(path, START_MS).await;
        let mut client = server.client().await;
        create(&mut client, "hall").await;
        (server, client)
    }

    pub(crate) async fn with(store: Arc<dyn Store>, now_ms: i64) -> Self {
        Self::with_options(store, Arc::new(ManualClock::at(now_ms)), Duration::from_secs(5)).await
    }

    pub(crate) async fn with_options(
        store: Arc<dyn Store>,
        clock: Arc<ManualClock>,
        options: impl Into<serve::Options>,
    ) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        Self::on(listener, store, clock, options.into()).await
    }

    pub(crate) async fn replica(database: &Database) -> Self {
        let clock = Arc::new(ManualClock::at(START_MS));
        Self::replica_with(database, clock, Duration::from_secs(5)).await
    }

    pub(crate) async fn replica_with(
        database: &Database,
        clock: Arc<ManualClock>,
        options: impl Into<serve::Options>,
    ) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").await.expect("a port");
        let advertised = format!("http://{}", listener.local_addr().expect("an address"));
        let server = PostgresAddress::parse(database.url()).expect("an address");
        let store = PostgresStore::open(server, &advertised, Duration::ZERO).await.expect("a database");
        Self::on(listener, Arc::new(store), clock, options.into()).await
    }

    async fn on(
        listener: TcpListener,
        store: Arc<dyn Store>,
        clock: Arc<ManualClock>,
        options: serve::Options,
    ) -> Self {
        let address = listener.local_addr().expect("an address");
        let (stop, stopped) = oneshot::channel::<()>();
        let served = serve::run(listener, store, Arc::clone(&clock) as _, options, async {
            // A dropped server stops as well.
            let _ = stopped.await;
        });
        let task = tokio::spawn(async { served.await.expect("served") });
        Self { address, clock, stop: Some(stop), task }
    }

    pub(crate) async fn channel(&self) -> Channel {
        Channel::from_shared(format!("http://{}", self.address))
            .expect("an address")
            .connect()
            .await
            .expect("a connection")
    }

    pub(crate) async fn client(&self) -> Client {
        Client::new(self.channel().await)
    }

    /// A client that shows a header with every request.
    pub(crate) async fn caller(&self, header: Option<String>) -> Caller {
        let value = header.map(|header| MetadataValue::try_from(header.as_str()).expect("a header"));
        TuningServiceClient::with_interceptor(self.channel().await, Show(value))
    }

    /// Asks it to stop, without waiting.
    pub(crate) fn begin_stop(&mut self) {
        drop(self.stop.take());
    }

    pub(crate) async fn stop(mut self) {
        self.begin_stop();
        self.task.await.expect("stopped");
    }
}

pub(crate) fn integer(integer: i64) -> wire::Value {
    wire::Value { kind: Some(value::Kind::Integer(integer)) }
}

pub(crate) fn text(text: &str) -> wire::Value {
    wire::Value { kind: Some(value::Kind::Text(text.to_owned())) }
}

fn integer_parameter(name: &str, max: i64, default: i64) -> wire::Parameter {
    wire::Parameter {
        name: name.to_owned(),
        domain: Some(parameter::Domain::Integer(wire::IntegerDomain { min: 1, max, scale: 0 })),
        default_value: Some(integer(default)),
        active_if: None,
        setup: false,
    }
}

/// A study that always explores.
pub(crate) fn study() -> wire::Study {
    wire::Study {
        display_name: "A hall".to_owned(),
        space: Some(wire::Space {
            parameters: vec![
                integer_parameter("min_leaf", 32, 1),
                integer_parameter("max_leaf", 32, 8),
                wire::Parameter {
                    name: "quality".to_owned(),
                    domain: Some(parameter::Domain::Categorical(wire::CategoricalDomain {
                        values: vec![text("low"), text("high")],
                    })),
                    default_value: Some(text("low")),
                    active_if: None,
                    setup: false,
                },
            ],
            constraints: vec![wire::Constraint {
                lesser: "min_leaf".to_owned(),
                greater: "max_leaf".to_owned(),
                ..wire::Constraint::default()
            }],
        }),
        indicators: vec![wire::Indicator { name: "triangles".to_owned(), min: 0.0, max: 100.0, scale: 0 }],
        objective: Some(wire::Objective {
            terms: vec![wire::ObjectiveTerm { metric: "render_ms".to_owned(), weight: 1.0 }],
            ..Default::default()
        }),
        policy: Some(wire::Policy { epsilon: Some(1.0), ..wire::Policy::default() }),
        seed: 11,
        ..wire::Study::default()
    }
}

pub(crate) async fn create(client: &mut Client, id: &str) -> wire::Study {
    client.create_study(creation(id, study())).await.expect("created").into_inner()
}

pub(crate) fn creation(id: &str, study: wire::Study) -> wire::CreateStudyRequest {
    wire::CreateStudyRequest { study_id: id.to_owned(), study: Some(study) }
}

/// A configuration of the least `min_leaf`.
pub(crate) fn configuration(max_leaf: i64, quality: &str) -> wire::Configuration {
    let values = [("min_leaf", integer(1)), ("max_leaf", integer(max_leaf)), ("quality", text(quality))];
    wire::Configuration { values: values.map(|(name, value)| (name.to_owned(), value)).into() }
}

/// A token for these studies, or for all, and its record.
pub(crate) fn token(scope: Scope, studies: Vec<String>, quota: Quota) -> (Token, TokenRecord) {
    let token = Token::make().expect("randomness");
    let record = TokenRecord {
        id: token.id().to_owned(),
        name: "a test".to_owned(),
        hash: token.hash(),
        scope,
        studies: Studies(studies),
        quota,
        create_ms: START_MS,
        expire_ms: None,
        revoke_ms: None,
    };
    (token, record)
}

/// Sends a request of HTTP and returns the whole answer, head and all.
pub(crate) async fn exchange(address: SocketAddr, request: &str) -> String {
    let mut stream = TcpStream::connect(address).await.expect("a connection");
    stream.write_all(request.as_bytes()).await.expect("sent");
    let mut answer = String::new();
    stream.read_to_string(&mut answer).await.expect("text");
    answer
}

pub(crate) fn triangles(count: f64) -> BTreeMap<String, f64> {
    BTreeMap::from([("triangles".to_owned(), count)])
}

pub(crate) fn ask(client_id: &str, count: f64) -> wire::SuggestRequest {
    wire::SuggestRequest {
        study: "studies/hall".to_owned(),
        client_id: client_id.to_owned(),
        indicators: triangles(count),
        fingerprint: Some(wire::Fingerprint {
            cpu_model: "a fast one".to_owned(),
            isa: "avx2".to_owned(),
            threads: 2,
            software: BTreeMap::from([("embree".to_owned(), "4.4.0".to_owned())]),
        }),
        ..wire::SuggestRequest::default()
    }
}

pub(crate) fn best() -> wire::GetBestRequest {
    let study = "studies/hall".to_owned();
    wire::GetBestRequest { study, indicators: triangles(10.0), ..Default::default() }
}

pub(crate) fn predict() -> wire::PredictRequest {
    let study = "studies/hall".to_owned();
    wire::PredictRequest { study, indicators: triangles(10.0), ..Default::default() }
}

pub(crate) fn ok() -> Option<wire::Outcome> {
    Some(wire::Outcome { kind: Some(outcome::Kind::Ok(wire::Ok {})) })
}

pub(crate) fn report(trial: &str, render_ms: f64) -> wire::ReportRequest {
    wire::ReportRequest {
        trial: trial.to_owned(),
        measurements: BTreeMap::from([("render_ms".to_owned(), render_ms), ("build_ms".to_owned(), 3.5)]),
        outcome: ok(),
        ..wire::ReportRequest::default()
    }
}

pub(crate) async fn suggest(client: &mut Client, client_id: &str, count: f64) -> wire::Trial {
    let request = ask(client_id, count);
    client.suggest(request).await.expect("a trial").into_inner()
}

pub(crate) async fn done(client: &mut Client, trial: &str, render_ms: f64) -> wire::ReportResponse {
    let request = report(trial, render_ms);
    client.report(request).await.expect("taken").into_inner()
}

pub(crate) async fn get(client: &mut Client, trial: &str) -> wire::Trial {
    let name = trial.to_owned();
    let request = wire::GetTrialRequest { name };
    client.get_trial(request).await.expect("a trial").into_inner()
}

pub(crate) fn assert_refused<T: std::fmt::Debug>(answer: Result<T, Status>, code: Code, fragment: &str) {
    let status = answer.expect_err("refused");
    assert_eq!(status.code(), code, "{status}");
    assert!(status.message().contains(fragment), "{status}");
}
