//! `kill -9` in mid-run: the search goes on where it stood, and a repeated report changes nothing.

use std::collections::BTreeSet;

use treewright_proto::v1 as pb;
use treewright_tests::daemon::Daemon;

use crate::wire;

const TRIALS: usize = 40;

/// The configurations that one client is handed over a whole search, the daemon being killed before
/// each of the given trials: after it was reported, or while it is out.
async fn configurations(kill_before: &[usize], kill_while_open: &[usize]) -> Vec<String> {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let database = folder.path().join("tuning.db");
    let mut daemon = Daemon::start(&database);
    let mut client = wire::connect(daemon.url()).await;
    let study = wire::create(&mut client, "restart").await;
    let mut seen = Vec::new();
    for number in 0..TRIALS {
        if kill_before.contains(&number) {
            daemon.kill();
            daemon = Daemon::start(&database);
            client = wire::connect(daemon.url()).await;
        }
        let mut trial =
            client.suggest(wire::suggestion(&study, "one", 0.5)).await.expect("a trial").into_inner();
        if kill_while_open.contains(&number) {
            daemon.kill();
            daemon = Daemon::start(&database);
            client = wire::connect(daemon.url()).await;
            let again =
                client.suggest(wire::suggestion(&study, "one", 0.5)).await.expect("a trial").into_inner();
            assert_eq!(again.name, trial.name, "a client that comes back gets its open trial again");
            trial = again;
        }
        seen.push(wire::text(trial.configuration.as_ref().expect("a configuration")));
        client.report(wire::report(&trial)).await.expect("the report is taken");
    }
    seen
}

#[tokio::test]
async fn the_search_resumes_at_the_same_point_after_kill_9() {
    let undisturbed = configurations(&[], &[]).await;
    assert!(undisturbed.iter().collect::<BTreeSet<_>>().len() > TRIALS / 2, "the search does search");
    assert_eq!(configurations(&[1, 9, 20, 33], &[]).await, undisturbed);
    assert_eq!(configurations(&[], &[0, 12, 27]).await, undisturbed);
}

#[tokio::test]
async fn a_report_repeated_after_a_kill_changes_nothing() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let database = folder.path().join("tuning.db");
    let daemon = Daemon::start(&database);
    let mut client = wire::connect(daemon.url()).await;
    let study = wire::create(&mut client, "repeat").await;
    let trial = client.suggest(wire::suggestion(&study, "one", 0.1)).await.expect("a trial").into_inner();
    let first = client.report(wire::report(&trial)).await.expect("taken").into_inner();
    assert!(!first.duplicate);
    daemon.kill();

    let daemon = Daemon::start(&database);
    let mut client = wire::connect(daemon.url()).await;
    let mut other = wire::report(&trial);
    other.measurements.insert("render_ms".into(), 1.0);
    let second = client.report(other).await.expect("taken").into_inner();
    assert!(second.duplicate);
    assert_eq!(second.trial, first.trial, "the first report stands");
    let request = pb::GetStudyRequest { name: study };
    let statistics = client.get_study(request).await.expect("it is there").into_inner().statistics;
    assert_eq!(statistics.map(|counts| (counts.trials, counts.completed_trials)), Some((1, 1)));
}
