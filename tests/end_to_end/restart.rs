//! Ends of the daemon, polite and not. After `kill -9` in mid-run the search goes on where it stood, and a
//! repeated report changes nothing.

use std::collections::BTreeSet;
use std::time::Duration;

use treewright_client::{Client, Indicators, Options, Outcome, Policy, Space, StudySpec};
use treewright_proto::v1 as pb;
use treewright_tests::daemon::Daemon;

use crate::site::Site;
use crate::wire;

const TRIALS: usize = 40;

/// The configurations that one client is handed over a whole search, the daemon being killed before
/// each of the given trials: after it was reported, or while it is out.
async fn configurations(kill_before: &[usize], kill_while_open: &[usize]) -> Vec<String> {
    let mut site = Site::new();
    let mut client = wire::connect(site.url()).await;
    let study = wire::create(&mut client, "restart").await;
    let mut seen = Vec::new();
    for number in 0..TRIALS {
        if kill_before.contains(&number) {
            site = site.killed();
            client = wire::connect(site.url()).await;
        }
        let mut trial =
            client.suggest(wire::suggestion(&study, "one", 0.5)).await.expect("a trial").into_inner();
        if kill_while_open.contains(&number) {
            site = site.killed();
            client = wire::connect(site.url()).await;
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
    let site = Site::new();
    let mut client = wire::connect(site.url()).await;
    let study = wire::create(&mut client, "repeat").await;
    let trial = client.suggest(wire::suggestion(&study, "one", 0.1)).await.expect("a trial").into_inner();
    let first = client.report(wire::report(&trial)).await.expect("taken").into_inner();
    assert!(!first.duplicate);

    let site = site.killed();
    let mut client = wire::connect(site.url()).await;
    let mut other = wire::report(&trial);
    other.measurements.insert("render_ms".into(), 1.0);
    let second = client.report(other).await.expect("taken").into_inner();
    assert!(second.duplicate);
    assert_eq!(second.trial, first.trial, "the first report stands");
    let request = pb::GetStudyRequest { name: study };
    let statistics = client.get_study(request).await.expect("it is there").into_inner().statistics;
    assert_eq!(statistics.map(|counts| (counts.trials, counts.completed_trials)), Some((1, 1)));
}

// A second thread lets the client see the daemon's goodbye while this one waits for its end.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn sigterm_ends_it_politely_and_the_database_stays_whole() {
    let site = Site::new();
    let database = site.database();
    let mut client = wire::connect(site.url()).await;
    let study = wire::create(&mut client, "polite").await;
    let trial = client.suggest(wire::suggestion(&study, "one", 0.5)).await.expect("a trial").into_inner();
    client.report(wire::report(&trial)).await.expect("taken");
    // A stream left open must not hold up the end.
    let (_open, requests) = tokio::sync::mpsc::channel::<pb::TuneRequest>(1);
    let stream = client.tune(tokio_stream::wrappers::ReceiverStream::new(requests)).await;
    assert!(stream.is_ok());
    assert!(site.daemon.terminate().success(), "SIGTERM is a normal end");

    let daemon = Daemon::start(&database);
    let mut client = wire::connect(daemon.url()).await;
    assert_eq!(wire::query(&mut client, &study, "state = COMPLETED").await.len(), 1);
}

/// A client, and a study whose trials have four frames.
fn of_four_frames(url: &str, lease_s: u32) -> (Client, StudySpec) {
    let options = Options::new().client_id("renderer").deadline(Duration::from_secs(20));
    let space = Space::builder().integer("leaf", 1..=32).default(8).build().expect("a space");
    let spec = StudySpec::builder(space).minimise("render_ms", 1.0).episode_frames(4);
    let spec = spec.policy(Policy::new().lease_s(lease_s)).build().expect("a specification");
    (Client::connect(url, options).expect("a good address"), spec)
}

#[tokio::test]
async fn a_frame_loop_ends_its_trial_of_several_frames_while_the_daemon_is_away() {
    let Site { daemon, folder } = Site::new();
    let address = daemon.address().to_owned();
    let (client, spec) = of_four_frames(daemon.url(), 60);
    let mut tuner = client.study("episodes", spec).await.expect("a study").tuner();
    let (mut daemon, mut previous, mut trials) = (Some(daemon), None, BTreeSet::new());
    for frame in 0..4 {
        if let Some(running) = daemon.take_if(|_| frame == 2) {
            running.kill();
        }
        let suggestion = tuner.next(&Indicators::new(), previous.take()).await;
        trials.insert(suggestion.trial().expect("no frame is a fallback").to_owned());
        let measured = [("render_ms", f64::from(1 + frame))].into();
        previous = Some(suggestion.finished(measured, Outcome::Ok).expect("measured"));
    }
    assert_eq!(trials.len(), 1, "{trials:?}");
    drop(previous);
    let daemon = Daemon::start_at(&folder.path().join("tuning.db"), &address);
    client.flush(Duration::from_secs(60)).await.expect("the report arrives");
    let mut reader = wire::connect(daemon.url()).await;
    let stored = wire::query(&mut reader, "studies/episodes", "state = COMPLETED").await;
    assert_eq!(stored.len(), 1);
    assert_eq!((stored[0].measurements.get("render_ms"), stored[0].cost), (Some(&2.5), Some(2.5)));
}

#[tokio::test]
async fn a_trial_of_several_frames_may_last_longer_than_its_lease() {
    let site = Site::new();
    let (client, spec) = of_four_frames(site.url(), 3);
    let mut tuner = client.study("episodes", spec).await.expect("a study").tuner();
    let mut previous = None;
    for _frame in 0..4 {
        let suggestion = tuner.next(&Indicators::new(), previous.take()).await;
        tokio::time::sleep(Duration::from_millis(1200)).await;
        let measured = [("render_ms", 1200.0)].into();
        previous = Some(suggestion.finished(measured, Outcome::Ok).expect("measured"));
    }
    drop(previous);
    client.flush(Duration::from_secs(60)).await.expect("the report arrives");
    let mut reader = wire::connect(site.url()).await;
    let stored = wire::query(&mut reader, "studies/episodes", "state = COMPLETED").await;
    assert_eq!(stored.iter().map(|trial| trial.late).collect::<Vec<_>>(), [false]);
}
