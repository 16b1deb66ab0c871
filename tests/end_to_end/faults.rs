//! Faults of disk, log and clock under a running daemon: the errors of clients, the service that goes on, and
//! the data afterwards. `docs/durability.md` has the table of these and other faults; `server/store/tests`
//! has locks of other programs, and files that are damaged or replaced.

use std::collections::BTreeSet;
use std::io::Write as _;
use std::time::{Duration, Instant};

use tonic::transport::Channel;
use tonic::{Code, Status};
use treewright_proto::v1 as pb;
use treewright_proto::v1::tuning_service_client::TuningServiceClient;
use treewright_tests::daemon::Daemon;
use treewright_tests::programs::{program, stderr};
use treewright_tests::sandbox::{Clock, SmallDisk, skip};

use crate::locks::beside;
use crate::site::{assert_sound, path_text};
use crate::wire;

/// Longest wait for something that should happen by itself.
const PATIENCE: Duration = Duration::from_secs(60);

/// A client that keeps the acknowledged reports.
pub(crate) struct Book {
    client: TuningServiceClient<Channel>,
    study: String,
    /// The names of the trials whose report was acknowledged, in that order.
    pub(crate) acknowledged: Vec<String>,
}

impl Book {
    pub(crate) async fn open(daemon: &Daemon) -> Self {
        let mut client = wire::connect(daemon.url()).await;
        let study = wire::create(&mut client, "faults").await;
        Self { client, study, acknowledged: Vec::new() }
    }

    async fn frame(&mut self) -> Result<(), Status> {
        let near = (self.acknowledged.len() / 10 % 10) as f64 / 10.0;
        let asked = self.client.suggest(wire::suggestion(&self.study, "one", near)).await?;
        self.client.report(wire::report(asked.get_ref())).await?;
        self.acknowledged.push(asked.into_inner().name);
        Ok(())
    }

    pub(crate) async fn frames(&mut self, count: usize) {
        for _ in 0..count {
            self.frame().await.expect("nothing is wrong yet");
        }
    }

    /// The refusal of a frame, after fewer than `within` that go through.
    async fn refusal(&mut self, within: usize) -> Status {
        for _ in 0..within {
            if let Err(status) = self.frame().await {
                return status;
            }
        }
        panic!("{within} frames went through");
    }

    /// Frames until one goes through again, without anybody's help.
    pub(crate) async fn recovers(&mut self) {
        let begun = Instant::now();
        while let Err(status) = self.frame().await {
            assert!(begun.elapsed() < PATIENCE, "it does not recover: {status}");
            tokio::time::sleep(Duration::from_millis(50)).await;
        }
    }

    /// Reads, and finds everything that was acknowledged.
    pub(crate) async fn reads(&mut self) {
        let request = pb::GetStudyRequest { name: self.study.clone() };
        self.client.get_study(request).await.expect("reads go on");
        let missing = self.missing().await;
        assert!(missing.is_empty(), "acknowledged and not there: {missing:?}");
    }

    async fn missing(&mut self) -> Vec<String> {
        let stored = wire::query(&mut self.client, &self.study, "state = COMPLETED").await;
        let stored: BTreeSet<String> = stored.into_iter().map(|trial| trial.name).collect();
        self.acknowledged.iter().filter(|name| !stored.contains(*name)).cloned().collect()
    }

    pub(crate) async fn reconnect(&mut self, daemon: &Daemon) {
        self.client = wire::connect(daemon.url()).await;
    }
}

fn refused(status: &Status, reason: &str) {
    assert_eq!(status.code(), Code::Unavailable, "{status}");
    assert!(status.message().contains(reason), "{status}");
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_full_disk_stops_writes_and_nothing_else() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let disk = match SmallDisk::mount(folder.path(), "size=16m") {
        Ok(disk) => disk,
        Err(why) => return skip("a full disk", &why),
    };
    let database = folder.path().join("tuning.db");
    let start = || Daemon::start_by(disk.command(program("treewrightd")), &database);
    let daemon = start();
    let mut book = Book::open(&daemon).await;
    book.frames(20).await;

    for _ in 0..2 {
        // All but a little of the disk is taken.
        let ballast = disk.view().join("ballast");
        let mut file = std::fs::File::create(&ballast).expect("a file");
        let mut length = 0u64;
        while file.write_all(&[7; 64 << 10]).is_ok() {
            length += 64 << 10;
        }
        file.set_len(length.saturating_sub(192 << 10)).expect("a shorter file");
        let status = book.refusal(5000).await;
        refused(&status, "full");
        book.reads().await;
        refused(&book.refusal(1).await, "the database cannot be used at the moment");
        drop(file);
        std::fs::remove_file(&ballast).expect("space");
        book.recovers().await;
        book.reads().await;
    }
    daemon.kill();
    let daemon = start();
    book.reconnect(&daemon).await;
    book.reads().await;
    book.frames(5).await;
}

/// The write-ahead log as a power cut may leave it: cut off, garbled, with leftovers behind its end.
#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn of_a_torn_log_everything_up_to_the_tear_is_there() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let database = folder.path().join("tuning.db");
    let daemon = Daemon::start(&database);
    let mut book = Book::open(&daemon).await;
    book.frames(3).await;
    // Ends with everything in the file and no log.
    assert!(daemon.terminate().success());
    let folded = book.acknowledged.len();
    let daemon = Daemon::start(&database);
    book.reconnect(&daemon).await;
    book.frames(25).await;
    daemon.kill();
    let (file, log) = (std::fs::read(&database).expect("a file"), std::fs::read(beside(&database, "-wal")));
    let log = log.expect("a log");
    let header = 32;
    let frame = 24 + 4096;
    assert!(log.len() > header + 30 * frame, "the log holds {} bytes", log.len());
    let all = book.acknowledged.len();

    let garbled = |at: usize| {
        let mut bytes = log.clone();
        bytes[at] ^= 0x10;
        bytes
    };
    let with_leftovers = |leftovers: &[u8]| [&log[..], leftovers].concat();
    let cut = |share: f64| log[..(log.len() as f64 * share) as usize].to_vec();
    // Which log, and which of the acknowledged reports are expected: at least and at most.
    let cases: Vec<(&str, Vec<u8>, usize, usize)> = vec![
        ("whole", log.clone(), all, all),
        ("noise behind the end", with_leftovers(&[0xa5; 3000]), all, all),
        ("an old frame behind the end", with_leftovers(&log[header..header + frame]), all, all),
        ("the last frame cut", log[..log.len() - 100].to_vec(), all - 1, all - 1),
        ("a bit over in the last frame", garbled(log.len() - 50), all - 1, all - 1),
        ("three quarters", cut(0.75), folded, all - 1),
        ("half", cut(0.5), folded, all - 1),
        ("a bit over in the middle", garbled(log.len() / 2), folded, all - 1),
        ("a bit over in the header", garbled(20), folded, folded),
        ("nothing", Vec::new(), folded, folded),
    ];
    let mut before = all;
    for (what, bytes, least, most) in cases {
        let torn = folder.path().join("torn.db");
        std::fs::write(&torn, &file).expect("a copy");
        std::fs::write(beside(&torn, "-wal"), &bytes).expect("a copy");
        let _ = std::fs::remove_file(beside(&torn, "-shm"));
        let daemon = Daemon::start(&torn);
        book.reconnect(&daemon).await;
        let missing = book.missing().await;
        let there = all - missing.len();
        assert!((least..=most).contains(&there), "{what}: {there} of {all}");
        // Nothing is missing before the tear.
        assert_eq!(missing, book.acknowledged[there..], "{what}");
        if what == "half" {
            assert!(there < before, "a shorter log holds less");
        }
        before = there;
        // It goes on, and its file is sound.
        let mut other = Book::open(&daemon).await;
        other.frames(2).await;
        assert!(daemon.terminate().success(), "{what}");
        assert_sound(&torn);
    }
}

#[test]
fn a_disk_that_cannot_be_written_is_named_at_the_start() {
    let folder = tempfile::tempdir().expect("a scratch folder");
    let disk = match SmallDisk::mount(folder.path(), "size=1m,ro") {
        Ok(disk) => disk,
        Err(why) => return skip("a read-only disk", &why),
    };
    let output = disk
        .command(program("treewrightd"))
        .args(["serve", "--listen", "127.0.0.1:0", "--database", path_text(&folder.path().join("tuning.db"))])
        .output()
        .expect("it runs");
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(4), "{said}");
    assert!(said.contains("cannot be written") && said.contains("Read-only"), "{said}");
}

async fn trial(book: &mut Book, client_id: &str) -> pb::Trial {
    let asked = book.client.suggest(wire::suggestion(&book.study, client_id, 0.5)).await;
    asked.expect("a trial").into_inner()
}

async fn state(book: &mut Book, trial: &pb::Trial) -> pb::TrialState {
    let request = pb::GetTrialRequest { name: trial.name.clone() };
    book.client.get_trial(request).await.expect("it is there").into_inner().state()
}

#[tokio::test(flavor = "multi_thread", worker_threads = 2)]
async fn a_clock_that_jumps_ends_no_lease_early_and_lets_none_live_for_ever() {
    const CLIENTS: usize = 8;
    let folder = tempfile::tempdir().expect("a scratch folder");
    let clock = match Clock::new(folder.path()) {
        Ok(clock) => clock,
        Err(why) => return skip("a clock that jumps", &why),
    };
    let database = folder.path().join("tuning.db");
    let start = || Daemon::start_by(clock.command(program("treewrightd")), &database);
    let daemon = start();
    let mut book = Book::open(&daemon).await;

    // Leases of a minute, and a day goes by at once: all are as they were.
    let mut held = Vec::new();
    for number in 0..CLIENTS {
        held.push(trial(&mut book, &format!("client-{number}")).await);
    }
    clock.set("+1d");
    for (number, trial) in held.iter().enumerate() {
        assert_eq!(self::trial(&mut book, &format!("client-{number}")).await.name, trial.name);
        let reported = book.client.report(wire::report(trial)).await.expect("taken").into_inner();
        assert!(!reported.trial.expect("the trial").late, "nothing is late because of the clock");
    }

    // The clock goes back by two days. Leases of two seconds end anyway, in this daemon and in the next.
    let mut short = wire::study();
    short.policy = Some(pb::Policy { lease_s: 2, ..pb::Policy::default() });
    let request = pb::CreateStudyRequest { study_id: "short".into(), study: Some(short) };
    book.study = book.client.create_study(request).await.expect("created").into_inner().name;
    let open = trial(&mut book, "one").await;
    clock.set("-1d");
    expires(&mut book, &open).await;
    let open = trial(&mut book, "two").await;
    daemon.kill();
    let daemon = start();
    book.reconnect(&daemon).await;
    // It is the second lease that the default lost, which is never given up for that.
    expires(&mut book, &open).await;
    assert!(daemon.terminate().success());
}

/// Waits for a trial's lease to end.
async fn expires(book: &mut Book, open: &pb::Trial) {
    let begun = Instant::now();
    while state(book, open).await == pb::TrialState::Open {
        assert!(begun.elapsed() < PATIENCE, "the lease does not end");
        // Any request for the study makes it look at its leases; nothing was measured yet.
        let best = pb::GetBestRequest { study: book.study.clone(), ..Default::default() };
        let nothing = book.client.get_best(best).await.expect_err("nothing to tell");
        assert_eq!(nothing.code(), Code::NotFound, "{nothing}");
        tokio::time::sleep(Duration::from_millis(100)).await;
    }
    assert_eq!(state(book, open).await, pb::TrialState::Expired);
}
