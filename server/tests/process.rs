//! `treewrightd` as a process: its ready line, its exit codes, its one-line messages, and its spans for a
//! collector of OpenTelemetry.

use std::io::{BufRead as _, BufReader, Read as _};
use std::net::TcpListener;
use std::path::Path;
use std::process::{Child, Command, Stdio};

use opentelemetry_proto::tonic::collector::trace::v1::trace_service_server::{
    TraceService, TraceServiceServer,
};
use opentelemetry_proto::tonic::collector::trace::v1::{
    ExportTraceServiceRequest, ExportTraceServiceResponse,
};
use opentelemetry_proto::tonic::common::v1::any_value::Value;
use opentelemetry_proto::tonic::trace::v1::Span;
use tokio::sync::mpsc;
use tonic::{Request, Response, Status};
use treewright_proto::v1 as wire;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;

struct Daemon {
    child: Child,
    ready: String,
}

fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_treewrightd"));
    // The developer's settings must not reach the test.
    for (name, _) in std::env::vars().filter(|(name, _)| name.starts_with("TREEWRIGHT_")) {
        command.env_remove(name);
    }
    command.args(arguments).stdout(Stdio::piped()).stderr(Stdio::piped());
    command
}

fn serve(database: &Path) -> Command {
    let database = database.to_str().expect("plain");
    command(&["serve", "--listen", "127.0.0.1:0", "--database", database])
}

impl Daemon {
    fn start(database: &Path) -> Self {
        Self::spawn(serve(database))
    }

    fn spawn(mut command: Command) -> Self {
        let mut child = command.spawn().expect("started");
        let mut ready = String::new();
        let stdout = child.stdout.as_mut().expect("piped");
        BufReader::new(stdout).read_line(&mut ready).expect("a line");
        Self { child, ready }
    }

    /// Sends SIGTERM and returns exit code and log.
    fn terminate(mut self) -> (Option<i32>, String) {
        let pid = self.child.id().to_string();
        let sent = Command::new("kill").args(["-TERM", &pid]).status().expect("sent");
        assert!(sent.success());
        let mut log = String::new();
        self.child.stderr.take().expect("piped").read_to_string(&mut log).expect("a log");
        (self.child.wait().expect("ended").code(), log)
    }
}

/// Runs to the end: exit code, standard output and standard error.
fn run(arguments: &[&str]) -> (Option<i32>, String, String) {
    let output = command(arguments).output().expect("run");
    let text = |bytes| String::from_utf8(bytes).expect("text");
    (output.status.code(), text(output.stdout), text(output.stderr))
}

#[test]
fn it_prints_one_line_serves_and_stops_at_sigterm() {
    let directory = tempfile::tempdir().unwrap();
    let daemon = Daemon::start(&directory.path().join("studies.db"));
    let address = daemon
        .ready
        .strip_prefix("treewrightd listening on http://")
        .and_then(|rest| rest.strip_suffix('\n'))
        .expect("the ready line");
    let address: std::net::SocketAddr = address.parse().expect("an address");
    assert_ne!(address.port(), 0);
    std::net::TcpStream::connect(address).expect("it listens");
    let (code, log) = daemon.terminate();
    assert_eq!(code, Some(0), "{log}");
    assert!(log.contains("draining") && log.contains("stopped"), "{log}");
}

#[test]
fn variables_that_are_empty_are_as_if_they_were_not_set() {
    let help = run(&["serve", "--help"]).1;
    let variables = help.split("[env: ").skip(1).filter_map(|rest| rest.split(['=', ']']).next());
    let variables: Vec<&str> = variables.collect();
    assert!(variables.len() > 20 && variables.contains(&"TREEWRIGHT_OTLP"), "{variables:?}");
    let directory = tempfile::tempdir().unwrap();
    let mut empty = serve(&directory.path().join("studies.db"));
    empty.envs(variables.iter().map(|name| (name, "")));
    let daemon = Daemon::spawn(empty);
    let ready = daemon.ready.clone();
    let (code, log) = daemon.terminate();
    assert!(ready.starts_with("treewrightd listening on http://127.0.0.1:"), "{log}");
    assert_eq!(code, Some(0), "{log}");
}

#[test]
fn a_second_daemon_on_one_database_is_refused() {
    let directory = tempfile::tempdir().unwrap();
    let database = directory.path().join("studies.db");
    let first = Daemon::start(&database);
    let pid = first.child.id();
    let path = database.to_str().unwrap();
    let (code, stdout, stderr) = run(&["serve", "--listen", "127.0.0.1:0", "--database", path]);
    assert_eq!(code, Some(4));
    assert_eq!(stdout, "");
    let message = format!("studies.db is in use by another treewrightd (pid {pid})");
    assert!(stderr.contains(&message), "{stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert_eq!(first.terminate().0, Some(0));
}

#[test]
fn each_trouble_has_its_exit_code_and_one_line() {
    let directory = tempfile::tempdir().unwrap();
    let here = directory.path().to_str().unwrap();
    let (code, _, stderr) = run(&["serve", "--listen", "127.0.0.1:0", "--database", here]);
    assert_eq!(code, Some(4));
    assert!(stderr.contains(&format!("{here} is a directory")), "{stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");

    let taken = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = taken.local_addr().unwrap().to_string();
    let database = directory.path().join("studies.db");
    let database = database.to_str().unwrap();
    let (code, stdout, stderr) = run(&["serve", "--listen", &address, "--database", database]);
    assert_eq!(code, Some(3));
    assert_eq!(stdout, "", "nothing claims to listen");
    assert!(stderr.contains(&format!("cannot listen on {address}")), "{stderr}");
    assert_eq!(stderr.lines().count(), 1, "{stderr}");
    assert!(!Path::new(database).exists());

    let (code, _, stderr) = run(&["serve", "--listen", "0.0.0.0:0", "--database", database]);
    assert_eq!(code, Some(2));
    assert!(stderr.contains("--insecure"), "{stderr}");
    assert_eq!(run(&["serve"]).0, Some(2));
    let (code, help, _) = run(&["serve", "--help"]);
    assert_eq!(code, Some(0));
    assert!(help.contains("TREEWRIGHT_DATABASE"), "{help}");
}

struct Collector(mpsc::UnboundedSender<Span>);

#[tonic::async_trait]
impl TraceService for Collector {
    async fn export(
        &self,
        request: Request<ExportTraceServiceRequest>,
    ) -> Result<Response<ExportTraceServiceResponse>, Status> {
        let resources = request.into_inner().resource_spans.into_iter();
        for span in resources.flat_map(|resource| resource.scope_spans).flat_map(|scope| scope.spans) {
            self.0.send(span).expect("the test listens");
        }
        Ok(Response::new(ExportTraceServiceResponse::default()))
    }
}

fn attribute(span: &Span, key: &str) -> Option<String> {
    let value = span.attributes.iter().find(|attribute| attribute.key == key)?.value.clone()?.value?;
    match value {
        Value::StringValue(text) => Some(text),
        _ => None,
    }
}

#[tokio::test]
async fn a_request_s_span_has_the_id_of_its_line_in_the_log() {
    let listener = tokio::net::TcpListener::bind("127.0.0.1:0").await.unwrap();
    let collector = format!("http://{}", listener.local_addr().unwrap());
    let (sender, mut spans) = mpsc::unbounded_channel();
    let incoming = tokio_stream::wrappers::TcpListenerStream::new(listener);
    let service = TraceServiceServer::new(Collector(sender));
    tokio::spawn(tonic::transport::Server::builder().add_service(service).serve_with_incoming(incoming));

    let folder = tempfile::tempdir().unwrap();
    let mut traced = serve(&folder.path().join("studies.db"));
    traced.args(["--log-format", "json", "--otlp", &collector]);
    let daemon = Daemon::spawn(traced);
    let url = daemon.ready.trim().rsplit(' ').next().unwrap().to_owned();
    let mut client = TuningServiceClient::connect(url).await.unwrap();
    let mut request = Request::new(wire::GetStudyRequest { name: "studies/none".to_owned() });
    let trace = "4bf92f3577b34da6a3ce929d0e0e4736";
    request.metadata_mut().insert("x-request-id", "frame-4711".parse().unwrap());
    request.metadata_mut().insert("traceparent", format!("00-{trace}-00f067aa0ba902b7-01").parse().unwrap());
    client.get_study(request).await.expect_err("there is none");

    // The end sends waiting spans.
    let ended = tokio::task::spawn_blocking(|| daemon.terminate());
    let span = loop {
        let span = spans.recv().await.expect("a span");
        if attribute(&span, "id").as_deref() == Some("frame-4711") {
            break span;
        }
    };
    assert_eq!((span.name.as_str(), attribute(&span, "rpc").as_deref()), ("request", Some("GetStudy")));
    let hexadecimal: String = span.trace_id.iter().map(|byte| format!("{byte:02x}")).collect();
    assert_eq!(hexadecimal, trace, "it belongs to the client's trace");
    assert!(span.events.iter().any(|event| event.name == "request refused"), "{:?}", span.events);

    let (code, log) = ended.await.unwrap();
    assert_eq!(code, Some(0), "{log}");
    let refused = log.lines().find(|line| line.contains("request refused")).expect("a line");
    let line: serde_json::Value = serde_json::from_str(refused).expect("JSON");
    assert_eq!(line["span"]["id"], "frame-4711");
}
