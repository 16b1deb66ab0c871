//! SQLite's locks on the database. The daemon holds them as long as it runs, during every request, so that
//! other programs can read the file beside it. They belong to the process, and the system drops them all when
//! the process closes any descriptor of the file. So only SQLite may open the file in the daemon.

use std::collections::BTreeMap;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use prost_types::FieldMask;
use tonic::transport::Channel;
use treewright_proto::v1 as pb;
use treewright_tests::daemon::Daemon;
use treewright_tests::ports::lasting_address;
use treewright_tests::programs::{run, stderr, token};

use crate::dashboard::get;
use crate::guard::{self, Caller, in_force};
use crate::site::{Site, path_text};
use crate::wire;

/// Bytes of which SQLite keeps a shared lock in the database while it is open in the mode of a write-ahead
/// log, and in the file of shared memory beside it (`SHARED_FIRST` and `UNIX_SHM_DMS` of its `os_unix.c`).
const SHARED: [(&str, u64); 2] = [("", 0x4000_0002), ("-shm", 128)];

/// Which of SQLite's locks the daemon lacks.
fn missing_locks(daemon: &Daemon, database: &Path) -> Vec<String> {
    let locks = std::fs::read_to_string("/proc/locks").expect("Linux lists them");
    let is_held = |(suffix, first): &(&str, u64)| {
        let inode = std::fs::metadata(beside(database, suffix)).map_or(0, |file| file.ino());
        locks.lines().any(|line| {
            let words: Vec<&str> = line.split_whitespace().collect();
            let [_, "POSIX", _, "READ", process, file, begin, ..] = words[..] else { return false };
            process == daemon.id().to_string()
                && file.ends_with(&format!(":{inode}"))
                && begin == first.to_string()
        })
    };
    SHARED.iter().filter(|lock| !is_held(lock)).map(|(suffix, _)| format!("tuning.db{suffix}")).collect()
}

/// A file that SQLite keeps beside a database.
pub(crate) fn beside(database: &Path, suffix: &str) -> PathBuf {
    PathBuf::from(format!("{}{suffix}", database.display()))
}

/// No lock is missing after this step. The kernel lists locks page by page, so a held lock can be left out
/// while others come and go; a lock that was given up stays missing.
fn held(daemon: &Daemon, database: &Path, after: &str) {
    let mut missing = missing_locks(daemon, database);
    for _ in 0..20 {
        if missing.is_empty() {
            break;
        }
        std::thread::sleep(Duration::from_millis(50));
        missing = missing_locks(daemon, database);
    }
    assert!(missing.is_empty(), "after {after} the daemon has no lock on {missing:?}");
}

async fn caller(url: &str, token: Option<&str>) -> Caller {
    let url = url.split(',').next().expect("an address").to_owned();
    let channel = Channel::from_shared(url).expect("an address").connect().await.expect("it answers");
    guard::caller(channel, token)
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_option_costs_the_daemon_its_locks() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let socket = folder.path().join("daemon.sock");
    let (metrics, dashboard) = (lasting_address(), lasting_address());
    let socket = socket.to_str().expect("plain");
    let everything = ["--tokens", "--keep-trials", "20000", "--metrics", &metrics, "--dashboard", &dashboard];
    let more = ["--socket", socket, "--idle-exit-s", "600", "--otlp", "http://127.0.0.1:9"];
    let everything = [&everything[..], &more].concat();
    let options: [&[&str]; 3] = [&[], &everything, &["--socket-only", "--socket", socket]];
    let log = folder.path().join("log");
    for (number, options) in options.iter().enumerate() {
        let database = folder.path().join(format!("{number}.db"));
        // A new file, and one that is there.
        for _ in 0..2 {
            let daemon = Daemon::start_with(&database, options, &log);
            held(&daemon, &database, &format!("a start with {options:?}"));
            assert!(daemon.terminate().success());
        }
    }
}

/// Makes every request of the contract once, and correctly.
async fn ask_everything(mut client: Caller, mut asked: impl FnMut(&str)) {
    let create = |id: &str| pb::CreateStudyRequest { study_id: id.into(), study: Some(wire::study()) };
    let study = client.create_study(create("first")).await.expect("created").into_inner();
    asked("CreateStudy");
    let name = study.name.clone();
    client.get_study(pb::GetStudyRequest { name: name.clone() }).await.expect("there");
    asked("GetStudy");
    client.list_studies(pb::ListStudiesRequest::default()).await.expect("listed");
    asked("ListStudies");
    let mut changed = study;
    changed.policy = Some(pb::Policy { epsilon: Some(0.5), ..Default::default() });
    let update_mask = Some(FieldMask { paths: vec!["policy.epsilon".into()] });
    let update = pb::UpdateStudyRequest { study: Some(changed), update_mask };
    client.update_study(update).await.expect("changed");
    asked("UpdateStudy");
    let trial = client.suggest(wire::suggestion(&name, "one", 0.5)).await.expect("a trial").into_inner();
    asked("Suggest");
    client.extend_lease(pb::ExtendLeaseRequest { trial: trial.name.clone() }).await.expect("extended");
    asked("ExtendLease");
    client.report(wire::report(&trial)).await.expect("reported");
    asked("Report");
    let other = client.suggest(wire::suggestion(&name, "one", 0.5)).await.expect("a trial").into_inner();
    client.abandon_trial(pb::AbandonTrialRequest { trial: other.name }).await.expect("abandoned");
    asked("AbandonTrial");
    client.get_trial(pb::GetTrialRequest { name: trial.name }).await.expect("there");
    asked("GetTrial");
    let query = pb::QueryTrialsRequest { study: name.clone(), ..Default::default() };
    client.query_trials(query).await.expect("found");
    asked("QueryTrials");
    let indicators = BTreeMap::from([("near".to_owned(), 0.5), ("far".to_owned(), 0.5)]);
    let predict = pb::PredictRequest { study: name.clone(), indicators, ..Default::default() };
    client.predict(predict).await.expect("predicted");
    asked("Predict");
    client
        .get_best(pb::GetBestRequest { study: name.clone(), ..Default::default() })
        .await
        .expect("the best");
    asked("GetBest");
    let frame = pb::TuneRequest { report: None, suggest: Some(wire::suggestion(&name, "two", 0.5)) };
    let mut answers = client.tune(tokio_stream::iter([frame])).await.expect("a stream").into_inner();
    answers.message().await.expect("an answer").expect("a frame");
    asked("Tune");
    drop(answers);
    client.delete_study(pb::DeleteStudyRequest { name }).await.expect("deleted");
    asked("DeleteStudy");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn no_request_costs_the_daemon_its_locks() {
    let (metrics, dashboard) = (lasting_address(), lasting_address());
    let options = ["--tokens", "--keep-trials", "20000", "--metrics", &metrics, "--dashboard", &dashboard];
    let site = Site::with(&options);
    let (daemon, database) = (&site.daemon, site.database());
    held(daemon, &database, "the start");
    let admin = token(&database, &["--scope", "admin"]);
    held(daemon, &database, "token create");
    let mut owner = caller(daemon.url(), Some(&admin)).await;
    in_force(&mut owner).await;
    held(daemon, &database, "a token that came into force");

    ask_everything(caller(daemon.url(), Some(&admin)).await, |what| held(daemon, &database, what)).await;
    caller(daemon.url(), Some("nonsense"))
        .await
        .list_studies(pb::ListStudiesRequest::default())
        .await
        .expect_err("no");
    held(daemon, &database, "a wrong token");
    for page in ["/metrics", "/livez", "/readyz", "/none"] {
        get(&metrics, page, "");
        held(daemon, &database, page);
    }
    let cookie = format!("Cookie: treewright_token={admin}\r\n");
    for page in ["/", "/login", "/style.css", "/studies/first", "/none"] {
        get(&dashboard, page, &cookie);
        held(daemon, &database, page);
    }

    let copy = site.path("copy.db");
    let (text, copy) = (path_text(&database), copy.as_str());
    let id = admin.split('_').nth(1).expect("an id");
    let commands: [(&[&str], i32); 9] = [
        (&["token", "list", "--database", text], 0),
        (&["backup", "--database", text, "--to", copy], 0),
        (&["backup", "--database", text, "--to", copy], 1),
        (&["check", "--database", text], 0),
        (&["check", "--database", copy], 0),
        (&["restore", "--from", copy, "--database", text], 4),
        (&["serve", "--listen", "127.0.0.1:0", "--database", text], 4),
        (&["token", "revoke", "--database", text, id], 0),
        (&["token", "revoke", "--forget", "--database", text, id], 0),
    ];
    for (command, code) in commands {
        let ran = run("treewrightd", command);
        assert_eq!(ran.status.code(), Some(code), "{command:?}: {}", stderr(&ran));
        held(daemon, &database, &format!("{command:?}"));
    }
    for signal in ["HUP", "HUP"] {
        daemon.signal(signal);
        tokio::time::sleep(Duration::from_millis(100)).await;
        held(daemon, &database, "SIGHUP");
    }
    assert!(site.daemon.terminate().success());
}
