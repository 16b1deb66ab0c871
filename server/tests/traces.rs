//! The daemon as a process that sends spans to a collector of OpenTelemetry.

use std::io::{BufRead as _, BufReader, Read as _};
use std::process::{Command, Stdio};

use opentelemetry_proto::tonic::collector::trace::v1::trace_service_server::{
    TraceService, TraceServiceServer,
};
use opentelemetry_proto::tonic::collector::trace::v1::{
    ExportTraceServiceRequest, ExportTraceServiceResponse,
};
use opentelemetry_proto::tonic::common::v1::any_value::Value;
use opentelemetry_proto::tonic::trace::v1::Span;
use tokio::net::TcpListener;
use tokio::sync::mpsc;
use tonic::{Request, Response, Status};
use treewright_proto::v1 as wire;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;

/// Passes received spans on.
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
    let listener = TcpListener::bind("127.0.0.1:0").await.unwrap();
    let collector = format!("http://{}", listener.local_addr().unwrap());
    let (sender, mut spans) = mpsc::unbounded_channel();
    let incoming = tokio_stream::wrappers::TcpListenerStream::new(listener);
    let service = TraceServiceServer::new(Collector(sender));
    tokio::spawn(tonic::transport::Server::builder().add_service(service).serve_with_incoming(incoming));

    let folder = tempfile::tempdir().unwrap();
    let mut daemon = Command::new(env!("CARGO_BIN_EXE_treewrightd"))
        .args([
            "serve",
            "--listen",
            "127.0.0.1:0",
            "--log-format",
            "json",
            "--otlp",
            &collector,
            "--database",
        ])
        .arg(folder.path().join("studies.db"))
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut ready = String::new();
    BufReader::new(daemon.stdout.as_mut().unwrap()).read_line(&mut ready).unwrap();
    let url = ready.trim().rsplit(' ').next().unwrap().to_owned();
    let mut client = TuningServiceClient::connect(url).await.unwrap();
    let mut request = Request::new(wire::GetStudyRequest { name: "studies/none".to_owned() });
    let trace = "4bf92f3577b34da6a3ce929d0e0e4736";
    request.metadata_mut().insert("x-request-id", "frame-4711".parse().unwrap());
    request.metadata_mut().insert("traceparent", format!("00-{trace}-00f067aa0ba902b7-01").parse().unwrap());
    client.get_study(request).await.expect_err("there is none");

    // The end sends waiting spans.
    let sent = Command::new("kill").args(["-TERM", &daemon.id().to_string()]).status().unwrap();
    assert!(sent.success());
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

    let mut log = String::new();
    tokio::task::spawn_blocking(move || {
        daemon.stderr.take().unwrap().read_to_string(&mut log).unwrap();
        assert!(daemon.wait().unwrap().success());
        let refused = log.lines().find(|line| line.contains("request refused")).expect("a line");
        let line: serde_json::Value = serde_json::from_str(refused).expect("JSON");
        assert_eq!(line["span"]["id"], "frame-4711");
    })
    .await
    .unwrap();
}
