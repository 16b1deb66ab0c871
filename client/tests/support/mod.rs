//! A stand-in for the daemon that runs inside the test. It keeps studies and trials in memory after the rules
//! of the wire contract, and can be made to hang, to lose answers, to refuse, and to be away.
#![allow(dead_code, unreachable_pub)] // each test program uses its own part of it

mod book;
mod service;

use std::net::SocketAddr;
use std::sync::{Arc, Mutex, MutexGuard};
use std::time::Duration;

use tokio::net::TcpSocket;
use tokio::sync::watch;
use treewright_client::{
    Client, Finished, Indicators, Measurements, Options, Outcome, Scale, Source, Space, Study, StudySpec,
    Suggestion,
};

pub use book::Book;

/// Which calls are held back for the time being.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Hold {
    /// None.
    Nothing,
    /// Suggest and the stream; all else is answered.
    Suggestions,
    /// Reports outside the stream.
    Reports,
    /// All, as if the process were stopped.
    Everything,
}

/// The stand-in.
pub struct Fake {
    address: SocketAddr,
    /// Bound but not listening: it reserves the port for this program while the stand-in is away.
    _kept: TcpSocket,
    book: Arc<Mutex<Book>>,
    hold: watch::Sender<Hold>,
    runtime: Option<tokio::runtime::Runtime>,
}

impl Fake {
    /// Starts one on a free port.
    pub fn start() -> Self {
        let mut fake = Self::absent();
        fake.come_back();
        fake
    }

    /// One with a patient client.
    pub fn with_client() -> (Self, Client) {
        let fake = Self::start();
        let client = Client::connect(&fake.url(), patient()).unwrap();
        (fake, client)
    }

    /// One with a patient client and the small study.
    pub async fn with_study() -> (Self, Client, Study) {
        Self::with_study_and(patient()).await
    }

    /// One with the small study and a client of these options.
    pub async fn with_study_and(options: Options) -> (Self, Client, Study) {
        let fake = Self::start();
        let client = Client::connect(&fake.url(), options).unwrap();
        let study = client.study("scene", spec()).await.unwrap();
        (fake, client, study)
    }

    /// One that has a port but does not listen on it yet.
    pub fn absent() -> Self {
        let kept = socket_at("127.0.0.1:0".parse().expect("an address"));
        let address = kept.local_addr().expect("the port is known");
        let hold = watch::Sender::new(Hold::Nothing);
        Self { address, _kept: kept, book: Arc::default(), hold, runtime: None }
    }

    pub fn url(&self) -> String {
        format!("http://{}", self.address)
    }

    /// Its studies and trials, and the faults to make.
    pub fn book(&self) -> MutexGuard<'_, Book> {
        self.book.lock().expect("no test panics inside the book")
    }

    pub fn hold(&self, hold: Hold) {
        self.hold.send_replace(hold);
    }

    /// Breaks every connection, as the end of a process does. Stored studies and trials stay.
    pub fn go_away(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            // Tests call this inside a runtime of their own, where nothing may block but another thread.
            let end = std::thread::spawn(move || runtime.shutdown_timeout(Duration::from_secs(5)));
            end.join().expect("the stand-in ends");
        }
    }

    /// Starts it again on its port.
    pub fn come_back(&mut self) {
        let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build();
        let runtime = runtime.expect("a runtime for the stand-in");
        let listener = {
            let _within = runtime.enter();
            socket_at(self.address).listen(1024).expect("it can be listened on")
        };
        let service = service::Service { book: Arc::clone(&self.book), hold: self.hold.clone() };
        runtime.spawn(service.serve(listener));
        self.runtime = Some(runtime);
    }
}

/// A socket on a port that only sockets of this process may share.
fn socket_at(address: SocketAddr) -> TcpSocket {
    let socket = TcpSocket::new_v4().expect("a socket");
    socket.set_reuseport(true).expect("a port can be shared");
    socket.bind(address).expect("a free port");
    socket
}

impl Drop for Fake {
    fn drop(&mut self) {
        if let Some(runtime) = self.runtime.take() {
            runtime.shutdown_background();
        }
    }
}

/// Settings with which nothing but a hanging daemon runs into a deadline, however busy the machine is.
pub fn patient() -> Options {
    let (back_off_min, back_off_max) = (Duration::from_millis(5), Duration::from_millis(40));
    let options = Options::new().client_id("tester").deadline(Duration::from_secs(20));
    Options { back_off_min, back_off_max, ..options }
}

/// Settings with which a hanging daemon is noticed at once.
pub fn hasty() -> Options {
    patient().deadline(Duration::from_millis(30)).call_deadline(Duration::from_millis(200))
}

/// A small study.
pub fn spec() -> StudySpec {
    let space = Space::builder().integer("max_depth", 9..=1000).default(32).log();
    let space = space.boolean("compact").default(false).build().expect("a valid space");
    let spec =
        StudySpec::builder(space).display_name("a scene").indicator("triangles", 0.0..=1e6, Scale::Log);
    spec.minimise("render_ms", 1.0).build().expect("a valid specification")
}

/// That study with trials of several frames.
pub fn in_episodes(frames: u32) -> StudySpec {
    let spec = spec();
    let objective = spec.objective.clone().with_episode_frames(frames).expect("a number of frames");
    StudySpec { objective, ..spec }
}

/// A state of that study; different numbers are far apart.
pub fn state(number: u32) -> Indicators {
    Indicators::from([("triangles", 10f64.powi(i32::try_from(number).expect("a small number")))])
}

pub fn measured(render_ms: f64) -> Measurements {
    Measurements::from([("render_ms", render_ms)])
}

/// The result of a frame, for the next one.
pub fn finish(suggestion: Suggestion, render_ms: f64) -> Option<Finished> {
    Some(suggestion.finished(measured(render_ms), Outcome::Ok).unwrap())
}

/// Asks until the daemon answers.
pub async fn from_the_daemon(mut ask: impl AsyncFnMut() -> Suggestion) -> Suggestion {
    loop {
        let suggestion = ask().await;
        if suggestion.source() == Source::Daemon {
            return suggestion;
        }
        tokio::time::sleep(Duration::from_millis(2)).await;
    }
}

/// Waits for something that must happen, without saying when.
pub async fn until(what: &str, holds: impl Fn() -> bool) {
    let patience = tokio::time::timeout(Duration::from_secs(30), async {
        while !holds() {
            tokio::time::sleep(Duration::from_millis(2)).await;
        }
    });
    assert!(patience.await.is_ok(), "it never happened: {what}");
}
