//! This daemon answers released clients: their recorded requests (`proto/released`), sent one after the other
//! to a daemon that knows nothing yet.

mod common;

use std::path::{Path, PathBuf};

use prost::Message;
use treewright_proto::v1 as wire;

use common::{Client, Server};

fn versions() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../proto/released");
    let entries = std::fs::read_dir(folder).expect("the released versions");
    entries.map(|entry| entry.expect("an entry").path()).filter(|path| path.is_dir()).collect()
}

/// Requests in the order of the conversation, by RPC.
fn requests(version: &Path) -> Vec<(String, Vec<u8>)> {
    let entries = std::fs::read_dir(version).expect("a recorded conversation");
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.to_string_lossy().ends_with(".request.binpb"))
        .collect();
    files.sort();
    let read = |path: PathBuf| {
        let name = path.file_name().expect("a name").to_string_lossy().into_owned();
        let rpc = name.split('.').nth(1).expect("NN.RPC.request.binpb").to_owned();
        (rpc, std::fs::read(path).expect("a file"))
    };
    files.into_iter().map(read).collect()
}

fn read<M: Message + Default>(bytes: &[u8]) -> M {
    M::decode(bytes).expect("a recorded message")
}

async fn ask(client: &mut Client, rpc: &str, bytes: &[u8]) -> Result<(), tonic::Status> {
    match rpc {
        "CreateStudy" => client.create_study(read::<wire::CreateStudyRequest>(bytes)).await.map(drop),
        "GetStudy" => client.get_study(read::<wire::GetStudyRequest>(bytes)).await.map(drop),
        "ListStudies" => client.list_studies(read::<wire::ListStudiesRequest>(bytes)).await.map(drop),
        "UpdateStudy" => client.update_study(read::<wire::UpdateStudyRequest>(bytes)).await.map(drop),
        "Suggest" => client.suggest(read::<wire::SuggestRequest>(bytes)).await.map(drop),
        "Report" => client.report(read::<wire::ReportRequest>(bytes)).await.map(drop),
        "Predict" => client.predict(read::<wire::PredictRequest>(bytes)).await.map(drop),
        "AbandonTrial" => client.abandon_trial(read::<wire::AbandonTrialRequest>(bytes)).await.map(drop),
        "ExtendLease" => client.extend_lease(read::<wire::ExtendLeaseRequest>(bytes)).await.map(drop),
        "GetTrial" => client.get_trial(read::<wire::GetTrialRequest>(bytes)).await.map(drop),
        "QueryTrials" => client.query_trials(read::<wire::QueryTrialsRequest>(bytes)).await.map(drop),
        "GetBest" => client.get_best(read::<wire::GetBestRequest>(bytes)).await.map(drop),
        other => panic!("the recorder calls {other}, this test does not"),
    }
}

#[tokio::test]
async fn requests_of_released_clients_are_answered() {
    assert!(versions().iter().any(|version| version.ends_with("0.1.0")));
    for version in versions() {
        let (_server, mut client) = Server::with_client().await;
        let requests = requests(&version);
        assert!(requests.len() >= 20, "{}", version.display());
        for (index, (rpc, bytes)) in requests.iter().enumerate() {
            let answer = ask(&mut client, rpc, bytes).await;
            assert!(answer.is_ok(), "{} {} {rpc}: {answer:?}", version.display(), index + 1);
        }
    }
}

#[tokio::test]
async fn what_only_a_newer_client_asks_for_is_refused_by_name() {
    let (_server, mut client) = Server::with_client().await;
    let requests = requests(&versions()[0]);
    let mut create: wire::CreateStudyRequest = read(&requests[0].1);
    create.study.as_mut().unwrap().policy.as_mut().unwrap().predictor = 8;
    let refused = client.create_study(create.clone()).await.unwrap_err();
    assert_eq!(refused.code(), tonic::Code::InvalidArgument);
    assert!(refused.message().contains("policy.predictor: 8 is not a known value"), "{refused}");
    create.study.as_mut().unwrap().policy.as_mut().unwrap().predictor = 0;
    client.create_study(create).await.unwrap();
    let policy = wire::Policy { epsilon: Some(0.5), predictor: 8, ..wire::Policy::default() };
    let update = |path: &str| wire::UpdateStudyRequest {
        study: Some(wire::Study {
            name: "studies/recorded".to_owned(),
            policy: Some(policy.clone()),
            ..wire::Study::default()
        }),
        update_mask: Some(prost_types::FieldMask { paths: vec![path.to_owned()] }),
    };
    // Fields that are sent outside the mask have no effect.
    client.update_study(update("policy.epsilon")).await.unwrap();
    for path in ["policy.predictor", "policy.field_of_tomorrow"] {
        let refused = client.update_study(update(path)).await.unwrap_err();
        assert_eq!(refused.code(), tonic::Code::InvalidArgument, "{refused}");
    }
}
