//! This client reads the recorded answers of released daemons (`proto/released`), served by the stand-in.

use std::path::{Path, PathBuf};

use prost::Message;
use treewright_client::{Client, Indicators, Mode, Outcome, PredictorMethod, TrialQuery, TrialState};
use treewright_proto::v1;

use super::support::{Fake, patient};

fn versions() -> Vec<PathBuf> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../proto/released");
    let entries = std::fs::read_dir(folder).expect("the released versions");
    entries.map(|entry| entry.expect("an entry").path()).filter(|path| path.is_dir()).collect()
}

/// The answers of a released daemon to every call of an RPC, in order.
fn responses<M: Message + Default>(version: &Path, rpc: &str) -> Vec<M> {
    let ending = format!(".{rpc}.response.binpb");
    let entries = std::fs::read_dir(version).expect("a recorded conversation");
    let mut files: Vec<PathBuf> = entries
        .map(|entry| entry.expect("an entry").path())
        .filter(|path| path.to_string_lossy().ends_with(&ending))
        .collect();
    files.sort();
    let read = |path: PathBuf| M::decode(std::fs::read(path).expect("a file").as_slice()).expect("a message");
    files.into_iter().map(read).collect()
}

/// The stand-in with all answers of a released daemon.
fn as_recorded(version: &Path) -> Fake {
    let fake = Fake::start();
    let mut book = fake.book();
    let studies: Vec<v1::ListStudiesResponse> = responses(version, "ListStudies");
    for study in &studies[0].studies {
        book.studies.insert(study.name.clone(), study.clone());
    }
    let trials: Vec<v1::QueryTrialsResponse> = responses(version, "QueryTrials");
    book.trials = trials.into_iter().flat_map(|page| page.trials).collect();
    book.trials.extend(responses::<v1::Trial>(version, "AbandonTrial"));
    book.predicted = responses(version, "Predict").pop();
    drop(book);
    fake
}

#[tokio::test]
async fn answers_of_released_daemons_are_read() {
    assert!(versions().iter().any(|version| version.ends_with("0.1.0")));
    for version in versions() {
        let fake = as_recorded(&version);
        let client = Client::connect(&fake.url(), patient()).unwrap();
        let studies = client.list_studies().await.unwrap();
        let spec = studies[0].spec().unwrap();
        assert_eq!(studies[0].display_name, "as recorded");
        assert_eq!((spec.space.parameters().len(), spec.indicators.indicators().len()), (6, 2));
        assert_eq!(studies[0].policy.predictor, Some(PredictorMethod::Contextual.into()));
        assert!((studies[0].policy.epsilon.unwrap() - 0.5).abs() < 1e-12);

        let trials = client.trials("recorded", TrialQuery::all()).take(100).await.unwrap();
        let ended = |wanted: fn(&Outcome) -> bool| {
            trials.iter().filter_map(|trial| trial.outcome.as_ref()?.as_known()).any(wanted)
        };
        assert!(ended(|outcome| *outcome == Outcome::Ok));
        assert!(ended(|outcome| matches!(outcome, Outcome::Infeasible { reason } if reason == "too deep")));
        assert!(ended(|outcome| *outcome == Outcome::aborted(90.0)));
        assert!(ended(|outcome| matches!(outcome, Outcome::Failed { .. })));
        for trial in &trials {
            assert!(trial.mode.as_known().is_some() && trial.unreadable.is_empty(), "{trial:?}");
            assert!(spec.space.configuration(trial.configuration.as_raw().clone()).is_ok(), "{trial:?}");
            assert!(trial.fingerprint.as_ref().is_some_and(|machine| machine.threads == 8));
        }
        let last = trials.last().unwrap();
        assert_eq!((last.mode, last.state), (Mode::Pinned.into(), TrialState::Abandoned.into()));

        let at = Indicators::from([("triangles", 262_267.0), ("distance", 12.5)]);
        let prediction = client.predict("recorded", &at).await.unwrap();
        assert!(prediction.mode.as_known().is_some());
        assert!(prediction.state.is_some_and(|state| state.tried > 0));
    }
}
