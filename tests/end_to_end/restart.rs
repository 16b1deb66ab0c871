//! `kill -9` in mid-run: no acknowledged report is lost, and the search goes on where it stood.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

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
async fn no_acknowledged_report_is_lost_in_a_storm_of_kills() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let database = folder.path().join("tuning.db");
    let mut acknowledged = BTreeSet::new();
    let heard = Arc::new(AtomicU64::new(0));
    let mut study = String::new();
    for round in 0..6u64 {
        let daemon = Daemon::start(&database);
        let url = daemon.url().to_owned();
        study = wire::create(&mut wire::connect(&url).await, "storm").await;
        let mut workers = tokio::task::JoinSet::new();
        for worker in 0..4u32 {
            let (url, study, heard) = (url.clone(), study.clone(), Arc::clone(&heard));
            workers.spawn(async move {
                let mut client = wire::connect(&url).await;
                let mut done = Vec::new();
                // Ends with the first call that meets the dead daemon.
                for step in 0.. {
                    let near = f64::from(worker) / 4.0 + f64::from(step % 3) / 20.0;
                    let asked =
                        client.suggest(wire::suggestion(&study, &format!("worker-{worker}"), near)).await;
                    let Ok(trial) = asked.map(tonic::Response::into_inner) else { break };
                    let Ok(answer) = client.report(wire::report(&trial)).await else { break };
                    done.push(answer.into_inner().trial.expect("the stored trial").name);
                    heard.fetch_add(1, Ordering::Relaxed);
                }
                done
            });
        }
        // At a moment of the machine's own choice, once enough went through.
        let patience = Instant::now() + Duration::from_secs(300);
        while heard.load(Ordering::Relaxed) < 10 * (round + 1) {
            assert!(Instant::now() < patience, "no report goes through");
            tokio::time::sleep(Duration::from_millis(1)).await;
        }
        daemon.kill();
        while let Some(done) = workers.join_next().await {
            acknowledged.extend(done.expect("a worker ends"));
        }
    }
    assert!(acknowledged.len() >= 40, "only {} reports went through", acknowledged.len());
    let daemon = Daemon::start(&database);
    let mut client = wire::connect(daemon.url()).await;
    let completed = wire::query(&mut client, &study, "state = COMPLETED AND outcome = OK").await;
    let stored: BTreeSet<String> = completed.into_iter().map(|trial| trial.name).collect();
    let missing: Vec<_> = acknowledged.difference(&stored).collect();
    assert!(
        missing.is_empty(),
        "{} of {} acknowledged reports are gone: {missing:?}",
        missing.len(),
        acknowledged.len()
    );
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
