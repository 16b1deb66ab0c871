//! Requests of a farm's clients: malformed messages, compressed requests, filters on names that are not
//! there.

mod common;

use common::{Server, ask, assert_refused, create};
use tonic::codec::CompressionEncoding;
use tonic::{Code, Request};
use treewright_proto::v1 as wire;

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

#[tokio::test]
async fn filters_on_names_that_the_study_lacks_are_refused() {
    let (server, mut client) = Server::with_hall().await;
    let query = |filter: &str| wire::QueryTrialsRequest {
        study: "studies/hall".to_owned(),
        filter: filter.to_owned(),
        ..wire::QueryTrialsRequest::default()
    };
    client.query_trials(query("config.min_leaf = 2 AND indicator.triangles > 1")).await.expect("it has both");
    let answer = client.query_trials(query("config.leaf = 2")).await;
    assert_refused(answer, Code::InvalidArgument, "at character 1: the study has no parameter \"leaf\"");
    let answer = client.query_trials(query("cost > 1 AND indicator.size > 1")).await;
    assert_refused(answer, Code::InvalidArgument, "at character 14: the study has no indicator \"size\"");
    server.stop().await;
}
