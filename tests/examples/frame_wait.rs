//! How long a renderer's frame waits for its tuner: the calling thread's time in the loop that asks and waits
//! (`Study::tuner`) and in the one that asked a frame ago (`Study::prefetching_tuner`), at 30 and 500 frames
//! a second, with a daemon that is well, slow (stopped for 40 of every 100 ms), stopped, and killed.
//!
//! `cargo run --release -p treewright-tests --example frame_wait -- [SECONDS]` (10 seconds a row by default).
//! Prints a table in Markdown. "Frames with a trial" are those that ran the daemon's suggestion; the others
//! ran a fallback.

use std::time::{Duration, Instant};

use treewright_client::blocking::{Client, PrefetchingTuner, Study, Tuner};
use treewright_client::{
    Finished, Indicators, Measurements, Options, Outcome, Scale, Source, Space, StudySpec, Suggestion,
};
use treewright_tests::daemon::Daemon;

/// The daemon's trouble while frames run.
#[derive(Clone, Copy)]
enum Trouble {
    Well,
    Slow,
    Stopped,
    Killed,
}

enum Loop {
    Waiting(Tuner),
    Prefetching(PrefetchingTuner),
}

impl Loop {
    fn next(&mut self, indicators: &Indicators, previous: Option<Finished>) -> Suggestion {
        match self {
            Loop::Waiting(tuner) => tuner.next(indicators, previous),
            Loop::Prefetching(tuner) => tuner.next(indicators, previous),
        }
    }
}

fn spec() -> StudySpec {
    let space = Space::builder().float("cost", 0.1..=10.0).default(1.0).integer("leaf", 1..=32).default(8);
    let spec =
        StudySpec::builder(space.build().expect("a space")).indicator("triangles", 1.0..=1e7, Scale::Log);
    spec.minimise("render_ms", 1.0).build().expect("a study")
}

/// Frames at a steady rate. Returns the waits in microseconds, and how many frames had a trial.
fn frames(mut tuner: Loop, every: Duration, time: Duration) -> (Vec<f64>, usize) {
    let indicators = Indicators::from([("triangles", 1e5)]);
    let (mut previous, mut waits_us, mut with_trial) = (None, Vec::new(), 0);
    let begin = Instant::now();
    let mut due = begin;
    while begin.elapsed() < time {
        let asked = Instant::now();
        let suggestion = tuner.next(&indicators, previous.take());
        waits_us.push(asked.elapsed().as_secs_f64() * 1e6);
        with_trial += usize::from(suggestion.source() == Source::Daemon);
        due = (due + every).max(Instant::now());
        std::thread::sleep(due - Instant::now());
        let measured = Measurements::from([("render_ms", every.as_secs_f64() * 1e3)]);
        previous = Some(suggestion.finished(measured, Outcome::Ok).expect("a result"));
    }
    (waits_us, with_trial)
}

/// Stops and continues the daemon while `frames` run.
fn troubled<T>(daemon: Daemon, trouble: Trouble, frames: impl FnOnce() -> T) -> T {
    let (end, ended) = std::sync::mpsc::channel::<()>();
    let troubles = std::thread::spawn(move || {
        let wait = |ms| {
            ended
                .recv_timeout(Duration::from_millis(ms))
                .is_err_and(|error| error == std::sync::mpsc::RecvTimeoutError::Timeout)
        };
        // The first second is well, so that every loop has a suggestion.
        if !wait(1000) {
            return;
        }
        match trouble {
            Trouble::Well => while wait(1000) {},
            Trouble::Slow => {
                while wait(60) {
                    daemon.signal("STOP");
                    wait(40);
                    daemon.signal("CONT");
                }
            }
            Trouble::Stopped => {
                daemon.signal("STOP");
                while wait(1000) {}
                daemon.signal("CONT");
            }
            Trouble::Killed => daemon.kill(),
        }
    });
    let result = frames();
    drop(end);
    troubles.join().expect("the daemon was troubled");
    result
}

fn row(name: &str, make: impl Fn(&Study) -> Loop, every: Duration, trouble: (&str, Trouble), time: Duration) {
    let folder = tempfile::tempdir().expect("a folder");
    let daemon = Daemon::start(&folder.path().join("waits.db"));
    let client = Client::connect(daemon.url(), Options::new().client_id("renderer")).expect("a client");
    let study = client.study("waits", spec()).expect("a study");
    let tuner = make(&study);
    let (mut waits_us, with_trial) = troubled(daemon, trouble.1, move || frames(tuner, every, time));
    waits_us.sort_by(f64::total_cmp);
    let at = |share: f64| waits_us[((waits_us.len() - 1) as f64 * share).round() as usize];
    println!(
        "| {name} | {} | {} | {:.0} | {:.0} | {:.0} | {:.1} % of {} |",
        (1.0 / every.as_secs_f64()).round(),
        trouble.0,
        at(0.5),
        at(0.99),
        at(1.0),
        100.0 * with_trial as f64 / waits_us.len() as f64,
        waits_us.len(),
    );
}

fn main() {
    let seconds = std::env::args().nth(1).map_or(10.0, |text| text.parse().expect("SECONDS is a number"));
    let time = Duration::from_secs_f64(seconds);
    let troubles = [
        ("well", Trouble::Well),
        ("slow", Trouble::Slow),
        ("stopped", Trouble::Stopped),
        ("killed", Trouble::Killed),
    ];
    println!(
        "| loop | frames/s | daemon | wait p50, µs | p99, µs | max, µs | frames with a trial |\n|---|---|---|---|---|---|---|"
    );
    for rate in [30.0, 500.0] {
        let every = Duration::from_secs_f64(1.0 / rate);
        for trouble in troubles {
            row("waiting", |study| Loop::Waiting(study.tuner()), every, trouble, time);
            let prefetching = |study: &Study| Loop::Prefetching(study.prefetching_tuner());
            row("prefetching", prefetching, every, trouble, time);
        }
    }
}
