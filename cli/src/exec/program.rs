//! One run of the tuned program: start it under a supervisor, wait, and return its cost or its failure.
//!
//! The result counts as soon as the program has ended. Another process that still holds its output open, such
//! as a helper in a session of its own, is not waited for.

use std::cell::Cell;
use std::collections::{BTreeSet, VecDeque};
use std::io::{Read, Write as _};
use std::net::Shutdown;
use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::os::unix::net::UnixStream;
use std::process::{ChildStderr, ChildStdout, ExitStatus, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use nix::poll::{PollFd, PollFlags, PollTimeout, poll};
use treewright_cli::printed::{self, LeftOut, Printed, Wanted};
use treewright_client::{Configuration, Measurements, StudySpec};

use super::supervisor::{self, Fate};
use crate::progress;

/// Bytes that are kept of each stream that the program writes to; the beginning is dropped.
const KEPT_BYTES: usize = 64 << 10;
const READ_BYTES: usize = 64 << 10;
/// Interval at which a running program is checked against its limits. Its end is noticed at once.
const LOOK: Duration = Duration::from_millis(100);
/// Longest time for reading the rest of a program's output while another process goes on writing there.
const DRAIN: Duration = Duration::from_millis(250);
/// Longest wait for a program that was killed. One that hangs in a device can take for ever.
const KILLED: Duration = Duration::from_secs(5);
/// Prefix of a parameter's name in the program's environment.
const VARIABLE: &str = "TREEWRIGHT_PARAM_";
/// The level of a run in the program's environment.
const LEVEL: &str = "TREEWRIGHT_FIDELITY";

/// Which numbers count.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum MetricSource {
    /// `wall_ms` and `cpu_ms`, which are always taken.
    Time,
    /// Also every number of the last JSON object that the program prints.
    Json,
}

/// The settings of runs.
#[derive(Debug)]
pub(crate) struct Runner<'a> {
    pub(crate) metric: MetricSource,
    /// The metrics that every run has to measure.
    pub(crate) wanted: Wanted<'a>,
    /// Exit codes besides 0 with which a run counts.
    pub(crate) accepted: &'a [i32],
    /// Pass on what the program writes.
    pub(crate) show_output: bool,
    /// A program that takes longer is ended, and cannot be used so.
    pub(crate) limit: Option<Duration>,
    /// Somebody wants everything to end.
    pub(crate) stop: &'a AtomicBool,
    /// The program prints a `wall_ms` of its own, which counts; `None` before a run has shown that.
    pub(crate) prints_time: Cell<Option<bool>>,
}

/// The end of a run.
#[derive(Debug, PartialEq)]
pub(crate) enum Run {
    /// It did its work.
    Done(Measurements, Vec<LeftOut>),
    /// The configuration cannot be used: the program says so, or it takes longer than it may.
    Infeasible(String),
    /// It ended badly or without a result. That may be the configuration's fault, or chance.
    Failed {
        /// How it ended, with its last words.
        reason: String,
        /// The end of its standard error.
        said: String,
    },
    /// It took longer than was worth waiting for: its time in milliseconds.
    TooSlow(f64),
    /// Somebody wants everything to end.
    Stopped,
}

impl Runner<'_> {
    /// Runs a command, at a level where the study has several. `abort_after` ends it early; `alive` is called
    /// now and then while it runs, and must not wait.
    pub(crate) fn run(
        &self,
        command: &[String],
        configuration: &Configuration,
        level: Option<&str>,
        abort_after: Option<Duration>,
        alive: impl FnMut(),
    ) -> Result<Run, std::io::Error> {
        let Some((program, arguments)) = command.split_first() else {
            return Err(std::io::Error::new(std::io::ErrorKind::InvalidInput, "the command is empty"));
        };
        let variables =
            configuration.iter().map(|(name, value)| (variable(VARIABLE, name), value.to_string()));
        let variables = variables.chain(level.map(|level| (LEVEL.to_owned(), level.to_owned())));
        let (socket, theirs) = UnixStream::pair()?;
        let mut started = supervisor::command(program, arguments)?
            .envs(variables)
            .stdin(OwnedFd::from(theirs))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()?;
        let mut supervised = Supervised {
            out: started.stdout.take().map(Tail::of),
            err: started.stderr.take().map(Tail::of),
            socket,
            received: Vec::new(),
            is_over: false,
            show_output: self.show_output,
        };
        let cut = self.watch(&mut supervised, abort_after, alive)?;
        let fate = supervised.fate();
        if supervised.is_over {
            started.wait()?;
        }
        supervised.drain()?;
        let said = supervised.err.map(Tail::text).unwrap_or_default();
        let (status, wall_ms, cpu_ms) = match fate {
            Some(Fate::Ended { status, wall_ms, cpu_ms }) => (Fate::status(status), wall_ms, cpu_ms),
            Some(Fate::NotStarted(number)) => {
                return Err(number
                    .map_or_else(|| std::io::ErrorKind::Other.into(), std::io::Error::from_raw_os_error));
            }
            None => {
                let reason = "it was ended from outside, together with what supervises it".to_owned();
                return Ok(cut.map_or(Run::Failed { reason, said }, |cut| cut.run(None)));
            }
        };
        Ok(match cut {
            Some(cut) => cut.run(Some(wall_ms)),
            None if self.stop.load(Ordering::Relaxed) => Run::Stopped,
            None => {
                let taken = Measurements::from([("wall_ms", wall_ms), ("cpu_ms", cpu_ms)]);
                self.result(status, &taken, &supervised.out.map(Tail::lines).unwrap_or_default(), said)
            }
        })
    }

    /// Waits until the program has ended. Returns the reason if it was ended before its time.
    fn watch(
        &self,
        supervised: &mut Supervised,
        abort_after: Option<Duration>,
        mut alive: impl FnMut(),
    ) -> Result<Option<Cut>, std::io::Error> {
        let begin = Instant::now();
        let mut looked = begin;
        let mut cut: Option<(Cut, Instant)> = None;
        while !supervised.is_over {
            supervised.read(LOOK)?;
            match &cut {
                Some((_, since)) if since.elapsed() > KILLED => break,
                Some(_) => {}
                None if looked.elapsed() < LOOK => {}
                None => {
                    looked = Instant::now();
                    alive();
                    cut = self.reason_to_end(begin.elapsed(), abort_after).map(|cut| (cut, Instant::now()));
                    if cut.is_some() {
                        // It may have ended by itself just now.
                        let _ = supervised.socket.shutdown(Shutdown::Write);
                    }
                }
            }
        }
        Ok(cut.map(|(cut, _)| cut))
    }

    fn reason_to_end(&self, elapsed: Duration, abort_after: Option<Duration>) -> Option<Cut> {
        if self.stop.load(Ordering::Relaxed) {
            return Some(Cut::Stop);
        }
        match self.limit {
            Some(limit) if elapsed > limit => Some(Cut::Limit(limit)),
            _ => abort_after.filter(|&after| elapsed > after).map(Cut::Slow),
        }
    }

    fn result(&self, status: ExitStatus, taken: &Measurements, out: &str, said: String) -> Run {
        let is_accepted = status.success() || status.code().is_some_and(|code| self.accepted.contains(&code));
        let printed = match self.metric {
            MetricSource::Time => printed::read("{}", self.wanted, taken),
            MetricSource::Json => printed::read(out, self.wanted, taken),
        };
        match printed {
            Printed::Infeasible(reason) => Run::Infeasible(reason),
            _ if !is_accepted => {
                let last = said.lines().rev().find(|line| !line.trim().is_empty()).unwrap_or_default();
                let reason = if last.is_empty() { status.to_string() } else { format!("{status}: {last}") };
                Run::Failed { reason, said }
            }
            Printed::NoResult(reason) => Run::Failed { reason, said },
            Printed::Measured { measurements, left_out } => {
                self.prints_time.set(Some(measurements.get("wall_ms") != taken.get("wall_ms")));
                Run::Done(measurements, left_out)
            }
        }
    }
}

/// Why a program is ended before its time.
enum Cut {
    Stop,
    /// It took longer than this, which is more than is worth waiting for.
    Slow(Duration),
    Limit(Duration),
}

impl Cut {
    /// The outcome of the run, whose `wall_ms` is known once it has ended.
    fn run(self, wall_ms: Option<f64>) -> Run {
        match self {
            Self::Stop => Run::Stopped,
            Self::Slow(after) => Run::TooSlow(wall_ms.unwrap_or(after.as_secs_f64() * 1e3)),
            Self::Limit(limit) => {
                Run::Infeasible(format!("it took longer than {}", humantime::format_duration(limit)))
            }
        }
    }
}

/// The outputs of a program and of its supervisor.
struct Supervised {
    out: Option<Tail<ChildStdout>>,
    err: Option<Tail<ChildStderr>>,
    socket: UnixStream,
    /// The supervisor's output so far.
    received: Vec<u8>,
    /// It says no more.
    is_over: bool,
    show_output: bool,
}

impl Supervised {
    /// Reads the available output once, and waits for some for at most `wait`. Returns whether there was any.
    fn read(&mut self, wait: Duration) -> Result<bool, std::io::Error> {
        let sources = [
            self.out.as_ref().and_then(Tail::source),
            self.err.as_ref().and_then(Tail::source),
            (!self.is_over).then(|| self.socket.as_fd()),
        ];
        let ready = ready(sources, wait)?;
        if let Some(out) = self.out.as_mut().filter(|_| ready[0]) {
            out.read(self.show_output);
        }
        if let Some(err) = self.err.as_mut().filter(|_| ready[1]) {
            err.read(self.show_output);
        }
        if ready[2] {
            let mut some = [0; 256];
            match self.socket.read(&mut some) {
                Ok(bytes) if bytes > 0 => self.received.extend(&some[..bytes]),
                Err(problem) if problem.kind() == std::io::ErrorKind::Interrupted => {}
                _ => self.is_over = true,
            }
        }
        Ok(ready.contains(&true))
    }

    /// The program's end; `None` where the supervisor died before it could report one.
    fn fate(&self) -> Option<Fate> {
        serde_json::from_slice(&self.received).ok()
    }

    /// Reads what the program wrote before it ended.
    fn drain(&mut self) -> Result<(), std::io::Error> {
        let begin = Instant::now();
        self.is_over = true;
        while begin.elapsed() < DRAIN && self.read(Duration::ZERO)? {}
        Ok(())
    }
}

/// Which of the sources can be read, after at most `wait`.
fn ready(sources: [Option<BorrowedFd>; 3], wait: Duration) -> Result<[bool; 3], std::io::Error> {
    let open: Vec<_> =
        sources.iter().enumerate().filter_map(|(place, source)| Some((place, (*source)?))).collect();
    let mut polled: Vec<_> = open.iter().map(|(_, source)| PollFd::new(*source, PollFlags::POLLIN)).collect();
    let mut ready = [false; 3];
    match poll(&mut polled, PollTimeout::try_from(wait).unwrap_or(PollTimeout::ZERO)) {
        // A signal came; the caller looks again.
        Err(nix::errno::Errno::EINTR) => return Ok(ready),
        result => result?,
    };
    for ((place, _), polled) in open.iter().zip(&polled) {
        ready[*place] = polled.any().unwrap_or(true);
    }
    Ok(ready)
}

/// The last of what comes from a source.
struct Tail<R> {
    /// Absent once it is at its end.
    source: Option<R>,
    kept: VecDeque<u8>,
    /// The beginning was dropped.
    is_cut: bool,
}

impl<R: Read + AsFd> Tail<R> {
    fn of(source: R) -> Self {
        Self { source: Some(source), kept: VecDeque::new(), is_cut: false }
    }

    fn source(&self) -> Option<BorrowedFd<'_>> {
        self.source.as_ref().map(AsFd::as_fd)
    }

    /// Reads the available output. An error is taken for the end.
    fn read(&mut self, show: bool) {
        let Some(source) = &mut self.source else { return };
        let mut some = [0; READ_BYTES];
        match source.read(&mut some) {
            Err(problem) if problem.kind() == std::io::ErrorKind::Interrupted => {}
            Ok(bytes) if bytes > 0 => {
                if show {
                    // Nobody may be looking.
                    let _ = std::io::stderr().write_all(&some[..bytes]);
                }
                self.keep(&some[..bytes]);
            }
            _ => self.source = None,
        }
    }

    fn keep(&mut self, more: &[u8]) {
        self.kept.extend(more);
        let surplus = self.kept.len().saturating_sub(KEPT_BYTES);
        self.is_cut |= surplus > 0;
        self.kept.drain(..surplus);
    }

    fn text(self) -> String {
        String::from_utf8_lossy(&Vec::from(self.kept)).into_owned()
    }

    /// The text without a line whose beginning was dropped: its rest may look like something else.
    fn lines(self) -> String {
        let is_cut = self.is_cut;
        let text = self.text();
        match text.split_once('\n') {
            _ if !is_cut => text,
            Some((_, rest)) => rest.to_owned(),
            None => String::new(),
        }
    }
}

pub(crate) fn variable(prefix: &str, parameter: &str) -> String {
    let plain = |each: char| if each.is_ascii_alphanumeric() { each.to_ascii_uppercase() } else { '_' };
    format!("{prefix}{}", parameter.chars().map(plain).collect::<String>())
}

/// Says where two parameters have one variable in the program's environment, of which the later remains.
pub(super) fn note_same_variables(spec: &StudySpec) {
    let names = spec.space.parameters().iter().map(|parameter| parameter.name.as_str());
    for (variable, parameter) in same_words(|name| variable(VARIABLE, name), names) {
        progress::note(&format!("{variable} stands for several parameters; use {{{parameter}}}"));
    }
}

/// Words, such as variables, that an earlier parameter has already, each with the later one that has it too.
pub(crate) fn same_words<'a>(
    word: impl Fn(&str) -> String,
    parameters: impl IntoIterator<Item = &'a str>,
) -> Vec<(String, &'a str)> {
    let mut seen = BTreeSet::new();
    let named = parameters.into_iter().map(|parameter| (word(parameter), parameter));
    named.filter(|(word, _)| !seen.insert(word.clone())).collect()
}

#[cfg(test)]
mod tests {
    use treewright_client::ObjectiveTerm;

    use super::*;

    static GO_ON: AtomicBool = AtomicBool::new(false);

    /// The end of a run, and whether the program printed its own time.
    fn ended_for(
        minimised: &[&str],
        (code, out, said): (i32, &str, &str),
        metric: MetricSource,
    ) -> (Run, Option<bool>) {
        let term = |metric: &&str| ObjectiveTerm { metric: (*metric).to_owned(), weight: 1.0 };
        let terms: Vec<_> = minimised.iter().map(term).collect();
        let wanted = Wanted { terms: &terms, maximised: &[], limits: &[], most: Measurements::MOST };
        let (accepted, show_output, limit, stop) = (&[4][..], false, None, &GO_ON);
        let prints_time = Cell::new(None);
        let runner = Runner { metric, wanted, accepted, show_output, limit, stop, prints_time };
        let taken = Measurements::from([("wall_ms", 9.0), ("cpu_ms", 8.0)]);
        let run = runner.result(Fate::status(code << 8), &taken, out, said.to_owned());
        (run, runner.prints_time.get())
    }

    fn ended(code: i32, out: &str, said: &str, metric: MetricSource) -> Run {
        let minimised: &[&str] = if metric == MetricSource::Json { &["loss"] } else { &[] };
        ended_for(minimised, (code, out, said), metric).0
    }

    #[test]
    fn a_time_that_the_program_prints_itself_is_noticed() {
        let of = |code, out| ended_for(&["wall_ms"], (code, out, ""), MetricSource::Json).1;
        assert_eq!(of(0, r#"{"loss": 2}"#), Some(false));
        assert_eq!(of(0, r#"{"wall_ms": 2}"#), Some(true));
        assert_eq!(of(1, r#"{"wall_ms": 2}"#), None, "a failed run tells nothing");
    }

    #[test]
    fn times_and_printed_numbers_are_taken() {
        let Run::Done(times, _) = ended(0, r#"{"loss": 1}"#, "", MetricSource::Time) else {
            panic!("it is well")
        };
        assert_eq!((times.get("wall_ms"), times.get("loss")), (Some(9.0), None));
        let printed = ended(0, "{\"loss\": 1}\n{\"loss\": 7.5}\nbye\n", "", MetricSource::Json);
        let Run::Done(printed, _) = printed else { panic!("it is well") };
        assert_eq!(printed.get("loss"), Some(7.5), "the last object counts");
    }

    #[test]
    fn failures_are_told_in_the_programs_own_words() {
        let Run::Failed { reason, said } = ended(3, "", "no\nmemory\n\n", MetricSource::Time) else {
            panic!("it fails")
        };
        assert!(reason.contains("3") && reason.ends_with("memory"), "{reason}");
        assert_eq!(said, "no\nmemory\n\n");
        let infeasible = ended(3, r#"{"infeasible": "too deep"}"#, "", MetricSource::Json);
        assert_eq!(infeasible, Run::Infeasible("too deep".to_owned()));
        let without = ended(0, "done", "", MetricSource::Json);
        assert!(matches!(without, Run::Failed { reason, .. } if reason.contains("loss")));
    }

    #[test]
    fn parameters_of_one_variable_are_found() {
        let one = |name: &'static str| ("P_A_B".to_owned(), name);
        let word = |name: &str| variable("P_", name);
        assert_eq!(same_words(word, ["a_b", "a-b", "c", "A_B"]), [one("a-b"), one("A_B")]);
        assert!(same_words(word, ["ab", "a_b"]).is_empty());
    }

    #[test]
    fn what_is_kept_is_bounded_and_begins_with_a_whole_line() {
        let tail = |pieces: &[&[u8]]| {
            let mut tail = Tail::<ChildStdout> { source: None, kept: VecDeque::new(), is_cut: false };
            pieces.iter().for_each(|piece| tail.keep(piece));
            assert!(tail.kept.len() <= KEPT_BYTES);
            tail
        };
        assert_eq!(tail(&[b"a\n", b"b"]).lines(), "a\nb");
        let long = [b'x'; KEPT_BYTES];
        assert_eq!(tail(&[&long, b"{\"loss\": 1}\n", b"end"]).lines(), "end");
        assert_eq!(tail(&[&long, &long]).lines(), "", "no line is whole");
        assert_eq!(tail(&[&long, &long]).text().len(), KEPT_BYTES);
    }
}
